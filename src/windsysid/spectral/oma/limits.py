"""Limits of operational modal analysis: each says whether it is a probability, odds, a size or a setting."""

MAX_FILLED_SHARE = 0.2
"""Size: share of missing samples up to which short gaps are filled by interpolation (`fill_short_gaps`)."""

MAX_FREQUENCY_SHARE = 0.42
"""Size: highest frequency of modes over the sampling rate; anti-aliasing filters fall off beyond. For another low-pass
filter, twice as much of its cut-off, as half the rate is the cut-off of an anti-aliasing filter."""

MIN_CYCLES = 8
"""Size: cycles in the record of the lowest frequency of modes."""

MAX_BAND_MODES = 5
"""Setting: largest number of modes in one band."""

MAX_BANDS = 24
"""Setting: number of bands that are analysed if no limits are given."""

BAND_SEARCHES = 2
"""Setting: number of times that bands are placed anew."""

MAX_BORDER_SHIFT = 0.15
"""Tolerance: of a band's borders about their right places, over its width, within which it is not fitted again."""

MAX_HARMONIC_HALF_WIDTHS = 1.5
"""Size: distance from a rotor harmonic, in half-widths of a peak, up to which it may be one of rotationally sampled
wind; with less, a mode next to blade passing is taken for it (tests/modal/matching)."""

MIN_PEAK_SIGMAS = 8.0
"""Size in standard deviations: rise of a peak that requires a mode, and of a peak in the correlation of two records
that hold the same motion."""

PEAK_WIDTH_FACTOR = 3.0
"""Size: factor on half-widths: of a mode and of such a peak, the larger of which is the distance within which the mode
explains the peak (few bins give its half height inaccurately); and of two modes, whose sum is the distance within which
one may be the skirt of the other."""

MIN_POWER_SHARE = 0.5
"""Size: share of a channel's power in a peak, twice that of its half-power range, that is most of its vibration; share
of the power there that modes explain if the peak is theirs."""

MIN_LOG_ODDS = 5.0
"""Log odds: evidence of the modes of a band against none, very strong beyond 5 (Kass & Raftery, J. Am. Stat. Assoc.
90, 1995)."""

MIN_BLADE_RATIO = 3.0
"""Size: motion of the blades over that of the support from which on a mode is one of the blades."""

MIN_ASSURANCE = 0.4
"""Size: modal assurance criterion from which on two shapes with two common sensors may be of the same mode."""

MAX_RECORD_DISTANCE = 3
"""Setting: number of following records that are searched for overlap; equal files are found wherever they are."""

MIN_SHAPE_ASSURANCE = 0.95
"""Size: modal assurance criterion below which shapes that scatter too much are not one shape."""

JOINT_STEPS = 120
"""Setting: largest number of iterations of a fit of several records."""

MAX_SENSORS = 60
"""Setting: largest number of channels that are chosen if none are listed."""

SHAPE_PHASE_STD, SHAPE_PHASE_FREEDOM = 0.03, 2.0
"""Setting: prior of the phases of mode shapes of real structures: their standard deviation [rad], added to their
uncertainty, and its degrees of freedom."""

MAX_LAG_PERIODS = 0.5
"""Setting: range ± of lags in periods of the highest mode, whose phase repeats beyond."""

MAX_SEARCHED_PERIODS = 2.0
"""Setting: largest lag that is searched, in periods of the highest mode."""

LAGS_PER_PERIOD = 80
"""Setting: number of lags that are evaluated in a period of the highest mode."""

LAG_SWEEPS = 20
"""Setting: number of sweeps over the channels; from half of them on, the steps become smaller."""

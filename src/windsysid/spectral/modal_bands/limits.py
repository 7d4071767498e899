"""Limits of the modes of a band; those without a source were set on simulated records."""

LINE_HALF_WIDTHS, HARMONIC_HALF_WIDTHS = 0.3, 1.0
"""Size: distance in half-widths ζ f below which a sinusoid, or a rotor harmonic with its skirts, disturbs a mode."""

MAX_RELIABLE_LOG_DAMPING_STD = 0.6
"""Size: standard deviation of ln ζ beyond which a record is too short."""

MIN_PROMINENCE, MIN_CLEAR_PROMINENCE = 2.0, 5.0
"""Size: power of a mode at its natural frequency over the background. A mode below the first represents the background,
as no power law fits the skirts of several modes; a mode below the second may, and does at the border of a band."""

MIN_HALF_WIDTH_BINS = 0.4
"""Size: half-width ζ f of a mode in bins; a narrower one cannot be distinguished from a sinusoid."""

MAX_SHAPE_STD = 0.15
"""Size: root mean square of a shape's standard deviations beyond which the shape is uncertain."""

MAX_DAMPING = 0.2
"""Size: damping ratio beyond which a mode is background."""

LOADS = (
    ((1 / 3, 0.06, 0.7), (0.04, 0.3), 0.0),
    ((1 / 20, 0.06, 0.7), (0.3, 0.5), 0.0),
    ((1 / 4, 0.005, 1.2), (0.0, float("inf")), 0.9),
)
"""Odds: of waves, of short waves and of a machine of varying speed against a mode, with the median and the logarithmic
standard deviation of their half-widths over frequency, their ranges of frequencies [Hz], and the probability that they
vary as machines do (`check.variation`). Peak periods of seas are 3 to 25 s, half-widths 3 to 12 % for JONSWAP spectra.
``python -m validation.oma`` counts machines that are taken for modes."""

MACHINE_VARIATIONS, MAX_STEADINESS = (0.35, 0.4, -0.4, 0.4), 1000.0
"""Setting: of motion under a machine with the background in its band:

- median and logarithmic standard deviation of the envelope's coefficient of variation, where random loads have 0.52;
- mean and standard deviation of the ln ratio of the variations of amplitude and phase, less its mean under random
  loads;
- the largest ratio of the densities, whose tails are not known any better."""

LEVEL_VARIATION = (0.3, 0.4, 0.2)
"""Setting: share of records in which the level of random loads varies, as in gusts or traffic; mean, and standard
deviation, of the rise of ln of the envelope's coefficient of variation there; standard deviation of the ln ratio of the
variations there."""

STRUCTURAL_DAMPING = ((0.8, 0.012, 0.7), (0.2, 0.06, 0.7))
"""Setting: prior of the damping ratios of modes, as shares, medians and logarithmic standard deviations: of structures,
and with aerodynamic, soil or added damping."""

MIN_MOTION = 0.2
"""Setting: motion of a channel over the largest from which on it is a dimension of shapes."""

SHAPE_DEVIATIONS = (0.005, 0.05)
"""Setting: prior of 1 − MAC of a shape under a load from that of the neighbouring mode, as means of exponential
distributions: near it, and quasi-static."""

EQUAL_SHAPES, PRIOR_PAIRS = (0.01, 0.5), 2.0
"""Setting: shares of pairs of modes whose shapes are as equal to the sensors as those of a mode and a load: of close
ones, as of a tuned mass damper, and a priori of others, as the bending modes of a tower at its top; as how many pairs
of the record the latter counts."""

MAX_CLOSE_RATIO = 1.5
"""Size: ratio of frequencies up to which two modes are close; and ratio of the highest to the lowest frequency below
which a clock lag resembles a constant phase."""

COMB_ODDS, MULTIPLE_MODES = (0.5, 0.01), 0.02
"""Odds: of a turning rotor of unknown speed, in records whose channels name a turbine and in others; and of modes at
multiples of one frequency, as those of a cable."""

HARMONIC_DAMPING, MAX_COMB_ORDER = ((0.5, 0.04, 0.5), (0.5, 0.005, 1.2)), 4
"""Setting: prior of the half-widths of rotor harmonics over frequency, as shares, medians and logarithmic standard
deviations: of what the blades sample of turbulence (OpenFAST's records of two turbines have 2 to 9 %), and of a machine
whose speed varies. Highest multiple of the first frequency in a comb, and of the blade-passing frequency of three
blades at which turbulence widens a harmonic: all harmonics of an idling rotor would cover every frequency."""

COMB_SCATTER = 0.5
"""Setting: distance of such a peak from its multiple in its half-widths, as a standard deviation: it has no mode's
form."""

MAX_LOAD_ODDS = 0.5
"""Odds: of a load against a mode beyond which a peak is not graded."""

"""Limits of the checks of a result: each says whether it is a probability, odds or a size, and where it comes from.

Most were set on simulated records; ``python -m validation.adversary.calibrate`` prints those of the verdict in addition
to what healthy records show. Each of some ten tests may condemn one healthy record in 500.
"""

FALSE_ALARM_PROBABILITY = 1e-3
"""Probability: significance level of a test, all channels, frequencies and times together: of innovations, lines, dead
channels, bursts, effects, scatter between parts and breaks of readings; set on simulated records
(`validation.adversary.calibrate`)."""

DISPERSION_PRIOR_ODDS = 0.1
"""Odds: that the scores of a record's parts scatter by more than the model says, before they are seen."""

MAX_WIDENING = 5.0
"""Size: factor on a standard deviation beyond which a record contradicts the model so much that no interval covers the
error; and beyond which an interval that covers rival explanations must be informative."""

MIN_RIVAL_PROBABILITY = 0.5
"""Probability: of a rival explanation whose evidence is not known."""

STRONG_LOG_ODDS = 3.0
"""Log odds: strong evidence for one explanation against another, 20 to 1 (Kass & Raftery, J. Am. Stat. Assoc. 90,
1995): for a narrow-band load or one mode more, and of a peak of a rotor against another one."""

LOG_EVIDENCE_STD = 3.0
"""Log odds: standard deviation of the error of the log evidence of approximate models, which preferred the wrong one by
3 to 5 (``python -m validation.towers``)."""

SHORT_NOISE_VIBRATION_PROBABILITY = 0.1
"""Probability: share of channels of noise that are taken for vibration in records that are short or end just above the
highest mode, whose resonances rise little above a power law."""

MIN_LONG_RECORD_BINS = 200
"""Size: number of frequency bins below which a record is short for the test of dead channels."""

MIN_VIBRATION_BINS = 40
"""Size: number of frequency bins below which no channel is tested for vibration."""

MAX_MISSING_SHARE = 0.05
"""Size: share of missing samples beyond which a channel is tested neither for lines nor for vibration."""

HARMONIC_HALF_WIDTH_SHARE = 0.02
"""Size: relative distance from a rotor harmonic nP within which power is the rotor's."""

HARMONIC_HALF_WIDTH_BINS = 3.0
"""Size: the same distance in frequency bins 1/T, the larger of both counts; and distance beyond a mode's half-width ζf
within which a blade-passing line is in it."""

CONFLICT_SIGMAS = 4.0
"""Size in standard deviations: difference that chance does not explain, one in 16 000: of an estimate or of a sensor's
offset from its prior, of two clocks, of a clock drift or of the amplitude of a force from 0, of which chance exceeds it
in one of 3000."""

MIN_CONDITION_INDEX = 30.0
"""Size: condition index from which on a combination of parameters is hardly identifiable (Belsley, Kuh & Welsch)."""

MIN_NAMED_CORRELATION = 0.9
"""Size: correlation of two estimates from which on both are named."""

INTEREST_FACTORS = (0.4, 2.5)
"""Size: factors on the lowest and on the highest natural frequency between which a spectral peak matters."""

OUTLIER_SIGMAS = 5.0
"""Size in standard deviations: innovation from which on it is an outlier, or mean from which on it is a bias; one
normal value in two million; and significance of lost rows, of which some 2000 patterns are tested."""

MIN_REMARKED_OUTLIERS = 3
"""Size: number of outliers of a channel from which on they are remarked."""

MAX_OUTLIER_SHARE = 0.05
"""Size: share of a channel's readings up to which they are outliers, and left out; with more the model is wrong."""

MAX_LEVEL_FACTOR = 1.15
"""Size: factor on the normalised innovation squared of all channels or of one. Levels are learned: one healthy record
in 500 is 1.06 off with all and 1.14 with one channel (`python -m validation.adversary.calibrate`)."""

MAX_CHANCE_SIGMAS = 4.5
"""Size in standard deviations: statistic of level, tails, lag of blades, or correlation of channels beyond chance; all
but the lag must be large, too. One healthy record in 500 exceeds 4.2, 3.9, 4.2 and 4.5."""

MAX_LEVEL_VARIATION = 0.25
"""Size: relative variation of the level of innovations over a record that is large."""

MAX_KURTOSIS = 1.0
"""Size: excess kurtosis of innovations that is large."""

MAX_CROSS_CORRELATION = 0.06
"""Size: correlation of the innovations of two channels that is large."""

MAX_PEAK_LEVEL = 2.0
"""Size: spectrum of the innovations at a peak near a natural frequency, 1 if white; intervals are √2 too narrow there.
One healthy record in 500 has 2.1."""

MAX_NEAR_MODE_LEVEL = 1.6
"""Size: mean spectrum of the innovations around a natural frequency, 1 if white; one healthy record in 500 has it."""

MAX_FAR_PEAK_LEVEL = 3.0
"""Size: spectrum of the innovations, 1 if white, beyond which a peak far from natural frequencies is remarked."""

MAX_SQUARED_AUTOCORRELATION = 0.02
"""Size: sum of squared autocorrelations beyond which colour is remarked; one correlation of 0.14."""

MAX_LEVEL_DEPARTURE = 0.05
"""Size: rms departure of the spectrum of innovations from 1 over half-octaves, beyond chance; healthy fits have
0.04."""

MIN_NONLINEARITY_SAMPLES = 500
"""Size: number of innovations below which no channel and no load is tested for nonlinearity."""

LINE_NEAR_MODE_FACTOR = 1.2
"""Size: factor on a natural frequency within which a line of the innovations, or a blade-passing load that is not
modelled, biases the mode."""

LINE_SEARCH_FACTOR = 1.6
"""Size: factor on a natural frequency within which lines of the readings are searched: they bias the level of the loads
there, too, and within which another coordinate's mode may look like a line or a narrow-band load."""

MIN_RESONANCE_WIDTH_BINS = 5.0
"""Size: half-power width of a resonance in frequency bins 1/T below which its peak resembles a line, and distance from
it within which no line is searched: from 5 on, its skirts are parabolas in 1/S
(``tests/results/test_steadiness.py``)."""

MAX_INFORMED_STD_RATIO = 0.7
"""Size: standard deviation of a tolerance's estimate, or of a quantity whose interval covers rivals, over that of its
prior, below which the record is informative."""

MIN_DEVIATION_SIGMAS = 2.0
"""Size in standard deviations: estimate of an informed tolerance from which on its file is wrong."""

MAX_DISAGREEMENT_SIGMAS = 3.0
"""Size in standard deviations: difference between two values of a coefficient, by filters and by spectra or under two
explanations nearly as good, or of a tolerance from 0, beyond which they conflict; two independent estimates exceed it
once in 370."""

MIN_BURST_SHARE = 0.375
"""Size: share of a channel's power in one of 16 segments of a burst: the rms is three times that of the rest."""

MIN_RMS_FALL = 3.0
"""Size: ratio of rms values of a transient in one channel, and its root if all of two or more channels exceed it; of
1500 simulated stationary records at most one of 160, or one of 20, exceeds it in one channel."""

NEGLIGIBLE_SHARE = 0.1
"""Size: share of a quantity up to which a contribution to it is neglected: an offset of a sample's noise, loads of a
motion's rms, another coordinate of a reading, the integration of a damping ratio, a coefficient of a mode's variance, a
parameter of a direction, a widening of an interval, outliers of squared innovations. In squares it is 1 %."""

MAX_EARLIER_RATIO = 0.3
"""Size: ratio of the mean square of segments before the strongest to it in a decay, except the one immediately before,
in which the decay may begin."""

"""Limits of the checks of a result: each says whether it is a probability, odds or a size, and where it comes from.

Most were set on simulated records; ``python -m validation.adversary.calibrate`` prints those of the verdict in addition
to what healthy records show. Each of some ten tests may condemn one healthy record in 500.
"""

FALSE_ALARM_PROBABILITY = 1e-3
"""Probability: significance level of a test, all channels, frequencies and times together: of innovations, lines, dead
channels, bursts, effects, scatter between parts, breaks of readings and bound phases; set on simulated records
(`validation.adversary.calibrate`)."""

SCREENING_PROBABILITY = 0.01
"""Probability: significance level, all comparisons together, of a change of vibration, of a sinusoid's scatter
over segments and of a rotor harmonic in innovations; and, with the fit's unknowns fixed, of an effect that is tested
with them. Simulated records of one to four modes with damping of 0.2 % to 5 % and 300 s to 3600 s exceed it in fewer
than 1 % (tests/inspection)."""

MODEL_CHANGE_PROBABILITY = 1e-4
"""Probability: significance level of what changes readings or a model: sinusoids, correlated loads of modes, clock lags
over all channels; and of an image of a mode over all shifts of frequency."""

PRIOR_ODDS_OF_MISFIT = 0.1
"""Odds: that the scores of a record's parts scatter by more than the model says, or that the prior of a coefficient is
too narrow, before the record is seen."""

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
"""Size: share of a channel's samples: with more missing ones it is tested neither for lines nor for vibration; if more
are left out as outliers, the model is wrong."""

HARMONIC_HALF_WIDTH_SHARE = 0.02
"""Size: relative distance from a rotor harmonic nP within which power is the rotor's; and standard deviation of the
rotor speed over its mean up to which the speed is constant. With more variation, harmonics and whirl modes are smeared,
spectra that require a constant speed are refused, and a spectrogram is drawn against the speed."""

HARMONIC_HALF_WIDTH_BINS = 3.0
"""Size: number of frequency bins 1/T:

- distance from a rotor harmonic, if it is more than `HARMONIC_HALF_WIDTH_SHARE` of its frequency;
- distance within which two sinusoids are not resolved;
- distance beyond a mode's half-width ζf within which a blade-passing line is in the mode;
- distance within which a narrow-band load may resemble a line; or, if that is more, as many of its half-widths."""

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

MAX_CHANCE_SIGMAS = 4.5
"""Size in standard deviations: difference beyond chance:

- of the level, the tails and the correlation of innovations, which must also be large, and of the blades' lag; one
  healthy record in 500 exceeds 4.2, 3.9, 4.5 and 4.2;
- of the mean square of a part of a rotor's spectra, which must also be large;
- of a peak from the background of the averaged log spectrum."""

MAX_LEVEL_VARIATION = 0.25
"""Size: relative variation of the level of innovations over a record that is large."""

MAX_KURTOSIS = 1.0
"""Size: excess kurtosis of innovations that is large."""

MAX_COLOUR = 0.06
"""Size: correlation of the innovations of two channels that is large; and rms difference of the spectrum of innovations
from 1 over half-octaves, beyond chance, that is large: healthy fits have 0.04."""

MAX_PEAK_LEVEL = 2.0
"""Size: spectrum of the innovations at a peak near a natural frequency, 1 if white; intervals are √2 too narrow there.
One healthy record in 500 has 2.1."""

MAX_NEAR_MODE_LEVEL = 1.6
"""Size: mean spectrum of the innovations around a natural frequency, 1 if white, that is large; one healthy record in
500 has it. And mean square of a part of a rotor's spectra, or its inverse, that is large: intervals are too narrow by a
factor of √1.6 there."""

MAX_FAR_PEAK_LEVEL = 3.0
"""Size: spectrum of the innovations, 1 if white, beyond which a peak far from natural frequencies is remarked."""

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
"""Size: standard deviation of an estimate over that of its prior, below which the record is informative (0.7: it has as
much information as the prior): of a tolerance, of a quantity whose interval covers rivals and of the damping of a
mode."""

MAX_DISAGREEMENT_SIGMAS = 3.0
"""Size in standard deviations: difference between two values of a coefficient, by filters and by spectra or under two
explanations nearly as good, or of a tolerance from 0, beyond which they conflict; two independent estimates exceed it
once in 370."""

MIN_RMS_FALL = 3.0
"""Size: ratio of rms values:

- of the beginning of a transient to its end in one channel; its root if all of two or more channels exceed it. Of 1500
  simulated stationary records at most one of 160, or one of 20, exceeds it in one channel;
- of a burst, one of 16 segments, to the other segments;
- of the strongest segment to those before a decay: its root at least."""

NEGLIGIBLE_SHARE = 0.1
"""Size: share of a quantity up to which a contribution to it is neglected:

- of an offset to the noise of a sample, of loads to the rms of a motion, of another coordinate to a reading;
- of the Runge–Kutta method to a damping ratio, of a coefficient to a mode, of a parameter to a direction;
- of parts, rivals and the level of innovations to an interval, and of outliers to squared innovations;
- of a stopped rotor's speed to the usual one.

Or an angle [rad] that is neglected: a change of the yaw, or a phase that a clock's drift changes. Its square, 1 %, is
the share of a power that is neglected: of outliers and autocorrelation in squared innovations, of loads in a motion's
variance, and of a harmonic of a mode that a nonlinearity may cause."""

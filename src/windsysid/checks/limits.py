"""Limits of the checks of a result: each says whether it is a probability, odds or a size, and where it comes from.

Most were set on simulated records; ``python -m validation.adversary.calibrate`` prints those of the verdict in addition
to what healthy records show. Each of some ten tests may condemn one healthy record in 500.
"""

FALSE_ALARM_PROBABILITY = 1e-3
"""Probability: significance level of a test, all channels, frequencies and times together: of innovations, lines, dead
channels, bursts, effects, scatter between parts and breaks of readings; set on simulated records
(`validation.adversary.calibrate`)."""

SCREENING_PROBABILITY = 0.01
"""Probability: significance level, all comparisons together, of a change of vibration, of a force law or a correlation
of smoothed loads, of a sinusoid's scatter over segments and of a rotor harmonic in innovations; and, with the fit's
unknowns fixed, of an effect that is tested with them. Simulated records of one to four modes with damping of 0.2 % to
5 % and 300 s to 3600 s exceed it in fewer than 1 % (tests/inspection)."""

MODEL_CHANGE_PROBABILITY = 1e-4
"""Probability: significance level of what changes readings or a model: sinusoids, correlated loads of modes, clock lags
over all channels; and of a motion that is bound to another one, whose test is conservative: of 82 pairs of healthy
modes the least probability was 0.4."""

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
"""Size: share of missing samples beyond which a channel is tested neither for lines nor for vibration, and of readings
that are left out as outliers, beyond which the model is wrong."""

HARMONIC_HALF_WIDTH_SHARE = 0.02
"""Size: relative distance from a rotor harmonic nP within which power is the rotor's, and standard deviation of the
rotor speed over its mean up to which it is constant. Beyond, harmonics and whirl modes are smeared, spectra of a
constant speed are refused, and a spectrogram is drawn against the speed."""

HARMONIC_HALF_WIDTH_BINS = 3.0
"""Size: the same distance in frequency bins 1/T, the larger of both counts; distance within which two sinusoids are not
resolved; and distance beyond a mode's half-width ζf within which a blade-passing line is in it. A narrow-band load may
look like a line within so many of its half-widths."""

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
"""Size in standard deviations: statistic of level, tails, lag of blades, or correlation of channels beyond chance; all
but the lag must be large, too. One healthy record in 500 exceeds 4.2, 3.9, 4.2 and 4.5. And mean square of a part of a
rotor's spectra, and rise of a peak above the background in the averaged log spectrum."""

MAX_LEVEL_VARIATION = 0.25
"""Size: relative variation of the level of innovations over a record that is large."""

MAX_KURTOSIS = 1.0
"""Size: excess kurtosis of innovations that is large."""

MAX_COLOUR = 0.06
"""Size: correlation of the innovations of two channels that is large, and rms departure of their spectrum from 1 over
half-octaves, beyond chance; healthy fits have 0.04."""

MAX_PEAK_LEVEL = 2.0
"""Size: spectrum of the innovations at a peak near a natural frequency, 1 if white; intervals are √2 too narrow there.
One healthy record in 500 has 2.1."""

MAX_NEAR_MODE_LEVEL = 1.6
"""Size: mean spectrum of the innovations around a natural frequency, 1 if white; one healthy record in 500 has it. And
mean square of a part of a rotor's spectra, or its inverse; intervals are √1.6 too narrow there."""

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
"""Size: standard deviation of an estimate over that of its prior, below which the record is informative: of a
tolerance, of a quantity whose interval covers rivals and of the damping of a mode."""

MAX_DISAGREEMENT_SIGMAS = 3.0
"""Size in standard deviations: difference between two values of a coefficient, by filters and by spectra or under two
explanations nearly as good, or of a tolerance from 0, beyond which they conflict; two independent estimates exceed it
once in 370."""

MIN_RMS_FALL = 3.0
"""Size: ratio of rms values of a transient in one channel, and its root if all of two or more channels exceed it; of
1500 simulated stationary records at most one of 160, or one of 20, exceeds it in one channel. A burst in one of 16
segments has this ratio to the others; segments before a decay have at most its root."""

NEGLIGIBLE_SHARE = 0.1
"""Size: share of a quantity up to which a contribution to it is neglected: an offset of a sample's noise, loads of a
motion's rms, another coordinate of a reading and the yaw [rad] that mixes it in, the integration of a damping ratio, a
coefficient of a mode's variance, a parameter of a direction, a widening of an interval and its error by that of the
level of innovations, the phase [rad] that a clock's
drift changes, the speed of a stopped rotor, outliers of squared innovations. In squares it is 1 %: of squared
innovations that outliers add and autocorrelation predicts, and of a mode's power that a nonlinearity makes."""

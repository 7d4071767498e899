"""Decision limits of an identification: probabilities, odds and sizes that decide on models and findings.

Settings of solvers and arithmetic stand next to their code. "Proven" means that intervals were validated.
"""

# Records

MAX_RADIANS_PER_READING = 2.5
"""Size: longest time between readings, times the highest natural frequency [rad]: 2.5 readings for each period; and
times the lowest one, beyond which resampling removes its mode."""

MAX_RADIANS_PER_SPECTRAL_READING = 1.3
"""Size: the longest time between readings [rad] for spectra: motion above half the rate hardly reaches the modes."""

NEGLIGIBLE_SPEED_VARIATION = 0.005
"""Size: standard deviation of the rotor's speed over its mean, up to which spectra of a constant speed lose nothing."""

NEGLIGIBLE_SPEED_VARIATION_IN_BANDS = 0.15
"""Size: as `NEGLIGIBLE_SPEED_VARIATION`, of bands that follow the blades; source: ``python -m validation.auto``."""

MAX_SPEED_VARIATION_IN_BANDS = 0.2
"""Size: as `windsysid.checks.limits.HARMONIC_HALF_WIDTH_SHARE`, of bands that follow the blades; source:
``python -m validation.auto``."""

# Outliers

MAX_NEIGHBOUR_SHARE = 0.75
"""Size: share of a spike's difference that its neighbours may have; next to a spike they have half of it."""

# Effects

MIN_SHIFT_SIGMAS = 0.2
"""Size: shift of an estimate, in standard deviations, from which on an effect is included, and its size estimated
again. An error of that size widens an interval by 2 %."""

MAX_DRIFT_RATE = 3e-4
"""Size: largest drift that a clock can have [s/s]."""

MIN_DRIFT_WINDOWS = 6
"""Size: windows of a record, and samples of a channel, below which no clock drift is looked for."""

MIN_DRIFT_LOG_ODDS = 12.0
"""Log odds: rise of the log likelihood of slow readings of like sensors from which on they have random-walk biases."""

MIN_TREND_POWER = 100.0
"""Probability: power of the slowest terms over that of terms up to twice as fast, beyond which they are a trend;
chance alone leaves 45 once in ten thousand."""

# Sinusoids

MIN_F_OVER_POWER = 0.5
"""Size: F over a line's relative power: nearly all sinusoids have more, most narrow-band loads less."""

MIN_LINE_POWER = 9.0
"""Probability: power over its surroundings from which on a frequency may be a line, or a line in another channel the
same sinusoid; one in ten healthy records has it."""

MAX_SINUSOID_SHIFT_BINS = 0.3
"""Size: difference of a sinusoid's frequency between channels, in frequencies of the periodogram, or by chance, if
that is more."""

SINUSOID_DIGITS = 5.0
"""Odds: decimal digits of the chance that a line of the periodogram is as steady as `find_sine` requires."""

# Alternative explanations

NEGLIGIBLE_SHIFT_SIGMAS = 1.0
"""Size: standard deviations up to which a coefficient may differ under another explanation without effect, and a
statistic of loads or a tolerance, which coefficients follow, under an effect."""

# Verdict

MAX_RESONANCE_DOF = 50.0
"""Size: equivalent degrees of freedom within the narrowest resonance of a rotor under wind: bands grow narrower with
the record, errors of the load model stay. ``python -m validation.spectral`` shows them for 36."""

MIN_RESONANCE_DOF = 20.0
"""Size: as `MAX_RESONANCE_DOF`, at least, of a turning rotor and of each block of one: not proven below. Where
nothing turns, it is `windsysid.inspection.limits.MIN_DEGREES_OF_FREEDOM`."""

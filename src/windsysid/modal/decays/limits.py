"""Limits of the analysis of free decays: each says whether it is a probability, odds, a size or a setting."""

MAX_MODES = 12
"""Setting: largest number of modes of a decay."""

MIN_CYCLES = 2.0
"""Size: cycles of a mode in the record; a slower one cannot be distinguished from a drift."""

MAX_DAMPING = 0.3
"""Size: damping ratio beyond which a decay is over before it has become a vibration."""

AMBIENT_PROBABILITY = 1e-4
"""Probability: that ambient vibration is by chance as large at one of its instants as a decay at its beginning."""

TIME_CONSTANTS = 5.0
"""Size: time constants 1/(2π ζ f) of the slowest mode after which a record is cut off: its amplitude is below 1 %."""

START_PROBABILITY = 1e-3
"""Probability: of a larger residual at the beginning of a decay; below it the motion is not free yet."""

MAX_START_STEPS = 6
"""Setting: number of times that the beginning is moved by a cycle of the slowest mode."""

PEAK_PROBABILITY = 1e-4
"""Probability: that one of all averages of a periodogram of noise is taken for a peak."""

MIN_RATE_FACTOR = 6.0
"""Size: sampling rate over the highest frequency at which a decay stands out of the noise; of a higher one only the
noise between them is lost."""

ENERGY_WINDOWS = 200
"""Setting: number of windows of a record for the search of the release."""

MIN_WINDOW = 8
"""Setting: samples of such a window, at least."""

TIME_PARTS = 32
"""Setting: number of segments whose scores are compared."""

MIN_SAMPLES = 64
"""Size: smallest number of samples of a decay."""

MIN_NOISE = 1e-3
"""Size: smallest noise over the root mean square of a channel; structures are hardly linear to more digits."""

MIN_STRUCTURE_DAMPING = 0.001
"""Size: damping ratio of a structure; if the whole interval is below, a machine is more likely."""

MIN_DISTANCE = 1.0
"""Size: half-widths ζ f of a mode within which a stronger one makes it doubtful."""

MIN_DRIVEN_SHARE, MAX_DRIVEN_SHARE = 0.02, 0.3
"""Size: share of the power at the beginning in modes that do not decay, beyond which no mode of the record is to be
used, and beyond which it is no decay."""

COMBINATION_SIGMAS, COMBINATION_DISTANCE = 3.0, 1e-3
"""Size: distance of a mode from the sum or difference of two others, in standard deviations and relative, up to which a
quadratic nonlinearity may make it (OpenFAST's decays of a rotor have such)."""

MAX_SIDEBAND_ORDER, MAX_DECAY_DIFFERENCE = 6, 0.2
"""Size: order of a rotor harmonic that modulates a mode, twice the number of three blades, and the logarithm of the
ratio of the decays of the mode and its sideband, in addition to standard deviations."""

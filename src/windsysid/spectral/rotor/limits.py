"""Limits of lifted spectra; those without a source were set on simulated records."""

MIN_BINS = 3
"""Size: number of pools of bins."""

MIN_TURNS = 24
"""Setting: turns of the rotor that the message states if there are fewer pools."""

MAX_HARMONICS = 10
"""Setting: highest harmonic K, with which the size of matrices grows."""

"""Limits of lifted spectra; those without a source were set on simulated records."""

MIN_BINS = 3
"""Size: number of pools of bins."""

MIN_TURNS = 24
"""Setting: turns of the rotor that the message states if there are fewer pools."""

MAX_HARMONICS = 10
"""Size: highest harmonic K; if the rotor turns more slowly relative to its modes, matrices are too large."""

MAX_MEAN_SQUARE = 1.5
"""Size: mean square, or its inverse, beyond which it is a reason; at 1.5 intervals are √1.5 too narrow."""

MEAN_SQUARE_PROBABILITY = 3.4e-6
"""Probability: of a larger, or of a smaller, mean square of one part by chance."""

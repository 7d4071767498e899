"""Limits of transforms and of their sinusoids."""

MIN_SPREAD_BLOCKS = 3
"""Size: number of blocks from which on the variance of their energies is estimated."""

SINUSOID_FALSE_ALARM_PROBABILITY = 1e-3
"""Probability: significance level of the F test of sinusoids over all frequencies and channels of a record."""

"""Limits of transforms and of their sinusoids."""

MIN_SPREAD_BLOCKS = 3
"""Size: number of blocks from which on the variance of their energies is estimated."""

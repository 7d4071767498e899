"""Limits of transforms and of their bands."""

MIN_BAND_BINS = 8
"""Size: number of frequency bins, sinusoids apart, of a band that is fitted: of a whole record, a half or a quarter."""

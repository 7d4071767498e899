"""Matching of measured modes to modes of a model, with odds."""

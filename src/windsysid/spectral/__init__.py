"""Identification from spectra: modes of any structure from ambient vibration, and what the model says of the
spectra."""

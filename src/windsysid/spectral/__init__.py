"""Identification from spectra: modes of any structure from ambient vibration, and the model's properties from the
spectra."""

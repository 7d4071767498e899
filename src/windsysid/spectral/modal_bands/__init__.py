"""Modes within one frequency range: spectral model, likelihood, model order, checks."""

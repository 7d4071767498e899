"""Fourier transforms of readings: cross-spectra, rotating frame, multi-blade coordinates, lifted (harmonic)
representation.
"""

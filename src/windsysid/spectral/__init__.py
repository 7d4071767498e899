"""Identification from spectra: modes of any structure from ambient vibration, and what more the spectra of a rotor
tell."""

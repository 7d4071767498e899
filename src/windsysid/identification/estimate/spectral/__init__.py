"""Estimates from spectra: turbines, rotors in bands, equations, narrow-band loads."""

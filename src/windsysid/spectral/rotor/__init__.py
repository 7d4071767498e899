"""The likelihood of the spectrum of a turning or parked rotor as a function of its coefficients."""

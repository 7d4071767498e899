"""Modes from coefficients: frequencies and damping against rotor speed, Floquet's theory, stability."""

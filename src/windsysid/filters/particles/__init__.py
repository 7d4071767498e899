"""Particle filters: sequential importance resampling, and its Rao–Blackwellised form."""

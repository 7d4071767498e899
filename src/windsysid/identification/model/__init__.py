"""Unknowns, their priors and tolerances, and the problem that they pose."""

"""Simulation of a turbine's sensors: random loads or wind, integrated between samples."""

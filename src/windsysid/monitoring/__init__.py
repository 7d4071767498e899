"""Changes between results, aerodynamic damping, drifts and jumps over many records."""

"""What moved between results, what the air adds to damping, what drifts or jumps over many."""

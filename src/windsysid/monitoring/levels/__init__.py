"""State-space models of a level that drifts and jumps, seen in blocks."""

"""Limits of cross-spectra of linear time-invariant equations."""

MIN_RESONANCE_FREEDOM = 12.0
"""Size: equivalent degrees of freedom of a block within the narrowest resonance; the effect of a finite record on a
narrower resonance was never validated."""

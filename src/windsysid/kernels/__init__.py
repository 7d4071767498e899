"""The only package that imports Numba: options, vectors of doubles, rows of whole vectors, counter-based random
numbers."""

"""The only room that knows Numba: options, vectors of doubles, rows of whole vectors, random numbers by counting."""

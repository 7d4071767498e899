"""Singular values of the spectral matrix over frequency, as in frequency domain decomposition.

At a resonance one mode dominates, and the spectral matrix has nearly the rank 1: the largest singular value has a peak
there. Where two modes are close, the second one rises, too (Brincker, Zhang & Andersen, Smart Mater. Struct. 10, 2001,
https://doi.org/10.1088/0964-1726/10/3/303).
"""

import numpy as np

from windsysid._types import Array, Complex

__all__ = ["singular_values"]

MAX_VALUES = 6
"""Setting: number of singular values."""

AVERAGED_BINS = 9
"""Setting: frequency bins in each average."""

MAX_AVERAGES = 3000
"""Setting: number of averages; longer records have more bins in each."""


def singular_values(frequency: Array, values: Complex) -> tuple[Array, Array]:
    """Largest singular values of the spectral matrix, averaged over overlapping groups of neighbouring frequencies.

    Channels are scaled to the same median, so that units do not matter.

    Parameters
    ----------
    frequency, values
        (F,) [Hz], and transforms (F, n).

    Returns
    -------
    tuple of Array
        Frequencies (K,) [Hz], the middles of the groups, and the values (K, k), the largest first.

    Examples
    --------
    >>> frequency = np.arange(200.0)
    >>> f, s = singular_values(frequency, np.outer(np.exp(1j * frequency), [1.0, 2.0]))
    >>> bool(np.allclose(s[:, 0], 2.0 * np.log(2.0)) and np.allclose(s[:, 1], 0.0))
    True
    """
    median = np.median(np.abs(values) ** 2, axis=0)
    scaled = values * np.sqrt(np.log(2.0) / np.maximum(median, 1e-300))
    size = max(AVERAGED_BINS, 3 * (len(values) // MAX_AVERAGES))
    size, step = min(size, len(values)), max(1, size // 3)
    groups, near = (np.lib.stride_tricks.sliding_window_view(x, size, axis=0)[::step] for x in (scaled, frequency))
    found = np.linalg.svd(groups, compute_uv=False)[:, :MAX_VALUES] ** 2 / size
    return near.mean(axis=1), np.pad(found, ((0, 0), (0, min(MAX_VALUES, values.shape[1]) - found.shape[1])))

r"""Filling of short gaps by the conditional mean: linear prediction from the samples on both sides.

For a stationary Gaussian process with autocovariance R the mean of x_i given the known samples k in a window around it
is

    E[x_i | x_k] = C_ik C_kk⁻¹ x_k,        C_ab = R(|a − b|)

(kriging, Wiener interpolation). Narrow-band vibration is interpolated correctly up to half the sampling rate, noise is
not added. Polynomial interpolation has an error in proportion to the vibration: if samples are lost at regular
intervals, this error appears as vibration at other frequencies.

Source: Rasmussen & Williams, Gaussian Processes for Machine Learning, MIT Press 2006, section 2.2.
"""

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Mask

__all__ = ["fill_short_gaps", "in_short_gaps"]

HALF_WINDOW = 16
"""Number of samples on each side from which a missing one is predicted."""

MAX_ITERATIONS, MAX_CHANGE_SIGMAS = 10, 3e-3
"""Largest number of iterations of covariance and prediction, and the change of predictions, in standard deviations of
the channel, below which the iteration has converged."""

NOISE_VARIANCE_SHARE = 1e-9
"""Noise variance relative to the channel's variance: it makes the equations of a noiseless channel solvable."""

_BATCH = 4096  # samples that are predicted at a time


def in_short_gaps(missing: Mask, longest: int) -> Mask:
    """Mask (T,) of missing samples in gaps of at most `longest` samples with known samples on both sides."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(np.int8), [0]])))
    first, past = edges[::2], edges[1::2]
    short = (past - first <= longest) & (first > 0) & (past < missing.size)
    marks = np.zeros(missing.size + 1, dtype=np.int64)
    np.add.at(marks, first[short], 1)
    np.add.at(marks, past[short], -1)
    return np.asarray(np.cumsum(marks[:-1]) > 0)


def fill_short_gaps(values: Array, longest: int) -> Array:
    """Fill the gaps of at most `longest` samples in a uniformly sampled channel (T,); longer gaps stay missing.

    The autocovariance is estimated from the filled channel, iteratively; the first iteration fills by straight lines.
    """
    known = np.isfinite(values)
    missing = np.flatnonzero(in_short_gaps(~known, longest))
    if not missing.size or np.count_nonzero(known) <= 2 * HALF_WINDOW:
        return values
    mean, scale = float(values[known].mean()), float(values[known].std()) or 1.0
    index = np.arange(values.size)
    whole = np.interp(index, index[known], (values[known] - mean) / scale)
    for _ in range(MAX_ITERATIONS):
        before = whole[missing]
        whole[missing] = _predicted(whole, known, missing)
        if np.std(whole[missing] - before) <= MAX_CHANGE_SIGMAS:
            break
    filled = values.copy()
    filled[missing] = mean + scale * whole[missing]
    return filled


def _predicted(whole: Array, known: Mask, missing: NDArray[np.intp]) -> Array:
    """Conditional means of the samples at `missing`, given the known samples in windows around them."""
    covariance = _covariance(whole)
    padded, there = np.pad(whole, HALF_WINDOW), np.pad(known, HALF_WINDOW)
    around = np.arange(2 * HALF_WINDOW + 1)
    parts = []
    for batch in np.split(missing, np.arange(_BATCH, missing.size, _BATCH)):
        rows = batch[:, None] + around
        mask = there[rows]
        system = covariance * (mask[:, :, None] & mask[:, None, :])
        system[:, around, around] += ~mask * covariance[0, 0]
        weights = np.linalg.solve(system, (covariance[HALF_WINDOW] * mask)[:, :, None])[:, :, 0]
        parts.append(np.sum(weights * padded[rows], axis=1))
    return np.concatenate(parts)


def _covariance(values: Array) -> Array:
    """Covariance matrix of the samples in a window; dividing by T at every lag makes it positive semidefinite."""
    size = 2 * HALF_WINDOW + 1
    lags = np.array([values[lag:] @ values[: values.size - lag] for lag in range(size)]) / values.size
    lags[0] += NOISE_VARIANCE_SHARE
    index = np.arange(size)
    return np.asarray(lags[np.abs(index[:, None] - index)])

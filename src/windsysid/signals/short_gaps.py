r"""Missing samples between known ones, by their conditional mean: linear prediction from both sides.

For a stationary Gaussian process with autocovariance R the mean of x_i given the known samples k in a window around it
is

    E[x_i | x_k] = C_ik C_kk⁻¹ x_k,        C_ab = R(|a − b|)

(kriging, Wiener interpolation). Narrow-band vibration is continued up to half the sampling rate, noise is left out.
Interpolation by polynomials leaves an error that is a share of the vibration: where samples are lost at regular
intervals, it looks like vibration at other frequencies.

Source: Rasmussen & Williams, Gaussian Processes for Machine Learning, MIT Press 2006, section 2.2.
"""

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Mask

__all__ = ["fill_short_gaps", "in_short_gaps"]

HALF_WINDOW = 16
"""Samples on either side from which a missing one is predicted."""

MAX_ROUNDS, MAX_CHANGE = 10, 3e-3
"""Repetitions of covariance and prediction at most, and the change of predictions, in standard deviations of the
channel, below which they end."""

MIN_NOISE = 1e-9
"""Share of the variance that is added as noise, so that the equations of a noiseless channel can be solved."""

_BATCH = 4096


def in_short_gaps(missing: Mask, longest: int) -> Mask:
    """Which missing samples (T,) are in gaps of `longest` samples at most, with known samples on both sides."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(np.int8), [0]])))
    first, past = edges[::2], edges[1::2]
    short = (past - first <= longest) & (first > 0) & (past < missing.size)
    marks = np.zeros(missing.size + 1, dtype=np.int64)
    np.add.at(marks, first[short], 1)
    np.add.at(marks, past[short], -1)
    return np.asarray(np.cumsum(marks[:-1]) > 0)


def fill_short_gaps(values: Array, longest: int) -> Array:
    """A uniformly sampled channel (T,) with its gaps of `longest` samples at most filled; longer ones stay missing.

    The autocovariance is that of the filled channel, which starts from straight lines and is repeated.
    """
    known = np.isfinite(values)
    wanted = np.flatnonzero(in_short_gaps(~known, longest))
    if not wanted.size or np.count_nonzero(known) <= 2 * HALF_WINDOW:
        return values
    mean, scale = float(values[known].mean()), float(values[known].std()) or 1.0
    index = np.arange(values.size)
    whole = np.interp(index, index[known], (values[known] - mean) / scale)
    for _ in range(MAX_ROUNDS):
        before = whole[wanted]
        whole[wanted] = _predicted(whole, known, wanted)
        if np.std(whole[wanted] - before) <= MAX_CHANGE:
            break
    filled = values.copy()
    filled[wanted] = mean + scale * whole[wanted]
    return filled


def _predicted(whole: Array, known: Mask, wanted: NDArray[np.intp]) -> Array:
    """Conditional means of the samples `wanted` given the known ones in the windows around them."""
    covariance = _covariance(whole)
    padded, there = np.pad(whole, HALF_WINDOW), np.pad(known, HALF_WINDOW)
    around = np.arange(2 * HALF_WINDOW + 1)
    parts = []
    for batch in np.split(wanted, np.arange(_BATCH, wanted.size, _BATCH)):
        rows = batch[:, None] + around
        mask = there[rows]
        system = covariance * (mask[:, :, None] & mask[:, None, :])
        system[:, around, around] += ~mask * covariance[0, 0]
        weights = np.linalg.solve(system, (covariance[HALF_WINDOW] * mask)[:, :, None])[:, :, 0]
        parts.append(np.sum(weights * padded[rows], axis=1))
    return np.concatenate(parts)


def _covariance(values: Array) -> Array:
    """Covariance of the samples in a window; divided by T for every lag, it has no negative eigenvalue."""
    size = 2 * HALF_WINDOW + 1
    lags = np.array([values[lag:] @ values[: values.size - lag] for lag in range(size)]) / values.size
    lags[0] += MIN_NOISE
    index = np.arange(size)
    return np.asarray(lags[np.abs(index[:, None] - index)])

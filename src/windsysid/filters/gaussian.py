"""Shared parts of Gaussian filters: the belief, the information of a step, the protocol, and the scalar
update.

A measurement of m readings with independent noise is taken in one reading at a time, which needs no matrix to be
inverted and lets a missing reading (NaN) simply be left out. The covariance update is Joseph's form written out for a
scalar reading,

    P ← (I − K h) P (I − K h)ᵀ + K r Kᵀ = P − K vᵀ − v Kᵀ + s K Kᵀ,     v = P hᵀ,  s = h v + r,  K = v / s.

Source: Särkkä & Svensson, Bayesian Filtering and Smoothing (2nd ed.), ch. 6; Bucy & Joseph (1968).
"""

import math
import threading
from typing import Any

import numpy as np
from numba import types

from windsysid.kernels.jit import pasted
from windsysid.kernels.parts import lanes_sum
from windsysid.kernels.rows import inner, multiply
from windsysid.kernels.simd import LANES, load, splat, store

__all__ = ["ARGUMENTS", "assimilate", "assimilate_sample", "close_belief", "keep", "open_belief", "scratch"]


scratch = threading.local()


_vector, _matrix, _cube = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
ARGUMENTS = (
    _vector, _matrix, _vector, _matrix, _matrix, types.boolean, types.boolean,
    _cube, _matrix, _matrix, _matrix, _matrix, _matrix, _matrix, _vector, types.boolean[:, ::1],
)  # fmt: skip
"""Numba's types of the arguments of every filter's kernel after the model.

Mean and covariance, which it moves in place; the inputs at their own time; inputs and readings of T samples; whether
the mean has been moved to a sample's time before, and whether it moves now; the covariances to be kept (T or 0, n, n);
and the fields of `Info`."""


@pasted
def open_belief(ws: Any, mean: Any, cov: Any) -> None:
    """Begin a run: `mean` (n,) and `cov` (n, n) into ``ws.mean`` and ``ws.cov``, whose rows are whole vectors."""
    for i in range(mean.size):
        ws.mean[i] = mean[i]
        for j in range(mean.size):
            ws.cov[i, j] = cov[i, j]


@pasted
def close_belief(ws: Any, mean: Any, cov: Any) -> None:
    """End a run: ``ws.mean`` and ``ws.cov`` into `mean` (n,) and `cov` (n, n)."""
    for i in range(mean.size):
        mean[i] = ws.mean[i]
        for j in range(mean.size):
            cov[i, j] = ws.cov[i, j]


@pasted
def assimilate_sample(ws: Any, blocks: Any, readings: Any, gated: Any, whitened: Any, whitening_std: Any) -> float:
    """Take in a sample's readings, linearised at ``ws.about``, one after the other; the log density that they had."""
    vectors = ws.about.size // LANES
    total = 0.0
    for c in range(readings.size):
        whitened[c] = np.nan
        whitening_std[c] = np.nan
        if np.isnan(readings[c]) or gated[c]:
            continue
        moved = splat(0.0)
        for i in range(vectors):
            moved = moved + load(ws.H, c * vectors + i) * (load(ws.mean, i) - load(ws.about, i))
        z, std = assimilate(ws, c, readings[c] - ws.y[c] - lanes_sum(moved), blocks.noise[c])
        whitened[c] = z
        whitening_std[c] = std
        total -= 0.5 * (math.log(2.0 * math.pi) + z * z) + math.log(std)
    return total


@pasted
def keep(mean: Any, cov: Any, k: int, means: Any, stds: Any, covs: Any) -> None:
    """Make the covariance symmetric to the last digit and store the result of sample `k`."""
    n = means.shape[1]
    for i in range(n):
        for j in range(i):
            cov[i, j] = cov[j, i]
        means[k, i] = mean[i]
        stds[k, i] = np.sqrt(cov[i, i])
    if covs.shape[0] > 0:
        for i in range(n):
            for j in range(n):
                covs[k, i, j] = cov[i, j]


@pasted
def assimilate(ws: Any, c: int, residual: float, variance: float) -> tuple[float, float]:
    """Take in reading `c`, row c of ``ws.H`` its derivative h, into ``ws.mean`` and ``ws.cov``.

    `residual` is its deviation from the expectation at the current mean. Returns the whitened innovation and the
    standard deviation it was divided by.
    """
    n, vectors = ws.cov.shape[0], ws.cov.shape[1] // LANES
    v, K, pulled, mean, cov = ws.spread, ws.K, ws.pulled, ws.mean, ws.cov
    multiply(ws.nothing, ws.H, c, c + 1, 0, n, cov, v)
    s = variance + inner(ws.H, c, v, c)
    scale, size, step = splat(1.0 / s), splat(s), splat(residual)
    for i in range(vectors):
        along = load(v, c * vectors + i)
        gain = along * scale
        store(K, i, gain)
        store(pulled, i, size * gain - along)
        store(mean, i, load(mean, i) + gain * step)
    # P − K vᵀ + (s K − v) Kᵀ
    for j in range(vectors):
        along, gain = load(v, c * vectors + j), load(K, j)
        for i in range(n):
            at = i * vectors + j
            store(cov, at, load(cov, at) + splat(pulled[0, i]) * gain - splat(K[0, i]) * along)
    root = math.sqrt(s)
    return residual / root, root

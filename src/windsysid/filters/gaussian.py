"""Shared parts of Gaussian filters: the belief, the information of a step, the protocol, and the scalar
update.

A measurement of m readings with independent noise is taken in one reading at a time, which needs no matrix to be
inverted and lets a missing reading (NaN) simply be left out. With P the covariance before the sample,

    v_c = P h_cᵀ − Σ_{d<c} K_d (h_c v_d),   s_c = h_c v_c + r_c,   K_c = v_c / s_c,   P ← P − Σ_c K_c v_cᵀ,

so that P is read and written once a sample. Joseph's form would add the error of K_c, which is of the size of rounding.

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

__all__ = ["ARGUMENTS", "assimilate_sample", "close_belief", "keep", "open_belief", "scratch"]


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
    """Assimilate a sample's readings, linearised at ``ws.about``, given H P in ``ws.spread``; returns their log
    density."""
    vectors, m, n = ws.about.size // LANES, readings.size, ws.cov.shape[0]
    H, v, gains, mean = ws.H, ws.spread, ws.gains, ws.mean
    total = 0.0
    for c in range(m):
        whitened[c] = np.nan
        whitening_std[c] = np.nan
        if np.isnan(readings[c]) or gated[c]:
            for i in range(n):
                gains[i, c] = 0.0
            continue
        moved = splat(0.0)
        for i in range(vectors):
            moved = moved + load(H, c * vectors + i) * (load(mean, i) - load(ws.about, i))
        s = blocks.noise[c] + inner(H, c, v, c)
        scale, root = 1.0 / s, math.sqrt(s)
        residual = readings[c] - ws.y[c] - lanes_sum(moved)
        step = splat(scale * residual)
        for i in range(vectors):
            store(mean, i, load(mean, i) + step * load(v, c * vectors + i))
        for d in range(c + 1, m):
            share = splat(scale * inner(H, d, v, c))
            for i in range(vectors):
                store(v, d * vectors + i, load(v, d * vectors + i) - share * load(v, c * vectors + i))
        for i in range(n):
            gains[i, c] = -scale * v[c, i]
        z = residual / root
        whitened[c] = z
        whitening_std[c] = root
        total -= 0.5 * (math.log(2.0 * math.pi) + z * z) + math.log(root)
    multiply(ws.cov, gains, 0, n, 0, m, v, ws.cov)
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

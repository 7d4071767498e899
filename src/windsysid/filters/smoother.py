"""Rauch–Tung–Striebel smoothing: the state at each sample given the whole record, in square-root form.

Forward runs the filter. Back from the last sample, with the filter's m, P = S Sᵀ and its step to the next sample,

    next state = m⁻ + A ξ,   this state = m + [S 0] ξ,   ξ ~ N(0, I),
    A = [F S | noise] (extended), [d_j | noise] (unscented),

    ⎡  A  ⎤            ⎡ L    0 ⎤         m_s = m + M L⁻¹ (m_s' − m⁻),
    ⎣ S 0 ⎦ Orth.  =   ⎣ M    N ⎦,        P_s = N Nᵀ + (M L⁻¹ S_s') (M L⁻¹ S_s')ᵀ,

which is G = P Fᵀ P⁻⁻¹, P_s = P + G (P_s' − P⁻) Gᵀ without a difference of covariances and without P⁻, whose condition
is the square of L's. A direction that the step leaves without uncertainty (a constant, a parameter that is known) has a
zero in L and takes nothing from the sample after it.

Source: Rauch, Tung & Striebel, AIAA Journal 3(8), 1965; Park & Kailath, Int. J. Control 62(5), 1995 (square-root form);
Särkkä, IEEE TAC 53(3), 2008, https://doi.org/10.1109/TAC.2008.919531 (unscented); Särkkä & Svensson, ch. 12–14.
"""

import math
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numba import types

from windsysid._types import Array
from windsysid.filters.ekf import EKF
from windsysid.filters.protocol import Filter, Info, empty_info
from windsysid.filters.roots import RELATIVE_ROUNDING, factorise, triangularise
from windsysid.filters.ukf import SIGMA_POINTS, UKF, set_load_roots, sigma_points, spread_transition
from windsysid.kernels.jit import JACOBIAN, VALUE, compiled, uncounted
from windsysid.kernels.rows import inner, padded, write
from windsysid.kernels.simd import LANES, splat, store
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.step import interval, linearise_transition, set_parameters
from windsysid.statespace.workspace import BLOCKS, WORKSPACE, workspace

__all__ = ["Smoothed", "linearised_kernel", "smooth"]


CHUNK_SAMPLES = 2048
"""Samples of which all covariances are held at once."""


class Smoothed(NamedTuple):
    """Smoothed state at each sample, given all readings.

    Attributes
    ----------
    mean, std
        Mean and standard deviation (T, n).
    info
        Output of the filter (`windsysid.filters.Info`).
    """

    mean: Array
    std: Array
    info: Info


def smooth(model: StateSpace, inputs: Array, readings: Array, filter_: Filter = EKF) -> Smoothed:
    """Smooth a record: states, loads, biases and parameters at each sample, given all readings.

    Memory is that of the result, 4 n + 4 m numbers per sample, and 2048 + T/2048 covariances: the filter runs forward
    twice, the second time in chunks from the beliefs at their beginnings.

    Parameters
    ----------
    model : StateSpace
        Model of n states and m readings.
    inputs : ndarray
        Known inputs and known loads at each sample (T, n_u + n_w).
    readings : ndarray
        Readings (T, m); NaN = missing.
    filter_ : Filter, default EKF
        Forward filter. The backward pass of the `UKF` takes sigma points through the transition, that of every other
        filter its exact Jacobian.

    Returns
    -------
    Smoothed
        The state and its standard deviation at each sample (T, n), and the output of the filter.

    Raises
    ------
    ValueError
        If a shape does not fit the model.

    References
    ----------
    - Rauch, Tung & Striebel, AIAA Journal 3(8), 1965, doi:10.2514/3.3166.
    - Särkkä, IEEE Trans. Automatic Control 53(3), 2008, doi:10.1109/TAC.2008.919531 (unscented).
    - Särkkä & Svensson, Bayesian Filtering and Smoothing, 2nd ed., Cambridge 2023, ch. 12–14.

    Examples
    --------
    >>> import numpy as np
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    >>> stiffness, sensor = ws.models.Parameter("k", 3.0, 0.5), ws.models.Reading("position", q, noise=0.01)
    >>> model = ws.models.compose(
    ...     spring, rate=20.0, values={}, parameters=[stiffness], cov=np.eye(2), sensors=[sensor]
    ... )
    >>> time = 0.05 * np.arange(400)
    >>> readings = (np.exp(-0.1 * time) * np.cos(2.0 * time))[:, None]  # released at q = 1 m with k = 4 N/m
    >>> smoothed = ws.filters.smooth(model, np.zeros((400, 1)), readings)
    >>> smoothed.mean[0, :2].round(1).tolist(), smoothed.std.shape
    ([1.0, -0.1], (400, 3))
    """
    inputs = np.ascontiguousarray(inputs, dtype=np.float64)
    readings = np.ascontiguousarray(readings, dtype=np.float64)
    n, m, samples = len(model.states), len(model.readings), len(readings)
    chunks = [slice(first, first + CHUNK_SAMPLES) for first in range(0, max(samples, 1), CHUNK_SAMPLES)]
    beliefs = [filter_.init(model)]
    for chunk in chunks:
        beliefs.append(filter_.run(model, beliefs[-1], inputs[chunk], readings[chunk])[0])
    smoothed = Smoothed(np.empty((samples, n)), np.empty((samples, n)), empty_info(samples, n, m))
    back, mean, root = _backward(model, filter_), np.empty(n), np.empty((n, n))
    for chunk, belief in zip(chunks[::-1], beliefs[-2::-1], strict=True):
        _, info, covs = filter_.run_with_covariances(model, belief, inputs[chunk], readings[chunk])
        for whole, part in zip(smoothed.info, info, strict=True):
            whole[chunk] = part
        ahead = inputs[chunk.start : chunk.stop + 1]
        back(ahead, info.mean, covs, mean, root, smoothed.mean[chunk], smoothed.std[chunk])
    return smoothed


def _backward(model: StateSpace, filter_: Filter) -> Callable[..., None]:
    """For a model, the compiled way back: a function of `_ARGUMENTS`."""
    blocks, n = model.blocks, len(model.states)
    points = sigma_points(blocks)
    scratch = (workspace(blocks), points, padded(2 * n, points.width), padded(n, n))
    if filter_ == UKF:
        return partial(_compiled_unscented(), model.compiled.rates, blocks, *scratch)
    return partial(linearised_kernel(), model.compiled.rates_jacobian, blocks, *scratch)


_matrix, _cube = types.float64[:, ::1], types.float64[:, :, ::1]
_ARGUMENTS = (
    WORKSPACE, SIGMA_POINTS, _matrix, _matrix, _matrix, _matrix, _cube, types.float64[::1], _matrix, _matrix, _matrix,
)  # fmt: skip
"""Scratch, two blocks of rows (2n, w⁺) and a covariance (n, n⁺) among it; inputs of T samples and, unless they are the
last, of the one after them; the filter's means and covariances; mean and root of the sample after, which become those
of the first; means and standard deviations to be written."""


@lru_cache(maxsize=1)
def linearised_kernel() -> Any:
    """The compiled smoother of linearised steps, one for all models."""
    return compiled(_linearised, types.void(types.FunctionType(JACOBIAN), BLOCKS, *_ARGUMENTS), borrows=True)


@lru_cache(maxsize=1)
def _compiled_unscented() -> Any:
    return compiled(_unscented, types.void(types.FunctionType(VALUE), BLOCKS, *_ARGUMENTS), borrows=True)


def _linearised(
    rates_jacobian: Any, blocks: Any, ws: Any, points: Any, rows: Any, cov: Any, inputs: Any, filtered: Any, covs: Any,
    mean: Any, root: Any, means: Any, stds: Any,
) -> None:  # fmt: skip
    n, last, predicted = mean.size, inputs.shape[0] - 1, ws.mean
    set_load_roots(blocks, ws, points)
    for k in range(filtered.shape[0] - 1, -1, -1):
        for i in range(n):
            predicted[i] = filtered[k, i]
            write(cov, i * cov.shape[1], covs, (k * n + i) * n, n)
        factorise(cov, points.root)
        if k < last:
            _linearised_transition(rates_jacobian, blocks, ws, points, predicted, rows, inputs[k], inputs[k + 1])
        _retreat(points.root, points.pivot, filtered[k], predicted, rows, k == last, mean, root, means[k], stds[k])


def _unscented(
    rates: Any, blocks: Any, ws: Any, points: Any, rows: Any, cov: Any, inputs: Any, filtered: Any, covs: Any,
    mean: Any, root: Any, means: Any, stds: Any,
) -> None:  # fmt: skip
    n, last, predicted = mean.size, inputs.shape[0] - 1, ws.mean
    set_load_roots(blocks, ws, points)
    for k in range(filtered.shape[0] - 1, -1, -1):
        for i in range(n):
            predicted[i] = filtered[k, i]
            write(cov, i * cov.shape[1], covs, (k * n + i) * n, n)
        factorise(cov, points.root)
        if k < last:
            spread_transition(rates, blocks, ws, points, predicted, rows, inputs[k], inputs[k + 1])
        _retreat(points.root, points.pivot, filtered[k], predicted, rows, k == last, mean, root, means[k], stds[k])


@uncounted
def _linearised_transition(
    rates_jacobian: Any, blocks: Any, ws: Any, points: Any, mean: Any, rows: Any, before: Any, after: Any
) -> None:
    """Transition as by `spread_transition`, with exact Jacobians: [F S | Γ √Q | V | √walk] into `rows` 1 … n."""
    nx, nz, nb, nt, _, _ = blocks.sizes
    n, rest, rough = nx + nz + nb + nt, nx + nz, blocks.load_within.shape[2]
    s = interval(blocks, after)
    phi = blocks.load_transition[s]
    for c in range(rows.size // LANES):
        store(rows, c, splat(0.0))
    set_parameters(blocks, ws, mean)
    linearise_transition(rates_jacobian, blocks, ws, mean, before, after)
    for j in range(n):
        direction = points.root[j]
        for i in range(nx):
            rows[i, j] = inner(ws.F, i, points.root, j)
        for i in range(nz):
            for k in range(nz):
                rows[nx + i, j] += phi[i, k] * direction[nx + k]
        for i in range(rest, n):
            rows[i, j] = direction[i]
    for j in range(nz):
        for i in range(nx):
            for k in range(nz):
                rows[i, n + j] += ws.gain[i, k] * points.load_roots[s * nz + j, k]
        for i in range(nz):
            rows[nx + i, n + j] = points.load_roots[s * nz + j, i]
    for j in range(rough):
        for i in range(nx):
            rows[i, n + nz + j] = ws.within[i, j]
    for j in range(points.walking.size):
        i = points.walking[j]
        rows[rest + i, n + nz + rough + nx + j] = math.sqrt(blocks.walk[s, i])


@uncounted
def _retreat(
    own: Any, pivot: Any, filtered: Any, predicted: Any, rows: Any, is_last: bool, mean: Any, root: Any,
    means: Any, stds: Any
) -> None:  # fmt: skip
    """Smoothed mean and root of one sample from those of the next, in place.

    `own` is the filter's root, `predicted` the mean that its step leads to, `rows` (2n, w) begin with A; the rest is
    filled in here. The last sample is the filter's.
    """
    n, w = mean.size, rows.shape[1]
    if is_last:
        for i in range(n):
            mean[i] = filtered[i]
            for j in range(n):
                root[i, j] = own[i, j]
    else:
        for i in range(n):
            for j in range(n):
                rows[n + i, j] = own[j, i]
        triangularise(rows, pivot)
        for i in range(n):
            mean[i] -= predicted[i]
        _solve(rows, mean)
        for j in range(n):
            _solve(rows, root[j])
        # A's place now takes [M L⁻¹ S_s' | N]
        for i in range(n):
            below = rows[n + i]
            predicted[i] = filtered[i]
            for k in range(n):
                predicted[i] += below[k] * mean[k]
            for j in range(n):
                through = 0.0
                for k in range(n):
                    through += below[k] * root[j, k]
                own[i, j] = through
        for i in range(n):
            mean[i] = predicted[i]
            for j in range(n):
                rows[i, j] = own[i, j]
            for j in range(n, w):
                rows[i, j] = rows[n + i, j]
        triangularise(rows[:n], pivot)
        for i in range(n):
            for j in range(n):
                root[j, i] = rows[i, j]
    for i in range(n):
        means[i] = mean[i]
        variance = 0.0
        for j in range(n):
            variance += root[j, i] * root[j, i]
        stds[i] = math.sqrt(variance)


@uncounted
def _solve(rows: Any, right: Any) -> None:
    """L⁻¹ `right`, in place, L being the first n rows and columns of `rows`; zero where L's pivot is rounding."""
    n = right.size
    for i in range(n):
        row = rows[i]
        size = 0.0
        for j in range(i):
            right[i] -= row[j] * right[j]
            size += row[j] * row[j]
        size = math.sqrt(size + row[i] * row[i])
        right[i] = right[i] / row[i] if row[i] > n * RELATIVE_ROUNDING * size else 0.0

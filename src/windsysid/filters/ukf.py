"""The unscented Kalman filter, in square-root form: moments through sigma points, by values alone.

With the root S of P = S Sᵀ and its columns s_j, f₀ = f(m) and, for each of n points in each direction,

    d_j = [f(m + c s_j) − f(m − c s_j)] / 2c,      g_j = [f(m + c s_j) + f(m − c s_j)] / 2 − f₀,
    mean  f₀ + Σ g_j / c²,
    covariance  Σ d_j d_jᵀ + Σ g_j g_jᵀ / c² + (β − α²) (Σ g_j)(Σ g_j)ᵀ / c⁴.

That is the scaled unscented transform, c² = α² (n + κ), with its 2n + 1 weights written out: a mean weight below zero,
as there is with many states, then needs no downdate of the root as long as β ≥ α². Here α = β = 1 and κ = 3 − n. c = √3
gives the points the fourth moment of a Gaussian along each direction; it does not grow with n, as it does in the
cubature filter, so that adding a state leaves the others' points where they are; and β = α² makes the covariance a
plain sum of squares.

predict: the load noise η reaches the motion inside the step, and not linearly, so points are drawn in (state, η, ξ);
biases and parameters, which stay or walk, and load states, which are linear, are moved exactly. The root of the sum is
found by QR. update: points are drawn anew. The d_j are a linear reading of the n unit normals behind S, and Σ g_j g_jᵀ
/ c² is noise in addition to the sensors': with both the linear update is the unscented one. Decorrelated, the readings
are taken in one by one by Carlson's update, which unlike rank-one downdates cannot fail.

A belief carries the covariance, and every step begins with its Cholesky root: so step, run and restart agree bit for
bit.

Source: van der Merwe & Wan, ICASSP 2001, https://doi.org/10.1109/ICASSP.2001.940586; Julier, ACC 2002,
https://doi.org/10.1109/ACC.2002.1025369; Särkkä & Svensson, ch. 8.
"""

import math
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numba import types

from windsysid.filters.gaussian import ARGUMENTS, close_belief, keep, open_belief
from windsysid.filters.protocol import Filter
from windsysid.filters.roots import absorb, factorise, square, triangularise
from windsysid.kernels.jit import VALUE, compiled, uncounted
from windsysid.kernels.rows import padded
from windsysid.kernels.simd import LANES, splat, store
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.step import expected_reading, interval, move, set_load_outputs
from windsysid.statespace.workspace import (
    BLOCKS,
    WORKSPACE,
    Blocks,
    Indices,
    Matrix,
    Vector,
    load_output,
    scratch_type,
    workspace,
)

__all__ = ["UKF"]

SIGMA_POINT_SIGMAS = math.sqrt(3.0)
"""c: how many standard deviations the sigma points are out."""


def _kernel(model: StateSpace) -> Callable[..., None]:
    blocks = model.blocks
    points = sigma_points(blocks)
    rows = padded(len(model.states), points.width)
    return partial(_compiled(), model.compiled.rates, model.compiled.reading, blocks, workspace(blocks), points, rows)


UKF = Filter("unscented Kalman filter", _kernel)


class SigmaPoints(NamedTuple):
    """Scratch of the unscented transform.

    `root` (n, n) of the state's covariance, transposed, and `load_roots` (S, n_z, n_z) of the load noise; `width` of
    the rows that a step writes; `walking` names the biases and parameters that walk. For a reading, `directions` (n, m
    + n) and `centre` (m + n,) hold the readings' d_j and means, then those of the state; `curved` (m, m) is Σ g_j g_jᵀ
    / c² with the sensors' noise.
    """

    root: Matrix
    load_roots: Matrix
    width: int
    walking: Indices
    state: Vector
    eta: Vector
    loads: Vector
    first: Vector
    high: Vector
    curvature: Vector
    curved_x: Matrix
    root_x: Matrix
    bend: Vector
    curved: Matrix
    directions: Matrix
    centre: Matrix
    behind: Matrix
    pivot: Matrix


SIGMA_POINTS = scratch_type(SigmaPoints)
"""Numba's type of `SigmaPoints`."""


def sigma_points(blocks: Blocks) -> SigmaPoints:
    """Allocate `SigmaPoints` for a model."""
    nx, nz, nb, nt, _, _ = (int(size) for size in blocks.sizes)
    rough = blocks.load_within.shape[2]
    n, m, size = nx + nz + nb + nt, len(blocks.noise), max(nx, len(blocks.noise))
    walking = np.flatnonzero(blocks.walk[0] > 0.0)
    width = n + nz + rough + nx + len(walking)
    return SigmaPoints(
        root=padded(n, n), load_roots=padded(len(blocks.step) * nz, nz), width=width, walking=walking,
        state=padded(1, n)[0], eta=padded(1, nz)[0], loads=np.zeros(nz),
        first=np.zeros(size), high=np.zeros(size), curvature=np.zeros(size), curved_x=padded(nx, nx),
        root_x=padded(nx, nx),
        bend=np.zeros(size), curved=np.zeros((m, m)), directions=padded(n, m + n), centre=padded(1, m + n),
        behind=padded(1, m + n),
        pivot=padded(1, width),
    )  # fmt: skip


@lru_cache(maxsize=1)
def _compiled() -> Any:
    """The compiled filter, one for all models."""
    value = types.FunctionType(VALUE)
    return compiled(
        _run, types.void(value, value, BLOCKS, WORKSPACE, SIGMA_POINTS, types.float64[:, ::1], *ARGUMENTS), borrows=True
    )


def _run(
    rates: Any, reading: Any, blocks: Any, ws: Any, points: Any, rows: Any, mean: Any, cov: Any, previous: Any,
    inputs: Any, readings: Any, started: bool, moves: bool, covs: Any, means: Any, stds: Any,
    innovation: Any, innovation_std: Any, whitened: Any, whitening_std: Any, log_likelihood: Any, gated: Any,
) -> None:  # fmt: skip
    n, m = mean.size, blocks.noise.size
    open_belief(ws, mean, cov)
    set_load_roots(blocks, ws, points)
    before = previous
    for k in range(inputs.shape[0]):
        after = inputs[k]
        if started and moves:
            factorise(ws.cov, points.root)
            spread_transition(rates, blocks, ws, points, ws.mean, rows, before, after)
            triangularise(rows, points.pivot)
            for i in range(n):
                for j in range(n):
                    points.root[j, i] = rows[i, j]
            square(points.root, ws.cov)
        started = True
        before = after
        seen = 0
        for c in range(m):
            innovation[k, c] = np.nan
            innovation_std[k, c] = np.nan
            whitened[k, c] = np.nan
            whitening_std[k, c] = np.nan
            seen += 0 if np.isnan(readings[k, c]) else 1
        log_likelihood[k] = 0.0
        if seen > 0:
            factorise(ws.cov, points.root)
            spread_reading(reading, blocks, ws, points, ws.mean, after)
            log_likelihood[k] = _assimilate(
                blocks, points, ws.mean, readings[k], innovation[k], innovation_std[k], whitened[k],
                whitening_std[k], gated[k]
            )  # fmt: skip
            square(points.root, ws.cov)
        keep(ws.mean, ws.cov, k, means, stds, covs)
    close_belief(ws, mean, cov)


@uncounted
def set_load_roots(blocks: Any, ws: Any, points: Any) -> None:
    """The roots of the load noise of every interval."""
    nz = blocks.sizes[1]
    for s in range(blocks.step.size):
        factorise(ws.Q[s * nz : (s + 1) * nz], points.load_roots[s * nz : (s + 1) * nz])


@uncounted
def spread_transition(
    rates: Any, blocks: Any, ws: Any, points: Any, mean: Any, rows: Any, before: Any, after: Any
) -> None:
    """Move `mean` by one step, in place, and write `rows` (n, ≥ width) with rows rowsᵀ the covariance after it.

    The first n columns belong to the state's own directions, those after them to the noise.
    """
    nx, nz, nb, nt, _, _ = blocks.sizes
    n, rest, rough = nx + nz + nb + nt, nx + nz, blocks.load_within.shape[2]
    s = interval(blocks, after)
    phi = blocks.load_transition[s]
    state, eta, root = points.state, points.eta, points.root
    for c in range(rows.size // LANES):
        store(rows, c, splat(0.0))
    set_load_outputs(blocks, ws, before, after)
    for j in range(nz):
        eta[j] = 0.0
    move(rates, blocks, ws, mean, eta, before, after)
    for i in range(nx):
        points.first[i] = ws.x[i]
        points.bend[i] = 0.0
        for j in range(nx):
            points.curved_x[i, j] = 0.0
    for i in range(nz):
        points.loads[i] = ws.z[i]
    for j in range(n + nz + rough):
        direction = root[j] if j < n else points.load_roots[s * nz + min(j - n, nz - 1)]
        for side in range(2):
            out = SIGMA_POINT_SIGMAS if side == 0 else -SIGMA_POINT_SIGMAS
            for i in range(n):
                state[i] = mean[i] + out * direction[i] if j < n else mean[i]
            for i in range(nz):
                eta[i] = out * direction[i] if n <= j < n + nz else 0.0
                ws.middle[i] = out * ws.R[s * nz + i, j - n - nz] if j >= n + nz else 0.0
            move(rates, blocks, ws, state, eta, before, after)
            if side == 0:
                for i in range(nx):
                    points.high[i] = ws.x[i]
        for i in range(nx):
            rows[i, j] = (points.high[i] - ws.x[i]) / (2.0 * SIGMA_POINT_SIGMAS)
            points.curvature[i] = (0.5 * (points.high[i] + ws.x[i]) - points.first[i]) / SIGMA_POINT_SIGMAS
            points.bend[i] += points.curvature[i] / SIGMA_POINT_SIGMAS
        for i in range(nx):
            for k in range(i, nx):
                points.curved_x[i, k] += points.curvature[i] * points.curvature[k]
        if j < n:
            for i in range(nz):
                moved = 0.0
                for k in range(nz):
                    moved += phi[i, k] * direction[nx + k]
                rows[nx + i, j] = moved
            for i in range(rest, n):
                rows[i, j] = direction[i]
        elif j < n + nz:
            for i in range(nz):
                rows[nx + i, j] = direction[i]
    for i in range(nz):
        ws.middle[i] = 0.0
    factorise(points.curved_x, points.root_x)
    for i in range(nx):
        mean[i] = points.first[i] + points.bend[i]
        for j in range(i + 1):
            rows[i, n + nz + rough + j] = points.root_x[j, i]
    for i in range(nz):
        mean[nx + i] = points.loads[i]
    for j in range(points.walking.size):
        i = points.walking[j]
        rows[rest + i, n + nz + rough + nx + j] = math.sqrt(blocks.walk[s, i])


@uncounted
def spread_reading(reading: Any, blocks: Any, ws: Any, points: Any, mean: Any, inputs: Any) -> None:
    """Means, directions and additional noise of all readings, as `_assimilate` takes them."""
    n, m = points.root.shape[0], blocks.noise.size
    state, curved = points.state, points.curved
    load_output(blocks, ws, inputs, ws.H1)
    expected_reading(reading, blocks, ws, mean, inputs)
    for c in range(m):
        points.first[c] = ws.y[c]
        points.bend[c] = 0.0
        for d in range(m):
            curved[c, d] = 0.0
        curved[c, c] = blocks.noise[c]
    for j in range(n):
        direction = points.root[j]
        for side in range(2):
            out = SIGMA_POINT_SIGMAS if side == 0 else -SIGMA_POINT_SIGMAS
            for i in range(n):
                state[i] = mean[i] + out * direction[i]
            expected_reading(reading, blocks, ws, state, inputs)
            if side == 0:
                for c in range(m):
                    points.high[c] = ws.y[c]
        for c in range(m):
            points.directions[j, c] = (points.high[c] - ws.y[c]) / (2.0 * SIGMA_POINT_SIGMAS)
            points.curvature[c] = (0.5 * (points.high[c] + ws.y[c]) - points.first[c]) / SIGMA_POINT_SIGMAS
            points.bend[c] += points.curvature[c] / SIGMA_POINT_SIGMAS
        for c in range(m):
            for d in range(c, m):
                curved[c, d] += points.curvature[c] * points.curvature[d]
        for i in range(n):
            points.directions[j, m + i] = direction[i]
    for c in range(m):
        points.centre[0, c] = points.first[c] + points.bend[c]
    for i in range(n):
        points.centre[0, m + i] = mean[i]


@uncounted
def _assimilate(
    blocks: Any, points: Any, mean: Any, readings: Any, innovation: Any, innovation_std: Any,
    whitened: Any, whitening_std: Any, gated: Any,
) -> float:  # fmt: skip
    """Take in a sample's readings: mean in place, its root in `points`; the log density that they had."""
    directions, centre, noise = points.directions, points.centre, points.curved
    n, m = directions.shape[0], blocks.noise.size
    for c in range(m):
        if np.isnan(readings[c]):
            continue
        spread = noise[c, c]
        for j in range(n):
            spread += directions[j, c] * directions[j, c]
        innovation[c] = readings[c] - centre[0, c]
        innovation_std[c] = math.sqrt(spread)
        gated[c] = abs(innovation[c]) > blocks.gate[0] * innovation_std[c]
        centre[0, c] = -innovation[c]  # from here on, the mean of the reading's deviation from what was read
    total = 0.0
    for c in range(m):
        if np.isnan(readings[c]) or gated[c]:
            continue
        # one row of the noise's Cholesky factor: this reading to unit noise, those after it to what it does not explain
        own = math.sqrt(noise[c, c])
        centre[0, c] /= own
        for j in range(n):
            directions[j, c] /= own
        for d in range(c + 1, m):
            share = noise[c, d] / own
            if share != 0.0:
                centre[0, d] -= share * centre[0, c]
                for j in range(n):
                    directions[j, d] -= share * directions[j, c]
                for e in range(d, m):
                    noise[d, e] -= share * noise[c, e] / own
        z, std = absorb(directions, centre, c, points.behind)
        whitened[c] = z
        whitening_std[c] = std * own
        total -= 0.5 * (math.log(2.0 * math.pi) + z * z) + math.log(std * own)
    for i in range(n):
        mean[i] = centre[0, m + i]
    for j in range(n):
        for i in range(n):
            points.root[j, i] = directions[j, m + i]
    return total

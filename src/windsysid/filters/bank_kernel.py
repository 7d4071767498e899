"""The kernel of a bank of filters: `LANES` extended Kalman filters at once, one model in each lane of the processor's
vectors.

One sample goes through `load_ends`, `step_mechanics`, `transpose_derivatives`, `step_tangents`, `predict_covariance`,
`expect_readings`, `expect_changes` and `assimilate_sample`, in that order, the last three where it has readings;
`windsysid.filters.bank` says which equations they hold. Every array has the lane as its last axis. Arrays of a model
are read entry by entry where most of them are zero: the patterns in `Lanes` list the entries that are not.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import types

from windsysid.filters.lanes import Lanes, Scratch
from windsysid.kernels.jit import LANE_JACOBIAN, compiled, uncounted
from windsysid.kernels.simd import load, splat, square_root, store, vectors

__all__ = ["run_kernel"]

_i1, _i2 = types.int64[::1], types.int64[:, ::1]
_f1, _f2, _f3, _f4 = (types.Array(types.float64, d, "C") for d in (1, 2, 3, 4))
_LANES_TYPE = types.NamedTuple(
    [_i1, _f1, _i1, _f2, _f4, _f4, _f4, _f4, _f2, _i1, _f2, _i2, _i2, _i2, _i2, _i2, _i1, _i1], Lanes
)
_LINES = {
    "every": _i1,
    "u": _f1,
    **dict.fromkeys(("w", "rate", "H0", "H1", "w0", "w1", "z1", "x", "total", "y", "residual"), _f2),
}
_SCRATCH_TYPE = types.NamedTuple([_LINES.get(name, _f3) for name in Scratch._fields], Scratch)


@lru_cache(maxsize=1)
def run_kernel() -> Any:
    """The compiled run over T samples, one for all models."""
    model = types.FunctionType(LANE_JACOBIAN)
    signature = types.void(
        model, model, _LANES_TYPE, _SCRATCH_TYPE, _f2, _f3, _f3, _f1, _f2, _f2, _f4, _f3, types.boolean, types.intp,
        _f4, _f4, _f2, _f4,
    )  # fmt: skip
    return compiled(_run, signature, borrows=True)


def _run(
    rates_jacobian: Any, reading_jacobian: Any, lanes: Any, ws: Any, mean: Any, cov: Any, tangents: Any, previous: Any,
    inputs: Any, readings: Any, changes: Any, changed: Any, started: bool, group: int, whitened: Any, variance: Any,
    slopes: Any, responses: Any,
) -> None:  # fmt: skip
    n, wide = mean.shape[0], ws.P.shape[1]
    for i in range(n):
        for j in range(n):
            store(ws.P, i * wide + j, load(cov, i * n + j))
    before, change_before = previous, changed
    for k in range(inputs.shape[0]):
        after, change = inputs[k], changes[k]
        if started:
            s = 0 if lanes.step.size == 1 else int(after[after.size - 1])
            load_ends(lanes, ws, mean, before, after, s)
            step_mechanics(rates_jacobian, lanes, ws, mean, before, after, s)
            transpose_derivatives(lanes, ws, s)
            step_tangents(lanes, ws, tangents, change_before, change, s)
            predict_covariance(lanes, ws, s)
        started = True
        before, change_before = after, change
        if not any_reading(readings[k]):
            continue
        expect_readings(reading_jacobian, lanes, ws, mean, after)
        expect_changes(ws, tangents, readings[k], change)
        assimilate_sample(lanes, ws, mean, tangents, readings[k], k, group, whitened, variance, slopes, responses)
    for i in range(n):
        for j in range(n):
            store(cov, i * n + j, load(ws.P, i * wide + j))


@uncounted
def any_reading(reading: Any) -> bool:
    """Test whether a sample has readings: between those that steps of the equations share, most have none."""
    count = 0
    for c in range(reading.shape[0]):
        count += not np.isnan(reading[c])
    return count > 0


@uncounted
def load_ends(lanes: Any, ws: Any, mean: Any, before: Any, after: Any, s: int) -> None:
    """The loads at both ends of a step, and the load states after it."""
    nx, nz, _, nu, nw = lanes.sizes
    phi = lanes.phi[s]
    turn_load_output(lanes, before, ws.H0)
    turn_load_output(lanes, after, ws.H1)
    for i in range(nz):
        store(ws.z1, i, splat(0.0))
    for e in range(lanes.phi_at.shape[0]):
        i, j = lanes.phi_at[e, 0], lanes.phi_at[e, 1]
        store(ws.z1, i, load(ws.z1, i) + load(phi, i * nz + j) * load(mean, nx + j))
    for i in range(nw):
        store(ws.w0, i, splat(before[nu + i]))
        store(ws.w1, i, splat(after[nu + i]))
    for e in range(lanes.H_at.shape[0]):
        i, j = lanes.H_at[e, 0], lanes.H_at[e, 1]
        store(ws.w0, i, load(ws.w0, i) + load(ws.H0, e) * load(mean, nx + j))
        store(ws.w1, i, load(ws.w1, i) + load(ws.H1, e) * load(ws.z1, j))


@uncounted
def step_mechanics(rates_jacobian: Any, lanes: Any, ws: Any, mean: Any, before: Any, after: Any, s: int) -> None:
    """One Runge–Kutta step of the mechanical states in place; ``ws.total_S`` becomes the slopes to x₀, w₀, w₁."""
    nx, nz, _, nu, nw = lanes.sizes
    h, span, unit = lanes.step[s], ws.S.shape[1], splat(1.0)
    for i in range(nx):
        store(ws.x, i, load(mean, i))
        store(ws.total, i, splat(0.0))
    clear(ws.total_S, nx, span)
    for stage in range(4):
        at = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        share = splat(h / 6.0 if stage == 0 or stage == 3 else h / 3.0)
        reach = splat(h if stage == 2 else 0.5 * h)
        early, late = splat(1.0 - at), splat(at)
        for i in range(nu):
            ws.u[i] = before[i] + at * (after[i] - before[i])
        for i in range(nw):
            store(ws.w, i, early * load(ws.w0, i) + late * load(ws.w1, i))
        rates_jacobian(
            vectors(ws.x), ws.u, vectors(lanes.p), vectors(ws.w), vectors(ws.rate), vectors(ws.A), vectors(ws.no_rates),
            vectors(ws.G)
        )  # fmt: skip
        for i in range(nx):
            slope = load(ws.rate, i)
            store(ws.total, i, load(ws.total, i) + share * slope)
            store(ws.x, i, load(mean, i) + reach * slope)
        clear(ws.slope_S, nx, span)
        for e in range(lanes.G_at.shape[0]):
            i, j = lanes.G_at[e, 0], lanes.G_at[e, 1]
            c, slope = i * span + nx + j, load(ws.G, i * nw + j)
            store(ws.slope_S, c, early * slope)
            store(ws.slope_S, c + nw, late * slope)
        if stage == 0:  # S is the identity
            for e in range(lanes.A_at.shape[0]):
                i, j = lanes.A_at[e, 0], lanes.A_at[e, 1]
                store(ws.slope_S, i * span + j, load(ws.A, i * nx + j))
        else:
            for i in range(nx):
                add_rows(
                    ws.A, i * nx, 1, lanes.A_columns, lanes.A_rows[i], lanes.A_rows[i + 1], ws.S, ws.slope_S, i, 0, span
                )  # fmt: skip
        for c in range(nx * span):
            slope = load(ws.slope_S, c)
            store(ws.total_S, c, load(ws.total_S, c) + share * slope)
            store(ws.S, c, reach * slope)
        for i in range(nx):
            store(ws.S, i * span + i, load(ws.S, i * span + i) + unit)
    for i in range(nx):
        store(mean, i, load(mean, i) + load(ws.total, i))
        store(ws.total_S, i * span + i, load(ws.total_S, i * span + i) + unit)
    for i in range(nz):
        store(mean, nx + i, load(ws.z1, i))


@uncounted
def transpose_derivatives(lanes: Any, ws: Any, s: int) -> None:
    """The mechanical rows of F into ``ws.top``, Γ into ``ws.gain`` and V into ``ws.within``, all transposed."""
    nx, nz, _, _, nw = lanes.sizes
    span, tall, phi = ws.S.shape[1], ws.top.shape[1], lanes.phi[s]
    for i in range(nx):
        for j in range(nx):
            store(ws.top, j * tall + i, load(ws.total_S, i * span + j))
        for j in range(nz):
            store(ws.top, (nx + j) * tall + i, splat(0.0))
            store(ws.gain, j * tall + i, splat(0.0))
    for e in range(lanes.H_at.shape[0]):
        c, j = lanes.H_at[e, 0], lanes.H_at[e, 1]
        first, last = load(ws.H0, e), load(ws.H1, e)
        for i in range(nx):
            a, b, d = (nx + j) * tall + i, j * tall + i, i * span + nx + c
            store(ws.top, a, load(ws.top, a) + load(ws.total_S, d) * first)
            store(ws.gain, b, load(ws.gain, b) + load(ws.total_S, d + nw) * last)
    rough, within = lanes.within.shape[2], lanes.within[s]
    clear(ws.within, rough, tall)
    for e in range(lanes.within_at.shape[0]):
        j, c = lanes.within_at[e, 0], lanes.within_at[e, 1]
        factor = load(within, j * rough + c)
        for i in range(nx):
            pushed = load(ws.top, (nx + j) * tall + i) + load(ws.gain, j * tall + i)
            store(ws.within, c * tall + i, load(ws.within, c * tall + i) + pushed * factor)
    for e in range(lanes.phi_at.shape[0]):
        c, j = lanes.phi_at[e, 0], lanes.phi_at[e, 1]
        factor = load(phi, c * nz + j)
        for i in range(nx):
            a = (nx + j) * tall + i
            store(ws.top, a, load(ws.top, a) + load(ws.gain, c * tall + i) * factor)


@uncounted
def step_tangents(lanes: Any, ws: Any, tangents: Any, before: Any, after: Any, s: int) -> None:
    """Propagate the changes of the states over one step: F dm + ∂x/∂w₀ dw₀ + ∂x/∂w₁ dw₁ for each change, whose loads
    follow its readings in `before` and `after`."""
    nx, nz, _, _, nw = lanes.sizes
    n, moving, tall, phi = tangents.shape[1], nx + nz, ws.top.shape[1], lanes.phi[s]
    span, m, c = ws.total_S.shape[1], ws.H.shape[0], tangents.shape[0]
    loads = nw if after.shape[0] > m else 0
    for t in range(tangents.shape[0]):
        first = t * n
        clear(ws.stepped, 1, tall)
        add_rows(tangents, first, 1, ws.every, 0, moving, ws.top, ws.stepped, 0, 0, tall)
        for i in range(nz):
            store(ws.z1, i, splat(0.0))
        for e in range(lanes.phi_at.shape[0]):
            i, j = lanes.phi_at[e, 0], lanes.phi_at[e, 1]
            store(ws.z1, i, load(ws.z1, i) + load(phi, i * nz + j) * load(tangents, first + nx + j))
        for j in range(loads):
            first_load, last_load = load(before, (m + j) * c + t), load(after, (m + j) * c + t)
            for i in range(nx):
                by = i * span + nx + j
                pushed = load(ws.total_S, by) * first_load + load(ws.total_S, by + nw) * last_load
                store(ws.stepped, i, load(ws.stepped, i) + pushed)
        for i in range(nx):
            store(tangents, first + i, load(ws.stepped, i))
        for i in range(nz):
            store(tangents, first + nx + i, load(ws.z1, i))


@uncounted
def predict_covariance(lanes: Any, ws: Any, s: int) -> None:
    """P ← F P Fᵀ + Γ Q Γᵀ + V Vᵀ in ``ws.P``: the upper triangle is computed, and mirrored."""
    nx, nz, nb, _, _ = lanes.sizes
    n, moving = ws.P.shape[0], nx + nz
    wide, tall, broad = ws.P.shape[1], ws.top.shape[1], ws.pushed.shape[1]
    P, moved, pushed, corner, phi, Q = ws.P, ws.moved, ws.pushed, ws.corner, lanes.phi[s], lanes.Q[s]
    clear(moved, moving, wide)
    clear(pushed, nx, broad)
    clear(corner, nx, tall)
    for i in range(nx):
        add_rows(ws.top, i, tall, ws.every, 0, moving, P, moved, i, 0, wide)
        add_rows(ws.gain, i, tall, ws.every, 0, nz, Q, pushed, i, 0, broad)
        add_rows(moved, i * wide, 1, ws.every, 0, moving, ws.top, corner, i, i - i % 4, tall)
        add_rows(pushed, i * broad, 1, ws.every, 0, nz, ws.gain, corner, i, i - i % 4, tall)
        add_rows(ws.within, i, tall, ws.every, 0, lanes.within.shape[2], ws.within, corner, i, i - i % 4, tall)
    for e in range(lanes.phi_at.shape[0]):
        i, j = nx + lanes.phi_at[e, 0], nx + lanes.phi_at[e, 1]
        factor = load(phi, (i - nx) * nz + j - nx)
        for c in range(n):
            store(moved, i * wide + c, load(moved, i * wide + c) + factor * load(P, j * wide + c))
    for i in range(nx):
        for j in range(i, nx):
            store(P, i * wide + j, load(corner, i * tall + j))
        for j in range(nz):
            store(P, i * wide + nx + j, load(pushed, i * broad + j))
        for j in range(moving, n):
            store(P, i * wide + j, load(moved, i * wide + j))
    for i in range(nz):
        for j in range(nz):
            store(P, (nx + i) * wide + nx + j, load(Q, i * broad + j))
        for j in range(moving, n):
            store(P, (nx + i) * wide + j, load(moved, (nx + i) * wide + j))
    for e in range(lanes.phi_at.shape[0]):
        j, c = nx + lanes.phi_at[e, 0], nx + lanes.phi_at[e, 1]
        factor = load(phi, (j - nx) * nz + c - nx)
        for i in range(moving):
            store(P, i * wide + j, load(P, i * wide + j) + load(moved, i * wide + c) * factor)
    for i in range(moving):
        for j in range(i + 1 if i < nx else moving, n):
            store(P, j * wide + i, load(P, i * wide + j))
    for i in range(nb):
        a = (moving + i) * (wide + 1)
        store(P, a, load(P, a) + splat(lanes.walk[s, i]))


@uncounted
def expect_readings(reading_jacobian: Any, lanes: Any, ws: Any, mean: Any, inputs: Any) -> None:
    """Predicted readings, in ``ws.y``, and their derivatives to the whole state, in ``ws.H``."""
    nx, nz, _, nu, nw = lanes.sizes
    n, m, moving = mean.shape[0], lanes.noise.shape[0], nx + nz
    turn_load_output(lanes, inputs, ws.H1)
    for i in range(nw):
        store(ws.w1, i, splat(inputs[nu + i]))
    for e in range(lanes.H_at.shape[0]):
        i, j = lanes.H_at[e, 0], lanes.H_at[e, 1]
        store(ws.w1, i, load(ws.w1, i) + load(ws.H1, e) * load(mean, nx + j))
    for i in range(nu):
        ws.u[i] = inputs[i]
    reading_jacobian(
        vectors(mean), ws.u, vectors(lanes.p), vectors(ws.w1), vectors(ws.y), vectors(ws.C), vectors(ws.no_readings),
        vectors(ws.E)
    )  # fmt: skip
    for c in range(m):
        for j in range(nx):
            store(ws.H, c * n + j, load(ws.C, c * nx + j))
        for j in range(nz):
            store(ws.H, c * n + nx + j, splat(0.0))
        for e in range(lanes.H_at.shape[0]):
            i, j = lanes.H_at[e, 0], c * n + nx + lanes.H_at[e, 1]
            store(ws.H, j, load(ws.H, j) + load(ws.E, c * nw + i) * load(ws.H1, e))
        bias = lanes.bias_of[c]
        if bias >= 0:
            store(ws.y, c, load(ws.y, c) + load(mean, moving + bias))
            store(ws.H, c * n + moving + bias, splat(1.0))


@uncounted
def expect_changes(ws: Any, tangents: Any, reading: Any, change: Any) -> None:
    """Changes of the readings minus their prediction, in ``ws.late``: dy − H dm − E dw."""
    n, m, nw, count = tangents.shape[1], ws.H.shape[0], ws.E.shape[1], tangents.shape[0]
    loads = nw if change.shape[0] > m else 0
    for t in range(tangents.shape[0]):
        for c in range(m):
            if np.isnan(reading[c]):
                continue
            left = load(change, c * count + t)
            for j in range(loads):
                left = left - load(ws.E, c * nw + j) * load(change, (m + j) * count + t)
            for i in range(n):
                left = left - load(ws.H, c * n + i) * load(tangents, t * n + i)
            store(ws.late, t * m + c, left)


@uncounted
def assimilate_sample(
    lanes: Any, ws: Any, mean: Any, tangents: Any, reading: Any, k: int, group: int, whitened: Any, variance: Any,
    slopes: Any, responses: Any,
) -> None:  # fmt: skip
    """Take in the readings one by one, P once for all: v = (P h − Σ v_d (v_d · h)) / √s over the readings d before."""
    n, m, wide, groups = mean.shape[0], lanes.noise.shape[0], ws.P.shape[1], whitened.shape[2]
    H, P, v, minus, residual, late = ws.H, ws.P, ws.v, ws.minus, ws.residual, ws.late
    clear(v, m, wide)
    clear(minus, m, wide)
    for c in range(m):
        store(residual, c, splat(0.0))
        if np.isnan(reading[c]):
            continue
        store(residual, c, splat(reading[c]) - load(ws.y, c))
        add_rows(H, c * n, 1, ws.every, 0, n, P, v, c, 0, wide)
        for d in range(c):
            along = splat(0.0)
            for i in range(n):
                along = along + load(H, c * n + i) * load(minus, d * wide + i)
            for i in range(n):
                store(v, c * wide + i, load(v, c * wide + i) + along * load(v, d * wide + i))
            store(residual, c, load(residual, c) + along * load(residual, d))
            for t in range(tangents.shape[0]):
                store(late, t * m + c, load(late, t * m + c) + along * load(late, t * m + d))
        spread = load(lanes.noise, c)
        for i in range(n):
            spread = spread + load(H, c * n + i) * load(v, c * wide + i)
        scale = splat(1.0) / square_root(spread)
        step = scale * load(residual, c)
        store(residual, c, step)
        for i in range(n):
            along = scale * load(v, c * wide + i)
            store(v, c * wide + i, along)
            store(minus, c * wide + i, -along)
            store(mean, i, load(mean, i) + along * step)
        for t in range(tangents.shape[0]):
            change = scale * load(late, t * m + c)
            store(late, t * m + c, change)
            store(slopes, t, load(slopes, t) - step * change)
            if responses.shape[0] > 0:
                store(responses, (k * m + c) * tangents.shape[0] + t, change)
            for i in range(n):
                store(tangents, t * n + i, load(tangents, t * n + i) + load(v, c * wide + i) * change)
        store(whitened, (k * m + c) * groups + group, step)
        store(variance, (k * m + c) * groups + group, spread)
    for i in range(n):
        add_rows(minus, i, wide, ws.every, 0, m, v, P, i, 0, wide)


@uncounted
def turn_load_output(lanes: Any, inputs: Any, H: Any) -> None:
    """H(ψ) at the azimuth of `inputs`, its entries in the order of `H_at`."""
    rows, nw, nz = lanes.output.shape[0], lanes.output.shape[1], lanes.output.shape[2]
    for e in range(lanes.H_at.shape[0]):
        entry = lanes.H_at[e, 0] * nz + lanes.H_at[e, 1]
        value = load(lanes.output, entry)
        for k in range(1, (rows + 1) // 2):
            angle = k * inputs[lanes.azimuth[0]]
            value = value + load(lanes.output, (2 * k - 1) * nw * nz + entry) * splat(math.cos(angle))
            value = value + load(lanes.output, 2 * k * nw * nz + entry) * splat(math.sin(angle))
        store(H, e, value)


@uncounted
def add_rows(
    weights: Any, first: int, stride: int, rows: Any, start: int, stop: int, matrix: Any, out: Any, to: int,
    begin: int, columns: int,
) -> None:  # fmt: skip
    """Row `to` of `out` += Σ_r weights[first + stride r] · row r of `matrix`, r = rows[start], …, rows[stop − 1].

    From the column `begin` on; `begin` and `columns` are multiples of four: so many or twice so many columns stay in
    registers.
    """
    c = begin
    while c + 8 <= columns:
        at = to * columns + c
        s0, s1, s2, s3 = load(out, at), load(out, at + 1), load(out, at + 2), load(out, at + 3)
        s4, s5, s6, s7 = load(out, at + 4), load(out, at + 5), load(out, at + 6), load(out, at + 7)
        for e in range(start, stop):
            r = rows[np.uint64(e)]
            weight, b = load(weights, first + stride * r), r * columns + c
            s0, s1 = s0 + weight * load(matrix, b), s1 + weight * load(matrix, b + 1)
            s2, s3 = s2 + weight * load(matrix, b + 2), s3 + weight * load(matrix, b + 3)
            s4, s5 = s4 + weight * load(matrix, b + 4), s5 + weight * load(matrix, b + 5)
            s6, s7 = s6 + weight * load(matrix, b + 6), s7 + weight * load(matrix, b + 7)
        store(out, at, s0)
        store(out, at + 1, s1)
        store(out, at + 2, s2)
        store(out, at + 3, s3)
        store(out, at + 4, s4)
        store(out, at + 5, s5)
        store(out, at + 6, s6)
        store(out, at + 7, s7)
        c += 8
    if c < columns:
        at = to * columns + c
        s0, s1, s2, s3 = load(out, at), load(out, at + 1), load(out, at + 2), load(out, at + 3)
        for e in range(start, stop):
            r = rows[np.uint64(e)]
            weight, b = load(weights, first + stride * r), r * columns + c
            s0, s1 = s0 + weight * load(matrix, b), s1 + weight * load(matrix, b + 1)
            s2, s3 = s2 + weight * load(matrix, b + 2), s3 + weight * load(matrix, b + 3)
        store(out, at, s0)
        store(out, at + 1, s1)
        store(out, at + 2, s2)
        store(out, at + 3, s3)


@uncounted
def clear(array: Any, rows: int, columns: int) -> None:
    nothing = splat(0.0)
    for i in range(rows * columns):
        store(array, i, nothing)

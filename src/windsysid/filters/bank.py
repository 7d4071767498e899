"""A bank: many extended Kalman filters side by side on the same readings, each with its own numbers in the model.

Learning parameters from a likelihood takes the filter at many neighbouring parameter values. They differ in numbers only, so they are run
in groups of `LANES`, the lane being the last axis of every array: each operation of the filter is one operation of the processor's vector
unit. The bank computes what `windsysid.filters.ekf` computes for models without parameters in the state, in the order

    predict   m⁻ = f(m),   P⁻ = F P Fᵀ + Γ Q Γᵀ
    update    reading by reading:  v = P h,  s = h v + r,  m ← m + v ν/s,  P ← P − v vᵀ/s

where P is changed once for all readings of a sample: v = P⁻ h − Σ u (u h) over the readings before, u = v/√s, and P = P⁻ − Σ u uᵀ.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid.jit import LANE_JACOBIAN, compiled, inlined, uncounted
from windsysid.mechanics.compile import CompiledModel
from windsysid.simd import LANES, load, splat, square_root, store, vectors
from windsysid.statespace import StateSpace

__all__ = ["LANES", "Bank", "Scores", "bank_of", "run_bank"]

Array = NDArray[np.float64]


class Lanes(NamedTuple):
    """One group of filters as arrays, the lane last: see `windsysid.transition.Blocks` for what they are.

    `phi_at`, `A_at`, `G_at` and `H_at` list the entries (row, column) that can differ from zero, row by row; `A_rows` says where
    each row of A begins in its list, `A_columns` is its second column.
    """

    sizes: Any
    step: Any
    azimuth: Any
    p: Any
    phi: Any
    Q: Any
    output: Any
    walk: Any
    bias_of: Any
    noise: Any
    phi_at: Any
    A_at: Any
    G_at: Any
    H_at: Any
    A_rows: Any
    A_columns: Any


class Bank(NamedTuple):
    """Filters of one structure, and what they believe.

    Attributes
    ----------
    compiled
        The model's kernels.
    lanes
        One `Lanes` per group.
    mean, cov
        Beliefs (groups, n, LANES), (groups, n, n, LANES).
    inputs
        Inputs at the beliefs' own time (n_u + n_w,).
    samples
        How many samples they have seen.
    filters
        How many filters there are; lanes beyond repeat the last one.
    """

    compiled: CompiledModel
    lanes: tuple[Lanes, ...]
    mean: Array
    cov: Array
    inputs: Array
    samples: int
    filters: int


class Scores(NamedTuple):
    """What came out of T samples of m readings for each filter.

    Attributes
    ----------
    whitened
        Innovations decorrelated and scaled to unit variance (T, m, filters); 0 where the reading is missing.
    log_std
        Logarithm of what they were divided by (T, m, filters); 0 where missing.
    """

    whitened: Array
    log_std: Array


def bank_of(models: Sequence[StateSpace]) -> Bank:
    """Put filters for models of one structure side by side, each at its model's prior.

    Raises
    ------
    ValueError
        If the models differ in more than their numbers, or have parameters in the state.
    """
    first = models[0]
    n = len(first.states)
    for model in models:
        if model.states != first.states or model.readings != first.readings or model.parameters:
            raise ValueError("a bank holds models of the same states and readings, without parameters in the state")
    padded = [*models, *[models[-1]] * (-len(models) % LANES)]
    groups = [padded[i : i + LANES] for i in range(0, len(padded), LANES)]
    patterns = _patterns(first, padded)
    return Bank(
        first.compiled,
        tuple(_lanes(group, patterns) for group in groups),
        np.ascontiguousarray([np.stack([m.mean for m in group], axis=-1) for group in groups]).reshape(-1, n, LANES),
        np.ascontiguousarray([np.stack([m.cov for m in group], axis=-1) for group in groups]).reshape(-1, n, n, LANES),
        np.zeros(len(first.inputs)),
        0,
        len(models),
    )


def run_bank(bank: Bank, inputs: Array, readings: Array, pool: ThreadPoolExecutor | None = None) -> tuple[Bank, Scores]:
    """Filter T samples with every filter: inputs (T, n_u + n_w), readings (T, m), NaN = missing."""
    inputs = np.require(inputs, np.float64, ["C", "W"])
    readings = np.require(readings, np.float64, ["C", "W"])
    samples, m = readings.shape
    mean, cov = bank.mean.copy(), bank.cov.copy()
    groups = len(bank.lanes)
    whitened, variance = np.zeros((samples, m, groups, LANES)), np.ones((samples, m, groups, LANES))
    kernel, rates, reading = _kernel(), bank.compiled.rates_of_lanes, bank.compiled.reading_of_lanes

    def run(g: int) -> None:
        kernel(
            rates, reading, bank.lanes[g], mean[g], cov[g],
            bank.inputs, inputs, readings, bank.samples > 0, g, whitened, variance,
        )  # fmt: skip

    list((pool.map if pool else map)(run, range(len(bank.lanes))))
    log_std = 0.5 * np.log(variance)
    scores = (array.reshape(samples, m, groups * LANES)[..., : bank.filters] for array in (whitened, log_std))
    last = inputs[-1].copy() if samples else bank.inputs
    return bank._replace(mean=mean, cov=cov, inputs=last, samples=bank.samples + samples), Scores(*scores)


def _lanes(group: Sequence[StateSpace], patterns: tuple[NDArray[np.int64], ...]) -> Lanes:
    blocks = [model.blocks for model in group]
    nx, nz, nb, _, nu, nw = blocks[0].sizes

    def last(name: str) -> Array:
        return np.ascontiguousarray(np.stack([getattr(b, name) for b in blocks], axis=-1))

    noise = last("load_noise")
    noise = np.pad(noise, [(0, 0), (0, 0), (0, -nz % 4), (0, 0)])
    return Lanes(
        np.array([nx, nz, nb, nu, nw], dtype=np.int64), blocks[0].step, blocks[0].azimuth,
        last("p"), last("load_transition"), noise, last("load_output"),
        blocks[0].walk, blocks[0].bias_of, last("noise"), *patterns,
    )  # fmt: skip


def _patterns(model: StateSpace, models: Sequence[StateSpace]) -> tuple[NDArray[np.int64], ...]:
    """Entries that can differ from zero: of Φ, of ∂ẋ/∂x and ∂ẋ/∂w (which kernels write or never touch), of H."""
    nx, _, _, _, nu, nw = model.blocks.sizes
    untouched = 1e300
    A, B, G = np.full((nx, nx), untouched), np.zeros((nx, 0)), np.full((nx, nw), untouched)
    model.compiled.rates_jacobian(np.zeros(nx), np.zeros(nu), model.blocks.p, np.zeros(nw), np.empty(nx), A, B, G)
    phi = np.any([m.blocks.load_transition != 0.0 for m in models], axis=(0, 1))
    output = np.any([m.blocks.load_output != 0.0 for m in models], axis=(0, 1))
    at = [np.ascontiguousarray(np.argwhere(mask)) for mask in (phi, untouched != A, untouched != G, output)]
    rows = np.searchsorted(at[1][:, 0], np.arange(nx + 1)).astype(np.int64)
    return *at, rows, np.ascontiguousarray(at[1][:, 1])


_i1, _i2 = types.int64[::1], types.int64[:, ::1]
_f1, _f2, _f3, _f4 = (types.Array(types.float64, d, "C") for d in (1, 2, 3, 4))
_LANES_TYPE = types.NamedTuple([_i1, _f1, _i1, _f2, _f4, _f4, _f4, _f2, _i1, _f2, _i2, _i2, _i2, _i2, _i1, _i1], Lanes)


@lru_cache(maxsize=1)
def _kernel() -> Any:
    model = types.FunctionType(LANE_JACOBIAN)
    return compiled(
        _run, types.void(model, model, _LANES_TYPE, _f2, _f3, _f1, _f2, _f2, types.boolean, types.intp, _f4, _f4)
    )  # fmt: skip


@uncounted
def _turn(lanes: Any, inputs: Any, H: Any) -> None:
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
def _add(
    weights: Any, first: int, stride: int, rows: Any, start: int, stop: int, matrix: Any, out: Any, to: int,
    begin: int, columns: int,
) -> None:  # fmt: skip
    """Row `to` of `out` += Σ_r weights[first + stride r] · row r of `matrix`, r = rows[start], …, rows[stop − 1].

    From the column `begin` on; `begin` and `columns` are multiples of four: so many or twice so many columns stay in registers.
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
def _clear(array: Any, rows: int, columns: int) -> None:
    nothing = splat(0.0)
    for i in range(rows * columns):
        store(array, i, nothing)


def _run(
    rates_jacobian: Any, reading_jacobian: Any, lanes: Any, mean: Any, cov: Any, previous: Any,
    inputs: Any, readings: Any, started: bool, group: int, whitened: Any, variance: Any,
) -> None:  # fmt: skip
    n, m = mean.shape[0], lanes.noise.shape[0]
    _filter(
        rates_jacobian, reading_jacobian, lanes, mean, cov, previous, inputs, readings, started, group, whitened, variance,
        _scratch(n, m, lanes.sizes, lanes.H_at.shape[0]),
    )  # fmt: skip


@uncounted
def _widths(n: int, sizes: Any) -> tuple[int, int, int, int]:
    """Lengths of the rows of matrices with n, n_x, n_z and n_x + 2 n_w columns: multiples of four."""
    nx, nz, _, _, nw = sizes
    columns = nx + 2 * nw
    return n + -n % 4, nx + -nx % 4, nz + -nz % 4, columns + -columns % 4


@inlined
def _scratch(n: int, m: int, sizes: Any, turning: int) -> Any:
    nx, nz, _, nu, nw = sizes
    moving = nx + nz
    wide, tall, broad, span = _widths(n, sizes)
    return (
        np.arange(max(n, m)), np.zeros(nu), np.zeros((nw, LANES)), np.zeros((nx, LANES)),
        np.zeros((nx, nx, LANES)), np.zeros((nx, nw, LANES)), np.zeros((nx, 0, LANES)), np.zeros((m, 0, LANES)),
        np.zeros((turning, LANES)), np.zeros((turning, LANES)), np.zeros((nw, LANES)), np.zeros((nw, LANES)), np.zeros((nz, LANES)),
        np.zeros((nx, LANES)), np.zeros((nx, LANES)),
        np.zeros((nx, span, LANES)), np.zeros((nx, span, LANES)), np.zeros((nx, span, LANES)),
        np.zeros((n, wide, LANES)), np.zeros((moving, wide, LANES)), np.zeros((nx, broad, LANES)),
        np.zeros((moving, tall, LANES)), np.zeros((nz, tall, LANES)), np.zeros((nx, tall, LANES)),
        np.zeros((m, LANES)), np.zeros((m, n, LANES)), np.zeros((m, nx, LANES)), np.zeros((m, nw, LANES)),
        np.zeros((m, wide, LANES)), np.zeros((m, wide, LANES)), np.zeros((m, LANES)),
    )  # fmt: skip


@uncounted
def _filter(
    rates_jacobian: Any, reading_jacobian: Any, lanes: Any, mean: Any, cov: Any, previous: Any,
    inputs: Any, readings: Any, started: bool, group: int, whitened: Any, variance: Any, scratch: Any,
) -> None:  # fmt: skip
    nx, nz, nb, nu, nw = lanes.sizes
    n, m, moving, groups = mean.shape[0], lanes.noise.shape[0], nx + nz, whitened.shape[2]
    wide, tall, broad, span = _widths(n, lanes.sizes)
    nothing, unit = splat(0.0), splat(1.0)
    (
        every, u, w, rate, A, G, no_rates, no_readings, H0, H1, w0, w1, z1, x, total, S, slope_S, total_S,
        P, moved, pushed, top, gain, corner, y, H, C, E, v, minus, residual,
    ) = scratch  # fmt: skip
    for i in range(n):
        for j in range(n):
            store(P, i * wide + j, load(cov, i * n + j))
    before = previous
    for k in range(inputs.shape[0]):
        after = inputs[k]
        if started:
            interval = 0 if lanes.step.size == 1 else int(after[after.size - 1])
            h, phi, Q = lanes.step[interval], lanes.phi[interval], lanes.Q[interval]
            # loads at both ends of the step
            _turn(lanes, before, H0)
            _turn(lanes, after, H1)
            for i in range(nz):
                store(z1, i, nothing)
            for e in range(lanes.phi_at.shape[0]):
                i, j = lanes.phi_at[e, 0], lanes.phi_at[e, 1]
                store(z1, i, load(z1, i) + load(phi, i * nz + j) * load(mean, nx + j))
            for i in range(nw):
                store(w0, i, splat(before[nu + i]))
                store(w1, i, splat(after[nu + i]))
            for e in range(lanes.H_at.shape[0]):
                i, j = lanes.H_at[e, 0], lanes.H_at[e, 1]
                store(w0, i, load(w0, i) + load(H0, e) * load(mean, nx + j))
                store(w1, i, load(w1, i) + load(H1, e) * load(z1, j))
            # RK4 with its sensitivities to x₀, w₀ and w₁
            for i in range(nx):
                store(x, i, load(mean, i))
                store(total, i, nothing)
            _clear(total_S, nx, span)
            for stage in range(4):
                at = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                share = splat(h / 6.0 if stage == 0 or stage == 3 else h / 3.0)
                reach = splat(h if stage == 2 else 0.5 * h)
                early, late = splat(1.0 - at), splat(at)
                for i in range(nu):
                    u[i] = before[i] + at * (after[i] - before[i])
                for i in range(nw):
                    store(w, i, early * load(w0, i) + late * load(w1, i))
                rates_jacobian(
                    vectors(x), u, vectors(lanes.p), vectors(w), vectors(rate), vectors(A), vectors(no_rates), vectors(G)
                )  # fmt: skip
                for i in range(nx):
                    slope = load(rate, i)
                    store(total, i, load(total, i) + share * slope)
                    store(x, i, load(mean, i) + reach * slope)
                _clear(slope_S, nx, span)
                for e in range(lanes.G_at.shape[0]):
                    i, j = lanes.G_at[e, 0], lanes.G_at[e, 1]
                    c, slope = i * span + nx + j, load(G, i * nw + j)
                    store(slope_S, c, early * slope)
                    store(slope_S, c + nw, late * slope)
                if stage == 0:  # S is the identity
                    for e in range(lanes.A_at.shape[0]):
                        i, j = lanes.A_at[e, 0], lanes.A_at[e, 1]
                        store(slope_S, i * span + j, load(A, i * nx + j))
                else:
                    for i in range(nx):
                        _add(
                            A, i * nx, 1, lanes.A_columns, lanes.A_rows[i], lanes.A_rows[i + 1], S, slope_S, i, 0, span
                        )
                for c in range(nx * span):
                    slope = load(slope_S, c)
                    store(total_S, c, load(total_S, c) + share * slope)
                    store(S, c, reach * slope)
                for i in range(nx):
                    store(S, i * span + i, load(S, i * span + i) + unit)
            for i in range(nx):
                store(mean, i, load(mean, i) + load(total, i))
                store(total_S, i * span + i, load(total_S, i * span + i) + unit)
            for i in range(nz):
                store(mean, nx + i, load(z1, i))
            # the mechanical rows of F, and Γ, both transposed
            for i in range(nx):
                for j in range(nx):
                    store(top, j * tall + i, load(total_S, i * span + j))
                for j in range(nz):
                    store(top, (nx + j) * tall + i, nothing)
                    store(gain, j * tall + i, nothing)
            for e in range(lanes.H_at.shape[0]):
                c, j = lanes.H_at[e, 0], lanes.H_at[e, 1]
                first_H, last_H = load(H0, e), load(H1, e)
                for i in range(nx):
                    a, b, d = (nx + j) * tall + i, j * tall + i, i * span + nx + c
                    store(top, a, load(top, a) + load(total_S, d) * first_H)
                    store(gain, b, load(gain, b) + load(total_S, d + nw) * last_H)
            for e in range(lanes.phi_at.shape[0]):
                c, j = lanes.phi_at[e, 0], lanes.phi_at[e, 1]
                factor = load(phi, c * nz + j)
                for i in range(nx):
                    a = (nx + j) * tall + i
                    store(top, a, load(top, a) + load(gain, c * tall + i) * factor)
            # F P, then (F P) Fᵀ + Γ Q Γᵀ, the upper triangle mirrored
            _clear(moved, moving, wide)
            _clear(pushed, nx, broad)
            _clear(corner, nx, tall)
            for i in range(nx):
                _add(top, i, tall, every, 0, moving, P, moved, i, 0, wide)
                _add(gain, i, tall, every, 0, nz, Q, pushed, i, 0, broad)
                _add(moved, i * wide, 1, every, 0, moving, top, corner, i, i - i % 4, tall)
                _add(pushed, i * broad, 1, every, 0, nz, gain, corner, i, i - i % 4, tall)
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
                store(P, a, load(P, a) + splat(lanes.walk[interval, i]))
        started = True
        before = after
        # what the sensors should read
        _turn(lanes, after, H1)
        for i in range(nw):
            store(w1, i, splat(after[nu + i]))
        for e in range(lanes.H_at.shape[0]):
            i, j = lanes.H_at[e, 0], lanes.H_at[e, 1]
            store(w1, i, load(w1, i) + load(H1, e) * load(mean, nx + j))
        for i in range(nu):
            u[i] = after[i]
        reading_jacobian(
            vectors(mean), u, vectors(lanes.p), vectors(w1), vectors(y), vectors(C), vectors(no_readings), vectors(E)
        )
        for c in range(m):
            for j in range(nx):
                store(H, c * n + j, load(C, c * nx + j))
            for j in range(nz):
                store(H, c * n + nx + j, nothing)
            for e in range(lanes.H_at.shape[0]):
                i, j = lanes.H_at[e, 0], c * n + nx + lanes.H_at[e, 1]
                store(H, j, load(H, j) + load(E, c * nw + i) * load(H1, e))
            bias = lanes.bias_of[c]
            if bias >= 0:
                store(y, c, load(y, c) + load(mean, moving + bias))
                store(H, c * n + moving + bias, unit)
        # readings one by one, P once for all: v = (P h − Σ v_d (v_d · h)) / √s over the readings d before
        _clear(v, m, wide)
        _clear(minus, m, wide)
        for c in range(m):
            store(residual, c, nothing)
            if np.isnan(readings[k, c]):
                continue
            store(residual, c, splat(readings[k, c]) - load(y, c))
            _add(H, c * n, 1, every, 0, n, P, v, c, 0, wide)
            for d in range(c):
                along = nothing
                for i in range(n):
                    along = along + load(H, c * n + i) * load(minus, d * wide + i)
                for i in range(n):
                    store(v, c * wide + i, load(v, c * wide + i) + along * load(v, d * wide + i))
                store(residual, c, load(residual, c) + along * load(residual, d))
            spread = load(lanes.noise, c)
            for i in range(n):
                spread = spread + load(H, c * n + i) * load(v, c * wide + i)
            scale = unit / square_root(spread)
            step = scale * load(residual, c)
            store(residual, c, step)
            for i in range(n):
                along = scale * load(v, c * wide + i)
                store(v, c * wide + i, along)
                store(minus, c * wide + i, -along)
                store(mean, i, load(mean, i) + along * step)
            store(whitened, (k * m + c) * groups + group, step)
            store(variance, (k * m + c) * groups + group, spread)
        for i in range(n):
            _add(minus, i, wide, every, 0, m, v, P, i, 0, wide)
    for i in range(n):
        for j in range(n):
            store(cov, i * n + j, load(P, i * wide + j))

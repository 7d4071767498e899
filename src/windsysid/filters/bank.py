"""A bank: many extended Kalman filters side by side on the same readings, each with its own numbers in the model.

Learning parameters from a likelihood takes the filter at many neighbouring parameter values. They differ in numbers only, so they are run
in groups of `LANES`, the lane being the last axis of every array: each operation of the filter is one operation of the processor's vector
unit. The bank computes what `windsysid.filters.ekf` computes for models without parameters in the state, in the order

    predict   m⁻ = f(m),   P⁻ = F P Fᵀ + Γ Q Γᵀ
    update    reading by reading:  v = P h,  s = h v + r,  m ← m + v ν/s,  P ← P − v vᵀ/s.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid.jit import JACOBIAN, compiled, inlined
from windsysid.mechanics.compile import CompiledModel
from windsysid.simd import LANES, load, splat, square_root, store
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
    inputs = np.ascontiguousarray(inputs, dtype=np.float64)
    readings = np.ascontiguousarray(readings, dtype=np.float64)
    samples, m = readings.shape
    mean, cov = bank.mean.copy(), bank.cov.copy()
    scores = np.zeros((2, len(bank.lanes), samples, m, LANES))
    kernel = _kernel()

    def run(g: int) -> None:
        kernel(
            bank.compiled.rates_jacobian, bank.compiled.reading_jacobian, bank.lanes[g], mean[g], cov[g],
            bank.inputs, inputs, readings, bank.samples > 0, scores[0, g], scores[1, g],
        )  # fmt: skip

    list((pool.map if pool else map)(run, range(len(bank.lanes))))
    whitened, log_std = (
        np.moveaxis(s, 0, 2).reshape(samples, m, LANES * len(bank.lanes))[..., : bank.filters] for s in scores
    )
    last = inputs[-1].copy() if samples else bank.inputs
    return bank._replace(mean=mean, cov=cov, inputs=last, samples=bank.samples + samples), Scores(whitened, log_std)


def _lanes(group: Sequence[StateSpace], patterns: tuple[NDArray[np.int64], ...]) -> Lanes:
    blocks = [model.blocks for model in group]
    nx, nz, nb, _, nu, nw = blocks[0].sizes

    def last(name: str) -> Array:
        return np.ascontiguousarray(np.stack([getattr(b, name) for b in blocks], axis=-1))

    return Lanes(
        np.array([nx, nz, nb, nu, nw], dtype=np.int64), blocks[0].step, blocks[0].azimuth,
        np.ascontiguousarray([b.p for b in blocks]), last("load_transition"), last("load_noise"), last("load_output"),
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
    model = types.FunctionType(JACOBIAN)
    return compiled(
        _run, types.void(model, model, _LANES_TYPE, _f2, _f3, _f1, _f2, _f2, types.boolean, _f3, _f3)
    )  # fmt: skip


@inlined
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


@inlined
def _combine(
    weights: Any, first: int, count: int, rows: Any, start: int, matrix: Any, columns: int, out: Any, to: int
) -> None:
    """Row `to` of `out` = Σ_e weights[first + e] · row rows[start + e] of `matrix`: four columns at a time stay in registers."""
    nothing = splat(0.0)
    whole = columns - columns % 4
    for c in range(0, whole, 4):
        one, two, three, four = nothing, nothing, nothing, nothing
        for e in range(count):
            weight, at = load(weights, first + e), rows[start + e] * columns + c
            one = one + weight * load(matrix, at)
            two = two + weight * load(matrix, at + 1)
            three = three + weight * load(matrix, at + 2)
            four = four + weight * load(matrix, at + 3)
        at = to * columns + c
        store(out, at, one)
        store(out, at + 1, two)
        store(out, at + 2, three)
        store(out, at + 3, four)
    for c in range(whole, columns):
        one = nothing
        for e in range(count):
            one = one + load(weights, first + e) * load(matrix, rows[start + e] * columns + c)
        store(out, to * columns + c, one)


def _run(
    rates_jacobian: Any, reading_jacobian: Any, lanes: Any, mean: Any, cov: Any, previous: Any,
    inputs: Any, readings: Any, started: bool, whitened: Any, log_std: Any,
) -> None:  # fmt: skip
    nx, nz, nb, nu, nw = lanes.sizes
    n, m, moving = mean.shape[0], lanes.noise.shape[0], nx + nz
    columns = nx + 2 * nw
    nothing, unit = splat(0.0), splat(1.0)
    every = np.arange(n)
    no_parameters = np.zeros((max(nx, m), 0))
    one_x, one_w, u, one_rate, one_y = np.zeros(nx), np.zeros(nw), np.zeros(nu), np.zeros(nx), np.zeros(m)
    one_A, one_G, one_C, one_E = np.zeros((nx, nx)), np.zeros((nx, nw)), np.zeros((m, nx)), np.zeros((m, nw))
    A, G = np.zeros((lanes.A_at.shape[0], LANES)), np.zeros((lanes.G_at.shape[0], LANES))
    H0, H1 = np.zeros((lanes.H_at.shape[0], LANES)), np.zeros((lanes.H_at.shape[0], LANES))
    w0, w1, z1 = np.zeros((nw, LANES)), np.zeros((nw, LANES)), np.zeros((nz, LANES))
    x, total = np.zeros((nx, LANES)), np.zeros((nx, LANES))
    S, slope_S = np.zeros((nx, columns, LANES)), np.zeros((nx, columns, LANES))
    total_S = np.zeros((nx, columns, LANES))
    top, moved = np.zeros((nx, moving, LANES)), np.zeros((moving, n, LANES))
    noise_gain, pushed = np.zeros((nx, nz, LANES)), np.zeros((nx, nz, LANES))
    y, H, E = np.zeros((m, LANES)), np.zeros((m, n, LANES)), np.zeros((m, nw, LANES))
    shift, v, s = np.zeros((n, LANES)), np.zeros((1, n, LANES)), np.zeros((1, LANES))
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
                for c in range(columns):
                    store(total_S, i * columns + c, nothing)
            for stage in range(4):
                at = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
                ahead = h if stage == 2 else 0.5 * h
                for i in range(nu):
                    u[i] = before[i] + at * (after[i] - before[i])
                for lane in range(LANES):
                    for i in range(nx):
                        one_x[i] = x[i, lane]
                    for i in range(nw):
                        one_w[i] = w0[i, lane] + at * (w1[i, lane] - w0[i, lane])
                    rates_jacobian(one_x, u, lanes.p[lane], one_w, one_rate, one_A, no_parameters[:nx], one_G)
                    for e in range(lanes.A_at.shape[0]):
                        A[e, lane] = one_A[lanes.A_at[e, 0], lanes.A_at[e, 1]]
                    for e in range(lanes.G_at.shape[0]):
                        G[e, lane] = one_G[lanes.G_at[e, 0], lanes.G_at[e, 1]]
                    for i in range(nx):
                        total[i, lane] += weight * one_rate[i]
                        x[i, lane] = mean[i, lane] + ahead * one_rate[i]
                if stage == 0:  # S is the identity
                    for c in range(nx * columns):
                        store(slope_S, c, nothing)
                    for e in range(lanes.A_at.shape[0]):
                        store(slope_S, lanes.A_at[e, 0] * columns + lanes.A_at[e, 1], load(A, e))
                else:
                    for i in range(nx):
                        first = lanes.A_rows[i]
                        _combine(A, first, lanes.A_rows[i + 1] - first, lanes.A_columns, first, S, columns, slope_S, i)
                early, late = splat(1.0 - at), splat(at)
                for e in range(lanes.G_at.shape[0]):
                    c = lanes.G_at[e, 0] * columns + nx + lanes.G_at[e, 1]
                    store(slope_S, c, load(slope_S, c) + early * load(G, e))
                    store(slope_S, c + nw, load(slope_S, c + nw) + late * load(G, e))
                share, reach = splat(weight), splat(ahead)
                for c in range(nx * columns):
                    slope = load(slope_S, c)
                    store(total_S, c, load(total_S, c) + share * slope)
                    store(S, c, reach * slope)
                for i in range(nx):
                    store(S, i * columns + i, load(S, i * columns + i) + unit)
            for i in range(nx):
                store(mean, i, load(mean, i) + load(total, i))
                store(total_S, i * columns + i, load(total_S, i * columns + i) + unit)
            for i in range(nz):
                store(mean, nx + i, load(z1, i))
            # the mechanical rows of F, and Γ
            for i in range(nx):
                for j in range(nx):
                    store(top, i * moving + j, load(total_S, i * columns + j))
                for j in range(nz):
                    store(top, i * moving + nx + j, nothing)
                    store(noise_gain, i * nz + j, nothing)
            for e in range(lanes.H_at.shape[0]):
                c, j = lanes.H_at[e, 0], lanes.H_at[e, 1]
                first_H, last_H = load(H0, e), load(H1, e)
                for i in range(nx):
                    a, b, w = i * moving + nx + j, i * nz + j, i * columns + nx + c
                    store(top, a, load(top, a) + load(total_S, w) * first_H)
                    store(noise_gain, b, load(noise_gain, b) + load(total_S, w + nw) * last_H)
            for e in range(lanes.phi_at.shape[0]):
                c, j = lanes.phi_at[e, 0], lanes.phi_at[e, 1]
                factor = load(phi, c * nz + j)
                for i in range(nx):
                    a = i * moving + nx + j
                    store(top, a, load(top, a) + load(noise_gain, i * nz + c) * factor)
            # F P, then (F P) Fᵀ + Γ Q Γᵀ, the upper triangle mirrored
            for i in range(nx):
                _combine(top, i * moving, moving, every, 0, cov, n, moved, i)
            for i in range(nz):
                for c in range(n):
                    store(moved, (nx + i) * n + c, nothing)
            for e in range(lanes.phi_at.shape[0]):
                i, j = nx + lanes.phi_at[e, 0], nx + lanes.phi_at[e, 1]
                factor = load(phi, (i - nx) * nz + j - nx)
                for c in range(n):
                    store(moved, i * n + c, load(moved, i * n + c) + factor * load(cov, j * n + c))
            for i in range(nx):
                _combine(noise_gain, i * nz, nz, every, 0, Q, nz, pushed, i)
            for i in range(nx):
                for j in range(i, nx):
                    value = nothing
                    for c in range(moving):
                        value = value + load(moved, i * n + c) * load(top, j * moving + c)
                    for c in range(nz):
                        value = value + load(pushed, i * nz + c) * load(noise_gain, j * nz + c)
                    store(cov, i * n + j, value)
                for j in range(nz):
                    store(cov, i * n + nx + j, load(pushed, i * nz + j))
                for j in range(moving, n):
                    store(cov, i * n + j, load(moved, i * n + j))
            for i in range(nz):
                for j in range(nz):
                    store(cov, (nx + i) * n + nx + j, load(Q, i * nz + j))
                for j in range(moving, n):
                    store(cov, (nx + i) * n + j, load(moved, (nx + i) * n + j))
            for e in range(lanes.phi_at.shape[0]):
                j, c = nx + lanes.phi_at[e, 0], nx + lanes.phi_at[e, 1]
                factor = load(phi, (j - nx) * nz + c - nx)
                for i in range(moving):
                    store(cov, i * n + j, load(cov, i * n + j) + load(moved, i * n + c) * factor)
            for i in range(moving):
                for j in range(i + 1 if i < nx else moving, n):
                    store(cov, j * n + i, load(cov, i * n + j))
            for i in range(nb):
                a = (moving + i) * (n + 1)
                store(cov, a, load(cov, a) + splat(lanes.walk[interval, i]))
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
        for lane in range(LANES):
            for i in range(nx):
                one_x[i] = mean[i, lane]
            for i in range(nw):
                one_w[i] = w1[i, lane]
            reading_jacobian(one_x, u, lanes.p[lane], one_w, one_y, one_C, no_parameters[:m], one_E)
            for c in range(m):
                y[c, lane] = one_y[c]
                for i in range(nx):
                    H[c, i, lane] = one_C[c, i]
                for i in range(nw):
                    E[c, i, lane] = one_E[c, i]
        for c in range(m):
            for j in range(nz):
                store(H, c * n + nx + j, nothing)
            for e in range(lanes.H_at.shape[0]):
                i, j = lanes.H_at[e, 0], c * n + nx + lanes.H_at[e, 1]
                store(H, j, load(H, j) + load(E, c * nw + i) * load(H1, e))
            bias = lanes.bias_of[c]
            if bias >= 0:
                store(y, c, load(y, c) + load(mean, moving + bias))
                store(H, c * n + moving + bias, unit)
        for i in range(n):
            store(shift, i, load(mean, i))
        for c in range(m):
            value_read = readings[k, c]
            if np.isnan(value_read):
                continue
            _combine(H, c * n, n, every, 0, cov, n, v, 0)
            spread = load(lanes.noise, c)
            residual = splat(value_read) - load(y, c)
            for i in range(n):
                slope = load(H, c * n + i)
                spread = spread + slope * load(v, i)
                residual = residual - slope * (load(mean, i) - load(shift, i))
            scale = unit / spread
            step = scale * residual
            for i in range(n):
                along = load(v, i)
                store(mean, i, load(mean, i) + along * step)
                gain = along * scale
                for j in range(i, n):
                    value = load(cov, i * n + j) - gain * load(v, j)
                    store(cov, i * n + j, value)
                    store(cov, j * n + i, value)
            store(whitened, k * m + c, residual / square_root(spread))
            store(s, 0, spread)
            for lane in range(LANES):
                log_std[k, c, lane] = 0.5 * math.log(s[0, lane])

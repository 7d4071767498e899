"""One step of a composed model, in compiled code: every filter moves its beliefs with these functions and no others.

The state is [x | z | b | θ]: mechanical states, load states, sensor biases, parameters in filter coordinates.
Between two samples inputs and loads run linearly, so that with w = w_known + H(ψ) z and z₁ = Φ z₀ + η

    x₁ = RK4(x₀; u₀, u₁, w₀, w₁, p(θ)),     y = h(x, u, p(θ), w) + b + noise.

x goes through RK4 together with its sensitivities to x₀, w₀, w₁ and p; z is discretised exactly; b and θ stay (or
walk). The load noise η reaches x₁ through w₁, and Q carries that correlation.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import types

from windsysid.jit import inlined

__all__ = [
    "BLOCKS",
    "Blocks",
    "Workspace",
    "expected_reading",
    "linearise_reading",
    "linearise_transition",
    "move",
    "predict_moments",
    "set_load_outputs",
    "workspace",
]


class Blocks(NamedTuple):
    """A composed model as plain arrays: what the kernels of every filter receive.

    Attributes
    ----------
    sizes
        (n_x, n_z, n_b, n_θ, n_u, n_w) as int64.
    step
        The sampling intervals that occur [s], (S,). Where there are several, the last column of the inputs says which of
        them, counted from 0, led to the sample.
    azimuth
        Column of ψ among the inputs, (1,) as int64; −1 where no load turns with the rotor.
    p
        All physical parameters (n_p,); those identified are replaced from θ.
    chosen
        Index into `p` of each identified parameter (n_θ,) as int64.
    reference
        Scale of each identified parameter (n_θ,): p = reference · exp(θ) or reference · θ.
    logarithmic
        1 where p = reference · exp(θ), as int64 (n_θ,).
    load_transition, load_noise
        Φ and the covariance of η for each interval (S, n_z, n_z).
    load_output
        H₀, C₁, S₁, C₂ … of H(ψ) = H₀ + Σ_k (C_k cos kψ + S_k sin kψ), (1 + 2K, n_w, n_z).
    walk
        Variance per step of each bias and parameter, for each interval (S, n_b + n_θ).
    bias_of
        Index of the bias state of each reading, −1 for none (m,) as int64.
    noise
        Variance of the noise of each reading (m,).
    gate
        Standard deviations beyond which an innovation is left out (1,); ∞ where none is.
    """

    sizes: Any
    step: Any
    azimuth: Any
    p: Any
    chosen: Any
    reference: Any
    logarithmic: Any
    load_transition: Any
    load_noise: Any
    load_output: Any
    walk: Any
    bias_of: Any
    noise: Any
    gate: Any


_i1, _f1, _f2, _f3 = types.int64[::1], types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
BLOCKS = types.NamedTuple([_i1, _f1, _i1, _f1, _i1, _f1, _i1, _f3, _f3, _f3, _f2, _i1, _f1, _f1], Blocks)
"""Numba's type of `Blocks`, for explicit signatures."""


class Workspace(NamedTuple):
    """Scratch arrays of one run. `A`, `B`, `G`, `C`, `D`, `E` keep the zeros that kernels never write."""

    p: Any
    slope: Any
    u: Any
    w0: Any
    w1: Any
    w: Any
    H0: Any
    H1: Any
    z: Any
    x: Any
    rate: Any
    total: Any
    A: Any
    B: Any
    G: Any
    S: Any
    slope_S: Any
    total_S: Any
    top: Any
    noise_gain: Any
    moved: Any
    y: Any
    C: Any
    D: Any
    E: Any
    H: Any


@inlined
def workspace(blocks: Any) -> Any:
    """Allocate a `Workspace` for a model."""
    nx, nz, nb, nt, nu, nw = blocks.sizes
    n, m, columns = nx + nz + nb + nt, blocks.noise.size, nx + 2 * nw + nt
    return Workspace(
        blocks.p.copy(), np.ones(nt), np.zeros(nu), np.zeros(nw), np.zeros(nw), np.zeros(nw),
        np.zeros((nw, nz)), np.zeros((nw, nz)), np.zeros(nz), np.zeros(nx),
        np.zeros(nx), np.zeros(nx), np.zeros((nx, nx)), np.zeros((nx, nt)), np.zeros((nx, nw)), np.zeros((nx, columns)),
        np.zeros((nx, columns)), np.zeros((nx, columns)), np.zeros((nx, n)), np.zeros((nx, nz)), np.zeros((n, n)),
        np.zeros(m), np.zeros((m, nx)), np.zeros((m, nt)), np.zeros((m, nw)), np.zeros((m, n)),
    )  # fmt: skip


@inlined
def set_parameters(blocks: Any, ws: Any, mean: Any) -> None:
    """Physical parameters and ∂p/∂θ from the parameter block of `mean`."""
    nx, nz, nb, nt, _, _ = blocks.sizes
    for j in range(nt):
        theta = mean[nx + nz + nb + j]
        reference = blocks.reference[j]
        if blocks.logarithmic[j] == 1:
            value = reference * np.exp(theta)
            ws.p[blocks.chosen[j]] = value
            ws.slope[j] = value
        else:
            ws.p[blocks.chosen[j]] = reference * theta
            ws.slope[j] = reference


@inlined
def interval(blocks: Any, inputs: Any) -> int:
    """Which of the model's sampling intervals led to the sample of these inputs."""
    return 0 if blocks.step.size == 1 else int(inputs[inputs.size - 1])


@inlined
def load_output(blocks: Any, inputs: Any, H: Any) -> None:
    """H(ψ) at the azimuth of `inputs`, into `H` (n_w, n_z)."""
    rows = blocks.load_output
    for i in range(H.shape[0]):
        for j in range(H.shape[1]):
            H[i, j] = rows[0, i, j]
    for k in range(1, (rows.shape[0] + 1) // 2):
        angle = k * inputs[blocks.azimuth[0]]
        cosine, sine = np.cos(angle), np.sin(angle)
        for i in range(H.shape[0]):
            for j in range(H.shape[1]):
                H[i, j] += rows[2 * k - 1, i, j] * cosine + rows[2 * k, i, j] * sine


@inlined
def set_load_outputs(blocks: Any, ws: Any, before: Any, after: Any) -> None:
    """H(ψ) at either end of a step, once for all the states that `move` takes through it."""
    load_output(blocks, before, ws.H0)
    load_output(blocks, after, ws.H1)


@inlined
def move(rates: Any, blocks: Any, ws: Any, state: Any, eta: Any, before: Any, after: Any) -> None:
    """The mechanical states one step on from `state` with the load noise `eta` (n_z,), by values alone, in ``ws.x``.

    Load states are left in ``ws.z``. It is what `linearise_transition` computes, without sensitivities.
    """
    nx, nz, _, _, nu, nw = blocks.sizes
    s = interval(blocks, after)
    h, phi = blocks.step[s], blocks.load_transition[s]
    set_parameters(blocks, ws, state)
    for i in range(nz):
        moved = eta[i]
        for j in range(nz):
            moved += phi[i, j] * state[nx + j]
        ws.z[i] = moved
    for i in range(nw):
        first, last = before[nu + i], after[nu + i]
        for j in range(nz):
            first += ws.H0[i, j] * state[nx + j]
            last += ws.H1[i, j] * ws.z[j]
        ws.w0[i] = first
        ws.w1[i] = last
    for i in range(nx):
        ws.x[i] = state[i]
        ws.total[i] = 0.0
    for stage in range(4):
        at = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
        ahead = h if stage == 2 else 0.5 * h
        for i in range(nu):
            ws.u[i] = before[i] + at * (after[i] - before[i])
        for i in range(nw):
            ws.w[i] = ws.w0[i] + at * (ws.w1[i] - ws.w0[i])
        rates(ws.x, ws.u, ws.p, ws.w, ws.rate)
        for i in range(nx):
            ws.total[i] += weight * ws.rate[i]
            ws.x[i] = state[i] + ahead * ws.rate[i]
    for i in range(nx):
        ws.x[i] = state[i] + ws.total[i]


@inlined
def linearise_transition(rates_jacobian: Any, blocks: Any, ws: Any, mean: Any, before: Any, after: Any) -> None:
    """Move `mean` by one step, in place, and leave the derivatives of the mechanical states.

    ``ws.top`` holds those to the state before the step (n_x, n), ``ws.noise_gain`` those to the load noise η (n_x, n_z).
    """
    nx, nz, nb, nt, nu, nw = blocks.sizes
    s = interval(blocks, after)
    h, phi = blocks.step[s], blocks.load_transition[s]
    set_parameters(blocks, ws, mean)
    set_load_outputs(blocks, ws, before, after)
    for i in range(nz):
        moved = 0.0
        for j in range(nz):
            moved += phi[i, j] * mean[nx + j]
        ws.z[i] = moved
    for i in range(nw):
        first, last = before[nu + i], after[nu + i]
        for j in range(nz):
            first += ws.H0[i, j] * mean[nx + j]
            last += ws.H1[i, j] * ws.z[j]
        ws.w0[i] = first
        ws.w1[i] = last
    columns = nx + 2 * nw + nt
    S, slope_S, total_S = ws.S, ws.slope_S, ws.total_S
    for i in range(nx):
        ws.x[i] = mean[i]
        ws.total[i] = 0.0
        for c in range(columns):
            S[i, c] = 0.0
            total_S[i, c] = 0.0
        S[i, i] = 1.0
    for stage in range(4):
        at = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
        ahead = h if stage == 2 else 0.5 * h
        for i in range(nu):
            ws.u[i] = before[i] + at * (after[i] - before[i])
        for i in range(nw):
            ws.w[i] = ws.w0[i] + at * (ws.w1[i] - ws.w0[i])
        rates_jacobian(ws.x, ws.u, ws.p, ws.w, ws.rate, ws.A, ws.B, ws.G)
        for i in range(nx):
            for c in range(nx):
                slope_S[i, c] = 0.0
            for c in range(nw):
                slope_S[i, nx + c] = (1.0 - at) * ws.G[i, c]
                slope_S[i, nx + nw + c] = at * ws.G[i, c]
            for c in range(nt):
                slope_S[i, nx + 2 * nw + c] = ws.B[i, c]
            for j in range(nx):
                slope = ws.A[i, j]
                if slope != 0.0:
                    for c in range(columns):
                        slope_S[i, c] += slope * S[j, c]
        for i in range(nx):
            ws.total[i] += weight * ws.rate[i]
            ws.x[i] = mean[i] + ahead * ws.rate[i]
            for c in range(columns):
                total_S[i, c] += weight * slope_S[i, c]
                S[i, c] = ahead * slope_S[i, c]
            S[i, i] += 1.0
    for i in range(nx):
        mean[i] += ws.total[i]
        for c in range(columns):
            S[i, c] = total_S[i, c]
        S[i, i] += 1.0
    for i in range(nz):
        mean[nx + i] = ws.z[i]
    top, noise_gain = ws.top, ws.noise_gain
    for i in range(nx):
        for j in range(nx):
            top[i, j] = S[i, j]
        for j in range(nz):
            eta = 0.0
            direct = 0.0
            for k in range(nw):
                eta += S[i, nx + nw + k] * ws.H1[k, j]
                direct += S[i, nx + k] * ws.H0[k, j]
            top[i, nx + j] = direct
            noise_gain[i, j] = eta
        for j in range(nz):
            through = 0.0
            for k in range(nz):
                through += noise_gain[i, k] * phi[k, j]
            top[i, nx + j] += through
        for j in range(nt):
            top[i, nx + nz + nb + j] = S[i, nx + 2 * nw + j] * ws.slope[j]


@inlined
def predict_moments(rates_jacobian: Any, blocks: Any, ws: Any, mean: Any, cov: Any, before: Any, after: Any) -> None:
    """Mean and covariance one step on, in place: P ← F P Fᵀ + Γ Q Γᵀ with F = ∂(x, z, b, θ)₁/∂(x, z, b, θ)₀."""
    nx, nz, nb, nt, _, _ = blocks.sizes
    n, rest = nx + nz + nb + nt, nx + nz
    linearise_transition(rates_jacobian, blocks, ws, mean, before, after)
    top, moved, noise_gain = ws.top, ws.moved, ws.noise_gain
    s = interval(blocks, after)
    phi, Q, walk = blocks.load_transition[s], blocks.load_noise[s], blocks.walk[s]
    # rows of F P: the mechanical rows are full, the load rows go through Φ, the others stay
    for i in range(nx):
        for c in range(n):
            moved[i, c] = 0.0
        for j in range(n):
            slope = top[i, j]
            if slope != 0.0:
                for c in range(n):
                    moved[i, c] += slope * cov[j, c]
    for i in range(nz):
        for c in range(n):
            moved[nx + i, c] = 0.0
        for j in range(nz):
            slope = phi[i, j]
            if slope != 0.0:
                for c in range(n):
                    moved[nx + i, c] += slope * cov[nx + j, c]
    # (F P) Fᵀ, the upper triangle, mirrored
    for i in range(nx):
        for j in range(i, nx):
            value = 0.0
            for k in range(n):
                value += moved[i, k] * top[j, k]
            cov[i, j] = value
            cov[j, i] = value
    for i in range(nx):
        for j in range(nz):
            value = 0.0
            for k in range(nz):
                value += moved[i, nx + k] * phi[j, k] + noise_gain[i, k] * Q[k, j]
            cov[i, nx + j] = value
            cov[nx + j, i] = value
        for j in range(rest, n):
            cov[i, j] = moved[i, j]
            cov[j, i] = moved[i, j]
    for i in range(nx):
        for k in range(nz):
            pushed = 0.0
            for j in range(nz):
                pushed += noise_gain[i, j] * Q[j, k]
            for j in range(i, nx):
                value = pushed * noise_gain[j, k]
                cov[i, j] += value
                if j != i:
                    cov[j, i] += value
    for i in range(nz):
        for j in range(i, nz):
            value = Q[i, j]
            for k in range(nz):
                value += moved[nx + i, nx + k] * phi[j, k]
            cov[nx + i, nx + j] = value
            cov[nx + j, nx + i] = value
        for j in range(rest, n):
            cov[nx + i, j] = moved[nx + i, j]
            cov[j, nx + i] = moved[nx + i, j]
    for i in range(nb + nt):
        cov[rest + i, rest + i] += walk[i]


@inlined
def set_reading_arguments(blocks: Any, ws: Any, state: Any, inputs: Any) -> None:
    """Parameters, mechanical states, inputs and loads of `state`, for a reading with H(ψ) in ``ws.H1``."""
    nx, nz, _, _, nu, nw = blocks.sizes
    set_parameters(blocks, ws, state)
    for i in range(nx):
        ws.x[i] = state[i]
    for i in range(nu):
        ws.u[i] = inputs[i]
    for i in range(nw):
        load = inputs[nu + i]
        for j in range(nz):
            load += ws.H1[i, j] * state[nx + j]
        ws.w[i] = load


@inlined
def expected_reading(reading: Any, blocks: Any, ws: Any, state: Any, inputs: Any) -> None:
    """The readings of `state` in ``ws.y``, by values alone; ``ws.H1`` holds H(ψ)."""
    nx, nz, _, _, _, _ = blocks.sizes
    set_reading_arguments(blocks, ws, state, inputs)
    reading(ws.x, ws.u, ws.p, ws.w, ws.y)
    for i in range(blocks.noise.size):
        bias = blocks.bias_of[i]
        if bias >= 0:
            ws.y[i] += state[nx + nz + bias]


@inlined
def linearise_reading(reading_jacobian: Any, blocks: Any, ws: Any, mean: Any, inputs: Any) -> None:
    """The expected readings in ``ws.y`` and their derivatives to the whole state in ``ws.H``."""
    nx, nz, nb, nt, _, nw = blocks.sizes
    load_output(blocks, inputs, ws.H1)
    set_reading_arguments(blocks, ws, mean, inputs)
    reading_jacobian(ws.x, ws.u, ws.p, ws.w, ws.y, ws.C, ws.D, ws.E)
    for i in range(blocks.noise.size):
        for j in range(nx):
            ws.H[i, j] = ws.C[i, j]
        for j in range(nz):
            slope = 0.0
            for k in range(nw):
                slope += ws.E[i, k] * ws.H1[k, j]
            ws.H[i, nx + j] = slope
        for j in range(nt):
            ws.H[i, nx + nz + nb + j] = ws.D[i, j] * ws.slope[j]
        bias = blocks.bias_of[i]
        if bias >= 0:
            ws.y[i] += mean[nx + nz + bias]
            ws.H[i, nx + nz + bias] = 1.0

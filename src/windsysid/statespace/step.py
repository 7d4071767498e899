"""One step of a composed model, in compiled code: every filter moves its beliefs with these functions and no others.

The state is [x | z | b | θ]: mechanical states, load states, sensor biases, parameters in filter coordinates.
Between two samples known inputs and loads run linearly, so that with w = w_known + H(ψ) z, z₁ = Φ z₀ + η and unit
normals ξ

    x₁ = RK4(x₀; u₀, u₁, w₀ + H₀ R ξ, w₁ + H₁ R ξ, p(θ)),     y = h(x, u, p(θ), w) + b + noise.

x goes through RK4 together with its sensitivities to x₀, w₀, w₁ and p; z is discretised exactly; b and θ stay (or
walk). The load noise η reaches x₁ through w₁, and Q carries that correlation. R ξ is what load states do within the
step in addition to a straight line (`windsysid.statespace.within_step`).
"""

from typing import Any

import numpy as np

from windsysid.kernels.jit import pasted, uncounted
from windsysid.kernels.parts import load_part, store_part
from windsysid.kernels.rows import multiply, write
from windsysid.kernels.simd import LANES, load, splat, store
from windsysid.statespace.workspace import load_output

__all__ = [
    "expected_reading", "linearise_reading", "linearise_transition", "move", "predict_moments", "set_load_outputs",
    "set_parameters",
]  # fmt: skip


@pasted
def set_parameters(blocks: Any, ws: Any, mean: Any) -> None:
    """Physical parameters and ∂p/∂θ from the parameter block of `mean`."""
    nx, nz, nb, nt, _, _ = blocks.sizes
    for j in range(nt):
        theta = mean[nx + nz + nb + j]
        value, slope = blocks.reference[j] * theta, blocks.reference[j]
        if blocks.logarithmic[j] == 1:
            value = slope = blocks.reference[j] * np.exp(theta)
        ws.p[blocks.chosen[j]] = value
        ws.slope[nx + nz + nb + j] = slope


@pasted
def interval(blocks: Any, inputs: Any) -> int:
    """Index of the model's sampling interval before the sample of these inputs."""
    return 0 if blocks.step.size == 1 else int(inputs[inputs.size - 1])


@pasted
def set_load_outputs(blocks: Any, ws: Any, before: Any, after: Any) -> None:
    """H(ψ) at either end of a step, once for all the states that `move` takes through it."""
    load_output(blocks, ws, before, ws.H0)
    load_output(blocks, ws, after, ws.H1)


@pasted
def set_load_ends(blocks: Any, ws: Any, state: Any, before: Any, after: Any) -> None:
    """Loads at either end of a step, known ones and those of the load states: of `state`, and ``ws.z`` at the end, in
    addition to ``ws.middle``."""
    nx, nz, _, _, nu, nw = blocks.sizes
    for i in range(nw):
        first, last = before[nu + i], after[nu + i]
        for j in range(nz):
            first += ws.H0[i, j] * (state[nx + j] + ws.middle[j])
            last += ws.H1[i, j] * (ws.z[j] + ws.middle[j])
        ws.w0[i] = first
        ws.w1[i] = last


@pasted
def set_stage_inputs(blocks: Any, ws: Any, before: Any, after: Any, at: float) -> None:
    """Inputs and loads a share `at` of a step after its beginning: between samples they run linearly."""
    _, _, _, _, nu, nw = blocks.sizes
    for i in range(nu):
        ws.u[i] = before[i] + at * (after[i] - before[i])
    for i in range(nw):
        ws.w[i] = ws.w0[i] + at * (ws.w1[i] - ws.w0[i])


@uncounted
def move(rates: Any, blocks: Any, ws: Any, state: Any, eta: Any, before: Any, after: Any) -> None:
    """The mechanical states one step on from `state` with the load noise `eta` (n_z,), by values alone, in ``ws.x``.

    Load states are left in ``ws.z``; ``ws.middle`` is what they are in addition to a straight line. It is what
    `linearise_transition` computes, without sensitivities.
    """
    nx, nz, _, _, _, _ = blocks.sizes
    s = interval(blocks, after)
    h, phi = blocks.step[s], blocks.load_transition[s]
    set_parameters(blocks, ws, state)
    for i in range(nz):
        moved = eta[i]
        for j in range(nz):
            moved += phi[i, j] * state[nx + j]
        ws.z[i] = moved
    set_load_ends(blocks, ws, state, before, after)
    for i in range(nx):
        ws.x[i] = state[i]
        ws.total[i] = 0.0
    for stage in range(4):
        at = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
        ahead = h if stage == 2 else 0.5 * h
        set_stage_inputs(blocks, ws, before, after, at)
        rates(ws.x, ws.u, ws.p, ws.w, ws.rate)
        for i in range(nx):
            ws.total[i] += weight * ws.rate[i]
            ws.x[i] = state[i] + ahead * ws.rate[i]
    for i in range(nx):
        ws.x[i] = state[i] + ws.total[i]


@uncounted
def linearise_transition(rates_jacobian: Any, blocks: Any, ws: Any, mean: Any, before: Any, after: Any) -> None:
    """Move `mean` by one step, in place, with its parameters in ``ws.p``, and leave in ``ws.F`` the rows of F for x and
    z, in ``ws.gain`` Γ, and in ``ws.within`` how ξ reaches x.

    F is the derivative of the state after the step to the state before, Γ that to the load noise η.
    """
    nx, nz, nb, nt, _, nw = blocks.sizes
    s = interval(blocks, after)
    h, phi = blocks.step[s], blocks.load_transition[s]
    set_load_outputs(blocks, ws, before, after)
    for i in range(nz):
        moved = 0.0
        for j in range(nz):
            moved += phi[i, j] * mean[nx + j]
        ws.z[i] = moved
    set_load_ends(blocks, ws, mean, before, after)
    J, G, S, slope_S, total_S, vectors = ws.J, ws.G, ws.S, ws.slope_S, ws.total_S, nx * ws.S.shape[1] // LANES
    for i in range(nx):
        ws.x[i] = mean[i]
        ws.total[i] = 0.0
    for c in range(vectors):
        store(S, c, splat(0.0))
        store(total_S, c, splat(0.0))
    for stage in range(4):
        at = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
        ahead = h if stage == 2 else 0.5 * h
        set_stage_inputs(blocks, ws, before, after, at)
        rates_jacobian(ws.x, ws.u, ws.p, ws.w, ws.rate, J, ws.J_p, G)
        early, late = splat(1.0 - at), splat(at)
        for i in range(nx):
            for c in range(0, nw, LANES):
                slope, first = load(G, (i * G.shape[1] + c) // LANES), i * J.shape[1] + nx + c
                store_part(J, first, early * slope, nw - c)
                store_part(J, first + nw, late * slope, nw - c)
            ws.total[i] += weight * ws.rate[i]
            ws.x[i] = mean[i] + ahead * ws.rate[i]
        multiply(J, J, 0, nx, 0, nx if stage > 0 else 0, S, slope_S)
        share, reach = splat(weight), splat(ahead)
        for c in range(vectors):
            slope = load(slope_S, c)
            store(total_S, c, load(total_S, c) + share * slope)
            store(S, c, reach * slope)
    for i in range(nx):
        mean[i] += ws.total[i]
    for i in range(nz):
        mean[nx + i] = ws.z[i]
    # F for x: its own columns, those of z through the loads at both ends, those of θ
    F, gain, direct, width, columns = ws.F, ws.gain, ws.pushed, ws.F.shape[1], S.shape[1]
    multiply(ws.nothing, ws.S_w1, 0, nx, 0, nw, ws.H1, gain)
    multiply(ws.nothing, ws.S_w0, 0, nx, 0, nw, ws.H0, direct)
    if blocks.load_within.shape[2] > 0:
        R = ws.R[s * nz : (s + 1) * nz]
        multiply(ws.nothing, gain, 0, nx, 0, nz, R, ws.within)
        multiply(ws.within, direct, 0, nx, 0, nz, R, ws.within)
    multiply(direct, gain, 0, nx, 0, nz, ws.phi[s * nz : (s + 1) * nz], direct)
    for i in range(nx):
        write(F, i * width, total_S, i * columns, nx)
        write(F, i * width + nx, direct, i * direct.shape[1], nz)
        for c in range(0, nt, LANES):
            slope = load_part(ws.S_p, i * columns + c, nt - c) * load_part(ws.slope, nx + nz + nb + c, nt - c)
            store_part(F, i * width + nx + nz + nb + c, slope, nt - c)
        F[i, i] += 1.0
    for i in range(nz):
        write(F, (nx + i) * width + nx, ws.phi, (s * nz + i) * ws.phi.shape[1], nz)


@uncounted
def predict_moments(rates_jacobian: Any, blocks: Any, ws: Any, mean: Any, cov: Any, before: Any, after: Any) -> None:
    """Mean and covariance (n, n⁺) one step on, in place: P ← F P Fᵀ + Γ Q Γᵀ + V Vᵀ with F = ∂(x, z, b, θ)₁/∂(x, z, b,
    θ)₀ and V = ∂x₁/∂ξ."""
    nx, nz, nb, nt, _, _ = blocks.sizes
    n, moving = nx + nz + nb + nt, nx + nz
    linearise_transition(rates_jacobian, blocks, ws, mean, before, after)
    s = interval(blocks, after)
    F, moved, moved_T, crossed = ws.F, ws.moved, ws.moved_T, ws.crossed
    gain, gain_T, pushed = ws.gain, ws.gain_T, ws.pushed
    # F P and its transpose; b and θ stay
    multiply(ws.nothing, F, 0, nx, 0, n, cov, moved)
    multiply(ws.nothing, F, nx, moving, nx, moving, cov, moved)
    for i in range(moving):
        for j in range(n):
            moved_T[j, i] = moved[i, j]
    multiply(ws.nothing, gain, 0, moving, 0, nz, ws.Q[s * nz : (s + 1) * nz], pushed)
    for i in range(nx):
        for j in range(nz):
            gain_T[j, i] = gain[i, j]
    multiply(ws.nothing, F, 0, nx, 0, n, moved_T, crossed)
    multiply(ws.nothing, F, nx, moving, nx, moving, moved_T, crossed)
    multiply(crossed, pushed, 0, moving, 0, nz, gain_T, crossed)
    rough = blocks.load_within.shape[2]
    if rough > 0:
        for i in range(nx):
            for j in range(rough):
                ws.within_T[j, i] = ws.within[i, j]
        multiply(crossed, ws.within, 0, nx, 0, rough, ws.within_T, crossed)
    width = cov.shape[1]
    for i in range(moving):
        write(cov, i * width, crossed, i * crossed.shape[1], moving)
        write(cov, i * width + moving, moved, i * width + moving, n - moving)
        for j in range(i):
            cov[i, j] = cov[j, i]
    walk = blocks.walk[s]
    for i in range(moving, n):
        write(cov, i * width, moved_T, i * crossed.shape[1], moving)
        cov[i, i] += walk[i - moving]


@pasted
def set_reading_arguments(blocks: Any, ws: Any, state: Any, inputs: Any) -> None:
    """Mechanical states, inputs and loads of `state`, for a reading with H(ψ) in ``ws.H1``."""
    nx, nz, _, _, nu, nw = blocks.sizes
    for i in range(nx):
        ws.x[i] = state[i]
    for i in range(nu):
        ws.u[i] = inputs[i]
    for i in range(nw):
        force = inputs[nu + i]
        for j in range(nz):
            force += ws.H1[i, j] * state[nx + j]
        ws.w[i] = force


@uncounted
def expected_reading(reading: Any, blocks: Any, ws: Any, state: Any, inputs: Any) -> None:
    """The readings of `state` in ``ws.y``, by values alone; ``ws.H1`` holds H(ψ)."""
    nx, nz, _, _, _, _ = blocks.sizes
    set_parameters(blocks, ws, state)
    set_reading_arguments(blocks, ws, state, inputs)
    reading(ws.x, ws.u, ws.p, ws.w, ws.y)
    for i in range(blocks.noise.size):
        bias = blocks.bias_of[i]
        if bias >= 0:
            ws.y[i] += state[nx + nz + bias]


@uncounted
def linearise_reading(reading_jacobian: Any, blocks: Any, ws: Any, mean: Any, inputs: Any) -> None:
    """Write the readings expected of `mean` and ``ws.p`` to ``ws.y``, their derivatives to the state to ``ws.H``."""
    nx, nz, _, _, _, nw = blocks.sizes
    load_output(blocks, ws, inputs, ws.H1)
    set_reading_arguments(blocks, ws, mean, inputs)
    reading_jacobian(ws.x, ws.u, ws.p, ws.w, ws.y, ws.H, ws.H_p, ws.E)
    H, width, vectors, by_load = ws.H, ws.H.shape[1], ws.H.shape[1] // LANES, ws.seen
    multiply(ws.nothing, ws.E, 0, blocks.noise.size, 0, nw, ws.H1, by_load)
    for i in range(blocks.noise.size):
        for c in range(vectors):
            store(H, i * vectors + c, load(H, i * vectors + c) * load(ws.slope, c))
        write(H, i * width + nx, by_load, i * by_load.shape[1], nz)
        bias = blocks.bias_of[i]
        if bias >= 0:
            ws.y[i] += mean[nx + nz + bias]
            H[i, nx + nz + bias] = 1.0

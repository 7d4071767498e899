"""One step of a composed model, in compiled code: every filter moves its beliefs with these functions and no others.

The state is [x | z | b | θ]: mechanical states, load states, sensor biases, parameters in filter coordinates.
Between two samples inputs and loads run linearly, so that with w = w_known + H(ψ) z and z₁ = Φ z₀ + η

    x₁ = RK4(x₀; u₀, u₁, w₀, w₁, p(θ)),     y = h(x, u, p(θ), w) + b + noise.

x goes through RK4 together with its sensitivities to x₀, w₀, w₁ and p; z is discretised exactly; b and θ stay (or
walk). The load noise η reaches x₁ through w₁, and Q carries that correlation.
"""

from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid.jit import pasted, uncounted
from windsysid.rows import multiply, padded, write
from windsysid.simd import LANES, load, load_part, splat, store, store_part

__all__ = [
    "BLOCKS",
    "WORKSPACE",
    "Blocks",
    "Matrix",
    "Vector",
    "Workspace",
    "expected_reading",
    "linearise_reading",
    "linearise_transition",
    "move",
    "predict_moments",
    "scratch_type",
    "set_load_outputs",
    "set_parameters",
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


Vector = Annotated[NDArray[np.float64], 1]
Matrix = Annotated[NDArray[np.float64], 2]
Indices = NDArray[np.int64]
"""Kinds of scratch arrays: (k,), (k, l), and (k,) of whole numbers."""
_i1, _f1, _f2, _f3 = types.int64[::1], types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
BLOCKS = types.NamedTuple([_i1, _f1, _i1, _f1, _i1, _f1, _i1, _f3, _f3, _f3, _f2, _i1, _f1, _f1], Blocks)
"""Numba's type of `Blocks`, for explicit signatures."""
_NUMBA = {int: types.int64, Indices: _i1, Vector: _f1, Matrix: _f2}


class Workspace(NamedTuple):
    """Scratch arrays of one run; matrices (·, n⁺) have rows padded with zeros to whole vectors, see `windsysid.rows.padded`.

    Attributes
    ----------
    mean, cov
        Of the state (n⁺,), (n, n⁺).
    about
        Where the readings are linearised (n⁺,).
    p
        Physical parameters (n_p,).
    slope
        ∂p/∂θ in θ's place in the state (n⁺,), 1 in the others'.
    J
        ∂ẋ/∂(x₀, w₀, w₁, p) of one stage, directly (n_x + 1, columns⁺): a kernel writes its first columns as ∂ẋ/∂x, those of p through
        `J_p`, and ∂ẋ/∂w into `G`.
    S, slope_S, total_S
        Sensitivities of x to the same less the identity, their rates and their change over the step (n_x + 1, columns⁺); `S_w0`, `S_w1`
        and `S_p` are `total_S` seen from those columns on.
    H0, H1
        H(ψ) at either end of the step (n_w, n_z⁺).
    load_output, phi, Q
        `load_output`, `load_transition` and `load_noise` of `Blocks`, one matrix below the other (·, n_z⁺).
    F
        The rows of F that belong to x and z (n_x + n_z, n⁺); the others are the identity's.
    gain, gain_T
        Γ (n_x + n_z, n_z⁺) and Γᵀ.
    moved, moved_T, pushed, crossed
        F P and its transpose, Γ Q, and F P Fᵀ + Γ Q Γᵀ of x and z (n_x + n_z, (n_x + n_z)⁺).
    H
        ∂y/∂ state (m + 1, n⁺), of which a kernel writes the first columns, and those of θ through `H_p`; ∂y/∂w goes into `E`, and through
        the loads' states into `seen`.
    spread
        H P (m, n⁺).
    K, pulled
        A reading's gain and s K − v (1, n⁺).
    nothing
        A row of zeros, as long as any.
    """

    mean: Vector
    about: Vector
    cov: Matrix
    p: Vector
    slope: Vector
    u: Vector
    w0: Vector
    w1: Vector
    w: Vector
    load_output: Matrix
    H0: Matrix
    H1: Matrix
    z: Vector
    x: Vector
    rate: Vector
    total: Vector
    J: Matrix
    J_p: Matrix
    G: Matrix
    S: Matrix
    slope_S: Matrix
    total_S: Matrix
    S_w0: Matrix
    S_w1: Matrix
    S_p: Matrix
    F: Matrix
    phi: Matrix
    Q: Matrix
    gain: Matrix
    gain_T: Matrix
    moved: Matrix
    moved_T: Matrix
    pushed: Matrix
    crossed: Matrix
    y: Vector
    H: Matrix
    H_p: Matrix
    E: Matrix
    seen: Matrix
    spread: Matrix
    K: Matrix
    pulled: Matrix
    nothing: Matrix


def scratch_type(kind: type[NamedTuple]) -> Any:
    """Numba's type of a tuple whose fields are annotated `int`, `Indices`, `Vector` or `Matrix`."""
    return types.NamedTuple(
        [_NUMBA[annotation] for annotation in get_type_hints(kind, include_extras=True).values()], kind
    )


WORKSPACE = scratch_type(Workspace)
"""Numba's type of `Workspace`."""


def shifted(matrix: Matrix, columns: int) -> Matrix:
    """`matrix` without its last row, seen from a column on: entry (i, j) is entry (i, columns + j)."""
    rows, width = matrix.shape[0] - 1, matrix.shape[1]
    return matrix.reshape(-1)[columns : columns + rows * width].reshape(rows, width)


def _padded(matrices: Matrix) -> Matrix:
    """Matrices (k, r, c), one below the other: (k r, c⁺)."""
    rows = padded(matrices.shape[0] * matrices.shape[1], matrices.shape[2])
    rows[:, : matrices.shape[2]] = matrices.reshape(rows.shape[0], -1) if rows.size else 0.0
    return rows


def workspace(blocks: Blocks) -> Workspace:
    """Allocate a `Workspace` for a model."""
    nx, nz, nb, nt, nu, nw = (int(size) for size in blocks.sizes)
    n, m, moving, columns = nx + nz + nb + nt, len(blocks.noise), nx + nz, nx + 2 * nw + nt
    slope, J, total_S, H = padded(1, n)[0], padded(nx + 1, columns), padded(nx + 1, columns), padded(m + 1, n)
    slope[:n] = 1.0
    gain, gain_T = padded(moving, nz), padded(nz, moving)
    gain[nx:, :nz] = gain_T[:, nx:moving] = np.eye(nz)
    phi, Q, load_output = (
        _padded(blocks_of) for blocks_of in (blocks.load_transition, blocks.load_noise, blocks.load_output)
    )
    return Workspace(
        mean=padded(1, n)[0], about=padded(1, n)[0], cov=padded(n, n), p=blocks.p.copy(), slope=slope, u=np.zeros(nu), w0=np.zeros(nw), w1=np.zeros(nw), w=np.zeros(nw),
        load_output=load_output, H0=padded(nw, nz), H1=padded(nw, nz), z=np.zeros(nz), x=np.zeros(nx), rate=np.zeros(nx), total=np.zeros(nx),
        J=J, J_p=shifted(J, nx + 2 * nw), G=padded(nx, nw), S=padded(nx, columns), slope_S=padded(nx, columns), total_S=total_S,
        S_w0=shifted(total_S, nx), S_w1=shifted(total_S, nx + nw), S_p=shifted(total_S, nx + 2 * nw),
        F=padded(moving, n), phi=phi, Q=Q, gain=gain, gain_T=gain_T,
        moved=padded(moving, n), moved_T=padded(n, moving), pushed=padded(moving, nz), crossed=padded(moving, moving),
        y=np.zeros(m), H=H, H_p=shifted(H, nx + nz + nb), E=np.zeros((m, nw)), seen=padded(m, nz), spread=padded(m, n), K=padded(1, n), pulled=padded(1, n),
        nothing=padded(1, n + columns),
    )  # fmt: skip


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
    """Which of the model's sampling intervals led to the sample of these inputs."""
    return 0 if blocks.step.size == 1 else int(inputs[inputs.size - 1])


@pasted
def load_output(blocks: Any, ws: Any, inputs: Any, H: Any) -> None:
    """H(ψ) at the azimuth of `inputs`, into `H` (n_w, n_z⁺)."""
    rows, vectors = ws.load_output, H.size // LANES
    for c in range(vectors):
        store(H, c, load(rows, c))
    for k in range(1, (blocks.load_output.shape[0] + 1) // 2):
        angle = k * inputs[blocks.azimuth[0]]
        cosine, sine = splat(np.cos(angle)), splat(np.sin(angle))
        for c in range(vectors):
            turning = load(rows, (2 * k - 1) * vectors + c) * cosine + load(rows, 2 * k * vectors + c) * sine
            store(H, c, load(H, c) + turning)


@pasted
def set_load_outputs(blocks: Any, ws: Any, before: Any, after: Any) -> None:
    """H(ψ) at either end of a step, once for all the states that `move` takes through it."""
    load_output(blocks, ws, before, ws.H0)
    load_output(blocks, ws, after, ws.H1)


@uncounted
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


@uncounted
def linearise_transition(rates_jacobian: Any, blocks: Any, ws: Any, mean: Any, before: Any, after: Any) -> None:
    """Move `mean` by one step, in place, with its parameters in ``ws.p``, and leave in ``ws.F`` the rows of F for x and z, in ``ws.gain`` Γ.

    F is the derivative of the state after the step to the state before, Γ that to the load noise η.
    """
    nx, nz, nb, nt, nu, nw = blocks.sizes
    s = interval(blocks, after)
    h, phi = blocks.step[s], blocks.load_transition[s]
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
        for i in range(nu):
            ws.u[i] = before[i] + at * (after[i] - before[i])
        for i in range(nw):
            ws.w[i] = ws.w0[i] + at * (ws.w1[i] - ws.w0[i])
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
    """Mean and covariance (n, n⁺) one step on, in place: P ← F P Fᵀ + Γ Q Γᵀ with F = ∂(x, z, b, θ)₁/∂(x, z, b, θ)₀."""
    nx, nz, nb, nt, _, _ = blocks.sizes
    n, moving = nx + nz + nb + nt, nx + nz
    linearise_transition(rates_jacobian, blocks, ws, mean, before, after)
    s = interval(blocks, after)
    F, moved, moved_T, gain, gain_T, pushed, crossed = (
        ws.F,
        ws.moved,
        ws.moved_T,
        ws.gain,
        ws.gain_T,
        ws.pushed,
        ws.crossed,
    )
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
    """The expected readings of `mean`, with its parameters in ``ws.p``, in ``ws.y``, and their derivatives to the whole state in ``ws.H``."""
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

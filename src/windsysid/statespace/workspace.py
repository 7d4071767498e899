"""A model's arrays as compiled code sees them, and the scratch of one run."""

from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid.kernels.jit import pasted
from windsysid.kernels.rows import padded
from windsysid.kernels.simd import LANES, load, splat, store

__all__ = ["BLOCKS", "WORKSPACE", "Blocks", "Matrix", "Vector", "Workspace", "scratch_type", "workspace"]


class Blocks(NamedTuple):
    """Composed model as plain arrays: argument of the kernels of every filter.

    Attributes
    ----------
    sizes
        (n_x, n_z, n_b, n_θ, n_u, n_w) as int64.
    step
        The sampling intervals that occur [s], (S,). Where there are several, the last column of the inputs says which
        of them, counted from 0, led to the sample.
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
    load_within
        R for each interval (S, n_z, r): what load states do within a step in addition to a straight line, as r unit
        normals that hold over the step (`windsysid.statespace.within_step`); r = 0 where they run along it.
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
    load_within: Any
    walk: Any
    bias_of: Any
    noise: Any
    gate: Any


Vector = Annotated[NDArray[np.float64], 1]
Matrix = Annotated[NDArray[np.float64], 2]
Indices = NDArray[np.int64]
"""Kinds of scratch arrays: (k,), (k, l), and (k,) of whole numbers."""
_i1, _f1, _f2, _f3 = types.int64[::1], types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
BLOCKS = types.NamedTuple([_i1, _f1, _i1, _f1, _i1, _f1, _i1, _f3, _f3, _f3, _f3, _f2, _i1, _f1, _f1], Blocks)
"""Numba's type of `Blocks`, for explicit signatures."""
_NUMBA = {int: types.int64, Indices: _i1, Vector: _f1, Matrix: _f2}


class Workspace(NamedTuple):
    """Scratch arrays of one run; matrices (·, n⁺) have rows padded with zeros to whole vectors, see
    `windsysid.kernels.rows.padded`.

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
        ∂ẋ/∂(x₀, w₀, w₁, p) of one stage, directly (n_x + 1, columns⁺): a kernel writes its first columns as ∂ẋ/∂x,
        those of p through `J_p`, and ∂ẋ/∂w into `G`.
    S, slope_S, total_S
        Sensitivities of x to the same less the identity, their rates and their change over the step (n_x + 1,
        columns⁺); `S_w0`, `S_w1` and `S_p` are `total_S` seen from those columns on.
    H0, H1
        H(ψ) at either end of the step (n_w, n_z⁺).
    middle
        What load states are in addition to a straight line over the whole step (n_z,); zero but for points drawn there.
    load_output, phi, Q, R
        `load_output`, `load_transition`, `load_noise` and `load_within` of `Blocks`, one matrix below the other (·,
        n_z⁺), (·, r⁺).
    F
        The rows of F that belong to x and z (n_x + n_z, n⁺); the others are the identity's.
    gain, gain_T
        Γ (n_x + n_z, n_z⁺) and Γᵀ.
    within, within_T
        How R reaches the motion (n_x + n_z, r⁺), and the same transposed.
    moved, moved_T, pushed, crossed
        F P and its transpose, Γ Q, and F P Fᵀ + Γ Q Γᵀ of x and z (n_x + n_z, (n_x + n_z)⁺).
    H
        ∂y/∂ state (m + 1, n⁺), of which a kernel writes the first columns, and those of θ through `H_p`; ∂y/∂w goes
        into `E`, and through the loads' states into `seen`.
    spread
        H P (m, n⁺), and then v of each reading.
    gains
        −Kᵀ of all readings (n, m⁺).
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
    middle: Vector
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
    R: Matrix
    gain: Matrix
    gain_T: Matrix
    within: Matrix
    within_T: Matrix
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
    gains: Matrix
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
    rough = blocks.load_within.shape[2]
    slope, J, total_S, H = padded(1, n)[0], padded(nx + 1, columns), padded(nx + 1, columns), padded(m + 1, n)
    slope[:n] = 1.0
    gain, gain_T = padded(moving, nz), padded(nz, moving)
    gain[nx:, :nz] = gain_T[:, nx:moving] = np.eye(nz)
    phi, Q, R, load_output = (
        _padded(blocks_of)
        for blocks_of in (blocks.load_transition, blocks.load_noise, blocks.load_within, blocks.load_output)
    )
    return Workspace(
        mean=padded(1, n)[0], about=padded(1, n)[0], cov=padded(n, n), p=blocks.p.copy(), slope=slope, u=np.zeros(nu),
        w0=np.zeros(nw), w1=np.zeros(nw), w=np.zeros(nw),
        load_output=load_output, H0=padded(nw, nz), H1=padded(nw, nz), middle=np.zeros(nz), z=np.zeros(nz),
        x=np.zeros(nx), rate=np.zeros(nx), total=np.zeros(nx),
        J=J, J_p=shifted(J, nx + 2 * nw), G=padded(nx, nw), S=padded(nx, columns), slope_S=padded(nx, columns),
        total_S=total_S,
        S_w0=shifted(total_S, nx), S_w1=shifted(total_S, nx + nw), S_p=shifted(total_S, nx + 2 * nw),
        F=padded(moving, n), phi=phi, Q=Q, R=R, gain=gain, gain_T=gain_T,
        within=padded(moving, rough), within_T=padded(rough, moving),
        moved=padded(moving, n), moved_T=padded(n, moving), pushed=padded(moving, nz), crossed=padded(moving, moving),
        y=np.zeros(m), H=H, H_p=shifted(H, nx + nz + nb), E=np.zeros((m, nw)), seen=padded(m, nz), spread=padded(m, n),
        gains=padded(n, m), nothing=padded(1, n + columns),
    )  # fmt: skip


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

"""The arrays of a bank: `LANES` models of one structure side by side, and the scratch of one run over them.

Every array has the lane as its last axis. Most entries of Φ, H(ψ) and the derivatives are zero for any argument: the
patterns in `Lanes` list those that are not.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.kernels.simd import LANES
from windsysid.statespace.compose import StateSpace

__all__ = ["Lanes", "Scratch", "lanes_of", "pad_within_factors", "patterns_of", "scratch_of"]


class Lanes(NamedTuple):
    """One group of filters as arrays, the lane last: see `windsysid.statespace.workspace.Blocks` for what they are.

    `phi_at`, `within_at`, `A_at`, `G_at` and `H_at` list the entries (row, column) that can differ from zero, row by
    row; `A_rows` says where each row of A begins in its list, `A_columns` is its second column.
    """

    sizes: Any
    step: Any
    azimuth: Any
    p: Any
    phi: Any
    Q: Any
    within: Any
    output: Any
    walk: Any
    bias_of: Any
    noise: Any
    phi_at: Any
    within_at: Any
    A_at: Any
    G_at: Any
    H_at: Any
    A_rows: Any
    A_columns: Any


class Scratch(NamedTuple):
    """Arrays that one run over a group of filters writes to and forgets; the lane is the last axis, rows are padded to
    four columns.

    Attributes
    ----------
    every
        0, 1, 2, …: the row numbers of a matrix of which every row is meant.
    u, w, rate, A, G
        Inputs, loads, ẋ, ∂ẋ/∂x and ∂ẋ/∂w of one stage; `no_rates` and `no_readings` are derivatives to no parameter.
    H0, H1, w0, w1
        Entries of H(ψ) and the loads w at the beginning and at the end of the step.
    z1
        Load states after the step.
    x, total
        State of the next stage, and the change over the step.
    S, slope_S, total_S
        Sensitivities of x to (x₀, w₀, w₁) at a stage, their rates, and their change over the step (n_x, n_x + 2 n_w).
    P
        Covariance (n, n).
    moved, pushed, corner
        F P (n_x + n_z, n), Γ Q (n_x, n_z) and the mechanical block of F P Fᵀ + Γ Q Γᵀ + V Vᵀ (n_x, n_x).
    top, gain, within
        The mechanical rows of F, Γ and V, all transposed (n_x + n_z, n_x), (n_z, n_x), (r, n_x).
    y, H, C, E
        Expected readings and their derivatives to the whole state, to x and to w.
    v, minus, residual
        Rows v of each reading, −v, and whitened innovations.
    stepped, late
        The mechanical states of a tangent after a step (1, n_x), and what is left of changes of the readings.
    """

    every: Any
    u: Any
    w: Any
    rate: Any
    A: Any
    G: Any
    no_rates: Any
    no_readings: Any
    H0: Any
    H1: Any
    w0: Any
    w1: Any
    z1: Any
    x: Any
    total: Any
    S: Any
    slope_S: Any
    total_S: Any
    P: Any
    moved: Any
    pushed: Any
    top: Any
    gain: Any
    within: Any
    corner: Any
    y: Any
    H: Any
    C: Any
    E: Any
    v: Any
    minus: Any
    residual: Any
    stepped: Any
    late: Any


def scratch_of(lanes: Lanes, n: int, changes: int) -> Scratch:
    """Allocate the arrays of one run over a group of filters with n states, and of so many changes of the readings."""
    nx, nz, _, nu, nw = (int(size) for size in lanes.sizes)
    m, turning, moving = len(lanes.noise), len(lanes.H_at), nx + nz
    wide, tall, broad, span = _row_lengths(n, nx, nz, nw)
    rows = {
        "w": nw, "rate": nx, "H0": turning, "H1": turning, "w0": nw, "w1": nw, "z1": nz, "x": nx, "total": nx, "y": m,
        "residual": m,
    }  # fmt: skip
    matrices = {
        "A": (nx, nx), "G": (nx, nw), "no_rates": (nx, 0), "no_readings": (m, 0),
        "S": (nx, span), "slope_S": (nx, span), "total_S": (nx, span),
        "P": (n, wide), "moved": (moving, wide), "pushed": (nx, broad), "corner": (nx, tall), "top": (moving, tall),
        "gain": (nz, tall), "within": (lanes.within.shape[2], tall),
        "H": (m, n), "C": (m, nx), "E": (m, nw), "v": (m, wide), "minus": (m, wide),
        "stepped": (1, tall), "late": (changes, m),
    }  # fmt: skip
    return Scratch(
        every=np.arange(max(n, m)),
        u=np.zeros(nu),
        **{name: np.zeros((size, LANES)) for name, size in rows.items()},
        **{name: np.zeros((*shape, LANES)) for name, shape in matrices.items()},
    )


def _row_lengths(n: int, nx: int, nz: int, nw: int) -> tuple[int, int, int, int]:
    """Lengths of rows with n, n_x, n_z and n_x + 2 n_w columns: multiples of four."""
    columns = nx + 2 * nw
    return n + -n % 4, nx + -nx % 4, nz + -nz % 4, columns + -columns % 4


def pad_within_factors(models: Sequence[StateSpace]) -> list[StateSpace]:
    """Pad the within-step factors R (S, n_z, r) of all models to the largest r with columns of zeros, which leave R Rᵀ
    unchanged.

    r is the number of independent noises that reach an output within a step: it depends on the values of time constants
    and levels (`windsysid.statespace.within_step`), not on the structure alone.
    """
    widest = max(model.blocks.load_within.shape[2] for model in models)
    return [_widened(model, widest - model.blocks.load_within.shape[2]) for model in models]


def _widened(model: StateSpace, columns: int) -> StateSpace:
    """Append columns of zeros to the within-step factors of a model."""
    if columns == 0:
        return model
    within = np.pad(model.blocks.load_within, [(0, 0), (0, 0), (0, columns)])
    return replace(model, blocks=model.blocks._replace(load_within=within))


def lanes_of(group: Sequence[StateSpace], patterns: tuple[NDArray[np.int64], ...]) -> Lanes:
    """The arrays of `LANES` models of one structure, with the entries that can differ from zero (`patterns_of`)."""
    blocks = [model.blocks for model in group]
    nx, nz, nb, _, nu, nw = blocks[0].sizes

    def last(name: str) -> Array:
        return np.ascontiguousarray(np.stack([getattr(b, name) for b in blocks], axis=-1))

    noise = last("load_noise")
    noise = np.pad(noise, [(0, 0), (0, 0), (0, -nz % 4), (0, 0)])
    return Lanes(
        np.array([nx, nz, nb, nu, nw], dtype=np.int64), blocks[0].step, blocks[0].azimuth,
        last("p"), last("load_transition"), noise, last("load_within"), last("load_output"),
        blocks[0].walk, blocks[0].bias_of, last("noise"), *patterns,
    )  # fmt: skip


def patterns_of(model: StateSpace, models: Sequence[StateSpace]) -> tuple[NDArray[np.int64], ...]:
    """Entries that can differ from zero: of Φ, of R, of ∂ẋ/∂x and ∂ẋ/∂w (which kernels write or never touch), of H."""
    nx, _, _, _, nu, nw = model.blocks.sizes
    untouched = 1e300
    A, B, G = np.full((nx, nx), untouched), np.zeros((nx, 0)), np.full((nx, nw), untouched)
    model.compiled.rates_jacobian(np.zeros(nx), np.zeros(nu), model.blocks.p, np.zeros(nw), np.empty(nx), A, B, G)
    phi = np.any([m.blocks.load_transition != 0.0 for m in models], axis=(0, 1))
    within = np.any([m.blocks.load_within != 0.0 for m in models], axis=(0, 1))
    output = np.any([m.blocks.load_output != 0.0 for m in models], axis=(0, 1))
    at = [np.ascontiguousarray(np.argwhere(mask)) for mask in (phi, within, untouched != A, untouched != G, output)]
    rows = np.searchsorted(at[2][:, 0], np.arange(nx + 1)).astype(np.int64)
    return *at, rows, np.ascontiguousarray(at[2][:, 1])

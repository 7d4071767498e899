"""Lifted spectra of many entries, and their likelihood, one place after the other.

The equations are those of `windsysid.spectral.rotor.likelihood`. Where a spectrum has many entries, the products of
matrices cost most: here those of one place stay in the processor's cache, as rows of whole vectors
(`windsysid.kernels.complex_rows`), and nothing is multiplied out that is zero or known by symmetry:

- D couples neighbouring harmonics, so it is a band about its diagonal: its factors solve for T = R D⁻¹, for L⁻¹ T and
  for Q = D⁻¹ U S_s (T U)ᴴ L⁻ᴴ, and there is no inverse.
- A parameter's derivative (dR − T dD) Q has few columns or rows that are not zero.
- An unknown of the loads changes few sources, and of Hermitian matrices the half is found.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.kernels.complex_rows import (
    add_row,
    clear,
    clear_row,
    conjugate_row,
    copy_part,
    copy_row,
    gram,
    imaginary,
    products,
    split,
    turn,
)
from windsysid.kernels.complex_solve import factor, solve, solve_turned, whiten
from windsysid.kernels.jit import called, compiled
from windsysid.kernels.rows import padded
from windsysid.spectral.rotor.harmonic_transfer import MAX_HARMONIC
from windsysid.spectral.rotor.kernel_sparse import element_at
from windsysid.spectral.transforms.lifted import Complex

__all__ = ["add_up_dense", "elements_of", "entries_at", "places_of", "spectra_dense"]


def elements_of(matrices: Complex) -> NDArray[np.int64]:
    """The unknown, the harmonic, the row and the column of every element of matrices (3, n, 7, r, c) that is not
    zero, (N, 4)."""
    return np.ascontiguousarray(np.argwhere(matrices.any(axis=0)), dtype=np.int64)


def entries_at(entries: NDArray[np.intp], orders: int, readings: int) -> NDArray[np.int64]:
    """The entry at each harmonic and reading (2K+1, r); −1 where it is not used."""
    found = np.full(orders * readings, -1, dtype=np.int64)
    found[entries] = np.arange(len(entries))
    return found.reshape(orders, readings)


def places_of(placement: Complex) -> tuple[NDArray[np.int64], Complex]:
    """Source and row (N, 2) of every element of U ((2K+1) n, s) that is not zero, and the elements (N,)."""
    where = np.ascontiguousarray(np.argwhere(placement.T != 0.0), dtype=np.int64)
    return where, np.ascontiguousarray(placement[where[:, 1], where[:, 0]])


class Room(NamedTuple):
    """Workspace for the matrices of one place; those of complex rows are (rows, columns).

    Attributes
    ----------
    D, turned, order
        The factors of D (q, q) and their transposed, and the row that each step exchanges (q,).
    phase
        What late clocks make of the readings (e,).
    one, weights, whitener, turned_whitener
        1, what the elimination takes of the rows above, L⁻¹, and its transposed (e, e).
    T, white, Q
        Tᵀ, (L⁻¹ T)ᵀ and Q (q, e).
    placed, placed_white, driven
        (T U)ᵀ, the same whitened, and S_s of its conjugate (s, e).
    S, half
        S, and one whitened derivative (e, e).
    data, turned_data
        L⁻¹ Y (e, g) and its transposed.
    left, right, slot
        Two factors of a derivative (max(2 (q + e), s, g), e), and the row that a row or a column has in them (q + e,).
    flat
        Whitened derivatives and, behind them, 1 − L⁻¹ P L⁻ᴴ of the data's mean P (n + 1, e²), as real numbers whose
        products are traces; so many more rows that there are a multiple of four.
    found
        The sum of their products, which are F and g (n + 1, n + 1).
    """

    D: Complex
    turned: Complex
    order: NDArray[np.int64]
    phase: Complex
    one: Array
    weights: Complex
    whitener: Array
    turned_whitener: Array
    T: Array
    white: Array
    Q: Array
    placed: Array
    placed_white: Array
    driven: Array
    S: Array
    half: Array
    data: Array
    turned_data: Array
    left: Array
    right: Array
    slot: NDArray[np.int64]
    flat: Array
    found: Array


def _room(model: Sequence[Any], columns: int = 0, unknowns: int = 0) -> Room:
    """Room for one place of a model."""
    size, entries, sources = model[4].shape[1] * model[0].shape[4], len(model[5]), model[11].shape[1]
    one = split(entries, entries)
    one[:, :entries] = np.eye(entries)
    most, rows = max(2 * (size + entries) if unknowns else 0, sources, columns), -(-(unknowns + 1) // 4) * 4
    return Room(
        D=np.empty((size, size), dtype=np.complex128), turned=np.empty((size, size), dtype=np.complex128),
        order=np.empty(size, dtype=np.int64), phase=np.empty(entries, dtype=np.complex128), one=one,
        weights=np.empty((entries, entries), dtype=np.complex128), whitener=split(entries, entries),
        turned_whitener=split(entries, entries), T=split(size, entries), white=split(size, entries),
        Q=split(size, entries), placed=split(sources, entries), placed_white=split(sources, entries),
        driven=split(sources, entries), S=split(entries, entries), half=split(entries, entries),
        data=split(entries, columns), turned_data=split(columns, entries), left=split(most, entries),
        right=split(most, entries), slot=np.empty(size + entries, dtype=np.int64), flat=padded(rows, entries**2),
        found=padded(rows, rows),
    )  # fmt: skip


_C1, _C2, _C3, _C5 = (types.Array(types.complex128, rank, "C") for rank in (1, 2, 3, 5))
_F1, _F2, _F3 = (types.Array(types.float64, rank, "C") for rank in (1, 2, 3))
_I1, _I2 = (types.Array(types.int64, rank, "C") for rank in (1, 2))
_MODEL = (_C5, _I2, _C5, _I2, _F2, _I1, _I2, types.boolean[:, ::1], _F1, _I2, _C1, _F2, _F2, _F2, _C3)
_ROOM = {"D": _C2, "turned": _C2, "order": _I1, "phase": _C1, "weights": _C2, "slot": _I1}
_ROOM_TYPE = types.NamedTuple([_ROOM.get(name, _F2) for name in Room._fields], Room)


def spectra_dense(model: Sequence[Any], S: Complex) -> None:
    """Fills S (B, e, e)."""
    _spectra_kernel()(*model, _room(model), S)


def add_up_dense(
    model: Sequence[Any], slopes: Sequence[Any], data: Complex, counts: Array, g: Array, F: Array
) -> float:
    """J of data (B, e, g); adds slope and information to g (n,) and F (n, n). NaN where S is not positive definite."""
    return float(_add_up_kernel()(*model, *slopes, data, counts, _room(model, data.shape[2], len(g)), g, F))


@lru_cache(maxsize=1)
def _spectra_kernel() -> Any:
    return compiled(_spectra, types.void(*_MODEL, _ROOM_TYPE, _C3), borrows=True)


@lru_cache(maxsize=1)
def _add_up_kernel() -> Any:
    slopes = (_C5, _I2, _C5, _I2, _F2, _F3, _F3, _F3)
    return compiled(_add_up, types.float64(*_MODEL, *slopes, _C3, _F1, _ROOM_TYPE, _F1, _F2), borrows=True)


@called
def _couple(matrices: Any, elements: Any, omega: Any, out: Any) -> int:
    """−ω² X_a + iω X_v + X_q of one set of matrices between all harmonics (q, q); the width of its band to either side
    of the diagonal."""
    count, n, apart = len(omega), matrices.shape[4], 0
    clear(out)
    for at in range(len(elements)):
        h, i, j = elements[at, 1], elements[at, 2], elements[at, 3]
        shift = h - MAX_HARMONIC
        apart = max(apart, abs(shift * n + i - j))
        for k in range(max(0, -shift), min(count, count - shift)):
            out[(k + shift) * n + i, k * n + j] = element_at(matrices[:, 0], h, i, j, omega[k])
    return apart


@called
def _read(
    matrices: Any, elements: Any, omega: Any, entry_of: Any, left_out: Any, phase: Any, white: Any, out: Any
) -> None:
    """out (q, e) ← (white R phase)ᵀ, R being one set of matrices and `white` transposed."""
    count, n = len(omega), matrices.shape[4]
    clear(out)
    for at in range(len(elements)):
        h, i, j = elements[at, 1], elements[at, 2], elements[at, 3]
        shift = h - MAX_HARMONIC
        for k in range(max(0, -shift), min(count, count - shift)):
            x = entry_of[k + shift, i]
            if x < 0 or left_out[x]:
                continue
            value = element_at(matrices[:, 0], h, i, j, omega[k]) * phase[x]
            add_row(out, k * n + j, value.real, value.imag, white, x)


@called
def _place(where: Any, elements: Any, T: Any, out: Any) -> None:
    """out (s, e) ← (T U)ᵀ of Tᵀ (q, e)."""
    clear(out)
    for at in range(len(where)):
        u = elements[at]
        add_row(out, where[at, 0], u.real, u.imag, T, where[at, 1])


@called
def _power(own: Any, cross: Any, s: int) -> Any:
    """The other source that one goes with, their cross spectrum, and whether there is any power."""
    pairs = len(cross)
    if s >= 2 * pairs:
        return s, 0.0, own[s] != 0.0
    other = s + pairs if s < pairs else s - pairs
    joint = cross[min(s, other)]
    return other, joint, own[s] != 0.0 or joint != 0.0


@called
def _drive_row(own: Any, cross: Any, placed: Any, s: int, out: Any, row: int) -> None:
    """A row of `out` ← row s of S_s (T U)ᴴ of (T U)ᵀ (s, e)."""
    other, joint, _ = _power(own, cross, s)
    conjugate_row(out, row, placed, s, own[s])
    if joint != 0.0:
        half = imaginary(out)
        for c in range(half):
            out[row, c] += joint * placed[other, c]
            out[row, half + c] -= joint * placed[other, half + c]


@called
def _half_driven(own: Any, cross: Any, placed: Any, left: Any, right: Any) -> int:
    """(T U) S_s (T U)ᴴ as leftᵀ right, of the sources that have power; how many rows they have."""
    used = 0
    for s in range(len(own)):
        if _power(own, cross, s)[2]:
            copy_row(left, used, placed, s)
            _drive_row(own, cross, placed, s, right, used)
            used += 1
    return used


@called
def _pack(matrix: Any, out: Any, row: int) -> None:
    """Row of `out` ← the e² numbers of a Hermitian matrix (e, e), so that products of two such rows are traces of the
    products of their matrices; what is left of the diagonal is not read."""
    e, half, place, root2 = len(matrix), imaginary(matrix), 0, math.sqrt(2.0)
    for i in range(e):
        copy_part(out, row, place, matrix, i, i, e - i, root2)
        out[row, place] = matrix[i, i]
        place += e - i
        copy_part(out, row, place, matrix, i, half + i + 1, e - i - 1, root2)
        place += e - i - 1


@called
def _both_ways(left: Any, right: Any, used: int, out: Any) -> None:
    """out ← leftᵀ right of so many rows + its transposed conjugate; the rows behind them are lost."""
    for k in range(used):
        conjugate_row(left, used + k, right, k, 1.0)
        conjugate_row(right, used + k, left, k, 1.0)
    products(left, right, 2 * used, out)


@called
def _spectrum(
    mechanics: Any, m_at: Any, readings: Any, r_at: Any, omega: Any, entries: Any, entry_of: Any, left_out: Any,
    late: Any, where: Any, placement: Any, own: Any, cross: Any, noise: Any, more: Any, b: int, room: Any,
) -> int:  # fmt: skip
    """S of one place, on the diagonal and to its right; the width of the band of D."""
    e, r, half = len(entries), readings.shape[3], imaginary(room.S)
    apart = _couple(mechanics, m_at, omega, room.D)
    factor(apart, room.order, room.D, room.turned)
    for x in range(e):
        angle = -omega[entries[x] // r] * late[x]
        room.phase[x] = complex(math.cos(angle), math.sin(angle))
    _read(readings, r_at, omega, entry_of, left_out, room.phase, room.one, room.T)
    solve_turned(apart, room.order, room.turned, room.T)
    _place(where, placement, room.T, room.placed)
    products(room.left, room.right, _half_driven(own, cross, room.placed, room.left, room.right), room.S)
    for x in range(e):
        if len(more):
            for y in range(x, e):
                room.S[x, y] += more[b, x, y].real
                room.S[x, half + y] += more[b, x, y].imag
        room.S[x, x] += 1.0 if left_out[x] else noise[x]
    return apart


@called
def _half_moved(
    d_mechanics: Any, dm_at: Any, d_readings: Any, dr_at: Any, which: int, omega: Any, entry_of: Any, left_out: Any,
    room: Any,
) -> int:  # fmt: skip
    """(dR − T dD) Q of one mechanical unknown as leftᵀ right, on the columns of dD or, where there are none, on the
    rows of dR; how many rows they have."""
    count, n, size, used = len(omega), d_mechanics.shape[4], len(room.order), 0
    for k in range(len(room.slot)):
        room.slot[k] = -1
    for at in range(len(dm_at)):
        if dm_at[at, 0] != which:
            continue
        h, i, j = dm_at[at, 1], dm_at[at, 2], dm_at[at, 3]
        shift = h - MAX_HARMONIC
        for k in range(max(0, -shift), min(count, count - shift)):
            to, value = k * n + j, element_at(d_mechanics[:, which], h, i, j, omega[k])
            if room.slot[to] < 0:
                room.slot[to] = used
                clear_row(room.left, used)
                copy_row(room.right, used, room.Q, to)
                used += 1
            add_row(room.left, room.slot[to], -value.real, -value.imag, room.white, (k + shift) * n + i)
    for at in range(len(dr_at)):
        if dr_at[at, 0] != which:
            continue
        h, i, j = dr_at[at, 1], dr_at[at, 2], dr_at[at, 3]
        shift = h - MAX_HARMONIC
        for k in range(max(0, -shift), min(count, count - shift)):
            x, to = entry_of[k + shift, i], k * n + j
            if x < 0 or left_out[x]:
                continue
            value = element_at(d_readings[:, which], h, i, j, omega[k]) * room.phase[x]
            if room.slot[to] >= 0:
                add_row(room.left, room.slot[to], value.real, value.imag, room.turned_whitener, x)
                continue
            if room.slot[size + x] < 0:
                room.slot[size + x] = used
                copy_row(room.left, used, room.turned_whitener, x)
                clear_row(room.right, used)
                used += 1
            add_row(room.right, room.slot[size + x], value.real, value.imag, room.Q, to)
    return used


def _spectra(
    mechanics: Any, m_at: Any, readings: Any, r_at: Any, omega: Any, entries: Any, entry_of: Any, left_out: Any,
    late: Any, where: Any, placement: Any, own: Any, cross: Any, noise: Any, more: Any, room: Any, S: Any,
) -> None:  # fmt: skip
    half = imaginary(room.S)
    for b in range(len(omega)):
        _spectrum(
            mechanics, m_at, readings, r_at, omega[b], entries, entry_of, left_out[b], late, where, placement, own[b],
            cross[b], noise[b], more, b, room,
        )  # fmt: skip
        for x in range(len(entries)):
            for y in range(x, len(entries)):
                S[b, x, y] = complex(room.S[x, y], room.S[x, half + y])
                S[b, y, x] = S[b, x, y].conjugate()


def _add_up(
    mechanics: Any, m_at: Any, readings: Any, r_at: Any, omega: Any, entries: Any, entry_of: Any, left_out: Any,
    late: Any, where: Any, placement: Any, own: Any, cross: Any, noise: Any, more: Any, d_mechanics: Any, dm_at: Any,
    d_readings: Any, dr_at: Any, later: Any, d_own: Any, d_cross: Any, d_noise: Any, data: Any, counts: Any,
    room: Any, gradient: Any, information: Any,
) -> float:  # fmt: skip
    e, r, half = len(entries), readings.shape[3], imaginary(room.S)
    sources, columns = own.shape[1], data.shape[2]
    moved, clocks, loads, levels = d_mechanics.shape[1], len(later), len(d_own), len(d_noise)
    value = 0.0
    for b in range(len(omega)):
        apart = _spectrum(
            mechanics, m_at, readings, r_at, omega[b], entries, entry_of, left_out[b], late, where, placement, own[b],
            cross[b], noise[b], more, b, room,
        )  # fmt: skip
        for x in range(e):
            copy_row(room.whitener, x, room.one, x)
            for g in range(columns):
                room.data[x, g] = data[b, x, g].real
                room.data[x, imaginary(room.data) + g] = data[b, x, g].imag
        value += counts[b] * whiten(room.S, room.weights, room.whitener, room.data)
        if math.isnan(value):
            return math.nan
        turn(room.whitener, room.turned_whitener)
        turn(room.data, room.turned_data)
        for g in range(columns):
            copy_row(room.left, g, room.turned_data, g)
            conjugate_row(room.right, g, room.turned_data, g, -1.0 / counts[b])
        products(room.left, room.right, columns, room.half)
        for x in range(e):
            value -= counts[b] * room.half[x, x]
            room.half[x, x] += 1.0
        _pack(room.half, room.flat, len(gradient))
        _read(readings, r_at, omega[b], entry_of, left_out[b], room.phase, room.turned_whitener, room.white)
        solve_turned(apart, room.order, room.turned, room.white)
        _place(where, placement, room.white, room.placed_white)
        for s in range(sources):
            _drive_row(own[b], cross[b], room.placed_white, s, room.driven, s)
        clear(room.Q)
        for at in range(len(where)):
            u = placement[at]
            add_row(room.Q, where[at, 1], u.real, u.imag, room.driven, where[at, 0])
        solve(apart, room.order, room.D, room.Q)
        for a in range(moved):
            used = _half_moved(d_mechanics, dm_at, d_readings, dr_at, a, omega[b], entry_of, left_out[b], room)
            _both_ways(room.left, room.right, used, room.half)
            _pack(room.half, room.flat, a)
        if clocks:  # S without its noise, times L⁻ᴴ
            clear(room.S)
            for x in range(e):
                for s in range(sources):
                    add_row(room.S, x, room.placed[s, x], room.placed[s, half + x], room.driven, s)
        for a in range(clocks):
            used = 0
            for x in range(e):
                if later[a, x] != 0.0 and not left_out[b, x]:
                    copy_row(room.left, used, room.turned_whitener, x)
                    clear_row(room.right, used)
                    angle = -omega[b, entries[x] // r] * later[a, x]
                    add_row(room.right, used, 0.0, angle, room.S, x)
                    used += 1
            _both_ways(room.left, room.right, used, room.half)
            _pack(room.half, room.flat, moved + a)
        for a in range(loads):
            used = _half_driven(d_own[a, b], d_cross[a, b], room.placed_white, room.left, room.right)
            products(room.left, room.right, used, room.half)
            _pack(room.half, room.flat, moved + clocks + a)
        for a in range(levels):
            used = 0
            for x in range(e):
                if d_noise[a, b, x] != 0.0 and not left_out[b, x]:
                    copy_row(room.left, used, room.turned_whitener, x)
                    conjugate_row(room.right, used, room.turned_whitener, x, d_noise[a, b, x])
                    used += 1
            products(room.left, room.right, used, room.half)
            _pack(room.half, room.flat, moved + clocks + loads + a)
        gram(room.flat, counts[b], room.found)
    unknowns = len(gradient)
    for a in range(unknowns):
        gradient[a] += room.found[unknowns, a]
        for c in range(a + 1):
            information[a, c] += room.found[a, c]
            information[c, a] = information[a, c]
    return value

"""Lifted spectra of many entries, and their likelihood, one place after the other.

The equations are those of `windsysid.spectral.lifted_likelihood`. Where a spectrum has many entries, the products of
matrices cost most: here those of one place stay in the processor's cache, and a parameter's derivative
(dR − T dD) Q, of which few columns or rows are not zero, is multiplied out on those only. Sources act on few degrees of
freedom: what they do is added up from the elements of U that are not zero.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid.kernels.jit import called, compiled
from windsysid.spectral.lifted import Complex
from windsysid.spectral.lifted_kernel import _at
from windsysid.spectral.lifted_mechanics import HIGHEST

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


_C1, _C2, _C3, _C4, _C5 = (types.Array(types.complex128, rank, "C") for rank in (1, 2, 3, 4, 5))
_F1, _F2, _F3 = (types.Array(types.float64, rank, "C") for rank in (1, 2, 3))
_I1, _I2 = types.Array(types.int64, 1, "C"), types.Array(types.int64, 2, "C")
_MODEL = (_C5, _I2, _C5, _I2, _F2, _I1, _I2, types.boolean[:, ::1], _F1, _I2, _C1, _F2, _F2, _F2, _C3)


@lru_cache(maxsize=1)
def spectra_dense() -> Any:
    """The kernel that fills S (B, e, e)."""
    return compiled(_spectra, types.void(*_MODEL, _C3))


@lru_cache(maxsize=1)
def add_up_dense() -> Any:
    """The kernel that returns J of data (B, e, g), and adds slope and information to g (n,) and F (n, n)."""
    slopes = (_C5, _I2, _C5, _I2, _F2, _F3, _F3, _F3)
    return compiled(_add_up, types.float64(*_MODEL, *slopes, _C3, _F1, _F1, _F2))


@called
def _couple(matrices: Any, elements: Any, omega: Any, out: Any) -> None:
    """The transposed of −ω² X_a + iω X_v + X_q of one set of matrices between all harmonics (q, q)."""
    count, n = len(omega), matrices.shape[4]
    out[:] = 0.0
    for at in range(len(elements)):
        h, i, j = elements[at, 1], elements[at, 2], elements[at, 3]
        shift = h - HIGHEST
        for k in range(max(0, -shift), min(count, count - shift)):
            out[k * n + j, (k + shift) * n + i] = _at(matrices[:, 0], h, i, j, omega[k])


@called
def _read(
    matrices: Any, elements: Any, first: int, end: int, omega: Any, entry_of: Any, left_out: Any, phase: Any, turn: Any,
    inverse: Any, out: Any,
) -> None:  # fmt: skip
    """Adds (R phase) D⁻¹ to `out` (e, q), R being the elements first … end of a set of matrices."""
    count, n, width = len(omega), matrices.shape[4], out.shape[1]
    for at in range(first, end):
        a, h, i, j = elements[at, 0], elements[at, 1], elements[at, 2], elements[at, 3]
        shift = h - HIGHEST
        for k in range(max(0, -shift), min(count, count - shift)):
            x = entry_of[k + shift, i]
            if x < 0 or left_out[x]:
                continue
            value = _at(matrices[:, a], h, i, j, omega[k])
            if turn:
                value *= phase[x]
            row = k * n + j
            for c in range(width):
                out[x, c] += value * inverse[row, c]


@called
def _place(where: Any, elements: Any, left: Any, out: Any) -> None:
    """out (s, e) ← (left U)ᵀ of left ᵀ (q, e)."""
    out[:] = 0.0
    for at in range(len(where)):
        s, row, u = where[at, 0], where[at, 1], elements[at]
        for x in range(out.shape[1]):
            out[s, x] += u * left[row, x]


@called
def _drive(where: Any, elements: Any, placed: Any, own: Any, cross: Any, driven: Any, out: Any) -> None:
    """out (q, e) ← U S_s (placed)*, placed (s, e) being (T U)ᵀ."""
    pairs, e = len(cross), placed.shape[1]
    for s in range(len(own)):
        for x in range(e):
            driven[s, x] = own[s] * placed[s, x].conjugate()
    for s in range(pairs):
        for x in range(e):
            driven[s, x] += cross[s] * placed[s + pairs, x].conjugate()
            driven[s + pairs, x] += cross[s] * placed[s, x].conjugate()
    out[:] = 0.0
    for at in range(len(where)):
        s, row, u = where[at, 0], where[at, 1], elements[at]
        for x in range(e):
            out[row, x] += u * driven[s, x]


@called
def _pack(half: Any, first: int, out: Any) -> None:
    """The e² numbers of half (e, first … first + e) and its transposed conjugate, so that products of two such rows
    are traces of the products of their matrices."""
    e, place, root2 = half.shape[0], 0, math.sqrt(2.0)
    for i in range(e):
        for j in range(i):
            a, b = half[i, first + j], half[j, first + i]
            out[place] = root2 * (a.real + b.real)
            out[place + 1] = root2 * (a.imag - b.imag)
            place += 2
        out[place] = 2.0 * half[i, first + i].real
        place += 1


def _spectra(
    mechanics: Any, m_at: Any, readings: Any, r_at: Any, omega: Any, entries: Any, entry_of: Any, left_out: Any,
    late: Any, where: Any, placement: Any, own: Any, cross: Any, noise: Any, more: Any, S: Any,
) -> None:  # fmt: skip
    bins, count = omega.shape
    n, r, e = mechanics.shape[4], readings.shape[3], len(entries)
    size, sources, turn, added = count * n, own.shape[1], late.any(), len(more) > 0
    phase = np.empty(e, dtype=np.complex128)
    D, T = np.empty((size, size), dtype=np.complex128), np.empty((e, size), dtype=np.complex128)
    placed, driven = np.empty((sources, e), dtype=np.complex128), np.empty((sources, e), dtype=np.complex128)
    W = np.empty((size, e), dtype=np.complex128)
    for b in range(bins):
        _couple(mechanics, m_at, omega[b], D)
        if turn:
            for x in range(e):
                phase[x] = np.exp(complex(0.0, -omega[b, entries[x] // r] * late[x]))
        T[:] = 0.0
        _read(readings, r_at, 0, len(r_at), omega[b], entry_of, left_out[b], phase, turn, np.linalg.inv(D).T, T)
        _place(where, placement, np.ascontiguousarray(T.T), placed)
        _drive(where, placement, placed, own[b], cross[b], driven, W)
        np.dot(T, W, S[b])
        if added:
            S[b] += more[b]
        for x in range(e):
            S[b, x, x] += 1.0 if left_out[b, x] else noise[b, x]


def _add_up(
    mechanics: Any, m_at: Any, readings: Any, r_at: Any, omega: Any, entries: Any, entry_of: Any, left_out: Any,
    late: Any, where: Any, placement: Any, own: Any, cross: Any, noise: Any, more: Any, d_mechanics: Any, dm_at: Any,
    d_readings: Any, dr_at: Any, later: Any, d_own: Any, d_cross: Any, d_noise: Any, data: Any, counts: Any,
    gradient: Any, information: Any,
) -> float:  # fmt: skip
    bins, count = omega.shape
    n, r, e = mechanics.shape[4], readings.shape[3], len(entries)
    size, sources, turn, added = count * n, own.shape[1], late.any(), len(more) > 0
    moved, clocks, loads, levels = d_mechanics.shape[1], len(later), len(d_own), len(d_noise)
    phase = np.empty(e, dtype=np.complex128)
    D, T = np.empty((size, size), dtype=np.complex128), np.empty((e, size), dtype=np.complex128)
    placed, driven = np.empty((sources, e), dtype=np.complex128), np.empty((sources, e), dtype=np.complex128)
    W, W_all = np.empty((size, e), dtype=np.complex128), np.empty((size, loads * e), dtype=np.complex128)
    S, half = np.empty((e, e), dtype=np.complex128), np.empty((e, e), dtype=np.complex128)
    left, right = np.empty((size + e, e), dtype=np.complex128), np.empty((size + e, e), dtype=np.complex128)
    slot = np.empty(size + e, dtype=np.int64)
    flat, shown = np.empty((len(gradient), e * e)), np.empty(e * e)
    value = 0.0
    for b in range(bins):
        _couple(mechanics, m_at, omega[b], D)
        for x in range(e):
            phase[x] = np.exp(complex(0.0, -omega[b, entries[x] // r] * late[x]))
        inverse = np.linalg.inv(D).T
        T[:] = 0.0
        _read(readings, r_at, 0, len(r_at), omega[b], entry_of, left_out[b], phase, turn, inverse, T)
        _place(where, placement, np.ascontiguousarray(T.T), placed)
        _drive(where, placement, placed, own[b], cross[b], driven, W)
        np.dot(T, W, S)
        signal = S.copy()
        if added:
            S += more[b]
        for x in range(e):
            S[x, x] += 1.0 if left_out[b, x] else noise[b, x]
        for x in range(e):
            if not S[x, x].real > 0.0:
                return math.nan
        L_inv = np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(S)))
        L_h = np.conj(L_inv).T
        y = np.dot(L_inv, data[b])
        half[:] = -0.5 * np.dot(y, np.conj(y).T)
        for x in range(e):
            value -= 2.0 * counts[b] * math.log(L_inv[x, x].real)
            value -= 2.0 * half[x, x].real
            half[x, x] += 0.5 * counts[b]
        _pack(half, 0, shown)
        T_w, L_t = np.dot(T.T, L_inv.T), np.ascontiguousarray(L_inv.T)  # (q, e) and (e, e): transposed
        Q = np.dot(np.dot(inverse, W), L_h)
        m_first = r_first = 0
        for a in range(moved):  # (dR − T dD) Q, on the columns of dD or, where there are none, on the rows of dR
            m_end, r_end, used = m_first, r_first, 0
            while m_end < len(dm_at) and dm_at[m_end, 0] == a:
                m_end += 1
            while r_end < len(dr_at) and dr_at[r_end, 0] == a:
                r_end += 1
            slot[:] = -1
            for at in range(m_first, m_end):
                h, i, j = dm_at[at, 1], dm_at[at, 2], dm_at[at, 3]
                shift = h - HIGHEST
                for k in range(max(0, -shift), min(count, count - shift)):
                    to, value_at = k * n + j, _at(d_mechanics[:, a], h, i, j, omega[b, k])
                    if slot[to] < 0:
                        slot[to] = used
                        left[used] = 0.0
                        right[used] = Q[to]
                        used += 1
                    place, row = slot[to], (k + shift) * n + i
                    for x in range(e):
                        left[place, x] -= value_at * T_w[row, x]
            for at in range(r_first, r_end):
                h, i, j = dr_at[at, 1], dr_at[at, 2], dr_at[at, 3]
                shift = h - HIGHEST
                for k in range(max(0, -shift), min(count, count - shift)):
                    x = entry_of[k + shift, i]
                    if x < 0 or left_out[b, x]:
                        continue
                    value_at = _at(d_readings[:, a], h, i, j, omega[b, k]) * phase[x]
                    to = k * n + j
                    if slot[to] >= 0:
                        for c in range(e):
                            left[slot[to], c] += value_at * L_t[x, c]
                        continue
                    if slot[size + x] < 0:
                        slot[size + x] = used
                        left[used] = L_t[x]
                        right[used] = 0.0
                        used += 1
                    for c in range(e):
                        right[slot[size + x], c] += value_at * Q[to, c]
            np.dot(left[:used].T, right[:used], half)
            _pack(half, 0, flat[a])
            m_first, r_first = m_end, r_end
        if clocks:
            seen = np.dot(signal, L_h)
        for a in range(clocks):
            used = 0
            for x in range(e):
                if later[a, x] != 0.0 and not left_out[b, x]:
                    left[used] = L_t[x]
                    right[used] = complex(0.0, -omega[b, entries[x] // r] * later[a, x]) * seen[x]
                    used += 1
            np.dot(left[:used].T, right[:used], half)
            _pack(half, 0, flat[moved + a])
        if loads:
            _place(where, placement, T_w, placed)
            for a in range(loads):
                _drive(where, placement, placed, 0.5 * d_own[a, b], 0.5 * d_cross[a, b], driven, W)
                W_all[:, a * e : (a + 1) * e] = W
            pushed = np.dot(T_w.T, W_all)
            for a in range(loads):
                _pack(pushed, a * e, flat[moved + clocks + a])
        for a in range(levels):
            for x in range(e):
                right[x] = (0.0 if left_out[b, x] else 0.5 * d_noise[a, b, x]) * L_h[x]
            np.dot(L_inv, right[:e], half)
            _pack(half, 0, flat[moved + clocks + loads + a])
        gradient += np.dot(flat, shown)
        information += counts[b] * np.dot(flat, flat.T)
    return value

"""Lifted spectra of few entries, and their likelihood, in compiled loops.

The equations are those of `windsysid.spectral.rotor.likelihood`. Where a spectrum has few entries, calls of a library
cost more than the arithmetic: here one loop runs over all places. D = Pᵀ L U is factored once, for T = R D⁻¹ and for
Q = D⁻¹ U S_s Uᴴ Tᴴ, and of a parameter's derivatives only the elements that are not zero are multiplied out.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import types

from windsysid.kernels.jit import called, compiled, inlined
from windsysid.spectral.rotor.harmonic_transfer import MAX_HARMONIC

__all__ = ["MAX_LOOP_ENTRIES", "add_up", "element_at", "spectra"]

MAX_LOOP_ENTRIES = 12
"""Numerical: entries of a spectrum up to which these loops are faster than products of matrices."""


@lru_cache(maxsize=1)
def spectra() -> Any:
    """The kernel that fills S (B, e, e) and its derivatives (n, B, e, e), of parameters, loads and noise in turn."""
    c2, c3, c4, c5 = (types.Array(types.complex128, rank, "C") for rank in (2, 3, 4, 5))
    f2, f3 = (types.Array(types.float64, rank, "C") for rank in (2, 3))
    signature = types.void(
        c4, c4, c5, c5, f2, types.int64[::1], types.boolean[:, ::1], c2, f2, f2, f3, f3, f2, f3, c3, c4
    )
    return compiled(_spectra, signature)


@lru_cache(maxsize=1)
def add_up() -> Any:
    """The kernel that returns J of S (B, e, e) and data (B, e, g), and adds slope and information to g (n,) and F
    (n, n)."""
    c3, c4, f1 = types.Array(types.complex128, 3, "C"), types.Array(types.complex128, 4, "C"), types.float64[::1]
    return compiled(_add_up, types.float64(c3, c4, c3, f1, f1, types.float64[:, ::1]))


@called
def _factor(D: Any, order: Any) -> None:
    """D ← L and U of P D, with partial pivoting; `order` the row that each step exchanges."""
    size = D.shape[0]
    for i in range(size):
        best, largest = i, -1.0
        for j in range(i, size):
            here = D[j, i].real * D[j, i].real + D[j, i].imag * D[j, i].imag
            if here > largest:
                best, largest = j, here
        order[i] = best
        if best != i:
            for k in range(size):
                D[i, k], D[best, k] = D[best, k], D[i, k]
        scale = 1.0 / D[i, i]
        for j in range(i + 1, size):
            if D[j, i] != 0.0:
                share = D[j, i] * scale
                D[j, i] = share
                for k in range(i + 1, size):
                    D[j, k] -= share * D[i, k]


@called
def _solve_left(D: Any, order: Any, rows: Any) -> None:
    """Rows (e, q) ← rows D⁻¹."""
    size = D.shape[0]
    for row in range(rows.shape[0]):
        for i in range(size):
            if rows[row, i] != 0.0:
                rows[row, i] /= D[i, i]
                for k in range(i + 1, size):
                    rows[row, k] -= rows[row, i] * D[i, k]
        for i in range(size - 1, -1, -1):
            for k in range(i):
                rows[row, k] -= rows[row, i] * D[i, k]
        for i in range(size - 1, -1, -1):
            rows[row, i], rows[row, order[i]] = rows[row, order[i]], rows[row, i]


@called
def _solve_right(D: Any, order: Any, columns: Any) -> None:
    """Columns (q, e) ← D⁻¹ columns."""
    size, width = columns.shape
    for i in range(size):
        if order[i] != i:
            for c in range(width):
                columns[i, c], columns[order[i], c] = columns[order[i], c], columns[i, c]
    for i in range(size):
        for k in range(i):
            if D[i, k] != 0.0:
                for c in range(width):
                    columns[i, c] -= D[i, k] * columns[k, c]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            if D[i, k] != 0.0:
                for c in range(width):
                    columns[i, c] -= D[i, k] * columns[k, c]
        for c in range(width):
            columns[i, c] /= D[i, i]


@inlined
def element_at(matrices: Any, h: int, i: int, j: int, omega: float) -> Any:
    """−ω² X_a + iω X_v + X_q of an element."""
    s = complex(0.0, omega)
    return (s * matrices[0, h, i, j] + matrices[1, h, i, j]) * s + matrices[2, h, i, j]


@inlined
def _nothing(matrices: Any, h: int, i: int, j: int) -> bool:
    """Test whether an element is zero at every frequency."""
    return bool(matrices[0, h, i, j] == 0.0 and matrices[1, h, i, j] == 0.0 and matrices[2, h, i, j] == 0.0)


@called
def _driven(T_s: Any, own: Any, cross: Any, out: Any) -> None:
    """T_s (e, s) times the covariance of the sources."""
    pairs = cross.shape[0]
    for x in range(T_s.shape[0]):
        for s in range(T_s.shape[1]):
            out[x, s] = T_s[x, s] * own[s]
        for s in range(pairs):
            out[x, s] += T_s[x, s + pairs] * cross[s]
            out[x, s + pairs] += T_s[x, s] * cross[s]


@called
def _outer(left: Any, right: Any, out: Any) -> None:
    """left (e, s) rightᴴ, Hermitian."""
    for x in range(left.shape[0]):
        for y in range(x + 1):
            total = 0.0j
            for s in range(left.shape[1]):
                total += left[x, s] * right[y, s].conjugate()
            out[x, y] = total
            out[y, x] = total.conjugate()


@called
def _halves(
    d_mechanics: Any, d_readings: Any, omega: Any, entries: Any, left_out: Any, T: Any, Q: Any, moved: Any, half: Any
) -> None:
    """(dR − T dD) Q of one parameter (e, e); `moved` (e, q) holds dR − T dD."""
    count, n, r, e = omega.shape[0], d_mechanics.shape[2], d_readings.shape[2], len(entries)
    moved[:], half[:] = 0.0, 0.0
    for h in range(d_mechanics.shape[1]):
        shift = h - MAX_HARMONIC
        if abs(shift) >= count:
            continue
        for i in range(n):
            for j in range(n):
                if _nothing(d_mechanics, h, i, j):
                    continue
                for k in range(max(0, -shift), min(count, count - shift)):
                    value = element_at(d_mechanics, h, i, j, omega[k])
                    for x in range(e):
                        moved[x, k * n + j] -= T[x, (k + shift) * n + i] * value
        for x in range(e):
            k, i = entries[x] // r - shift, entries[x] % r
            if left_out[x] or k < 0 or k >= count:
                continue
            for j in range(n):
                if not _nothing(d_readings, h, i, j):
                    moved[x, k * n + j] += element_at(d_readings, h, i, j, omega[k])
    for x in range(e):
        for c in range(count * n):
            if moved[x, c] != 0.0:
                for y in range(e):
                    half[x, y] += moved[x, c] * Q[c, y]


def _spectra(
    mechanics: Any, readings: Any, d_mechanics: Any, d_readings: Any, omega: Any, entries: Any, left_out: Any,
    placement: Any, own: Any, cross: Any, d_own: Any, d_cross: Any, noise: Any, d_noise: Any, S: Any, A: Any,
) -> None:  # fmt: skip
    bins, count = omega.shape
    n, r, e = mechanics.shape[2], readings.shape[2], len(entries)
    size, sources = count * n, placement.shape[1]
    moved, loads, levels = d_mechanics.shape[1], d_own.shape[0], d_noise.shape[0]
    D, order = np.empty((size, size), dtype=np.complex128), np.empty(size, dtype=np.int64)
    T, Q = np.empty((e, size), dtype=np.complex128), np.empty((size, e), dtype=np.complex128)
    T_s, driven = np.empty((e, sources), dtype=np.complex128), np.empty((e, sources), dtype=np.complex128)
    turned, half = np.empty((e, size), dtype=np.complex128), np.empty((e, e), dtype=np.complex128)
    for b in range(bins):
        D[:], T[:], T_s[:], Q[:] = 0.0, 0.0, 0.0, 0.0
        for h in range(mechanics.shape[1]):
            shift = h - MAX_HARMONIC
            if abs(shift) >= count:
                continue
            for i in range(n):
                for j in range(n):
                    if _nothing(mechanics, h, i, j):
                        continue
                    for k in range(max(0, -shift), min(count, count - shift)):
                        D[(k + shift) * n + i, k * n + j] = element_at(mechanics, h, i, j, omega[b, k])
            for x in range(e):
                k = entries[x] // r - shift
                if not left_out[b, x] and 0 <= k < count:
                    for j in range(n):
                        if _nothing(readings, h, entries[x] % r, j):
                            continue
                        T[x, k * n + j] = element_at(readings, h, entries[x] % r, j, omega[b, k])
        _factor(D, order)
        _solve_left(D, order, T)
        for i in range(size):
            for s in range(sources):
                if placement[i, s] != 0.0:
                    for x in range(e):
                        T_s[x, s] += T[x, i] * placement[i, s]
        _driven(T_s, own[b], cross[b], driven)
        _outer(driven, T_s, S[b])
        for x in range(e):
            S[b, x, x] += 1.0 if left_out[b, x] else noise[b, x]
        if not len(A):
            continue
        for i in range(size):
            for s in range(sources):
                if placement[i, s] != 0.0:
                    for x in range(e):
                        Q[i, x] += placement[i, s] * driven[x, s].conjugate()
        _solve_right(D, order, Q)
        for a in range(moved):
            _halves(d_mechanics[:, a], d_readings[:, a], omega[b], entries, left_out[b], T, Q, turned, half)
            for x in range(e):
                for y in range(e):
                    A[a, b, x, y] = half[x, y] + half[y, x].conjugate()
        for a in range(loads):
            _driven(T_s, d_own[a, b], d_cross[a, b], driven)
            _outer(driven, T_s, A[moved + a, b])
        for a in range(levels):
            A[moved + loads + a, b] = 0.0
            for x in range(e):
                if not left_out[b, x]:
                    A[moved + loads + a, b, x, x] = d_noise[a, b, x]


def _add_up(S: Any, A: Any, data: Any, counts: Any, gradient: Any, information: Any) -> float:
    bins, e, columns = data.shape
    unknowns, value, root2 = len(A), 0.0, math.sqrt(2.0)
    L = np.empty((e, e), dtype=np.complex128)
    y, shown = np.empty(e, dtype=np.complex128), np.empty((e, e), dtype=np.complex128)
    white, flat = np.empty((e, e), dtype=np.complex128), np.empty((unknowns, e * e))
    for b in range(bins):
        for i in range(e):  # Cholesky: S = L Lᴴ
            for j in range(i + 1):
                total = S[b, i, j]
                for k in range(j):
                    total -= L[i, k] * L[j, k].conjugate()
                if j < i:
                    L[i, j] = total / L[j, j].real
                elif total.real > 0.0:
                    L[i, i] = math.sqrt(total.real)
                else:
                    return math.nan
            value += 2.0 * counts[b] * math.log(L[i, i].real)
        shown[:] = 0.0
        for c in range(columns):
            for i in range(e):
                total = data[b, i, c]
                for k in range(i):
                    total -= L[i, k] * y[k]
                y[i] = total / L[i, i].real
                value += y[i].real * y[i].real + y[i].imag * y[i].imag
                for j in range(i + 1):
                    shown[i, j] += y[i] * y[j].conjugate()
        for a in range(unknowns):
            for j in range(e):  # L⁻¹ A, then times L⁻ᴴ
                for i in range(e):
                    total = A[a, b, i, j]
                    for k in range(i):
                        total -= L[i, k] * white[k, j]
                    white[i, j] = total / L[i, i].real
            place = 0
            for i in range(e):
                for j in range(i + 1):
                    total = white[i, j]
                    for k in range(j):
                        total -= white[i, k] * L[j, k].conjugate()
                    white[i, j] = total / L[j, j].real
                    if j < i:
                        gradient[a] -= 2.0 * (shown[i, j].real * white[i, j].real + shown[i, j].imag * white[i, j].imag)
                        flat[a, place] = root2 * white[i, j].real
                        flat[a, place + 1] = root2 * white[i, j].imag
                        place += 2
                    else:
                        gradient[a] += (counts[b] - shown[i, i].real) * white[i, i].real
                        flat[a, place] = white[i, i].real
                        place += 1
            for other in range(a + 1):
                total_real = 0.0
                for i in range(e * e):
                    total_real += flat[a, i] * flat[other, i]
                information[a, other] += counts[b] * total_real
    for a in range(unknowns):
        for other in range(a):
            information[other, a] = information[a, other]
    return value

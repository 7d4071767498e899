"""Solves with a complex matrix that is a band about its diagonal, and with one that is Hermitian and positive."""

import math
from typing import Any

from windsysid.kernels.complex_rows import exchange, imaginary, scale_row, take_rows
from windsysid.kernels.jit import called
from windsysid.kernels.simd import LANES

__all__ = ["factor", "solve", "solve_turned", "whiten"]


@called
def factor(apart: int, order: Any, D: Any, turned: Any) -> None:
    """D ← its factors, with partial pivoting: U to the right of the diagonal, 1/U on it, and what each step takes from
    the rows below to its left. `turned` is their transposed.

    Source: Golub and Van Loan, Matrix Computations, 4th ed., section 4.3.5.
    """
    size = len(order)
    for i in range(size):
        end, last = min(size, i + apart + 1), min(size, i + 2 * apart + 1)
        best, largest = i, -1.0
        for j in range(i, end):
            here = D[j, i].real * D[j, i].real + D[j, i].imag * D[j, i].imag
            if here > largest:
                best, largest = j, here
        order[i] = best
        if best != i:
            for k in range(i, last):
                D[i, k], D[best, k] = D[best, k], D[i, k]
        scale = D[i, i].conjugate() * (1.0 / largest)
        D[i, i] = scale
        for j in range(i + 1, end):
            if D[j, i] == 0.0:
                continue
            share = D[j, i] * scale
            D[j, i] = share
            for k in range(i + 1, last):
                D[j, k] -= share * D[i, k]
    for i in range(size):
        for j in range(max(0, i - apart), min(size, i + 2 * apart + 1)):
            turned[j, i] = D[i, j]


@called
def solve(apart: int, order: Any, D: Any, rows: Any) -> None:
    """Rows (q, e) ← D⁻¹ rows."""
    size, width = len(order), imaginary(rows) // LANES
    for i in range(size):
        exchange(rows, i, order[i])
        for j in range(i + 1, min(size, i + apart + 1)):
            if D[j, i] != 0.0:
                take_rows(rows, j, D, i, i + 1, 0, width)
    for i in range(size - 1, -1, -1):
        take_rows(rows, i, D, i + 1, min(size, i + 2 * apart + 1), 0, width)
        scale_row(rows, i, D[i, i])


@called
def solve_turned(apart: int, order: Any, turned: Any, rows: Any) -> None:
    """Rows (q, e) ← D⁻ᵀ rows."""
    size, width = len(order), imaginary(rows) // LANES
    for i in range(size):
        take_rows(rows, i, turned, max(0, i - 2 * apart), i, 0, width)
        scale_row(rows, i, turned[i, i])
    for i in range(size - 1, -1, -1):
        take_rows(rows, i, turned, i + 1, min(size, i + apart + 1), 0, width)
        exchange(rows, i, order[i])


@called
def whiten(S: Any, weights: Any, whitener: Any, data: Any) -> float:
    """`whitener` ← L⁻¹ and `data` ← L⁻¹ data of S = L Lᴴ, of which the half on the diagonal and to its right is read
    and lost; log |S|, or NaN where S is not positive. `whitener` is 1 before, `weights` (e, e) are room."""
    e, half, logarithm = len(S), imaginary(S), 0.0
    width, columns = half // LANES, imaginary(data) // LANES
    for i in range(e):
        for k in range(i):
            weights[i, k] = complex(S[k, i], -S[k, half + i]) / S[k, k]
        take_rows(S, i, weights, 0, i, i // LANES, width)
        take_rows(whitener, i, weights, 0, i, 0, i // LANES + 1)
        take_rows(data, i, weights, 0, i, 0, columns)
        if not S[i, i] > 0.0:
            return math.nan
        logarithm += math.log(S[i, i])
    for i in range(e):
        size = complex(1.0 / math.sqrt(S[i, i]), 0.0)
        scale_row(whitener, i, size)
        scale_row(data, i, size)
    return logarithm

"""Matrices whose rows are whole vectors: the row operations that the filters' steps are made of.

Rows are padded with zeros to a multiple of `LANES` and begin at a whole register, so that a row operation is a few
vector instructions with no remainder: row i of `a` is its vectors i · a.shape[1] // LANES and on. Where a shape is
given as (m, n⁺), n columns are meant and the rest is zero.
"""

from typing import Any

import numpy as np
from llvmlite import binding
from numba.core import config
from numpy.typing import NDArray

from windsysid.kernels.jit import called, pasted
from windsysid.kernels.parts import lanes_sum, load_part, stays_a_function, store_part
from windsysid.kernels.simd import LANES, load, splat, store

__all__ = ["inner", "multiply", "padded", "write"]

_features = binding.get_host_cpu_features().flatten() if config.CPU_FEATURES is None else config.CPU_FEATURES
FOUR_VECTORS_FIT = "+avx512f" in _features
"""True if registers hold the sums of two rows, four vectors each: AVX-512 has 32 of 8 doubles, AVX2 16 of 4."""


def padded(rows: int, columns: int) -> NDArray[np.float64]:
    """A matrix of zeros (rows, columns or up to LANES − 1 more)."""
    width = -(-columns // LANES) * LANES
    room = np.zeros(rows * width + LANES)
    skipped = -(room.ctypes.data // 8) % LANES
    return room[skipped : skipped + rows * width].reshape(rows, width)


@called
def multiply(start: Any, weights: Any, first: int, last: int, begin: int, end: int, matrix: Any, out: Any) -> None:
    """Rows i of `out` = `start` + Σ_j weights[i, j] · row j of `matrix`, for first ≤ i < last and begin ≤ j < end.

    A `start` of one row is that of every row. Two rows and two or four vectors of their sums stay in registers, so that
    each vector of `matrix` is read once for both rows; a last row without a second is computed twice.
    """
    stays_a_function()
    width = out.shape[1] // LANES
    apart = 0 if start.shape[0] == 1 else width
    for i in range(first, last, 2):
        k = min(i + 1, last - 1)
        c = 0
        while FOUR_VECTORS_FIT and c + 4 <= width:
            a, b, at = i * apart + c, k * apart + c, begin * width + c
            a0, a1, a2, a3 = load(start, a), load(start, a + 1), load(start, a + 2), load(start, a + 3)
            b0, b1, b2, b3 = load(start, b), load(start, b + 1), load(start, b + 2), load(start, b + 3)
            for j in range(begin, end):
                u, v = splat(weights[i, j]), splat(weights[k, j])
                m0, m1, m2, m3 = load(matrix, at), load(matrix, at + 1), load(matrix, at + 2), load(matrix, at + 3)
                a0, a1, a2, a3 = a0 + u * m0, a1 + u * m1, a2 + u * m2, a3 + u * m3
                b0, b1, b2, b3 = b0 + v * m0, b1 + v * m1, b2 + v * m2, b3 + v * m3
                at += width
            _store_four(out, i * width + c, a0, a1, a2, a3)
            _store_four(out, k * width + c, b0, b1, b2, b3)
            c += 4
        while c + 2 <= width:
            a, b, at = i * apart + c, k * apart + c, begin * width + c
            a0, a1, b0, b1 = load(start, a), load(start, a + 1), load(start, b), load(start, b + 1)
            for j in range(begin, end):
                u, v = splat(weights[i, j]), splat(weights[k, j])
                m0, m1 = load(matrix, at), load(matrix, at + 1)
                a0, a1, b0, b1 = a0 + u * m0, a1 + u * m1, b0 + v * m0, b1 + v * m1
                at += width
            store(out, i * width + c, a0)
            store(out, i * width + c + 1, a1)
            store(out, k * width + c, b0)
            store(out, k * width + c + 1, b1)
            c += 2
        if c < width:
            a0, b0, at = load(start, i * apart + c), load(start, k * apart + c), begin * width + c
            for j in range(begin, end):
                m0 = load(matrix, at)
                a0, b0 = a0 + splat(weights[i, j]) * m0, b0 + splat(weights[k, j]) * m0
                at += width
            store(out, i * width + c, a0)
            store(out, k * width + c, b0)


@pasted
def _store_four(out: Any, at: int, one: Any, two: Any, three: Any, four: Any) -> None:
    store(out, at, one)
    store(out, at + 1, two)
    store(out, at + 2, three)
    store(out, at + 3, four)


@pasted
def inner(a: Any, i: int, b: Any, j: int) -> float:
    """Row i of `a` times row j of `b`."""
    width = a.shape[1] // LANES
    total = splat(0.0)
    for c in range(width):
        total = total + load(a, i * width + c) * load(b, j * width + c)
    return float(lanes_sum(total))


@pasted
def write(out: Any, at: int, row: Any, first: int, count: int) -> None:
    """Copy `count` elements of `row`, from element `first` on, to those of `out` from element `at` on."""
    for c in range(0, count, LANES):
        store_part(out, at + c, load_part(row, first + c, count - c), count - c)

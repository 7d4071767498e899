"""Matrices whose rows are whole vectors: the row operations that the filters' steps are made of.

Rows are padded with zeros to a multiple of `LANES` and begin at a whole register, so that a row operation is a few
vector instructions with no remainder: row i of `a` is its vectors i · a.shape[1] // LANES and on. Where a shape is
given as (m, n⁺), n columns are meant and the rest is zero.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from windsysid.kernels.jit import called, pasted
from windsysid.kernels.parts import lanes_sum, load_part, stays_a_function, store_part
from windsysid.kernels.simd import LANES, load, splat, store

__all__ = ["inner", "multiply", "padded", "write"]


def padded(rows: int, columns: int) -> NDArray[np.float64]:
    """A matrix of zeros (rows, columns or up to LANES − 1 more)."""
    width = -(-columns // LANES) * LANES
    room = np.zeros(rows * width + LANES)
    skipped = -(room.ctypes.data // 8) % LANES
    return room[skipped : skipped + rows * width].reshape(rows, width)


@called
def multiply(start: Any, weights: Any, first: int, last: int, begin: int, end: int, matrix: Any, out: Any) -> None:
    """Rows i of `out` = `start` + Σ_j weights[i, j] · row j of `matrix`, for first ≤ i < last and begin ≤ j < end.

    A `start` of one row is that of every row. Four vectors of a sum at a time stay in registers.
    """
    stays_a_function()
    width = out.shape[1] // LANES
    apart = 0 if start.shape[0] == 1 else width
    for i in range(first, last):
        c = 0
        while c + 4 <= width:
            at = i * apart + c
            one, two, three, four = load(start, at), load(start, at + 1), load(start, at + 2), load(start, at + 3)
            for j in range(begin, end):
                weight, at = splat(weights[i, j]), j * width + c
                one = one + weight * load(matrix, at)
                two = two + weight * load(matrix, at + 1)
                three = three + weight * load(matrix, at + 2)
                four = four + weight * load(matrix, at + 3)
            at = i * width + c
            store(out, at, one)
            store(out, at + 1, two)
            store(out, at + 2, three)
            store(out, at + 3, four)
            c += 4
        while c + 2 <= width:
            at = i * apart + c
            one, two = load(start, at), load(start, at + 1)
            for j in range(begin, end):
                weight, at = splat(weights[i, j]), j * width + c
                one = one + weight * load(matrix, at)
                two = two + weight * load(matrix, at + 1)
            at = i * width + c
            store(out, at, one)
            store(out, at + 1, two)
            c += 2
        if c < width:
            one = load(start, i * apart + c)
            for j in range(begin, end):
                one = one + splat(weights[i, j]) * load(matrix, j * width + c)
            store(out, i * width + c, one)


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

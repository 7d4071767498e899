"""Algebra of triangular covariance roots: P = S Sᵀ with S lower triangular, never subtracted from.

Rows are padded with zeros to whole vectors (`windsysid.kernels.simd.padded`). Roots are kept transposed: row j of
`root` is column j of S, the direction of one sigma point. A covariance may be singular (a state that is known, two that
always agree): a pivot that rounding cannot tell from zero is zero, and so is its column.

Source: Golub & Van Loan, Matrix Computations (4th ed.), 4.2 and 5.2; Carlson, AIAA Journal 11(9), 1973.
"""

import math
from typing import Any

from windsysid.kernels.jit import uncounted
from windsysid.kernels.parts import lanes_sum, without_first
from windsysid.kernels.simd import LANES, load, splat, store

__all__ = ["absorb", "factorise", "square", "triangularise"]

RELATIVE_ROUNDING = 2.3e-16

MIN_SUM_OF_SQUARES = 1e-290
"""A sum of squares below it is zero: its inverse is, or could be, infinite."""


@uncounted
def factorise(cov: Any, root: Any) -> None:
    """`root` (n, n⁺) of the covariance `cov` (n, n⁺), of which the upper triangle is read (Cholesky)."""
    n, width = root.shape[0], root.shape[1] // LANES
    for j in range(n):
        first = j // LANES
        for c in range(first):
            store(root, j * width + c, splat(0.0))
        for c in range(first, width):
            row = load(cov, j * width + c)
            for k in range(j):
                row = row - splat(root[k, j]) * load(root, k * width + c)
            store(root, j * width + c, row)
        scale = splat(0.0 if root[j, j] <= n * RELATIVE_ROUNDING * cov[j, j] else 1.0 / math.sqrt(root[j, j]))
        store(root, j * width + first, scale * without_first(load(root, j * width + first), j - first * LANES))
        for c in range(first + 1, width):
            store(root, j * width + c, scale * load(root, j * width + c))


@uncounted
def square(root: Any, cov: Any) -> None:
    """The covariance (n, n⁺) of `root` (n, n⁺), symmetric to the last digit."""
    n, width = root.shape[0], root.shape[1] // LANES
    for i in range(n):
        for c in range(i // LANES, width):
            row = splat(0.0)
            for k in range(i + 1):
                row = row + splat(root[k, i]) * load(root, k * width + c)
            store(cov, i * width + c, row)
        for j in range(i):
            cov[i, j] = cov[j, i]


@uncounted
def triangularise(rows: Any, pivot: Any) -> None:
    """A (n, w⁺) → L lower triangular, in place, with L Lᵀ = A Aᵀ: the QR factorisation of Aᵀ by Householder
    reflections.

    `pivot` (1, w⁺) is scratch.
    """
    n, width = rows.shape[0], rows.shape[1] // LANES
    for i in range(min(n, rows.shape[1])):
        first = i // LANES
        head, own = rows[i, i], load(rows, i * width + first)
        part = without_first(own, i - first * LANES + 1)
        store(pivot, first, part)
        store(rows, i * width + first, own - without_first(own, i - first * LANES))
        squares = part * part
        for c in range(first + 1, width):
            part = load(rows, i * width + c)
            squares = squares + part * part
            store(pivot, c, part)
            store(rows, i * width + c, splat(0.0))
        tail = lanes_sum(squares)
        norm = math.sqrt(head * head + tail)
        rows[i, i] = norm
        if tail < MIN_SUM_OF_SQUARES:
            if head < 0.0:
                for r in range(i + 1, n):
                    rows[r, i] = -rows[r, i]
            continue
        # onto +norm, so that L has a positive diagonal; of the two ways to write head − norm the one without
        # cancellation
        lead = head - norm if head <= 0.0 else -tail / (head + norm)
        scale = 2.0 / (lead * lead + tail)
        pivot[0, i] = lead
        for r in range(i + 1, n):
            products = splat(0.0)
            for c in range(first, width):
                products = products + load(pivot, c) * load(rows, r * width + c)
            along = splat(scale * lanes_sum(products))
            for c in range(first, width):
                store(rows, r * width + c, load(rows, r * width + c) - along * load(pivot, c))


@uncounted
def absorb(directions: Any, centre: Any, c: int, behind: Any) -> tuple[float, float]:
    """Take in one reading with noise of unit variance, in place (Carlson's update, which subtracts nothing).

    `directions` (n, w⁺) and `centre` (1, w⁺) hold, for each of w quantities, its sensitivity to n independent unit
    normals and its mean: readings, as deviations from what was read, then the state, whose part of `directions` is a
    transposed root and stays one. Quantity `c` is taken in, those after it are moved; those before it are lost.
    `behind` (1, w⁺) is scratch. Returns the whitened innovation and the standard deviation it was divided by.
    """
    n, width = directions.shape[0], directions.shape[1] // LANES
    first, innovation = c // LANES, -centre[0, c]
    for i in range(first, width):
        store(behind, i, splat(0.0))
    variance = 1.0
    for j in range(n - 1, -1, -1):
        slope = directions[j, c]
        wider = variance + slope * slope
        kept, lost, weight = (
            splat(math.sqrt(variance / wider)),
            splat(slope / math.sqrt(variance * wider)),
            splat(slope),
        )
        for i in range(first, width):
            value, before = load(directions, j * width + i), load(behind, i)
            store(directions, j * width + i, kept * value - lost * before)
            store(behind, i, before + weight * value)
        variance = wider
    std, step = math.sqrt(variance), splat(innovation / variance)
    for i in range(first, width):
        store(centre, i, load(centre, i) + load(behind, i) * step)
    return innovation / std, std

"""Algebra of triangular covariance roots: P = S Sᵀ with S lower triangular, never subtracted from.

Roots are kept transposed: row j of `root` is column j of S, the direction of one sigma point. A covariance may be singular (a state that is
known, two that always agree): a pivot that rounding cannot tell from zero is zero, and so is its column.

Source: Golub & Van Loan, Matrix Computations (4th ed.), 4.2 and 5.2; Carlson, AIAA Journal 11(9), 1973.
"""

import math
from typing import Any

from windsysid.jit import inlined

__all__ = ["absorb", "factorise", "square", "triangularise"]

ROUNDING = 2.3e-16


@inlined
def factorise(cov: Any, root: Any) -> None:
    """`root` (n, n) of the covariance `cov` (n, n), of which the upper triangle is read (Cholesky)."""
    n = root.shape[0]
    for j in range(n):
        row = root[j]
        for i in range(j):
            row[i] = 0.0
        for i in range(j, n):
            row[i] = cov[j, i]
        for k in range(j):
            above = root[k]
            factor = above[j]
            if factor != 0.0:
                for i in range(j, n):
                    row[i] -= factor * above[i]
        scale = 0.0 if row[j] <= n * ROUNDING * cov[j, j] else 1.0 / math.sqrt(row[j])
        for i in range(j, n):
            row[i] *= scale


@inlined
def square(root: Any, cov: Any) -> None:
    """The covariance (n, n) of `root` (n, n), symmetric to the last digit."""
    n = root.shape[0]
    for i in range(n):
        row = cov[i]
        for j in range(i, n):
            row[j] = 0.0
        for k in range(i + 1):
            direction = root[k]
            factor = direction[i]
            for j in range(i, n):
                row[j] += factor * direction[j]
        for j in range(i):
            row[j] = cov[j, i]


@inlined
def triangularise(rows: Any) -> None:
    """A (n, w) → L lower triangular, in place, with L Lᵀ = A Aᵀ: the QR factorisation of Aᵀ by Householder reflections."""
    n, w = rows.shape
    for i in range(min(n, w)):
        pivot = rows[i]
        tail = 0.0
        for j in range(i + 1, w):
            tail += pivot[j] * pivot[j]
        head = pivot[i]
        norm = math.sqrt(head * head + tail)
        if tail == 0.0:
            if head < 0.0:
                for r in range(i, n):
                    rows[r, i] = -rows[r, i]
            continue
        # onto +norm, so that L has a positive diagonal; of the two ways to write head − norm the one without cancellation
        lead = head - norm if head <= 0.0 else -tail / (head + norm)
        scale = 2.0 / (lead * lead + tail)
        pivot[i] = lead
        for r in range(i + 1, n):
            row = rows[r]
            along = 0.0
            for j in range(i, w):
                along += pivot[j] * row[j]
            along *= scale
            for j in range(i, w):
                row[j] -= along * pivot[j]
        pivot[i] = norm
        for j in range(i + 1, w):
            pivot[j] = 0.0


@inlined
def absorb(directions: Any, centre: Any, c: int, behind: Any) -> tuple[float, float]:
    """Take in one reading with noise of unit variance, in place (Carlson's update, which subtracts nothing).

    `directions` (n, w) and `centre` (w,) hold, for each of w quantities, its sensitivity to n independent unit normals and its mean:
    readings, as deviations from what was read, then the state, whose part of `directions` is a transposed root and stays one. Quantity
    `c` is taken in, those after it are moved. `behind` (w,) is scratch. Returns the whitened innovation and the standard deviation it was
    divided by.
    """
    n, w = directions.shape
    for i in range(c + 1, w):
        behind[i] = 0.0
    variance = 1.0
    for j in range(n - 1, -1, -1):
        row = directions[j]
        slope = row[c]
        wider = variance + slope * slope
        kept, lost = math.sqrt(variance / wider), slope / math.sqrt(variance * wider)
        for i in range(c + 1, w):
            value = row[i]
            row[i] = kept * value - lost * behind[i]
            behind[i] += slope * value
        variance = wider
    std = math.sqrt(variance)
    innovation = -centre[c]
    for i in range(c + 1, w):
        centre[i] += behind[i] * innovation / variance
    return innovation / std, std

"""Complex matrices whose rows are whole vectors: their real parts, and behind them their imaginary parts.

A matrix (m, n) is an array of doubles with n⁺ columns of real parts and n⁺ of imaginary ones, n⁺ being n rounded up to
a multiple of `LANES`; what is past n is zero. A product of two numbers is then four products of vectors, and nothing
has to change places. One vector more ends each row: rows whose lengths are powers of two would fall on the same places
of the processor's cache.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from windsysid.kernels.jit import called, pasted
from windsysid.kernels.parts import lanes_sum, load_part, stays_a_function, store_part
from windsysid.kernels.rows import padded
from windsysid.kernels.simd import LANES, load, splat, store

__all__ = [
    "add_row", "clear", "clear_row", "conjugate_row", "copy_part", "copy_row", "exchange", "gram", "imaginary",
    "products", "scale_row", "split", "take_rows", "turn",
]  # fmt: skip

VECTORS_PER_CHUNK = 64
"""Vectors of a row that `gram` goes through before it turns to the next row: four such rows stay in the first cache."""


def split(rows: int, columns: int) -> NDArray[np.float64]:
    """A complex matrix of zeros."""
    return padded(rows, (2 * -(-columns // LANES) + 1) * LANES)


@pasted
def imaginary(rows: Any) -> int:
    """The column in which the imaginary parts begin."""
    return int(rows.shape[1] // (2 * LANES) * LANES)


@called
def add_row(out: Any, i: int, real: float, imag: float, rows: Any, k: int) -> None:
    """Adds (real + i imag) · row k of `rows` to row i of `out`."""
    stays_a_function()
    stride = out.shape[1] // LANES
    width, a, b, to, of = stride // 2, splat(real), splat(imag), i * stride, k * stride
    for c in range(width):
        x, y = load(rows, of + c), load(rows, of + width + c)
        store(out, to + c, load(out, to + c) + a * x - b * y)
        store(out, to + width + c, load(out, to + width + c) + a * y + b * x)


@called
def take_rows(rows: Any, i: int, weights: Any, first: int, last: int, begin: int, end: int) -> None:
    """Takes Σ_k weights[i, k] · row k from row i of `rows`, first ≤ k < last, on the vectors begin ≤ c < end of either
    part; `weights` are complex numbers."""
    stays_a_function()
    stride = rows.shape[1] // LANES
    width = stride // 2
    for c in range(begin, end):
        at = i * stride + c
        x, y, across, along = load(rows, at), load(rows, at + width), splat(0.0), splat(0.0)
        for k in range(first, last):
            weight = weights[i, k]
            if weight == 0.0:
                continue
            a, b, of = splat(weight.real), splat(weight.imag), k * stride + c
            u, v = load(rows, of), load(rows, of + width)
            x = x - a * u
            y = y - a * v
            across = across + b * v
            along = along + b * u
        store(rows, at, x + across)
        store(rows, at + width, y - along)


@called
def conjugate_row(out: Any, i: int, rows: Any, k: int, scale: float) -> None:
    """Row i of `out` ← scale · the conjugate of row k of `rows`."""
    stride = out.shape[1] // LANES
    width, s, to, of = stride // 2, splat(scale), i * stride, k * stride
    for c in range(width):
        store(out, to + c, s * load(rows, of + c))
        store(out, to + width + c, -(s * load(rows, of + width + c)))


@called
def products(left: Any, right: Any, count: int, out: Any) -> None:
    """out (e, e) ← leftᵀ right of their first `count` rows, on the diagonal and to its right; left of it, anything.

    Four sums stay in registers, none of which waits for another.
    """
    stays_a_function()
    stride = out.shape[1] // LANES
    width, half = stride // 2, imaginary(left)
    for c in range(width):
        for i in range(min(out.shape[0], (c + 1) * LANES)):
            x = y = across = along = splat(0.0)
            for k in range(count):
                a, b, at = splat(left[k, i]), splat(left[k, half + i]), k * stride + c
                u, v = load(right, at), load(right, at + width)
                x = x + a * u
                y = y + a * v
                across = across + b * v
                along = along + b * u
            store(out, i * stride + c, x - across)
            store(out, i * stride + width + c, y + along)


@called
def copy_part(out: Any, row: int, place: int, rows: Any, i: int, first: int, count: int, scale: float) -> None:
    """Elements place … of a row of `out` ← scale · `count` elements of row i of `rows`, from element `first` on."""
    for c in range(0, count, LANES):
        part = splat(scale) * load_part(rows, i * rows.shape[1] + first + c, count - c)
        store_part(out, row * out.shape[1] + place + c, part, count - c)


@called
def gram(rows: Any, weight: float, out: Any) -> None:
    """Adds weight · rows rowsᵀ to out (n, n), on the diagonal and left of it; the rows are real, and n is a multiple
    of 4."""
    stays_a_function()
    width = rows.shape[1] // LANES
    for start in range(0, width, VECTORS_PER_CHUNK):
        end = min(width, start + VECTORS_PER_CHUNK)
        for j in range(0, out.shape[0], 4):
            for i in range(j, out.shape[0]):
                a = b = c = d = splat(0.0)
                for at in range(start, end):
                    x = load(rows, i * width + at)
                    a = a + x * load(rows, j * width + at)
                    b = b + x * load(rows, (j + 1) * width + at)
                    c = c + x * load(rows, (j + 2) * width + at)
                    d = d + x * load(rows, (j + 3) * width + at)
                out[i, j] += weight * lanes_sum(a)
                out[i, j + 1] += weight * lanes_sum(b)
                out[i, j + 2] += weight * lanes_sum(c)
                out[i, j + 3] += weight * lanes_sum(d)


@called
def exchange(rows: Any, i: int, j: int) -> None:
    """Rows i and j change places."""
    if i != j:
        for c in range(rows.shape[1]):
            rows[i, c], rows[j, c] = rows[j, c], rows[i, c]


@called
def scale_row(rows: Any, i: int, by: complex) -> None:
    """Row i times a number."""
    half = imaginary(rows)
    for c in range(half):
        x, y = rows[i, c], rows[i, half + c]
        rows[i, c], rows[i, half + c] = by.real * x - by.imag * y, by.real * y + by.imag * x


@called
def clear(out: Any) -> None:
    """out ← 0."""
    for i in range(out.shape[0]):
        for c in range(out.shape[1]):
            out[i, c] = 0.0


@called
def clear_row(out: Any, i: int) -> None:
    """Row i of `out` ← 0."""
    for c in range(out.shape[1]):
        out[i, c] = 0.0


@called
def copy_row(out: Any, i: int, rows: Any, k: int) -> None:
    """Row i of `out` ← row k of `rows`."""
    for c in range(out.shape[1]):
        out[i, c] = rows[k, c]


@called
def turn(rows: Any, out: Any) -> None:
    """out ← the transposed of complex rows."""
    from_half, to_half = imaginary(rows), imaginary(out)
    for i in range(out.shape[0]):
        for j in range(rows.shape[0]):
            out[i, j] = rows[j, i]
            out[i, to_half + j] = rows[j, from_half + i]

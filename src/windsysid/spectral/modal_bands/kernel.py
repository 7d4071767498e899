"""Compiled loops of scoring: a band's spectrum and its whitened derivatives, row by row.

The equations of D and S̄ are those of `windsysid.spectral.modal_bands.model`. With S̄ = G Gᴴ in each row, a slope dS of
the model becomes A = G⁻¹ dS G⁻ᴴ. All slopes are sums of u vᴴ + v uᴴ, so that only vectors are whitened. A Hermitian
matrix is kept as m² real numbers, its diagonal and √2 times real and imaginary parts below it: inner products of these
are traces of products.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import types

from windsysid.kernels.jit import compiled, uncounted

__all__ = ["whitened_slopes"]


@lru_cache(maxsize=1)
def whitened_slopes() -> Any:
    """The kernel, compiled."""
    c2, c3 = types.complex128[:, ::1], types.complex128[:, :, ::1]
    f0, f1, f2, f3 = types.float64, types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
    i1 = types.int64[::1]
    return compiled(_whiten, f0(c3, f1, f1, f1, i1, f2, f1, f1, c2, c2, c2, f1, c2, c3, i1, f3, f2))


@uncounted
def _solve(root: Any, x: Any) -> None:
    """x ← G⁻¹ x."""
    m = len(x)
    for i in range(m):
        total = x[i]
        for j in range(i):
            total -= root[i, j] * x[j]
        x[i] = total / root[i, i].real


@uncounted
def _respond(fine: Any, f: Any, zeta: Any, h: Any, h_f: Any, h_z: Any) -> None:
    """h and its derivatives to ln f and ln ζ (r, F)."""
    for j in range(len(f)):
        for i in range(len(fine)):
            ratio = fine[i] / f[j]
            x = ratio * ratio
            q = complex(1.0 - x, 2.0 * zeta[j] * ratio)
            h[j, i] = -x / q
            h_f[j, i] = 2.0 * x / q - x * ratio * complex(-2.0 * ratio, 2.0 * zeta[j]) / (q * q)
            h_z[j, i] = zeta[j] * x * complex(0.0, 2.0 * ratio) / (q * q)


@uncounted
def _expect(
    weights: Any, first: int, tilt: Any, bend: Any, h: Any, h_f: Any, h_z: Any, d: Any, d_f: Any, d_z: Any, d_a: Any
) -> None:
    """D of one row and its derivatives (r, r): means over the taper's window."""
    r = h.shape[0]
    d[:], d_f[:], d_z[:], d_a[:] = 0.0, 0.0, 0.0, 0.0
    for i in range(len(weights)):
        at = first + i
        weight = weights[i] * tilt[at]
        for other in range(r):
            turned = weight * h[other, at].conjugate()
            for j in range(r):
                d_f[j, other] += h_f[j, at] * turned
                d_z[j, other] += h_z[j, at] * turned
                if j >= other:
                    d[j, other] += h[j, at] * turned
                    d_a[j, other] += bend[at] * (h[j, at] * turned)
    for j in range(r):
        for other in range(j):
            d[other, j] = d[j, other].conjugate()
            d_a[other, j] = d_a[j, other].conjugate()


@uncounted
def _product(x: Any, out: Any) -> None:
    """out = x xᴴ."""
    for i in range(x.shape[0]):
        for j in range(x.shape[0]):
            total = 0.0 + 0.0j
            for other in range(x.shape[1]):
                total += x[i, other] * x[j, other].conjugate()
            out[i, j] = total


@uncounted
def _assemble(d: Any, both: Any, phi: Any, level: Any, tilt: float, out: Any, ahead: Any) -> None:
    """out = Φ [D ∘ C Cᴴ] Φᴴ + tilt · L Lᴴ."""
    m, r = phi.shape
    for j in range(r):
        for i in range(m):
            total = 0.0 + 0.0j
            for other in range(r):
                total += d[j, other] * both[j, other] * phi[i, other].conjugate()
            ahead[j, i] = total
    for i in range(m):
        for j in range(m):
            total = tilt * level[i, j]
            for other in range(r):
                total += phi[i, other] * ahead[other, j]
            out[i, j] = total


@uncounted
def _add(u: Any, v: Any, scale: float, out: Any) -> None:
    """out += scale (u vᴴ + v uᴴ), as real numbers."""
    m = len(u)
    at = m
    for i in range(m):
        out[i] += 2.0 * scale * (u[i] * v[i].conjugate()).real
        for j in range(i):
            z = u[i] * v[j].conjugate() + v[i] * u[j].conjugate()
            out[at] += scale * math.sqrt(2.0) * z.real
            out[at + 1] += scale * math.sqrt(2.0) * z.imag
            at += 2


@uncounted
def _turned(d: Any, both: Any, white: Any, j: int, v: Any) -> None:
    """v = G⁻¹ Φ (D ∘ B)ᴴ e_j."""
    for i in range(len(v)):
        v[i] = 0.0
    for other in range(len(white)):
        weight = d[j, other] * both[j, other]
        for i in range(len(v)):
            v[i] += weight.conjugate() * white[other, i]


def _whiten(
    power: Any, count: Any, frequency: Any, fine: Any, first: Any, window: Any, f: Any, zeta: Any,
    shape: Any, load: Any, rest: Any, numbers: Any, drift: Any, mix: Any, real: Any, slopes: Any, misfit: Any,
) -> float:  # fmt: skip
    """Whitened slopes (p, K, m²) and misfit 1 − G⁻¹ P G⁻ᴴ (K, m²), both times √n; returns Σ n (ln det S̄ + tr S̄⁻¹ P),
    infinite where S̄ is not positive.

    Parameters
    ----------
    power, count, frequency, fine, first, window
        Of a `windsysid.spectral.transforms.dft.Band`.
    f, zeta, shape, load, rest, drift, mix
        Of the modes; no columns of `drift`, and no matrices of `mix`, where they are no unknowns.
    numbers
        f_c, a, b.
    real
        The elements of Φ that are real.
    slopes
        Zero when handed in.
    """
    k_rows, m = power.shape[0], power.shape[1]
    r = shape.shape[1]
    moves, mixes = drift.shape[1] > 0, len(mix) > 0
    phi = shape.copy()
    centre, a_slope, b_slope = numbers[0], numbers[1], numbers[2]
    h = np.empty((r, len(fine)), dtype=np.complex128)
    h_f, h_z = np.empty_like(h), np.empty_like(h)
    _respond(fine, f, zeta, h, h_f, h_z)
    tilts, bends = np.empty(len(fine)), np.empty(len(fine))
    for i in range(len(fine)):
        bends[i] = math.log(fine[i] / centre)
        tilts[i] = math.exp(a_slope * bends[i])
    d = np.empty((r, r), dtype=np.complex128)
    d_f, d_z, d_a = np.empty_like(d), np.empty_like(d), np.empty_like(d)
    both, level = np.empty_like(d), np.empty((m, m), dtype=np.complex128)
    _product(load, both)
    _product(rest, level)
    cost = 0.0
    root = np.empty((m, m), dtype=np.complex128)
    white = np.empty((r, m), dtype=np.complex128)  # G⁻¹ φ_j
    inner = np.empty((r, m), dtype=np.complex128)  # G⁻¹ Φ (D∘B)ᴴ e_j
    z = np.empty((m, m), dtype=np.complex128)  # rows: columns of G⁻¹ L
    y = np.empty_like(z)  # rows: columns of G⁻¹ L_f
    here, grow = rest.copy(), np.ones(m)  # L_f, and its columns over those of L
    axes = np.empty((m, m), dtype=np.complex128)  # rows: columns of G⁻¹
    whole, seen = np.empty_like(axes), np.empty_like(axes)  # T G, and rows: columns of its inverse
    v = np.empty(m, dtype=np.complex128)
    for k in range(k_rows):
        height = math.log(frequency[k] / centre)
        tilt = math.exp(b_slope * height)
        bend = height * tilt
        if mixes:
            for j in range(m):
                grow[j] = math.exp(0.5 * mix[0, j, j].real * height)
                for i in range(m):
                    here[i, j] = rest[i, j] * grow[j]
            _product(here, level)
        if moves:
            for j in range(r):
                for i in range(m):
                    phi[i, j] = shape[i, j] + (frequency[k] / f[j] - 1.0) * drift[i, j]
        _expect(window[k], first[k], tilts, bends, h, h_f, h_z, d, d_f, d_z, d_a)
        _assemble(d, both, phi, level, tilt, root, inner)
        for i in range(m):  # Cholesky, in place
            for j in range(i):
                total = root[i, j]
                for other in range(j):
                    total -= root[i, other] * root[j, other].conjugate()
                root[i, j] = total / root[j, j].real
            pivot = root[i, i].real
            for other in range(i):
                pivot -= root[i, other].real ** 2 + root[i, other].imag ** 2
            if not pivot > 0.0:
                return math.inf
            root[i, i] = math.sqrt(pivot)
            cost += count[k] * math.log(pivot)
        size = math.sqrt(count[k])
        for i in range(m):
            for j in range(m):
                axes[i, j] = 1.0 if i == j else 0.0
                z[i, j] = rest[j, i]
            _solve(root, axes[i])
            _solve(root, z[i])
            for j in range(m):
                y[i, j] = z[i, j] * grow[i]
                whole[i, j], seen[i, j] = root[i, j], axes[i, j]
        if mixes:
            for i in range(m):
                for j in range(i):
                    for order in range(len(mix)):
                        for q in range(j + 1):
                            whole[i, q] += height ** (order + 1) * mix[order, i, j] * root[j, q]
            for i in range(m):
                for j in range(m):
                    seen[i, j] = 1.0 if i == j else 0.0
                _solve(whole, seen[i])
        # misfit: 1 − W P Wᴴ, with W = (T G)⁻¹ whose columns are the rows of `seen`
        at = m
        for i in range(m):
            for j in range(i + 1):
                total = 0.0 + 0.0j
                for p in range(i + 1):
                    for q in range(j + 1):
                        total += seen[p, i] * power[k, p, q] * seen[q, j].conjugate()
                if i == j:
                    misfit[k, i] = size * (1.0 - total.real)
                    cost += count[k] * total.real
                else:
                    misfit[k, at] = -size * math.sqrt(2.0) * total.real
                    misfit[k, at + 1] = -size * math.sqrt(2.0) * total.imag
                    at += 2
        for j in range(r):
            for i in range(m):
                white[j, i] = phi[i, j]
            _solve(root, white[j])
        a = 0
        for which in range(2):
            for j in range(r):
                _turned(d_f if which == 0 else d_z, both, white, j, v)
                _add(white[j], v, size, slopes[a, k])
                a += 1
        first_drift = len(slopes) - 2 * m * r
        for j in range(r):
            _turned(d, both, white, j, inner[j])
        for which in range(2):
            for j in range(r):
                for i in range(m):
                    v[i] = inner[j, i] if which == 0 else -1j * inner[j, i]
                if moves:
                    for row in range(m):
                        _add(axes[row], v, size * (frequency[k] / f[j] - 1.0), slopes[first_drift, k])
                        first_drift += 1
                for row in range(m):
                    if which == 1 and row == real[j]:
                        continue
                    _add(axes[row], v, size, slopes[a, k])
                    a += 1
        if moves:
            for j in range(r):
                for i in range(m):
                    v[i] = -frequency[k] / f[j] * drift[i, j]
                _solve(root, v)
                _add(v, inner[j], size, slopes[j, k])
        for which in range(2):
            for i in range(1, r):
                for j in range(i):
                    for other in range(m):
                        v[other] = 0.0
                    for other in range(j, r):
                        weight = d[i, other] * load[other, j].conjugate()
                        if which == 1:
                            weight = weight * 1j
                        for q in range(m):
                            v[q] += weight.conjugate() * white[other, q]
                    _add(white[i], v, size, slopes[a, k])
                    a += 1
        if r > 0:
            for j in range(r):
                _turned(d_a, both, white, j, v)
                _add(white[j], v, 0.5 * size, slopes[a, k])
            a += 1
        for i in range(m):
            _add(y[i], y[i], 0.5 * size * tilt, slopes[a, k])
            a += 1
        for which in range(2):
            for i in range(1, m):
                for j in range(i):
                    for other in range(m):
                        v[other] = y[j, other] if which == 0 else -1j * y[j, other]
                    _add(z[i], v, size * tilt * grow[j], slopes[a, k])
                    a += 1
        if mixes:
            for i in range(1, m):
                _add(y[i], y[i], 0.5 * size * bend, slopes[a, k])
                a += 1
        for which in range(2):
            for order in range(len(mix)):
                for i in range(1, m):
                    for j in range(i):
                        for other in range(m):
                            v[other] = root[j, other].conjugate() if other <= j else 0.0
                            if which == 1:
                                v[other] *= -1j
                        _add(seen[i], v, size * height ** (order + 1), slopes[a, k])
                        a += 1
        for i in range(m):
            _add(y[i], y[i], 0.5 * size * bend, slopes[a, k])
    return cost

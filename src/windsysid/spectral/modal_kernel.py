"""The compiled part of scoring: whitened slopes of a band's spectrum, row by row.

With S̄ = G Gᴴ in each row, a slope dS of the model becomes A = G⁻¹ dS G⁻ᴴ. All slopes are sums of u vᴴ + v uᴴ, so that
only vectors are whitened. A Hermitian matrix is kept as m² real numbers, its diagonal and √2 times real and imaginary
parts below it: inner products of these are traces of products.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import types

from windsysid.kernels.jit import compiled, inlined

__all__ = ["whitened_slopes"]


@lru_cache(maxsize=1)
def whitened_slopes() -> Any:
    """The kernel, compiled."""
    c2, c3 = types.complex128[:, ::1], types.complex128[:, :, ::1]
    f1, f2, f3 = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
    i1 = types.int64[::1]
    return compiled(_whiten, types.float64(c3, c3, c3, c3, c3, c3, f1, f1, f1, c2, c2, c2, i1, f3, f2))


@inlined
def _solve(root: Any, x: Any) -> None:
    """x ← G⁻¹ x."""
    m = len(x)
    for i in range(m):
        total = x[i]
        for j in range(i):
            total -= root[i, j] * x[j]
        x[i] = total / root[i, i].real


@inlined
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


def _whiten(
    power: Any, d: Any, d_f: Any, d_z: Any, d_a: Any, s: Any, count: Any, tilt: Any, bend: Any,
    phi: Any, load: Any, rest: Any, real: Any, slopes: Any, misfit: Any,
) -> float:  # fmt: skip
    """Whitened slopes (p, K, m²) and misfit 1 − G⁻¹ P G⁻ᴴ (K, m²), both times √n; returns Σ n (ln det S̄ + tr S̄⁻¹ P),
    infinite where S̄ is not positive.

    Parameters
    ----------
    power
        P (K, m, m).
    d, d_f, d_z, d_a
        D and, in row j, its derivatives to ln f_j, ln ζ_j by h_j alone, and its derivative to a; (K, r, r).
    s
        S̄ (K, m, m), overwritten.
    count, tilt, bend
        n, (f/f_c)^b and its derivative to b (K,).
    phi, load, rest, real
        Φ, C, L, and the elements of Φ that are real.
    """
    k_rows, m = power.shape[0], power.shape[1]
    r = phi.shape[1]
    cost = 0.0
    white = np.empty((r, m), dtype=np.complex128)  # G⁻¹ φ_j
    inner = np.empty((r, m), dtype=np.complex128)  # G⁻¹ Φ (D∘B)ᴴ e_j
    z = np.empty((m, m), dtype=np.complex128)  # rows: columns of G⁻¹ L
    axes = np.empty((m, m), dtype=np.complex128)  # rows: columns of G⁻¹
    v = np.empty(m, dtype=np.complex128)
    both = np.empty((r, r), dtype=np.complex128)  # C Cᴴ
    for i in range(r):
        for j in range(r):
            total = 0.0 + 0.0j
            for other in range(r):
                total += load[i, other] * load[j, other].conjugate()
            both[i, j] = total
    for k in range(k_rows):
        root = s[k]
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
        # misfit: 1 − G⁻¹ P G⁻ᴴ, with W = G⁻¹ whose columns are the rows of `axes`
        at = m
        for i in range(m):
            for j in range(i + 1):
                total = 0.0 + 0.0j
                for p in range(i + 1):
                    for q in range(j + 1):
                        total += axes[p, i] * power[k, p, q] * axes[q, j].conjugate()
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
                for i in range(m):
                    v[i] = 0.0
                for other in range(r):
                    weight = (d_f[k, j, other] if which == 0 else d_z[k, j, other]) * both[j, other]
                    for i in range(m):
                        v[i] += weight.conjugate() * white[other, i]
                _add(white[j], v, size, slopes[a, k])
                a += 1
        for j in range(r):
            for i in range(m):
                inner[j, i] = 0.0
            for other in range(r):
                weight = d[k, j, other] * both[j, other]
                for i in range(m):
                    inner[j, i] += weight.conjugate() * white[other, i]
        for which in range(2):
            for j in range(r):
                for i in range(m):
                    v[i] = inner[j, i] if which == 0 else -1j * inner[j, i]
                for row in range(m):
                    if which == 1 and row == real[j]:
                        continue
                    _add(axes[row], v, size, slopes[a, k])
                    a += 1
        for which in range(2):
            for i in range(1, r):
                for j in range(i):
                    for other in range(m):
                        v[other] = 0.0
                    for other in range(j, r):
                        weight = d[k, i, other] * load[other, j].conjugate()
                        if which == 1:
                            weight = weight * 1j
                        for q in range(m):
                            v[q] += weight.conjugate() * white[other, q]
                    _add(white[i], v, size, slopes[a, k])
                    a += 1
        if r > 0:
            for j in range(r):
                for i in range(m):
                    v[i] = 0.0
                for other in range(r):
                    weight = d_a[k, j, other] * both[j, other]
                    for i in range(m):
                        v[i] += weight.conjugate() * white[other, i]
                _add(white[j], v, 0.5 * size, slopes[a, k])
            a += 1
        for i in range(m):
            _add(z[i], z[i], 0.5 * size * tilt[k], slopes[a, k])
            a += 1
        for which in range(2):
            for i in range(1, m):
                for j in range(i):
                    for other in range(m):
                        v[other] = z[j, other] if which == 0 else -1j * z[j, other]
                    _add(z[i], v, size * tilt[k], slopes[a, k])
                    a += 1
        for i in range(m):
            _add(z[i], z[i], 0.5 * size * bend[k], slopes[a, k])
    return cost

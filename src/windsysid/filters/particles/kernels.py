"""The inner loops of the particle filter: chunks of particles, taken through a block of samples.

Particles are an array (n, N), so that a loop over the particles of a chunk is vector code. A chunk knows nothing of the
others: what they have in common, sums over the weights, comes out per sample and chunk and is added up afterwards in
the chunks' order. Which thread ran a chunk therefore changes nothing.

With w̃ the weights before a sample, relative to the chunk's largest, and r the readings minus those expected of each
particle, a row of sums holds

    largest log-weight, Σw, Σw², Σ w (x − c), Σ w (x − c)²    after the sample, c being the cloud's centre,
    Σ w̃ r, Σ w̃ r²                                            before it.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import types

from windsysid.kernels.jit import JACOBIAN, VALUE, compiled, inlined
from windsysid.kernels.philox import Purpose, exponential, fill_normals, logarithm
from windsysid.statespace.step import (
    expected_reading,
    interval,
    linearise_reading,
    move,
    set_load_outputs,
    set_parameters,
)
from windsysid.statespace.workspace import BLOCKS, WORKSPACE, load_output

__all__ = ["CHUNK", "advance_kernel", "combine_kernel", "renew_kernel", "rows_kernel", "sums_kernel", "temper_kernel"]

CHUNK = 256
"""Particles that go through a block of samples together: their states fit the processor's nearest cache."""

MOVE = int(Purpose.MOVE)

_vector, _matrix, _cube = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
_KEY, _index = types.uint64[::1], types.int64[:, ::1]


@lru_cache(maxsize=1)
def advance_kernel() -> Any:
    """Take some chunks of particles through a block of samples.

    Arguments: the model's rates and reading, its `Blocks` and a `Workspace`; the seed's key; the first sample's number,
    chunks from … to; whether the state has been moved before, and whether it moves now; the particles (n, N) and
    log-weights (N,), changed in place; the centre (n,); inputs at the state's own time, inputs (T, ·) and readings (T,
    m); degrees of freedom of each sensor (m,), ∞ for Gaussian ones; for a linear model its rows at each sample (T, m, 1
    + n), otherwise none, and (column, reading) of those that differ from zero, ordered by reading; sums (1 + T, chunks,
    3 + 2 n + 2 m), the first row being what held before the first sample.
    """
    value = types.FunctionType(VALUE)
    return compiled(
        _advance,
        types.void(
            value, value, BLOCKS, WORKSPACE, _KEY, types.int64, types.int64, types.int64, types.boolean, types.boolean,
            _matrix, _vector, _vector, _vector, _matrix, _matrix, _vector, _cube, _index, _cube,
        ),
    )  # fmt: skip


def _advance(
    rates: Any, reading: Any, blocks: Any, ws: Any, key: Any, number: int, first: int, last: int, started: bool,
    moves: bool,
    particles: Any, log_weights: Any, centre: Any, previous: Any, inputs: Any, readings: Any, freedom: Any,
    rows: Any, entries: Any, sums: Any,
) -> None:  # fmt: skip
    nx, nz, nb, nt, _, _ = blocks.sizes
    n, count = particles.shape
    m, rest = blocks.noise.size, nx + nz
    state = np.empty(n)
    off, weight, loss = np.empty((m, CHUNK)), np.empty(CHUNK), np.empty(CHUNK)
    walking = 0
    for i in range(nb + nt):
        if blocks.walk[0, i] > 0.0:
            walking += 1
    rough = blocks.load_within.shape[2]
    draws = nz + rough + walking
    random = np.empty((4 * ((draws + 3) // 4), CHUNK))
    load_roots = np.zeros((blocks.step.size, nz, nz))
    for s in range(blocks.step.size):
        _cholesky(blocks.load_noise[s], load_roots[s])
    eta = np.empty(nz)
    for chunk in range(first, last):
        begin = chunk * CHUNK
        size = min(CHUNK, count - begin)
        own = log_weights[begin : begin + size]
        w, q = weight[:size], loss[:size]
        before, moved = previous, started
        for k in range(-1, inputs.shape[0]):  # −1: what held before, summed by the same machine code
            row = sums[k + 1, chunk]
            if k >= 0:
                after = inputs[k]
                if moved and moves:
                    if draws > 0:
                        fill_normals(key, number + k, MOVE, begin, random)
                    if rest > 0:
                        set_load_outputs(blocks, ws, before, after)
                        s = interval(blocks, after)
                        root, within = load_roots[s], blocks.load_within[s]
                        for i in range(size):
                            for j in range(n):
                                state[j] = particles[j, begin + i]
                            for j in range(nz):
                                total = 0.0
                                for below in range(j + 1):
                                    total += root[below, j] * random[below, i]
                                eta[j] = total
                                total = 0.0
                                for c in range(rough):
                                    total += within[j, c] * random[nz + c, i]
                                ws.middle[j] = total
                            move(rates, blocks, ws, state, eta, before, after)
                            for j in range(nx):
                                particles[j, begin + i] = ws.x[j]
                            for j in range(nz):
                                particles[nx + j, begin + i] = ws.z[j]
                    draw = nz + rough
                    for j in range(nb + nt):
                        variance = blocks.walk[interval(blocks, after), j]
                        if blocks.walk[0, j] > 0.0:
                            values, z, step = (
                                particles[rest + j, begin : begin + size],
                                random[draw],
                                math.sqrt(variance),
                            )
                            for i in range(size):
                                values[i] += step * z[i]
                            draw += 1
                moved = True
                before = after
                any_read = False
                for c in range(m):
                    any_read |= not np.isnan(readings[k, c])
                # readings minus what each particle expects
                if any_read and rows.shape[0] > 0:
                    e = 0
                    for c in range(m):
                        r, zero = off[c], readings[k, c] - rows[k, c, n]
                        for i in range(size):
                            r[i] = zero
                        while e < entries.shape[0] and entries[e, 0] == c:
                            j, slope = entries[e, 1], rows[k, c, entries[e, 1]]
                            values = particles[j, begin : begin + size]
                            if e + 1 < entries.shape[0] and entries[e + 1, 0] == c:
                                at = entries[e + 1, 1]
                                other, second = particles[at, begin : begin + size], rows[k, c, at]
                                for i in range(size):
                                    r[i] -= slope * values[i] + second * other[i]
                                e += 2
                            else:
                                for i in range(size):
                                    r[i] -= slope * values[i]
                                e += 1
                elif any_read:
                    load_output(blocks, ws, after, ws.H1)
                    for i in range(size):
                        for j in range(n):
                            state[j] = particles[j, begin + i]
                        expected_reading(reading, blocks, ws, state, after)
                        for c in range(m):
                            off[c, i] = readings[k, c] - ws.y[c]
                for i in range(size):
                    q[i] = 0.0
                for c in range(m):
                    one, two = 0.0, 0.0
                    if not np.isnan(readings[k, c]):
                        r, scale, nu = off[c], 1.0 / blocks.noise[c], freedom[c]
                        if nu == np.inf:
                            half = 0.5 * scale
                            for i in range(size):
                                one += w[i] * r[i]
                                two += w[i] * r[i] * r[i]
                                q[i] += half * r[i] * r[i]
                        else:
                            power, scale = 0.5 * (nu + 1.0), scale / nu
                            for i in range(size):
                                one += w[i] * r[i]
                                two += w[i] * r[i] * r[i]
                                q[i] += power * logarithm(1.0 + scale * r[i] * r[i])
                    row[3 + 2 * n + c] = one
                    row[3 + 2 * n + m + c] = two
                if any_read:
                    for i in range(size):
                        own[i] -= q[i]
            _sum(particles, begin, own, w, centre, row)


@inlined
def _sum(particles: Any, begin: int, own: Any, w: Any, centre: Any, row: Any) -> None:
    """Weights of a chunk relative to its largest, and their sums."""
    n, size = particles.shape[0], own.size
    largest = _largest(own)
    shift = largest if largest > -np.inf else 0.0
    total, squares = 0.0, 0.0
    for i in range(size):
        w[i] = exponential(own[i] - shift)
        total += w[i]
        squares += w[i] * w[i]
    row[0] = largest
    row[1] = total
    row[2] = squares
    for j in range(n):
        values, middle = particles[j, begin : begin + size], centre[j]
        one, two = 0.0, 0.0
        for i in range(size):
            away = values[i] - middle
            one += w[i] * away
            two += w[i] * away * away
        row[3 + j] = one
        row[3 + n + j] = two


@inlined
def _largest(values: Any) -> float:
    """The greatest value, 32 at a time: one after the other, each comparison would wait for the last."""
    best = np.full(32, -np.inf)
    whole = values.size // 32
    for block in range(whole):
        part = values[32 * block : 32 * block + 32]
        for i in range(32):
            best[i] = max(best[i], part[i])
    for i in range(32 * whole, values.size):
        best[0] = max(best[0], values[i])
    for i in range(8):
        best[i] = max(max(best[i], best[i + 8]), max(best[i + 16], best[i + 24]))
    largest: float = best[0]
    for i in range(1, 8):
        largest = max(largest, best[i])
    return largest


@lru_cache(maxsize=1)
def sums_kernel() -> Any:
    """Sums (1, chunks, 3 + 2 n + …) over particles (n, N) with log-weights (N,) about a centre (n,).

    The sums of readings are left out.
    """
    return compiled(_sums, types.void(_matrix, _vector, _vector, _cube))


def _sums(particles: Any, log_weights: Any, centre: Any, sums: Any) -> None:
    weight = np.empty(CHUNK)
    for chunk in range(sums.shape[1]):
        begin = chunk * CHUNK
        size = min(CHUNK, log_weights.size - begin)
        _sum(particles, begin, log_weights[begin : begin + size], weight[:size], centre, sums[0, chunk])


@lru_cache(maxsize=1)
def combine_kernel() -> Any:
    """Sums of chunks (1 + T, chunks, ·) → log Σw and effective sample size (1 + T,); mean, variance (1 + T, n); for
    each reading mean and variance of its deviation from what was expected (T, m). The centre (n,) comes before the
    results.
    """
    return compiled(_combine, types.void(_cube, _vector, _vector, _vector, _matrix, _matrix, _matrix, _matrix))


def _combine(
    sums: Any, centre: Any, log_total: Any, ess: Any, mean: Any, variance: Any, off: Any, off_variance: Any
) -> None:
    n, m = mean.shape[1], off.shape[1]
    chunks = sums.shape[1]
    share = np.empty(chunks)
    for k in range(sums.shape[0]):
        if k > 0:
            total = 0.0  # of the weights before the sample: `share` still holds them
            for c in range(chunks):
                total += share[c] * sums[k - 1, c, 1]
            for j in range(m):
                one, two = 0.0, 0.0
                for c in range(chunks):
                    one += share[c] * sums[k, c, 3 + 2 * n + j]
                    two += share[c] * sums[k, c, 3 + 2 * n + m + j]
                off[k - 1, j] = one / total
                off_variance[k - 1, j] = max(two / total - (one / total) ** 2, 0.0)
        largest = -np.inf
        for c in range(chunks):
            largest = max(largest, sums[k, c, 0])
        total, squares = 0.0, 0.0
        for c in range(chunks):
            share[c] = math.exp(sums[k, c, 0] - largest)
            total += share[c] * sums[k, c, 1]
            squares += share[c] * share[c] * sums[k, c, 2]
        log_total[k] = largest + math.log(total)
        ess[k] = total * total / squares
        for j in range(n):
            one, two = 0.0, 0.0
            for c in range(chunks):
                one += share[c] * sums[k, c, 3 + j]
                two += share[c] * sums[k, c, 3 + n + j]
            one /= total
            mean[k, j] = centre[j] + one
            variance[k, j] = max(two / total - one * one, 0.0)


@lru_cache(maxsize=1)
def rows_kernel() -> Any:
    """Derivatives and, last, values at zero of the readings at each sample (T, m, n + 1).

    For a model whose readings are linear in its state.
    """
    return compiled(_rows, types.void(types.FunctionType(JACOBIAN), BLOCKS, WORKSPACE, _matrix, _cube))


def _rows(reading_jacobian: Any, blocks: Any, ws: Any, inputs: Any, rows: Any) -> None:
    n = rows.shape[2] - 1
    zero = np.zeros(n)
    set_parameters(blocks, ws, zero)
    for k in range(inputs.shape[0]):
        linearise_reading(reading_jacobian, blocks, ws, zero, inputs[k])
        for c in range(rows.shape[1]):
            for j in range(n):
                rows[k, c, j] = ws.H[c, j]
            rows[k, c, n] = ws.y[c]


@lru_cache(maxsize=1)
def temper_kernel() -> Any:
    """Largest share of a sample's log-likelihoods (N,) that log-weights (N,) can take before the effective sample size
    falls to a given number.

    Arguments: log-weights, log-likelihoods, what is left to take in (0 … 1], the number.
    """
    return compiled(_temper, types.float64(_vector, _vector, types.float64, types.float64))


def _temper(log_weights: Any, likelihoods: Any, left: float, least: float) -> float:
    if _effective(log_weights, likelihoods, left) >= least:
        return left
    low, high = 0.0, left
    for _ in range(20):
        middle = 0.5 * (low + high)
        if _effective(log_weights, likelihoods, middle) >= least:
            low = middle
        else:
            high = middle
    return low


@inlined
def _effective(log_weights: Any, likelihoods: Any, part: float) -> float:
    together = log_weights + part * likelihoods
    largest = _largest(together)
    total, squares = 0.0, 0.0
    for i in range(log_weights.size):
        w = exponential(together[i] - largest)
        total += w
        squares += w * w
    return total * total / squares


@lru_cache(maxsize=1)
def renew_kernel() -> Any:
    """Liu and West's kernel: weights (N,), a, ancestors (N,), normal numbers (≥ n, N), values (n, N) and the new values
    (n, N).

    The new values are drawn, then moved by the affine map that gives them the weighted mean and covariance of the old
    ones: what the draw itself would add to their error is taken out again.
    """
    return compiled(_renew, types.void(_vector, types.float64, types.int64[::1], _matrix, _matrix, _matrix))


def _renew(weights: Any, a: float, chosen: Any, noise: Any, values: Any, out: Any) -> None:
    n, count = values.shape
    mean, own, root, own_root = np.empty(n), np.empty(n), np.zeros((n, n)), np.zeros((n, n))
    _moments(values, weights, mean, root)
    h = math.sqrt(1.0 - a * a)
    for j in range(n):
        row, new = values[j], out[j]
        for i in range(count):
            new[i] = a * (row[chosen[i]] - mean[j])
        for below in range(j + 1):
            z, slope = noise[below], h * root[below, j]
            for i in range(count):
                new[i] += slope * z[i]
    _moments(out, np.full(count, 1.0 / count), own, own_root)
    for j in range(n):  # to unit covariance
        row = out[j]
        scale = 1.0 / own_root[j, j] if own_root[j, j] > 0.0 else 0.0
        for i in range(count):
            row[i] -= own[j]
        for below in range(j):
            other, slope = out[below], own_root[below, j]
            for i in range(count):
                row[i] -= slope * other[i]
        for i in range(count):
            row[i] *= scale
    for j in range(n - 1, -1, -1):  # and to the covariance of the old ones
        row, scale, middle = out[j], root[j, j], mean[j]
        for i in range(count):
            row[i] = middle + scale * row[i]
        for below in range(j):
            other, slope = out[below], root[below, j]
            for i in range(count):
                row[i] += slope * other[i]


@inlined
def _moments(values: Any, weights: Any, mean: Any, root: Any) -> None:
    """Weighted mean, and the transposed root of the unbiased covariance Σ w (x − m) (x − m)ᵀ / (1 − Σ w²)."""
    n, count = values.shape
    cov = np.empty((n, n))
    squares = 0.0
    for i in range(count):
        squares += weights[i] * weights[i]
    unbiased = 1.0 / (1.0 - squares) if squares < 1.0 else 1.0
    for j in range(n):
        row = values[j]
        total = 0.0
        for i in range(count):
            total += weights[i] * row[i]
        mean[j] = total
    for j in range(n):
        row = values[j]
        for below in range(j, n):
            other = values[below]
            total = 0.0
            for i in range(count):
                total += weights[i] * (row[i] - mean[j]) * (other[i] - mean[below])
            cov[j, below] = total * unbiased
    _cholesky(cov, root)


@inlined
def _cholesky(cov: Any, root: Any) -> None:
    """Transposed root (n, n) of a covariance whose upper triangle is read; zero where `cov` is singular.

    Row j is column j of L.
    """
    n = root.shape[0]
    for j in range(n):
        for i in range(j, n):
            value = cov[j, i]
            for k in range(j):
                value -= root[k, j] * root[k, i]
            root[j, i] = value
        pivot = root[j, j]
        scale = 0.0 if pivot <= 1e-14 * cov[j, j] else 1.0 / math.sqrt(pivot)
        for i in range(j, n):
            root[j, i] *= scale

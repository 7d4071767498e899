"""Compiled Kalman filter and jump test of `windsysid.monitoring.levels.jumps`.

The candidates are the blocks k before which a jump is tested. Of each, `sums` has Σ G², Σ G z and the trace e(k).
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import types

from windsysid._types import Array
from windsysid.kernels.jit import compiled, uncounted

__all__ = ["run_kernel"]


@lru_cache(maxsize=1)
def run_kernel() -> Any:
    """The compiled run over T blocks."""
    v, m, i = types.float64[::1], types.float64[:, ::1], types.int64[::1]
    found = types.Tuple((types.float64, types.int64, types.int64))
    return compiled(_run, found(v, v, m, m, v, i, v, m, i, m, v, v, v, v, i, v, v))


def _run(
    y: Array, r: Array, h: Array, freed: Array, rest: Array, whole: Array, mean: Array, cov: Array, begun: Array,
    sums: Array, level: Array, std: Array, whitened: Array, statistic: Array, since: Array,
    evidence: Array, excused: Array,
) -> tuple[float, int, int]:  # fmt: skip
    """`windsysid.monitoring.levels.jumps.track`; `mean`, `cov`, `begun`, `sums` and the evidence become those after the
    last block.

    It gives the likelihood, the block that it stopped at, and how many candidates are kept.
    """
    wander, scatter, limit, clip, spacing = rest[0], rest[1], rest[2], rest[3], rest[4]
    tolerated, pull, growth, logarithmic, most_ratio = rest[5], rest[6], rest[7], rest[8], rest[9]
    first, window, before, kept = whole[0], whole[1], whole[2], whole[3]
    gain, cross = np.zeros(h.shape[1]), np.zeros(h.shape[1])
    log_likelihood = 0.0
    for t in range(len(y)):
        cov[0, 0] += wander
        if freed[t, 0] > 0.0:
            kept = 0
            for j in range(h.shape[1]):
                cov[j, j] += freed[t, j]
        if window > 0:
            kept = _add_candidate(begun, sums, kept, before + t)
        if not np.isnan(y[t]):
            innovation, spread = _innovation(t, y, h, mean, cov, cross)
            variance = scatter * r[t]
            if growth != 0.0:
                variance *= _value_ratio(y[t], innovation, logarithmic, most_ratio) ** growth
            variance += spread
            root = math.sqrt(variance)
            z = innovation / root
            whitened[t] = z
            most_of_it = clip + tolerated / root
            small = min(max(z, -most_of_it), most_of_it)
            log_likelihood -= 0.5 * math.log(variance) + 0.5 * small * small + most_of_it * (abs(z) - abs(small))
            rest[10] -= 0.5 * math.log(variance) + 0.5 * small * small
            _correct(min(max(z, -pull), pull) * root, variance, gain, cross, mean, cov)
            _add_innovation(t, h, gain, variance, small / root, sums, kept)
        level[t], evidence[t] = mean[0], rest[10]
        std[t] = math.sqrt(cov[0, 0])
        if window == 0:
            continue
        _test(t, begun, sums, kept, tolerated, statistic, since, excused)
        kept = _thin(begun, sums, kept, before + t, window, spacing)
        if t >= first and statistic[t] > limit:
            return log_likelihood, t, kept
    return log_likelihood, -1, kept


@uncounted
def _add_candidate(begun: Array, sums: Array, kept: int, block: int) -> int:
    for j in range(sums.shape[1]):
        sums[kept, j] = 0.0
    sums[kept, 2] = 1.0
    begun[kept] = block
    return kept + 1


@uncounted
def _innovation(t: int, y: Array, h: Array, mean: Array, cov: Array, cross: Array) -> tuple[float, float]:
    """y_t − hᵀ m and hᵀ P h; `cross` becomes P h."""
    innovation, spread = y[t], 0.0
    for i in range(len(mean)):
        cross[i] = 0.0
        for j in range(len(mean)):
            cross[i] += cov[i, j] * h[t, j]
        innovation -= h[t, i] * mean[i]
        spread += h[t, i] * cross[i]
    return innovation, spread


@uncounted
def _value_ratio(y: float, innovation: float, logarithmic: float, most: float) -> float:
    """The foreseen value over the block's own, 1/`most` … `most`."""
    foreseen, ratio = y - innovation, 1.0
    if logarithmic > 0.0:
        ratio = math.exp(min(max(-innovation, -30.0), 30.0))
    elif foreseen > 0.0:
        ratio = foreseen / max(y, foreseen / most)
    return min(max(ratio, 1.0 / most), most)


@uncounted
def _correct(pulled: float, variance: float, gain: Array, cross: Array, mean: Array, cov: Array) -> None:
    """Mean and covariance after a block; Joseph's form (I − K hᵀ) P (I − K hᵀ)ᵀ + K s² r Kᵀ, written out."""
    for i in range(len(mean)):
        gain[i] = cross[i] / variance
        mean[i] += gain[i] * pulled
    for i in range(len(mean)):
        for j in range(i, len(mean)):
            value = cov[i, j] - gain[i] * cross[j] - cross[i] * gain[j] + gain[i] * gain[j] * variance
            cov[i, j] = value
            cov[j, i] = value


@uncounted
def _add_innovation(
    t: int, h: Array, gain: Array, variance: float, scaled: float, sums: Array, kept: int
) -> None:  # fmt: skip
    """Add a block to the sums of each candidate; `scaled` is the clipped z_t / √S_t."""
    for c in range(kept):
        seen = 0.0
        for j in range(len(gain)):
            seen += h[t, j] * sums[c, 2 + j]
        for j in range(len(gain)):
            sums[c, 2 + j] -= gain[j] * seen
        sums[c, 0] += seen * seen / variance
        sums[c, 1] += seen * scaled


@uncounted
def _test(
    t: int, begun: Array, sums: Array, kept: int, tolerated: float, statistic: Array, since: Array, excused: Array
) -> None:
    """The statistic after a block, its candidate, and what a tolerated jump adds to the likelihood at most."""
    for c in range(kept):
        energy, product = sums[c, 0], sums[c, 1]
        excess = abs(product) - tolerated * energy
        if energy > 0.0 and excess > 0.0 and excess * excess > statistic[t] * energy:
            statistic[t] = excess * excess / energy
            since[t] = begun[c]
        if tolerated > 0.0 and energy > 0.0:
            least = min(tolerated, abs(product) / energy)
            excused[t] = max(excused[t], least * (2.0 * abs(product) - least * energy))


@uncounted
def _thin(begun: Array, sums: Array, kept: int, block: int, window: int, spacing: float) -> int:
    """Keep candidates about `spacing` of their age apart, and no older than `window` by the next block."""
    last = -1
    for c in range(kept):
        age = block - begun[c] + 1
        crowded = last >= 0 and 0 < c < kept - 1 and begun[c + 1] - begun[last] <= spacing * age
        if age >= window or crowded:
            continue
        last += 1
        if last != c:
            begun[last] = begun[c]
            for j in range(sums.shape[1]):
                sums[last, j] = sums[c, j]
    return last + 1

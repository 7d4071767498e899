"""Level and jump statistic averaged over uncertain random-walk rate and scatter.

A watch of a day knows neither. Plugged in as if they were known, a wander that came out too small makes jumps of what
only wanders, and intervals that are too narrow. So each wander q that is likely has a filter of its own (Magill's bank,
or static multiple models), and these say together, with the weights of what they make of the blocks,

    w(q) ∝ p(q) L(q),    level = Σ w m,    variance = Σ w (P + (m − level)²),

    ℓ = 2 ln Σ w′ exp(ℓ(q) / 2),    w′(q) ∝ w(q) exp(a(q) / 2),

where ℓ(q) is twice the logarithm of the ratio of likelihoods with a jump and with a tolerated one, and a(q) what the
tolerated one adds: numerator and denominator are averaged over q, each by itself. What a larger wander explains as well
as a jump does is then none.

A wander's prior is Cauchy's of √q / (s √r): below its scale all are as likely. Compared with a prior of its logarithm
larger ones count for more, and series that wander more than is usual have intervals that are wide enough before it is
seen.

The scatter is known from n blocks only. So variances are those of Student's t, and ℓ becomes n ln(1 + ℓ / n), which
passes a threshold about as often as ℓ does where the scatter is known.

Source: Magill, IEEE Trans. AC-10(4), 1965, https://doi.org/10.1109/TAC.1965.1098191.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.monitoring.levels.jumps import INNOVATION_LIMIT_SIGMAS, LevelBelief, Observations, Rates, Track, track
from windsysid.monitoring.levels.learning import LOG_SCATTER_STD, MEAN_SQUARED_SCATTER

__all__ = ["Together", "most_likely_begin", "together", "with_likely"]

RANDOM_WALK_RATIOS = np.geomspace(3e-4, 2.0, 18)
"""Of √q / (s √r), each 1.7 times the one before."""

RANDOM_WALK_SCALE = 0.1
"""Scale of their prior."""

MIN_RELATIVE_LIKELIHOOD = 1e-6
"""A random-walk rate that is less likely than this, relative to the likeliest, has no filter."""

PRIOR_BLOCKS = round(0.5 / LOG_SCATTER_STD**2)
"""Blocks that tell a scatter as well as its prior does."""


class Together(NamedTuple):
    """Level, its standard deviation, and the statistic of the test for a jump, after each block (T,)."""

    level: Array
    std: Array
    statistic: Array


def with_likely(blocks: Observations, prior: LevelBelief, rates: Rates) -> Rates:
    """These rates, and the random-walk rates that are likely after the blocks, each with its best scatter.

    Arguments are those of `windsysid.monitoring.levels.learning.learn_rates`; of the rates the scatter is where it
    begins.
    """
    there = np.isfinite(blocks.y)
    usual, count = float(np.median(blocks.r[there])), int(there.sum())
    found, evidence = [], []
    for share in RANDOM_WALK_RATIOS:
        one = rates._replace(wander=usual * rates.scatter * share**2, likely=())
        whitened = track(blocks, prior, one, test=False).whitened
        squares = np.minimum(whitened[np.isfinite(whitened)] ** 2, INNOVATION_LIMIT_SIGMAS**2)
        scatter = (rates.scatter * float(squares.sum()) + PRIOR_BLOCKS * MEAN_SQUARED_SCATTER) / (count + PRIOR_BLOCKS)
        one = one._replace(wander=usual * scatter * share**2, scatter=scatter)
        chance = math.log(share / (1.0 + (share / RANDOM_WALK_SCALE) ** 2))
        found.append((one.wander, one.scatter, chance))
        evidence.append(chance + float(track(blocks, prior, one, test=False).evidence[-1]))
    least = max(evidence) + math.log(MIN_RELATIVE_LIKELIHOOD)
    likely = tuple(one for one, of in zip(found, evidence, strict=True) if of >= least)
    return rates._replace(likely=likely, learned_from=count)


def together(tracks: Sequence[Track], rates: Rates, newest: int = 0) -> Together:
    """State of the tracks with all `hypotheses` of these rates, in their order, averaged over the same T blocks.

    With `newest`, after so many of the newest blocks alone: to the same bits, whatever came with them in the tracks.
    """
    level, std, statistic, excused = (
        np.array([getattr(one, name)[-newest:] for one in tracks]) for name in ("level", "std", "statistic", "excused")
    )
    evidence = _evidence(tracks, rates)[:, -newest:].copy()
    weight = np.exp(evidence - evidence.max(axis=0))
    weight /= weight.sum(axis=0)
    mean = (weight * level).sum(axis=0)
    variance = (weight * (std**2 + (level - mean) ** 2)).sum(axis=0)
    tolerated = evidence + 0.5 * excused
    jumped = np.maximum(2.0 * (_log_sum(tolerated + 0.5 * statistic) - _log_sum(tolerated)), 0.0)
    if rates.learned_from:
        blocks = rates.learned_from + PRIOR_BLOCKS
        variance *= blocks / (blocks - 2)
        jumped = blocks * np.log1p(jumped / blocks)
    return Together(mean, np.sqrt(variance), jumped)


def most_likely_begin(tracks: Sequence[Track], rates: Rates) -> int:
    """Likeliest block of a jump after the last block, by the likeliest random-walk rate."""
    jumped = _evidence(tracks, rates)[:, -1] + [0.5 * one.statistic[-1] for one in tracks]
    return int(tracks[int(np.argmax(jumped))].since[-1])


def _evidence(tracks: Sequence[Track], rates: Rates) -> Array:
    priors = np.array([[prior] for _, prior in rates.hypotheses()])
    return np.asarray(np.array([one.evidence for one in tracks]) + priors, dtype=np.float64)


def _log_sum(of: Array) -> Array:
    top = of.max(axis=0)
    return np.asarray(top + np.log(np.exp(of - top).sum(axis=0)), dtype=np.float64)

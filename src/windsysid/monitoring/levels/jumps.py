"""Random-walk level with jumps, observed in blocks through covariates: Kalman filter and generalised likelihood ratio.

    y_t = level_t + slopes · x_t + e_t,    e_t ~ N(0, s² r_t),    level_t = level_{t−1} + w_t,    w_t ~ N(0, q),

with the variance r_t of the block's own estimate, a factor s² on it and a rate q that are learned (`learn_rates`). A
unit jump before block k leaves the trace G_t(k) = h_tᵀ e_t(k) / √S_t on the whitened innovations z_t, where e_k(k) =
(1, 0 … 0) and e_{t+1}(k) = (I − K_t h_tᵀ) e_t(k). The statistic is that of Willsky & Jones,

    ℓ_t = max_k  (|Σ G z| − ν₀ Σ G²)₊² / Σ G²,

twice the logarithm of a likelihood ratio: a jump of the likeliest size before the likeliest block, against no jump or
one of the tolerated size ν₀. In the test an innovation counts as ν₀ and `INNOVATION_LIMIT_SIGMAS` standard deviations
at most, and it pulls at the level with `PULL_LIMIT_SIGMAS` at most. A bad block alone is therefore no alarm: to pass a
threshold of b² it takes more than b² / `INNOVATION_LIMIT_SIGMAS`² blocks. The blocks k that are kept are about
`CANDIDATE_SPACING` of their age apart, up to an age of `MAX_JUMP_AGE_BLOCKS` blocks. Missing blocks are NaN.

`threshold` turns a rate of false alarms into b²: Siegmund and Venkatraman's approximation for white innovations, every
k, no clipping and ν₀ = 0, compared with which there are fewer.

The variance of a damping grows with the damping that its block found: low estimates have narrow bands, and a
level that weighs blocks by these comes out low, by more σ the more blocks there are. Where it does so by a power that
is learned, r_t ∝ y_t^g, it is taken at the level that is foreseen, r_t (hᵀ m / y_t)^g.

Sources: Willsky & Jones, IEEE Trans. AC-21(1), 1976, https://doi.org/10.1109/TAC.1976.1101146; Lai, IEEE Trans.
IT-44(7), 1998, https://doi.org/10.1109/18.737522; Siegmund & Venkatraman, Ann. Statist. 23(1), 1995,
https://doi.org/10.1214/aos/1176324466; Huber, Ann. Math. Statist. 35(1), 1964, https://doi.org/10.1214/aoms/1177703732.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array

__all__ = [
    "INNOVATION_LIMIT_SIGMAS", "MAX_JUMP_AGE_BLOCKS", "LevelBelief", "Observations", "Progress", "Rates", "Track",
    "shared_error", "threshold", "track",
]  # fmt: skip


INNOVATION_LIMIT_SIGMAS = 3.0
"""Standard deviations beyond ν₀ that one innovation may count for in the test and in the likelihood."""

PULL_LIMIT_SIGMAS = 1.5
"""Standard deviations beyond which an innovation's pull on the level is cut off.

This is Huber's estimator, 96 % efficient where there are no bad blocks.
"""

MAX_JUMP_AGE_BLOCKS = 12_960
"""Blocks that a jump may lie back when it is found: 90 days of 10 minutes."""

CANDIDATE_SPACING = 0.1
"""Distance of the blocks k that are kept, as a share of their age."""

MAX_CANDIDATES = 400
"""More blocks k than `MAX_JUMP_AGE_BLOCKS` and `CANDIDATE_SPACING` ever keep."""

MAX_VALUE_RATIO = 4.0
"""Factor between a block and the level beyond which the variance of the block is moved no further."""


class LevelBelief(NamedTuple):
    """Mean (d,) and covariance (d, d) of [level, slopes]."""

    mean: Array
    cov: Array


class Observations(NamedTuple):
    """T blocks of one series.

    Attributes
    ----------
    y, r, x
        Values (T,), NaN where one is missing, their variances (T,), and covariates (T, m).
    freed
        (T, 1 + m): variance that level and slopes gain before a block where the level is known to have jumped, 0
        otherwise. Earlier jumps are no longer searched for.
    """

    y: Array
    r: Array
    x: Array
    freed: Array

    @classmethod
    def of(cls, y: Array, r: Array, x: Array) -> "Observations":
        """Blocks of a level that is not known to have jumped."""
        return cls(y, r, x, np.zeros((len(y), 1 + x.shape[1])))

    def part(self, at: slice) -> "Observations":
        """Some of the blocks."""
        return Observations(self.y[at], self.r[at], self.x[at], self.freed[at])


class Rates(NamedTuple):
    """Variance q that a level gains per block, and the estimate of the variance of its blocks.

    Attributes
    ----------
    wander
        q.
    scatter
        The factor s² on the variance.
    growth
        The power g of a block's value with which its variance grows.
    logarithmic
        Whether blocks are logarithms of values; of use only with a growth.
    likely
        Wanders that q may be, the scatter with each, and the logarithm of its prior, which has no norm
        (`windsysid.monitoring.levels.together`).
    learned_from
        Number of blocks in the estimate of the scatter.
    """

    wander: float
    scatter: float
    growth: float = 0.0
    logarithmic: bool = True
    likely: Sequence[Sequence[float]] = ()
    learned_from: int = 0

    def hypotheses(self) -> list[tuple["Rates", float]]:
        """These rates with each of the likely random-walk rates and scatters, and the logarithm of its prior."""
        plain = self._replace(likely=())
        return [(plain._replace(wander=q, scatter=s2), prior) for q, s2, prior in self.likely] or [(plain, 0.0)]


class Progress(NamedTuple):
    """State of a track: all that is needed to continue as if there had been no end.

    Attributes
    ----------
    belief
        After the last block.
    blocks
        How many were taken in.
    begun
        Blocks k that are kept (c,), counted from the first of all.
    sums
        Of each of them Σ G², Σ G z and the trace e(k) (c, 2 + d).
    evidence
        Of all blocks (`Track`).
    """

    belief: LevelBelief
    blocks: int
    begun: NDArray[np.int64]
    sums: Array
    evidence: float = 0.0


class Track(NamedTuple):
    """Results of the filter and the test on T blocks.

    Attributes
    ----------
    level, std
        The level after each block and its standard deviation (T,).
    whitened
        Innovations in their standard deviations, not clipped (T,); NaN where a block is missing.
    statistic
        ℓ_t (T,).
    since
        The block k of the maximum (T,), counted from the first of all that were taken in; −1 where there is none.
    evidence
        Logarithm of the likelihood of all blocks so far (T,), where an innovation counts for `INNOVATION_LIMIT_SIGMAS`
        at most, as in the test.
    excused
        Twice what a jump of the tolerated size or less adds to it at most (T,).
    log_likelihood
        Of the innovations, Huber's beyond `INNOVATION_LIMIT_SIGMAS`.
    stopped
        The first block, from `first` on, whose statistic passed the threshold; −1 if none did.
    progress
        What another track goes on from.
    """

    level: Array
    std: Array
    whitened: Array
    statistic: Array
    since: NDArray[np.int64]
    evidence: Array
    excused: Array
    log_likelihood: float
    stopped: int
    progress: Progress

    @property
    def belief(self) -> LevelBelief:
        """After the last block that was taken in."""
        return self.progress.belief


def track(
    blocks: Observations, prior: LevelBelief | Progress, rates: Rates, *, limit: float = math.inf,
    tolerated: float = 0.0, first: int = 0, test: bool = True,
) -> Track:  # fmt: skip
    """Follow a level through T blocks and test for a jump.

    Parameters
    ----------
    blocks
        T of them, with m covariates.
    prior, rates
        Of [level, slopes] before the first block, d = 1 + m; or how far a track came that goes on: T blocks one by one
        give what they give together.
    limit, first
        Stop at the first block from `first` on with ℓ_t above `limit`.
    tolerated
        ν₀.
    test
        Whether ℓ is required.
    """
    y, r, x, freed = blocks
    count = len(y)
    level, std, whitened = np.full((3, count), np.nan)
    statistic, excused, evidence = np.zeros((3, count))
    since = np.full(count, -1, dtype=np.int64)
    h = np.column_stack([np.ones(count), x])
    before = prior if isinstance(prior, Progress) else Progress(prior, 0, *_no_candidates(h.shape[1]))
    mean, cov = before.belief.mean.copy(), np.ascontiguousarray(before.belief.cov.copy())
    kept = len(before.begun)
    begun, sums = np.empty(MAX_CANDIDATES, dtype=np.int64), np.empty((MAX_CANDIDATES, 2 + h.shape[1]))
    begun[:kept], sums[:kept] = before.begun, before.sums
    rest = np.array(
        [rates.wander, rates.scatter, limit, INNOVATION_LIMIT_SIGMAS, CANDIDATE_SPACING, tolerated, PULL_LIMIT_SIGMAS,
         rates.growth, float(rates.logarithmic), MAX_VALUE_RATIO, before.evidence]
    )  # fmt: skip
    whole = np.array([first, MAX_JUMP_AGE_BLOCKS if test else 0, before.blocks, kept], dtype=np.int64)
    from windsysid.monitoring.levels.jump_kernel import run_kernel

    log_likelihood, stopped, kept = run_kernel()(
        y, r, h, freed, rest, whole, mean, cov, begun, sums, level, std, whitened, statistic, since, evidence, excused
    )
    taken = before.blocks + (count if stopped < 0 else stopped + 1)
    progress = Progress(LevelBelief(mean, cov), taken, begun[:kept].copy(), sums[:kept].copy(), float(rest[-1]))
    return Track(level, std, whitened, statistic, since, evidence, excused, log_likelihood, stopped, progress)


def _no_candidates(d: int) -> tuple[NDArray[np.int64], Array]:
    return np.empty(0, dtype=np.int64), np.empty((0, 2 + d))


def shared_error(level: float, y: Array, r: Array, rates: Rates) -> float:
    """Common part of the errors of blocks (T,), as a standard deviation, in filter coordinates.

    An estimate with the relative standard deviation ς is Gaussian to first order only. Its mean has a relative bias of
    the order ς², which is equal in all blocks, so that averaging over blocks does not reduce it.
    """
    there = np.isfinite(y)
    if not there.any():
        return 0.0
    usual = rates.scatter * float(np.median(r[there]))
    std = math.sqrt(usual)
    return min(std, usual if rates.logarithmic else usual / max(abs(level), std))


@lru_cache(maxsize=64)
def threshold(rate: float) -> float:
    """The b² that ℓ_t passes `rate` times per block where nothing jumps: b φ(b) ∫ x ν(x)² dx = rate.

    Jumps may lie back 1 to `MAX_JUMP_AGE_BLOCKS` blocks, which bounds the integral to b/√MAX_JUMP_AGE_BLOCKS … b.
    """
    from scipy.integrate import quad
    from scipy.optimize import brentq
    from scipy.stats import norm

    def nu(x: float) -> float:  # Siegmund's function of the overshoot
        half = 0.5 * x
        return float((norm.cdf(half) - 0.5) / half / (half * norm.cdf(half) + norm.pdf(half)))

    def excess(b: float) -> float:
        integral = quad(lambda x: x * nu(x) ** 2, b / math.sqrt(MAX_JUMP_AGE_BLOCKS), b)[0]
        return math.log(b * norm.pdf(b) * integral / rate)

    return float(brentq(excess, 1.0, 30.0)) ** 2

"""A series followed while its blocks come: level, rates and jumps from a state of fixed size.

What a follower keeps are its last `MAX_KEPT_BLOCKS` blocks, the belief before the first of them, two rates, and the
jumps among them. All else follows from these: the filter and the test of `windsysid.monitoring.levels.jumps` run from
that belief through those blocks, one by one as they come or at once after a restart, to the same bits.

The first `learn` blocks are learned from. Rates are learned from them, again whenever there are twice as many, and from
`MAX_KEPT_BLOCKS` on whenever `DROPPED_BLOCKS` more have come: these then leave, and the belief before them becomes the
one after them. A jump is looked for as far back as blocks are kept. It is dated and measured when it is found, and
again when `HINDSIGHTS` more blocks have come.

A watch over records (`windsysid.monitoring.watch`) knows all blocks at once: its rates, its covariates and its dates
use what comes later. It shares the filter, the test, the learning of rates and the measuring, not the order.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.monitoring.levels.jumps import LevelBelief, Observations, Progress, Rates, Track, shared_error, track
from windsysid.monitoring.levels.learning import MEAN_SQUARED_SCATTER, learn_growth, learn_rates
from windsysid.monitoring.levels.locating import (
    JUMP_SLOPE_PRIOR,
    MAX_HINDSIGHT_BLOCKS,
    SLOPE_PRIOR,
    Jump,
    first_belief,
    freedom,
    locate,
    without_bad,
)
from windsysid.monitoring.levels.together import most_likely_begin, together, with_likely

__all__ = ["DROPPED_BLOCKS", "HINDSIGHTS", "MAX_KEPT_BLOCKS", "Kept", "LevelFollower", "Now"]

MAX_KEPT_BLOCKS = 4032
"""Blocks that are kept: four weeks of 10 minutes."""

DROPPED_BLOCKS = 1008
"""Blocks that leave at once where more would be kept: a week."""

HINDSIGHTS = (12, MAX_HINDSIGHT_BLOCKS)
"""Blocks after which a jump is dated and measured again: two hours and a day."""

MAX_JUMPS = 16
"""Largest number of jumps among the blocks that are kept; then no more are searched for until the first has left."""

Ring = NDArray[np.float32]


class Now(NamedTuple):
    """State of a series after a block, in filter coordinates.

    Attributes
    ----------
    level, std
        At mean covariates; the standard deviation is that of a change of the level.
    shared
        What its blocks are off by together (`windsysid.monitoring.levels.jumps.shared_error`), which no change shows.
    statistic
        Of the test for a jump; 0 while learning.
    new, again
        The jump that this block set off; jumps that were measured again, by the block that found them.
    """

    level: float
    std: float
    shared: float
    statistic: float
    new: Jump | None = None
    again: tuple[Jump, ...] = ()


class Kept(NamedTuple):
    """All that a follower is.

    Attributes
    ----------
    y, std
        Blocks (n,) and their standard deviations; NaN where there is none.
    let_go
        How many came before them: blocks are counted from the first of all.
    before
        Belief before them; None until rates were learned.
    rates
        None until then.
    scale
        What a relative change is of.
    jumps
        Among the blocks, in their order.
    """

    y: Ring
    std: Ring
    let_go: int
    before: LevelBelief | None
    rates: Rates | None
    scale: float
    jumps: tuple[Jump, ...]


class LevelFollower:
    """One series: it changes with every block.

    Parameters
    ----------
    kind
        ``k``, ``c``, ``f`` or ``noise``.
    logarithmic
        Whether θ is a logarithm.
    tolerated
        Relative jumps up to this size are no alarm.
    kept
        To go on from, or `beginning`.
    """

    def __init__(self, kind: str, logarithmic: bool, tolerated: float, kept: Kept) -> None:
        self.kind, self.logarithmic, self.tolerated = kind, logarithmic, tolerated
        self.kept = kept
        self._heads: list[Progress] = []  # of each likely wander; follow from what is kept, when they are needed

    @staticmethod
    def beginning(blocks: int, let_go: int) -> Kept:
        """Series without data in so many blocks that are kept, and so many before."""
        nothing = np.full(blocks, np.nan, dtype=np.float32)
        return Kept(nothing, nothing, let_go, None, None, 1.0, ())

    @property
    def known(self) -> int:
        """Number of kept blocks with information."""
        return int(np.isfinite(self.kept.y).sum())

    def append(self, y: float, std: float) -> None:
        """Process a block; NaN without information. One of `learn`, `follow` and `guess` must come before the next."""
        with np.errstate(over="ignore", under="ignore"):
            block = np.array([y, std], dtype=np.float32)
        if not (np.isfinite(block).all() and block[1] > 0.0):
            block[:] = np.nan
        self.kept = self.kept._replace(y=np.append(self.kept.y, block[0]), std=np.append(self.kept.std, block[1]))

    def guess(self) -> Now:
        """State of the series before any rates were learned: without effect of covariates."""
        y, r = self._blocks()
        if not np.isfinite(y).any():
            return Now(math.nan, math.nan, 0.0, 0.0)
        blocks = Observations.of(y, r, np.empty((len(y), 0)))
        prior, _ = first_belief(y, r, 0, self.kind, self.logarithmic)
        growth = learn_growth(y, r, self.logarithmic) if self.kind == "c" else 0.0
        rates = with_likely(blocks, prior, Rates(0.0, MEAN_SQUARED_SCATTER, growth, self.logarithmic))
        return self._now([track(blocks, prior, one, test=False) for one, _ in rates.hypotheses()], rates)

    def learn(self, x: Array, *, anew: bool) -> Now:
        """Learn the rates from the blocks that are kept, with covariates x (n, m).

        Parameters
        ----------
        anew
            Whether the belief before them is learned as well: always the first time, and where x has other columns.
        """
        y, r = self._blocks(x)
        before, scale = self.kept.before, self.kept.scale
        if not np.isfinite(y).any():
            return self.guess() if before is None else self._stands(x)
        if anew or before is None:
            before, scale = first_belief(y, r, x.shape[1], self.kind, self.logarithmic)
        rates = self.kept.rates or Rates(0.0, 1.0, logarithmic=self.logarithmic)
        self.kept = self.kept._replace(before=before, scale=scale, rates=rates)
        blocks = self._cleared(x)
        rates = learn_rates(blocks, before, kind=self.kind, logarithmic=self.logarithmic)
        self.kept = self.kept._replace(rates=with_likely(blocks, before, rates))
        return self._stands(x)

    def wander_beside_trend(self, x: Array) -> float:
        """Random-walk rate that is learned if the level may also follow a straight line, with covariates x (n, m).

        A steady drift is a wander to `learn`, which explains it; here it is none.
        """
        kept = self.kept
        if kept.before is None or kept.rates is None or not np.isfinite(kept.y).any():
            return 0.0
        y, r, x, freed = self._cleared(x)
        trend = np.column_stack([x, np.linspace(0.0, 1.0, len(y))])
        d = trend.shape[1]
        cov = np.zeros((d + 1, d + 1))
        cov[:d, :d], cov[d, d] = kept.before.cov, (SLOPE_PRIOR[self.kind] * kept.scale) ** 2
        before = LevelBelief(np.append(kept.before.mean, 0.0), cov)
        blocks = Observations(y, r, trend, np.column_stack([freed, np.zeros(len(y))]))
        return learn_rates(blocks, before, kind=self.kind, logarithmic=self.logarithmic).wander

    def newest_level(self, x: Array, count: int) -> tuple[float, float]:
        """The level by the last `count` blocks alone, and its standard deviation, with covariates x (n, m).

        Where it drifts, the level that is followed lags behind.
        """
        kept = self.kept
        assert kept.before is not None
        assert kept.rates is not None
        blocks = self._cleared(x)
        blocks.freed[-min(count, len(blocks.y)), 0] = (3.0 * JUMP_SLOPE_PRIOR[self.kind] * kept.scale) ** 2
        done = track(blocks, kept.before, kept.rates, test=False)
        return float(done.level[-1]), float(done.std[-1])

    def let_go(self, x: Array, count: int) -> None:
        """Forget the first `count` of the blocks, with covariates x (n, m), but not their statistics."""
        kept, before = self.kept, self.kept.before
        if before is not None and kept.rates is not None:
            before = track(self._cleared(x).part(slice(count)), before, kept.rates, test=False).belief
        self._heads = []
        first = kept.let_go + count
        self.kept = kept._replace(
            y=kept.y[count:], std=kept.std[count:], let_go=first, before=before,
            jumps=tuple(jump for jump in kept.jumps if jump.latest >= first),
        )  # fmt: skip

    def follow(self, newest: Array, covariates: Callable[[], Array], limit: float) -> Now:
        """Take in the newest block, with its covariates (1, m); test it against `limit`.

        Parameters
        ----------
        covariates
            Gives those of all blocks that are kept (n, m), where they are needed.
        """
        if self.kept.rates is None:
            return self.guess()
        if not self._heads:
            done = self._restart(covariates())
        else:
            block = Observations.of(*self._blocks(newest, 1), newest)
            rates, least = self.kept.rates.hypotheses(), self.tolerated * self.kept.scale
            done = [track(block, head, one, tolerated=least) for head, (one, _) in zip(self._heads, rates, strict=True)]
            self._heads = [one.progress for one in done]
        again = self._look_back(covariates)
        if again:
            done = self._restart(covariates())
        now = self._now(done, self.kept.rates)._replace(again=again)
        if now.statistic <= limit or len(self.kept.jumps) == MAX_JUMPS:
            return now
        x = covariates()
        likely = most_likely_begin(done, self.kept.rates)
        jump = self._locate(x, len(self.kept.y) - 1, likely, len(self.kept.y), self.kept.jumps)
        self.kept = self.kept._replace(jumps=(*self.kept.jumps, jump))
        after = self._stands(x)
        return now._replace(level=after.level, std=after.std, new=jump)

    # what follows from what is kept

    def _blocks(self, x: Array | None = None, newest: int = 0) -> tuple[Array, Array]:
        """Blocks and variances as `track` takes them; with x, none of those that lack a covariate."""
        part = slice(-newest if newest else None, None)
        y, std = self.kept.y[part].astype(np.float64), self.kept.std[part].astype(np.float64)
        if x is not None:
            y[~_told(x[-len(y) :])] = np.nan
        return y, np.where(np.isfinite(y), std, 1.0) ** 2

    def _cleared(self, x: Array, jumps: tuple[Jump, ...] | None = None) -> Observations:
        """Blocks without those that are bad or ambiguous near a jump."""
        assert self.kept.rates is not None
        return self._run(x, self.kept.rates, jumps)[1]

    def _run(self, x: Array, rates: Rates, jumps: tuple[Jump, ...] | None = None) -> tuple[Track, Observations]:
        """Filter and test through all blocks, and the blocks of `_cleared`."""
        kept = self.kept
        assert kept.before is not None
        y, r = self._blocks(x)
        blocks = Observations.of(y, r, np.where(_told(x)[:, None], x, 0.0))
        past: LevelBelief | Progress = kept.before
        begin = 0
        size, least = JUMP_SLOPE_PRIOR[self.kind] * kept.scale, self.tolerated * kept.scale
        jumps = kept.jumps if jumps is None else jumps
        for jump in jumps:
            earliest, latest, found = (max(0, at - kept.let_go) for at in (jump.earliest, jump.latest, jump.found))
            near = slice(max(0, earliest - MAX_HINDSIGHT_BLOCKS), found + 1)
            y[near] = without_bad(y[near], rates.scatter * r[near])
            y[earliest:latest] = np.nan  # it is not known on which side these are
        for jump in jumps:
            end = max(begin, jump.latest - kept.let_go)
            if end > begin:
                past = track(blocks.part(slice(begin, end)), past, rates, tolerated=least).progress
            mean = (past.belief if isinstance(past, Progress) else past).mean
            blocks.freed[end], begin = freedom(mean, size, kept.scale), end
        return track(blocks.part(slice(begin, None)), past, rates, tolerated=least), blocks

    def _now(self, done: Sequence[Track], rates: Rates) -> Now:
        """State averaged over all likely random-walk rates after the newest block."""
        level, std, statistic = (float(one[-1]) for one in together(done, rates, newest=1))
        return Now(level, std, shared_error(level, *self._blocks(), rates), statistic)

    def _stands(self, x: Array) -> Now:
        assert self.kept.rates is not None
        return self._now(self._restart(x), self.kept.rates)

    def _restart(self, x: Array) -> list[Track]:
        assert self.kept.rates is not None
        done = [self._run(x, one)[0] for one, _ in self.kept.rates.hypotheses()]
        self._heads = [one.progress for one in done]
        return done

    def _look_back(self, covariates: Callable[[], Array]) -> tuple[Jump, ...]:
        """Measure again the jumps for which a `HINDSIGHTS` is over."""
        again = []
        count = self.kept.let_go + len(self.kept.y)
        for i, jump in enumerate(self.kept.jumps):
            if count - 1 - jump.found not in HINDSIGHTS or jump.earliest <= self.kept.let_go:
                continue
            others = self.kept.jumps[:i] + self.kept.jumps[i + 1 :]
            later = min((other.earliest for other in others if other.found > jump.found), default=count)
            end = max(later, jump.found + 1) - self.kept.let_go
            found, likely = jump.found - self.kept.let_go, jump.at - self.kept.let_go
            measured = self._locate(covariates(), found, likely, end, tuple(o for o in others if o.found < jump.found))
            self.kept = self.kept._replace(jumps=(*self.kept.jumps[:i], measured, *self.kept.jumps[i + 1 :]))
            again.append(measured)
        return tuple(again)

    def _locate(self, x: Array, found: int, likely: int, end: int, jumps: tuple[Jump, ...]) -> Jump:
        """Date and measure a jump by the blocks before `end`, given the jumps before it."""
        kept = self.kept
        assert kept.before is not None
        assert kept.rates is not None
        blocks, size = self._cleared(x, jumps).part(slice(end)), JUMP_SLOPE_PRIOR[self.kind] * kept.scale
        jump = locate(blocks, kept.before, kept.rates, found, likely, size, kept.scale)
        first = kept.let_go
        return jump._replace(
            at=jump.at + first, earliest=jump.earliest + first, latest=jump.latest + first, found=jump.found + first
        )


def _told(x: Array) -> NDArray[np.bool_]:
    """Blocks (n,) with all covariates (n, m)."""
    return np.asarray(np.isfinite(x).all(axis=1), dtype=bool)

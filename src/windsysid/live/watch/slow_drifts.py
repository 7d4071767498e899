"""Slow drift: a level that differs significantly from that of weeks or months ago, though there was no jump.

Whenever a week leaves the windows that are kept, the level after it may become a reference: one in `MAX_KEPT_BLOCKS`
windows, `MAX_REFERENCES` of them, of which the oldest leaves. Once in `TEST_EVERY_BLOCKS` windows the level l is held
against each reference l₀,

    z = (|l − l₀| − ν₀)₊ / √(σ² + σ₀² + δ² + Σ q),

with the variances of both, what the errors of windows share (δ), the tolerated size ν₀, and the sum of the wander q of
all windows between. That wander is learned again whenever a week leaves, with a straight line: the wander that a
level is followed with would explain the drift that is looked for. Where nothing changes but by that wander, z is a
standard normal at most. `limit_of` gives the z that all tests of all series of a year pass as often as stated, by
Bonferroni's bound: they are far from independent, so there are fewer.

The coordinates of a level are those of learned covariates, which stay as they are once windows have left. A jump takes
all references of its series away: what was before it says nothing of a drift after it.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from windsysid.monitoring.levels.following import MAX_KEPT_BLOCKS, Kept, Now
from windsysid.monitoring.levels.locating import Jump
from windsysid.monitoring.watch import YEAR
from windsysid.results.posterior import SIGMAS

__all__ = [
    "TEST_EVERY_BLOCKS", "DriftReference", "Drifted", "Past", "drifted_since", "grew", "limit_of", "past_of",
    "remembered",
]  # fmt: skip

MAX_REFERENCES = 13
"""With four weeks between them: a year."""

TEST_EVERY_BLOCKS = 144
"""A day of 10 minutes."""

MIN_GROWTH_FACTOR = 1.5
"""Factor on a drift, by the whole of its 95 % interval, from which on an alarm says it anew."""


class DriftReference(NamedTuple):
    """A level that was.

    Attributes
    ----------
    block
        Of how many windows it was the level.
    time
        When the next one began [ns since 1970].
    level, std
        In filter coordinates.
    wandered
        Sum of the wander of all windows before.
    """

    block: int
    time: int
    level: float
    std: float
    wandered: float


class Past(NamedTuple):
    """State of a series from windows that have left the memory.

    Attributes
    ----------
    references
        In their order.
    wandered
        Sum of the wander of the windows that have left since it was first learned.
    wander
        Random walk of a window, learned last together with a straight line.
    """

    references: tuple[DriftReference, ...] = ()
    wandered: float = 0.0
    wander: float = 0.0


class Drifted(NamedTuple):
    """Drift, as a jump from the reference to now, and the random walk of the level meanwhile.

    Attributes
    ----------
    jump
        ``before`` is the reference's level; the standard deviation is that of the difference.
    time
        Of the reference [ns since 1970].
    wander
        Standard deviation, in filter coordinates.
    z
        The test's statistic.
    """

    jump: Jump
    time: int
    wander: float
    z: float


def remembered(past: Past, kept: Kept, left: int, time: int, wander: float) -> Past:
    """State after `left` windows have left; the first that remains began at `time`.

    Parameters
    ----------
    wander
        As it was learned now.
    """
    wandered = past.wandered + left * past.wander
    last = past.references[-1].block if past.references else -MAX_KEPT_BLOCKS
    references = past.references
    if kept.let_go - last >= MAX_KEPT_BLOCKS and kept.before is not None and not kept.jumps:
        level, std = float(kept.before.mean[0]), math.sqrt(float(kept.before.cov[0, 0]))
        references = (*references, DriftReference(kept.let_go, time, level, std, wandered))[-MAX_REFERENCES:]
    return Past(references, wandered, wander)


def drifted_since(reference: DriftReference, past: Past, now: Now, kept: Kept, tolerated: float) -> Drifted:
    """Drift of a series since a reference; `tolerated` is relative."""
    newest = kept.let_go + len(kept.y) - 1
    size, std = now.level - reference.level, math.hypot(now.std, reference.std, now.shared)
    wander = math.sqrt(past.wandered - reference.wandered + past.wander * len(kept.y))
    z = (abs(size) - tolerated * kept.scale) / math.hypot(std, wander)
    jump = Jump(newest, reference.block, newest, newest, size, std, reference.level)
    return Drifted(jump, reference.time, wander, z)


def past_of(plain: Sequence[Any]) -> Past:
    """From plain values, as a checkpoint has them."""
    references, *rest = plain
    return Past(tuple(DriftReference(*one) for one in references), *rest)


def grew(before: Jump, jump: Jump) -> bool:
    """Check whether a drift has grown by half since it was reported."""
    return abs(jump.size) - SIGMAS * jump.std >= MIN_GROWTH_FACTOR * abs(before.size)


@lru_cache(maxsize=64)
def limit_of(alarms_per_year: float, window: float, series: int) -> float:
    """Threshold z that tests of so many series exceed so often in a year, at most, if nothing drifts."""
    from scipy.stats import norm

    tests = max(1, series) * MAX_REFERENCES * YEAR / (TEST_EVERY_BLOCKS * window)
    return float(norm.isf(min(0.5, 0.5 * alarms_per_year / tests)))

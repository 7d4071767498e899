"""Date and size of a jump of a level, for a watch over records and for one on line.

Jumps of level and slopes are more coefficients of the regression, tried before each block where they may have happened:
their likelihoods are when, their mixture is how much.
"""

import math
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.monitoring.change import MIN_CHANGE_ODDS
from windsysid.monitoring.levels.jumps import LevelBelief, Observations, Rates, track
from windsysid.monitoring.levels.learning import learn_rates
from windsysid.results.posterior import SIGMAS

__all__ = [
    "JUMP_SLOPE_PRIOR", "MAX_HINDSIGHT_BLOCKS", "SLOPE_PRIOR", "Jump", "first_belief", "freedom", "jump_while_learning",
    "locate", "without_bad",
]  # fmt: skip

SLOPE_PRIOR = {"k": 0.05, "f": 0.025, "c": 0.5, "noise": 0.5}
"""Relative prior standard deviation of a covariate's effect: on stiffness (and anything else), frequency, damping,
noise.

The effect is that of one standard deviation of the covariate.
"""

JUMP_SLOPE_PRIOR = {"k": 0.3, "f": 0.15, "c": 1.0, "noise": 1.0}
"""Prior standard deviation of a jump's change of covariate effects, relative, and a third of its own."""

OUTLIER_SIGMAS = 5.0
"""Standard deviations from the median of five beyond which a block near a jump is left out.

It would be taken for the new level.
"""

MAX_JUMP_PLACES = 200
"""Blocks at which a jump is tried, where it may have happened before any of more."""

MAX_HINDSIGHT_BLOCKS = 144
"""Blocks after an alarm, where there are any, that help to tell when and how much: a day."""

MIN_LEVEL_BLOCKS = 3
"""Setting: blocks that a level has at least before and after a jump while rates are learned: one bad block is none."""

MIN_WALK_SHARE = 1e-4
"""Setting: share of the learned random-walk rate with which the likeliest block of a jump is searched for, as the
learned rate includes the jump."""

CENTRE_BLOCKS = 25
"""Blocks whose median is where a level is looked for."""


class Jump(NamedTuple):
    """A jump in filter coordinates.

    Attributes
    ----------
    at, earliest, latest, found
        The likeliest block, the interval of blocks, the block that found it.
    size, std, before
        How much, its standard deviation, and the level before.
    """

    at: int
    earliest: int
    latest: int
    found: int
    size: float
    std: float
    before: float


def first_belief(y: Array, r: Array, slopes: int, kind: str, logarithmic: bool) -> tuple[LevelBelief, float]:
    """Of level and slopes before the first of blocks (T,) with variances (T,); and what a relative change is of.

    At least one block must be known.
    """
    there = np.isfinite(y)
    centre = float(np.median(y[there][:CENTRE_BLOCKS]))
    usual = math.sqrt(float(np.median(r[there])))
    scale = 1.0 if logarithmic else max(abs(centre), usual)
    spread = np.append((10.0 * usual) ** 2, np.full(slopes, (SLOPE_PRIOR[kind] * scale) ** 2))
    return LevelBelief(np.append(centre, np.zeros(slopes)), np.diag(spread)), scale


def locate(
    blocks: Observations, prior: LevelBelief, rates: Rates, found: int, likely: int, jump: float, scale: float
) -> Jump:
    """Date and measure a jump that block `found` of blocks (T,) set off, and that lies before block `likely` or so.

    Parameters
    ----------
    blocks, prior, rates
        As `windsysid.monitoring.levels.jumps.track` takes them. Blocks after `found` help, as far as there are any.
    jump, scale
        Of `JUMP_SLOPE_PRIOR` in filter coordinates, and what a relative change is of.
    """
    y, r, x, freed = blocks
    age = found - likely + 1
    since = int(np.flatnonzero(np.append(1.0, freed[: found + 1, 0]))[-1])
    start = max(since, likely - max(2 * age, MAX_HINDSIGHT_BLOCKS))
    end = min(found + max(age, MAX_HINDSIGHT_BLOCKS), len(y))
    before = track(blocks.part(slice(start)), prior, rates, test=False).belief
    d = len(before.mean)
    mean, cov = np.append(before.mean, np.zeros(d)), np.zeros((2 * d, 2 * d))
    cov[:d, :d] = before.cov
    cov[range(d, 2 * d), range(d, 2 * d)] = freedom(before.mean, jump, scale)
    places = np.arange(max(start, likely - 2 * age), found + 1)
    places = places[:: -(-len(places) // MAX_JUMP_PLACES)]
    part = slice(start, end)
    good = without_bad(y[part], rates.scatter * r[part])
    levels = np.empty((len(places), 3))
    likelihoods = np.empty(len(places))
    for row, place in enumerate(places):
        after = (np.arange(start, end) >= place)[:, None]
        stepped = np.hstack([x[part], after, after * x[part]])
        tried = track(Observations.of(good, r[part], stepped), LevelBelief(mean, cov), rates, test=False)
        levels[row] = tried.belief.mean[d], tried.belief.cov[d, d], tried.belief.mean[0]
        likelihoods[row] = tried.log_likelihood
    weight = np.exp(likelihoods - likelihoods.max())
    weight /= weight.sum()
    cumulated, tail = np.cumsum(weight), 0.5 * math.erfc(SIGMAS / math.sqrt(2.0))
    earliest, latest = (int(places[np.searchsorted(cumulated, p).clip(0, len(places) - 1)]) for p in (tail, 1.0 - tail))
    size = float(weight @ levels[:, 0])
    std = math.sqrt(float(weight @ (levels[:, 1] + np.square(levels[:, 0] - size))))
    return Jump(int(places[weight.argmax()]), earliest, latest, found, size, std, float(weight @ levels[:, 2]))


def jump_while_learning(
    blocks: Observations, prior: LevelBelief, kind: str, logarithmic: bool, sizes: tuple[float, float, float]
) -> tuple[Jump, Rates] | None:
    """Find a jump among the blocks (T,) from which the rates are learned, where a test of innovations has no rates yet.

    The rates are learned without a jump and with one at the likeliest block. The ratio of both likelihoods, shared out
    among the blocks at which the jump may be, gives its odds (Kass & Raftery, J. Am. Stat. Assoc. 90(430), 1995,
    https://doi.org/10.1080/01621459.1995.10476572).

    Parameters
    ----------
    blocks, prior
        As `windsysid.monitoring.levels.jumps.track` takes them.
    kind, logarithmic
        As `windsysid.monitoring.levels.learning.learn_rates` takes them.
    sizes
        Of `JUMP_SLOPE_PRIOR` in filter coordinates, what a relative change is of, and the jump that is tolerated.

    Returns
    -------
    tuple of Jump and Rates, or None
        The jump and the rates next to it; None if the odds are below `MIN_CHANGE_ODDS` or the jump is tolerated.
    """
    count, (jump, scale, least) = len(blocks.y), sizes
    good = np.flatnonzero(np.isfinite(blocks.y))[MIN_LEVEL_BLOCKS : -MIN_LEVEL_BLOCKS or None]
    if not good.size:
        return None
    rates = learn_rates(blocks, prior, kind=kind, logarithmic=logarithmic)
    free, steady = freedom(prior.mean, jump, scale), rates._replace(wander=MIN_WALK_SHARE * rates.wander)

    def stepped(place: int) -> Observations:
        freed = blocks.freed.copy()
        freed[place] = free
        return blocks._replace(freed=freed)

    def likelihood(seen: Observations, at: Rates) -> float:
        return track(seen, prior, at, test=False).log_likelihood

    places = good[:: -(-good.size // MAX_JUMP_PLACES)]
    likely = int(places[np.argmax([likelihood(stepped(int(place)), steady) for place in places])])
    again = learn_rates(stepped(likely), prior, kind=kind, logarithmic=logarithmic)
    gain = likelihood(stepped(likely), again) - likelihood(blocks, rates)
    if gain < math.log(MIN_CHANGE_ODDS * good.size):
        return None
    found = locate(blocks, prior, again, count - 1, likely, jump, scale)
    return (found, again) if abs(found.size) > least else None


def without_bad(y: Array, variance: Array) -> Array:
    """Blocks (T,), NaN for those that are `OUTLIER_SIGMAS` off their neighbours, but not for a step."""
    around = np.lib.stride_tricks.sliding_window_view(np.pad(y, 2, constant_values=np.nan), 5)
    middle = np.array([np.median(five[np.isfinite(five)]) if np.isfinite(five).any() else np.nan for five in around])
    return np.where(np.abs(y - middle) > OUTLIER_SIGMAS * np.sqrt(variance), np.nan, y)


def freedom(mean: Array, jump: float, scale: float) -> Array:
    """Prior variances (d,) of a jump's changes of level and slopes: effects are expected to grow with the level."""
    return np.append(3.0 * jump, jump * mean[1:] / max(abs(mean[0]), scale)) ** 2

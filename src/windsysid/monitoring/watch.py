"""Detection of drifts and jumps over many records of one turbine: season and wind regressed out, alarms at a stated
rate, failing sensors distinguished from failing structures.

Every record leaves a block: its information on each coefficient, without its prior, and the covariates of its time
(temperature, wind speed, power …). Each coefficient is a level that may wander, plus slopes times covariates, plus the
block's own error (`windsysid.monitoring.levels.jumps`). Level and slopes are learned as the blocks come, from a prior;
how fast the level wanders and by how much blocks scatter more than their intervals say is learned by maximum likelihood
from the first `MAX_LEARNING_BLOCKS` blocks, and again whenever there are twice as many. A test for a jump of any size
above `TOLERATED_DRIFT` at any time runs on the whitened innovations of each series; the false alarms of a year are
shared out evenly among the series.

After an alarm the jump becomes one more coefficient of the regression, before each block that it may have happened
before: their likelihoods are when, their mixture is how much. The level is then free to be another, and the watch goes
on.

The noise that each record's identification found in its sensors is watched as well. A stiffness that moved between
records that their models explain, with the noise as it was, has moved; where noise or trust changed with it, the sensor
comes first (docs/monitor.md).
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.monitoring.changes import DetectedJump, Watch, WatchedSeries
from windsysid.monitoring.levels.jumps import Observations, Rates, Track, shared_error, threshold, track
from windsysid.monitoring.levels.learning import learn_rates
from windsysid.monitoring.levels.locating import (
    JUMP_SLOPE_PRIOR,
    MAX_HINDSIGHT_BLOCKS,
    Jump,
    first_belief,
    freedom,
    jump_while_learning,
    locate,
    without_bad,
)
from windsysid.monitoring.series import DAY, MIN_BLOCKS, RecordBlocks
from windsysid.results.posterior import SIGMAS

__all__ = ["TOLERATED_DRIFT", "YEAR", "percent_of", "tell", "was_lost", "watch"]


MAX_LEARNING_BLOCKS = 1008
"""Blocks before the first alarm: a week of 10 minutes; half of the blocks where there are fewer than twice as many."""

TOLERATED_DRIFT = {"k": 0.005, "f": 0.0025, "c": 0.1, "noise": 0.1}
"""Jumps up to this size, relative, are no alarm however sure they are: they are drift."""

YEAR = 365.25 * DAY

MAX_CONSTANT_VARIATION = 1e-9
"""Share of a covariate's size up to which it is constant, and moves by rounding alone."""

SENSOR, STRUCTURE, NOISE = "check the sensor first", "the turbine", "the sensor"

UNEXPLAINED, HEARD, SOUND, UNWATCHED = (
    "the model does not explain the records any more", "a sensor, its cable, or noise from its surroundings",
    "the sensors did not change", "the noise of sensors is not watched here",
)  # fmt: skip
"""Why a jump is put down to a sensor or to the structure."""


def watch(
    blocks: RecordBlocks, *, alarms_per_year: float = 0.1, tolerated: Mapping[str, float] = TOLERATED_DRIFT
) -> Watch:
    """Detect drifts and jumps over many records of one turbine, with season and wind regressed out.

    Parameters
    ----------
    blocks : RecordBlocks
        Estimates (T, n) of n series from T records, at least `MIN_BLOCKS`, with times [s] and covariates (T, m)
        (`windsysid.read_blocks`).
    alarms_per_year : float, default 0.1
        Accepted rate of false alarms of the turbine, all series together [1/a].
    tolerated : mapping of str to float, optional
        Largest relative jump that raises no alarm, by kind of series: stiffness ``"k"``, frequency ``"f"``, damping
        ``"c"`` and ``"noise"`` of sensors, as far as they are monitored.

    Returns
    -------
    Watch
        ``series``: level (T,) and drift [%] of each, with 95 % intervals; ``changes``: jumps [%] with the interval of
        their date and size.

    Raises
    ------
    ConfigurationError
        If `alarms_per_year` is not between 1e-6 and 100, `tolerated` lacks a kind, or too few estimates are usable.

    See Also
    --------
    read_blocks : Estimates from the folders of saved results.
    compare : Two results.

    Notes
    -----
    Each series is a random-walk level plus regression on covariates plus the error of the record (a linear Gaussian
    state-space model); a test for a jump at any time runs on its standardised innovations.

    References
    ----------
    - Willsky & Jones, IEEE Trans. Automatic Control 21(1), 1976, doi:10.1109/TAC.1976.1101146.
    - Lai, IEEE Trans. Information Theory 44(7), 1998, doi:10.1109/18.737522.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> from windsysid.monitoring.series import RecordBlocks
    >>> theta = 0.005 * np.random.default_rng(0).standard_normal((600, 1))  # relative to 1.77 MN/m
    >>> theta[500:] -= 0.02
    >>> blocks = RecordBlocks(
    ...     names=("k_side_side",), time=600.0 * np.arange(600), theta=theta, std=np.full((600, 1), 0.005),
    ...     logarithmic=(True,), reference=(1.77e6,), covariates=np.empty((600, 0)), covariate_names=(),
    ... )
    >>> (jump,) = ws.monitor(blocks).changes
    >>> print(f"{jump.name}: {jump.percent:.2f} % ({jump.low:.2f} … {jump.high:.2f} %)")
    k_side_side: -1.95 % (-2.13 … -1.77 %)
    """
    _check_options(blocks, alarms_per_year, tolerated)
    count = len(blocks.time)
    begins = min(MAX_LEARNING_BLOCKS, count // 2)
    step = float(np.median(np.diff(blocks.time)))
    covariates, notes = _standardise_covariates(blocks, begins)
    there = np.asarray(np.isfinite(covariates.x).all(axis=1))
    if not there.all():
        notes.append(f"{int((~there).sum())} of {count} records lack a covariate and were left out")
    followed = np.flatnonzero(np.isfinite(blocks.theta[there][:begins]).sum(axis=0) >= MIN_BLOCKS // 2).tolist()
    if not followed:
        raise ConfigurationError(
            f"expected at least {MIN_BLOCKS // 2} estimates of grade A or B to learn from in the first {begins} records"
        )
    rare = [name for i, name in enumerate(blocks.names) if i not in followed]
    if rare:
        notes.append(f"too few estimates to learn from (of grade A or B), and not followed: {', '.join(rare)}")
    limit = threshold(alarms_per_year * step / YEAR / len(followed))
    series, jumps = [], []
    for i in followed:
        y = np.where(there, blocks.theta[:, i], np.nan)
        one = _follow(blocks, i, y, np.where(there[:, None], covariates.x, 0.0), begins, limit, tolerated)
        series.append(_describe(blocks, i, one, y, covariates, begins))
        jumps += [(i, jump) for jump in one.jumps]
    jumps.sort(key=lambda found: found[1].found)
    changes = tuple(_change(blocks, i, jump, jumps) for i, jump in jumps)
    notes = [*blocks.notes, *notes]
    notes.insert(
        0,
        f"alarms from {blocks.when(float(blocks.time[begins]))} on: {begins} records to learn from, in which"
        " jumps are searched for afterwards",
    )
    return Watch(blocks, tuple(series), changes, alarms_per_year, begins, tuple(notes))


def _check_options(blocks: RecordBlocks, alarms_per_year: float, tolerated: Mapping[str, float]) -> None:
    kinds = dict.fromkeys(map(blocks.kind, range(len(blocks.names))))
    missing = [kind for kind in kinds if kind not in tolerated]
    if missing:
        raise ConfigurationError(
            f"tolerated: expected a size for {', '.join(kinds)}, got none for {', '.join(missing)}"
        )
    if not 1e-6 <= alarms_per_year <= 100.0:
        raise ConfigurationError(f"alarms per year: expected 1e-6 to 100, got {alarms_per_year:g}")


class _Standardised(NamedTuple):
    """Covariates (T, m) as standard scores of the learning time, their names, and their standard deviations (m,)."""

    x: Array
    names: list[str]
    scales: Array


class _Followed(NamedTuple):
    track: Track
    rates: Rates
    limit: float
    jumps: list[Jump]
    scale: float
    learned: float
    least: float


def _follow(
    blocks: RecordBlocks, i: int, y: Array, x: Array, begins: int, limit: float, tolerated: Mapping[str, float]
) -> _Followed:
    """Level, rates and jumps of one series from its blocks (T,) and standardised covariates (T, m)."""
    count, kind = len(y), blocks.kind(i)
    seen = Observations.of(y.copy(), np.where(np.isfinite(y), blocks.std[:, i], 1.0) ** 2, x)
    prior, scale = first_belief(seen.y, seen.r, x.shape[1], kind, blocks.logarithmic[i])
    jump, least = JUMP_SLOPE_PRIOR[kind] * scale, tolerated[kind] * scale
    jumps: list[Jump] = []
    early = jump_while_learning(seen.part(slice(begins)), prior, kind, blocks.logarithmic[i], (jump, scale, least))
    if early is not None:
        jumps.append(early[0])
        seen = _part(seen, *early, freedom(prior.mean, jump, scale))
    begin = first = begins
    tested = np.zeros(count)
    while True:
        rates = learn_rates(seen.part(slice(begin)), prior, kind=kind, logarithmic=blocks.logarithmic[i])
        end = min(2 * begin, count)
        while True:
            whole = track(seen.part(slice(end)), prior, rates, limit=limit, tolerated=least, first=first)
            upto = whole.stopped + 1 or end
            tested[first:upto] = whole.statistic[first:upto]
            if whole.stopped < 0:
                break
            since, free = int(whole.since[whole.stopped]), freedom(whole.belief.mean, jump, scale)
            where = whole.stopped, since, jump, scale
            first = whole.stopped + 1
            ahead = min(first + max(first - since, MAX_HINDSIGHT_BLOCKS), count)
            parted = _part(seen, locate(seen.part(slice(first)), prior, rates, *where), rates, free)
            after = track(parted.part(slice(ahead)), prior, rates, limit=limit, tolerated=least, first=first)
            until = count if after.stopped < 0 else max(first, int(after.since[after.stopped]))
            jumps.append(locate(seen.part(slice(until)), prior, rates, *where))  # by blocks up to the next jump
            seen = _part(seen, jumps[-1], rates, free)
        if end == count:
            learned = float(whole.level[begins - 1])
            return _Followed(whole._replace(statistic=tested), rates, limit, jumps, scale, learned, least)
        begin = first = end


def _part(blocks: Observations, jump: Jump, rates: Rates, free: Array) -> Observations:
    """Blocks without those that are bad near a jump or on neither side of it, and with free ones at it."""
    y, freed = blocks.y.copy(), blocks.freed.copy()
    near = slice(max(0, jump.earliest - MAX_HINDSIGHT_BLOCKS), jump.found + 1)
    y[near] = without_bad(y[near], rates.scatter * blocks.r[near])
    y[jump.earliest : jump.latest] = np.nan
    freed[jump.latest] = free
    return blocks._replace(y=y, freed=freed)


def _describe(
    blocks: RecordBlocks, i: int, one: _Followed, y: Array, covariates: _Standardised, begins: int
) -> WatchedSeries:
    """A `WatchedSeries` in units and percent."""
    x, names, scales = covariates
    level, std = one.track.level, one.track.std
    belief, now = one.track.belief, float(level[-1])
    told = np.hypot(std, shared_error(now, y, blocks.std[:, i] ** 2, one.rates))
    sigma = np.sqrt(np.diag(belief.cov))
    name = blocks.names[i]

    def value(theta: Array) -> Array:
        return blocks.reference[i] * (np.exp(theta) if blocks.logarithmic[i] else theta)

    def share(part: float, spread: float, of: float) -> tuple[float, float, float]:
        return percent_of(part, spread, of, blocks.logarithmic[i])

    day = max(1, round(DAY / float(np.median(np.diff(blocks.time)))))
    return WatchedSeries(
        name=name,
        unit=blocks.units[i] if blocks.units else "",
        level=value(level),
        low=value(level - SIGMAS * told),
        high=value(level + SIGMAS * told),
        adjusted=value(y - np.where(np.isfinite(x), x, 0.0) @ belief.mean[1:]),
        whitened=one.track.whitened,
        statistic=one.track.statistic,
        limit=one.limit,
        drift=share(now - one.learned, math.hypot(std[-1], std[begins - 1]), one.learned),
        slopes={
            name: share(belief.mean[1 + j] / scales[j], sigma[1 + j] / scales[j], now) for j, name in enumerate(names)
        },
        wander=share(math.sqrt(one.rates.wander * day), 0.0, now)[0],
        scatter=math.sqrt(one.rates.scatter),
        smallest=abs(share(_smallest(blocks, i, one, day), 0.0, now)[0]),
    )


def _smallest(blocks: RecordBlocks, i: int, one: _Followed, within: int) -> float:
    """Least jump in filter coordinates that passes the test within so many blocks with a probability of 0.9.

    The level is taken to be as well known as it gets.
    """
    r = one.rates.scatter * float(np.nanmedian(blocks.std[:, i])) ** 2
    q = one.rates.wander
    spread = 0.5 * (q + math.sqrt(q * (q + 4.0 * r)))  # Riccati's equation of a random walk in noise
    variance = spread + r
    left = (r / variance) ** 2  # of a jump's trace, squared, from block to block
    energy = (within if left > 1.0 - 1e-12 else (1.0 - left**within) / (1.0 - left)) / variance
    return one.least + (math.sqrt(one.limit) + 1.28) / math.sqrt(energy)


def _change(blocks: RecordBlocks, i: int, jump: Jump, jumps: Sequence[tuple[int, Jump]]) -> DetectedJump:
    """A jump in words, percent and seconds, and where to look for its cause."""
    name = blocks.names[i]
    percent, low, high = percent_of(jump.size, jump.std, jump.before, blocks.logarithmic[i])
    time, earliest, latest, found = (float(blocks.time[k]) for k in (jump.at, jump.earliest, jump.latest, jump.found))
    cause, why = _cause(blocks, i, jump, jumps)
    told = tell(name, (percent, low, high), blocks.between(earliest, latest), blocks.when(found), why)
    return DetectedJump(name, time, earliest, latest, found, percent, low, high, cause, told)


def _cause(blocks: RecordBlocks, i: int, jump: Jump, jumps: Sequence[tuple[int, Jump]]) -> tuple[str, str]:
    """Likely cause of a jump of series i, with its reason."""
    kinds = list(map(blocks.kind, range(len(blocks.names))))
    noisy = [blocks.names[j] for j, other in jumps if kinds[j] == "noise" and _meet(jump, other)]
    if kinds[i] == "noise":
        return NOISE, HEARD
    if noisy:
        return SENSOR, f"{SENSOR}: {', '.join(noisy)} changed with it"
    if was_lost(np.isfinite(blocks.theta[:, i]), jump):
        return SENSOR, f"{SENSOR}: {UNEXPLAINED}"
    return STRUCTURE, SOUND if "noise" in kinds else UNWATCHED


def _meet(one: Jump, other: Jump) -> bool:
    """Test whether one jump may have happened before the other was found, and the other way round."""
    return other.earliest <= one.found and one.earliest <= other.found


def tell(name: str, percent: tuple[float, float, float], when: str, found: str, why: str) -> str:
    """A jump in a sentence: by how much and its 95 % interval [%], when, when it was found, and where to look."""
    verb = "rose" if percent[0] > 0.0 else "fell"
    size, low, high = abs(percent[0]), percent[1], percent[2]
    return f"{name} {verb} by {size:.3g} % ({low:+.3g} … {high:+.3g} %) on {when}, found on {found}: {why}"


def was_lost(good: NDArray[np.bool_], jump: Jump) -> bool:
    """Test whether most blocks (T,) were good before the jump and most are not after it."""
    before = good[max(0, jump.earliest - MAX_HINDSIGHT_BLOCKS) : jump.earliest]
    after = good[jump.latest : jump.found + 1]
    return bool(len(before) and len(after) and before.mean() > 0.5 > after.mean())


def _standardise_covariates(blocks: RecordBlocks, begins: int) -> tuple[_Standardised, list[str]]:
    """Covariates as standard scores of the learning time, and notes of those left out."""
    x = np.asarray(blocks.covariates, dtype=np.float64)
    missing = [
        name for name, column in zip(blocks.covariate_names, x.T, strict=True) if np.isfinite(column[:begins]).sum() < 2
    ]
    if missing:
        raise ConfigurationError(
            f"covariates: expected numbers of {', '.join(missing)} in the first {begins} records, got none: leave the"
            " column out"
        )
    scales = np.nanstd(x[:begins], axis=0)
    moves = scales > MAX_CONSTANT_VARIATION * np.nanmax(np.abs(x[:begins]), axis=0)
    notes = [
        f"{name} was constant while learning and was left out"
        for name, there in zip(blocks.covariate_names, moves, strict=True) if not there
    ]  # fmt: skip
    names = [name for name, there in zip(blocks.covariate_names, moves, strict=True) if there]
    centred = (x[:, moves] - np.nanmean(x[:begins, moves], axis=0)) / scales[moves]
    return _Standardised(np.ascontiguousarray(centred), names, scales[moves]), notes


MAX_LOG_STEP = 700.0
"""Largest step in a logarithm whose factor is still a number: the intervals of series without information end there."""


def percent_of(part: float, std: float, of: float, logarithmic: bool) -> tuple[float, float, float]:
    """A change in filter coordinates and its 95 % interval in percent of the value at coordinate `of`."""
    steps = part + std * np.array([0.0, -SIGMAS, SIGMAS])
    percent = 100.0 * (np.expm1(np.minimum(steps, MAX_LOG_STEP)) if logarithmic else steps / max(abs(of), 1e-300))
    return float(percent[0]), float(percent[1]), float(percent[2])

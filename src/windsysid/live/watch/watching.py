"""On-line watch over one turbine: levels, alarms and a checkpoint from the row of each window.

A row gives a block of each series: of a coefficient what the window says without its prior, of a sensor the noise that
was found. Each is followed by `windsysid.monitoring.levels.following`, through the conditions of
`windsysid.live.windows.conditions`; what jumped, or drifted (`windsysid.live.watch.slow_drifts`), becomes an alarm by
the rules of `windsysid.live.watch.alarms`. Windows that are refused, failed, transient or missing are blocks without an
estimate, and so are coefficients of grade C: the level wanders on, its interval widens.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.fleet.rows import Row
from windsysid.fleet.series import COVARIATES
from windsysid.live.checkpoint import KeptWatch, pack_watch, unpack_watch
from windsysid.live.store.contents import Alarm, SeriesLevel
from windsysid.live.watch.alarms import (
    MIN_EMPTY_WINDOWS,
    AlarmCase,
    Circumstances,
    blind_alarm,
    came_back,
    drift_alarm,
    jump_alarm,
    takes_back,
    why_blind,
)
from windsysid.live.watch.slow_drifts import (
    TEST_EVERY_BLOCKS,
    Drifted,
    DriftReference,
    Past,
    drifted_since,
    grew,
    limit_of,
    remembered,
)
from windsysid.live.watch.watch_state import NO_WINDOWS, WatchState
from windsysid.live.watch.watched import Said, Watched, band_of, in_coordinates_of, said_of
from windsysid.live.windows.conditions import NO_STATE, covariates_of, learn_standards
from windsysid.monitoring.levels.following import DROPPED_BLOCKS, MAX_KEPT_BLOCKS, Kept, LevelFollower, Now
from windsysid.monitoring.levels.jumps import threshold
from windsysid.monitoring.levels.locating import MAX_HINDSIGHT_BLOCKS, Jump
from windsysid.monitoring.series import MIN_BLOCKS
from windsysid.monitoring.watch import TOLERATED_DRIFT, YEAR, was_lost

__all__ = ["Taken", "WatchOptions", "Watching", "resume", "start"]

MAX_CASES = 256
"""Number of jumps whose reports a watch keeps; beyond it, the oldest are no longer updated."""

_KINDS = ("k", "c", "f", "noise")


class WatchOptions(NamedTuple):
    """Settings of a watch.

    Attributes
    ----------
    window
        Length of a window [s].
    learn
        Windows to learn from before the first alarm: a day of 10 minutes, 12 to 2016.
    alarms_per_year
        False alarms that are accepted of a turbine in a year, all series together: 1e-6 to 100. Jumps may have one
        half of them, drifts the other.
    tolerated
        Of ``k``, ``c``, ``f`` and ``noise``: relative changes up to this size are no alarm, however sure.
    """

    window: float = 600.0
    learn: int = 144
    alarms_per_year: float = 0.1
    tolerated: Mapping[str, float] = TOLERATED_DRIFT


class Taken(NamedTuple):
    """Outcome of a row: levels and checkpoint of a `windsysid.live.store.contents.Result`, and alarms.

    Attributes
    ----------
    alarms
        New ones, and those that changed: an alarm that is known is replaced by the one of its key.
    """

    levels: tuple[SeriesLevel, ...]
    alarms: tuple[Alarm, ...]
    checkpoint: bytes


class Watching:
    """The watch over one turbine: it changes with every row, and its checkpoints are all that it takes to go on.

    `start` and `resume` make one.
    """

    def __init__(self, turbine: str, options: WatchOptions, kept: KeptWatch) -> None:
        self.turbine, self.options = turbine, options
        self._state, self._windows, self._cases, self._past = kept.state, kept.windows, kept.cases, dict(kept.past)
        self._followers = {one.name: self._follower(one, series) for one, series in kept.series.items()}
        self._watched = {one.name: one for one in kept.series}

    def take(self, row: Row, window: int) -> Taken:
        """Take in the row of the window that begins at `window` [ns since 1970]; rows come in order of windows.

        Parameters
        ----------
        row
            As `windsysid.fleet.rows` has it; refused and failed ones too.

        Raises
        ------
        ConfigurationError
            If the window is no later than the one before.
        """
        if len(self._windows.time) and window <= self._windows.time[-1]:
            raise ConfigurationError(
                f"{self.turbine}: expected a window after {self._windows.time[-1]}, got {window}: take them in order"
            )
        step, tested = round(1e9 * self.options.window), self._windows_so_far // TEST_EVERY_BLOCKS
        if len(self._windows.time):
            last = int(self._windows.time[-1])
            missing = round((window - last) / step) - 1
            for k in range(max(0, missing - DROPPED_BLOCKS), missing):  # the level wanders on, a week at most
                self._block(last + (k + 1) * step, None)
        said, now = self._block(window, row)
        alarms = self._alarms(now, window + step, drifts=self._windows_so_far // TEST_EVERY_BLOCKS > tested)
        levels = tuple(self._level(name, said.get(name, Said()), now[name]) for name in now)
        return Taken(levels, alarms, self.checkpoint())

    def checkpoint(self) -> bytes:
        """All that it takes to go on, as bytes: no more than `MAX_KEPT_BLOCKS` windows need."""
        series = {one: self._followers[name].kept for name, one in self._watched.items()}
        return pack_watch(self.turbine, KeptWatch(self._state, self._windows, series, self._cases, self._past))

    @property
    def _windows_so_far(self) -> int:
        """Windows so far, with those that are missing."""
        return self._state.let_go + len(self._windows.time)

    def _follower(self, one: Watched, kept: Kept) -> LevelFollower:
        return LevelFollower(one.kind, one.logarithmic, self.options.tolerated[one.kind], kept)

    def _covariates(self, newest: int = 0) -> Array:
        """All windows, or a number of the newest."""
        part = slice(-newest if newest else None, None)
        state, conditions = self._windows.state[part], self._windows.conditions[part]
        if self._state.standards is None:
            return np.zeros((len(state), 1))
        return covariates_of(self._state.standards, state, conditions)

    def _block(self, window: int, row: Row | None) -> tuple[dict[str, Said], dict[str, Now]]:
        """Process a window, or a missing one: its estimate of each series, and their levels."""
        said = {} if row is None else said_of(row)
        for one in said:
            if one.name not in self._watched:
                kept = LevelFollower.beginning(len(self._windows.time), self._state.let_go)
                self._watched[one.name] = one
                self._followers[one.name] = self._follower(one, kept)
        own = {one.name: in_coordinates_of(self._watched[one.name], one, value) for one, value in said.items()}
        self._windows = self._windows.and_then(window, row)
        takes = bool(self._windows.state[-1] != NO_STATE)
        for name, follower in self._followers.items():
            follower.append(*(own.get(name, Said()).usable if takes else Said())[:2])
        learning = self._count(row, takes)
        newest = self._covariates(1)
        limit = self._limit() if self._state.taken >= self.options.learn else math.inf
        now = {name: self._advance(name, learning, newest, limit) for name in self._followers}
        self._see(window, row, newest, any(math.isfinite(one.kept.y[-1]) for one in self._coefficients()))
        return own, now

    def _coefficients(self) -> list[LevelFollower]:
        return [one for one in self._followers.values() if one.kind != "noise"]

    def _advance(self, name: str, learning: bool | None, newest: Array, limit: float) -> Now:
        """Take the newest window into a series; `learning` is what `_count` gave."""
        follower = self._followers[name]
        if learning is None or not (follower.kept.rates is not None or follower.known >= MIN_BLOCKS // 2):
            return follower.follow(newest, self._covariates, limit)
        x = self._covariates()
        now = follower.learn(x, anew=learning)
        if not learning:
            past, wander = self._past.get(name, Past()), follower.wander_beside_trend(x)
            first = int(self._windows.time[0])
            self._past[name] = remembered(past, follower.kept, DROPPED_BLOCKS, first, wander)
        return now

    def _count(self, row: Row | None, takes: bool) -> bool | None:
        """Count the newest window; whether rates are to be learned, from the beginning (True) or on (False)."""
        if row is not None and row["status"] == "ok":
            self._note_settings(f"{row['settings']} {row['windsysid']}")
        self._state = state = self._state._replace(taken=self._state.taken + takes)
        learned = state.standards is not None
        if len(self._windows.time) > MAX_KEPT_BLOCKS:
            self._let_go()
            if learned:
                return False
        elif state.let_go and learned:
            return None
        if not takes or state.taken < state.next_learning:
            return None
        standards = learn_standards(self._windows.state, self._windows.conditions)
        self._state = self._state._replace(next_learning=self._next_learning(), standards=standards)
        return True

    def _note_settings(self, made: str) -> None:
        """Note with which settings a window was estimated, and since when they are others than before."""
        if made != self._state.settings:
            changed = int(self._windows.time[-1]) if self._state.settings else None
            self._state = self._state._replace(settings=made, changed=changed)

    def _let_go(self) -> None:
        """Forget the oldest windows, but not their statistics."""
        x = self._covariates()
        for follower in self._followers.values():
            follower.let_go(x, DROPPED_BLOCKS)
        self._windows = self._windows.later(DROPPED_BLOCKS)
        self._state = self._state._replace(let_go=self._state.let_go + DROPPED_BLOCKS)

    def _next_learning(self) -> int:
        """The number of windows at which rates are learned next: `learn` times a power of two."""
        taken, following = self._state.taken, self.options.learn
        while following <= taken:
            following *= 2
        while following >= 4 * MIN_BLOCKS and following // 2 > taken:
            following //= 2
        return following

    def _limit(self) -> float:
        """Of the test of each series for a jump; together they have half of the false alarms that are accepted."""
        rate = 0.5 * self.options.alarms_per_year / max(1, len(self._followers))
        return threshold(rate * self.options.window / YEAR)

    def _level(self, name: str, said: Said, now: Now) -> SeriesLevel:
        one = self._watched[name]
        window = band_of(one, said.theta, said.std)
        level = band_of(one, now.level, math.hypot(now.std, now.shared))
        return SeriesLevel(name, one.unit, one.kind, *window, *level, now.statistic, self._limit(), said.grade)

    # what is said of it

    def _alarms(self, now: Mapping[str, Now], end: int, *, drifts: bool) -> tuple[Alarm, ...]:
        """Alarms that are new, updated or ended after the window that ends at `end`."""
        before = {case.alarm.key: case.alarm for case in self._cases}
        cases = self._with_jumps()
        if drifts:
            cases = self._with_drifts(cases, now)
        cases = [self._ended(case, now[case.series], end) for case in cases]
        self._cases = tuple(cases[-MAX_CASES:])
        changed = [case.alarm for case in cases if before.get(case.alarm.key) != case.alarm]
        blind = self._blind(end)
        return (*changed, *([] if blind is None else [blind]))

    def _with_jumps(self) -> list[AlarmCase]:
        """With the jumps that are new; where one is, or was measured again, all are said anew."""
        found = {(name, jump.found): jump for name, one in self._followers.items() for jump in one.kept.jumps}
        cases = [_measured_again(case, found) for case in self._cases]
        moved = bool(found) or any(case.jump != one.jump for case, one in zip(cases, self._cases, strict=True))
        for (name, _), jump in sorted(found.items(), key=lambda one: one[1].found):
            returns = _is_return(name, jump, cases)
            cases.append(AlarmCase(name, jump, returns, self._jump_alarm(name, jump, cases, returns=returns)))
            if name in self._past:
                self._past[name] = self._past[name]._replace(references=())
        return [self._said_anew(case, cases) for case in cases] if moved else cases

    def _said_anew(self, case: AlarmCase, cases: list[AlarmCase]) -> AlarmCase:
        """Alarm of a jump with its current estimate, while its windows are kept."""
        newest = self._windows_so_far - 1
        young = newest - case.jump.found <= MAX_HINDSIGHT_BLOCKS
        if case.drift or not young or case.jump.earliest < self._state.let_go:
            return case
        alarm = self._jump_alarm(case.series, case.jump, cases, returns=case.returns)
        return case._replace(alarm=alarm._replace(ended=case.alarm.ended))

    def _with_drifts(self, cases: list[AlarmCase], now: Mapping[str, Now]) -> list[AlarmCase]:
        """With the drifts that are new; those that are open are said anew where they grew."""
        limit = limit_of(0.5 * self.options.alarms_per_year, self.options.window, len(self._followers))
        cases = [self._grown(case, now[case.series], cases) for case in cases]
        open_ones = {case.series for case in cases if case.drift and case.alarm.ended is None}
        for name, one in self._followers.items():
            past = self._past.get(name, Past())
            tried = [(drifted_since(it, past, now[name], one.kept, one.tolerated).z, it) for it in past.references]
            z, since = max(tried, default=(0.0, None))
            if since is None or name in open_ones or not z > limit:
                continue
            found = self._drift(name, since, now[name])
            returns = _is_return(name, found.jump, cases)
            alarm = self._drift_alarm(name, found, cases, returns=returns)
            cases.append(AlarmCase(name, found.jump, returns, alarm, drift=True))
        return cases

    def _grown(self, case: AlarmCase, now: Now, cases: list[AlarmCase]) -> AlarmCase:
        """A drift that is open, as it is now, where it grew."""
        references = self._past.get(case.series, Past()).references
        since = next((it for it in references if it.block == case.jump.earliest), None)
        if not case.drift or case.alarm.ended is not None or since is None:
            return case
        drift = self._drift(case.series, since, now)
        alarm = self._drift_alarm(case.series, drift, cases, returns=False, opened=case.alarm.opened)
        if not (grew(case.jump, drift.jump) or alarm.severity == "alarm" != case.alarm.severity):
            return case
        return case._replace(jump=drift.jump._replace(found=case.jump.found), alarm=alarm._replace(key=case.alarm.key))

    def _drift(self, name: str, since: DriftReference, now: Now) -> Drifted:
        """A drift as it is reported: to the level of the last day, since the followed level lags behind."""
        one = self._followers[name]
        level, std = one.newest_level(self._covariates(), TEST_EVERY_BLOCKS)
        return drifted_since(since, self._past[name], now._replace(level=level, std=std), one.kept, one.tolerated)

    def _drift_alarm(
        self, name: str, drift: Drifted, cases: list[AlarmCase], *, returns: bool, opened: int | None = None
    ) -> Alarm:
        newest = int(self._windows.time[-1])
        when = drift.time, newest, newest, opened or newest + round(1e9 * self.options.window)
        about = self._circumstances(name, drift.jump, cases, when)
        standards = self._state.standards
        weather = standards is not None and COVARIATES.index("temperature") in standards.columns
        return drift_alarm(self.turbine, self._watched[name], drift, when, about, returns=returns, weather=weather)

    def _jump_alarm(self, name: str, jump: Jump, cases: list[AlarmCase], *, returns: bool) -> Alarm:
        when = self._when(jump)
        about = self._circumstances(name, jump, cases, when)
        return jump_alarm(self.turbine, self._watched[name], jump, when, about, returns=returns)

    def _ended(self, case: AlarmCase, now: Now, end: int) -> AlarmCase:
        if case.alarm.ended is not None or not came_back(case.jump, now.level, now.std):
            return case
        return case._replace(alarm=case.alarm._replace(ended=end))

    def _when(self, jump: Jump) -> tuple[int, int, int, int]:
        first = self._state.let_go
        earliest, latest, found = (
            int(self._windows.time[max(0, at - first)]) for at in (jump.earliest, jump.latest, jump.found)
        )
        return earliest, latest, found, found + round(1e9 * self.options.window)

    def _circumstances(
        self, name: str, jump: Jump, cases: list[AlarmCase], when: tuple[int, int, int, int]
    ) -> Circumstances:
        noisy = [
            case.series for case in cases
            if self._watched[case.series].kind == "noise"
            and case.jump.earliest <= jump.found and jump.earliest <= case.jump.found
        ]  # fmt: skip
        first = self._state.let_go
        known = self._windows.state != NO_STATE
        here = jump._replace(**{at: int(known[: max(0, getattr(jump, at) - first)].sum()) for at in _PLACES})
        changed = self._state.changed
        return Circumstances(
            [other for other in dict.fromkeys(noisy) if other != name],
            any(one.kind == "noise" for one in self._watched.values()),
            was_lost(np.isfinite(self._followers[name].kept.y)[known], here),
            was_lost(self._windows.sound[known], here),
            changed is not None and when[0] <= changed <= when[2],
        )

    def _see(self, window: int, row: Row | None, x: Array, said: bool) -> None:
        """Record whether the newest window is usable, and if not, since when and why."""
        state = self._state
        if said and bool(np.isfinite(x[-1]).all()):
            self._state = state._replace(blind=0, why="" if state.blind_open is None else state.why)
            return
        since = window if state.blind == 0 else state.blind_since
        self._state = state._replace(blind=state.blind + 1, blind_since=since, why=why_blind(row))

    def _blind(self, end: int) -> Alarm | None:
        """That nothing can be watched, or that it can again."""
        state = self._state
        if state.blind == 0 and state.blind_open is not None and state.blind_since is not None:
            self._state = state._replace(blind_since=None, blind_open=None, why="")
            return blind_alarm(self.turbine, state.blind_since, state.blind_open, end, state.why)
        if state.blind >= MIN_EMPTY_WINDOWS and state.blind_open is None and state.blind_since is not None:
            self._state = state._replace(blind_open=end)
            return blind_alarm(self.turbine, state.blind_since, end, None, state.why)
        return None


_PLACES = ("earliest", "latest", "found")


def _measured_again(case: AlarmCase, found: dict[tuple[str, int], Jump]) -> AlarmCase:
    """A case with its jump as it is measured now, which is taken out of `found`."""
    return case if case.drift else case._replace(jump=found.pop((case.series, case.jump.found), case.jump))


def _is_return(series: str, jump: Jump, cases: Sequence[AlarmCase]) -> bool:
    """Check whether a jump of a series reverses an earlier one."""
    return any(takes_back(case.jump, jump) for case in cases if case.series == series and not case.returns)


def start(turbine: str, options: WatchOptions = WatchOptions()) -> Watching:
    """A watch before any data.

    Raises
    ------
    ConfigurationError
        If an option is out of its range.
    """
    _check(options)
    first = options.learn
    while first >= 2 * MIN_BLOCKS:
        first //= 2
    state = WatchState(0, first, None, 0, None, 0, None, "", "", None)
    return Watching(turbine, options, KeptWatch(state, NO_WINDOWS, {}, (), {}))


def resume(checkpoint: bytes, turbine: str, options: WatchOptions = WatchOptions()) -> Watching:
    """The watch as it was when it gave this checkpoint: it goes on, bit for bit, as if it had never stopped.

    Raises
    ------
    ConfigurationError
        If the checkpoint is damaged, or of another turbine or version; or an option is out of its range.
    """
    _check(options)
    return Watching(turbine, options, unpack_watch(checkpoint, turbine))


def _check(options: WatchOptions) -> None:
    if not 12 <= options.learn <= MAX_KEPT_BLOCKS // 2:
        raise ConfigurationError(f"learn: expected 12 to {MAX_KEPT_BLOCKS // 2} windows, got {options.learn}")
    if not 1e-6 <= options.alarms_per_year <= 100.0:
        raise ConfigurationError(f"alarms per year: expected 1e-6 to 100, got {options.alarms_per_year:g}")
    if not (math.isfinite(options.window) and options.window > 0.0):
        raise ConfigurationError(f"window: expected a length in seconds above 0, got {options.window:g}")
    wrong = [kind for kind in _KINDS if not 0.0 <= options.tolerated.get(kind, math.nan) < math.inf]
    if wrong:
        raise ConfigurationError(f"tolerated: expected a size of 0 or more for {', '.join(wrong)}")

"""Events of a fleet, in sentences: jumps, failing sensors, outliers, each once.

An alarm whose jump has zero in its interval, once its date is known, is left out, unless a jump that has not takes it
back; the watch of the turbine lists it.
A jump that happens while a sensor of the turbine fails is put down to that.
A jump that half of the turbines of the type have on the same date is the season's, the site's or the software's, and no
turbine's. What falls in the cold and comes back, at once or in steps, is named as ice.
A jump with which noise or trust changed is the sensor's
(docs/monitor.md).
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.fleet.sensors import Failing
from windsysid.fleet.sisters import Standing
from windsysid.monitoring.changes import DetectedJump, Watch
from windsysid.monitoring.series import DAY
from windsysid.monitoring.watch import NOISE, SENSOR

__all__ = ["FleetEvent", "events_of"]

MAX_SHARED_DAYS = 7.0
"""Jumps of turbines of the type within so many days of each other belong together."""

MIN_SHARED_TURBINES = 3
"""Turbines of the type that must have a jump for it to be the site's, and half of them."""

MAX_STEP_DAYS = 2.0
"""Jumps of a coefficient in one direction, at most so many days apart, are one.

What grows in hours, as ice does, sets off one alarm after the other, and the size of each is of little use.
"""

LEVEL_DAYS = 3.0
"""Days before and after jumps whose blocks tell the level: when the alarm went, what grows had not grown."""

MAX_RECOVERY_DAYS = 60.0
"""Greatest number of days after which a drop that recovers counts as temporary."""

MAX_REST_SHARE = 0.5
"""Share of a fall that may be left after it came back."""

MAX_ICING_CELSIUS = 2.0
"""Mean temperature [°C] of the day of the fall up to which what came and went is named as ice.

Ice grows below 0 °C, and thermometers of nacelles read a degree or two too much. It stays until the thaw is over, so
that the temperature meanwhile says little.
"""

ICING_SECONDS = 0.5 * DAY
"""[s] before and after the fall whose temperature counts."""

_WORST = ("turbine", "ice", "sensor", "outlier", "shared")


class FleetEvent(NamedTuple):
    """One thing that stands out.

    Attributes
    ----------
    turbine
        Which; several, with commas, where they share it.
    kind
        ``turbine``, ``ice``, ``sensor``, ``outlier`` or ``shared``.
    sentence
        The sentence.
    """

    turbine: str
    kind: str
    sentence: str


@dataclass(frozen=True, eq=False)
class _Jump:
    """A jump of one coefficient of one turbine, and the watch that found it."""

    turbine: str
    watch: Watch
    change: DetectedJump

    @property
    def seconds(self) -> float:
        """When it happened [s since 1970]."""
        return _epoch(self.watch) + self.change.time

    def is_alike(self, other: "_Jump") -> bool:
        """Test whether two jumps are of one coefficient, in one direction, about the same date."""
        one, another = self.change, other.change
        same = one.name == another.name and one.percent * another.percent > 0.0
        return same and abs(self.seconds - other.seconds) <= MAX_SHARED_DAYS * DAY


def events_of(
    watches: Mapping[str, Watch], failing: Sequence[Failing], standings: Sequence[Standing],
    air: Mapping[str, tuple[Array, Array]],
) -> list[FleetEvent]:  # fmt: skip
    """Findings, the worst first, each once."""
    jumps = [_Jump(name, one, change) for name, one in watches.items() for change in _told(one)]
    shared, single = _shared_jumps(jumps, len(watches))
    sensors, unexplained = _sensor_failures(single, failing)
    doubtful = {jump.turbine for jump in single if jump not in unexplained}
    outliers = [
        FleetEvent(s.turbine, "outlier", s.sentence) for s in standings if s.outlier and s.turbine not in doubtful
    ]
    found = shared + _single_jumps(unexplained, air) + sensors + outliers
    return sorted(found, key=lambda event: _WORST.index(event.kind))


def _shared_jumps(jumps: Sequence[_Jump], turbines: int) -> tuple[list[FleetEvent], list[_Jump]]:
    """Events of jumps that enough turbines have about the same date, and the jumps that are left."""
    events: list[FleetEvent] = []
    left = list(jumps)
    for jump in jumps:
        alike = [other for other in left if jump.is_alike(other)]
        sisters = list(dict.fromkeys(other.turbine for other in alike))
        if jump not in left or len(sisters) < max(MIN_SHARED_TURBINES, 0.5 * turbines):
            continue
        left = [other for other in left if other not in alike]
        verb = "rose" if jump.change.percent > 0.0 else "fell"
        when = jump.watch.blocks.when(jump.change.time)
        told = f"{jump.change.name} {verb} about {when} at {len(sisters)} of {turbines}: season, site or software"
        events.append(FleetEvent(", ".join(sisters), "shared", told))
    return events, left


def _sensor_failures(jumps: Sequence[_Jump], failing: Sequence[Failing]) -> tuple[list[FleetEvent], list[_Jump]]:
    """Events of sensors that fail, and the jumps that are not put down to one of them."""
    events: list[FleetEvent] = []
    explained: set[_Jump] = set()
    for one in failing:
        theirs = [jump for jump in jumps if jump.turbine == one.turbine and one.covers(jump.seconds)]
        explained.update(theirs)
        more = f"; jumps found meanwhile, {len(theirs)}, are attributed to it" if theirs else ""
        events.append(FleetEvent(one.turbine, "shared" if one.shared else "sensor", one.sentence + more))
    return events, [jump for jump in jumps if jump not in explained]


def _single_jumps(jumps: Sequence[_Jump], air: Mapping[str, tuple[Array, Array]]) -> list[FleetEvent]:
    """Events of jumps that one turbine has; a jump and those that take it back are one event."""
    events: list[FleetEvent] = []
    left = list(jumps)
    while left:
        jump = left.pop(0)
        sensor = jump.change.cause in (NOISE, SENSOR)
        back = [] if sensor else _taken_back_by(jump, left)
        if back:
            left = [other for other in left if other not in back]
            steps = [one.change for one in (jump, *back)]
            events.append(_went(jump.turbine, steps, jump.watch, *air[jump.turbine]))
        else:
            events.append(FleetEvent(jump.turbine, "sensor" if sensor else "turbine", jump.change.sentence))
    return events


def _taken_back_by(jump: _Jump, later: Sequence[_Jump]) -> list[_Jump]:
    """The later jumps of the same coefficient that take a jump back; none where it stays."""
    key = jump.turbine, jump.change.name
    same = [other for other in later if (other.turbine, other.change.name) == key]
    return same[: _steps_back(jump.watch, [jump.change, *(other.change for other in same)])]


def _told(one: Watch) -> list[DetectedJump]:
    """Reported jumps: significant ones, once their dates are known, and the recoveries that cancel one."""
    merged = _merged(one)
    told = []
    for i, change in enumerate(merged):
        later = [other for other in merged[i + 1 :] if other.name == change.name and _is_sure(other)]
        if _is_sure(change) or _steps_back(one, [change, *later]):
            told.append(change)
    return told


def _is_sure(change: DetectedJump) -> bool:
    """Test whether a jump's interval contains only jumps."""
    return change.low > 0.0 or change.high < 0.0


def _merged(one: Watch) -> list[DetectedJump]:
    """The jumps of a watch, those that are steps of one taken together, in the order of their alarms."""
    runs: list[list[DetectedJump]] = []
    newest: dict[str, list[DetectedJump]] = {}
    for change in one.changes:
        run = newest.get(change.name)
        if (
            run is None
            or change.percent * run[-1].percent <= 0.0
            or change.earliest - run[-1].latest > MAX_STEP_DAYS * DAY
        ):
            runs.append(newest.setdefault(change.name, []) if run is None else [])
            run = newest[change.name] = runs[-1]
        run.append(change)
    return [run[0] if len(run) == 1 else _as_one(one, run) for run in runs]


def _as_one(one: Watch, run: Sequence[DetectedJump]) -> DetectedJump:
    """Steps of one coefficient as one jump: its size by the blocks before and after."""
    first, last = run[0], max(run, key=lambda step: step.latest)
    (percent,) = _levels(one, [first._replace(latest=last.latest, percent=sum(step.percent for step in run))])
    verb = "rose" if percent > 0.0 else "fell"
    when, found = one.blocks.between(first.earliest, last.latest), one.blocks.when(first.found)
    told = f"{first.name} {verb} by {abs(percent):.3g} % in {len(run)} steps on {when}, found on {found}"
    cause = next((step.cause for step in run if step.cause in (NOISE, SENSOR)), first.cause)
    return first._replace(latest=last.latest, percent=percent, low=percent, high=percent, cause=cause, sentence=told)


def _epoch(one: Watch) -> float:
    """When the blocks of a watch begin [s since 1970]; local time counts as UTC."""
    begin = one.blocks.begin
    if begin is None:
        return 0.0
    return (begin if begin.tzinfo is not None else begin.replace(tzinfo=UTC)).timestamp()


def _levels(one: Watch, steps: Sequence[DetectedJump]) -> list[float]:
    """Level after each of some jumps of a coefficient, less that before the first, in percent of that."""
    time, values = one.blocks.time, next(series.adjusted for series in one.series if series.name == steps[0].name)
    side = LEVEL_DAYS * DAY

    def level(low: float, high: float) -> float:
        inside = (time > low) & (time < high) & np.isfinite(values)
        return float(np.median(values[inside])) if inside.any() else math.nan

    before = level(steps[0].earliest - side, steps[0].earliest)
    after = [level(max(a.latest, b.earliest - side), b.earliest) for a, b in itertools.pairwise(steps)]
    after.append(level(steps[-1].latest, steps[-1].latest + side))
    told = np.cumsum([step.percent for step in steps])  # where there are no blocks between two jumps
    found = 100.0 * (np.array(after) / before - 1.0)
    return [float(value) for value in np.where(np.isfinite(found), found, told)]


def _steps_back(one: Watch, steps: Sequence[DetectedJump]) -> int:
    """After how many more jumps of a coefficient the first one is taken back; 0 where it is not."""
    levels = _levels(one, [step for step in steps if step.time - steps[0].time <= MAX_RECOVERY_DAYS * DAY])
    back = int(np.argmin(np.abs(levels)))
    return back if abs(levels[back]) <= MAX_REST_SHARE * np.max(np.abs(levels[: back + 1])) else 0


def _went(name: str, steps: Sequence[DetectedJump], one: Watch, seconds: Array, temperature: Array) -> FleetEvent:
    """Sentence on a temporary change."""
    levels = np.array(_levels(one, steps)[:-1])
    top = int(np.argmax(np.abs(levels)))
    first, reached, begins, last = steps[0], steps[top], steps[top + 1], steps[-1]
    base = _epoch(one)
    inside = (seconds >= base + first.earliest - ICING_SECONDS) & (seconds <= base + first.latest + ICING_SECONDS)
    inside &= np.isfinite(temperature)
    mean = float(temperature[inside].mean()) if inside.any() else None
    verbs = ("rose", "fell") if levels[top] > 0.0 else ("fell", "rose")
    when = one.blocks.between(first.earliest, reached.latest), one.blocks.between(begins.earliest, last.latest)
    told = f"{first.name} {verbs[0]} by {abs(levels[top]):.2g} % on {when[0]} and {verbs[1]} again on {when[1]}"
    if mean is None:
        return FleetEvent(name, "turbine", told)
    if mean > MAX_ICING_CELSIUS or levels[top] > 0.0:
        return FleetEvent(name, "turbine", f"{told}, at {round(mean)} °C when it {verbs[0]}")
    return FleetEvent(name, "ice", f"{told}, at {round(mean)} °C when it fell, as with ice on blades")

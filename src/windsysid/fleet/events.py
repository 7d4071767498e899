"""What stands out of a fleet, in sentences: jumps, sensors that fail, outliers, each thing once.

An alarm whose jump has zero in its band, once its date is known, is left out, unless a jump that has not takes it back;
the watch of the turbine lists it.
A jump that happens while a sensor of the turbine fails is put down to that.
A jump that half of the sisters have on the same date is the season's, the site's or the software's, and no turbine's.
What falls in the cold and comes back, at once or in steps, is named as ice.
A jump with which noise or trust changed is the sensor's
(docs/monitor.md).
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from datetime import UTC
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.fleet.sensors import Failing
from windsysid.fleet.sisters import Standing
from windsysid.monitoring.changes import Change, Watch
from windsysid.monitoring.series import DAY
from windsysid.monitoring.watch import NOISE, SENSOR

__all__ = ["Event", "events_of"]

SHARED_DAYS = 7.0
"""Jumps of sisters within so many days of each other belong together."""

MIN_SHARED = 3
"""Sisters that must have a jump for it to be the site's, and half of them."""

STEP_DAYS = 2.0
"""Jumps of a coefficient in one direction, at most so many days apart, are one.

What grows in hours, as ice does, sets off one alarm after the other, and the size of each is of little use.
"""

SIDE_DAYS = 3.0
"""Days before and after jumps whose blocks tell the level: when the alarm went, what grows had not grown."""

RETURN_DAYS = 60.0
"""What falls and comes back within so many days came and went."""

RETURN_MAX_REST = 0.5
"""Share of a fall that may be left after it came back."""

ICE_MAX_TEMPERATURE = 2.0
"""Mean temperature [°C] of the day of the fall up to which what came and went is named as ice.

Ice grows below 0 °C, and thermometers of nacelles read a degree or two too much. It stays until the thaw is over, so
that the temperature meanwhile says little.
"""

ICE_DAY = 0.5 * DAY
"""[s] before and after the fall whose temperature counts."""

_WORST = ("turbine", "ice", "sensor", "outlier", "shared")


class Event(NamedTuple):
    """One thing that stands out.

    Attributes
    ----------
    turbine
        Which; several, with commas, where they share it.
    kind
        ``turbine``, ``ice``, ``sensor``, ``outlier`` or ``shared``.
    told
        The sentence.
    """

    turbine: str
    kind: str
    told: str


def events_of(
    watches: Mapping[str, Watch], failing: Sequence[Failing], standings: Sequence[Standing],
    air: Mapping[str, tuple[Array, Array]],
) -> list[Event]:  # fmt: skip
    """What stands out, the worst first, each thing once."""
    changes = [(name, change) for name, one in watches.items() for change in _told(one)]
    found: list[Event] = []
    done: set[int] = set()
    for i, (name, change) in enumerate(changes):
        alike = [j for j, (_, other) in enumerate(changes) if j not in done and _is_alike(watches, changes, i, j)]
        sisters = list(dict.fromkeys(changes[j][0] for j in alike))
        if i not in done and len(sisters) >= max(MIN_SHARED, 0.5 * len(watches)):
            done.update(alike)
            verb = "rose" if change.percent > 0.0 else "fell"
            when = watches[name].blocks.when(change.time)
            told = f"{change.name} {verb} about {when} at {len(sisters)} of {len(watches)}: season, site or software"
            found.append(Event(", ".join(sisters), "shared", told))
    meanwhile = {
        one: [
            i for i, (name, change) in enumerate(changes)
            if name == one.turbine and i not in done and one.covers(_epoch(watches[name]) + change.time)
        ]
        for one in failing
    }  # fmt: skip
    done.update(i for theirs in meanwhile.values() for i in theirs)
    for i, (name, change) in enumerate(changes):
        if i in done:
            continue
        if change.cause in (NOISE, SENSOR):
            found.append(Event(name, "sensor", change.told))
            continue
        later = [
            j for j in range(i + 1, len(changes))
            if j not in done and changes[j][0] == name and changes[j][1].name == change.name
        ]  # fmt: skip
        back = _steps_back(watches[name], [change, *(changes[j][1] for j in later)])
        if not back:
            found.append(Event(name, "turbine", change.told))
            continue
        done.update(later[:back])
        steps = [change, *(changes[j][1] for j in later[:back])]
        found.append(_went(name, steps, watches[name], *air[name]))
    for one, theirs in meanwhile.items():
        more = f"; jumps found meanwhile, {len(theirs)}, are put down to it" if theirs else ""
        found.append(Event(one.turbine, "shared" if one.shared else "sensor", one.told + more))
    doubtful = {one.turbine for one, theirs in meanwhile.items() if theirs}
    found += [Event(s.turbine, "outlier", s.told) for s in standings if s.outlier and s.turbine not in doubtful]
    return sorted(found, key=lambda event: _WORST.index(event.kind))


def _told(one: Watch) -> list[Change]:
    """Jumps that are told: those that are some, once it is known when they were, and what such a one takes back."""
    merged = _merged(one)
    told = []
    for i, change in enumerate(merged):
        later = [other for other in merged[i + 1 :] if other.name == change.name and _is_sure(other)]
        if _is_sure(change) or _steps_back(one, [change, *later]):
            told.append(change)
    return told


def _is_sure(change: Change) -> bool:
    """Whether a jump's band holds nothing but jumps."""
    return change.low > 0.0 or change.high < 0.0


def _merged(one: Watch) -> list[Change]:
    """The jumps of a watch, those that are steps of one taken together, in the order of their alarms."""
    runs: list[list[Change]] = []
    newest: dict[str, list[Change]] = {}
    for change in one.changes:
        run = newest.get(change.name)
        if run is None or change.percent * run[-1].percent <= 0.0 or change.earliest - run[-1].latest > STEP_DAYS * DAY:
            runs.append(newest.setdefault(change.name, []) if run is None else [])
            run = newest[change.name] = runs[-1]
        run.append(change)
    return [run[0] if len(run) == 1 else _as_one(one, run) for run in runs]


def _as_one(one: Watch, run: Sequence[Change]) -> Change:
    """Steps of one coefficient as one jump: its size by the blocks before and after."""
    first, last = run[0], max(run, key=lambda step: step.latest)
    (percent,) = _levels(one, [first._replace(latest=last.latest, percent=sum(step.percent for step in run))])
    verb = "rose" if percent > 0.0 else "fell"
    when, found = one.blocks.between(first.earliest, last.latest), one.blocks.when(first.found)
    told = f"{first.name} {verb} by {abs(percent):.3g} % in {len(run)} steps on {when}, found on {found}"
    cause = next((step.cause for step in run if step.cause in (NOISE, SENSOR)), first.cause)
    return first._replace(latest=last.latest, percent=percent, low=percent, high=percent, cause=cause, told=told)


def _epoch(one: Watch) -> float:
    """When the blocks of a watch begin [s since 1970]; local time counts as UTC."""
    begin = one.blocks.begin
    if begin is None:
        return 0.0
    return (begin if begin.tzinfo is not None else begin.replace(tzinfo=UTC)).timestamp()


def _is_alike(watches: Mapping[str, Watch], changes: Sequence[tuple[str, Change]], i: int, j: int) -> bool:
    """Whether two jumps are of one coefficient, in one direction, about the same date."""
    (name, one), (other_name, other) = changes[i], changes[j]
    if one.name != other.name or one.percent * other.percent <= 0.0:
        return False
    apart = _epoch(watches[name]) + one.time - _epoch(watches[other_name]) - other.time
    return abs(apart) <= SHARED_DAYS * DAY


def _levels(one: Watch, steps: Sequence[Change]) -> list[float]:
    """Level after each of some jumps of a coefficient, less that before the first, in percent of that."""
    time, values = one.blocks.time, next(series.adjusted for series in one.series if series.name == steps[0].name)
    side = SIDE_DAYS * DAY

    def level(low: float, high: float) -> float:
        inside = (time > low) & (time < high) & np.isfinite(values)
        return float(np.median(values[inside])) if inside.any() else math.nan

    before = level(steps[0].earliest - side, steps[0].earliest)
    after = [level(max(a.latest, b.earliest - side), b.earliest) for a, b in itertools.pairwise(steps)]
    after.append(level(steps[-1].latest, steps[-1].latest + side))
    told = np.cumsum([step.percent for step in steps])  # where there are no blocks between two jumps
    found = 100.0 * (np.array(after) / before - 1.0)
    return [float(value) for value in np.where(np.isfinite(found), found, told)]


def _steps_back(one: Watch, steps: Sequence[Change]) -> int:
    """After how many more jumps of a coefficient the first one is taken back; 0 where it is not."""
    levels = _levels(one, [step for step in steps if step.time - steps[0].time <= RETURN_DAYS * DAY])
    back = int(np.argmin(np.abs(levels)))
    return back if abs(levels[back]) <= RETURN_MAX_REST * np.max(np.abs(levels[: back + 1])) else 0


def _went(name: str, steps: Sequence[Change], one: Watch, seconds: Array, temperature: Array) -> Event:
    """What came and went, in words."""
    levels = np.array(_levels(one, steps)[:-1])
    top = int(np.argmax(np.abs(levels)))
    first, reached, begins, last = steps[0], steps[top], steps[top + 1], steps[-1]
    base = _epoch(one)
    inside = (seconds >= base + first.earliest - ICE_DAY) & (seconds <= base + first.latest + ICE_DAY)
    inside &= np.isfinite(temperature)
    mean = float(temperature[inside].mean()) if inside.any() else None
    verbs = ("rose", "fell") if levels[top] > 0.0 else ("fell", "rose")
    when = one.blocks.between(first.earliest, reached.latest), one.blocks.between(begins.earliest, last.latest)
    told = f"{first.name} {verbs[0]} by {abs(levels[top]):.2g} % on {when[0]} and {verbs[1]} again on {when[1]}"
    if mean is None:
        return Event(name, "turbine", told)
    if mean > ICE_MAX_TEMPERATURE or levels[top] > 0.0:
        return Event(name, "turbine", f"{told}, at {round(mean)} °C when it {verbs[0]}")
    return Event(name, "ice", f"{told}, at {round(mean)} °C when it fell: as ice on blades does")

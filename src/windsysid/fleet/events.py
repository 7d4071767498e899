"""What stands out of a fleet, in sentences: jumps, sensors that fail, outliers, each thing once.

A jump that happens while a sensor of the turbine fails is put down to that.
A jump that half of the sisters have on the same date is the season's, the site's or the software's, and no turbine's.
What falls in the cold and comes back is named as ice. A jump with which noise or trust changed is the sensor's
(docs/monitor.md).
"""

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

RETURN_DAYS = 60.0
"""What falls and comes back within so many days came and went."""

RETURN_MAX_REST = 0.5
"""Share of a fall that may be left after it came back."""

ICE_MAX_TEMPERATURE = 2.0
"""Mean temperature [°C] up to which what came and went is named as ice."""

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
    changes = [(name, change) for name, one in watches.items() for change in one.changes]
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
        later = (j for j in range(i + 1, len(changes)) if j not in done)
        back = next((j for j in later if _comes_back(changes[i], changes[j])), None)
        if back is None:
            found.append(Event(name, "turbine", change.told))
            continue
        done.add(back)
        found.append(_went(name, change, changes[back][1], watches[name], *air[name]))
    for one, theirs in meanwhile.items():
        more = f"; jumps found meanwhile, {len(theirs)}, are put down to it" if theirs else ""
        found.append(Event(one.turbine, "shared" if one.shared else "sensor", one.told + more))
    doubtful = {one.turbine for one, theirs in meanwhile.items() if theirs}
    found += [Event(s.turbine, "outlier", s.told) for s in standings if s.outlier and s.turbine not in doubtful]
    return sorted(found, key=lambda event: _WORST.index(event.kind))


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


def _comes_back(one: tuple[str, Change], other: tuple[str, Change]) -> bool:
    """Whether a jump takes back an earlier one of the same coefficient and turbine."""
    (name, first), (other_name, second) = one, other
    near = 0.0 < second.time - first.time <= RETURN_DAYS * DAY
    opposite = first.percent * second.percent < 0.0
    rest = abs(first.percent + second.percent) <= RETURN_MAX_REST * abs(first.percent)
    return name == other_name and first.name == second.name and near and opposite and rest


def _went(name: str, first: Change, second: Change, one: Watch, seconds: Array, temperature: Array) -> Event:
    """What came and went, in words."""
    base = _epoch(one)
    inside = (seconds >= base + first.time) & (seconds <= base + second.time) & np.isfinite(temperature)
    mean = float(temperature[inside].mean()) if inside.any() else None
    verbs = ("rose", "fell") if first.percent > 0.0 else ("fell", "rose")
    when = [one.blocks.between(change.earliest, change.latest) for change in (first, second)]
    told = f"{first.name} {verbs[0]} by {abs(first.percent):.2g} % on {when[0]} and {verbs[1]} again on {when[1]}"
    if mean is None:
        return Event(name, "turbine", told)
    if mean > ICE_MAX_TEMPERATURE or first.percent > 0.0:
        return Event(name, "turbine", f"{told}, at {round(mean)} °C")
    return Event(name, "ice", f"{told}, at {round(mean)} °C: as ice on blades does")

"""Failing sensors: channels with findings week after week, where turbines of the same type have none."""

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.fleet.series import pairs, seconds_of

__all__ = ["Failing", "Weeks", "failing_sensors", "weeks_of"]

WEEK_SECONDS = 7 * 86400.0

MIN_FAILING_SHARE = 0.25
"""Share of a week's records with a finding from which a sensor is named."""

MIN_COMMON_SHARE = 0.05
"""Median share at the other turbines of the type, from which the site or the logger is named instead."""

MIN_WEEKLY_RECORDS = 12
"""Records of a week that are needed."""


class Weeks(NamedTuple):
    """Records of a turbine week by week: number of the week since 1970 (W,), records in it (W,), and how many have a
    finding of each channel and kind (W,)."""

    number: NDArray[np.int64]
    records: NDArray[np.int64]
    findings: dict[str, dict[str, NDArray[np.int64]]]


class Failing(NamedTuple):
    """A sensor that fails.

    Attributes
    ----------
    turbine, channel
        Which.
    kind
        What is found most.
    share
        Of the records of these weeks.
    first, last
        Days on which the first week begins and the last one ends.
    shared
        Whether the other turbines of the type have it too.
    """

    turbine: str
    channel: str
    kind: str
    share: float
    first: str
    last: str
    shared: bool

    def covers(self, seconds: float) -> bool:
        """Test whether a moment [s since 1970] is in these weeks, or in the one before or after."""
        low, high = (datetime.fromisoformat(day).replace(tzinfo=UTC).timestamp() for day in (self.first, self.last))
        return low - WEEK_SECONDS <= seconds <= high + WEEK_SECONDS

    @property
    def sentence(self) -> str:
        """The sentence."""
        who = (
            "other turbines of its type have it too: check the site and the loggers"
            if self.shared
            else "check the sensor"
        )
        return f"{self.channel}: {self.kind} in {100 * self.share:.0f} % of records, {self.first} … {self.last}: {who}"


def weeks_of(table: Any) -> Weeks:
    """Weeks from rows with the columns ``time`` and ``health``."""
    seconds = seconds_of(table)
    week = np.where(np.isfinite(seconds), np.floor(np.nan_to_num(seconds) / WEEK_SECONDS), -1.0).astype(np.int64)
    number = np.unique(week[week >= 0])
    records = np.array([(week == one).sum() for one in number], dtype=np.int64)
    health = pairs(table, "health")
    kinds = np.asarray(health.entries.field("kind").to_numpy(zero_copy_only=False), dtype=object)
    findings: dict[str, dict[str, NDArray[np.int64]]] = {}
    for channel in dict.fromkeys(health.names):
        mine = health.names == channel
        for kind in (*dict.fromkeys(kinds[mine]), ""):  # "" for any of them
            rows = np.unique(health.row[mine & ((kinds == kind) | (kind == ""))])
            counted = np.array([(week[rows] == one).sum() for one in number], dtype=np.int64)
            findings.setdefault(channel, {})[kind] = counted
    return Weeks(number, records, findings)


def failing_sensors(weeks: Mapping[str, Weeks]) -> list[Failing]:
    """Sensors that fail, each stretch of weeks once."""
    found: list[Failing] = []
    for turbine, mine in weeks.items():
        for channel, kinds in mine.findings.items():
            share = kinds[""] / np.maximum(mine.records, 1)
            bad = (share >= MIN_FAILING_SHARE) & (mine.records >= MIN_WEEKLY_RECORDS)
            for first, last in _runs(mine.number, bad):
                part = slice(first, last + 1)
                worst = max((kind for kind in kinds if kind), key=lambda kind: int(kinds[kind][part].sum()))
                of = float(kinds[""][part].sum() / mine.records[part].sum())
                sisters = [other for name, other in weeks.items() if name != turbine]
                shared = _is_shared(sisters, channel, mine.number[part])
                found.append(
                    Failing(turbine, channel, worst, of, _day(mine.number[first]), _day(mine.number[last] + 1), shared)
                )
    return found


def _is_shared(sisters: Sequence[Weeks], channel: str, numbers: NDArray[np.int64]) -> bool:
    """True if this channel of the other turbines of the type has findings in these weeks, too."""
    shares = np.array([_share(other, channel, numbers) for other in sisters])
    known = shares[~np.isnan(shares)]
    return bool(known.size) and float(np.median(known)) >= MIN_COMMON_SHARE


def _share(weeks: Weeks, channel: str, numbers: NDArray[np.int64]) -> float:
    """Share of the records of some weeks with a finding of a channel; NaN without records."""
    there = np.isin(weeks.number, numbers)
    records = int(weeks.records[there].sum())
    if not records:
        return math.nan
    kinds = weeks.findings.get(channel)
    return 0.0 if kinds is None else float(kinds[""][there].sum() / records)


def _runs(number: NDArray[np.int64], bad: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of stretches of bad weeks; a single good or missing week does not end one."""
    runs: list[tuple[int, int]] = []
    for i in np.flatnonzero(bad):
        if runs and number[i] - number[runs[-1][1]] <= 2:
            runs[-1] = (runs[-1][0], int(i))
        else:
            runs.append((int(i), int(i)))
    return runs


def _day(week: int) -> str:
    return datetime.fromtimestamp(float(week) * WEEK_SECONDS, UTC).date().isoformat()

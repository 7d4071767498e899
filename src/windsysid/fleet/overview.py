"""Overview of all turbines of an archive: outliers, jumps, availability, failing sensors.

Each turbine is watched by itself (`windsysid.monitoring.watch`), at a rate of false alarms that is stated for the whole
page and shared out among the turbines. What then looks alike at half of the turbines of the type on the same date is
the site's or the season's, and no turbine's. What falls in the cold and comes back is named as ice.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.fleet.archive import read_table, turbines_of
from windsysid.fleet.events import FleetEvent, events_of
from windsysid.fleet.sensors import Failing, failing_sensors, weeks_of
from windsysid.fleet.series import BLOCK_COLUMNS, blocks_of, numbers, pairs, seconds_of, texts, unidentified
from windsysid.fleet.sisters import MIN_TURBINES_OF_TYPE, Standing, stand
from windsysid.monitoring.changes import Watch
from windsysid.monitoring.watch import watch
from windsysid.output.answers import SummarisedAnswer
from windsysid.output.progress import Progress, unheard
from windsysid.output.table import Table
from windsysid.results.identification import USABLE

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Glance", "Overview", "oversee", "overview_of"]

OUTLIER_PROBABILITY = 0.05
"""Probability of an outlier on the page of a healthy fleet: one page in twenty."""


class Glance(NamedTuple):
    """The records of one turbine.

    Attributes
    ----------
    records, identified, refused, failed
        How many.
    trusted
        Share of the identified ones [1].
    usable
        In how many of them each coefficient, frequency and damping ratio has grade A or B.
    available
        Share of the time from the archive's first record to its last that identified records cover [1].
    months
        The same month by month, by ``2026-03``.
    states
        Share of the records in each state [1].
    reasons
        Why records were refused or failed, the commonest first.
    """

    records: int
    identified: int
    refused: int
    failed: int
    trusted: float
    usable: Mapping[str, int]
    available: float
    months: Mapping[str, float]
    states: Mapping[str, float]
    reasons: Sequence[tuple[str, int]]

    @property
    def least_usable(self) -> str:
        """The quantity that fewest identified records determine, and the share of them that do."""
        name = min(self.usable, key=lambda name: self.usable[name], default=None)
        return "–" if name is None else f"{name} {100.0 * self.usable[name] / self.identified:.0f} %"


@dataclass(frozen=True, eq=False)
class Overview(SummarisedAnswer):
    """A fleet at a glance.

    Attributes
    ----------
    archive
        Its folder.
    glances
        Of each turbine.
    watches
        Of each turbine that could be watched.
    standings
        Coefficients of turbines, compared within the type.
    failing
        Sensors that fail.
    events
        What stands out, the worst first.
    alarms_per_year
        False alarms that are accepted in a year, all turbines together.
    notes
        What a reader must know.
    """

    archive: Path
    glances: Mapping[str, Glance]
    watches: Mapping[str, Watch]
    standings: tuple[Standing, ...]
    failing: tuple[Failing, ...]
    events: tuple[FleetEvent, ...]
    alarms_per_year: float
    notes: tuple[str, ...] = field(default=())

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each turbine: ``turbine``; ``records``, and how many were ``identified``, ``refused`` or
        ``failed``; the shares ``trusted`` and ``available`` [1]; ``changes``, how many jumps."""
        import pandas as pd

        rows = []
        for name, g in self.glances.items():
            jumps = len(self.watches[name].changes) if name in self.watches else 0
            rows.append((name, g.records, g.identified, g.refused, g.failed, g.trusted, g.available, jumps))
        columns = ["turbine", "records", "identified", "refused", "failed", "trusted", "available", "changes"]
        return pd.DataFrame(rows, columns=columns)

    @property
    def size(self) -> str:
        """Number of turbines, in words."""
        return f"{len(self.glances)} turbine{'s' * (len(self.glances) != 1)}"

    @property
    def sentences(self) -> list[str]:
        """Findings, one sentence each."""
        if not self.events and not self.watches:
            return [f"no turbine is watched ({self.size}): too few records with a result"]
        if not self.events:
            return [f"nothing stands out in {self.size}"]
        return [f"{event.turbine}: {event.sentence}" for event in self.events]

    def tables(self) -> list[Table]:
        """One line a turbine."""
        rows = []
        for name, glance in self.glances.items():
            mine = [s for s in self.standings if s.turbine == name]
            far = max(mine, key=lambda s: abs(s.score), default=None)
            kinds = [event.kind for event in self.events if name in event.turbine.split(", ")]
            rows.append((
                name, ", ".join(dict.fromkeys(kinds)) or "–", f"{glance.records}", f"{glance.identified}",
                glance.least_usable, f"{100.0 * glance.available:.0f} %",
                ", ".join(f"{100.0 * share:.0f} % {state}" for state, share in glance.states.items()),
                "" if far is None else f"{far.name} {far.percent:+.2g} %",
            ))  # fmt: skip
        headings = (
            "turbine", "stands out", "records", "identified", "least usable", "available", "states", "off its type",
        )  # fmt: skip
        compared = len(headings) - (not self.standings)
        return [Table(headings[:compared], [row[:compared] for row in rows], self.size, words=(0, 1, 4, 6, 7))]

    def summary(self) -> dict[str, Any]:
        """Plain values, for ``summary.json``."""
        return {
            "archive": str(self.archive),
            "alarms_per_year": self.alarms_per_year,
            "events": [event._asdict() for event in self.events],
            "turbines": {
                name: {
                    **{key: value for key, value in glance._asdict().items() if key != "reasons"},
                    "reasons": [{"why": why, "records": count} for why, count in glance.reasons],
                    "changes": [c._asdict() for c in self.watches[name].changes] if name in self.watches else [],
                }
                for name, glance in self.glances.items()
            },
            "sisters": [standing._asdict() for standing in self.standings],
            "sensors": [one._asdict() for one in self.failing],
            "notes": list(self.notes),
        }

    def __repr__(self) -> str:
        return f"<Overview of {self.size}: {'; '.join(self.sentences)}>"

    def contents(self) -> list[Table | str]:
        """The sentences, the tables, the notes."""
        return [*self.sentences, *self.tables(), *self.notes]


def oversee(archive: str | Path, *, alarms_per_year: float = 0.1, progress: Progress = unheard) -> Overview:
    """Look over all turbines of an archive.

    Parameters
    ----------
    archive
        Folder that ``windsysid batch`` wrote.
    alarms_per_year
        False alarms of jumps that are accepted in a year, all turbines together.
    progress
        Callback with the name of the step and its completed share, 0 to 1; None if unknown.

    Raises
    ------
    ConfigurationError
        If the folder is no archive, or the rate is out of range.
    """
    tables = {}
    names = turbines_of(archive)
    for i, name in enumerate(names):
        progress(f"reading {name}", i / len(names))
        tables[name] = read_table(archive, name, (*BLOCK_COLUMNS, "modes", "duration", "health"))
    return overview_of(tables, Path(archive), alarms_per_year=alarms_per_year, progress=progress)


def overview_of(
    tables: Mapping[str, Any], archive: Path, *, alarms_per_year: float, progress: Progress = unheard
) -> Overview:
    """Overview of rows by turbine that have been read."""
    notes: list[str] = []
    if why := unidentified(tables.values()):
        raise ConfigurationError(f"archive {archive}: {why}")
    seconds = np.concatenate([seconds_of(table) for table in tables.values()])
    if not np.isfinite(seconds).any():
        raise ConfigurationError(
            f"archive {archive}: no record says when it began, so nothing can be put in order: give [time] start in a"
            " mapping, and batch again"
        )
    span = float(np.nanmin(seconds)), float(np.nanmax(seconds))
    watches: dict[str, Watch] = {}
    for i, (name, table) in enumerate(tables.items()):
        progress(f"watching {name}", i / len(tables))
        try:
            watches[name] = watch(blocks_of(table), alarms_per_year=alarms_per_year / len(tables))
        except ConfigurationError as error:
            notes.append(f"{name} is not watched: {error}")
    glances = {name: _glance(table, *span) for name, table in tables.items()}
    failing = failing_sensors({name: weeks_of(table) for name, table in tables.items()})
    standings = _standings(watches)
    if len(watches) < MIN_TURBINES_OF_TYPE:
        notes.append(f"comparison within a turbine type needs at least {MIN_TURBINES_OF_TYPE} turbines")
    air = {name: (seconds_of(table), numbers(table, "scada_temperature")) for name, table in tables.items()}
    events = events_of(watches, failing, standings, air)
    return Overview(
        archive, glances, watches, tuple(standings), tuple(failing), tuple(events), alarms_per_year, tuple(notes)
    )


def _glance(table: Any, begin: float, end: float) -> Glance:
    status, seconds, duration = texts(table, "status"), seconds_of(table), numbers(table, "duration")
    ok = status == "ok"
    trusted = np.array([value is True for value in table["trusted"].to_pylist()], dtype=bool)
    dated = ok & np.isfinite(seconds) & np.isfinite(duration)
    step = _step(seconds)  # a record stands for the time up to the next: loggers leave gaps of a sample
    cover = np.minimum(np.maximum(duration, step if step < 1.1 * np.nanmedian(duration) else 0.0), 86400.0)
    months: dict[str, float] = {}
    for month, (low, high) in _months(begin, end).items():
        inside = dated & (seconds >= low) & (seconds < high)
        months[month] = min(float(cover[inside].sum() / (high - low)), 1.0)
    whole = min(float(cover[dated].sum() / max(end - begin, 1.0)), 1.0)
    states = Counter(one for one in texts(table, "state") if one is not None)
    why = Counter(_kind_of(text) for text in texts(table, "why") if text)
    count = len(status)
    return Glance(
        count, int(ok.sum()), int((status == "refused").sum()), int((status == "failed").sum()),
        float(trusted[ok].mean()) if ok.any() else 0.0, _usable(table), whole, months,
        {state: of / count for state, of in states.most_common()}, why.most_common(5),
    )  # fmt: skip


def _usable(table: Any) -> dict[str, int]:
    """In how many rows each coefficient, frequency and damping ratio has grade A or B."""
    found = dict[str, int]()
    coefficients, modes = pairs(table, "parameters"), pairs(table, "modes")
    graded = [(coefficients, "grade", ""), *((modes, f"{of}_grade", f" {of}") for of in ("frequency", "damping_ratio"))]
    for of, key, suffix in graded:
        good = np.isin(of.grades(table, key), USABLE)
        found |= {
            f"{name}{suffix.replace('_', ' ')}": int(good[of.names == name].sum()) for name in dict.fromkeys(of.names)
        }
    return found


def _step(seconds: Array) -> float:
    """Usual time from one record to the next [s]."""
    known = np.sort(seconds[np.isfinite(seconds)])
    return float(np.median(np.diff(known))) if len(known) > 1 else 0.0


def _kind_of(why: str) -> str:
    """A reason without the name of the file and numbers, so that like ones are counted together."""
    words = why.split(": ")
    return ": ".join(word for word in words if "/" not in word and ".csv" not in word)[:120] or why[:120]


def _months(begin: float, end: float) -> dict[str, tuple[float, float]]:
    """Months from begin to end, with the part of each in between [s since 1970]."""
    found: dict[str, tuple[float, float]] = {}
    at = datetime.fromtimestamp(begin, UTC)
    month = datetime(at.year, at.month, 1, tzinfo=UTC)
    while month.timestamp() < end:
        following = datetime(month.year + month.month // 12, month.month % 12 + 1, 1, tzinfo=UTC)
        found[f"{month:%Y-%m}"] = max(begin, month.timestamp()), min(end, following.timestamp())
        month = following
    return found


def _standings(watches: Mapping[str, Watch]) -> list[Standing]:
    """Turbines that have the same coefficients, against each other, at the same covariates."""
    kinds: dict[tuple[tuple[str, str, float], ...], list[str]] = {}
    for name, one in watches.items():
        kinds.setdefault(_coefficients(one), []).append(name)
    tests = sum(len(key) for key, names in kinds.items() if len(names) >= MIN_TURBINES_OF_TYPE)
    found: list[Standing] = []
    for key, names in kinds.items():
        means = _common_means([watches[name] for name in names])
        for coefficient, *_ in key:
            levels = {name: _level(watches[name], coefficient, means) for name in names}
            found += stand(levels, coefficient, OUTLIER_PROBABILITY / max(tests, 1))
    return found


def _coefficients(one: Watch) -> tuple[tuple[str, str, float], ...]:
    """Name, unit and reference of each coefficient that is watched."""
    reference = dict(zip(one.blocks.names, one.blocks.reference, strict=True))
    coefficients = (s for i, s in enumerate(one.series) if one.blocks.kind(i) != "noise")
    return tuple((s.name, s.unit, reference[s.name]) for s in coefficients)


def _learned_means(one: Watch) -> dict[str, float]:
    with np.errstate(invalid="ignore"):
        means = np.nanmean(one.blocks.covariates[: one.begins], axis=0)
    return dict(zip(one.blocks.covariate_names, means.tolist(), strict=True))


def _common_means(watches: Sequence[Watch]) -> dict[str, float]:
    each = [_learned_means(one) for one in watches]
    shared = [name for name in each[0] if all(name in means for means in each)]
    return {name: float(np.mean([means[name] for means in each])) for name in shared}


def _level(one: Watch, coefficient: str, means: Mapping[str, float]) -> tuple[float, float]:
    """Level now and its standard deviation, at covariates that all have in common."""
    series = next(s for s in one.series if s.name == coefficient)
    own = _learned_means(one)
    moved = sum(series.slopes[name][0] * (mean - own[name]) for name, mean in means.items() if name in series.slopes)
    level = float(series.level[-1])
    return level * (1.0 + 0.01 * moved), 0.25 * float(series.high[-1] - series.low[-1])

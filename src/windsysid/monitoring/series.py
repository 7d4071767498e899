"""What records say, one after the other: the series that the watch follows.

A block is one record's estimates without their prior, the noise found in its sensors, and the covariates of its time.
"""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.monitoring.own_information import without_prior
from windsysid.records.moments import moment
from windsysid.results.posterior import SIGMAS, Posterior, load_posterior

__all__ = ["DAY", "MIN_BLOCKS", "Blocks", "gather", "read_blocks"]


MIN_BLOCKS = 12
"""Blocks that a watch needs."""

DAY = 86400.0


@dataclass(frozen=True, eq=False)
class Blocks:
    """What records say, one after the other.

    Attributes
    ----------
    names
        Of the n series: coefficients, and ``noise_…`` for what was found of sensors.
    time
        (T,) [s], increasing.
    theta, std
        (T, n) estimates in filter coordinates without their prior, and standard deviations; NaN where a record says
        nothing.
    logarithmic
        Of each series, whether θ is a logarithm.
    reference
        Of each series, the value at θ = 0 (logarithmic) or θ = 1.
    units
        SI unit of each series, ``1`` for noise; empty where nobody says them.
    covariates
        (T, m); a block without all of them is left out.
    covariate_names
        Of the m.
    trusted
        (T,) whether nothing spoke against the record's result.
    records
        Names of the T records; empty where they have none.
    begin
        Calendar time of time 0, where it is known.
    notes
        How the records were put in order, and what speaks against it.
    """

    names: tuple[str, ...]
    time: Array
    theta: Array
    std: Array
    logarithmic: tuple[bool, ...]
    reference: tuple[float, ...]
    covariates: Array
    covariate_names: tuple[str, ...] = ()
    trusted: NDArray[np.bool_] | None = None
    records: tuple[str, ...] = ()
    begin: datetime | None = None
    notes: tuple[str, ...] = ()
    units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        shape = (len(self.time), len(self.names))
        for what, value in (("theta", self.theta), ("std", self.std)):
            if value.shape != shape:
                raise ConfigurationError(f"blocks: expected {what} of shape {shape}, got {value.shape}")
        if self.covariates.shape != (shape[0], len(self.covariate_names)):
            raise ConfigurationError(
                f"blocks: expected covariates of shape {(shape[0], len(self.covariate_names))}, got"
                f" {self.covariates.shape}"
            )
        if shape[0] < MIN_BLOCKS:
            raise ConfigurationError(f"blocks: expected at least {MIN_BLOCKS} records to learn from, got {shape[0]}")
        if not (np.diff(self.time) > 0.0).all():
            raise ConfigurationError(
                "blocks: expected times that increase from record to record: put the records in order"
            )
        if not (self.std[np.isfinite(self.std)] > 0.0).all():
            raise ConfigurationError("blocks: expected positive standard deviations")

    def when(self, seconds: float) -> str:
        """A time of these blocks as a date, or as a day since the first."""
        if self.begin is None:
            return f"day {seconds / DAY:.2f}"
        return (self.begin + timedelta(seconds=seconds)).isoformat(sep=" ", timespec="minutes")

    def between(self, earliest: float, latest: float) -> str:
        """An interval of time, in one word where it is one block."""
        return self.when(latest) if earliest == latest else f"{self.when(earliest)} … {self.when(latest)}"


def gather(
    posteriors: Sequence[Posterior],
    *,
    time: Array | None = None,
    covariates: Mapping[str, Array] | None = None,
    noise: Sequence[Mapping[str, tuple[float, float]]] = (),
    begin: datetime | None = None,
) -> Blocks:
    """Blocks from the posteriors of records, each less its prior, in the coordinates of the first.

    Without `time`, the records are put in order of when they began, where all of them say it; otherwise they stay as
    given, 10 minutes apart.

    Parameters
    ----------
    posteriors
        Of T records of one turbine.
    time
        (T,) [s], increasing.
    covariates
        (T,) of each name, for the posteriors as they are given.
    noise
        For each record, noise of sensors with its standard deviation relative to itself.
    begin
        Calendar time of time 0.

    Raises
    ------
    ConfigurationError
        If records are too few, times do not increase, two records began at the same time, some say their zone and some
        do not, or lengths disagree.
    """
    count = len(posteriors)
    if count < MIN_BLOCKS:
        raise ConfigurationError(f"expected at least {MIN_BLOCKS} records to learn from, got {count}")
    columns = {name: np.asarray(values, dtype=np.float64) for name, values in (covariates or {}).items()}
    notes: list[str] = []
    spans = _spans(posteriors) if time is None else None
    if spans is not None:
        order = sorted(range(count), key=[span.begin for span in spans].__getitem__)
        posteriors, spans = [posteriors[i] for i in order], [spans[i] for i in order]
        noise = [noise[i] for i in order] if noise else ()
        columns = {name: values[order] for name, values in columns.items()}
        notes += _overlaps(spans)
        begin = first = spans[0].begin
        time = np.array([(span.begin - first).total_seconds() for span in spans], dtype=np.float64)
    elif time is None:
        silent = sum(posterior.start is None for posterior in posteriors)
        notes.append(
            f"{silent} of {count} records do not say when they began: they were taken in the order given, 10 minutes"
            " apart"
        )
        time = np.asarray(600.0 * np.arange(count), dtype=np.float64)
    frame = posteriors[0]
    names = [q.name for q in frame.parameters]
    sensors = sorted({name for found in noise for name in found})
    theta = np.full((count, len(names) + len(sensors)), np.nan)
    std = theta.copy()
    for row, posterior in enumerate(posteriors):
        known = [q for q in frame.parameters if q.name in [own.name for own in posterior.parameters]]
        at = [names.index(q.name) for q in known]
        theta[row, at], cov = without_prior(posterior, known)
        std[row, at] = np.sqrt(np.diag(cov))
    for row, found in enumerate(noise):
        for name, (value, relative) in found.items():
            theta[row, len(names) + sensors.index(name)] = math.log(value)
            std[row, len(names) + sensors.index(name)] = relative
    return Blocks(
        names=(*names, *sensors),
        time=np.asarray(time, dtype=np.float64),
        theta=theta,
        std=std,
        logarithmic=(*(q.logarithmic for q in frame.parameters), *(True for _ in sensors)),
        reference=(*(q.reference for q in frame.parameters), *(1.0 for _ in sensors)),
        covariates=np.column_stack(list(columns.values())) if columns else np.empty((count, 0)),
        covariate_names=tuple(columns),
        trusted=np.array([posterior.trusted for posterior in posteriors]),
        records=tuple(posterior.record for posterior in posteriors),
        units=(*(posteriors[0].turbine.model.coefficient(name).unit for name in names), *("1" for _ in sensors)),
        begin=begin,
        notes=tuple(notes),
    )


class _Span(NamedTuple):
    """When what was used of a record began and ended."""

    begin: datetime
    end: datetime
    record: str


def _spans(posteriors: Sequence[Posterior]) -> list[_Span] | None:
    """Of each record; None if one does not say it; ConfigurationError if they cannot be compared."""
    spans = []
    for posterior in posteriors:
        if posterior.start is None or posterior.section is None:
            return None
        begin, end = (moment(posterior.start) + timedelta(seconds=seconds) for seconds in posterior.section)
        spans.append(_Span(begin, end, posterior.record))
    with_zone = [span.record for span in spans if span.begin.tzinfo is not None]
    without = [span.record for span in spans if span.begin.tzinfo is None]
    if with_zone and without:
        raise ConfigurationError(
            f"records with a zone ('{with_zone[0]}') and without ('{without[0]}') cannot be put in order: give the zone"
            " in the mapping file, [time] zone, and identify again"
        )
    return spans


def _overlaps(spans: Sequence[_Span]) -> list[str]:
    """Describe records, in order, that begin before the one before has ended.

    Raises ConfigurationError if two begin together.
    """
    found: list[tuple[_Span, _Span]] = []
    latest = spans[0]
    for span in spans[1:]:
        if span.begin == latest.begin:
            raise ConfigurationError(
                f"'{latest.record}' and '{span.record}' begin at the same time, {span.begin.isoformat()}: leave one of"
                " them out"
            )
        if span.begin < latest.end:
            found.append((latest, span))
        latest = max(latest, span, key=lambda one: one.end)
    if not found:
        return []
    (one, other), more = found[0], len(found) - 1
    seconds = (min(one.end, other.end) - other.begin).total_seconds()
    others = f", and {more} more" if more else ""
    return [
        f"'{one.record}' and '{other.record}' overlap by {seconds:.4g} s{others}: what both hold is counted twice,"
        " which the alarms do not know"
    ]


def read_blocks(folders: Sequence[str | Path], covariates: str | Path | None = None) -> Blocks:
    """Blocks from folders that ``windsysid identify`` wrote, and a CSV file of covariates with a line for each.

    Records that say when they began are put in order of time. Folders of others are taken in the order given; where
    that is the alphabetical one, as a shell gives it, in natural order: ``res-2`` before ``res-10``.

    The file's columns but ``time`` and ``folder`` are covariates; an empty cell is a missing value. Its lines belong to
    the folders named in the column ``folder``; without one, to the records that began at their ``time`` (ISO 8601),
    where both are known; otherwise to the folders in their order. Where records do not say when they began, ``time``,
    in seconds or as ISO 8601, says it.

    Raises
    ------
    ConfigurationError
        If a folder holds no result, records cannot be put in order, or the file does not fit.
    """
    found = [(Path(folder), load_posterior(folder)) for folder in folders]
    spans = _spans([posterior for _, posterior in found])
    notes: list[str] = []
    if spans is None:
        texts = [str(folder) for folder, _ in found]
        natural = sorted(range(len(found)), key=lambda i: _natural(texts[i]))
        if texts == sorted(texts) and natural != sorted(natural):
            found = [found[i] for i in natural]
            notes.append(f"folders were taken in natural order, {found[0][0].name} … {found[-1][0].name}")
    silent = sum(posterior.record_hash is None for _, posterior in found)
    if silent:
        notes.append(
            f"{silent} results of an older version do not hold the noise of their sensors, which is not watched in"
            " them: identify again"
        )
    columns: dict[str, Array] = {}
    time, begin = None, None
    if covariates is not None:
        table = _read_table(Path(covariates), len(found))
        rows = _lines_of(table, [folder for folder, _ in found], spans)
        if spans is None and table.time is not None:
            if table.folders:
                order = np.argsort(table.time[rows])
                found, rows = [found[i] for i in order], [rows[i] for i in order]
            time, begin = table.time[rows], table.dates[0] if table.dates else None
        columns = {name: values[rows] for name, values in table.columns.items()}
    posteriors = [posterior for _, posterior in found]
    noise = [_noise(posterior) for posterior in posteriors]
    blocks = gather(posteriors, time=time, covariates=columns, noise=noise, begin=begin)
    return replace(blocks, notes=(*notes, *blocks.notes))


def _natural(text: str) -> list[tuple[int, str]]:
    """A key that sorts numbers in text by their size."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", text) if part]


def _noise(posterior: Posterior) -> dict[str, tuple[float, float]]:
    """Noise of sensors, each with its relative standard deviation."""
    return {
        s.name: (s.estimate, math.log(s.high / s.low) / (2.0 * SIGMAS))
        for s in posterior.statistics
        if s.name.startswith("noise_") and s.estimate > 0.0 and math.inf > s.high > s.low > 0.0
    }


class _Table(NamedTuple):
    """A file of covariates: columns (T,), time [s] from the first line, the dates, and the folders if it names them."""

    path: Path
    columns: dict[str, Array]
    time: Array | None
    dates: list[datetime]
    folders: list[str]


def _read_table(path: Path, count: int) -> _Table:
    """A CSV file with one line a record."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = list(csv.DictReader(file))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"covariates {path}: cannot be read: {error}") from None
    if len(lines) != count:
        raise ConfigurationError(f"covariates {path}: expected {count} lines, one for each record, got {len(lines)}")
    columns: dict[str, Array] = {}
    time, dates, folders = None, list[datetime](), list[str]()
    for name in lines[0]:
        texts = [(line[name] or "").strip() for line in lines]
        if name == "folder":
            folders = texts
            continue
        if name == "time" and not _is_number(texts[0]):
            try:
                dates = [datetime.fromisoformat(text) for text in texts]
                time = np.array([(date - dates[0]).total_seconds() for date in dates])
            except (ValueError, TypeError):
                raise ConfigurationError(
                    f"covariates {path}: expected times in seconds or as 2026-03-31T12:00, got {texts[0]!r}"
                ) from None
            continue
        bad = [text for text in texts if text and not _is_number(text)]
        if bad:
            raise ConfigurationError(
                f"covariates {path}: expected numbers in column '{name}', got {bad[0]!r}: leave the column out"
            )
        columns[name] = np.array([float(text) if text else math.nan for text in texts])
    return _Table(path, columns, columns.pop("time", time), dates, folders)


def _lines_of(table: _Table, folders: Sequence[Path], spans: Sequence[_Span] | None) -> list[int]:
    """The line of each folder; ConfigurationError where that is not sure."""
    count = len(folders)
    order = list(range(count)) if spans is None else sorted(range(count), key=lambda i: spans[i].begin)
    hint = "add a column 'folder' with the names of the folders"
    if table.folders:
        lines: dict[str, list[int]] = {}
        for line, name in enumerate(table.folders):
            lines.setdefault(name, []).append(line)
        for folder in folders:
            if len(lines.get(folder.name, [])) != 1:
                raise ConfigurationError(
                    f"covariates {table.path}: expected one line of folder '{folder.name}', got"
                    f" {len(lines.get(folder.name, []))}"
                )
        return [lines[folder.name][0] for folder in folders]
    if spans is not None and table.dates and (table.dates[0].tzinfo is None) == (spans[0].begin.tzinfo is None):
        rows = [0] * count
        for i, line in zip(order, sorted(range(count), key=lambda k: table.dates[k]), strict=True):
            if abs(table.dates[line] - spans[i].begin) > spans[i].end - spans[i].begin:
                raise ConfigurationError(
                    f"covariates {table.path}: no line has the time of '{folders[i].name}',"
                    f" {spans[i].begin.isoformat()}: correct it, or {hint}"
                )
            rows[i] = line
        return rows
    if spans is not None:
        rising = order == list(range(count)) if table.time is None else bool((np.diff(table.time[order]) > 0.0).all())
        if not rising:
            raise ConfigurationError(
                f"covariates {table.path}: the order of its lines contradicts when the records began: {hint}"
            )
    return list(range(count))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True

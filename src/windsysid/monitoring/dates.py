"""Order of records in time."""

from collections.abc import Mapping, Sequence
from datetime import datetime, timedelta
from typing import NamedTuple, Protocol

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.records.moments import moment

__all__ = ["MIN_BLOCKS", "Dated", "Order", "Span", "in_order", "spans_of"]

MIN_BLOCKS = 12
"""Blocks that a watch needs."""


class Dated(Protocol):
    """What says of which record it is, and when that began."""

    @property
    def record(self) -> str:
        """Its name."""

    @property
    def start(self) -> str | None:
        """The moment of the record's time 0."""

    @property
    def section(self) -> tuple[float, float] | None:
        """What was used of it [s]."""


class Order(NamedTuple):
    """Results in order of time: which is which, times (T,) [s], covariates (T, m), calendar time of time 0, and what
    was done."""

    order: list[int]
    time: Array
    covariates: Array
    begin: datetime | None
    notes: tuple[str, ...]


def in_order(
    results: Sequence[Dated], time: Array | None, covariates: Mapping[str, Array] | None, begin: datetime | None
) -> Order:
    """Put results in order, as `gather` says.

    Raises
    ------
    ConfigurationError
        As `gather` does.
    """
    count = len(results)
    if count < MIN_BLOCKS:
        raise ConfigurationError(
            f"expected at least {MIN_BLOCKS} records to learn from, got {count}; identify more, or use compare for two"
        )
    notes: list[str] = []
    order = list(range(count))
    spans = spans_of(results) if time is None else None
    if spans is not None:
        order = sorted(range(count), key=[span.begin for span in spans].__getitem__)
        notes += _overlaps([spans[i] for i in order])
        begin = first = spans[order[0]].begin
        time = np.array([(spans[i].begin - first).total_seconds() for i in order], dtype=np.float64)
    elif time is None:
        silent = sum(result.start is None for result in results)
        notes.append(
            f"{silent} of {count} records do not say when they began: they were taken in the order given, 10 minutes"
            " apart"
        )
        time = np.asarray(600.0 * np.arange(count), dtype=np.float64)
    table = _table(covariates or {}, count)[order]
    return Order(order, np.asarray(time, dtype=np.float64), table, begin, tuple(notes))


def _table(covariates: Mapping[str, Array], count: int) -> Array:
    """Covariates as columns (T, m)."""
    table = np.empty((count, len(covariates)))
    for i, (name, values) in enumerate(covariates.items()):
        if np.shape(values) != (count,):
            raise ConfigurationError(
                f"covariates: expected {count} values of {name}, one for each record, got {np.shape(values)}"
            )
        table[:, i] = values
    return table


class Span(NamedTuple):
    """When what was used of a record began and ended."""

    begin: datetime
    end: datetime
    record: str


def spans_of(results: Sequence[Dated]) -> list[Span] | None:
    """Of each record; None if one does not say it; ConfigurationError if they cannot be compared."""
    spans = []
    for result in results:
        if result.start is None or result.section is None:
            return None
        begin, end = (moment(result.start) + timedelta(seconds=seconds) for seconds in result.section)
        spans.append(Span(begin, end, result.record))
    by_zone = {span.begin.tzinfo is not None: span.record for span in reversed(spans)}
    if len(by_zone) > 1:
        raise ConfigurationError(
            f"records with a zone ('{by_zone[True]}') and without ('{by_zone[False]}') cannot be put in order: give the"
            " zone in the mapping file, [time] zone, and identify again"
        )
    return spans


def _overlaps(spans: Sequence[Span]) -> list[str]:
    """Describe records, in order, that begin before the one before has ended.

    Raises ConfigurationError if two begin together.
    """
    found: list[tuple[Span, Span]] = []
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

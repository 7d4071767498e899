"""A record as the blocks that its logger would have sent."""

import itertools
from collections.abc import Iterator

import numpy as np

from windsysid.errors import ConfigurationError, RecordError
from windsysid.live.blocks.block import Block
from windsysid.records.moments import has_zone, nanoseconds
from windsysid.records.record import Record

__all__ = ["begin_of", "blocks_of", "even_rate", "moment_ns"]

SECOND = 1_000_000_000
"""Nanoseconds."""

_MIN_GAP_STEPS = 1.5
"""Steps: a longer one is a gap."""

_MAX_OFF_GRID_STEPS = 0.25
"""Of a step: a sample farther from its block's grid is not evenly spaced."""

_MAX_ROUNDING_STEPS = 0.05
"""Of a step: how far a rate with fewer digits may move the last sample."""


def moment_ns(text: str) -> int:
    """A moment with its zone, such as ``2026-01-05T12:00:00Z`` [ns since 1970, UTC].

    Raises
    ------
    ConfigurationError
        If it is none, or has no zone.
    """
    try:
        known = has_zone(text)
    except ValueError as error:
        raise ConfigurationError(str(error)) from None
    if not known:
        raise ConfigurationError(f"expected a moment with its zone, such as 2026-01-05T12:00:00Z, got '{text[:40]}'")
    return nanoseconds(text)


def begin_of(record: Record) -> int | None:
    """The moment of a record's time 0 [ns since 1970, UTC]; None where it is not known, or only on a local clock."""
    if record.start is None or not has_zone(record.start):
        return None
    return moment_ns(record.start)


def even_rate(record: Record) -> float:
    """The rate of a record [Hz] with no more digits than its times tell apart: that of the next file is the same."""
    rate = record.rate
    for digits in range(3, 12):
        rounded = float(f"{rate:.{digits}g}")
        if record.duration * abs(1.0 - rounded / rate) <= _MAX_ROUNDING_STEPS / rate:
            return rounded
    return rate


def blocks_of(record: Record, turbine: str, begin: int, *, seconds: float = 1.0, stream: str = "") -> Iterator[Block]:
    """The blocks of a record, in order; each one's number is its start.

    Parameters
    ----------
    turbine
        Its name in the service.
    begin
        The moment of the record's time 0 [ns since 1970, UTC].
    seconds
        Length of a block [s]; one before a gap is shorter, and none is shorter than a sample.
    stream
        Which of the turbine's loggers it is of.

    Raises
    ------
    RecordError
        If samples between two gaps are not evenly spaced.
    """
    rate = even_rate(record)
    length = max(1, round(seconds * rate))
    edges = [0, *(np.flatnonzero(np.diff(record.time) * rate > _MIN_GAP_STEPS) + 1).tolist(), record.samples]
    for first, last in itertools.pairwise(edges):
        for low in range(first, last, length):
            high = min(low + length, last)
            place = (record.time[low:high] - record.time[low]) * rate
            off = np.abs(place - np.arange(high - low))
            if off.max() > _MAX_OFF_GRID_STEPS:
                raise RecordError(
                    f"{record.name}: samples at {record.time[low]:.6g} s are not evenly spaced: expected one rate,"
                    f" {rate:.6g} Hz; put them on one rate first"
                )
            start = begin + round(float(record.time[low]) * SECOND)
            yield Block(turbine, start, start, rate, record.channels, record.units, record.values[low:high], stream)

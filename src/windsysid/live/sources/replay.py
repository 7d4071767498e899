"""A record that is played as if it were measured now: no broker, nothing else running."""

import asyncio
import itertools
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

from windsysid.live.blocks.block import Block
from windsysid.live.sources.cutting import SECOND, begin_of, blocks_of
from windsysid.live.sources.source import Commits, Push, SourceState, stopped_within
from windsysid.records.formats import iterate_record
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.record import Record

__all__ = ["Replay", "begin_or_now", "paced", "record_blocks"]

_PIECE_SECONDS = 600.0
"""Of a file that is in memory at once [s]."""


class Replay:
    """Plays a record at any speed.

    Parameters
    ----------
    record
        A record, or the path of a file of one.
    turbine
        Its name in the service.
    speed
        How many times faster than it was recorded; 0 is as fast as its blocks are taken.
    seconds
        Length of a block [s].
    begin
        The moment of the record's time 0 [ns since 1970]; by default `begin_or_now`.
    stream
        Which of the turbine's loggers it is of.
    mapping
        What the columns of the file are.
    """

    def __init__(
        self,
        record: Record | str | Path,
        turbine: str,
        *,
        speed: float = 1.0,
        seconds: float = 1.0,
        begin: int | None = None,
        stream: str = "",
        mapping: str | Path | Mapping | None = None,
    ) -> None:
        self.record, self.turbine, self.speed = record, turbine, speed
        self.seconds, self.begin, self.stream, self.mapping = seconds, begin, stream, mapping
        self.state = SourceState()

    def describe(self) -> str:
        """The record, and how fast it is played."""
        name = self.record.name if isinstance(self.record, Record) else str(self.record)
        return f"replay of {name} as {self.turbine}" + (f", {self.speed:g} ×" if self.speed else "")

    async def run(self, push: Push, stop: asyncio.Event) -> None:
        """Play the record once.

        Raises
        ------
        RecordError, ConfigurationError
            If the record cannot be read.
        """
        begin = self.begin
        if begin is None:
            begin = await asyncio.to_thread(begin_or_now, self.record, self.speed, self.mapping)
        blocks = record_blocks(
            self.record, self.turbine, begin, seconds=self.seconds, stream=self.stream, mapping=self.mapping
        )
        self.state = self.state._replace(state="running")
        commits = Commits(self)
        began = first = None
        while (block := await asyncio.to_thread(next, blocks, None)) is not None and not stop.is_set():
            if began is None or first is None:
                began, first = time.monotonic(), block.start
            due = began + _due(block, first) / self.speed if self.speed else 0.0
            if self.speed and await stopped_within(stop, due - time.monotonic()):
                break
            await commits.push(push, block)
        await commits.finish()
        self.state = self.state._replace(state="ended")


def paced(blocks: Iterator[Block], speed: float) -> Iterator[Block]:
    """Blocks when their last sample is due, `speed` times faster than they were recorded; at once where it is 0."""
    began = first = None
    for block in blocks:
        if began is None or first is None:
            began, first = time.monotonic(), block.start
        if speed:
            time.sleep(max(0.0, began + _due(block, first) / speed - time.monotonic()))
        yield block


def _due(block: Block, first: int) -> float:
    """When a block is over, from the start of the first one [s]."""
    return (block.start - first) / SECOND + len(block.values) / block.rate


def begin_or_now(record: Record | str | Path, speed: float, mapping: str | Path | Mapping | None = None) -> int:
    """The moment of a record's time 0 [ns since 1970, UTC], by the record.

    One that does not say it is played as if it were measured now: at `speed` none of its samples is ahead of the clock.

    Raises
    ------
    RecordError, ConfigurationError
        If it cannot be read.
    """
    pieces = _pieces(record, mapping)
    first = next(pieces)
    begin = begin_of(first)
    if begin is not None:
        return begin
    last = deque(itertools.chain([first], pieces if speed != 1.0 else ()), maxlen=1).pop()
    played = 1.0 - 1.0 / speed if speed > 1.0 else float(speed == 0.0)
    return time.time_ns() - round(
        SECOND * (float(first.time[0]) + played * float(last.time[-1] - first.time[0] + 1.0 / first.rate))
    )


def record_blocks(
    record: Record | str | Path,
    turbine: str,
    begin: int,
    *,
    seconds: float = 1.0,
    stream: str = "",
    mapping: str | Path | Mapping | None = None,
) -> Iterator[Block]:
    """The blocks of a record or of a file of one, which is never wholly in memory; parameters as of `Replay`.

    Raises
    ------
    RecordError, ConfigurationError
        If it cannot be read.
    """
    for piece in _pieces(record, mapping):
        yield from blocks_of(piece, turbine, begin, seconds=seconds, stream=stream)


def _pieces(record: Record | str | Path, mapping: str | Path | Mapping | None) -> Iterator[Record]:
    return iter([record]) if isinstance(record, Record) else iterate_record(record, _PIECE_SECONDS, mapping=mapping)

"""One turbine's stream in the engine: received blocks, open windows, waiting windows.

A follower is small and does not grow: numbers of the blocks of open windows, clocks, counts. The samples are in the
store. Its methods are called under its lock.
"""

import threading
from collections import Counter, deque
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from windsysid.errors import ConfigurationError
from windsysid.fleet.members import Member
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockRefused
from windsysid.live.store.contents import Alarm, Result, Status
from windsysid.live.watch.open_alarms import OpenAlarms
from windsysid.live.watch.watching import Watching, WatchOptions
from windsysid.live.windows.estimate import Estimated
from windsysid.live.windows.streams import Drift, StreamHealth, Verdict
from windsysid.live.windows.table_size import Growth, TableSize, growth
from windsysid.live.windows.timeline import SECOND, TurbineWindows, sample_time

__all__ = ["Conclusion", "Followed", "Follower", "Placed", "WindowTask"]

MAX_STREAMS = 16
"""Loggers that a turbine may have."""

MAX_BLOCK_WINDOWS = 2
"""Windows that a block may have samples of."""

Arrival = Literal["new", "repeated", "too late"]


@dataclass(frozen=True)
class Followed:
    """A turbine that the engine follows.

    Attributes
    ----------
    member
        Name, turbine file and sensors. Its mapping is of files, since blocks come with names and units; one with SCADA
        is refused.
    window
        Length of a window [s].
    formulation
        As of `windsysid.identify`.
    options
        How its watch is set; the window's length there is this one.
    """

    member: Member
    window: float = 600.0
    formulation: str = "spectral"
    options: WatchOptions = field(default_factory=WatchOptions)


class WindowTask(NamedTuple):
    """A window that is closed, and when it was, by the service's clock [ns since 1970]."""

    turbine: str
    window: int
    until: int
    closed: int


class Conclusion(NamedTuple):
    """Outcome of a row: its result, alarms of the structure, and the state of the channels' means."""

    result: Result
    alarms: Sequence[Alarm]
    means: Drift
    verdicts: Sequence[Verdict]


class Placed(NamedTuple):
    """Received block: its content, its number, and the windows that it is kept for."""

    arrival: Arrival
    sequence: int
    windows: tuple[int, ...] = ()


@dataclass
class _Stream:
    """One logger: the newest sample, one that may be out of the way, and up to where all blocks came.

    Blocks of a logger that was `restarted`, or has no numbers, are kept by their starts.
    """

    newest: int | None = None
    ahead: int | None = None
    committed: int | None = None
    restarted: bool = False
    health: StreamHealth | None = None

    def has_committed(self, sequence: int) -> bool:
        return self.committed is not None and sequence <= self.committed


class Follower:
    """State of one turbine in the engine."""

    def __init__(self, followed: Followed, settings: str, watching: Watching) -> None:
        if followed.member.scada is not None:
            raise ConfigurationError(
                f"{followed.member.name}: scada is for files: remove it, and push its channels as a stream of blocks"
            )
        self.followed, self.settings, self.watching = followed, settings, watching
        self.name = followed.member.name
        self.windows = TurbineWindows.of(self.name, followed.window)
        self.lock, self.taking = threading.RLock(), threading.Lock()
        self.streams: dict[str, _Stream] = {}
        self.open: dict[int, dict[str, set[int]]] = {}
        self.tables: dict[int, dict[tuple[str, float], TableSize]] = {}
        self.order: deque[WindowTask] = deque()
        self.estimates: dict[int, Estimated] = {}
        self.closed_until = 0
        self.counts: Counter[str] = Counter()
        self.received = 0
        self.state = "waiting"
        self.rotor_speed: float | None = None
        self.last: Future[None] | None = None
        self.told = 0
        self.withheld: list[Future[None]] = []
        self.means: Drift = {}
        self.concluded: Conclusion | None = None
        self.alarms = OpenAlarms(self.name)

    def place(self, block: Block, jump: int) -> Placed:
        """Classify a block, and record a new one.

        Parameters
        ----------
        jump
            A block that lies so far ahead of all others [ns] moves the stream's clock when a second one says the same.

        Raises
        ------
        BlockRefused
            If it is longer than two windows, there are too many loggers, or the table of a window would grow by far
            more cells than the block has values.
        """
        windows = self.windows.of_block(block)
        stream = self._stream(block, len(windows))
        still = tuple([window for window in windows if window >= self.closed_until])
        sequence = block.sequence
        if not still:
            return Placed("repeated" if stream.has_committed(sequence) else "too late", sequence)
        if self._restarts(stream, block):
            self.counts["numbering restarted"] += 1
            stream.restarted = True
        elif not stream.restarted and self._has(block.stream, sequence):
            return Placed("repeated", sequence)
        tables = self._checked_tables(block, still)
        self.streams[block.stream] = stream
        if stream.restarted:
            sequence = block.start  # the sender counts from the beginning again: its starts go on growing
            if self._has(block.stream, sequence):
                return Placed("repeated", sequence)
            stream.committed = block.sequence
        self.note(block, sequence, tables)
        self._move_clock(stream, block, jump)
        return Placed("new", sequence, still)

    def _stream(self, block: Block, windows: int) -> _Stream:
        """The logger of a block, new or known."""
        if windows > MAX_BLOCK_WINDOWS:
            raise BlockRefused(
                f"block of {len(block.values) / block.rate:.6g} s: expected no longer than a window of"
                f" {self.windows.length / SECOND:g} s; send shorter blocks"
            )
        if block.stream not in self.streams and len(self.streams) >= MAX_STREAMS:
            raise BlockRefused(
                f"stream '{block.stream}': the turbine has {MAX_STREAMS} loggers already, expected no more"
            )
        return self.streams.get(block.stream, _Stream())

    def _checked_tables(self, block: Block, windows: Iterable[int]) -> dict[int, Growth]:
        tables = {window: self.grown(block, window) for window in windows}
        for window, table in tables.items():
            table.check(block, window + self.windows.length)
        return tables

    def _restarts(self, stream: _Stream, block: Block) -> bool:
        """Check whether a sender counts anew: its block has an earlier number but is later than all."""
        later = stream.newest is not None and block.start > stream.newest
        return later and not stream.restarted and self._has(block.stream, block.sequence)

    def note(self, block: Block, sequence: int, tables: Mapping[int, Growth]) -> None:
        """Write down that a block is known, and what it makes of its windows' tables."""
        for window, grown in tables.items():
            self.open.setdefault(window, {}).setdefault(block.stream, set()).add(sequence)
            self.tables.setdefault(window, {})[block.stream, block.rate] = grown.after
        stream = self.streams.setdefault(block.stream, _Stream())
        if sequence == block.start:  # so that numbers of both kinds never mix, also after a restart of ours
            stream.restarted = True
        if stream.committed is None:
            stream.committed = sequence
        self._run_up(block.stream)

    def grown(self, block: Block, window: int) -> Growth:
        """Size of a window's table without and with a block; each logger and each rate has a table of its own."""
        before = self.tables.get(window, {}).get((block.stream, block.rate))
        return growth(before, block, window, window + self.windows.length)

    def stored(self) -> Future[None]:
        """Done when all blocks so far are on disk, or were forgotten."""
        if self.last is not None and not self.last.done():
            return self.last
        done: Future[None] = Future()
        done.set_result(None)
        return done

    def forget(self, block: Block, placed: Placed) -> None:
        """A block did not get to the store: it may come again."""
        for window in placed.windows:
            self.open.get(window, {}).get(block.stream, set()).discard(placed.sequence)
        stream = self.streams[block.stream]
        if stream.committed is not None and not stream.restarted:
            stream.committed = min(stream.committed, placed.sequence - 1)

    def _run_up(self, name: str) -> None:
        stream = self.streams[name]
        while stream.committed is not None and not stream.restarted and self._has(name, stream.committed + 1):
            stream.committed += 1

    def _has(self, stream: str, sequence: int) -> bool:
        return any(sequence in window.get(stream, ()) for window in self.open.values())

    def _move_clock(self, stream: _Stream, block: Block, jump: int) -> None:
        end = sample_time(block, len(block.values) - 1)
        if stream.newest is None or block.start <= stream.newest + jump:
            if stream.newest is not None and block.start < stream.newest - self.windows.length:
                self.counts["clock jumps"] += 1
            stream.newest, stream.ahead = max(end, stream.newest or 0), None
        elif stream.ahead is None:
            stream.ahead = end
        else:
            self.counts["clock jumps"] += 1
            stream.newest, stream.ahead = max(min(stream.ahead, end), stream.newest), None

    def see(self, block: Block) -> None:
        """Let the stream's clock run up to a block that was believed before."""
        stream = self.streams.setdefault(block.stream, _Stream())
        stream.newest = max(sample_time(block, len(block.values) - 1), stream.newest or 0)

    @property
    def clock(self) -> int | None:
        """Time of the newest sample that is believed [ns since 1970]."""
        return max((stream.newest for stream in self.streams.values() if stream.newest is not None), default=None)

    def over(self, lateness: int) -> list[int]:
        """Open windows that the stream has left behind by `lateness` [ns], in order."""
        clock = self.clock
        if clock is None:
            return []
        return sorted(window for window in self.open if window + self.windows.length + lateness <= clock)

    def close(self, window: int, now: int, until: int | None = None) -> WindowTask:
        """Close an open window: what comes for it from now on is too late. `until` is its end where it is another's."""
        until = window + self.windows.length if until is None else until
        for name, numbers in self.open.pop(window).items():
            stream = self.streams[name]
            if numbers and not stream.restarted:  # what is missing before them would be too late
                stream.committed = max(stream.committed or 0, max(numbers))
            self._run_up(name)
        self.tables.pop(window, None)
        self.closed_until = max(self.closed_until, until)
        task = WindowTask(self.name, window, until, now)
        self.order.append(task)
        return task

    def restore(self, status: Status) -> None:
        """Continue from the state in the store."""
        self.counts.update(status.counts)
        self.received, self.state = status.received, status.state
        self.rotor_speed = status.rotor_speed
        for name, sequence in status.sequences.items():
            self.streams[name] = _Stream(newest=status.stream or None, committed=sequence)

    def status(self) -> Status:
        """As the store keeps it."""
        sequences = {name: s.committed for name, s in self.streams.items() if s.committed is not None}
        return Status(
            self.name, sequences, self.clock or 0, self.received, self.state, self.rotor_speed, dict(self.counts)
        )

"""Assembly of blocks into windows: the window of a sample, and the record of a window's blocks.

Everything here is a function of values. The record of a window depends on the set of its blocks, and not on the order
in which they came or on how a stream was cut into them. `docs/live_engine.md` lists what happens in every case.

A sample belongs to the window in which it was taken, by the stamp of its own block. Within a window the blocks of each
logger are put in the order of their numbers. A block whose stamp is within half a sample of where the blocks before it
end goes on from there: stamps scatter, and a logger's clock drifts, while samples follow each other evenly. What is
missing is a hole of NaN. Where a logger's clock was set back or its rate changed, two pieces have no common grid, and
the longest one is taken: a record has no seam.
"""

import bisect
import hashlib
import math
from collections import Counter
from collections.abc import Container, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.live.blocks.block import Block
from windsysid.live.blocks.limits import MAX_TABLE_CHANNELS, cells_allowed
from windsysid.records.moments import moment_text
from windsysid.records.record import Record

__all__ = ["SECOND", "Gathered", "TurbineWindows", "gather", "sample_time"]

SECOND = 1_000_000_000
"""Nanoseconds."""

MAX_EDGE_SAMPLES = 1e-3
"""Of a sample: a stamp so near before a boundary counts as on it, since stamps are rounded."""

AVERAGED_SECONDS, MAX_AVERAGED_BLOCKS = 10.0, 100
"""Seconds of blocks, and blocks, whose stamps decide together whether one stamp was off or samples are missing."""


MIN_LEAD_SHARE = 0.01
"""Minimum duration of a logger's samples, relative to the longest logger's, for its grid to be the record's."""


class TurbineWindows(NamedTuple):
    """Division of a turbine's time into windows.

    Attributes
    ----------
    length
        [ns].
    offset
        Of all boundaries from multiples of `length` [ns].
    """

    length: int
    offset: int = 0

    @classmethod
    def of(cls, turbine: str, seconds: float) -> "TurbineWindows":
        """Those of a turbine: whole seconds off, by its name, so that not all turbines' windows end at once."""
        digest = int.from_bytes(hashlib.sha256(turbine.encode()).digest()[:8], "big")
        return cls(round(seconds * SECOND), digest % max(1, int(seconds)) * SECOND)

    def start(self, moment: int) -> int:
        """Of the window that a moment lies in."""
        return (moment - self.offset) // self.length * self.length + self.offset

    def of_block(self, block: Block) -> range:
        """Starts of the windows that a block has samples of."""
        step = SECOND / block.rate
        first, last = (
            block.start + MAX_EDGE_SAMPLES * step,
            sample_time(block, len(block.values) - 1) + MAX_EDGE_SAMPLES * step,
        )
        return range(self.start(int(first)), self.start(int(last)) + 1, self.length)


def sample_time(block: Block, index: int) -> int:
    """When a sample was taken, by its block's stamp [ns since 1970]."""
    return block.start + round(index * SECOND / block.rate)


class Gathered(NamedTuple):
    """Joined blocks of a window.

    Attributes
    ----------
    record
        Its times are k/`rate`; None where there are fewer than two samples.
    rate
        [Hz].
    missing
        Samples between the first and the last that did not come.
    repeated
        Samples that came more than once.
    cut
        Samples that were left out: they have no common grid with the others, or one that is far larger than the number
        of values received.
    """

    record: Record | None
    rate: float = 0.0
    missing: int = 0
    repeated: int = 0
    cut: int = 0


class _Piece(NamedTuple):
    """Samples on one grid: rate [Hz], time of the first [ns], channels and values (n, m)."""

    rate: float
    start: int
    channels: dict[str, str]
    values: NDArray[np.float64]
    there: int


def gather(blocks: Iterable[Block], window: int, until: int, name: str) -> Gathered:
    """The record of a window from `window` to `until` [ns since 1970].

    Its time starts at 0 with the first sample, which was taken at its `start`; its grid is that of the logger with the
    highest rate. Samples of slower loggers are put at the grid's nearest moments.
    """
    streams: dict[str, list[Block]] = {}
    inside = [part for block in blocks if (part := _inside(block, window, until)) is not None]
    for part in _with_most_channels(inside):
        streams.setdefault(part.stream, []).append(part)
    missing = repeated = cut = 0
    pieces = []
    for stream in sorted(streams):
        best, again, others = _longest(sorted(streams[stream], key=lambda block: (block.sequence, block.start)))
        pieces.append(best)
        cut += others
        repeated += again
        missing += len(best.values) - best.there
    if not pieces:
        return Gathered(None)
    record, rate, left_out = _joined(pieces, name)
    return Gathered(record, rate, missing, repeated, cut + left_out)


def _inside(block: Block, window: int, until: int) -> Block | None:
    """The samples of a block that lie in a window."""
    step = SECOND / block.rate
    low = max(0, math.ceil((window - block.start) / step - MAX_EDGE_SAMPLES))
    high = min(len(block.values), math.ceil((until - block.start) / step - MAX_EDGE_SAMPLES))
    if low >= high:
        return None
    if low == 0 and high == len(block.values):
        return block
    return Block(
        block.turbine, block.sequence, sample_time(block, low), block.rate, block.channels, block.units,
        block.values[low:high], block.stream,
    )  # fmt: skip


def _with_most_channels(blocks: Sequence[Block]) -> Iterable[Block]:
    """Leave out the channels with the fewest samples if there are more than `MAX_TABLE_CHANNELS`."""
    names = {block.channels for block in blocks}
    if len({name for channels in names for name in channels}) <= MAX_TABLE_CHANNELS:
        return blocks
    samples: Counter[str] = Counter()
    for block in blocks:
        samples.update(dict.fromkeys(block.channels, len(block.values)))
    kept = {name for name, _ in samples.most_common(MAX_TABLE_CHANNELS)}
    return [part for block in blocks if (part := _narrowed(block, kept)) is not None]


def _narrowed(block: Block, kept: Container[str]) -> Block | None:
    at = [i for i, name in enumerate(block.channels) if name in kept]
    if not at:
        return None
    channels, units = (tuple(texts[i] for i in at) for texts in (block.channels, block.units))
    return replace(block, channels=channels, units=units, values=block.values[:, at])


def _longest(blocks: Sequence[Block]) -> tuple[_Piece, int, int]:
    """Find the longest piece of one logger's blocks on one grid; count its repeated samples, and those left out.

    Only pieces that can be the longest are filled, one after the other, since each one is a table.
    """
    parts: list[tuple[float, Sequence[Block], list[int]]] = []
    at = 0
    while at < len(blocks):
        index = _indices(blocks, at)
        part = blocks[at : at + len(index)]
        parts.append((sum(len(block.values) for block in part) / part[0].rate, part, index))
        at += len(index)
    parts.sort(key=lambda part: (-part[0], part[1][0].start))
    best, repeated, cut = None, 0, 0
    for seconds, part, index in parts:
        if best is not None and seconds <= best.there / best.rate:
            cut += sum(len(block.values) for block in part)
            continue
        piece, again = _filled(part, index, part[0].rate, part[0].start)
        repeated += again
        if best is not None:
            cut += min(best, piece, key=_duration).there
        best = piece if best is None else max(best, piece, key=_duration)
    assert best is not None
    return best, repeated, cut


def _duration(piece: _Piece) -> tuple[float, int]:
    return _seconds(piece), -piece.start


def _indices(blocks: Sequence[Block], first: int) -> list[int]:
    """First rows of block `first` and of the following blocks on its grid, as far as they share the grid."""
    rate, origin = blocks[first].rate, blocks[first].start
    index: list[int] = []
    end = 0  # of what is placed
    lags: list[float] = []  # of stamps behind the grid, in samples: of the newest blocks that went on evenly
    known = _PlacedBlocks()
    some = max(1, min(MAX_AVERAGED_BLOCKS, math.ceil(AVERAGED_SECONDS * rate / max(1, len(blocks[first].values)))))

    def off(k: int) -> float:
        return (blocks[k].start - origin) * rate / SECOND

    def mean_shift(k: int, expected: float, shift: float) -> float:
        ahead = []
        for j in range(k, min(k + some, len(blocks))):
            if abs(off(j) - expected - shift) < 1.5:
                ahead.append(off(j) - expected)
            expected += len(blocks[j].values)
        return sum(ahead) / len(ahead)

    for k in range(first, len(blocks)):
        block = blocks[k]
        if block.rate != rate:
            return index
        base = sum(lags) / len(lags) if lags else 0.0
        shift, step = off(k) - end - base, 0
        if k > first and abs(shift) >= 0.5:  # a stamp may be off: what the next ones say counts
            shift = mean_shift(k, end + base, shift)
            step = math.floor(shift + 0.5) if abs(shift) >= 0.5 + 0.25 / len(lags) else 0
        if not known.add(block, end + step, set_back=step < 0):
            return index  # its clock was set back, or a gap is too long for what came
        index.append(end + step)
        lags = [*lags[1 - some :], off(k) - (end + step)] if some > 1 else [off(k) - (end + step)]
        end = max(end, end + step + len(block.values))
    return index


class _PlacedBlocks:
    """The blocks of a piece that are placed, sorted by their first rows."""

    def __init__(self) -> None:
        self._begins: list[int] = []
        self._blocks: list[Block] = []
        self._longest = self._rows = self._values = 0
        self._channels: frozenset[str] = frozenset()

    def add(self, block: Block, begin: int, *, set_back: bool) -> bool:
        """Add a block, unless the table would become too large for the values received; the first one always fits.

        Of a clock that was `set_back`, only a block that repeats what is there.
        """
        if set_back and not self.repeats(block, begin):
            return False
        rows, values = max(self._rows, begin + len(block.values)), self._values + block.values.size
        new = not self._channels.issuperset(block.channels)
        channels = self._channels.union(block.channels) if new else self._channels
        if self._blocks and rows * len(channels) > cells_allowed(values):
            return False
        at = bisect.bisect(self._begins, begin)
        self._begins.insert(at, begin)
        self._blocks.insert(at, block)
        self._longest = max(self._longest, len(block.values))
        self._rows, self._values, self._channels = rows, values, channels
        return True

    def repeats(self, new: Block, begin: int) -> bool:
        """Check whether a block at `begin` has the values of earlier blocks wherever both have values."""
        end = begin + len(new.values)
        low = bisect.bisect(self._begins, begin - self._longest)
        for j in range(low, bisect.bisect_left(self._begins, end)):
            if not _agree(self._blocks[j], self._begins[j], new, begin):
                return False
        return begin >= 0


def _agree(old: Block, at: int, new: Block, begin: int) -> bool:
    """Check whether two blocks at `at` and `begin` are equal where they overlap; NaN equals any value."""
    low, high = max(begin, at), min(begin + len(new.values), at + len(old.values))
    shared = [name for name in new.channels if name in old.channels]
    if low >= high or not shared:
        return True
    a = old.values[low - at : high - at, [old.channels.index(name) for name in shared]]
    b = new.values[low - begin : high - begin, [new.channels.index(name) for name in shared]]
    return bool(np.all((a == b) | np.isnan(a) | np.isnan(b)))


def _filled(blocks: Sequence[Block], index: Sequence[int], rate: float, origin: int) -> tuple[_Piece, int]:
    """Grid with the samples of blocks; repeated samples do not replace earlier ones."""
    channels = {name: unit for block in blocks for name, unit in zip(block.channels, block.units, strict=True)}
    column = {name: i for i, name in enumerate(channels)}
    rows = max(at + len(block.values) for at, block in zip(index, blocks, strict=True))
    alike = all(block.channels == blocks[0].channels for block in blocks)
    values = np.full((rows, len(channels)), np.nan)
    end = there = again = 0
    for at, block in zip(index, blocks, strict=True):
        n = len(block.values)
        if alike and at >= end:
            values[at : at + n] = block.values
            there += n
        else:
            columns = [column[name] for name in block.channels]
            place = np.ix_(range(at, at + n), columns)
            old = values[place]
            fresh = np.isnan(values[at : at + n]).all(axis=1)
            values[place] = np.where(np.isnan(old), block.values, old)
            there += int(fresh.sum())
            again += n - int(fresh.sum())
        end = max(end, at + n)
    return _Piece(rate, origin, channels, values, there), again


def _joined(pieces: Sequence[_Piece], name: str) -> tuple[Record | None, float, int]:
    """Join the pieces of all loggers to one record; its rate [Hz], and the samples of loggers that were left out.

    The grid is that of the fastest logger, of several the one with the most samples; loggers with less than
    `MIN_LEAD_SHARE` do not count.
    """
    least = MIN_LEAD_SHARE * max(map(_seconds, pieces))
    lead = max((piece for piece in pieces if _seconds(piece) >= least), key=lambda piece: (piece.rate, piece.there))
    if len(lead.values) < 2:
        return None, lead.rate, 0
    placed, left_out = _placed(pieces, lead)
    columns: dict[str, NDArray[np.float64]] = {}
    units: dict[str, str] = {}
    for piece, values in placed:
        for (channel, unit), column in zip(piece.channels.items(), values.T, strict=True):
            known = columns.get(channel)
            if known is None:
                columns[channel], units[channel] = column, unit
            elif units[channel] == unit:
                columns[channel] = np.where(np.isnan(known), column, known)
    record = Record(
        time=np.arange(len(lead.values)) / lead.rate,
        values=lead.values if len(pieces) == 1 else np.column_stack(list(columns.values())),
        channels=tuple(columns), units=tuple(units.values()), name=name, start=moment_text(lead.start, 0),
    )  # fmt: skip
    return record, lead.rate, left_out


def _placed(pieces: Sequence[_Piece], lead: _Piece) -> tuple[list[tuple[_Piece, NDArray[np.float64]]], int]:
    """Put pieces on the grid of `lead`; count the samples of those that would make the table too large."""
    values = sum(piece.there * len(piece.channels) for piece in pieces)
    room = cells_allowed(values) / len(lead.values) - len(lead.channels)
    placed, left_out = [], 0
    for piece in pieces:
        width = 0 if piece is lead else len(piece.channels)
        if width > room:
            left_out += piece.there
            continue
        room -= width
        placed.append((piece, piece.values if piece is lead else _on_grid(piece, lead)))
    return placed, left_out


def _seconds(piece: _Piece) -> float:
    """Duration of a piece's samples."""
    return piece.there / piece.rate


def _on_grid(piece: _Piece, lead: _Piece) -> NDArray[np.float64]:
    """Place the samples of a logger at the nearest instants of another logger's grid."""
    moments = (piece.start - lead.start) / SECOND + np.arange(len(piece.values)) / piece.rate
    at = np.floor(moments * lead.rate + 0.5).astype(np.int64)
    inside = (at >= 0) & (at < len(lead.values))
    placed = np.full((len(lead.values), len(piece.channels)), np.nan)
    placed[at[inside]] = piece.values[inside]
    return placed

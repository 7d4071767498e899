"""From blocks to windows: which window a sample belongs to, and the record that a window's blocks are.

Everything here is a function of values. The record of a window depends on the set of its blocks, and not on the order
in which they came or on how a stream was cut into them. `docs/live_engine.md` lists what happens in every case.

A sample belongs to the window in which it was taken, by the stamp of its own block. Within a window the blocks of each
logger are put in the order of their numbers. A block whose stamp is within half a sample of where the blocks before it
end goes on from there: stamps scatter, and a logger's clock drifts, while samples follow each other evenly. What is
missing is a hole of NaN. Where a logger's clock was set back or its rate changed, two pieces have no common grid, and
the longest one is taken: a record has no seam.
"""

import hashlib
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.live.block import Block
from windsysid.records.moments import moment_text
from windsysid.records.record import Record

__all__ = ["SECOND", "Gathered", "Windows", "gather", "sample_time"]

SECOND = 1_000_000_000
"""Nanoseconds."""

EDGE = 1e-3
"""Of a sample: a stamp so near before a boundary counts as on it, since stamps are rounded."""

AVERAGED, MOST_AVERAGED = 10.0, 100
"""Seconds of blocks, and blocks, whose stamps decide together whether one stamp was off or samples are missing."""


class Windows(NamedTuple):
    """How a turbine's time is cut.

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
    def of(cls, turbine: str, seconds: float) -> "Windows":
        """Those of a turbine: whole seconds off, by its name, so that not all turbines' windows end at once."""
        digest = int.from_bytes(hashlib.sha256(turbine.encode()).digest()[:8], "big")
        return cls(round(seconds * SECOND), digest % max(1, int(seconds)) * SECOND)

    def start(self, moment: int) -> int:
        """Of the window that a moment lies in."""
        return (moment - self.offset) // self.length * self.length + self.offset

    def of_block(self, block: Block) -> range:
        """Starts of the windows that a block has samples of."""
        step = SECOND / block.rate
        first, last = block.start + EDGE * step, sample_time(block, len(block.values) - 1) + EDGE * step
        return range(self.start(int(first)), self.start(int(last)) + 1, self.length)


def sample_time(block: Block, index: int) -> int:
    """When a sample was taken, by its block's stamp [ns since 1970]."""
    return block.start + round(index * SECOND / block.rate)


class Gathered(NamedTuple):
    """What a window's blocks are together.

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
        Samples that were left out, since they have no common grid with the others.
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
    for block in blocks:
        inside = _inside(block, window, until)
        if inside is not None:
            streams.setdefault(block.stream, []).append(inside)
    missing = repeated = cut = 0
    pieces = []
    for stream in sorted(streams):
        placed = _placed(sorted(streams[stream], key=lambda block: (block.sequence, block.start)))
        best = max(placed, key=lambda piece: (piece[0].there / piece[0].rate, -piece[0].start))
        pieces.append(best[0])
        cut += sum(piece.there for piece, _ in placed if piece is not best[0])
        repeated += sum(again for _, again in placed)
        missing += len(best[0].values) - best[0].there
    if not pieces:
        return Gathered(None)
    record, rate = _joined(pieces, name)
    return Gathered(record, rate, missing, repeated, cut)


def _inside(block: Block, window: int, until: int) -> Block | None:
    """The samples of a block that lie in a window."""
    step = SECOND / block.rate
    low = max(0, math.ceil((window - block.start) / step - EDGE))
    high = min(len(block.values), math.ceil((until - block.start) / step - EDGE))
    if low >= high:
        return None
    if low == 0 and high == len(block.values):
        return block
    return Block(
        block.turbine, block.sequence, sample_time(block, low), block.rate, block.channels, block.units,
        block.values[low:high], block.stream,
    )  # fmt: skip


def _placed(blocks: Sequence[Block]) -> list[tuple[_Piece, int]]:
    """Pieces of one logger's blocks, each on one grid, and how many samples of each had come before."""
    pieces = []
    at = 0
    while at < len(blocks):
        rate, origin = blocks[at].rate, blocks[at].start
        index, last = _indices(blocks[at:], rate, origin)
        pieces.append(_filled(blocks[at : at + last], index, rate, origin))
        at += last
    return pieces


def _indices(blocks: Sequence[Block], rate: float, origin: int) -> tuple[list[int], int]:
    """Where on the grid each block begins, and how many blocks share the grid with the first one."""
    index: list[int] = []
    end = 0  # of what is placed
    lags: list[float] = []  # of stamps behind the grid, in samples: of the newest blocks that went on evenly
    off = [(block.start - origin) * rate / SECOND for block in blocks]
    some = max(1, min(MOST_AVERAGED, math.ceil(AVERAGED * rate / max(1, len(blocks[0].values)))))
    for k, block in enumerate(blocks):
        if block.rate != rate:
            return index, k
        base = sum(lags) / len(lags) if lags else 0.0
        shift, step = off[k] - end - base, 0
        if k and abs(shift) >= 0.5:  # a stamp may be off: what the next ones say counts
            counted, ahead = end, []
            for j in range(k, min(k + some, len(blocks))):
                if abs(off[j] - counted - base - shift) < 1.5:
                    ahead.append(off[j] - counted - base)
                counted += len(blocks[j].values)
            shift = sum(ahead) / len(ahead)
            step = math.floor(shift + 0.5) if abs(shift) >= 0.5 + 0.25 / len(lags) else 0
        if step < 0 and not _repeats(blocks, index, k, end + step):
            return index, k  # its clock was set back
        index.append(end + step)
        lags = [*lags[1 - some :], off[k] - (end + step)] if some > 1 else [off[k] - (end + step)]
        end = max(end, end + step + len(block.values))
    return index, len(blocks)


def _repeats(blocks: Sequence[Block], index: Sequence[int], k: int, begin: int) -> bool:
    """Whether block `k`, placed at `begin`, says of every moment what an earlier block said, or nothing was said."""
    block = blocks[k]
    end = begin + len(block.values)
    for j in range(k):
        low, high = max(begin, index[j]), min(end, index[j] + len(blocks[j].values))
        if low >= high:
            continue
        old, new = blocks[j], block
        shared = [name for name in new.channels if name in old.channels]
        a = old.values[low - index[j] : high - index[j], [old.channels.index(name) for name in shared]]
        b = new.values[low - begin : high - begin, [new.channels.index(name) for name in shared]]
        if not np.all((a == b) | np.isnan(a) | np.isnan(b)):
            return False
    return begin >= 0


def _filled(blocks: Sequence[Block], index: Sequence[int], rate: float, origin: int) -> tuple[_Piece, int]:
    """A grid with the samples of blocks on it; what comes again does not replace what is there."""
    channels = {name: unit for block in blocks for name, unit in zip(block.channels, block.units, strict=True)}
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
            columns = [list(channels).index(name) for name in block.channels]
            place = np.ix_(range(at, at + n), columns)
            old = values[place]
            fresh = np.isnan(values[at : at + n]).all(axis=1)
            values[place] = np.where(np.isnan(old), block.values, old)
            there += int(fresh.sum())
            again += n - int(fresh.sum())
        end = max(end, at + n)
    return _Piece(rate, origin, channels, values, there), again


def _joined(pieces: Sequence[_Piece], name: str) -> tuple[Record | None, float]:
    """One record of the pieces of all loggers, on the grid of the fastest, the one with the most samples first."""
    lead = max(pieces, key=lambda piece: (piece.rate, piece.there))
    if len(lead.values) < 2:
        return None, lead.rate
    rows = len(lead.values)
    columns: dict[str, NDArray[np.float64]] = {}
    units: dict[str, str] = {}
    for piece in pieces:
        placed = piece.values
        if piece is not lead:
            moments = (piece.start - lead.start) / SECOND + np.arange(len(piece.values)) / piece.rate
            at = np.floor(moments * lead.rate + 0.5).astype(np.int64)
            inside = (at >= 0) & (at < rows)
            placed = np.full((rows, len(piece.channels)), np.nan)
            placed[at[inside]] = piece.values[inside]
        for i, (channel, unit) in enumerate(piece.channels.items()):
            if channel not in columns:
                columns[channel], units[channel] = placed[:, i], unit
            elif units[channel] == unit:
                columns[channel] = np.where(np.isnan(columns[channel]), placed[:, i], columns[channel])
    values = lead.values if len(pieces) == 1 else np.column_stack(list(columns.values()))
    record = Record(
        time=np.arange(rows) / lead.rate, values=values, channels=tuple(columns), units=tuple(units.values()),
        name=name, start=moment_text(lead.start, 0),
    )  # fmt: skip
    return record, lead.rate

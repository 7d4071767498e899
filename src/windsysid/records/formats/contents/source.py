"""An open file before reading: its content, and its samples block by block.

Every format gives a `FileSource`. `gather` makes one `Record` of it, `gather_section` reads a part, `pieces` gives
the record in pieces that fit into memory. Blocks are checked as they pass, so that a file of any size is
checked whole: time must increase inside a block and from one block to the next.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.checks import Array, check_block, check_channels, refuse_outside
from windsysid.records.formats.contents.columns import Column, names_and_units
from windsysid.records.packets import RegularTimes, is_even, place_packets, place_rounded, shares_stamps
from windsysid.records.record import STAMPS, Record
from windsysid.records.rounded import is_coarse
from windsysid.records.stamps import usual_step

__all__ = [
    "FileBlock", "FileSource", "Progress", "doubles", "gather", "gather_section", "indexed_source", "pieces",
    "reading_notes", "shifted", "with_regular_times", "without_repeats",
]  # fmt: skip

Progress = Callable[[float], None]
"""Called with the fraction of the file that has been read."""

MAX_OFF_GRID_STEPS = 0.25
"""Part of a step by which stamps may be off multiples of it and still be a clock where the rate is given."""

MAX_SPAN_ERROR = 0.01
"""Relative difference between a given rate and time stamps, above which they contradict each other."""

_NOTES = {
    "cut_off": "{}", "left_out": "left out, because they are no channels: {}", "left_over": "{}", "repeated": "{}",
    "dropped": "{}",
}  # fmt: skip
"""Attributes of a record on the reading of its file, and the text of the note on each."""


def doubles(values: Any) -> Array:
    """Numbers in double precision; the signalling NaN that a damaged single may be is missing as any other is."""
    with np.errstate(invalid="ignore"):
        return np.asarray(values, dtype=np.float64)


class FileBlock(NamedTuple):
    """Consecutive samples of a file, in SI.

    Attributes
    ----------
    time : (n,) array
        [s]
    values : (n, m) array
    place : callable
        What a user calls the place of a row: ``line 17``.
    done : float
        Fraction of the file that has been read.
    """

    time: Array
    values: Array
    place: Callable[[int], str]
    done: float


@dataclass(frozen=True)
class FileSource:
    """An opened file.

    Attributes
    ----------
    name : str
    channels, units : tuple of str (m,)
        Under our names, units SI.
    blocks : callable
        ``blocks(start, end)`` iterates over the samples in order. It may leave out blocks that end before
        `start` [s], and may stop when it has passed `end` [s]; the last block it gives then reaches `end`, or is
        the file's last one.
    attributes : mapping of str to str
    first : float
        Time of the first sample [s], NaN if only reading tells.
    start : str or None
        The moment of time 0, as `Record.start`.
    rate : float or None
        Rate [Hz] that the mapping gives: rows are placed by counting if their times do not increase.
    """

    name: str
    channels: tuple[str, ...]
    units: tuple[str, ...]
    blocks: Callable[[float, float], Iterator[FileBlock]]
    attributes: Mapping[str, str] = field(default_factory=dict)
    first: float = np.nan
    start: str | None = None
    rate: float | None = None


def reading_notes(attributes: Mapping[str, str]) -> list[str]:
    """List the parts of a file that were left out, from the attributes of its record."""
    return [f"Reading the file: {text.format(attributes[key])}." for key, text in _NOTES.items() if key in attributes]


def without_repeats(source: FileSource) -> FileSource:
    """Keep one of several channels with the same name and the same values.

    Raises
    ------
    RecordError
        If channels of one name differ in unit or, when their block is read, in a value.
    """
    first: dict[str, int] = {}
    again = {k: one for k, name in enumerate(source.channels) if (one := first.setdefault(name, k)) != k}
    if not again:
        return source
    kept = sorted(first.values())
    for k, one in again.items():
        if source.units[k] != source.units[one]:
            raise _differing(source.channels[k], "units")

    def blocks(start: float, end: float) -> Iterator[FileBlock]:
        for block in source.blocks(start, end):
            for k, one in again.items():
                _check_same(source.channels[k], block, one, k)
            yield block._replace(values=block.values[:, kept])

    repeated = dict.fromkeys(source.channels[one] for one in sorted(again.values()))
    return replace(
        source,
        channels=tuple(first),
        units=tuple(source.units[k] for k in kept),
        blocks=blocks,
        attributes={
            **source.attributes,
            "repeated": f"listed several times with the same values, one kept: {', '.join(repeated)}",
        },
    )


def _check_same(name: str, block: FileBlock, one: int, other: int) -> None:
    left, right = block.values[:, one], block.values[:, other]
    same = (left == right) | (np.isnan(left) & np.isnan(right))
    if not same.all():
        raise _differing(name, f"values ({block.place(int(np.argmin(same)))})")


def _differing(name: str, what: str) -> RecordError:
    return RecordError(
        f"channel '{name}' is listed twice with different {what}; rename one in a mapping file:"
        f' [channels."{name}#2"] name = "{name}_2"'
    )


def gather(source: FileSource, progress: Progress | None = None) -> Record:
    """The whole file as one record."""
    time, values = [], []
    source = with_regular_times(source)
    for block in _checked(source, -np.inf, np.inf, progress):
        time.append(block.time)
        values.append(block.values)
    return _record(source, time, values)


def gather_section(source: FileSource, start: float, end: float, progress: Progress | None = None) -> Record:
    """The samples with start ≤ t < end, as `Record.section` gives them; the rest of the file is not kept.

    Raises
    ------
    RecordError
        If the section is empty, holds a single sample, or reaches outside the record.
    """
    source = with_regular_times(source, start, end)
    blocks = list(_within(source, start, end, progress))
    return _record(source, [block.time for block in blocks], [block.values for block in blocks])


def pieces(
    source: FileSource, seconds: float, progress: Progress | None = None, section: tuple[float, float] | None = None
) -> Iterator[Record]:
    """The file, or a section of it [s], as records of about `seconds` each; every sample is in exactly one of them.

    A sample that would be alone in its piece, next to a gap, joins the piece before it.

    Raises
    ------
    RecordError
        At the latest when all has been given: if the section is empty, holds a single sample, or reaches outside.
    """
    held: list[tuple[Array, Array]] = []  # the piece before, kept until the next one has two samples
    open_time: list[Array] = []
    open_values: list[Array] = []
    origin, number = np.nan, 0.0

    def close() -> Iterator[Record]:
        if sum(part.size for part in open_time) >= 2 and held:
            yield _record(source, [t for t, _ in held], [v for _, v in held])
            held.clear()
        held.extend(zip(open_time, open_values, strict=True))
        if sum(part.size for part, _ in held) > 0 and len(held) > 1:
            merged = np.concatenate([t for t, _ in held]), np.concatenate([v for _, v in held])
            held[:] = [merged]
        open_time.clear()
        open_values.clear()

    source = with_regular_times(source, *(section or (-np.inf, np.inf)))
    blocks = _checked(source, -np.inf, np.inf, progress) if section is None else _within(source, *section, progress)
    for block in blocks:
        origin = block.time[0] if np.isnan(origin) else origin
        index = np.floor((block.time - origin) / seconds)
        edges = [0, *(np.flatnonzero(np.diff(index)) + 1), block.time.size]
        for low, high in itertools.pairwise(edges):
            if open_time and index[low] != number:
                yield from close()
            number = index[low]
            open_time.append(block.time[low:high].copy())
            open_values.append(block.values[low:high].copy())
    yield from close()
    yield _record(source, [t for t, _ in held], [v for _, v in held])


def indexed_source(
    name: str,
    columns: Sequence[Column],
    time: Array,
    rows: Callable[[int, int], Array],
    *,
    place: Callable[[int], str] = "sample {}".format,
    values_at_once: int = 1 << 20,
) -> FileSource:
    """A source whose times (T,) are known and whose ``rows(low, high)`` can be read anywhere, in SI (high − low, m)."""
    size = max(1, values_at_once // len(columns))

    def blocks(start: float, end: float) -> Iterator[FileBlock]:
        low, high = 0, time.size
        if (start > -np.inf or end < np.inf) and np.all(np.diff(time) > 0.0):
            low = min(int(np.searchsorted(time, start)), max(time.size - 2, 0))
            high = min(int(np.searchsorted(time, end)) + 1, time.size)
        for first in range(low, high, size):
            last = min(first + size, high)
            yield FileBlock(time[first:last], rows(first, last), shifted(place, first), last / time.size)

    first = float(time[0]) if time.size else np.nan
    return FileSource(name, *names_and_units(columns), blocks, first=first)


def shifted(place: Callable[[int], str], first: int) -> Callable[[int], str]:
    """Names the places of rows that are counted from row `first` of the file."""
    return lambda row: place(first + row)


def with_regular_times(source: FileSource, start: float = -np.inf, end: float = np.inf) -> FileSource:
    """Place rows on a regular grid (`windsysid.records.packets`), if rows of the first block share time stamps or have
    rounded ones.

    The source that is returned can be read once, from `start` to `end` [s]; its attribute `STAMPS` describes the grid.

    Raises
    ------
    RecordError
        If the source's rate contradicts the span of its time stamps, or the places of lost rows are not known.
    """
    blocks = source.blocks(start, end)
    held = list(itertools.islice(blocks, 1))
    if held and (source.rate is not None or shares_stamps(held[0].time) or is_coarse(held[0].time)):
        times = np.concatenate([block.time for block in source.blocks(-np.inf, np.inf)])
        placed = _placed(times, held[0], source.units)
        if source.rate is not None:
            _check_span(times, placed, source.rate)
        if placed is not None:
            return _timed(source, placed.time, {**source.attributes, STAMPS: _note(times, placed)})
        if source.rate is not None and not _has_rhythm(times):
            return _timed(source, np.arange(times.size) / source.rate, source.attributes)

    def resumed(_start: float, _end: float) -> Iterator[FileBlock]:
        while held:
            yield held.pop()
        yield from blocks

    return replace(source, blocks=resumed)


def _placed(times: Array, first: FileBlock, units: tuple[str, ...]) -> RegularTimes | None:
    """All rows on the grid behind their stamps (T,) [s], if there is one and the `first` block's readings agree."""
    if shares_stamps(times):
        return place_packets(times) if is_even(first.time, first.values) else None
    return place_rounded(times, first.values[:, [unit != "rad" for unit in units]]) if is_coarse(times) else None


def _note(times: Array, placed: RegularTimes) -> str:
    shared = int(np.count_nonzero(np.diff(times) == 0.0))
    what = (
        f"{shared} of {times.size} rows have the time stamp of the row before" if shared else "stamps have few digits"
    )
    return f"{what}; rows were placed on a regular grid of {1.0 / placed.step:.6g} Hz, with {placed.lost} lost"


def _has_rhythm(times: Array) -> bool:
    """Test whether times (T,) [s] increase by nearly whole multiples of one step."""
    steps = np.diff(times)
    if not steps.size or not np.all(steps > 0.0):
        return False
    counts = steps / usual_step(times)
    return bool(np.all(np.abs(counts - np.rint(counts)) <= MAX_OFF_GRID_STEPS))


def _check_span(times: Array, placed: RegularTimes | None, rate: float) -> None:
    """Refuse a rate [Hz] at which rows, lost ones included, take another time than their stamps (T,) [s] span."""
    if placed is not None:
        rows, doubt = times.size + placed.lost, 0.0
        spans = [rows * placed.step]
    else:
        steps = np.diff(times)
        forward = steps[steps > 0.0]
        rows = times.size if not _has_rhythm(times) else 1 + round(float(times[-1] - times[0]) / usual_step(times))
        doubt = 2.0 * float(np.median(forward)) if forward.size else np.inf
        spans = [float(times[-1] - times[0]), float(np.sum(forward))]  # the second one where the clock was set back
    if all(abs(rows / rate - span) > MAX_SPAN_ERROR * span + doubt for span in spans):
        raise RecordError(
            f"{rows} rows at [time] rate = {rate:g} Hz take {rows / rate:.5g} s, but their stamps span"
            f" {spans[0]:.5g} s; were rows lost or written twice? else correct the rate"
        )


def _timed(source: FileSource, times: Array, attributes: Mapping[str, str]) -> FileSource:
    """Replace the times of a source by others (T,) [s]."""

    def blocks(_start: float, end: float) -> Iterator[FileBlock]:
        low = 0
        for block in source.blocks(-np.inf, np.inf):
            high = low + block.time.size
            yield block._replace(time=times[low:high])
            if high > low and times[high - 1] >= end:
                return
            low = high

    return replace(source, blocks=blocks, attributes=attributes, first=float(times[0]))


def _checked(source: FileSource, start: float, end: float, progress: Progress | None) -> Iterator[FileBlock]:
    check_channels(source.channels)
    previous = np.nan
    if progress is not None:
        progress(0.0)
    for block in source.blocks(start, end):
        if block.time.size:
            check_block(block.time, block.values, source.channels, block.place, previous)
            previous = float(block.time[-1])
            yield block
        if progress is not None:
            progress(block.done)
    if progress is not None:
        progress(1.0)


def _within(source: FileSource, start: float, end: float, progress: Progress | None) -> Iterator[FileBlock]:
    """The samples with start ≤ t < end of every block that has some; RecordError as of `gather_section`."""
    first, last, steps, kept = source.first, np.nan, np.empty(0), 0
    if start < end:
        for block in _checked(source, start, end, progress):
            first = block.time[0] if np.isnan(first) else first
            last = block.time[-1]
            steps = np.diff(block.time) if block.time.size > 1 else steps
            low, high = np.searchsorted(block.time, (start, end), side="left")
            if high > low:
                kept += int(high - low)
                # a view would keep the whole block alive
                yield block._replace(time=block.time[low:high].copy(), values=block.values[low:high].copy())
    step = float(np.median(steps)) if steps.size else 0.0
    refuse_outside(start, end, kept, float(first), float(last), step)


def _record(source: FileSource, time: list[Array], values: list[Array]) -> Record:
    if not time:
        raise RecordError("expected at least 2 samples, got 0; give a longer record")
    whole = len(time) > 1
    return Record(
        np.concatenate(time) if whole else time[0],
        np.concatenate(values) if whole else values[0],
        source.channels,
        source.units,
        name=source.name,
        attributes=source.attributes,
        start=source.start,
    )

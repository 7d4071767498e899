"""HAWC2 results: the list of channels in ``NAME.sel``, their numbers next to it in ``NAME.dat``, text or packed binary.

In a binary file each channel is a row of int16 with a scale; the channel Time has a resolution of 1/32000 of its range
only, and the text has six digits. So times are the grid that the list says, number of scans over duration, beginning
where the channel Time does; a channel Time that departs from it by more than its resolution is refused. Names, axes and
signs are HAWC2's own; a mapping turns them into windsysid's.

Source: HAWC2 manual (DTU Wind, Risø-R-1597), "Output"; the columns are those that HAWC2 12 writes.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.formats.contents.columns import Cell
from windsysid.records.formats.contents.format import Format
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.series import FileSeries, TimeGrid, source_of_series
from windsysid.records.formats.contents.source import FileSource
from windsysid.records.formats.text.text import decoded, plain_numbers
from windsysid.records.record import AS_WRITTEN, Array
from windsysid.units import canonical

__all__ = ["FORMAT", "distinct_names", "known_unit"]

_COUNTS, _FIRST = 8, 12  # lines of the list: numbers of scans and channels, first channel
_NAME, _UNIT, _ABOUT = slice(12, 43), slice(43, 54), slice(54, None)
_PACKED = np.dtype("<i2")
_DIGITS = 1e-5  # resolution of six digits, of the number's power of ten


@dataclass(frozen=True)
class _List:
    """Content of the ``.sel`` file."""

    scans: int
    duration: float
    cells: tuple[Cell, ...]
    scales: Array | None


def open_hawc2(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a pair of files by either; binary numbers are read as far as they are needed."""
    listing, data = path.with_suffix(_suffix(path, "sel")), path.with_suffix(_suffix(path, "dat"))
    for other in (listing, data):
        if not other.is_file():
            raise RecordError(f"has no {other.name} next to it, the rest of the HAWC2 result; copy it there too")
    known = _read_list(listing)
    channels = len(known.cells)
    if known.scales is None:
        values = plain_numbers(data.read_bytes())
        if values.size != known.scans * channels:
            raise RecordError(
                f"is cut off or damaged: {known.scans} scans of {channels} channels are {known.scans * channels}"
                f" numbers, {data.name} holds {values.size}; run the simulation again"
            )
        table = values.reshape(known.scans, channels)
    elif data.stat().st_size != _PACKED.itemsize * known.scans * channels:
        raise RecordError(
            f"is cut off or damaged: {known.scans} scans of {channels} channels need"
            f" {_PACKED.itemsize * known.scans * channels} bytes, {data.name} has {data.stat().st_size}; copy it again"
        )

    def column(index: int, low: int, high: int) -> Array:
        if known.scales is None:
            return np.ascontiguousarray(table[low:high, index])
        with data.open("rb") as file:
            file.seek(_PACKED.itemsize * (index * known.scans + low))
            return np.asarray(np.fromfile(file, _PACKED, high - low) * known.scales[index])

    def together(indices: Sequence[int], low: int, high: int) -> list[Array]:
        return [column(numbers[i], low, high) for i in indices]

    grid = _grid(known, column)
    numbers = [k for k, cell in enumerate(known.cells) if cell.name.lower() != "time"]
    series = [
        FileSeries(known.cells[k], known.scans, lambda low, high, k=k: column(k, low, high), grid)  # type: ignore[misc]
        for k in numbers
    ]
    if not series:
        raise RecordError("lists no channel but the time; add sensors to the output of HAWC2")
    how = "let HAWC2 write its unit"
    return source_of_series(data.name, series, mapping, {"source": "HAWC2"}, how=how, together=together)


def _suffix(path: Path, wanted: str) -> str:
    return f".{wanted.upper() if path.suffix.isupper() else wanted}"


def _read_list(path: Path) -> _List:
    lines = decoded(path.read_bytes()).splitlines()
    try:
        scans, count, duration, form = lines[_COUNTS].split()[:4]
        found = _List(int(scans), float(duration), _cells(lines, int(count)), None)
        if found.scans < 2 or not 0.0 < found.duration < np.inf or form.upper() not in ("ASCII", "BINARY"):
            raise ValueError
        if form.upper() == "ASCII":
            return found
        below = lines[_FIRST + int(count) :]
        start = next(k for k, line in enumerate(below) if line.lower().startswith("scale factors"))
        texts = " ".join(below[start + 1 :]).split()
        scales = plain_numbers("\n".join([*texts, ""]).encode())
        if scales.size != len(found.cells) or not np.isfinite(scales).all() or len({text[-4] for text in texts}) > 1:
            raise ValueError  # the last one may be cut in its exponent
    except (ValueError, IndexError, StopIteration):
        raise RecordError(
            f"{path.name} is not the list of a HAWC2 result, or is cut off; run the simulation or copy it again"
        ) from None
    return _List(found.scans, found.duration, found.cells, scales)


def _cells(lines: list[str], count: int) -> tuple[Cell, ...]:
    rows = lines[_FIRST : _FIRST + count]
    if len(rows) < count or count < 1 or [int(row[:12]) for row in rows] != list(range(1, count + 1)):
        raise ValueError
    names = distinct_names([row[_NAME].strip() for row in rows], [row[_ABOUT].strip() for row in rows])
    return tuple(Cell(name, name, known_unit(row[_UNIT].strip())) for name, row in zip(names, rows, strict=True))


def distinct_names(names: Sequence[str], about: Sequence[str]) -> list[str]:
    """Make names distinct: append descriptions to names that occur several times, and numbers if that is not enough."""
    counts = Counter(names)
    full = [name if counts[name] == 1 else f"{name} {text}".strip() for name, text in zip(names, about, strict=True)]
    counts = Counter(full)
    return [name[:200] if counts[name] == 1 else f"{name} {k}"[:200] for k, name in enumerate(full, 1)]


def known_unit(text: str) -> str:
    """Unit of HAWC2 as it is if windsysid knows it, otherwise marked as written."""
    try:
        canonical(text)
    except ConfigurationError:
        return AS_WRITTEN + text
    return text or "-"


def _grid(known: _List, column: Callable[[int, int, int], Array]) -> TimeGrid:
    step = known.duration / known.scans
    at = next((k for k, cell in enumerate(known.cells) if cell.name.lower() == "time"), None)
    if at is None:
        return TimeGrid(step, step)
    time = column(at, 0, known.scans)
    if not np.isfinite(time).all():
        raise RecordError("the channel Time is not a time; it is damaged; run the simulation again")
    if known.scales is not None:
        coarse = np.full(time.size, abs(float(known.scales[at])))
    else:
        coarse = _DIGITS * 10.0 ** np.floor(np.log10(np.maximum(np.abs(time), 1e-30)))
    elapsed = step * np.arange(known.scans)
    apart = time - elapsed
    count = float(np.median(apart)) / step
    first = step * round(count) if np.isfinite(count) else 0.0
    if np.max(np.abs(apart - first) - coarse) > 0.01 * step:
        first = float(apart[0])  # the record does not begin on a multiple of the step
    if not np.max(np.abs(apart - first) - coarse) <= 0.01 * step:
        raise RecordError(
            f"the channel Time is not the grid of {known.scans} scans in {known.duration:g} s that the list says; it is"
            " damaged; run the simulation again"
        )
    return TimeGrid(first, step)


def _has_list(path: Path) -> bool:
    return path.suffix.lower() == ".sel" or path.with_suffix(_suffix(path, "sel")).is_file()


FORMAT = Format("HAWC2 results", (".sel", ".dat"), open_hawc2, claims=_has_list)

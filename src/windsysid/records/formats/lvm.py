r"""LabVIEW measurement files, ``.lvm``: text with a header, then one or more segments, each with a header of its own.

A segment says the channels, their units, how many samples follow and their spacing (``X0``, ``Delta_X``). Times are the
column ``X_Value`` where there is one, otherwise X0 + k Delta_X; where these begin anew in each segment, the segments'
own ``Date`` and ``Time`` set them apart. A segment with fewer rows than it says was cut and is refused; so is a last
line that nothing ends.

Source: NI, "Specification for the LabVIEW measurement file (.lvm)".
"""

import itertools
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.formats.access.files import read_start
from windsysid.records.formats.contents.format import Format
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.series import FileSeries, TimeGrid, cell_of, source_of_series
from windsysid.records.formats.contents.source import FileSource
from windsysid.records.formats.text.dialect import MISSING, is_number
from windsysid.records.formats.text.text import encoding_of, line_blocks
from windsysid.records.moments import moment, tidy
from windsysid.records.record import Array

__all__ = ["FORMAT"]

_BEGIN, _END = "LabVIEW Measurement", "***End_of_Header***"
_SEPARATORS = {"tab": "\t", "comma": ",", "space": " "}


@dataclass
class _Segment:
    """Rows of one segment: its header by keyword, its column names, and its cells as numbers with their lines."""

    header: dict[str, list[str]]
    names: list[str]
    rows: list[list[float]] = field(default_factory=list)

    def numbers(self, key: str) -> list[float]:
        try:
            return [float(text.replace(",", ".")) for text in self.header.get(key, []) if text]
        except ValueError:
            raise RecordError(f"has no number behind {key}; it is damaged; export it again") from None


def open_lvm(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file; such files are read whole."""
    if not read_start(path, len(_BEGIN)).startswith(_BEGIN.encode()):
        raise RecordError("is no LabVIEW measurement file; give the file the ending of what it is")
    head, segments = _parsed(path)
    channels = _common_channels(segments)
    first = segments[0]
    tables = [np.array(one.rows) for one in segments]
    multi = head.get("X_Columns", ["One"])[0].lower() == "multi"
    start = _moment(head, first)
    time = _time(head, segments, tables, start, multi)
    values = np.concatenate(tables)[:, 1 : 1 + len(channels) * (1 + multi) : 1 + multi]
    units = itertools.chain(first.header.get("Y_Unit_Label", []), itertools.repeat(None))
    grid = time if isinstance(time, TimeGrid) else None
    times = None if isinstance(time, TimeGrid) else lambda: time
    series = [
        FileSeries(cell_of(name, name, unit), len(values), _column(column), grid, times, start=start)
        for name, unit, column in zip(channels, units, values.T, strict=False)
    ]
    about = {key: head[key][0] for key in ("Description", "Operator", "Project") if head.get(key)}
    return source_of_series(path.name, series, mapping, about, how="give it a unit in LabVIEW (Y_Unit_Label)")


def _column(values: Array) -> Callable[[int, int], Array]:
    return lambda low, high: np.ascontiguousarray(values[low:high])


def _parsed(path: Path) -> tuple[dict[str, list[str]], list[_Segment]]:
    """Parse the header of the file and all segments."""
    lines = _lines(path)
    head = _file_header(lines)
    mark = _SEPARATORS.get(head.get("Separator", ["Tab"])[0].lower(), "\t")
    decimal = head.get("Decimal_Separator", ["."])[0]
    rows = ((number, [cell.strip() for cell in line.split(mark)]) for number, line in lines)
    segments: list[_Segment] = []
    for number, cells in rows:
        if not any(cells):
            continue
        if cells[0] == "Channels":
            segments.append(_segment(cells, rows, decimal))
        elif segments:
            segments[-1].rows.append(_row(cells, segments[-1], decimal, number))
        else:
            raise RecordError(f"line {number} should begin a segment with 'Channels'; it is damaged; export it again")
    for one in segments:
        said = one.numbers("Samples")
        if said and len(one.rows) < max(said):
            raise RecordError(
                f"is cut off: a segment says {max(said):g} samples and has {len(one.rows)}; copy or export it again"
            )
    return head, segments


def _file_header(lines: Iterator[tuple[int, str]]) -> dict[str, list[str]]:
    """The header of the file, by keyword."""
    head: dict[str, list[str]] = {}
    next(lines, None)
    for _, line in lines:
        key, *cells = re.split(r"[\t,]", line)
        if key == _END:
            break
        if key == "Decimal_Separator":
            cells = [line[len(key) + 1 :].strip("\t ") or "."]  # which may be the comma itself
        if key:
            head[key] = [cell.strip() for cell in cells if cell.strip()]
    return head


def _segment(first: list[str], rows: Iterator[tuple[int, list[str]]], decimal: str) -> _Segment:
    """A segment without its rows, from the first line of its header to the names of its columns."""
    header = {first[0]: first[1:]}
    for number, (key, *cells) in rows:
        if key == "X_Value":
            return _Segment(header, [key, *cells])
        if key == _END or not any([key, *cells]):
            continue
        if not key or key == "Channels" or is_number(key, decimal):
            raise RecordError(f"line {number} is no header line, expected X_Value before it; export it again")
        header[key] = cells
    raise RecordError("is cut off in the header of its last segment; copy or export it again")


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    encoding = encoding_of(path)
    last = ""
    with path.open("rb") as file:
        file.seek(-1, 2)
        ended = file.read() in (b"\n", b"\r", b"\0")
    for block in line_blocks(path, encoding):
        for number, line in enumerate(block.text.decode().splitlines(), block.first):
            last = line
            yield number, line
    if not ended and last.strip():
        raise RecordError("ends in the middle of a line; it is cut off; copy or export it again")


def _row(cells: list[str], segment: _Segment, decimal: str, number: int) -> list[float]:
    """The cells of a row as numbers; behind the channels stands a comment, which is left out."""
    width = len(segment.names) - (segment.names[-1] == "Comment")
    if len(cells) < width:
        raise RecordError(
            f"line {number} has {len(cells)} cells, expected {width} as in the header; complete or remove that line"
        )
    text = "".join(cells[:width])
    if decimal == "." and text.isascii() and "_" not in text:  # what follows is the same, and slow
        try:
            return [float(cell) if cell else np.nan for cell in cells[:width]]
        except ValueError:
            pass
    values = []
    for index, cell in enumerate(cells[:width]):
        if cell in MISSING:
            values.append(np.nan)
        elif is_number(cell, decimal):
            values.append(float(cell.replace(decimal, ".")))
        else:
            raise RecordError(f"column '{segment.names[index]}', line {number}: '{cell[:40]}' is not a number")
    return values


def _common_channels(segments: list[_Segment]) -> list[str]:
    """The channels of the first segment, which all must have."""
    if not any(one.rows for one in segments):
        raise RecordError("holds no samples; expected a segment with rows; record it again")
    channels = _channels(segments[0])
    if any(_channels(one) != channels or one.names != segments[0].names for one in segments):
        raise RecordError("has segments with different channels; expected the same in all; split it in LabVIEW")
    return channels


def _channels(segment: _Segment) -> list[str]:
    names = [name for name in segment.names[1:] if name not in ("Comment", "X_Value")]
    said = segment.numbers("Channels")
    if not names or not said or said[0] != len(names):
        raise RecordError(
            f"names {len(names)} channels, expected {said[0] if said else 0:g}; it is damaged; export it again"
        )
    return names


def _moment(head: dict[str, list[str]], segment: _Segment) -> str | None:
    """The moment of a segment's zero, as local time; None where it is not written as year/month/day."""
    date = (segment.header.get("Date") or head.get("Date") or [""])[0]
    time = (segment.header.get("Time") or head.get("Time") or [""])[0].replace(",", ".")
    if not re.fullmatch(r"\d{4}/\d{2}/\d{2}", date):
        return None
    seconds, _, fraction = time.partition(".")
    try:
        return tidy(f"{date.replace('/', '-')}T{seconds}" + (f".{fraction[:6].rstrip('0') or '0'}" if fraction else ""))
    except ValueError:
        return None


def _time(
    head: dict[str, list[str]], segments: list[_Segment], tables: list[Array], start: str | None, multi: bool
) -> Array | TimeGrid:
    """Times [s] after the first segment's moment, or their grid where only that is written."""
    parts = []
    for one, table in zip(segments, tables, strict=True):
        written = table[:, 0]
        if multi:
            axes = table[:, 0 : 2 * len(one.names) // 2 - 1 : 2]
            if not np.all(axes == axes[:, :1]):
                raise RecordError("has channels with different times; export channels of one clock")
        if np.isnan(written).all():
            begin, step = one.numbers("X0") or [0.0], one.numbers("Delta_X")
            if not step or len({*step}) > 1 or len({*begin}) > 1 or not step[0] > 0.0:
                raise RecordError("has channels without a common step of the time; export channels of one clock")
            if len(segments) == 1:
                return TimeGrid(begin[0], step[0], start)
            written = np.asarray(begin[0] + step[0] * np.arange(table.shape[0]))
        parts.append(written)
    return np.concatenate(_apart(head, segments, parts, start))


def _apart(head: dict[str, list[str]], segments: list[_Segment], parts: list[Array], start: str | None) -> list[Array]:
    """Segments whose times begin anew, set apart by their moments."""
    if all(later[0] > former[-1] for former, later in itertools.pairwise(parts)):
        return parts
    moments = [_moment(head, one) for one in segments]
    if start is None or None in moments:
        raise RecordError("has segments that restart the time and have no dates; split it in LabVIEW")
    begun = moment(start)
    return [part + (moment(str(one)) - begun).total_seconds() for part, one in zip(parts, moments, strict=True)]


FORMAT = Format("a LabVIEW measurement file", (".lvm",), open_lvm, begins=(_BEGIN.encode(),))

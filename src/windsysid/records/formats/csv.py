"""Records as text: one line per sample, written by windsysid or by a logger.

    time [s],rotor_speed [rad/s],tower_x_acceleration [m/s^2]
    0.0,1.2671,0.0132
    0.01,1.2671,

`windsysid.records.formats.text.dialect` finds out how a file is written, `columns` what its columns are, `clock` what
its time counts; here rows become numbers. A row that is not exactly as wide as the header is an error, so that columns
never shift; an empty cell or NaN means missing. A last line that nothing ends may be cut in the middle of a number: it
is left out, and the attribute ``cut_off`` says so, unless its last number is as long as those above.

Written files use ``name [unit]`` and the shortest digits that give back the same float64; the time says its zero,
``time [s since 2021-07-07T12:00:00Z]``, where that is known.
"""

import contextlib
import csv
import io
import itertools
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, NoReturn

import numpy as np
import numpy.typing as npt

from windsysid.errors import RecordError
from windsysid.records.formats.contents.columns import Cell, Column, find_times, plan_columns
from windsysid.records.formats.contents.format import Format
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.source import FileBlock, FileSource
from windsysid.records.formats.text.dates import fitting_formats, is_stamp
from windsysid.records.formats.text.dialect import Layout, counts_rows, find_layout, is_number, split
from windsysid.records.formats.text.text import LineBlock, encoding_of, last_line, line_blocks
from windsysid.records.formats.time.clock import Clock, counted_clock, make_clock, start_of
from windsysid.records.record import Array, Record

__all__ = ["FORMAT", "columns_of_text", "format_of_dates"]

Numbers = npt.NDArray[np.int64]

_TRUTHS = (b"True", b"TRUE", b"true", b"False", b"FALSE", b"false")
_HOW = "write '{}' in the header"
_HEAD = 1 << 18  # bytes that tell how a file is written
_NUMBER_ROWS, _DATE_ROWS = 20, 1000  # rows from which the unit of a time, or the format of dates, is determined
_SHORT = 1 << 23
"""Bytes that NumPy reads in less time than pandas takes to be imported: what a process reads beyond, in one file or in
several, pandas reads, a number in a sixth of the time."""


class _Head(NamedTuple):
    """Layout of a file, cells of its first rows, columns of the time, and the column that only counts rows."""

    layout: Layout
    rows: list[tuple[int, list[str]]]
    times: tuple[int, ...]
    counter: tuple[int, ...] = ()


def open_csv(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Find out how a file is written; `windsysid.records.formats` is the way in."""
    encoding = encoding_of(path, mapping.csv.encoding)
    last = last_line(path, encoding)
    head = _read_head(path, encoding, mapping)
    layout, rows = head.layout, head.rows
    columns = plan_columns(
        layout.cells, (*head.times, *head.counter), mapping, lambda i: _numbers(rows, i, layout), _HOW
    )
    attributes = dict(layout.attributes)
    if head.counter:
        attributes["dropped"] = f"the column '{layout.cells[0].written}' counts the rows; it is left out"
    keep = not last or not last.strip() or _is_complete(last, rows, layout.delimiter)
    if not keep:
        attributes["cut_off"] = "the last line has no end and may be cut off; it is left out"
    first = _first_stamps(head, mapping)
    times, clock = _clock(head, first, mapping)
    rate = mapping.time.rate
    reader = _Reader(path, encoding, head._replace(times=times), columns, clock, keep, rate or 1.0)
    names, units = tuple(column.name for column in columns), tuple(column.unit for column in columns)
    start = reader.first_time(first[0][1]) if times else 0.0
    began = start_of(mapping.time, clock.start)
    return FileSource(path.name, names, units, reader.blocks, attributes, start, began, rate if times else None)


def _first_stamps(head: _Head, mapping: Mapping) -> list[tuple[int, str]]:
    """Lines and times of the first rows; RecordError if no row is as wide as the header, or times do not increase."""
    layout, rows = head.layout, head.rows
    first = _stamps(rows, head.times, len(layout.cells))
    if not first:
        number, found = rows[0] if rows else (layout.first_row, [])
        raise RecordError(
            f"line {number} has {len(found)} cells, expected {max(1, len(layout.cells))} as in the header; complete or"
            " remove that line"
        )
    if not layout.headed and head.times and mapping.time.column is None:
        _check_headless_time(first, layout.decimal)
    return first


def _clock(head: _Head, first: list[tuple[int, str]], mapping: Mapping) -> tuple[tuple[int, ...], Clock]:
    """Columns of the time, none where rows are counted, and their clock."""
    if not head.times:
        return (), Clock()
    unit, cells = head.layout.cells[head.times[0]].unit, [cell for _, cell in first]
    make = make_clock if mapping.time.rate is None else counted_clock
    clock = make(cells, unit, mapping.time, lambda k: f"line {first[k][0]}", head.layout.decimal)
    if clock is None:
        return (), Clock()
    if len(head.times) == 2 and not clock.textual:
        raise RecordError(
            f"the date '{first[0][1][:40]}' in two columns is a number; name the columns of date and time in the"
            ' mapping file: [time] column = ["Date", "Time"]'
        )
    return head.times, clock


def _read_head(path: Path, encoding: str, mapping: Mapping) -> _Head:
    """Read the first lines of a file.

    Where the mapping gives the rate, a first column without a header that counts is the time.
    """
    head = list(_head(path, encoding))
    if not head:
        raise RecordError("holds only blank lines; expected a header line and rows of numbers")

    def rows(layout: Layout) -> list[tuple[int, list[str]]]:
        return [(number, split(text, layout.delimiter)) for number, text in head if number >= layout.first_row]

    layout = find_layout(head, mapping.csv, timed=mapping.time.rate is None)
    if mapping.time.rate is not None and not layout.headed:
        cells = [row[0] for _, row in rows(layout)[:20]]
        if counted_clock(cells, None, mapping.time, "row {}".format, layout.decimal) is not None:
            layout = find_layout(head, mapping.csv, timed=True)
            return _Head(layout, rows(layout), (0,))
    found = rows(layout)
    return _Head(layout, found, *_times_and_counter(layout.cells, [cells for _, cells in found], mapping))


def _stamps(rows: list[tuple[int, list[str]]], times: tuple[int, ...], width: int) -> list[tuple[int, str]]:
    """Lines and times of the first rows: few for numbers, more for dates, to distinguish day and month."""
    some = [(number, " ".join(cells[i] for i in times)) for number, cells in rows[:_DATE_ROWS] if len(cells) >= width]
    dated = bool(times) and bool(some) and not is_number(some[0][1].replace(",", "."))
    return some if dated else some[:_NUMBER_ROWS]


def format_of_dates(path: Path, mapping: Mapping) -> str | None:
    """Strptime pattern that fits the dates in the first lines; None if several fit, or the time needs none."""
    layout, rows, times, _ = _read_head(path, encoding_of(path, mapping.csv.encoding), mapping)
    cells = [cell for _, cell in _stamps(rows, times, len(layout.cells))] if times else []
    needed = mapping.time.format is None and cells and not any(map(is_stamp, cells))
    fitting = fitting_formats(cells) if needed else ()
    return fitting[0] if len(fitting) == 1 else None


def columns_of_text(path: Path, mapping: Mapping) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the columns that hold numbers in the first lines, and of those that hold text; the time is neither."""
    layout, numbered, times, counter = _read_head(path, encoding_of(path, mapping.csv.encoding), mapping)
    rows = [cells for _, cells in numbered]
    numbers: list[str] = []
    texts: list[str] = []
    for index, cell in enumerate(layout.cells):
        cells = [row[index] for row in rows if index < len(row) and row[index] not in layout.missing]
        if index not in (*times, *counter):
            found = sum(is_number(text, layout.decimal) for text in cells)
            (texts if 2 * found < len(cells) else numbers).append(cell.written)
    return tuple(numbers), tuple(texts)


def _times_and_counter(
    cells: Sequence[Cell], rows: list[list[str]], mapping: Mapping
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Columns of the time, and the first column if it only counts rows and the mapping does not mention it.

    If the mapping gives the rate and there is no other time, the column that counts rows is the time, so that lost rows
    remain gaps.
    """
    mentioned = mapping.time.column == cells[0].written or cells[0].written in mapping.channels
    if mentioned or not counts_rows(cells, rows):
        return find_times(cells, mapping), ()
    times = tuple(1 + index for index in find_times(cells[1:], mapping))
    return (times, (0,)) if times or mapping.time.rate is None else ((0,), ())


def write_csv(record: Record, file: BinaryIO) -> None:
    """Write the bare file; `windsysid.records.formats.write_record` is the safe way in."""
    import pandas as pd

    frame = pd.DataFrame(record.values)
    frame.insert(0, "time", record.time)
    header = [
        "time [s]" if record.start is None else f"time [s since {record.start}]",
        *(f"{name} [{unit}]" for name, unit in zip(record.channels, record.units, strict=True)),
    ]
    frame.to_csv(file, mode="wb", index=False, header=header, lineterminator="\n", encoding="utf-8")


def _head(path: Path, encoding: str) -> Iterator[tuple[int, str]]:
    """Number and text of the first lines that are not blank."""
    for block in line_blocks(path, encoding, size=_HEAD):
        for number, line in enumerate(block.text.decode().split("\n"), block.first):
            if line.strip():
                yield number, line
        if number > 1:
            return


def _numbers(rows: list[tuple[int, list[str]]], index: int, layout: Layout) -> Array:
    """The numbers in the first rows of a column."""
    cells = [row[index] for _, row in rows if index < len(row)]
    marked = [cell for cell in cells if cell not in layout.missing and is_number(cell, layout.decimal)]
    return np.array([float(cell.replace(layout.decimal, ".")) for cell in marked])


def _is_complete(last: str, rows: list[tuple[int, list[str]]], delimiter: str) -> bool:
    """Test whether a last line without an end is complete: it has the columns and the decimals of the others."""
    cells = split(last, delimiter)
    others = [row for _, row in rows[:20] if row != cells]
    if last.rstrip().endswith('"') or not others:
        return bool(others) and len(cells) == len(others[0])
    if any(len(row) != len(cells) for row in others):
        return False
    shape = {re.sub(r"\d", "0", re.sub(r"^[+-]?\d+(?=[.,])", "0", row[-1])) for row in others}
    mine = re.sub(r"\d", "0", re.sub(r"^[+-]?\d+(?=[.,])", "0", cells[-1]))
    return shape == {mine} and bool(re.search(r"[.,]\d", cells[-1]))


def _check_headless_time(first: list[tuple[int, str]], decimal: str) -> None:
    try:
        values = [float(cell.replace(decimal, ".")) for _, cell in first]
    except ValueError:
        return  # dates, or a bad cell that is named later
    if any(b <= a for a, b in itertools.pairwise(values)):
        raise RecordError(
            "has no header line, and its first column does not increase as time does; write 'time [s],name [unit],...'"
            " above, or [time] rate = … [Hz] into a mapping file"
        )


def _without_blanks(text: bytes, mark: bytes) -> bytes:
    """Lines without blanks around cells; runs of blanks become one where they are the delimiter."""
    if mark == b" ":
        text = re.sub(rb"[ \t]+", b" ", text)
    if b" " not in text and (b"\t" not in text or mark == b"\t"):
        return text
    edge = rb"[\n]" if mark in b" \t" else rb"[\n" + mark + rb"]"
    # The look-behind makes the search linear: a match from each blank of a run would make it quadratic.
    text = re.sub(rb"(?<![ \t])[ \t]++(?=" + edge + rb")", b"", text)
    text = re.sub(rb"(?<=" + edge + rb")[ \t]++", b"", text)
    return text.lstrip(b" ") if mark == b"\t" else text.lstrip(b" \t")


class _Reader:
    """Rows of one file as numbers, block by block; `by_numpy` bytes of all files were read by NumPy."""

    by_numpy = 0

    def __init__(
        self,
        path: Path,
        encoding: str,
        head: _Head,
        columns: tuple[Column, ...],
        clock: Clock,
        keep: bool,
        rate: float,
    ) -> None:
        self.path, self.encoding, self.layout, self.times = path, encoding, head.layout, head.times
        self.columns, self.clock, self.keep, self.rate = columns, clock, keep, rate
        self.wanted = [*self.times, *(column.index for column in columns)]
        self.numeric = sorted({*self.wanted} - ({*self.times} if clock.textual else set()))
        marked = any(is_number(mark) and not np.isnan(float(mark)) for mark in self.layout.missing)
        plain = self.layout.decimal == "." and self.layout.delimiter != " " and not marked
        self.short = plain and path.stat().st_size < _SHORT
        self.width = len(self.layout.cells)

    def blocks(self, start: float, end: float) -> Iterator[FileBlock]:
        waiting = None  # a block before `start`, only read if it turns out to be the last one
        row = 0
        for block in line_blocks(self.path, self.encoding, keep_last=self.keep):
            text, numbers = self._rows(block)
            if not numbers.size:
                continue
            row += numbers.size
            if start > -np.inf and self._last_time(text, row) < start:
                waiting = (text, numbers, block.done, row)
                continue
            waiting = None
            rows = self._parsed(text, numbers, block.done, row)
            yield rows
            if rows.time[-1] >= end:
                return
        if waiting:
            yield self._parsed(*waiting)

    def first_time(self, cell: str) -> float:
        """Time of the first row [s], NaN if its cell is no time."""
        try:
            raw = [cell] if self.clock.textual else np.array([float(cell.replace(self.layout.decimal, "."))])
            return float(self.clock.seconds(raw, "row {}".format)[0])
        except ValueError:
            return np.nan

    def _last_time(self, text: bytes, rows: int) -> float:
        """Time [s] of the last row of a block, after which `rows` rows of the file are read."""
        if not self.times:
            return (rows - 1) / self.rate
        line = text[text.rfind(b"\n", 0, -1) + 1 : -1].decode()
        cells = line.split(self.layout.delimiter)
        return self.first_time(" ".join(cells[i] for i in self.times))

    def _rows(self, block: LineBlock) -> tuple[bytes, Numbers]:
        """The rows of a block, all as wide as the header, without blanks, quotes and blank lines; and their lines."""
        text, first = self._below_header(block)
        mark = self.layout.delimiter.encode()
        if b'"' in text:
            text = self._without_quotes(text, first)
        text = _without_blanks(text, mark)
        symbols = np.frombuffer(text, dtype=np.uint8)
        ends = np.flatnonzero(symbols == 10)
        numbers = np.arange(first, first + ends.size)
        filled = np.diff(ends, prepend=-1) > 1
        if not filled.all():
            text = re.sub(rb"\n\n+", b"\n", text).lstrip(b"\n")
            numbers, symbols = numbers[filled], np.frombuffer(text, dtype=np.uint8)
            ends = np.flatnonzero(symbols == 10)
        widths = 1 + np.diff(np.searchsorted(np.flatnonzero(symbols == mark[0]), ends), prepend=0)
        text = self._without_last_delimiter(text, widths, mark)
        ragged = np.flatnonzero(widths != self.width)
        if ragged.size:
            k = int(ragged[0])
            raise RecordError(
                f"line {numbers[k]} has {widths[k]} cells, expected {self.width} as in the header; the file "
                "may be cut off or have decimal commas; complete or remove that line"
            )
        return text, numbers

    def _below_header(self, block: LineBlock) -> tuple[bytes, int]:
        """The lines of a block that hold rows, and the number of the first of them."""
        above = self.layout.first_row - block.first
        if above <= 0:
            return block.text, block.first
        lines = block.text.split(b"\n", above)
        return (lines[-1], self.layout.first_row) if len(lines) > above else (b"", 0)

    def _without_last_delimiter(self, text: bytes, widths: Numbers, mark: bytes) -> bytes:
        """The text without the delimiter that ends every line, where the header has one too."""
        if self.layout.closed and np.all(widths == self.width + 1) and text.count(mark + b"\n") == widths.size:
            widths -= 1
            return text.replace(mark + b"\n", b"\n")
        return text

    def _without_quotes(self, text: bytes, first: int) -> bytes:
        mark = self.layout.delimiter
        if mark == " ":
            text = text.replace(b'""', b"nan")  # an empty cell, which is nothing between blanks without its quotes
        simple = re.compile(
            rb"(?:^|(?<=[\n" + mark.encode() + rb']))"([^"\n' + mark.encode() + rb']*)"(?=[\n' + mark.encode() + rb"])"
        )
        text = simple.sub(rb"\1", text)
        if b'"' not in text:
            return text
        lines = enumerate(text.decode().split("\n"), first)
        return "\n".join(self._without_quoted(*line) if '"' in line[1] else line[1] for line in lines).encode()

    def _without_quoted(self, number: int, line: str) -> str:
        """One line without its quotes and the delimiters between them."""
        mark = self.layout.delimiter
        if line.count('"') % 2:
            raise RecordError(f"line {number} has a quote that is not closed; correct that line")
        cells = split(line, mark)
        if len(cells) != self.width:
            return line  # named with its width by `_rows`
        if self.clock.textual and mark == ",":
            cells = [re.sub(r"(:\d\d),(\d)", r"\1.\2", c) if k in self.times else c for k, c in enumerate(cells)]
        for index in sorted(self.wanted):
            if re.search(rf'["{mark}]', cells[index]):
                self._refuse(index, number, cells[index])
        return mark.join(re.sub(rf'["{mark}]', "_", cell) for cell in cells)

    def _parsed(self, text: bytes, numbers: Numbers, done: float, read: int) -> FileBlock:
        def place(row: int) -> str:
            return f"line {numbers[row]}"

        if any(word in text for word in _TRUTHS):
            self._refuse_bad_cells(text, numbers)  # pandas makes numbers of them
        table, texts = self._cells(text, numbers)
        if len(table) != numbers.size:
            raise RecordError(f"lines {numbers[0]} to {numbers[-1]} hold {len(table)} rows; the file is damaged")
        time = self._seconds(table, texts, place, read)
        at = [self.numeric.index(column.index) for column in self.columns]
        if all(column.factor == 1.0 for column in self.columns):
            values = table[:, at]
        else:
            values = np.column_stack([column.values(table[:, i]) for i, column in zip(at, self.columns, strict=True)])
        return FileBlock(time, np.ascontiguousarray(values), place, done)

    def _cells(self, text: bytes, numbers: Numbers) -> tuple[Array, list[list[str]]]:
        """The `numeric` columns (T, n), and the texts of times that are no numbers."""
        if self.short and not self.clock.textual and _Reader.by_numpy < _SHORT:
            _Reader.by_numpy += len(text)
            with contextlib.suppress(ValueError):  # something is missing, or no number
                return np.loadtxt(
                    io.BytesIO(text), delimiter=self.layout.delimiter, usecols=self.numeric, comments=None, ndmin=2
                ), []
        import pandas as pd

        kinds: dict[int, Any] = dict.fromkeys(self.numeric, np.float64)
        missing: Any = {index: list(self.layout.missing) for index in kinds}
        texts = [i for i in self.times if i not in kinds]
        try:
            with warnings.catch_warnings():
                # Newer pandas reads every digit anyway and warns about the option that older ones need for it.
                warnings.filterwarnings("ignore", message=".*float_precision", category=Warning)
                frame = pd.read_csv(
                    io.BytesIO(text),
                    header=None,
                    sep=self.layout.delimiter,
                    usecols=self.wanted,
                    dtype={**kinds, **dict.fromkeys(texts, object)},
                    float_precision="round_trip",
                    quoting=csv.QUOTE_NONE,
                    decimal=self.layout.decimal,
                    keep_default_na=False,
                    na_values=missing,
                    skip_blank_lines=False,
                    engine="c",
                )
        except (ValueError, OverflowError):
            self._refuse_bad_cells(text, numbers)
            raise RecordError(
                f"lines {numbers[0]} to {numbers[-1]}: some cell is not a number; export the file again"
            ) from None
        return frame[self.numeric].to_numpy(), [frame[i].to_list() for i in texts]

    def _seconds(self, table: Array, texts: list[list[str]], place: Callable[[int], str], read: int) -> Array:
        if not self.times:  # counted, and not added up, so that they are the same in pieces
            return np.asarray(np.arange(read - len(table), read) / self.rate)
        if not self.clock.textual:
            return self.clock.seconds(table[:, self.numeric.index(self.times[0])], place)
        return self.clock.seconds([" ".join(row) for row in zip(*texts, strict=True)], place)

    def _refuse_bad_cells(self, text: bytes, numbers: Numbers) -> None:
        mark = self.layout.decimal
        for line, number in zip(text.decode().split("\n"), numbers, strict=False):
            for index, cell in enumerate(line.split(self.layout.delimiter)):
                wanted = index in self.wanted and not (index in self.times and self.clock.textual)
                if wanted and cell not in self.layout.missing and not is_number(cell, mark):
                    self._refuse(index, int(number), cell)

    def _refuse(self, index: int, line: int, cell: str) -> NoReturn:
        raise RecordError(
            f"column '{self.layout.cells[index].written}', line {line}: '{cell[:40]}' is not a number: expected a"
            f" decimal '{self.layout.decimal}', no mark of thousands; see [csv] in docs/records.md"
        )


FORMAT = Format("text", (".csv", ".txt", ".dat", ".tsv"), open_csv, write_csv)

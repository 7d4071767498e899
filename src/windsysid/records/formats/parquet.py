"""Records as Parquet: one column per channel, its unit in the column's metadata.

A file that pandas wrote is read as well: its time is a column called so, or its index, as numbers or as dates; units
come from the names, as in text. Needs pyarrow. Rows are written in groups with checksums, so that a section reads
only its groups and a damaged page is found.

Parquet has no checksum of the footer, where names, units and types stand. windsysid writes one before it, where no
reader of Parquet looks. In a foreign file, what the footer gives twice must agree: names, the number of rows, and
that no value is beyond the least and the greatest that it gives for a column.
"""

import io
import json
import re
import zlib
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from windsysid.configuration import parse_json
from windsysid.errors import OutputError, RecordError
from windsysid.records.formats.access.files import read_start, reading
from windsysid.records.formats.contents.columns import (
    Cell,
    Column,
    find_times,
    is_called_time,
    name_and_unit,
    names_and_units,
    plan_columns,
)
from windsysid.records.formats.contents.format import Format, package
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.source import FileBlock, FileSource, doubles, shifted
from windsysid.records.formats.time.clock import (
    Clock,
    counted_clock,
    exact_seconds,
    make_clock,
    moments_clock,
    start_of,
)
from windsysid.records.moments import split_start
from windsysid.records.record import Array, Record

__all__ = ["FORMAT"]

_GROUP = 1 << 16  # rows
_SOME = 10_000  # values that show in which units they are plausible
_VALUES = 1 << 20  # read at once

_SEAL = b"windsysid crc32 "
"""Prefix of a footer, with eight digits: the checksum of the footer and of the bytes after it."""

_UNNAMED = re.compile(r"__index_level_\d+__")
"""Name that pandas gives to an index without a name."""

_TAIL = 8
"""Bytes behind the footer: its length, and four letters."""


def open_parquet(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file; its row groups are read as far as they are needed."""
    if read_start(path, 4) != b"PAR1":
        raise RecordError("is not Parquet; give the file the ending of what it is, or export it again")
    _check_seal(path)
    file = _opened(path)
    with reading():
        rows = _rows(file, mapping)
        notes = _notes(file.schema_arrow)
        attributes = {str(k): str(v) for k, v in parse_json(notes.get("windsysid_attributes", "{}")).items()}
        clock = rows.clock
        start = 0.0 if clock is None else float(_seconds(clock, rows.first)[0])
        said, attributes = split_start(attributes, np.array([start]))
    if rows.counter:
        attributes["dropped"] = "pandas' index counts the rows; it is left out"
    return FileSource(
        notes.get("windsysid_name", path.name),
        *names_and_units(rows.columns),
        partial(_blocks, file, rows, mapping.time.rate or 1.0),
        attributes,
        start,
        start_of(mapping.time, (None if clock is None else clock.start) or said),
        None if clock is None else mapping.time.rate,
    )


class _Rows(NamedTuple):
    """Reader of rows: channels, columns of the time and of their number, the clock and the times of the first rows.

    Without a clock rows are counted.
    """

    columns: tuple[Column, ...]
    times: tuple[int, ...]
    counter: tuple[int, ...]
    clock: Clock | None
    first: Any


def _rows(file: Any, mapping: Mapping) -> _Rows:
    schema = file.schema_arrow
    cells = [_cell(schema.field(i)) for i in range(len(schema))]
    index = _pandas_index(_notes(schema), schema.names)
    times, counter = _times_and_counter(cells, index, mapping)

    def some(index: int) -> Array:
        _check_type(schema.field(index), dates=False)
        batch = next(file.iter_batches(_SOME, columns=[schema.names[index]]), None)
        return np.empty(0) if batch is None else _numbers(_column(batch, schema.names, index))

    columns = plan_columns(cells, (*times, *counter), mapping, some, "name the column '{}'")
    for i in [*times, *(column.index for column in columns)]:
        _check_type(schema.field(i), dates=i in times)
    shown = times[0] if times else 0
    batch = next(file.iter_batches(20, columns=[schema.names[shown]]), None)
    if batch is None or not batch.num_rows:
        raise RecordError("expected at least 2 samples, got 0; give a longer record")
    first = _column(batch, schema.names, shown)
    clock = _clock(first, cells[shown].unit, mapping) if times else None
    return _Rows(columns, times if clock else (), counter, clock, first)


def _notes(schema: Any) -> dict[str, str]:
    return {key.decode(): text.decode() for key, text in (schema.metadata or {}).items()}


def _blocks(file: Any, rows: _Rows, rate: float, start: float, end: float) -> Iterator[FileBlock]:
    """Blocks of the rows from `start` to `end` [s]."""
    done, total, waiting = 0, max(file.metadata.num_rows, 1), None
    indices = [*rows.times, *(column.index for column in rows.columns)]
    for table in _batches(file, file.schema_arrow.names, indices):
        first = done
        done += len(table[0])
        seconds = np.arange(first, done) / rate if rows.clock is None else _seconds(rows.clock, table[0])
        values = [column.values(_numbers(table[i])) for i, column in enumerate(rows.columns, len(rows.times))]
        block = FileBlock(seconds, np.column_stack(values), shifted("sample {}".format, first), done / total)
        waiting = block if seconds.size and seconds[-1] < start else None
        if waiting is None:
            yield block
            if seconds.size and seconds[-1] >= end:
                return
    if waiting is not None:
        yield waiting


def write_parquet(record: Record, file: BinaryIO) -> None:
    """Write the bare file; `windsysid.records.formats.write_record` is the safe way in.

    Raises
    ------
    OutputError
        If pyarrow is not installed.
    """
    try:
        pa, pq = _pyarrow("pyarrow"), _pyarrow("pyarrow.parquet")
    except RecordError as error:
        raise OutputError(str(error)) from None
    fields = [pa.field("time", pa.float64(), metadata={"units": "s"})]
    for name, unit in zip(record.channels, record.units, strict=True):
        fields.append(pa.field(name, pa.float64(), metadata={"units": unit}))
    attributes = {**record.attributes, **({} if record.start is None else {"start_time": record.start})}
    about = {"windsysid_name": record.name, "windsysid_attributes": json.dumps(attributes)}
    columns = [record.time, *(record[name] for name in record.channels)]
    table = pa.table([pa.array(column) for column in columns], schema=pa.schema(fields, metadata=about))
    written = io.BytesIO()
    pq.write_table(table, written, row_group_size=_GROUP, write_page_checksum=True, use_dictionary=False)
    content = written.getbuffer()
    at = len(content) - _TAIL - int.from_bytes(content[-_TAIL:-4], "little")
    for part in (content[:at], _seal(content[at:]), content[at:]):
        file.write(part)


def _seal(footer: bytes | memoryview) -> bytes:
    """Prefix of a footer that windsysid wrote."""
    return _SEAL + b"%08x\n" % zlib.crc32(footer)


def _check_seal(path: Path) -> None:
    """Refuse a file whose footer was changed after windsysid sealed it; one without a seal is somebody else's."""
    size, length = path.stat().st_size, len(_seal(b""))
    with path.open("rb") as file:
        file.seek(max(size - _TAIL, 0))
        footer = int.from_bytes(file.read(4), "little") + _TAIL
        if footer + length > size:
            return
        file.seek(size - footer - length)
        found, rest = file.read(length), file.read()
    if found.startswith(_SEAL) and found != _seal(rest):
        raise RecordError("is damaged: the checksum of its footer does not agree; copy or export it again")


class _Footer:
    """Columns and groups of rows in the footer, compared with the rows as they come.

    A group is asked about after its rows were read: pyarrow ends the whole process where one is damaged that nothing
    was read of.
    """

    def __init__(self, file: Any, names: list[str], indices: list[int]) -> None:
        self.about, self.names = file.metadata, names
        paths = [self.about.schema.column(i).path for i in range(self.about.num_columns)]
        places = {name: [i for i, path in enumerate(paths) if path == name] for name in names}
        self.at = {i: places[names[i]][_occurrence(names, i)] for i in indices if places[names[i]]}
        self.group, self.begin, self.done = 0, 0, 0  # the group at hand, its first row, rows that came

    def check(self, batch: Any) -> None:
        """Refuse rows of which the footer says something else."""
        self.done += batch.num_rows
        groups = self._groups()
        compute = _pyarrow("pyarrow.compute")
        for index, at in self.at.items():
            pairs = [limits for group in groups if (limits := self._limits(group.column(at), index)) is not None]
            found = compute.min_max(_column(batch, self.names, index)).as_py()
            if len(pairs) < len(groups) or found["min"] is None:
                continue
            if found["min"] < min(low for low, _ in pairs) or found["max"] > max(high for _, high in pairs):
                raise RecordError(
                    f"is damaged: column '{self.names[index]}' has values beyond the least and greatest that the footer"
                    " says; copy or export it again"
                )

    def _groups(self) -> list[Any]:
        """The groups that the rows since the last call are of."""
        groups = []
        while self.begin < self.done and self.group < self.about.num_row_groups:
            groups.append(self.about.row_group(self.group))
            if self.begin + groups[-1].num_rows > self.done:
                break
            self.group, self.begin = self.group + 1, self.begin + groups[-1].num_rows
        return groups

    def _limits(self, column: Any, index: int) -> tuple[Any, Any] | None:
        """The least and greatest value of a column of a group; None if the footer does not say them as numbers."""
        if column.path_in_schema != self.names[index]:
            raise RecordError("is damaged: its footer gives a column two names; copy or export it again")
        known = column.statistics
        if known is None or not known.has_min_max or not isinstance(known.min, int | float):
            return None
        return known.min, known.max

    def check_end(self) -> None:
        """Refuse a file with another number of rows."""
        if self.done != self.about.num_rows:
            raise RecordError(f"is damaged: expected {self.about.num_rows} rows, got {self.done}; copy it again")


def _pyarrow(module: str) -> Any:
    return package(module, "Parquet files", "parquet")


def _opened(path: Path) -> Any:
    pq = _pyarrow("pyarrow.parquet")
    with reading():
        return pq.ParquetFile(path, page_checksum_verification=True)


def _batches(file: Any, names: list[str], indices: list[int]) -> Iterator[list[Any]]:
    """The columns at these indices of a file with columns of these names, batch by batch."""
    with reading():
        footer = _Footer(file, names, indices)
        read = list(dict.fromkeys(names[i] for i in indices))
        for batch in file.iter_batches(max(1, min(_GROUP, _VALUES // len(indices))), columns=read):
            footer.check(batch)
            yield [_column(batch, names, i) for i in indices]
        footer.check_end()


def _column(batch: Any, names: list[str], index: int) -> Any:
    """The column at `index` of the file: pyarrow reads by name, and gives all columns of that name in their order."""
    return batch.column(sorted(batch.schema.get_all_field_indices(names[index]))[_occurrence(names, index)])


def _occurrence(names: list[str], index: int) -> int:
    """Number of columns before the one at `index` with its name."""
    return names[:index].count(names[index])


def _cell(field: Any) -> Cell:
    unit = (field.metadata or {}).get(b"units", b"").decode()
    return Cell(field.name, field.name, unit) if unit else name_and_unit(field.name)


def _pandas_index(notes: dict[str, str], names: list[str]) -> int | None:
    """The column that pandas says is the index, if that is how the file was written."""
    try:
        index = parse_json(notes.get("pandas", "{}"))["index_columns"]
    except (ValueError, KeyError, TypeError):
        return None
    said = isinstance(index, list) and len(index) == 1 and isinstance(index[0], str)
    return names.index(index[0]) if said and index[0] in names else None


def _times_and_counter(
    cells: list[Cell], index: int | None, mapping: Mapping
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Columns of the time, and pandas' index if it only counts rows and another column is the time."""
    counter: tuple[int, ...] = ()
    if index is not None and _UNNAMED.fullmatch(cells[index].written) and _has_other_time(cells, index, mapping):
        counter, index = (index,), None
    if index is not None and mapping.time.column is None:
        return (index,), counter
    return find_times(cells, mapping), counter


def _has_other_time(cells: list[Cell], index: int, mapping: Mapping) -> bool:
    """Test whether another column than the index is the time: the mapping's column, or one with the name of a time."""
    if mapping.time.column is not None:
        return mapping.time.column != cells[index].written
    return is_called_time(cells[0].name)


def _check_type(field: Any, *, dates: bool) -> None:
    import pyarrow as pa  # type: ignore[import-untyped,unused-ignore]

    kind = field.type
    if pa.types.is_floating(kind) or pa.types.is_integer(kind) or (dates and pa.types.is_timestamp(kind)):
        return
    raise RecordError(f"column '{field.name}' holds {kind}, expected numbers; leave it out or convert it")


def _clock(column: Any, unit: str | None, mapping: Mapping) -> Clock | None:
    import pyarrow as pa  # type: ignore[import-untyped,unused-ignore]

    if pa.types.is_timestamp(column.type):
        return moments_clock(int(_moments(column)[0]), column.type.tz, mapping.time)
    make = make_clock if mapping.time.rate is None else counted_clock
    return make([repr(v) for v in _numbers(column).tolist()], unit, mapping.time, "sample {}".format, ".")


def _seconds(clock: Clock, column: Any) -> Array:
    import pyarrow as pa  # type: ignore[import-untyped,unused-ignore]

    if pa.types.is_timestamp(column.type):
        return exact_seconds(clock, _moments(column), "sample {}".format)
    return clock.seconds(_numbers(column), "sample {}".format)


def _moments(column: Any) -> Any:
    import pyarrow as pa  # type: ignore[import-untyped,unused-ignore]

    if column.null_count:
        raise RecordError("the time is missing at some sample; remove those rows")
    return column.cast(pa.timestamp("ns", column.type.tz)).cast(pa.int64()).to_numpy()


def _numbers(column: Any) -> Array:
    return doubles(column.to_numpy(zero_copy_only=False))


FORMAT = Format("Parquet", (".parquet",), open_parquet, write_parquet, (b"PAR1",))

"""A strict reader of Arrow's IPC stream: columns of floats, and nothing else.

What it reads is the format of https://arrow.apache.org/docs/format/Columnar.html: messages of a length, a description
in FlatBuffers (Message.fbs, Schema.fbs) and a body. A block is one schema of float32 and float64 fields and batches of
samples. Everything else that a stream may hold is refused by its description, before anything is made of it: columns
that are compressed would let 25 kB become a gigabyte. Every offset is held against the payload.
"""

import struct
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Columns", "NotArrowError", "read_columns"]

MARK = b"\xff\xff\xff\xff"
"""Before every message."""

MAX_TEXT_BYTES = 1000
"""Of a name, a unit or a mark [bytes]."""

MAX_MARKS = 100
"""Of a schema or a field."""

MAX_BATCHES = 10_000
"""Largest number of batches in a stream: each one takes 100 bytes of description, however few rows it has."""

MAX_CACHED_SCHEMAS, MAX_SCHEMA_CACHE_BYTES = 32, 16_000_000
"""Largest number of schema lengths in the cache, and of schemas of one length; size of the cache [bytes]."""

SCHEMA, BATCH = 1, 3
"""Kinds of messages (MessageHeader)."""

FLOATING_POINT = 3
"""Of the types of a field (Type)."""

FLOATS: dict[int, np.dtype[np.floating]] = {1: np.dtype("<f4"), 2: np.dtype("<f8")}
"""By precision; 0 is half."""

_i16, _i32, _u32, _i64 = (struct.Struct(f"<{code}").unpack_from for code in "hiIq")
_pair = struct.Struct("<qq").unpack_from
_head = struct.Struct("<4si").unpack_from
_shorts = [struct.Struct(f"<{n}H").unpack_from for n in range(9)]


class NotArrowError(ValueError):
    """The bytes are not such a stream; the message says what was expected."""


class Columns(NamedTuple):
    """Content of a stream.

    Attributes
    ----------
    marks
        The schema's metadata.
    names, units
        Of the columns; a unit is None where the field says none.
    values
        (n, m), float32 where all columns are, float64 otherwise; NaN where a value is null.
    """

    marks: dict[str, str]
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    values: NDArray[np.floating]


class _Field(NamedTuple):
    name: str
    unit: str | None
    dtype: np.dtype[np.floating]


class _Schema(NamedTuple):
    """Fields, where the text of each mark is, and the bytes around those texts with their places."""

    pieces: tuple[tuple[int, int, bytes], ...]
    fields: tuple[_Field, ...]
    marks: tuple[tuple[str, int, int], ...]

    @property
    def texts(self) -> tuple[tuple[str, ...], tuple[str | None, ...]]:
        """Names and units of the fields."""
        return tuple([field.name for field in self.fields]), tuple([field.unit for field in self.fields])


class _Message(NamedTuple):
    """Offsets of a message's header table and body, and the length of the body [bytes]."""

    kind: int
    header: int
    body: int
    length: int


class _Batch(NamedTuple):
    """Rows of a batch, where its lists of nodes and of buffers begin, and where its body does, with its length."""

    rows: int
    node: int
    buffer: int
    body: int
    length: int


def read_columns(payload: bytes, *, most_rows: int, most_columns: int) -> Columns:
    """The columns of a stream.

    Raises
    ------
    NotArrowError
        If it is none, is cut, holds anything but floats, is compressed, or has more rows or columns.
    """
    try:
        messages = _messages(payload)
        schema = _opened(payload, messages, most_columns)
        fields = schema.fields
        batches = _batches(payload, messages, len(fields), most_rows)
        rows = sum([batch.rows for batch in batches])
        if rows * sum([field.dtype.itemsize for field in fields]) > len(payload):
            raise NotArrowError("columns share their bytes: expected separate bytes for each column")
        single = {field.dtype.itemsize for field in fields} == {4}
        values = np.empty((rows, len(fields)), dtype=np.float32 if single else np.float64)
        at = 0
        for batch in batches:
            _fill(payload, batch, fields, values[at : at + batch.rows])
            at += batch.rows
        marks = {name: payload[begin:end].decode() for name, begin, end in schema.marks}
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise NotArrowError(f"an offset points outside it ({error})") from None
    return Columns(marks, *schema.texts, values)


def _opened(payload: bytes, messages: Iterator[_Message], most_columns: int) -> _Schema:
    """The schema, which is the first message."""
    first = next(messages, None)
    if first is None or first.kind != SCHEMA:
        raise NotArrowError("expected a schema first")
    schema = _known_schema(payload, first) or _schema(payload, first, most_columns)
    if len(schema.fields) > most_columns:  # the cache may hold a schema that was read with other limits
        raise _too_wide(len(schema.fields), most_columns)
    return schema


def _batches(payload: bytes, messages: Iterator[_Message], columns: int, most_rows: int) -> list[_Batch]:
    """The batches that follow the schema."""
    batches: list[_Batch] = []
    rows = 0
    for message in messages:
        if message.kind != BATCH:
            raise NotArrowError("expected batches of samples after the schema, no dictionaries and no tensors")
        batch = _batch(payload, message, columns)
        rows += batch.rows
        if not 0 <= batch.rows <= rows <= most_rows:
            raise NotArrowError(f"more than {most_rows} samples: send shorter blocks")
        batches.append(batch)
        if len(batches) > MAX_BATCHES:
            raise NotArrowError(f"more than {MAX_BATCHES} batches: send one")
    return batches


def _messages(payload: bytes) -> Iterator[_Message]:
    """The messages of a stream, until its mark of the end or the payload's."""
    at, end = 0, len(payload)
    while at < end:
        mark, size = _head(payload, at)
        if mark != MARK:
            raise NotArrowError(f"expected a message at byte {at}")
        if size == 0:
            return
        version, kind, header, length = _places(payload, _table(payload, at + 8), 4)
        begin = at + 8 + size
        long = _i64(payload, length)[0] if length else 0
        if size < 0 or not 0 <= long <= end - begin:
            raise NotArrowError("a message is truncated")
        if not all((version, kind, header)) or not 3 <= _i16(payload, version)[0] <= 4:
            raise NotArrowError("expected version 4 or 5 of the format")
        yield _Message(payload[kind], _table(payload, header), begin, long)
        at = begin + long


def _known_schema(payload: bytes, message: _Message) -> _Schema | None:
    """The schema that was read before, if all but the texts of the marks is as it was: a logger's blocks differ in
    nothing else, and a schema is most of what there is to read."""
    for known in _schemas.get(message.body, ()):
        if all(payload[begin:end] == piece for begin, end, piece in known.pieces):
            return known
    return None


_schemas: dict[int, list[_Schema]] = {}
"""Schemas that were read, by the length of their messages; `MAX_CACHED_SCHEMAS` lengths, and of each length as many."""


def _schema(payload: bytes, message: _Message, most_columns: int) -> _Schema:
    """Metadata and fields of a schema."""
    order, listed, marked = _places(payload, message.header, 3)
    if order and _i16(payload, order)[0] != 0:
        raise NotArrowError("expected little-endian values")
    count, at = _vector(payload, listed)
    if count > most_columns:
        raise _too_wide(count, most_columns)
    fields = tuple([_field(payload, _table(payload, at + 4 * i)) for i in range(count)])
    marks = tuple([(_text(payload, key), *_span(payload, value)) for key, value in _marks(payload, marked)])
    pieces, at = [], 0
    for begin, end in [*sorted((begin, end) for _, begin, end in marks), (message.body, message.body)]:
        if begin < at or end > message.body:
            raise NotArrowError("a text points outside its message")
        pieces.append((at, begin, payload[at:begin]))
        at = end
    schema = _Schema(tuple(pieces), fields, marks)
    _remember(schema, message.body)
    return schema


def _remember(schema: _Schema, length: int) -> None:
    """Add a schema of so many bytes to the cache, which is emptied where it would become too large."""
    held = sum(size * len(alike) for size, alike in _schemas.items())
    if len(_schemas) >= MAX_CACHED_SCHEMAS or held + length > MAX_SCHEMA_CACHE_BYTES:
        _schemas.clear()
    texts = sum(len(field.name) + len(field.unit or "") for field in schema.fields)
    if texts <= length <= MAX_SCHEMA_CACHE_BYTES:  # longer texts would share their bytes
        alike = _schemas.setdefault(length, [])
        alike.insert(0, schema)
        del alike[MAX_CACHED_SCHEMAS:]


def _too_wide(columns: int, most: int) -> NotArrowError:
    return NotArrowError(f"{columns} channels: expected {most} at most")


def _field(payload: bytes, table: int) -> _Field:
    name_at, _, kind, of_type, dictionary, _, marks = _places(payload, table, 7)
    name = _text(payload, name_at)
    dtype = None
    if kind and of_type and not dictionary and payload[kind] == FLOATING_POINT:
        (precision,) = _places(payload, _table(payload, of_type), 1)
        dtype = FLOATS.get(_i16(payload, precision)[0] if precision else 0)
    if dtype is None:
        raise NotArrowError(f"channel '{name[:40]}': expected float32 or float64")
    units = [_text(payload, value) for key, value in _marks(payload, marks) if _text(payload, key) == "unit"]
    return _Field(name, units[0] if units else None, dtype)


def _marks(payload: bytes, at: int) -> list[list[int]]:
    """Metadata: where the key and the value of each are."""
    count, first = _vector(payload, at)
    if count > MAX_MARKS:
        raise NotArrowError(f"{count} metadata: expected {MAX_MARKS} at most")
    return [_places(payload, _table(payload, first + 4 * i), 2) for i in range(count)]


def _batch(payload: bytes, message: _Message, columns: int) -> _Batch:
    """Locations of a batch's columns: each has a node (rows, nulls), a validity bitmap, and its values."""
    rows, nodes, buffers, compression = _places(payload, message.header, 4)
    if compression:
        raise NotArrowError("columns are compressed: send them as they are")
    (n, node), (m, buffer) = _vector(payload, nodes), _vector(payload, buffers)
    if n != columns or m != 2 * n:
        raise NotArrowError(f"a batch of {n} columns: expected those of the schema, {columns}")
    return _Batch(_i64(payload, rows)[0] if rows else 0, node, buffer, message.body, message.length)


def _fill(payload: bytes, batch: _Batch, fields: tuple[_Field, ...], values: NDArray[np.floating]) -> None:
    """The values of a batch."""
    rows = batch.rows
    for i, field in enumerate(fields):
        count, nulls = _pair(payload, batch.node + 16 * i)
        if count != rows:
            raise NotArrowError(f"channel '{field.name[:40]}' has {count} values: expected {rows}")
        if not rows:
            continue
        at = _buffer(payload, batch, 2 * i + 1, rows * field.dtype.itemsize)
        values[:, i] = np.frombuffer(payload, field.dtype, rows, at)
        if nulls:
            bytes_ = (rows + 7) // 8
            bits = np.frombuffer(payload, np.uint8, bytes_, _buffer(payload, batch, 2 * i, bytes_))
            values[np.unpackbits(bits, bitorder="little")[:rows] == 0, i] = np.nan


def _buffer(payload: bytes, batch: _Batch, which: int, size: int) -> int:
    """Offset of a batch's buffer, of which `size` bytes are read."""
    offset, length = _pair(payload, batch.buffer + 16 * which)
    if offset < 0 or length < size or offset + length > batch.length:
        raise NotArrowError("a column is truncated")
    return batch.body + int(offset)


# FlatBuffers: a table begins with the way back to its list of fields' places; 0 stands for what is left out


def _table(payload: bytes, at: int) -> int:
    """The table that the offset at a place means."""
    return at + int(_u32(payload, at)[0])


def _places(payload: bytes, table: int, most: int) -> list[int]:
    """Offsets of the first fields of a table; 0 if a field is absent."""
    listed = table - _i32(payload, table)[0]
    if listed < 0:
        raise NotArrowError("an offset points outside it")
    known = min(most, (_shorts[1](payload, listed)[0] - 4) // 2)
    if known < 0:
        raise NotArrowError("a table is truncated")
    found = [table + off if off else 0 for off in _shorts[known](payload, listed + 4)]
    return found if known == most else found + [0] * (most - known)


def _vector(payload: bytes, at: int) -> tuple[int, int]:
    """Length of a vector, and where its first element is; of none where the table has none."""
    if not at:
        return 0, 0
    begin = at + _u32(payload, at)[0]
    return _u32(payload, begin)[0], begin + 4


def _span(payload: bytes, at: int) -> tuple[int, int]:
    """Start and end of a text."""
    length, begin = _vector(payload, at)
    if length > MAX_TEXT_BYTES or begin + length > len(payload):
        raise NotArrowError(f"a text of {length} bytes: expected {MAX_TEXT_BYTES} at most")
    return begin, begin + length


def _text(payload: bytes, at: int) -> str:
    begin, end = _span(payload, at)
    return payload[begin:end].decode()

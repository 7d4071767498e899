"""NumPy's ``.npy`` and ``.npz``: a structured array with a field for each channel, a matrix, or named arrays.

The fields of a structured array are channels by their names. The columns of a matrix are ``column_1``, ``column_2`` …;
like text without a header it needs a mapping with the names and the rate. The arrays of an ``.npz`` are read by the
rules of `windsysid.records.formats.contents.arrays`. Headers are read first and compared with the size of the file.
Pickles are not read: they could run any program. Dates become seconds after the first one.

Source: NumPy, ``numpy.lib.format``.
"""

import math
import zipfile
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.formats.access.files import reading
from windsysid.records.formats.contents.arrays import Stored, rate_hint, source_of_arrays
from windsysid.records.formats.contents.format import Format
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.source import FileSource, doubles
from windsysid.records.record import Array

__all__ = ["FORMAT"]

_MAGIC = b"\x93NUMPY"
_ENDING = ".npy"
_COARSE = ("Y", "M", "generic")  # units of dates that have no fixed number of seconds


class _ArrayHeader(NamedTuple):
    """Shape and data type of an array, and size of its header and numbers together [bytes]."""

    shape: tuple[int, ...]
    kind: np.dtype[Any]
    size: int


def open_numpy(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file; an ``.npy`` is read as far as it is needed, an ``.npz`` array by array."""
    with reading():
        arrays = list(_archive(path) if zipfile.is_zipfile(path) else _single(path))
    return source_of_arrays(path.name, arrays, mapping, {"source": "NumPy"}, rate_hint(arrays))


def _single(path: Path) -> Iterator[Stored]:
    with path.open("rb") as file:
        header = _header(file)
    size = path.stat().st_size
    _check_size(path.name, header, size)
    if size > header.size:
        raise RecordError("holds more than one array; write several with numpy.savez into an .npz")
    name = "column_1" if len(header.shape) == 1 else "column"
    yield from _stored(name, header, partial(np.load, path, mmap_mode="r", allow_pickle=False))


def _archive(path: Path) -> Iterator[Stored]:
    @cache  # such a file is read array by array, not in parts
    def array(name: str) -> Any:
        with reading(), zipfile.ZipFile(path) as archive, archive.open(name) as file:
            return np.lib.format.read_array(file, allow_pickle=False)

    with zipfile.ZipFile(path) as archive:
        members = [one for one in archive.infolist() if one.filename.endswith(_ENDING)]
        if not members:
            raise RecordError("is no .npz of NumPy: it holds no array; give the file the ending of what it is")
        for one in members:
            with archive.open(one) as file:
                header = _header(file)
            _check_size(one.filename, header, one.file_size)
            yield from _stored(one.filename.removesuffix(_ENDING), header, partial(array, one.filename))


def _header(file: IO[bytes]) -> _ArrayHeader:
    if file.read(len(_MAGIC)) != _MAGIC:
        raise RecordError("is no array of NumPy; give the file the ending of what it is")
    file.seek(0)
    version = np.lib.format.read_magic(file)
    first = version == (1, 0)
    shape, _, kind = (np.lib.format.read_array_header_1_0 if first else np.lib.format.read_array_header_2_0)(file)
    if version == (3, 0) and kind.names is not None:  # as 2.0, but for names in UTF-8, which was read as Latin-1
        kind.names = tuple(name.encode("latin-1").decode() for name in kind.names)
    count = math.prod(map(int, shape))
    return _ArrayHeader(shape, kind, file.tell() + count * kind.itemsize)


def _check_size(name: str, header: _ArrayHeader, size: int) -> None:
    if header.kind.hasobject or size >= header.size:
        return
    raise RecordError(f"is cut off: {name} needs {header.size} bytes, got {size}; copy or save it again")


def _stored(path: str, header: _ArrayHeader, get: Callable[[], Any]) -> list[Stored]:
    """Channels of an array; a structured array has one for each field."""
    if header.kind.hasobject and header.kind.names is None:
        return [Stored(path, header.shape, lambda index: np.empty(0), numeric=False)]
    if header.kind.hasobject:
        raise RecordError(f"{path}: a field holds Python objects, which are not read; save numbers only")
    if header.kind.names is None:
        return [_one(path, header.shape, header.kind, get)]
    return [
        _one(f"{path}/{name}", header.shape, header.kind[name], partial(_field, get, name))
        for name in header.kind.names
    ]


def _field(get: Callable[[], Any], name: str) -> Any:
    return get()[name]


def _one(path: str, shape: tuple[int, ...], kind: np.dtype[Any], get: Callable[[], Any]) -> Stored:
    kept = tuple(size for size in shape if size != 1)
    moments = kind.kind in "mM" and np.datetime_data(kind)[0] not in _COARSE

    def read(index: tuple[Any, ...]) -> Array:
        values = np.reshape(get(), kept)
        return doubles(_seconds(values)[index] if moments else values[index])

    numeric = (kind.kind in "fiub" or moments) and kind.subdtype is None
    return Stored(path, kept, read, numeric, "s" if moments else None)


def _seconds(moments: Any) -> Array:
    """Dates as seconds after the first one, and durations as seconds; NaN where one is missing."""
    if moments.dtype.kind == "M":
        moments = moments - moments.flat[0]
    return np.asarray(moments / np.timedelta64(1, "s"))


FORMAT = Format("a NumPy array", (".npy", ".npz"), open_numpy, begins=(_MAGIC,))

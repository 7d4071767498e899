"""MATLAB's ``.mat``: files to version 7 by scipy, those of version 7.3, which are HDF5, by h5py.

A variable is an array of `windsysid.records.formats.contents.arrays`; the fields of a structure are ``name/field``.
HDF5 counts axes from the other end than MATLAB, so that a matrix of T rows and m columns lies there as (m, T): what is
the time follows from its length, so that both versions give the same record. A scalar called ``fs`` or the like is no
time; the message that a rate is missing names it. Cells, characters and objects (``timetable``, ``datetime``) are left
out.
"""

import struct
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.formats.access.files import read_start, reading
from windsysid.records.formats.access.hdf5_tree import datasets
from windsysid.records.formats.access.probing import probe
from windsysid.records.formats.contents.arrays import Stored, rate_hint, source_of_arrays
from windsysid.records.formats.contents.format import Format
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.source import FileSource, doubles
from windsysid.records.formats.hdf5 import opened, stored
from windsysid.records.record import Array

__all__ = ["FORMAT"]

_OLD, _NEW = b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file"
_HEADER = 128  # bytes
_ELEMENTS = (14, 15)  # a variable, plain or compressed
_NO_NUMBERS = ("char", "cell", "function_handle", "struct", "object", "unknown", "opaque", "function")


def open_matlab(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file of either kind; variables are read where they are needed."""
    start = read_start(path, 128)
    if not start.startswith((_OLD, _NEW)):
        raise RecordError("is no MATLAB file of version 5 to 7.3; save it in MATLAB with -v7.3, or as what it is")
    with reading():
        if start.startswith(_OLD):
            _follow(path, ">" if start[126:128] == b"MI" else "<")
            probe(path, "scipy.io")
        arrays = list(_new(path) if start.startswith(_NEW) else _old(path))
        hint = rate_hint(arrays)
    about = start[:116].decode("latin-1").strip()
    return source_of_arrays(path.name, arrays, mapping, {"source": about}, hint)


def _follow(path: Path, order: str) -> None:
    """Refuse a file whose chain of variables does not end where the file does: scipy would leave out the rest."""
    size, at = path.stat().st_size, _HEADER
    with path.open("rb") as file:
        while at < size:
            file.seek(at)
            tag = file.read(8)
            kind, length = struct.unpack(f"{order}II", tag) if len(tag) == 8 else (0, 0)
            if kind not in _ELEMENTS or at + 8 + length > size:
                raise RecordError(
                    f"is damaged or cut off: no whole variable begins at byte {at}; copy or save it again"
                )
            at += 8 + length


def _new(path: Path) -> Iterator[Stored]:
    probe(path)
    file = opened(path)
    try:
        yield from _datasets(file)
    except Exception:
        file.close()
        raise


def _datasets(file: Any) -> Iterator[Stored]:
    for name, dataset in datasets(file):
        kind = dataset.attrs.get("MATLAB_class", b"double")
        kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
        if kind not in _NO_NUMBERS and not dataset.attrs.get("MATLAB_empty", 0):
            yield from stored(name, dataset)


def _old(path: Path) -> Iterator[Stored]:
    from scipy.io import whosmat

    @cache  # such a file is read variable by variable, not in parts
    def variable(name: str) -> Any:
        from scipy.io import loadmat

        with reading():
            return loadmat(str(path), variable_names=[name], squeeze_me=True, struct_as_record=False)[name]

    for name, shape, kind in whosmat(str(path)):
        if kind == "struct":
            yield from _fields(name, partial(variable, name))
        else:
            yield _array(name, tuple(shape), kind not in _NO_NUMBERS, partial(variable, name))


def _fields(path: str, get: Callable[[], Any]) -> Iterator[Stored]:
    """The fields of a structure, and those of structures in it; arrays of structures have no names and are left out."""
    structure = get()
    for field in getattr(structure, "_fieldnames", ()):
        value = getattr(structure, field)
        below = _member(get, field)
        if hasattr(value, "_fieldnames"):
            yield from _fields(f"{path}/{field}", below)
        else:
            array = np.asarray(value)
            yield _array(f"{path}/{field}", array.shape, array.dtype.kind in "fiub", below)


def _member(get: Callable[[], Any], field: str) -> Callable[[], Any]:
    return lambda: getattr(get(), field)


def _array(path: str, shape: tuple[int, ...], numeric: bool, get: Callable[[], Any]) -> Stored:
    def read(index: tuple[Any, ...]) -> Array:
        array = np.asarray(get())
        if array.dtype.kind not in "fiub":
            raise RecordError(f"'{path}' holds {array.dtype}, expected real numbers; leave it out or convert it")
        return doubles(np.reshape(array, kept)[index])

    kept = tuple(size for size in shape if size != 1)
    return Stored(path, kept, read, numeric)


FORMAT = Format("a MATLAB file", (".mat",), open_matlab, begins=(_OLD, _NEW))

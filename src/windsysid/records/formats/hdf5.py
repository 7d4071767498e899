"""HDF5 of any layout: datasets are channels, by their paths; a mapping says which one is the time.

A dataset ``tower/acc`` is called ``acc``, or ``tower_acc`` where another is called so too; the mapping may list it as
``tower/acc``. Units are attributes ``units`` or ``unit``; packed numbers are unpacked as in netCDF. The fields of a
compound dataset are series of their own, ``table/field``. Files of DTU's time series format are read by
`windsysid.records.formats.gtsdf`. HDF5 has no checksum of its own tables: a damaged file may look whole.
"""

from pathlib import Path
from typing import Any

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.formats import gtsdf
from windsysid.records.formats.access.files import damaged, read_start, reading
from windsysid.records.formats.access.hdf5_tree import datasets
from windsysid.records.formats.access.probing import probe
from windsysid.records.formats.contents.arrays import Stored, source_of_arrays
from windsysid.records.formats.contents.format import Format
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.source import FileSource, doubles
from windsysid.records.formats.netcdf import check_seal, unpacked
from windsysid.records.record import Array

__all__ = ["FORMAT", "opened", "stored"]

_MAGIC = b"\x89HDF\r\n\x1a\n"
_UNITS = ("units", "unit", "Units", "Unit")


def open_hdf5_file(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file of any layout; its datasets are read as far as they are needed."""
    if read_start(path, len(_MAGIC)) != _MAGIC:
        raise RecordError("is not HDF5; give the file the ending of what it is, or export it again")
    if not check_seal(path):
        probe(path)
    file = opened(path)
    try:
        found = list(datasets(file))
        if _text(file.attrs.get("type", "")).lower().startswith(gtsdf.TYPE.lower()):
            return _gtsdf(path.name, file, found, mapping)
        arrays = [array for name, dataset in found for array in stored(name, dataset)]
        texts = {str(key): str(value) for key, value in file.attrs.items() if isinstance(value, str)}
    except Exception as error:
        file.close()
        raise damaged(error) from error
    return source_of_arrays(path.name, arrays, mapping, texts)


def _gtsdf(name: str, file: Any, found: list[tuple[str, Any]], mapping: Mapping) -> FileSource:
    about = {str(key): _plain(value) for key, value in file.attrs.items()}
    groups = {name: dict(file[name].attrs) for name in {path.split("/")[0] for path, _ in found if "/" in path}}
    return gtsdf.source_of_blocks(name, about, dict(found), groups, mapping)


def opened(path: Path) -> Any:
    """An h5py file, closed when it is no longer referenced; RecordError where it is damaged."""
    import h5py  # type: ignore[import-untyped,unused-ignore]

    with reading():  # damaged HDF5 raises nearly anything
        return h5py.File(path, "r")


def stored(path: str, dataset: Any, *, unit: str | None = None) -> list[Stored]:
    """A dataset as arrays; a compound one has one for each field."""
    fields = dataset.dtype.names
    if fields is not None:
        return [_stored(f"{path}/{name}", dataset.fields(name), dataset, dataset.dtype[name], None) for name in fields]
    said = next((_text(dataset.attrs[key]) for key in _UNITS if key in dataset.attrs), unit)
    return [_stored(path, dataset, dataset, dataset.dtype, said)]


def _stored(path: str, values: Any, dataset: Any, kind: Any, unit: str | None) -> Stored:
    shape = tuple(dataset.shape or ())
    kept = [axis for axis, size in enumerate(shape) if size != 1]

    def read(index: tuple[Any, ...]) -> Array:
        whole: list[Any] = [0] * len(shape)
        for axis, one in zip(kept, index, strict=True):
            whole[axis] = one
        with reading():
            if values is dataset:
                return doubles(unpacked(dataset, tuple(whole)))
            return doubles(values[tuple(whole)])

    return Stored(path, tuple(shape[axis] for axis in kept), read, kind.kind in "fiu" and not kind.subdtype, unit)


def _plain(value: Any) -> Any:
    return _text(value) if isinstance(value, bytes) else value


def _text(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", errors="replace")
    return str(np.squeeze(value)) if isinstance(value, np.ndarray) else str(value)


FORMAT = Format("HDF5", (".h5", ".hdf5", ".hdf", ".he5"), open_hdf5_file, begins=(_MAGIC,))

"""Records as netCDF-4: one variable (time,) per channel with its ``units``, times in seconds.

Everything a `Record` holds is kept, names and attributes included, so that reading gives back what was
written. HDF5 protects none of its own tables: a damaged file gives zeros, or makes the library hang. So every block of
numbers carries a checksum, and a seal after the end of the file holds one of the whole. Foreign files are read
if they are built the same way: a coordinate ``time`` [s] and numbers along it.
"""

import io
import zlib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

import numpy as np

from windsysid.errors import ConfigurationError, OutputError, RecordError
from windsysid.records.formats.access.files import read_start, reading
from windsysid.records.formats.access.hdf5_tree import check_tree
from windsysid.records.formats.access.probing import probe
from windsysid.records.formats.contents.columns import Cell, Column, name_and_unit, plan_columns
from windsysid.records.formats.contents.format import Format
from windsysid.records.formats.contents.mapping import Mapping
from windsysid.records.formats.contents.source import FileBlock, FileSource, doubles, indexed_source
from windsysid.records.formats.time.clock import split_since, start_of
from windsysid.records.formats.time.time_units import confirmed_unit
from windsysid.records.labelled import written_order
from windsysid.records.moments import has_zone, split_start
from windsysid.records.record import Array, Record
from windsysid.units import si_unit, to_si

if TYPE_CHECKING:
    import h5netcdf

__all__ = ["FORMAT", "check_seal", "open_hdf5", "sealed", "unpacked"]

_HDF5 = b"\x89HDF\r\n\x1a\n"
_SEAL = b"windsysid crc32 "  # and eight digits, after the end of the HDF5 file, where no other program looks
_MAX_CHECKED_BYTES = 1 << 28  # bytes: a section of a larger file is not worth reading it all for its checksum
_VALUES = 1 << 20  # read at once
_SOME = 10_000  # values that show in which units they are plausible
_HOW = "give the variable its attribute units"
_MAX_VALUES_AT_ONCE = 1 << 24  # values that fit into memory without thinking


class _Contents(NamedTuple):
    """Content of a file: channels, the names of the file's variables, times [s], and its attributes."""

    columns: tuple[Column, ...]
    variables: list[str]
    time: Array
    start: str | None
    attributes: dict[str, str]
    name: str


def open_netcdf(path: Path, mapping: Mapping, *, whole: bool = False) -> FileSource:
    """Open a file; its variables are read as far as they are needed."""
    start = read_start(path, len(_HDF5))
    if start[:3] == b"CDF":
        raise RecordError("is classic netCDF, expected netCDF-4; convert it with 'nccopy -k nc4'")
    if start != _HDF5:
        raise RecordError("is not netCDF-4; give the file the ending of what it is, or export it again")
    if (whole or path.stat().st_size < _MAX_CHECKED_BYTES) and not check_seal(path):
        probe(path)
    with reading(), open_hdf5(path) as file:
        found = _contents(file, mapping, path.name)
    columns = found.columns
    opened: list[h5netcdf.File] = []

    def rows(low: int, high: int) -> Array:
        with reading():
            parts = [unpacked(opened[-1][found.variables[c.index]], slice(low, high)) for c in columns]
        return np.column_stack([column.values(part) for column, part in zip(columns, parts, strict=True)])

    values = found.time.size * len(columns)
    at_once = values if whole and values <= _MAX_VALUES_AT_ONCE else _VALUES
    source = indexed_source(found.name, columns, found.time, rows, values_at_once=at_once)

    def blocks(start: float, end: float) -> Iterator[FileBlock]:
        opened.append(open_hdf5(path))
        try:
            yield from source.blocks(start, end)
        finally:
            opened.pop().close()

    return replace(source, blocks=blocks, attributes=found.attributes, start=found.start)


def _contents(file: "h5netcdf.File", mapping: Mapping, name: str) -> _Contents:
    time_name = _time_name(mapping)
    if time_name not in file.variables or len(file[time_name].dimensions) != 1:
        raise RecordError(
            "not a record: expected a coordinate 'time' (T,) in seconds, got the variables "
            f"{', '.join(list(file.variables)[:12]) or 'none'}"
        )
    columns, names, scalars = _channels(file, time_name, mapping)
    time = _seconds(file[time_name], time_name, mapping)
    texts = {key: str(value) for key, value in file.attrs.items() if not key.startswith("windsysid_")}
    said, attributes = split_start(texts, time)
    left_out = {"left_out": ", ".join(scalars)} if scalars and not mapping.only_listed else {}
    start = start_of(mapping.time, _since(file[time_name]) or said)
    return _Contents(columns, names, time, start, attributes | left_out, str(file.attrs.get("windsysid_name", name)))


def _channels(
    file: "h5netcdf.File", time_name: str, mapping: Mapping
) -> tuple[tuple[Column, ...], list[str], list[str]]:
    """Channels of a file, the names of all variables with samples, and those of scalars that the mapping leaves out."""
    names = [name for name in _order(file) if name != time_name]
    scalars = [name for name in names if not file[name].dimensions and name not in mapping.channels]
    names = [name for name in names if name not in scalars]
    (dimension,) = file[time_name].dimensions

    def some(index: int) -> Array:
        _check_variable(file[names[index]], names[index], dimension)
        return unpacked(file[names[index]], slice(0, _SOME))

    columns = plan_columns([_cell(name, file[name]) for name in names], None, mapping, some, _HOW)
    for column in columns:
        _check_variable(file[names[column.index]], names[column.index], dimension)
    return columns, names, scalars


def write_netcdf(record: Record, file: BinaryIO) -> None:
    """Write the bare file; `windsysid.records.formats.write_record` is the safe way in.

    Raises
    ------
    OutputError
        If a name cannot stand in a netCDF file.
    """
    for name in (*record.channels, *record.attributes):
        if "/" in name:
            raise OutputError(f"'{name}' cannot be a name in netCDF because of the '/'; rename it or write CSV")
    import h5netcdf

    written = io.BytesIO()  # a disk that is full makes HDF5 end the interpreter: it gets none
    with h5netcdf.File(written, "w") as whole:
        whole.dimensions["time"] = record.samples
        columns = zip(("time", *record.channels), ("s", *record.units), (record.time, *record.values.T), strict=True)
        for name, unit, values in columns:
            # HDF5 gives its fill value, zero by default, for blocks that a damaged file has lost sight of.
            variable = whole.create_variable(name, ("time",), np.float64, values, fillvalue=np.nan, fletcher32=True)
            variable.attrs["units"] = unit
        whole.attrs.update({**record.attributes, **record.marks})
    file.write(sealed(written.getvalue()))


def sealed(content: bytes) -> bytes:
    """The content of a file with a checksum of the whole after its end."""
    return content + _SEAL + b"%08x\n" % zlib.crc32(content)


def check_seal(path: Path) -> bool:
    """Refuse a file that was changed after windsysid sealed it; False for one without a seal, which is somebody else's.

    Raises
    ------
    RecordError
        If the checksum is not that of the file.
    """
    body = path.stat().st_size - len(_SEAL) - 9
    with path.open("rb") as file:
        file.seek(max(body, 0))
        found = file.read()
    if not found.startswith(_SEAL):
        return False
    if found != _SEAL + b"%08x\n" % _checksum(path, body):
        raise RecordError("is damaged: its checksum does not agree with its content; copy or export it again")
    return True


def _checksum(path: Path, size: int) -> int:
    checksum = 0
    with path.open("rb") as file:
        while size > 0 and (data := file.read(min(size, 1 << 22))):
            checksum, size = zlib.crc32(data, checksum), size - len(data)
    return checksum


def open_hdf5(path: Path) -> "h5netcdf.File":
    """An HDF5 file, opened for reading; RecordError where it is damaged or none."""
    import h5netcdf
    import h5py  # type: ignore[import-untyped,unused-ignore]

    with reading():  # damaged HDF5 raises nearly anything
        # h5netcdf leaves a traceback on stderr where it fails half-way: fail before it in the same places.
        with h5py.File(path) as file:
            file.attrs.get("_nc3_strict")
            check_tree(file)
        return h5netcdf.File(path, decode_vlen_strings=True)


def _order(file: "h5netcdf.File") -> list[str]:
    """The variables' names without the coordinates (CF conventions 1.11, section 5), in the written record's order."""
    listed = [str(item.attrs.get("coordinates", "")).split() for item in (file, *file.variables.values())]
    coordinates = {*file.dimensions, *(name for some in listed for name in some)}
    names = [name for name in file.variables if name not in coordinates]
    return written_order(names, file.attrs.get("windsysid_channels", "[]"))


def _time_name(mapping: Mapping) -> str:
    if mapping.time.rate is not None or isinstance(mapping.time.column, tuple):
        raise ConfigurationError(
            f"{mapping.place}: time: netCDF has one time of its own; leave only its column, unit, zone and start"
        )
    return mapping.time.column or "time"


def _unit(variable: "h5netcdf.Variable") -> str:
    return str(variable.attrs.get("units", ""))


def _cell(name: str, variable: "h5netcdf.Variable") -> Cell:
    unit = _unit(variable)
    return Cell(name, name, unit) if unit else name_and_unit(name)


def _since(time: "h5netcdf.Variable") -> str | None:
    """The moment that ``seconds since …`` names: UTC where it has no zone (CF conventions 1.11, section 4.4)."""
    said = split_since(_unit(time))[1]
    return said if said is None or has_zone(said) else said + "Z"


def unpacked(variable: Any, rows: Any) -> Array:
    """Unpack values by CF conventions 1.11: the fill value is missing (2.5.1), then scale and offset apply (8.1)."""
    raw, attributes = variable[rows], variable.attrs
    values = doubles(raw)
    for key in ("_FillValue", "missing_value"):
        if key in attributes:
            values = np.where(np.isin(raw, attributes[key]), np.nan, values)
    scale, offset = (
        float(np.squeeze(attributes.get(key, usual))) for key, usual in (("scale_factor", 1.0), ("add_offset", 0.0))
    )
    return values if (scale, offset) == (1.0, 0.0) else scale * values + offset


def _seconds(variable: "h5netcdf.Variable", name: str, mapping: Mapping) -> Array:
    _check_variable(variable, name, *variable.dimensions)
    time = unpacked(variable, slice(None))
    unit = (
        mapping.time.unit
        or split_since(_unit(variable) or None)[0]
        or confirmed_unit(time[:20][np.isfinite(time[:20])])
    )
    try:
        factor = to_si(1.0, unit) if si_unit(unit) == "s" else None
    except ConfigurationError as error:
        raise RecordError(f"time: {error}") from error
    if factor is None:
        raise RecordError(f"time is in '{unit}', expected seconds; convert it first")
    return time if factor == 1.0 else np.asarray(time * factor)


def _check_variable(variable: "h5netcdf.Variable", name: str, dimension: str) -> None:
    kind = np.dtype(variable.dtype)
    if variable.dimensions != (dimension,) or kind.kind not in "fiu" or "_Unsigned" in variable.attrs:
        raise RecordError(
            f"'{name}' is {kind} with dimensions ({', '.join(variable.dimensions)}): "
            f"expected numbers with dimension ({dimension}); leave it out or convert it"
        )


FORMAT = Format("netCDF-4", (".nc", ".nc4", ".netcdf"), open_netcdf, write_netcdf)

"""Alternatives to a record, a turbine or a posterior as an argument: a path, a name, a table, a result.

pandas and xarray are never imported here: whoever hands over their objects has done so.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, cast

from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.labelled import Labelled, is_a, of_dataset, of_frame

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from windsysid.records.formats.contents.mapping import Mapping
    from windsysid.records.record import Record


__all__ = ["MappingLike", "RecordLike", "as_pieces", "as_record", "as_records"]

RecordLike: TypeAlias = "Record | str | Path | pd.DataFrame | xr.Dataset"
MappingLike: TypeAlias = "str | Path | Mapping"


def as_records(given: "RecordLike | Sequence[RecordLike]", mapping: "MappingLike | None" = None) -> "list[Record]":
    """One record or several, in a list or a tuple, as `as_record` takes each; ConfigurationError if there is none."""
    several = cast("Sequence[RecordLike]", given) if isinstance(given, list | tuple) else [cast("RecordLike", given)]
    if not several:
        raise ConfigurationError("records: expected one at least, got an empty list")
    return [as_record(each, mapping) for each in several]


def as_pieces(
    given: "RecordLike | Iterable[Record]", mapping: "MappingLike | None" = None
) -> "Record | Iterable[Record]":
    """Pieces of a record as they are; anything else as `as_record` takes it."""
    library = type(given).__module__.split(".")[0]
    if isinstance(given, Iterable) and not isinstance(given, str) and library not in ("pandas", "xarray"):
        return cast("Iterable[Record]", given)
    return as_record(cast("RecordLike", given), mapping)


def as_record(given: RecordLike, mapping: "MappingLike | None" = None) -> "Record":
    """A record from itself, a file read by its mapping, a DataFrame or a Dataset.

    The columns of a DataFrame are called ``name [unit]``, or ``attrs["units"]`` holds the unit of each name. Variables
    of a Dataset have an attribute ``units``. The time [s] is a column or coordinate ``time``, or else the index, in
    seconds or as dates.

    Raises
    ------
    RecordError
        If it is none of these, or a column has no unit.
    ConfigurationError
        If there is a mapping although no file is read.
    """
    from windsysid.records.record import Record

    if isinstance(given, str | Path):
        from windsysid.records.formats import read_record

        return read_record(given, mapping=mapping)
    if mapping is not None:
        raise ConfigurationError(
            f"mapping: expected the path of a file as the record, got a {type(given).__name__}: a mapping tells how a"
            " file is read"
        )
    if isinstance(given, Record):
        return given
    if is_a(given, "pandas", "DataFrame"):
        return _said(of_frame(given), "a column '{0} [unit]', or attrs['units']['{0}']", "DataFrame")
    if is_a(given, "xarray", "Dataset"):
        return _said(of_dataset(given, every=False), "an attribute 'units'", "Dataset")
    raise RecordError(
        "record: expected a Record, the path of a file, a pandas DataFrame or an xarray Dataset, got"
        f" {type(given).__name__}{': call Record.from_array(values, rate)' if hasattr(given, '__array__') else ''}"
    )


def _said(table: Labelled, where: str, kind: str) -> "Record":
    """The record of a table in which every channel says its unit."""
    from windsysid.records.record import Record

    unsaid = next((name for name, (_, unit) in table.columns.items() if unit is None), None)
    if unsaid is not None:
        raise RecordError(f"{kind}: '{unsaid}' has no unit: expected {where.format(unsaid)}")
    if not table.columns:
        raise RecordError(f"{kind}: expected channels along the time, got none")
    try:
        return Record.from_labelled(table, where)
    except RecordError as error:
        raise RecordError(f"{kind}: {error}") from error

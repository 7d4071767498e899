"""What a function may be handed instead of a record, a turbine or a posterior: a path, a name, a table, a result.

pandas and xarray are never imported here: whoever hands over their objects has done so.
"""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from windsysid.errors import RecordError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from windsysid.records.record import Record


__all__ = ["RecordLike", "as_record"]

RecordLike: TypeAlias = "Record | str | Path | pd.DataFrame | xr.Dataset"

_HEADING = re.compile(r"(.*\S)\s*[\[(]([^\[\]()]*)[\])]\s*")


def as_record(given: RecordLike) -> "Record":
    """A record from itself, a file, a DataFrame or a Dataset.

    The columns of a DataFrame are called ``name [unit]``, or ``attrs["units"]`` holds the unit of each name. Variables
    of a Dataset have an attribute ``units``. The time [s] is a column or coordinate ``time``, or else the index, in
    seconds or as dates.

    Raises
    ------
    RecordError
        If it is none of these, or a column has no unit.
    """
    from windsysid.records.record import Record

    if isinstance(given, Record):
        return given
    if isinstance(given, str | Path):
        from windsysid.records.formats import read_record

        return read_record(given)
    library = type(given).__module__.split(".")[0]
    if library == "pandas" and type(given).__name__ == "DataFrame":
        return _from_columns(*_of_frame(given), "DataFrame")
    if library == "xarray" and type(given).__name__ == "Dataset":
        return _from_columns(*_of_dataset(given), "Dataset")
    raise RecordError(
        "record: expected a Record, the path of a file, a pandas DataFrame or an xarray Dataset, got"
        f" {type(given).__name__}"
    )


def _of_frame(frame: Any) -> tuple[dict[str, tuple[Any, str | None]], tuple[Any, str | None]]:
    """Columns and time of a DataFrame, each with its unit as far as it says one."""
    said = frame.attrs.get("units", {})
    columns: dict[str, tuple[Any, str | None]] = {}
    for heading in frame.columns:
        split = _HEADING.fullmatch(str(heading))
        name, unit = split.groups() if split else (str(heading).strip(), None)
        if name in columns:
            raise RecordError(f"DataFrame: column '{name}' is there twice: rename one")
        columns[name] = frame[heading].to_numpy(), unit if unit is not None else said.get(heading)
    return columns, (frame.index.to_numpy(), None)


def _of_dataset(data: Any) -> tuple[dict[str, tuple[Any, str | None]], tuple[Any, str | None]]:
    """Variables along the time of a Dataset, and the time, each with its unit as far as it says one."""
    if "time" not in data.variables or data["time"].dims != ("time",):
        raise RecordError(f"Dataset: expected a coordinate 'time', got {', '.join(map(str, data.coords)) or 'none'}")
    columns = {
        str(name): (variable.values, variable.attrs.get("units"))
        for name, variable in data.data_vars.items()
        if variable.dims == ("time",)
    }
    return columns, (data["time"].values, data["time"].attrs.get("units"))


def _from_columns(columns: dict[str, tuple[Any, str | None]], index: tuple[Any, str | None], kind: str) -> "Record":
    from windsysid.records.record import Record, convert

    moments, unit = columns.pop("time", index)
    time = _seconds(np.asarray(moments), unit, kind)
    channels = {}
    for name, (values, unit) in columns.items():
        if unit is None:
            raise RecordError(
                f"{kind}: '{name}' has no unit: expected "
                + (
                    f"a column '{name} [unit]', or attrs['units']['{name}']"
                    if kind == "DataFrame"
                    else "an attribute 'units'"
                )
            )
        try:
            numbers = np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError):
            raise RecordError(f"{kind}: '{name}': expected numbers, got {np.asarray(values).dtype}") from None
        channels[name] = convert(numbers, unit, f"{kind}: '{name}'")
    if not channels:
        raise RecordError(f"{kind}: expected channels along the time, got none")
    values = np.column_stack([values for values, _ in channels.values()])
    return Record(time, values, tuple(channels), tuple(unit for _, unit in channels.values()), name=kind)


def _seconds(moments: Any, unit: str | None, kind: str) -> Any:
    """Times in seconds; dates from the first on."""
    from windsysid.records.record import convert

    if np.issubdtype(moments.dtype, np.datetime64):
        return (moments - moments[:1]) / np.timedelta64(1, "s")
    if np.issubdtype(moments.dtype, np.timedelta64):
        return moments / np.timedelta64(1, "s")
    try:
        seconds, si = convert(np.asarray(moments, dtype=np.float64), unit or "s", f"{kind}: time")
    except (TypeError, ValueError) as error:
        if isinstance(error, RecordError):
            raise
        raise RecordError(f"{kind}: time: expected seconds or dates without time zone, got {moments.dtype}") from None
    if si != "s":
        raise RecordError(f"{kind}: time: expected s, got {unit}")
    return seconds

"""Tables that carry their labels, a pandas DataFrame and an xarray Dataset, taken apart: columns, units, times, start.

pandas and xarray are never imported here: whoever hands over their objects has done so.
"""

import re
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.configuration import parse_json
from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.moments import moment_text, split_start, zone_offset
from windsysid.units import si_unit, to_si

__all__ = ["Labelled", "is_a", "of_dataset", "of_frame", "written_order"]

_HEADING = re.compile(r"(.*\S)\s*[\[(]([^\[\]()]*)[\])]\s*")
_MINE = "windsysid_"


class Labelled(NamedTuple):
    """A table taken apart.

    Attributes
    ----------
    columns : dict of str to (array (T,), str or None)
        Values and unit of each channel, None where none is said.
    time : (T,) array
        [s]
    start : str or None
        The moment of time 0.
    attributes : dict of str to str
    name : str
    """

    columns: dict[str, tuple[Any, str | None]]
    time: Array
    start: str | None
    attributes: dict[str, str]
    name: str


def is_a(given: Any, library: str, kind: str) -> bool:
    """Test whether a value is of a class of a library, which is not imported."""
    return any(base.__name__ == kind and base.__module__.split(".")[0] == library for base in type(given).__mro__)


def _require(given: Any, library: str, kind: str) -> None:
    if not is_a(given, library, kind):
        raise RecordError(f"{kind}: expected one of {library}, got {type(given).__name__}")


def of_frame(frame: Any) -> Labelled:
    """A DataFrame: columns ``name [unit]``, or units in ``attrs["units"]``; the time is a column or the index.

    Raises
    ------
    RecordError
        If a column is there twice, or the time is neither numbers nor dates.
    """
    _require(frame, "pandas", "DataFrame")
    said = frame.attrs.get("units", {})
    columns: dict[str, tuple[Any, str | None]] = {}
    for heading in frame.columns:
        split = _HEADING.fullmatch(str(heading))
        name, unit = split.groups() if split else (str(heading).strip(), None)
        if name in columns:
            raise RecordError(f"DataFrame: column '{name}' is there twice: rename one")
        columns[name] = frame[heading], unit if unit is not None else said.get(heading)
    label = str(frame.index.name or "")
    indexed = _HEADING.fullmatch(label)
    moments, unit = columns.pop("time", (frame.index, indexed[2] if indexed else None))
    time, start = _seconds(moments, unit, "DataFrame")
    values = {name: (column.to_numpy(), unit) for name, (column, unit) in columns.items()}
    texts = {str(k): str(v) for k, v in frame.attrs.items() if k != "units"}
    noted, attributes = split_start(texts, time)
    return Labelled(values, time, start or noted, attributes, "DataFrame")


def of_dataset(dataset: Any, *, every: bool = True) -> Labelled:
    """A Dataset whose variables (time,) have an attribute ``units``, in the order that a record wrote.

    `every` variable must run along the time; otherwise those that do are taken.

    Raises
    ------
    RecordError
        If there is no time, or it is neither numbers nor dates.
    """
    _require(dataset, "xarray", "Dataset")
    if "time" not in dataset.variables or dataset["time"].dims != ("time",):
        found = ", ".join(str(name) for name in list(dataset.variables)[:12]) or "none"
        raise RecordError(f"Dataset: not a record: expected a coordinate 'time' (T,), got the variables {found}")
    order = written_order([str(name) for name in dataset.data_vars], dataset.attrs.get(f"{_MINE}channels", "[]"))
    columns = {}
    for name in order:
        variable = dataset[name]
        if variable.dims == ("time",):
            columns[name] = variable.to_numpy(), variable.attrs.get("units")
        elif every:
            raise RecordError(
                f"'{name}' is {variable.dtype} with dimensions ({', '.join(map(str, variable.dims))}): "
                "expected numbers with dimension (time); leave it out or convert it"
            )
    time, start = _seconds(dataset["time"].to_index(), dataset["time"].attrs.get("units"), "Dataset")
    texts = {str(k): str(v) for k, v in dataset.attrs.items() if not str(k).startswith(_MINE)}
    noted, attributes = split_start(texts, time)
    return Labelled(columns, time, start or noted, attributes, str(dataset.attrs.get(f"{_MINE}name", "record")))


def written_order(names: list[str], listed: str) -> list[str]:
    """Names in the order in which a record listed them, as JSON; as they are if it lists others or none."""
    try:
        order = [str(name) for name in parse_json(listed)]
    except (TypeError, ValueError):
        return names
    return order if sorted(order) == sorted(names) else names


def _seconds(moments: Any, unit: str | None, kind: str) -> tuple[Array, str | None]:
    """Times [s], and of dates the moment of the first, from which they count."""
    zone = getattr(moments.dtype, "tz", None)
    if zone is not None:
        naive = getattr(moments, "dt", moments)  # a column of dates has what an index has under dt
        moments = naive.tz_convert(None)
    array = np.asarray(moments.to_numpy())
    if np.issubdtype(array.dtype, np.datetime64):
        instants = array.astype("datetime64[ns]").astype(np.int64)
        if not instants.size or np.isnat(array).any():
            raise RecordError(f"{kind}: time: expected a date in every row, got some without; remove those rows")
        origin = int(instants[0])
        return (instants - origin) / 1e9, moment_text(origin, None if zone is None else zone_offset(origin, zone))
    if np.issubdtype(array.dtype, np.timedelta64):
        return np.asarray(array / np.timedelta64(1, "s")), None
    try:
        seconds = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise RecordError(f"{kind}: time: expected seconds or dates, got {array.dtype}") from None
    factor = _seconds_in(unit or "s", kind)
    return (seconds if factor == 1.0 else seconds * factor), None


def _seconds_in(unit: str, kind: str) -> float:
    try:
        if si_unit(unit) != "s":
            raise RecordError(f"{kind}: time: expected s, got {unit}; convert it first")
        return to_si(1.0, unit)
    except ConfigurationError as error:
        raise RecordError(f"{kind}: time: {error}") from error

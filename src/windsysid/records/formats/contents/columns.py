"""From a file's columns to a record's channels: names, units and signs.

A header cell says a name and a unit in one of three ways: ``name [unit]`` or ``name (unit)``; an ending that is
one of `SUFFIXES` (``pitch_deg`` is the channel ``pitch`` in degrees); or not at all. A column without a unit is
refused where its name says a quantity (`windsysid.records.quantities`): ``rotor_speed`` could be in rpm as well as in
rad/s. Where the name says none, the values stay ``as written: unknown``. What a mapping file says about a column goes
before.
"""

import contextlib
import difflib
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from windsysid.errors import ConfigurationError, RecordError, UnknownTimeError
from windsysid.records.checks import Array, check_channels
from windsysid.records.formats.contents.mapping import AS_IT_IS, ChannelRule, Mapping, matches
from windsysid.records.quantities import check_quantity, implied_unit, missing_units
from windsysid.records.record import AS_WRITTEN
from windsysid.units import canonical, is_same_quantity, si_unit, to_si

__all__ = [
    "COUNTER_NAMES", "DATE_NAMES", "SUFFIXES", "TIME_NAMES", "Cell", "Column", "find_time", "find_times",
    "is_called_time", "is_no_time_unit", "name_and_unit", "names_and_units", "occurrences", "plan_columns",
    "split_unit",
]  # fmt: skip

SUFFIXES = {
    "_mV_per_V": "mV/V", "_V_per_V": "V/V", "_microstrain": "microstrain", "_ustrain": "microstrain",
    "_um_m": "µm/m", "_mm_m": "mm/m",
    "_mm_s2": "mm/s^2", "_m_s2": "m/s^2", "_rad_s2": "rad/s^2", "_deg_s2": "deg/s^2",
    "_mm_s": "mm/s", "_m_s": "m/s", "_km_h": "km/h", "_rad_s": "rad/s", "_deg_s": "deg/s", "_rpm": "rpm",
    "_rad": "rad", "_deg": "deg", "_mm": "mm", "_cm": "cm", "_mg": "mg",
    "_MNm": "MN*m", "_kNm": "kN*m", "_Nm": "N*m", "_MN": "MN", "_kN": "kN", "_MW": "MW", "_kW": "kW",
    "_W": "W", "_N": "N", "_g": "g", "_m": "m", "_s": "s",
}  # fmt: skip
"""Units that may end a column's name when it has none in brackets; longer ones first, capitals matter.

A single letter may mean something else (``tower_acceleration_W`` stands in the west): it counts only where it does not
contradict the quantity that the name says; ``_N`` and ``_m`` count only where they are of that quantity.
"""

DATE_NAMES = ("date", "datum", "dato", "fecha", "data", "day")
"""Names of a column with the date, in any case, where the next one is called as a time is."""

TIME_NAMES = (
    "time", "t", "timestamp", "datetime", "date time", "date/time", "date_time", "time stamp", "time_stamp", "elapsed",
    "elapsed time", "elapsed_time", "zeit", "zeitstempel", "tid", "uhrzeit", "hora", "temps", "tiempo",
    "date and time", "local time", "datum", "date", "datum/uhrzeit", "datum/zeit", "datum uhrzeit",
    "datum und uhrzeit", "fecha y hora", "fecha/hora", "fecha hora",
)  # fmt: skip
"""Names of a time column, in any case."""

_FINE_UNITS = "s|sec|secs|seconds|ms|msec|millis|milliseconds|us|µs|usec|micros|microseconds|ns|nanos|nanoseconds"
_COARSE_UNITS = "min|mins|minutes|h|hours|d|days"
_TIME_WITH_UNIT = re.compile(
    rf"(?P<name>{'|'.join(TIME_NAMES)})[ _.-]+(?:in[ _])?(?P<unit>{_FINE_UNITS}|(?<!^t.)(?:{_COARSE_UNITS}))",
    re.IGNORECASE,
)
_CAMEL_TIME = re.compile(r"(?P<name>[Tt]ime|[Tt]imestamp)(?P<unit>Ms|Us|Ns|Sec|Seconds|Millis|Milliseconds|Micros)")
"""Names that end in a unit of time: ``time_ms``, ``t_us``, ``timestamp_ns``, ``Time in ms``, ``timeMs``. ``t_min`` and
``t_d`` are left out: they may be other quantities."""

COUNTER_NAMES = ("count", "counter", "sample", "samples", "index", "scan", "record", "row", "no", "no.", "nr", "n", "#")
"""Names of a column that counts samples, in any case; with the mapping's `rate` such a column is the time."""


@dataclass(frozen=True)
class Cell:
    """One column as the file describes it: the cell as written, its name, and its unit as far as it says one."""

    written: str
    name: str
    unit: str | None = None


@dataclass(frozen=True)
class Column:
    """One channel of the record: column `index` of the file times `factor`, in the SI unit `unit`."""

    index: int
    name: str
    unit: str
    factor: float = 1.0

    def values(self, raw: Array) -> Array:
        """The values in SI, bit for bit the file's own where nothing is to be converted."""
        if self.factor in (1.0, -1.0):
            return raw if self.factor == 1.0 else -raw
        with np.errstate(all="ignore"):  # a damaged number; infinity is named by whoever checks the rows
            return raw * self.factor


def names_and_units(columns: Sequence[Column]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names and the units of channels, each (m,)."""
    return tuple(column.name for column in columns), tuple(column.unit for column in columns)


def split_unit(written: str) -> Cell:
    """Split a header cell into a name and a unit: the one in brackets, or the one at the end of a time's name.

    A name that ends like a time in a unit of another quantity is no time: ``T_s [degC]`` is a temperature.

    Raises
    ------
    RecordError
        If a time has two units.
    """
    bracketed = re.fullmatch(r"(.*\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\))", written)
    if not bracketed:
        return Cell(written, *_time_and_unit(written))
    name, unit = bracketed[1], bracketed[2] if bracketed[2] is not None else bracketed[3]
    bare, said = _time_and_unit(name)
    if said is not None and said != _spelt(unit):
        if is_no_time_unit(unit):
            return Cell(written, name, unit)
        raise RecordError(f"column '{written[:40]}' is in {said} and in {unit[:40]}; expected one unit; correct either")
    return Cell(written, bare, unit)


def _time_and_unit(name: str) -> tuple[str, str | None]:
    """Split the name of a time into the name and the unit at its end; any other name stays whole, without a unit."""
    found = _TIME_WITH_UNIT.fullmatch(name) or _CAMEL_TIME.fullmatch(name)
    return (found["name"], _spelt(found["unit"])) if found else (name, None)


def _spelt(unit: str) -> str | None:
    """Canonical spelling of a unit of time, in any case of its letters; None for any other text."""
    for text in (unit, unit.lower()):
        with contextlib.suppress(ConfigurationError):
            return canonical(text) if si_unit(text) == "s" else None
    return None


def is_no_time_unit(unit: str) -> bool:
    """Test whether a text is a known unit of another quantity than time."""
    try:
        return si_unit(unit) not in ("s", "1")
    except ConfigurationError:
        return False


def is_called_time(name: str) -> bool:
    """Test whether a column has the name of a time, with or without a unit at its end."""
    return _time_and_unit(name)[0].lower() in TIME_NAMES


def name_and_unit(written: str) -> Cell:
    """A header cell with its unit, from brackets or from its ending."""
    cell = split_unit(written)
    if cell.unit is None:
        for suffix, unit in SUFFIXES.items():
            if written.endswith(suffix) and written != suffix:
                name = written.removesuffix(suffix)
                return Cell(written, name, unit) if _is_meant(name, suffix, unit) else cell
    return cell


def _is_meant(name: str, suffix: str, unit: str) -> bool:
    """Test whether the ending of a name is a unit, and not a letter that means something else."""
    if len(suffix) > 2:
        return True
    quantity = implied_unit(name)
    return suffix not in ("_N", "_m") if quantity is None else is_same_quantity(unit, quantity)


def find_times(cells: Sequence[Cell], mapping: Mapping) -> tuple[int, ...]:
    """Find the columns of the time: two where date and time of day are separate columns.

    Where the mapping gives the rate, the first column counts only if it has the name of a time or of a counter.

    Raises
    ------
    RecordError, ConfigurationError
        As `find_time`.
    """
    wanted = mapping.time.column
    if isinstance(wanted, tuple):
        return tuple(find_time(cells, replace(mapping, time=replace(mapping.time, column=name))) for name in wanted)
    first, second = [*(cell.name.lower() for cell in cells[:2]), "", ""][:2]
    if wanted is None and first in DATE_NAMES and is_called_time(second):
        return 0, 1
    if wanted is None and mapping.time.rate is not None:
        return (0,) if cells and (is_called_time(cells[0].name) or first in COUNTER_NAMES) else ()
    return (find_time(cells, mapping),)


def find_time(cells: Sequence[Cell], mapping: Mapping) -> int:
    """The column of the time: the one the mapping names, otherwise the first, if it is called so.

    Raises
    ------
    RecordError
        If neither says which.
    """
    wanted = mapping.time.column
    if isinstance(wanted, tuple):
        raise ConfigurationError(
            f"{mapping.place}: time.column: date and time in two columns are read from text only; give one column"
        )
    if wanted is not None:
        found = [i for i, cell in enumerate(cells) if wanted in (cell.written, cell.name)]
        if len(found) != 1:
            raise ConfigurationError(
                f"{mapping.place}: time.column: the record has {len(found)} columns '{wanted}', expected one: "
                f"{_hint(wanted, cells)}"
            )
        return found[0]
    if not cells or not is_called_time(cells[0].name):
        first = cells[0].written if cells else ""
        raise UnknownTimeError(
            f"the first column is '{first[:40]}', expected 'time [s]'; put the time first, or write [time] column"
            " into a mapping file, or [time] rate where none is a time"
        )
    return 0


def plan_columns(
    cells: Sequence[Cell],
    time: int | tuple[int, ...] | None,
    mapping: Mapping,
    some: Callable[[int], Array],
    how: str,
) -> tuple[Column, ...]:
    """Columns that become channels.

    Parameters
    ----------
    cells : sequence of Cell
    time : int, tuple of int or None
        Index of the time column, or of several, None if it is not among them.
    mapping : Mapping
    some : callable
        Some values (n,) of a column, by its index; requested only where a unit is missing.
    how : str
        How a user writes a unit in this format; ``{}`` stands for the name and the unit.

    Raises
    ------
    ConfigurationError
        If the mapping lists a column that is not there.
    RecordError
        If a unit is missing or unknown, a name is none or given twice, or nothing is left.
    """
    times = time if isinstance(time, tuple) else (time,)
    keys = [(*more, cell.written, cell.name) for cell, more in zip(cells, occurrences(cells), strict=True)]
    _check_listed(keys, times, mapping, cells)
    rules = _rules(keys, times, mapping)
    columns = tuple(_column(index, cells[index], rule) for index, rule in rules.items())
    unsaid = [one for one in columns if not (cells[one.index].unit or rules[one.index].unit) and implied_unit(one.name)]
    if unsaid:
        advice = f"{how}, or in a mapping (windsysid start asks and writes it)"
        raise RecordError(missing_units([(one.name, some(one.index)) for one in unsaid], advice))
    _check_names(columns, rules)
    return columns


def _check_listed(
    keys: Sequence[tuple[str, ...]], times: tuple[int | None, ...], mapping: Mapping, cells: Sequence[Cell]
) -> None:
    """Refuse a mapping that lists a column that the file does not have."""
    for key in mapping.channels:
        if not any(matches(key, *names) for i, names in enumerate(keys) if i not in times):
            raise ConfigurationError(
                f'{mapping.place}: channels."{key}": the record has no such column: {_hint(key, cells)}'
            )


def _rules(keys: Sequence[tuple[str, ...]], times: tuple[int | None, ...], mapping: Mapping) -> dict[int, ChannelRule]:
    """Mapping of each column that becomes a channel, by its index."""
    found = {i: mapping.rule_of(*names) for i, names in enumerate(keys) if i not in times}
    rules = {i: rule or ChannelRule() for i, rule in found.items() if rule or not mapping.only_listed}
    if not rules and mapping.only_listed:
        raise ConfigurationError(
            f"{mapping.place}: lists no channel of the record, and only_listed = true leaves out the others; list one"
        )
    if not rules:
        raise RecordError("holds no channel but the time; expected at least one")
    return rules


def _check_names(columns: Sequence[Column], rules: dict[int, ChannelRule]) -> None:
    """Refuse names that are none, and names that a mapping repeats; `without_repeats` compares those of the file."""
    names = [column.name for column in columns]
    renamed = [column.name for column in columns if rules[column.index].name]
    check_channels(names if any(names.count(name) > 1 for name in renamed) else dict.fromkeys(names))


def occurrences(cells: Sequence[Cell]) -> list[tuple[str, ...]]:
    """List the keys of each cell, ``name#2`` for the second column of a name; none where the name occurs once."""
    counts, seen = Counter(cell.name for cell in cells), Counter[str]()
    keys: list[tuple[str, ...]] = []
    for cell in cells:
        seen[cell.name] += 1
        number = seen[cell.name]
        keys.append((f"{cell.name}#{number}", f"{cell.written}#{number}") if counts[cell.name] > 1 else ())
    return keys


def _column(index: int, cell: Cell, rule: ChannelRule) -> Column:
    name = rule.name or (cell.written if cell.name == "time" else cell.name)  # another time than the record's own
    unit = rule.unit or cell.unit or AS_IT_IS
    if unit == AS_IT_IS:
        return Column(index, name, AS_WRITTEN + (cell.unit or "unknown"), rule.scale)
    if unit.startswith(AS_WRITTEN):
        return Column(index, name, unit, rule.scale)
    try:
        check_quantity(name, unit)
        return Column(index, name, si_unit(unit), to_si(1.0, unit) * rule.scale)
    except ConfigurationError as error:
        raise RecordError(
            f"column '{cell.written}': {error}, give another in the mapping file, or unit = \"{AS_IT_IS}\" there to "
            "keep the values unconverted"
        ) from error


def _hint(wanted: str, cells: Sequence[Cell]) -> str:
    names = [cell.name for cell in cells]
    close = difflib.get_close_matches(wanted, names, n=3)
    more = f" and {len(names) - 12} more" if len(names) > 12 else ""
    return f"did you mean {', '.join(close)}?" if close else f"it has {', '.join(names[:12])}{more}"

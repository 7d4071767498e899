"""Mapping file: properties of a record that its file does not give, written once by a user.

    [time]
    column = "Zeit"
    format = "%d.%m.%Y %H:%M:%S.%f"
    zone = "Europe/Stockholm"

    [csv]
    delimiter = ";"
    decimal = ","
    encoding = "latin-1"
    header_row = 3

    [channels."Acc_X_nacelle"]
    name = "tower_x_acceleration"
    unit = "g"
    sign = -1

Channels that are not listed keep their names, unless ``only_listed = true`` drops them. ``docs/records.md``
tells every key.
"""

import fnmatch
import math
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Literal

from windsysid.configuration import read_tables
from windsysid.errors import ConfigurationError
from windsysid.records.formats.text.text import decoded
from windsysid.records.moments import tidy
from windsysid.units import canonical, si_unit

__all__ = ["AS_IT_IS", "NAMED_FORMATS", "ChannelRule", "CsvRule", "Mapping", "TimeRule", "load_mapping", "matches"]

AS_IT_IS = "as written"
"""The unit of a channel whose values are to be left alone."""

NAMED_FORMATS = ("iso", "excel", "matlab", "unix", "labview")
"""Formats of time that are no strptime patterns; the last four count days, days, seconds and seconds."""


_PYTHON_ENCODINGS = ("idna", "mbcs", "oem", "punycode", "raw-unicode-escape", "undefined", "unicode-escape")
"""Encodings of Python's own that are not for text files (documentation of codecs, "Python Specific Encodings")."""


class _Strict:
    __pydantic_config__ = {"extra": "forbid", "strict": False}  # noqa: RUF012 - read by pydantic from the class


@dataclass(frozen=True)
class TimeRule(_Strict):
    """Column and unit of the time.

    Attributes
    ----------
    column
        Name of the time column; in text two names, of the columns with the date and the time of day.
    rate
        Sampling rate [Hz] of a file without a time column, or whose time column has no unit or counts samples: sample k
        is at k/rate. If the column has a regular step, rows that are missing in it become gaps.
    unit
        Unit of a time that is a number: ``s``, ``ms``, ``min``, ``h``, ``d``.
    format
        ``iso``, ``excel``, ``matlab``, ``unix``, ``labview``, or a strptime pattern.
    zone
        Zone of times that carry none, as in ``Europe/Stockholm``.
    start
        The moment of time 0 in ISO 8601, for a file that does not say it.
    """

    column: str | tuple[str, str] | None = None
    unit: str | None = None
    format: str | None = None
    zone: str | None = None
    start: str | datetime | None = None
    rate: float | None = None

    def __post_init__(self) -> None:
        if self.rate is not None and not 0.0 < self.rate < math.inf:
            raise ValueError(f"rate {self.rate} is not a number of samples per second above 0")
        if self.rate is not None and (self.unit, self.format) != (None, None):
            raise ValueError(
                "rate is for files without a time, or whose time has no unit; remove it, or unit and format"
            )
        if self.unit is not None and si_unit(self.unit) != "s":
            raise ValueError(f"unit '{self.unit}' is not a unit of time, expected s, ms, min, h or d")
        if self.format is not None and self.format not in NAMED_FORMATS:
            _check_pattern(self.format)
        if self.start is not None:
            object.__setattr__(self, "start", _checked_start(self.start))
        if self.zone is not None:
            _check_zone(self.zone)


@dataclass(frozen=True)
class CsvRule(_Strict):
    """Format of a text file, as far as it cannot be detected.

    Attributes
    ----------
    delimiter
        ``,`` ``;`` a tab, or a blank for runs of blanks.
    decimal
        ``.`` or ``,``.
    encoding
        As Python names it.
    header_row
        Number of the line with the names, counted from 1; 0 for none.
    unit_row
        Number of the line with the units; 0 for none.
    missing
        More cells that mean that a value is missing, such as ``-9999``.
    """

    delimiter: Literal[",", ";", "\t", " "] | None = None
    decimal: Literal[".", ","] | None = None
    encoding: str | None = None
    header_row: int | None = None
    unit_row: int | None = None
    missing: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.delimiter is not None and self.delimiter == self.decimal:
            raise ValueError("delimiter and decimal are the same, expected two")
        if self.encoding is not None:
            _check_encoding(self.encoding)
        if min(self.header_row or 0, self.unit_row or 0) < 0:
            raise ValueError("header_row and unit_row are line numbers, counted from 1")


@dataclass(frozen=True)
class ChannelRule(_Strict):
    """Meaning of one column.

    Attributes
    ----------
    name
        Its name in the record.
    unit
        Its unit in the file, or ``as written`` to leave the values alone.
    sign
        1 or -1.
    factor
        What the file's values are multiplied by to be in `unit`.
    """

    name: str | None = None
    unit: str | None = None
    sign: Literal[1, -1] = 1
    factor: float = 1.0

    def __post_init__(self) -> None:
        if self.unit is not None and self.unit != AS_IT_IS:
            canonical(self.unit)
        if not math.isfinite(self.factor) or self.factor == 0.0:
            raise ValueError(f"factor {self.factor} is not a number other than 0")

    @property
    def scale(self) -> float:
        """Sign times factor."""
        return self.sign * self.factor


@dataclass(frozen=True)
class Mapping(_Strict):
    """A whole mapping file; the empty one changes nothing.

    Attributes
    ----------
    time, csv, channels
        Its tables.
    only_listed
        Whether columns that `channels` does not list are dropped.
    place
        Name of the file, for messages.
    """

    time: TimeRule = field(default_factory=TimeRule)
    csv: CsvRule = field(default_factory=CsvRule)
    channels: dict[str, ChannelRule] = field(default_factory=dict)
    only_listed: bool = False
    place: str = "mapping"

    def __post_init__(self) -> None:
        for key, rule in self.channels.items():
            if "*" in key and rule.name is not None:
                raise ValueError(f'channels."{key}": a pattern gives many channels one name; remove the name')

    def rule_of(self, *names: str) -> ChannelRule | None:
        """The rule of a column that is called so: that of one of its names, else of the first pattern (``*``)."""
        exact = next((self.channels[name] for name in names if name in self.channels), None)
        if exact is not None:
            return exact
        return next((rule for key, rule in self.channels.items() if matches(key, *names)), None)


def _checked_start(start: str | datetime) -> str:
    try:
        return tidy(start if isinstance(start, str) else start.isoformat())
    except ValueError as error:
        raise ValueError(f"start: {error}") from None


def _check_zone(zone: str) -> None:
    import zoneinfo

    try:
        zoneinfo.ZoneInfo(zone)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError):
        raise ValueError(f"unknown zone '{zone}', expected one like 'UTC' or 'Europe/Stockholm'") from None


def _check_pattern(pattern: str) -> None:
    """Raise a ValueError with the reason if pandas cannot use a pattern for any text."""
    import pandas as pd

    if "%" not in pattern:
        raise ValueError(
            f"format '{pattern}' is neither a pattern such as '%d.%m.%Y %H:%M:%S' nor one of {', '.join(NAMED_FORMATS)}"
        )
    if "%Z" in pattern.replace("%%", ""):
        raise ValueError(
            f"format '{pattern[:40]}': names of zones (%Z) are not read; write the name itself into the format, and"
            " [time] zone, as in 'Europe/Stockholm'"
        )
    try:
        pd.to_datetime(pd.Series(["x"], dtype="object"), format=pattern, errors="coerce", utc=True)
    except Exception as error:  # a ValueError, or what `re` raises where a field stands twice
        reason = " ".join(str(error).split())[:80]
        raise ValueError(f"format '{pattern[:40]}' is no pattern of date and time: {reason}") from None


def _check_encoding(name: str) -> None:
    """Raise a ValueError for a name that is no encoding of text files."""
    import codecs

    try:
        own = codecs.lookup(name).name in _PYTHON_ENCODINGS
        codecs.getincrementaldecoder(name)
        if own or "a".encode(name).decode(name, errors="replace") != "a":
            raise ValueError
    except (LookupError, ValueError):
        raise ValueError(f"unknown encoding '{name[:40]}', expected one like 'utf-8' or 'cp1252'") from None


def matches(key: str, *names: str) -> bool:
    """Test whether a key of ``[channels]`` means a column with these names: one of them, or a pattern such as
    ``Acc*``."""
    return key in names or ("*" in key and any(fnmatch.fnmatchcase(name, key.replace("[", "[[]")) for name in names))


def load_mapping(path: str | Path) -> Mapping:
    """Read a mapping file: names, units and signs of the channels of a logger's files, and where their time is.

    Parameters
    ----------
    path : str or Path
        TOML file; `windsysid.records.formats.contents.mapping` and docs/records.md list its keys.

    Returns
    -------
    Mapping
        The rules for time, names, units and signs.

    Raises
    ------
    ConfigurationError
        If the file is missing, no TOML, or has an unknown key or a wrong value; the message names the key.

    See Also
    --------
    read_record : Read a record by a mapping.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> path = Path(tempfile.mkdtemp()) / "logger.toml"
    >>> _ = path.write_text('channels."Acc X" = {name = "tower_x_acceleration", unit = "g", sign = -1}')
    >>> ws.load_mapping(path).channels["Acc X"]
    ChannelRule(name='tower_x_acceleration', unit='g', sign=-1, factor=1.0)
    """
    from pydantic import TypeAdapter, ValidationError

    from windsysid.mechanics.sensor_lists import first_problem

    path = Path(path)
    data = read_tables(path, "a mapping", decoded)
    if "place" in data:
        raise ConfigurationError(f"{path}: unknown key 'place': remove it or correct its spelling")
    try:
        return TypeAdapter(Mapping).validate_python({**data, "place": str(path)})
    except ValidationError as error:
        for detail in error.errors():
            if detail["type"] == "unexpected_keyword_argument":
                key = ".".join(map(str, detail["loc"]))
                raise ConfigurationError(f"{path}: unknown key '{key}': remove it or correct its spelling") from error
        raise ConfigurationError(f"{path}: {first_problem(error)}") from error

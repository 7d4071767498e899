"""SCADA statistics joined to records: values of the turbine's controller for the minutes of a record.

A SCADA file is read as any record is (docs/records.md), with a mapping of its own where its columns have other names.
A line counts from its time on, until the next usual one. A record has the mean of the lines that it overlaps, each by
the length of the overlap; the state is that of the longest overlap.
"""

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.records.formats import read_record
from windsysid.records.moments import moment

__all__ = ["SCADA_COLUMNS", "Scada", "read_scada"]

SCADA_COLUMNS: dict[str, tuple[str, tuple[str, ...]]] = {
    "wind_speed": ("m/s", ("wind_speed",)),
    "power": ("W", ("power",)),
    "pitch": ("rad", ("pitch", "blade_1_pitch", "blade_pitch")),
    "temperature": ("degC", ("temperature", "air_temperature")),
    "yaw": ("rad", ("nacelle_yaw",)),
    "rotor_speed": ("rad/s", ("rotor_speed",)),
    "state": ("", ("turbine_state", "state")),
}
"""Quantity of SCADA that is kept: its unit (none for a code), and the channels that may hold it."""

MAX_ZONE_SECONDS = 86400.0
"""[s] that a local clock is off UTC at most, with time to spare."""

MIN_COVERED_SHARE = 0.5
"""Share of a record that SCADA must cover to say anything of it."""


class Scada(NamedTuple):
    """SCADA statistics of one turbine.

    Attributes
    ----------
    begin
        The moment of time 0.
    time
        (T,) [s], when each line begins.
    period
        [s] that a line holds for.
    columns
        (T,) of each of `SCADA_COLUMNS` that the file has.
    """

    begin: datetime
    time: Array
    period: float
    columns: dict[str, Array]

    def holds(self, start: datetime, seconds: float) -> bool:
        """Test whether its lines span `seconds` from `start` on, whatever is missing between."""
        low = (start - self.begin) / timedelta(seconds=1)
        return bool(self.time[0] <= low and low + seconds <= self.time[-1] + self.period)

    def is_near(self, start: datetime | None, seconds: float | None) -> bool:
        """Test whether `seconds` from `start` on, a date without a zone, may be in the time of its lines.

        UTC where a zone is known: clocks of unknown zone differ by less than `MAX_ZONE_SECONDS`.
        """
        if start is None or seconds is None:
            return False
        zone = self.begin.tzinfo
        begin = self.begin if zone is None else self.begin.astimezone(UTC).replace(tzinfo=None)
        low = (start - begin) / timedelta(seconds=1)
        last = self.time[-1] + self.period + MAX_ZONE_SECONDS
        return bool(self.time[0] - MAX_ZONE_SECONDS <= low + seconds and low <= last)

    def during(self, start: datetime, seconds: float) -> dict[str, float]:
        """Statistics of `seconds` from `start` on, by name; a name is left out if too little is known.

        Raises
        ------
        ConfigurationError
            If one of SCADA and record says its zone and the other does not.
        """
        if (start.tzinfo is None) != (self.begin.tzinfo is None):
            one, other = ("SCADA", "the record") if start.tzinfo is None else ("the record", "SCADA")
            raise ConfigurationError(f"{one} says its zone and {other} does not: give [time] zone in the mapping file")
        low = (start - self.begin) / timedelta(seconds=1)
        first = max(int(np.searchsorted(self.time, low - self.period, side="right")) - 1, 0)
        last = int(np.searchsorted(self.time, low + seconds, side="left"))
        begins = self.time[first:last]
        overlap = np.minimum(begins + self.period, low + seconds) - np.maximum(begins, low)
        found: dict[str, float] = {}
        for name, column in self.columns.items():
            values = column[first:last]
            there = np.isfinite(values) & (overlap > 0.0)
            if overlap[there].sum() < MIN_COVERED_SHARE * seconds or not there.any():
                continue
            found[name] = _mean(name, values[there], overlap[there])
        return found


def _mean(name: str, values: Array, weight: Array) -> float:
    if name == "state":
        return float(max(set(values.tolist()), key=lambda code: weight[values == code].sum()))
    if name == "yaw":
        return float(np.angle(weight @ np.exp(1j * values)) % (2.0 * np.pi))
    return float(weight @ values / weight.sum())


def read_scada(path: str | Path, mapping: str | Path | None = None) -> Scada:
    """SCADA statistics from a file.

    Raises
    ------
    RecordError
        If the file cannot be read.
    ConfigurationError
        If it does not say when it begins, has none of `SCADA_COLUMNS`, or one of them in another unit.
    """
    record = read_record(path, mapping=mapping)
    if record.start is None:
        raise ConfigurationError(f"SCADA {path}: its times are no dates: give [time] start in its mapping file")
    columns: dict[str, Array] = {}
    for name, (unit, channels) in SCADA_COLUMNS.items():
        channel = next((one for one in channels if one in record), None)
        if channel is None:
            continue
        if unit and record.unit(channel) != unit:
            raise ConfigurationError(
                f"SCADA {path}: column '{channel}': expected {unit}, got {record.unit(channel)}: say its unit in a"
                " mapping file"
            )
        columns[name] = record[channel]
    if not columns:
        wanted = ", ".join(channels[0] for _, channels in SCADA_COLUMNS.values())
        raise ConfigurationError(f"SCADA {path}: expected one of {wanted}, got none: name them in a mapping file")
    return Scada(moment(record.start), record.time, float(np.median(np.diff(record.time))), columns)

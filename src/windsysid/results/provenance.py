"""Provenance of a result: record, turbine, sensors, options, version and date."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from windsysid._version import __version__
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.turbine.tables import as_tables
from windsysid.turbine.turbine import Turbine

if TYPE_CHECKING:
    from windsysid.records.formats.contents.mapping import Mapping as FileMapping

__all__ = ["Provenance", "RecordHash", "mapping_tables", "record_hash", "sensor_tables", "trace", "turbine_hash"]

_ROWS = 1 << 16
"""Setting: number of rows that are hashed at once."""


@dataclass(frozen=True)
class Provenance:
    """Provenance of a result: record, turbine, sensors, options, version and date.

    Attributes
    ----------
    windsysid
        Version.
    identified
        Date in UTC, ISO 8601.
    start
        Date of the record's time 0, as `windsysid.records.record.Record.start`.
    record_hash
        `record_hash` of the whole record, before a section was taken of it.
    turbine_hash
        `turbine_hash` of the turbine as it was given.
    sensors
        The sensor list that was used, each sensor as the table of its file without default values.
    options
        Arguments of `windsysid.identify`, and those of the command line: file, mapping, added noise, length of pieces.
    """

    windsysid: str
    identified: str
    start: str | None
    record_hash: str
    turbine_hash: str
    sensors: tuple[Mapping[str, Any], ...]
    options: Mapping[str, Any]

    def with_options(self, **more: Any) -> "Provenance":
        """Provenance with more options; those that are None are left out."""
        told = {name: value for name, value in more.items() if value is not None}
        return replace(self, options={**self.options, **told})

    def summary(self) -> dict[str, Any]:
        """As plain values."""
        return {field.name: getattr(self, field.name) for field in fields(self)} | {"sensors": list(self.sensors)}


class RecordHash:
    """SHA-256 of a record that comes in pieces: the same however it is cut.

    Hashed are names and units of channels, then times and values in SI, row by row as little-endian float64. So a
    record has one hash in whatever format it is stored, as long as the format keeps every bit.
    """

    def __init__(self) -> None:
        self._sha: Any = None

    def take(self, piece: Record) -> None:
        """The next samples."""
        if self._sha is None:
            self._sha = hashlib.sha256(json.dumps([piece.channels, piece.units]).encode())
        for low in range(0, piece.samples, _ROWS):
            part = slice(low, low + _ROWS)
            rows = np.column_stack([piece.time[part], piece.values[part]]).astype("<f8", copy=False)
            rows[np.isnan(rows)] = np.nan  # NaN has many bit patterns
            self._sha.update(np.ascontiguousarray(rows))

    def __str__(self) -> str:
        """Of all that was taken so far: ``sha256:`` and 64 digits."""
        return f"sha256:{'' if self._sha is None else self._sha.hexdigest()}"


def record_hash(record: Record) -> str:
    """SHA-256 of the content of a record, whatever its file, see `RecordHash`."""
    found = RecordHash()
    found.take(record)
    return str(found)


def turbine_hash(turbine: Turbine) -> str:
    """SHA-256 of a turbine's whole file as `windsysid.turbine.file.write_turbine` writes it."""
    import tomli_w

    return f"sha256:{hashlib.sha256(tomli_w.dumps(as_tables(turbine)).encode()).hexdigest()}"


def sensor_tables(sensors: Sequence[Sensor]) -> tuple[dict[str, Any], ...]:
    """Sensors as the tables of their file, without defaults."""
    return tuple(sensor.model_dump(exclude_defaults=True) for sensor in sensors)


def mapping_tables(mapping: "FileMapping | None") -> dict[str, Any] | None:
    """A mapping as the tables of its file, without defaults; None for none."""
    return None if mapping is None else _omit_empty(asdict(mapping))


def trace(
    record: Record, found: str, turbine: Turbine, sensors: Sequence[Sensor], options: Mapping[str, Any]
) -> Provenance:
    """Provenance of a new result from `record`, whose `record_hash` is `found`."""
    return Provenance(
        windsysid=__version__,
        identified=datetime.now(UTC).isoformat(timespec="seconds").replace("+00:00", "Z"),
        start=record.start,
        record_hash=found,
        turbine_hash=turbine_hash(turbine),
        sensors=sensor_tables(sensors),
        options=dict(options),
    )


def _omit_empty(tables: Mapping[str, Any]) -> dict[str, Any]:
    plain = {key: _omit_empty(value) if isinstance(value, dict) else value for key, value in tables.items()}
    return {key: list(v) if isinstance(v, tuple) else v for key, v in plain.items() if v not in (None, {}, (), False)}

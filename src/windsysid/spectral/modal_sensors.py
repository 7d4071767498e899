"""Sensors of operational modal analysis: which channels, what they read, where they sit and where they point."""

from collections.abc import Container, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.inspection.channels import VIBRATION, kind_of
from windsysid.mechanics.sensor_lists import first_problem, parse_sensors, read_sensor_tables
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record

__all__ = ["ModalSensor", "choose_sensors", "derivative_order", "read_modal_sensors"]

MOST_SENSORS = 60

Quantity = Literal["acceleration", "velocity", "displacement", "strain", "load"]

_ORDERS = {"acceleration": 2, "velocity": 1, "displacement": 0, "strain": 0, "load": 0}


class ModalSensor(BaseModel):
    """One channel whose vibration is analysed.

    Attributes
    ----------
    channel
        Name of the record's channel.
    quantity
        What it reads; told by the channel's unit and name where it is not given.
    position
        Where it sits [m], for drawing; None where that is not known.
    direction
        Where it points [1]; of any length.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    channel: str = Field(min_length=1)
    quantity: Quantity | None = None
    position: tuple[float, float, float] | None = None
    direction: tuple[float, float, float] | None = None

    @field_validator("direction")
    @classmethod
    def _points_somewhere(cls, value: tuple[float, float, float] | None) -> tuple[float, float, float] | None:
        if value is not None and not any(value):
            raise ValueError("expected a direction that points somewhere")
        return value


def read_modal_sensors(path: str | Path) -> tuple[ModalSensor, ...]:
    """Read a sensor list from TOML: one ``[[sensor]]`` table per channel, keys as in `ModalSensor`, or a turbine's
    sensor list.

    Raises
    ------
    ConfigurationError
        In one line: the file, the sensor, what was expected and what was got.
    """
    tables = read_sensor_tables(path)
    if not tables:
        raise ConfigurationError(f"{path}: expected [[sensor]] tables, one per channel, got none")
    if any(isinstance(table, dict) and "point" in table for table in tables):
        return as_modal(parse_sensors(tables, str(path)))
    sensors = []
    for number, table in enumerate(tables, start=1):
        try:
            sensors.append(ModalSensor.model_validate(table))
        except ValidationError as error:
            raise ConfigurationError(f"{path}: sensor {number}: {first_problem(error)}") from None
    return tuple(sensors)


def as_modal(sensors: Sequence[Sensor | ModalSensor | str]) -> tuple[ModalSensor, ...]:
    """Sensors from a turbine's, from channel names, or as they are."""
    kinds: dict[str, Quantity] = {"acceleration": "acceleration", "velocity": "velocity", "angular_rate": "velocity",
        "displacement": "displacement", "moment": "load", "strain": "strain"}  # fmt: skip
    found = []
    for sensor in sensors:
        if isinstance(sensor, str):
            found.append(ModalSensor(channel=sensor))
        elif isinstance(sensor, Sensor):
            found.append(ModalSensor(channel=sensor.channel, quantity=kinds[sensor.quantity]))
        else:
            found.append(sensor)
    return tuple(found)


def choose_sensors(record: Record, sensors: Sequence[Sensor | ModalSensor | str] | None) -> tuple[ModalSensor, ...]:
    """The sensors that were asked for, or the record's: its accelerometers, or else its most telling kind of channels.

    Raises
    ------
    ConfigurationError
        If a channel is missing, listed twice or no vibration, or there is none.
    """
    if sensors is None:
        known = {name: kind_of(name, unit) for name, unit in zip(record.channels, record.units, strict=True)}
        live = {name: kind for name, kind in known.items() if _moves(record[name])}
        for kind in VIBRATION:
            names = [name for name, what in live.items() if what == kind and not _has_measured_twin(name, live)]
            if names:
                return tuple(ModalSensor(channel=name) for name in names[:MOST_SENSORS])
        still = [name for name, kind in known.items() if kind in VIBRATION and name not in live]
        if still:
            raise ConfigurationError(
                f"{record.name}: {', '.join(still[:3])}: constant or empty, which no structure is: expected vibration;"
                " check sensors and file"
            )
        raise ConfigurationError(
            f"{record.name}: expected channels that show vibration (acceleration, strain, load, displacement, "
            f"velocity), got none: list them (--sensors)"
        )
    found = as_modal(sensors)
    channels = [sensor.channel for sensor in found]
    for sensor in found:
        if sensor.channel not in record:
            raise ConfigurationError(
                f"{record.name}: no channel '{sensor.channel}': it has {', '.join(record.channels)[:100]}"
            )
        if channels.count(sensor.channel) > 1:
            raise ConfigurationError(
                f"channel '{sensor.channel}' is listed {channels.count(sensor.channel)} times: list it once"
            )
        derivative_order(sensor, record)
    return found


def derivative_order(sensor: ModalSensor, record: Record) -> int:
    """How often what a sensor reads is derived by time: acceleration 2, velocity 1, displacement, strain and load 0.

    Raises
    ------
    ConfigurationError
        If neither the sensor nor its channel says.
    """
    kind = sensor.quantity or kind_of(sensor.channel, record.unit(sensor.channel))
    if kind not in _ORDERS:
        raise ConfigurationError(
            f"channel '{sensor.channel}' [{record.unit(sensor.channel)}]: expected a vibration; say in the sensor "
            f'list what it reads: quantity = "acceleration"'
        )
    return _ORDERS[kind]


def _has_measured_twin(channel: str, others: Container[str]) -> bool:
    """Whether a channel without gravity, which no accelerometer reads, stands next to the same one with gravity."""
    return channel.endswith("_kinematic") and channel.removesuffix("_kinematic") in others


def _moves(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return known.size > 2 and float(np.ptp(known)) > 1e-12 * float(np.abs(known).max())

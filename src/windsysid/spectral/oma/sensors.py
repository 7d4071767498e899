"""Sensors of operational modal analysis: which channels, what they read, where they sit and where they point."""

from collections.abc import Container, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from windsysid._types import Array
from windsysid.checks.dead_channel import is_constant
from windsysid.errors import ConfigurationError
from windsysid.inspection.bodies import body_of
from windsysid.inspection.channels import VIBRATION, kind_of
from windsysid.inspection.plausibility import rotor_of
from windsysid.mechanics.sensor_lists import first_problem, parse_sensors, read_sensor_tables
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.spectral.transforms.multiblade import is_blade

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


def choose_sensors(
    record: Record, sensors: Sequence[Sensor | ModalSensor | str] | None
) -> tuple[tuple[ModalSensor, ...], tuple[str, ...]]:
    """Choose the listed sensors, or those of the structure: accelerometers, or else the best kind of channels.

    Returns
    -------
    tuple of tuple of ModalSensor, and tuple of str
        Sensors, and notes on channels that were left out.

    Raises
    ------
    ConfigurationError
        If a channel is missing, listed twice or no vibration, or there is none.
    """
    if sensors is None:
        return _of_the_structure(record)
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
    return found, ()


def _of_the_structure(record: Record) -> tuple[tuple[ModalSensor, ...], tuple[str, ...]]:
    """Choose the channels of the best kind that measure the structure, with notes on channels of other bodies."""
    known = {name: kind_of(name, unit) for name, unit in zip(record.channels, record.units, strict=True)}
    shaking = [name for name, kind in known.items() if kind in VIBRATION and not _has_measured_twin(name, known)]
    live = [name for name in shaking if _moves(record[name])]
    media = [name for name in live if body_of(name) not in ("structure", "rotor")]
    blades = _turning_blades(record, [name for name in live if name not in media])
    for kind in VIBRATION:
        of_kind = [name for name in live if known[name] == kind]
        names = [name for name in of_kind if name not in media and name not in blades]
        if names:
            notes = _left_out(
                [name for name in blades if known[name] in VIBRATION[: VIBRATION.index(kind) + 1]],
                [name for name in media if name in of_kind],
            )
            return tuple(ModalSensor(channel=name) for name in names[:MOST_SENSORS]), notes
    still = [name for name in shaking if name not in live and body_of(name) in ("structure", "rotor")]
    if blades or not still:
        got = "got none" if not live else f"got only {_listed(live)} of blades, water, air or mooring lines"
        raise ConfigurationError(
            f"{record.name}: expected channels that show the structure's vibration (acceleration, strain, load, "
            f"displacement, velocity), {got}: list them (--sensors)"
        )
    raise ConfigurationError(
        f"{record.name}: {', '.join(still[:3])}: constant or empty; expected vibration; check sensors and file"
    )


def _turning_blades(record: Record, names: Sequence[str]) -> list[str]:
    """Channels of blades that cannot be transformed into the fixed frame.

    If the rotor turns, these are all without a name such as ``blade_1_…``; if it is unknown whether the rotor turns,
    all of them, unless the record has no other channels.
    """
    blades = [name for name in names if body_of(name) == "rotor"]
    rotor = rotor_of(record)
    if rotor is not None and rotor.turns:
        return [name for name in blades if not is_blade(name)]
    return blades if rotor is None and len(blades) < len(names) else []


def _left_out(blades: Sequence[str], media: Sequence[str]) -> tuple[str, ...]:
    """Write notes on channels that were left out."""
    notes = []
    if blades:
        notes.append(
            f"left out: {_listed(blades)}: modes of rotating blades appear at f ± 1P; name channels of all blades "
            "blade_1_… and record rotor_azimuth, or list them (--sensors)"
        )
    if media:
        notes.append(
            f"left out: {_listed(media)}: water, air or mooring lines, not the structure; list them to use them"
        )
    return tuple(notes)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


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
    """Whether the record has a simulated acceleration without gravity also with gravity, as sensors measure it."""
    return channel.endswith("_kinematic") and channel.removesuffix("_kinematic") in others


def _moves(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return known.size > 2 and not is_constant(known)

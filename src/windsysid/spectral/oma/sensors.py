"""Sensors of operational modal analysis: channels, physical quantities, positions and directions."""

from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from windsysid._types import Array
from windsysid.checks.dead_channel import is_constant
from windsysid.errors import ConfigurationError
from windsysid.inspection.bodies import body_of
from windsysid.inspection.channels import VIBRATION, Kind, kind_of
from windsysid.inspection.rotor import rotor_of
from windsysid.mechanics.sensor_lists import first_problem, parse_sensors, read_sensor_file
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import AS_WRITTEN, Record
from windsysid.spectral.oma.limits import MAX_SENSORS
from windsysid.spectral.transforms.multiblade import is_blade

__all__ = [
    "ModalSensor", "Node", "SensorList", "choose_sensors", "derivative_order", "geometry_of", "read_modal_sensors",
]  # fmt: skip

Quantity = Literal["acceleration", "velocity", "displacement", "strain", "load"]

_ORDERS = {"acceleration": 2, "velocity": 1, "displacement": 0, "strain": 0, "load": 0}
"""Setting: order of the time derivative of a displacement."""


Point = tuple[float, float, float]


class Node(BaseModel):
    """Point of the structure in drawings of shapes: its name, position [m], and the node whose motion it follows."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    name: str = Field(min_length=1)
    position: Point
    follows: str | None = None


class _Geometry(BaseModel):
    """Nodes and lines of a sensor list."""

    node: list[Node] = Field(default=[])
    lines: list[tuple[str, str]] = Field(default=[])


class SensorList(tuple["ModalSensor", ...]):
    """Sensors of a file, with the nodes of the structure and the pairs of their names that a line joins."""

    nodes: tuple[Node, ...]
    lines: tuple[tuple[str, str], ...]

    @classmethod
    def of(
        cls, sensors: "Sequence[ModalSensor]", nodes: Sequence[Node], lines: Sequence[tuple[str, str]]
    ) -> "SensorList":
        """Sensors with a geometry."""
        found = cls(sensors)
        found.nodes, found.lines = tuple(nodes), tuple(lines)
        return found


class ModalSensor(BaseModel):
    """Channel for operational modal analysis, with its position and direction for figures.

    Attributes
    ----------
    channel
        Name of the record's channel.
    quantity
        Physical quantity; by default that of the channel's unit and name.
    position
        Position [m], for figures; None if it is unknown.
    direction
        Direction [1]; of any length.

    Examples
    --------
    >>> import windsysid as ws
    >>> sensors = [
    ...     ws.models.ModalSensor(channel=f"tower_{axis}_acceleration", position=(0.0, 0.0, 90.0), direction=direction)
    ...     for axis, direction in (("x", (0.0, 1.0, 0.0)), ("z", (1.0, 0.0, 0.0)))
    ... ]
    >>> found = ws.oma(ws.simulate("tower", duration=600.0, rate=5.0, seed=1), sensors=sensors)
    >>> found.channels, round(found.modes[0].frequency.estimate, 3)
    (('tower_x_acceleration', 'tower_z_acceleration'), 0.315)
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
            raise ValueError("expected a direction other than zero")
        return value


def read_modal_sensors(path: str | Path) -> tuple[ModalSensor, ...]:
    """Read a sensor list from TOML: one ``[[sensor]]`` table per channel, keys as in `ModalSensor`, or a turbine's
    sensor list.

    ``[[node]]`` tables (`name`, `position`, and perhaps `follows`, another node) and ``lines`` (pairs of nodes) are the
    geometry for drawings; a sensor may then have ``node`` in place of ``position``.

    Raises
    ------
    ConfigurationError
        In one line: the file, the sensor, what was expected and what was got.
    """
    content = read_sensor_file(path, ("node", "lines"))
    tables = content["sensor"]
    nodes, lines = _geometry(content, str(path))
    if not tables:
        raise ConfigurationError(f"{path}: expected [[sensor]] tables, one per channel, got none")
    if any(isinstance(table, dict) and "point" in table for table in tables):
        return as_modal(parse_sensors(tables, str(path)))
    sensors = []
    for number, table in enumerate(tables, start=1):
        try:
            sensors.append(ModalSensor.model_validate(_at_node(table, nodes)))
        except ValidationError as error:
            raise ConfigurationError(f"{path}: sensor {number}: {first_problem(error)}") from None
        except ValueError as error:
            raise ConfigurationError(f"{path}: sensor {number}: {error}") from None
    return SensorList.of(sensors, nodes, lines)


def _geometry(content: Mapping[str, Any], source: str) -> tuple[list[Node], list[tuple[str, str]]]:
    """Nodes and lines of a sensor list."""
    try:
        found = _Geometry.model_validate({key: content[key] for key in ("node", "lines") if key in content})
    except ValidationError as error:
        raise ConfigurationError(f"{source}: {first_problem(error)}") from None
    _check_names(found, source)
    return found.node, found.lines


def _check_names(found: "_Geometry", source: str) -> None:
    """Refuse nodes that are named twice or not at all."""
    names = [node.name for node in found.node]
    named = [*(name for line in found.lines for name in line), *(node.follows or node.name for node in found.node)]
    wrong = [name for name in named if names.count(name) != 1]
    if wrong:
        raise ConfigurationError(
            f"{source}: expected one [[node]] of each name, got {names.count(wrong[0])} '{wrong[0]}'"
        )


def _at_node(table: Any, nodes: Sequence[Node]) -> Any:
    """Table of a sensor with the position of its node."""
    if not isinstance(table, dict) or "node" not in table:
        return table
    places = {node.name: node.position for node in nodes}
    if table["node"] not in places or "position" in table:
        raise ValueError(f"expected the name of a [[node]] and no position, got node = {table['node']!r:.60}")
    return {key: value for key, value in table.items() if key != "node"} | {"position": places[table["node"]]}


def geometry_of(sensors: Any) -> tuple[tuple[Node, ...], tuple[tuple[str, str], ...]]:
    """Nodes and lines of a sensor list, or of the lists of several records, each once."""
    lists = [one for one in [sensors, *(sensors or ())] if isinstance(one, SensorList)]
    nodes = {node.name: node for one in lists for node in one.nodes}
    return tuple(nodes.values()), tuple(dict.fromkeys(line for one in lists for line in one.lines))


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
    kinds = _vibration_kinds(record)
    live = [name for name in kinds if _moves(record[name])]
    media, blades = _other_bodies(record, live)
    usable = {name: kinds[name] for name in live if name not in (*media, *blades)}
    if not usable:
        raise _without_vibration(record, list(kinds), live, blades)
    best = min(usable.values(), key=VIBRATION.index)
    chosen = tuple(ModalSensor(channel=name) for name, kind in usable.items() if kind == best)
    return chosen[:MAX_SENSORS], _left_out(blades, media, kinds, best)


def _vibration_kinds(record: Record) -> dict[str, Kind]:
    """Kinds of the channels that measure vibration, without simulated twins of measured ones."""
    kinds = {name: kind_of(name, unit) for name, unit in zip(record.channels, record.units, strict=True)}
    return {n: kind for n, kind in kinds.items() if kind in VIBRATION and not _has_measured_twin(n, kinds)}


def _without_vibration(
    record: Record, vibration: Sequence[str], live: Sequence[str], blades: Sequence[str]
) -> ConfigurationError:
    """Error for a record without usable channels, of which some may be constant or of other bodies."""
    dead = [name for name in vibration if name not in live and body_of(name) in ("structure", "rotor")]
    if dead and not blades:
        return ConfigurationError(
            f"{record.name}: {', '.join(dead[:3])}: constant or empty; expected vibration; check sensors and file"
        )
    unitless = [name for name, unit in zip(record.channels, record.units, strict=True) if unit.startswith(AS_WRITTEN)]
    why = f" (windsysid start asks for the units of {_listed(unitless)})" if unitless else ""
    got = f"got only {_listed(live)} of blades, water, air or mooring lines" if live else f"got none{why}"
    return ConfigurationError(
        f"{record.name}: expected channels that show the structure's vibration (acceleration, strain, load, "
        f"displacement, velocity), {got}: list them (sensors=)"
    )


def _other_bodies(record: Record, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Channels of water, air and mooring lines, and those of rotating blades."""
    media = [name for name in names if body_of(name) not in ("structure", "rotor")]
    return media, _turning_blades(record, [name for name in names if name not in media])


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


def _left_out(blades: Sequence[str], media: Sequence[str], kinds: Mapping[str, Kind], best: Kind) -> tuple[str, ...]:
    """Notes on channels that were left out although their kind is as good as the best of the structure."""
    rank = VIBRATION.index(best)
    blades = [name for name in blades if VIBRATION.index(kinds[name]) <= rank]
    media = [name for name in media if kinds[name] == best]
    notes = []
    if blades:
        notes.append(
            f"left out: {_listed(blades)}: modes of rotating blades appear at f ± 1P; name channels of all blades "
            "blade_1_… and record rotor_azimuth, or list the sensors"
        )
    if media:
        notes.append(
            f"left out: {_listed(media)}: water, air or mooring lines, not the structure; list them to use them"
        )
    return tuple(notes)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def derivative_order(sensor: ModalSensor, record: Record) -> int:
    """Order of the time derivative that a sensor reads: acceleration 2, velocity 1, displacement, strain and load 0.

    Raises
    ------
    ConfigurationError
        If neither the sensor nor its channel names a vibration.
    """
    kind = sensor.quantity or kind_of(sensor.channel, record.unit(sensor.channel))
    if kind not in _ORDERS:
        raise ConfigurationError(
            f"channel '{sensor.channel}' [{record.unit(sensor.channel)}]: expected a vibration; say in the sensor "
            f'list what it reads: quantity = "acceleration"'
        )
    return _ORDERS[kind]


def _has_measured_twin(channel: str, others: Container[str]) -> bool:
    """True for a simulated acceleration without gravity that the record also has with gravity, as sensors measure."""
    return channel.endswith("_kinematic") and channel.removesuffix("_kinematic") in others


def _moves(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return known.size > 2 and not is_constant(known)

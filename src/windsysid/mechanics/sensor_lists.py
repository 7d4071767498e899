"""Sensor lists: TOML tables to sensors, each of the class that its quantity names."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from windsysid.configuration import read_tables
from windsysid.errors import ConfigurationError
from windsysid.mechanics.sensors import SENSORS, Sensor

__all__ = ["as_sensor", "first_problem", "parse_sensors", "read_sensor_file", "read_sensor_tables", "read_sensors"]


def as_sensor(table: Any) -> Sensor:
    """The sensor that a table of a sensor list describes; its `quantity` names the class.

    Raises
    ------
    ConfigurationError
        In one line: what was expected, what was got.
    """
    if not isinstance(table, Mapping):
        raise ConfigurationError(f"expected a table, got {table!r:.80}")
    quantity = table.get("quantity")
    if "quantity" not in table:
        raise ConfigurationError("'quantity' is missing: add it")
    if not (isinstance(quantity, str) and quantity in SENSORS):
        raise ConfigurationError(f"quantity: expected one of {', '.join(SENSORS)}, got {quantity!r:.80}")
    try:
        return SENSORS[quantity].model_validate(table)
    except ValidationError as error:
        raise ConfigurationError(first_problem(error)) from None


def read_sensors(path: str | Path) -> tuple[Sensor, ...]:
    """Read a sensor list from TOML: a ``[[sensor]]`` table per channel, with the keys of the class of its quantity.

    Parameters
    ----------
    path : str or Path
        TOML file.

    Returns
    -------
    tuple of Sensor
        In the order of the file.

    Raises
    ------
    ConfigurationError
        If a value is missing or wrong; the message names the file and the sensor.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import windsysid as ws
    >>> path = Path(tempfile.mkdtemp()) / "sensors.toml"
    >>> keys = 'channel = "a", quantity = "acceleration", point = "tower", axis = "x", frame = "nacelle", noise = 0.01'
    >>> _ = path.write_text(f"sensor = [{{{keys}}}]")
    >>> (sensor,) = ws.models.read_sensors(path)
    >>> sensor.channel, sensor.unit
    ('a', 'm/s^2')
    """
    return parse_sensors(read_sensor_tables(path), str(path))


def read_sensor_tables(path: str | Path) -> list[object]:
    """Read the ``[[sensor]]`` tables of a TOML file, not yet validated; ConfigurationError where it holds others."""
    tables: list[object] = read_sensor_file(path)["sensor"]
    return tables


def read_sensor_file(path: str | Path, others: Sequence[str] = ()) -> dict[str, Any]:
    """Read a TOML file with ``[[sensor]]`` tables and `others`; ConfigurationError where it holds more."""
    path = Path(path)
    content = read_tables(path, "a TOML file with [[sensor]] tables")
    tables = content.get("sensor")
    if set(content) - {*others} != {"sensor"} or not isinstance(tables, list):
        raise ConfigurationError(
            f"{path}: expected [[sensor]] tables and nothing else, got {', '.join(sorted(content)) or 'an empty file'}"
        )
    return content


def parse_sensors(tables: Sequence[object], source: str) -> tuple[Sensor, ...]:
    """Validate sensor tables read from `source`."""
    if not isinstance(tables, list | tuple):
        raise ConfigurationError(f"{source}: expected [[sensor]] tables, one per channel, got {tables!r}")
    sensors: list[Sensor] = []
    for number, table in enumerate(tables, start=1):
        try:
            sensors.append(as_sensor(table))
        except ConfigurationError as error:
            raise ConfigurationError(f"{source}: sensor {number}: {error}") from None
    channels = [sensor.channel for sensor in sensors]
    for channel in channels:
        if channels.count(channel) > 1:
            raise ConfigurationError(
                f"{source}: channel '{channel}' is listed {channels.count(channel)} times: list it once"
            )
    return tuple(sensors)


def first_problem(error: ValidationError) -> str:
    """First problem of a pydantic error in one line: key, expected and received value.

    An unknown key comes first: it is usually the misspelt one that is then missing. Items of a list are counted from 1.
    """
    details = error.errors()
    detail = next((d for d in details if d["type"] == "extra_forbidden"), details[0])
    where = ".".join(str(part + 1 if isinstance(part, int) else part) for part in detail["loc"])
    if detail["type"] == "extra_forbidden":
        return f"unknown key '{where}': remove it or correct its spelling"
    if detail["type"] == "missing":
        return f"'{where}' is missing: add it"
    message = detail["msg"].removeprefix("Value error, ")
    got = detail.get("input")
    shown = f", got {got!r:.80}" if isinstance(got, str | int | float | bool) else ""
    return f"{where}: {message}{shown}" if where else message

"""The turbine file: TOML tables, every value with its unit (``k_x = "1800 N/m"``), to a `Turbine` and back.

A ``rotor`` of hinged blades on its support (docs/nrel5mw.md) and a ``tower`` under a rigid rotor (docs/tower.md) have
files of their own; any other model that was registered is written with its parameters by name
(`windsysid.turbine.model_file`).
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from pydantic import ValidationError

from windsysid.configuration import parse_toml
from windsysid.errors import ConfigurationError
from windsysid.mechanics.model import MODELS
from windsysid.mechanics.sensor_lists import first_problem, parse_sensors
from windsysid.turbine.entries import File
from windsysid.turbine.model_file import ModelFile, model_tables
from windsysid.turbine.rotor_file import RotorFile, rotor_tables
from windsysid.turbine.tower_file import TowerFile, tower_tables
from windsysid.turbine.turbine import Turbine
from windsysid.units import engineering

__all__ = ["as_tables", "parse_turbine"]


def parse_turbine(text: str, source: str) -> Turbine:
    """The turbine that TOML text describes.

    Raises
    ------
    ConfigurationError
        In one line that begins with `source`: what was wrong, what was expected, what was got.
    """
    try:
        content = parse_toml(text)
    except ValueError as error:
        raise ConfigurationError(f"turbine file {source}: expected TOML, got: {error}") from None
    sensors = content.pop("sensor", [])
    model = content.get("model")
    kind = model.get("kind", "rotor") if isinstance(model, dict) else "rotor"
    if not (isinstance(kind, str) and kind in MODELS):
        known = " or ".join(f"'{name}'" for name in MODELS)
        raise ConfigurationError(
            f"turbine file {source}: model.kind: expected {known}, got {kind!r:.60}; a model of your own is known "
            f"once the module that "
            "registers it is imported"
        )
    try:
        file = _format(kind).file.model_validate(content)
    except ValidationError as error:
        raise ConfigurationError(f"turbine file {source}: {first_problem(error)}") from None
    turbine = replace(file.turbine(parse_sensors(sensors, f"turbine file {source}")), site=file.site, odds=file.odds)
    for name in turbine.model.coordinates:
        frequency = turbine.natural_frequency(name) / (2.0 * math.pi)
        if not frequency <= _MAX_FREQUENCY_HZ:
            raise ConfigurationError(
                f"turbine file {source}: {_stiffness(turbine, name)} makes {name} vibrate at {frequency:.3g} Hz: "
                f"expected at most {_MAX_FREQUENCY_HZ:g} Hz; correct the value or its unit"
            )
    return turbine


_MAX_FREQUENCY_HZ = 25_000.0
"""Highest frequency that four samples per period at the fastest rate of a simulation can show [Hz]."""


def as_tables(turbine: Turbine) -> dict[str, Any]:
    """A turbine as the tables of its file: `parse_turbine` of them gives it back."""
    return {
        "name": turbine.name,
        "description": turbine.description,
        "source": turbine.source,
        "assumed": list(turbine.assumed),
        **({} if turbine.site == "onshore" else {"site": turbine.site}),
        **({"odds": dict(turbine.odds)} if turbine.odds else {}),
        **_format(turbine.model.kind).tables(turbine),
        "prior": {"stiffness": turbine.spread[0], "damping": turbine.spread[1]},
        "tolerances": {"masses": f"{turbine.mass_tolerance!r} 1"}
        | ({"aerodynamics": f"{turbine.aerodynamic_tolerance!r} 1"} if turbine.model.kind == "tower" else {}),
        "sensor": [sensor.model_dump(exclude_none=True) for sensor in turbine.sensors],
    }


def _stiffness(turbine: Turbine, coordinate: str) -> str:
    """The stiffness of a degree of freedom, with its name."""
    names = turbine.model.coefficients_of(coordinate, "stiffness")
    units = {name: turbine.model.coefficient(name).unit for name in names}
    return ", ".join(f"{name} = {' '.join(engineering(unit, turbine.values[name]))}" for name, unit in units.items())


class _Format(NamedTuple):
    """Reader and writer of the file of one kind of model."""

    file: type[File]
    tables: Callable[[Turbine], dict[str, Any]]


def _format(kind: str) -> _Format:
    own = {"rotor": _Format(RotorFile, rotor_tables), "tower": _Format(TowerFile, tower_tables)}
    return own.get(kind, _Format(ModelFile, model_tables))

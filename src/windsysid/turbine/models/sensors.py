"""The sensors of a turbine file: outputs that a model names and an instrument can read, with axis and sign.

Where a model names none for an axis, the file has the usual instrument: accelerometers at the tower top, and at the
tips of the blades.
"""

from typing import Any

from windsysid.turbine.models.hinge import Hinge
from windsysid.turbine.models.machine import Machine

__all__ = ["rotor_sensors", "tower_sensors"]

_AXES = {"x": ("YawBrTAgyp", "NcIMUTAgys"), "z": ("YawBrTAgxp", "NcIMUTAgxs")}
"""Outputs of accelerations with gravity in the nacelle, by axis of the turbine file: to the right looking upwind,
downwind."""


def tower_sensors(machine: Machine, tilt: float) -> list[tuple[dict[str, Any], str]]:
    """Sensors of a tower, each with a comment; `tilt` is the slope of the top [rad/m]."""
    return [_top_sensor(machine, axis, tilt) for axis in _AXES]


def rotor_sensors(machine: Machine, hinge: Hinge) -> list[tuple[dict[str, Any], str]]:
    """Sensors of a rotor, each with a comment."""
    top, comment = _top_sensor(machine, "x", 0.0, places=1)
    found = [(top | {"frame": "tower_top"}, comment)]
    for blade in range(1, machine.blades + 1):
        name = f"TipALgyb{blade}"
        said = f"{name} with the sign changed: positive with the rotation" if name in machine.outputs else _ASSUMED
        found.append(
            (
                {
                    "channel": f"blade_{blade}_tip_lag_acceleration", "quantity": "acceleration",
                    "point": f"blade_{blade}", "axis": "tangential", "frame": "blade",
                    "position": [round(hinge.tip, 4), 0.0], "deflection": round(hinge.lever, 4),
                    "slope": round(hinge.slope, 4), "feels_gravity": True, "noise": 0.05, "bias": 2.0, "drift": 1.7,
                },
                said,
            )
        )  # fmt: skip
    return found


_ASSUMED = "assumed: the model's outputs name no instrument for this axis"


def _top_sensor(machine: Machine, axis: str, tilt: float, places: int = 2) -> tuple[dict[str, Any], str]:
    """The accelerometer in the nacelle along an axis; `places` 1: at the tower top only."""
    names = _AXES[axis][:places]
    name = next((name for name in names if name in machine.outputs), "")
    stem = "nacelle" if name.startswith("NcIMU") else "tower"
    height = float(machine.top.sensor[2]) if stem == "nacelle" else 0.0
    said = "to the right, looking upwind" if axis == "x" else "downwind"
    found = {
        "channel": f"{stem}_{axis}_acceleration", "quantity": "acceleration", "point": "tower", "axis": axis,
        "frame": "nacelle", "feels_gravity": True, "noise": 0.005, "bias": 0.1,
    }  # fmt: skip
    if height:
        found["gain"] = round(1.0 + tilt * height, 5)
    return found, f"{said}: {name}, {machine.sources['outputs']}" if name else f"{said}; {_ASSUMED}"

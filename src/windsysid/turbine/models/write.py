"""Turbine files of machines, each number with the file and line that it came from."""

import math
from collections.abc import Callable
from typing import Any

from windsysid.errors import ConfigurationError
from windsysid.turbine.models.hinge import equivalent_hinge, equivalent_rotor
from windsysid.turbine.models.limits import (
    AERODYNAMIC_DAMPING,
    DAMPING_SPREAD,
    LOAD_DEFLECTIONS,
    PARKED_DAMPING,
    PASSING_SHARE,
    STIFFNESS_SPREAD,
)
from windsysid.turbine.models.machine import DIRECTIONS, Machine
from windsysid.turbine.models.motion import MachineMode, MachineModes, TowerMode, machine_modes, tower_modes
from windsysid.turbine.models.sensors import rotor_sensors, tower_sensors
from windsysid.units import RPM

__all__ = ["turbine_text"]


def turbine_text(machine: Machine, kind: str) -> str:
    """Compute the turbine file of a machine: of the kind ``tower`` or ``rotor``.

    Raises
    ------
    ConfigurationError
        If the machine has no such modes, or a rotor was requested and the model has no blades.
    """
    write: dict[str, Callable[[Machine], str]] = {"tower": _tower_text, "rotor": _rotor_text}
    return write[kind](machine)


def _tower_text(machine: Machine) -> str:
    modes = machine_modes(machine, machine.rotor_speed)
    towers = [tower_modes(machine, i)[0] for i in (0, 1)]
    beams = _beam_modes(machine)
    tilt = sum(abs(mode.tilt) for mode in towers) / 2.0
    turning = (modes.side_side, modes.fore_aft)
    stiffness = [t.mass * (2.0 * math.pi * m.frequency) ** 2 for t, m in zip(towers, turning, strict=True)]
    lines = _head(machine, "tower side-side and fore-aft, rotor rigid", "loads, noise, aerodynamic and parked damping")
    lines += ["[model]", 'kind = "tower"', f"blades = {machine.blades}", "", *_rotor_speed(machine)]
    for i, name in enumerate(DIRECTIONS):
        found, air = turning[i], AERODYNAMIC_DAMPING[i]
        lines += [
            "", f"[{name}]",
            _line("modal_mass", towers[i].mass, "kg", f"at the tower top; {_structure(machine)}"),
            _line("frequency", found.frequency, "Hz", _turning(machine, towers[i], beams[i])),
            _line(
                "damping_ratio", 100.0 * (found.damping + air), "%",
                f"{100.0 * found.damping:.3f} % structure with the mass on top ({machine.sources['damping']}), "
                f"{100.0 * air:.1f} % air (assumed)",
            ),
        ]  # fmt: skip
    lines += [
        "", "[top]", _line("tilt", tilt, "rad/m", _tilts(towers)),
        _line("gravity", machine.gravity, "m/s^2", machine.sources["gravity"]), "",
        *_forces("loads", 1.0, 1.0, stiffness), "", *_forces("blade_passing", 10.0, PASSING_SHARE, stiffness), "",
        *_spreads(),
        "", "[states.parked] # structure, and what models leave out: soil, air, dampers (assumed)",
    ]  # fmt: skip
    for i, name in enumerate(DIRECTIONS):
        lines.append(_line(f"{name}_damping_ratio", 100.0 * (turning[i].damping + PARKED_DAMPING[i]), "%", ""))
    lines.append(f"prior_damping = {DAMPING_SPREAD}")
    return "\n".join([*lines, *_sensors(tower_sensors(machine, tilt))]) + "\n"


def _rotor_text(machine: Machine) -> str:
    if machine.blade is None:
        raise ConfigurationError(f"{machine.name}: the model has no blades: expected kind='tower'")
    modes, towers = machine_modes(machine, machine.rotor_speed), tower_modes(machine, 0)
    elastic = equivalent_hinge(machine.blade, machine.top, towers[0])
    hinge, support = equivalent_rotor(machine, elastic, towers, modes)
    s, top = machine.sources, _structure(machine)
    lines = _head(machine, "equivalent-hinge blades, tower side-side with partly free roll", "loads, noise")
    lines += [f"# modes with the rotor turning: {_edges(modes)}", ""]
    lines += ["[model]", f"blades = {machine.blades}", 'y = "locked"', 'roll = "free"', "", *_rotor_speed(machine)]
    axis = float(machine.top.shaft[0])
    lines += [
        _line("gravity", machine.gravity * axis, "m/s^2", f"its part in the rotor plane; {s['gravity']}, {s['top']}"),
        _line("hinge_offset", hinge.offset, "m", s["blade"]),
        _line("tip_lever", hinge.lever, "m", "per radian of lag"),
        "", "[support]", _line("hub_mass_x", support.hub_mass, "kg", top),
        _line("hub_mass_y", support.hub_mass, "kg", ""),
        _line("k_x", support.stiffness, "N/m", "with gravity"), _line("c_x", support.damping, "N*s/m", s["damping"]),
        _line("k_y", support.stiffness, "N/m", ""), _line("c_y", support.damping, "N*s/m", ""),
        _line("kappa", support.kappa, "rad/m", "slope of the first side-side mode"),
        _line("roll_inertia", support.roll_inertia, "kg*m^2", "by the tower's second side-side mode"),
        _line("k_roll", support.roll_stiffness, "N*m/rad", "by the collective edgewise mode"),
        _line("c_roll", support.roll_damping, "N*m*s/rad", s["damping"]),
        "", "[blade]", _line("mass", hinge.mass, "kg", s["blade"]),
        _line("first_moment", hinge.first_moment, "kg*m", "about the hinge"),
        _line("inertia", hinge.inertia, "kg*m^2", "about the hinge"),
        _line("k_beta", hinge.stiffness, "N*m/rad", f"elastic alone: {elastic.stiffness:.5g}"),
        _line("c_beta", hinge.damping, "N*m*s/rad", "the model's ratio of the edgewise mode"),
        "", "[loads] # where their estimates start", 'time_constant = "1 s"',
        _line("hub_rms", LOAD_DEFLECTIONS["side_side"] * support.stiffness, "N", ""),
        _line("blade_rms", LOAD_DEFLECTIONS["blade"] * hinge.stiffness, "N*m", ""),
        _line("roll_rms", LOAD_DEFLECTIONS["roll"] * support.roll_stiffness, "N*m", ""),
        "", *_spreads(), *_sensors(rotor_sensors(machine, hinge)),
    ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _head(machine: Machine, description: str, assumed: str) -> list[str]:
    files = sorted({part.split(":")[0].strip() for text in machine.sources.values() for part in text.split(", ")})
    files = [name for name in files if "." in name]
    return [
        f"# Made by windsysid turbine from a model of {machine.program}. Check what is assumed.",
        f"name = {_quoted(machine.name)}", f"description = {_quoted(f'{machine.name}: {description}')}",
        f"source = {_quoted(f'{machine.program} model: ' + ', '.join(files))}",
        f"assumed = [{', '.join(_quoted(word) for word in [*assumed.split(', '), *machine.assumed])}]",
        *(['site = "offshore"'] if machine.offshore else []), "",
    ]  # fmt: skip


def _rotor_speed(machine: Machine) -> list[str]:
    return ["[rotor]", _line("speed", machine.rotor_speed * RPM, "rpm", machine.sources["rotor_speed"])]


def _structure(machine: Machine) -> str:
    return f"{machine.sources['tower']}, {machine.sources['top']}"


def _turning(machine: Machine, tower: TowerMode, beam: MachineMode | None) -> str:
    speed = f"rotor turning at {machine.rotor_speed * RPM:.4g} rpm"
    found = f"{speed}; {tower.frequency:.4g} Hz with a rigid rotor at rest" if machine.blade is not None else ""
    return found if beam is None else f"{found}; {beam.frequency:.4g} Hz if the tower bent as a beam of its sections"


def _beam_modes(machine: Machine) -> tuple[MachineMode | None, MachineMode | None]:
    """Side-side and fore-aft mode without the shapes to which the model restricts the tower; None where it does not."""
    if machine.support.shapes is None:
        return None, None
    free = machine._replace(support=machine.support._replace(shapes=None))
    found = machine_modes(free, machine.rotor_speed)
    return found.side_side, found.fore_aft


def _tilts(towers: list[TowerMode]) -> str:
    return f"slope of the modes at the top: {abs(towers[0].tilt):.4g} side-side, {abs(towers[1].tilt):.4g} fore-aft"


def _edges(modes: MachineModes) -> str:
    named = {"tower": modes.side_side, "edge backward": modes.backward, "collective": modes.collective,
             "forward": modes.forward, "tower's second": modes.second}  # fmt: skip
    return ", ".join(f"{name} {mode.frequency:.4f} Hz" for name, mode in named.items() if mode is not None)


def _forces(table: str, time_constant: float, share: float, stiffness: list[float]) -> list[str]:
    lines = [f"[{table}] # where their estimates start", f'time_constant = "{time_constant:g} s"']
    for name, k in zip(DIRECTIONS, stiffness, strict=True):
        lines.append(_line(f"{name}_rms", share * LOAD_DEFLECTIONS[name] * k, "N", ""))
    return lines


def _spreads() -> list[str]:
    return ["[prior] # relative standard deviations", f"stiffness = {STIFFNESS_SPREAD}", f"damping = {DAMPING_SPREAD}"]


def _sensors(sensors: list[tuple[dict[str, Any], str]]) -> list[str]:
    lines = []
    for sensor, comment in sensors:
        lines += ["", f"[[sensor]] # {comment}"]
        lines += [f"{key} = {_value(value)}" for key, value in sensor.items()]
    return lines


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return _quoted(value) if isinstance(value, str) else repr(value)


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def _line(key: str, value: float, unit: str, comment: str) -> str:
    return f'{key} = "{float(value):.8g} {unit}"' + (f" # {comment}" if comment else "")

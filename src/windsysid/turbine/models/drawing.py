"""Machines from a table of a drawing: what stands on top in the first lines, then the tower from its foot upwards.

    top_mass = 350 t
    top_height = 1.9 m
    top_inertia = 2.6e7 kg*m^2
    rotor_speed = 12.1 rpm
    height [m], diameter [m], wall [mm]
    0, 6.0, 35.1
    87.6, 3.87, 24.7

The section is a diameter and a wall, or ``stiffness`` (EI); ``mass`` per length is that of steel where it is left out.
"""

import math
from pathlib import Path

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.turbine.models.checks import gyration_problem
from windsysid.turbine.models.input_file import InputFile
from windsysid.turbine.models.machine import Machine, Support, Top
from windsysid.units import parse_quantity

__all__ = ["read_drawing"]

_KEYS = {
    "top_mass": ("kg", None), "top_height": ("m", 0.0), "top_offset": ("m", 0.0), "top_inertia": ("kg*m^2", 0.0),
    "top_inertia_fore_aft": ("kg*m^2", None), "rotor_speed": ("rad/s", None), "blades": ("1", 3.0),
    "density": ("kg/m^3", 8500.0), "young": ("Pa", 2.1e11), "damping": ("%", 0.005), "gravity": ("m/s^2", 9.80665),
    "base_rocking": ("N*m/rad", math.inf), "base_lateral": ("N/m", math.inf),
}  # fmt: skip
"""Keys of the first lines, with unit and default; 8500 kg/m³ is steel with flanges, paint and bolts
(NREL/TP-500-38060)."""

_COLUMNS = {"height": "m", "diameter": "m", "wall": "m", "stiffness": "N*m^2", "mass": "kg/m"}


def read_drawing(path: Path) -> Machine:
    """Read the machine of a table.

    Raises
    ------
    ConfigurationError
        With file and line: a value or column that is missing, not known, out of order or of another unit.
    """
    file = InputFile(path)
    values, lines, at = _values(file)
    columns = _table(file, at)
    z = columns["height"]
    if len(z) < 2 or np.any(np.diff(z) <= 0.0):
        i = int(np.argmax(np.diff(z) <= 0.0)) if len(z) > 1 else 0
        file.fail(at + 1 + min(i + 1, len(z) - 1), "height: expected two or more heights that ascend from the foot")
    mass, stiffness = _section(file, at, columns, values)
    if problem := gyration_problem(stiffness / mass, float(z[-1] - z[0])):
        file.fail(at + 1, problem)
    base = None
    if math.isfinite(values["base_rocking"]) or math.isfinite(values["base_lateral"]):
        springs = [min(values[name], MAX_BASE * stiffness[0]) for name in ("base_lateral", "base_rocking")]
        base = np.array([np.diag(springs)] * 2)
    support = Support(
        z, mass, 0.0 * z, np.array([stiffness, stiffness]), np.full_like(z, np.inf), (), base, float(z[0]),
        np.full((2, 2), values["damping"]), None,
    )  # fmt: skip
    centre = np.array([values["top_offset"], 0.0, values["top_height"]])
    inertia = np.diag([values["top_inertia"], values.get("top_inertia_fore_aft", values["top_inertia"])])
    top = Top(((values["top_mass"], centre),), inertia, centre, np.array([1.0, 0.0, 0.0]))

    def where(*names: str) -> str:
        known = [str(lines[name]) for name in names if name in lines]
        return f"{path.name}:{', '.join(known)}" if known else "assumed"

    sources = {
        "tower": f"{path.name}:{at + 1}-{at + len(z)}", "top": where("top_mass", "top_height", "top_inertia"),
        "damping": where("damping"), "rotor_speed": where("rotor_speed"), "gravity": where("gravity"), "outputs": "",
    }  # fmt: skip
    return Machine(
        path.stem, "a drawing", support, top, None, round(values["blades"]), values["rotor_speed"], values["gravity"],
        False, (), sources,
    )  # fmt: skip


MAX_BASE = 1e6
"""Setting: largest stiffness of a foundation over EI of the foot [1/m, 1/m³], in place of an infinite one."""


def _values(file: InputFile) -> tuple[dict[str, float], dict[str, int], int]:
    """Values of the first lines with their line numbers, and the number of the line of headings."""
    values: dict[str, float] = {}
    lines: dict[str, int] = {}
    for number, line in enumerate(file.lines, start=1):
        text = line.split("#")[0].strip()
        if not text:
            continue
        key, equal, quantity = (part.strip() for part in text.partition("="))
        if not equal:
            missing = [key for key in ("top_mass", "rotor_speed") if key not in values]
            if missing:
                file.fail(number, f"expected a line '{missing[0]} = … {_KEYS[missing[0]][0]}' before the table")
            return _defaults() | values, lines, number
        if key not in _KEYS:
            file.fail(number, f"unknown key '{key[:40]}': expected some of {', '.join(_KEYS)}")
        try:
            values[key] = float(quantity) if _KEYS[key][0] == "1" else parse_quantity(quantity, _KEYS[key][0])
        except ValueError as error:
            file.fail(number, f"{key}: {error}, got '{quantity[:40]}'")
        lines[key] = number
    file.fail(len(file.lines) or 1, "expected a table with the heading 'height [m]', found none")


def _defaults() -> dict[str, float]:
    return {key: default for key, (_, default) in _KEYS.items() if default is not None}


def _table(file: InputFile, at: int) -> dict[str, Array]:
    """Columns of the table below the line `at`, in SI."""
    names, factors = [], []
    for heading in file.lines[at - 1].split(","):
        name, _, unit = heading.strip().rstrip("]").partition("[")
        name = name.strip()
        if name not in _COLUMNS:
            file.fail(at, f"unknown column '{name[:40]}': expected some of {', '.join(_COLUMNS)}")
        try:
            factors.append(parse_quantity(f"1 {unit.strip()}", _COLUMNS[name]))
        except ConfigurationError:
            file.fail(at, f"{name}: expected a unit such as [{_COLUMNS[name]}], got '[{unit.strip()[:20]}]'")
        names.append(name)
    rows = []
    for number, line in enumerate(file.lines[at:], start=at + 1):
        if text := line.split("#")[0].strip():
            words = text.split(",")
            try:
                row = [float(word) for word in words]
            except ValueError:
                row = []
            if len(row) != len(names) or not all(map(math.isfinite, row)):
                file.fail(number, f"expected {len(names)} numbers, got '{text[:60]}'")
            rows.append(row)
    if "height" not in names:
        file.fail(at, f"expected a column 'height [m]', got {', '.join(names)}")
    values = np.array(rows).reshape(len(rows), len(names)) * factors
    return {name: values[:, i] for i, name in enumerate(names)}


def _section(file: InputFile, at: int, columns: dict[str, Array], values: dict[str, float]) -> tuple[Array, Array]:
    """Mass per length and EI."""
    tube = "diameter" in columns and "wall" in columns
    if not tube and not {"stiffness", "mass"} <= set(columns):
        file.fail(at, f"expected columns diameter and wall, or stiffness and mass, got {', '.join(columns)}")
    area, second = np.zeros(0), np.zeros(0)
    if tube:
        outer, inner = columns["diameter"], columns["diameter"] - 2.0 * columns["wall"]
        if np.any(inner < 0.0) or np.any(columns["wall"] <= 0.0):
            file.fail(at + 1, "wall: expected more than 0 and less than half of the diameter; check its unit")
        area, second = math.pi / 4.0 * (outer**2 - inner**2), math.pi / 64.0 * (outer**4 - inner**4)
    mass = columns["mass"] if "mass" in columns else values["density"] * area
    stiffness = columns["stiffness"] if "stiffness" in columns else values["young"] * second
    if np.any(mass <= 0.0) or np.any(stiffness <= 0.0):
        file.fail(at + 1, "expected mass and stiffness above 0 in every row")
    return mass, stiffness

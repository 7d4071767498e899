"""Machines from a table of a drawing: parts on top in the first lines, then the tower from its foot upwards.

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
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
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
    columns, rows = _table(file, at)
    z = columns["height"]
    falls = np.flatnonzero(np.diff(z) <= 0.0)
    if len(z) < 2 or falls.size:
        line = rows[falls[0] + 1] if falls.size else [at, *rows][-1]
        file.fail(line, "height: expected two or more heights that ascend from the foot")
    z, columns = _refined(z, columns)
    mass, stiffness = _section(file, at, columns, values)
    file.check_gyration(at + 1, "section", stiffness / mass, float(z[-1] - z[0]))
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
        "tower": f"{path.name}:{rows[0]}-{rows[-1]}", "top": where("top_mass", "top_height", "top_inertia"),
        "damping": where("damping"), "rotor_speed": where("rotor_speed"), "gravity": where("gravity"), "outputs": "",
    }  # fmt: skip
    return Machine(
        path.stem, "a drawing", support, top, None, round(values["blades"]), values["rotor_speed"], values["gravity"],
        False, (), sources, (path,),
    )  # fmt: skip


MAX_BASE = 1e3
"""Setting: largest stiffness of a foundation over EI of the foot [1/m, 1/m³], in place of an infinite one: a tower of
20 m loses 1e-4 of its frequency."""


def _values(file: InputFile) -> tuple[dict[str, float], dict[str, int], int]:
    """Values of the first lines with their line numbers, and the number of the line of headings."""
    values: dict[str, float] = {}
    lines: dict[str, int] = {}
    for number, text in _texts(file, 1):
        key, equal, quantity = (part.strip() for part in text.partition("="))
        if not equal:
            for name in ("top_mass", "rotor_speed"):
                if name not in values:
                    file.fail(number, f"expected a line '{name} = … {_KEYS[name][0]}' before the table")
            defaults = {key: default for key, (_, default) in _KEYS.items() if default is not None}
            return defaults | values, lines, number
        if key in lines:
            file.fail(number, f"{key}: expected one line of it, got another one in line {lines[key]}")
        values[key], lines[key] = _quantity(file, number, key, quantity.rstrip(",; ")), number
    file.fail(len(file.lines) or 1, "expected a table with the heading 'height [m]', found none")


def _texts(file: InputFile, first: int) -> Iterator[tuple[int, str]]:
    """Number and text of each line from `first` on, without comments and empty lines."""
    for number, line in enumerate(file.lines[first - 1 :], start=first):
        if text := line.split("#")[0].strip():
            yield number, text


def _quantity(file: InputFile, number: int, key: str, text: str) -> float:
    if key not in _KEYS:
        file.fail(number, f"unknown key '{key[:40]}': expected some of {', '.join(_KEYS)}")
    unit = _KEYS[key][0]
    try:
        value = float(text) if unit == "1" else parse_quantity(text, unit)
    except ValueError as error:
        file.fail(number, f"{key}: {error}, got '{text[:40]}'")
    low, high, expected = _RANGES.get(key, (0.0, math.inf, "a value of 0 or more"))
    if not low <= value <= high or (key == "blades" and value != int(value)):
        file.fail(number, f"{key}: expected {expected}, got '{text[:40]}'")
    return value


_ABOVE = (math.ulp(0.0), math.inf, "a value above 0")
_RANGES = {
    "top_height": (-math.inf, math.inf, "a height"), "top_offset": (-math.inf, math.inf, "a distance"),
    "damping": (math.ulp(0.0), 0.99, "more than 0 and up to 99 %"),
    "blades": (1.0, 20.0, "a whole number above 0"),
    **dict.fromkeys(("top_mass", "density", "young", "gravity", "base_rocking", "base_lateral"), _ABOVE),
}  # fmt: skip
"""Smallest and largest value of a key, and what is expected."""


def _table(file: InputFile, at: int) -> tuple[dict[str, Array], list[int]]:
    """Columns of the table below the line `at`, in SI, and the numbers of its lines."""
    units = dict(_heading(file, at, heading) for heading in file.lines[at - 1].split(","))
    if "height" not in units:
        file.fail(at, f"expected a column 'height [m]', got {', '.join(units)}")
    rows, lines = [], []
    for number, text in _texts(file, at + 1):
        try:
            row = [float(word) for word in text.split(",")]
        except ValueError:
            row = []
        if len(row) != len(units) or not all(map(math.isfinite, row)):
            file.fail(number, f"expected {len(units)} numbers, got '{text[:60]}'")
        rows.append(row)
        lines.append(number)
    values = np.array(rows).reshape(len(rows), len(units)) * list(units.values())
    return {name: values[:, i] for i, name in enumerate(units)}, lines


def _heading(file: InputFile, at: int, heading: str) -> tuple[str, float]:
    """Name of a column, and its unit in SI."""
    name, _, unit = (part.strip() for part in heading.strip().rstrip("]").partition("["))
    if name not in _COLUMNS:
        file.fail(at, f"unknown column '{name[:40]}': expected some of {', '.join(_COLUMNS)}")
    try:
        return name, parse_quantity(f"1 {unit}", _COLUMNS[name])
    except ConfigurationError:
        file.fail(at, f"{name}: expected a unit such as [{_COLUMNS[name]}], got '[{unit[:20]}]'")


def _refined(z: Array, columns: dict[str, Array]) -> tuple[Array, dict[str, Array]]:
    """Heights and columns with more rows between those of the table: diameter and wall are linear, EI is not."""
    parts = [np.linspace(low, high, ROWS_BETWEEN, endpoint=False) for low, high in pairwise(z)]
    fine = np.concatenate([*parts, z[-1:]])
    return fine, {name: np.interp(fine, z, column) for name, column in columns.items()}


ROWS_BETWEEN = 10
"""Setting: rows in place of one: EI of a cone that halves its diameter is then linear to 0.3 % in between."""


def _section(file: InputFile, at: int, columns: dict[str, Array], values: dict[str, float]) -> tuple[Array, Array]:
    """Mass per length and EI: of a steel tube, unless columns say otherwise."""
    if not ({"stiffness", "mass"} <= set(columns) or {"diameter", "wall"} <= set(columns)):
        file.fail(at, f"expected columns diameter and wall, or stiffness and mass, got {', '.join(columns)}")
    if "wall" in columns and "diameter" in columns:
        outer, inner = columns["diameter"], columns["diameter"] - 2.0 * columns["wall"]
        if np.any(inner < 0.0):
            file.fail(at + 1, "wall: expected more than 0 and less than half of the diameter; check its unit")
        area, second = math.pi / 4.0 * (outer**2 - inner**2), math.pi / 64.0 * (outer**4 - inner**4)
        columns = {"mass": values["density"] * area, "stiffness": values["young"] * second} | columns
    if np.any(columns["mass"] <= 0.0) or np.any(columns["stiffness"] <= 0.0):
        file.fail(at + 1, "expected mass and stiffness above 0 in every row")
    return columns["mass"], columns["stiffness"]

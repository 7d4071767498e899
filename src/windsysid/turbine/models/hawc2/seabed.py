"""Soil and water around the bodies of HAWC2: springs along a pile, and the mass of water that moves along."""

import numpy as np

from windsysid._types import Array
from windsysid.turbine.models.hawc2.htc_file import HtcBlock
from windsysid.turbine.models.input_file import InputFile

__all__ = ["soil_stiffness", "water_mass"]


KILO = 1e3
"""Forces of soil curves are written in kN, per metre of pile."""


def soil_stiffness(main: HtcBlock, name: str, z: Array) -> Array:
    """Lateral stiffness (n,) [N/m²] of the soil at heights z (n,) of a body, up to the first deflection of its curves.

    Raises
    ------
    ConfigurationError
        With file and line: a table that is missing, or out of order.
    """
    found = np.zeros_like(z)
    for element in _elements(main, "soil", name):
        file = element.open("datafile")
        at = file.heading("lateral")[1]
        rows, columns = (int(value) for value in _numbers(file, at + 1, 2))
        deflection = _numbers(file, at + 2, columns)
        table = np.array([_numbers(file, at + 3 + i, columns + 1) for i in range(rows)]).reshape(rows, columns + 1)
        if columns < 2 or deflection[0] != 0.0 or deflection[1] <= 0.0 or np.any(np.diff(table[:, 0]) <= 0.0):
            file.fail(at + 3, "expected deflections from 0 on and depths that ascend")
        found += np.interp(-z, table[:, 0], KILO * table[:, 2] / deflection[1], left=0.0, right=0.0)
    return found


def _elements(main: HtcBlock, kind: str, name: str) -> list[HtcBlock]:
    """Elements ``soil_element`` or ``hydro_element`` of a body."""
    block = main.first(kind)
    elements = block.all(f"{kind}_element") if block else ()
    return [one for one in elements if one.word("mbdy_name", "body_name").lower() == name]


def _numbers(file: InputFile, index: int, count: int) -> list[float]:
    """The first numbers of a line, by its index."""
    words = file.lines[index].split()[:count] if index < len(file.lines) else []
    if len(words) < count:
        file.fail(index + 1, f"expected {count} numbers, got {len(words)}")
    return [file.value(index + 1, word) for word in words]


def water_mass(main: HtcBlock, name: str, along: Array, z: Array) -> Array:
    """Mass of water (n,) [kg/m] that a body moves along, at distances along it and heights z (n,)."""
    found = np.zeros_like(z)
    for element in _elements(main, "hydro", name):
        rows = np.array([row.numbers(1, 5) for row in element.commands("sec")]).reshape(-1, 5)
        if len(rows) < 2 or np.any(np.diff(rows[:, 0]) <= 0.0):
            element.file.fail(element.line, "hydro_element: expected two or more lines 'sec' that ascend")
        water = main.block("hydro").block("water_properties")
        density = float(water.command("rho").numbers(1, 1)[0])
        level = -float(water.command("mwl").numbers(1, 1)[0])
        mass = np.interp(along, rows[:, 0], density * rows[:, 1] * rows[:, 4])
        found += np.where((z <= level) & (along >= rows[0, 0]) & (along <= rows[-1, 0]), mass, 0.0)
    return found

"""Foundation of a tower: SubDyn's members in one vertical line, soil springs, and the water that moves along."""

import math
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.turbine.models.input_file import InputFile
from windsysid.turbine.models.machine import PointMass

__all__ = ["Substructure", "read_substructure"]

SHEAR_FACTOR = 0.53
"""Setting: Cowper's shear coefficient κ of a thin steel tube, 2(1 + ν)/(4 + 3ν) (J. Appl. Mech. 33, 1966)."""

STEP = 1e-6
"""Setting: distance [m] between the two sides of a step of the section."""


class Substructure(NamedTuple):
    """A vertical beam below the tower: stations z (n,) [m], mass and water [kg/m], EI [N·m²], κGA [N], masses on it,
    foundation (2, 2, 2) by direction, and where the numbers stand."""

    z: Array
    mass: Array
    water: Array
    bending: Array
    shear: Array
    points: tuple[PointMass, ...]
    base: Array | None
    sources: tuple[str, ...]

    @classmethod
    def none(cls) -> "Substructure":
        """Nothing: the tower is clamped at its foot."""
        empty = np.zeros(0)
        return cls(empty, empty, empty, empty, empty, (), None, ())


def read_substructure(main: InputFile, foot: float) -> Substructure:
    """Read SubDyn, soil and added mass of a main file; ``foot`` is the height of the tower's foot [m].

    Raises
    ------
    ConfigurationError
        With file and line, if members are not one vertical line of round tubes up to the tower's foot.
    """
    sub = main.file("SubFile")
    joints, first = sub.rows("JointID", sub.count("NJoints"), 4)
    heights = {}
    for i, words in enumerate(joints):
        x, y, height = (sub.value(first + i, word) for word in words[1:4])
        if math.hypot(x, y) > STEP:
            sub.fail(
                first + i,
                f"joint {words[0]}: expected joints in one vertical line (a monopile), got x, y = {x:g}, {y:g}",
            )
        heights[words[0]] = height
    stations = _members(sub, heights)
    stations.sort(key=lambda row: row[0])
    table = np.array(stations)
    z = table[:, 0]
    if abs(z[-1] - foot) > 0.01:
        sub.fail(first, f"expected members up to the tower's foot at {foot:g} m (TowerBsHt), got up to {z[-1]:g} m")
    z = z + STEP * _repeats(z)
    z[-1] = min(z[-1], foot - STEP)
    base, springs = _base(sub, heights)
    water, sea = _water(main, z)
    return Substructure(
        z, table[:, 1], water, table[:, 2], table[:, 3], _points(sub, heights), base,
        (f"{sub.path.name}:{first}-{first + len(joints) - 1}", *springs, *sea),
    )  # fmt: skip


def _repeats(z: Array) -> Array:
    """Number of earlier stations (n,) at the same height."""
    return np.array([float(np.sum(z[:i] == height)) for i, height in enumerate(z)])


def _members(sub: InputFile, heights: dict[str, float]) -> list[list[float]]:
    """Two stations of each member: z, mass per length, EI, κGA."""
    properties, first = sub.rows("PropSetID", _sets(sub), 6)
    sections = {}
    for i, words in enumerate(properties):
        young, shear, density, diameter, wall = (sub.value(first + i, word) for word in words[1:6])
        inner = diameter - 2.0 * wall
        area = math.pi / 4.0 * (diameter**2 - inner**2)
        second = math.pi / 64.0 * (diameter**4 - inner**4)
        sections[words[0]] = (density * area, young * second, SHEAR_FACTOR * shear * area)
    members, first = sub.rows("MemberID", sub.count("NMembers"), 5)
    found = []
    for i, words in enumerate(members):
        if not words[5:6] or words[5].lower() not in ("1", "1c", "1.0"):
            sub.fail(first + i, f"member {words[0]}: expected a round beam (MType 1c), got {' '.join(words[5:6])}")
        for joint, section in zip(words[1:3], words[3:5], strict=True):
            if joint not in heights or section not in sections:
                sub.fail(first + i, f"member {words[0]}: joint {joint} or section {section} is not in the tables above")
            found.append([heights[joint], *sections[section]])
    return found


def _sets(sub: InputFile) -> int:
    """Number of round sections: the first of several values of that name."""
    return sub.count("NPropSets" if sub.has("NPropSets") else "NPropSetsCyl")


def _points(sub: InputFile, heights: dict[str, float]) -> tuple[PointMass, ...]:
    """Concentrated masses."""
    count = sub.count("NCmass", 0)
    rows, first = sub.rows("CMJointID", count, 3) if count else ([], 0)
    found = []
    for i, words in enumerate(rows):
        if words[0] not in heights:
            sub.fail(first + i, f"mass: joint {words[0]} is not in the table of joints")
        found.append(PointMass(heights[words[0]], *(sub.value(first + i, word) for word in words[1:3])))
    return tuple(found)


def _base(sub: InputFile, heights: dict[str, float]) -> tuple[Array | None, tuple[str, ...]]:
    """The foundation: None where the lowest joint is locked, else the springs of its soil file."""
    rows, first = sub.rows("RJointID", sub.count("NReact"), 7)
    if len(rows) != 1 or heights.get(rows[0][0]) != min(heights.values()):
        sub.fail(first, "expected one reaction joint, the lowest of the members")
    words = rows[0]
    if all(word in ("1", "1.0") for word in words[1:7]):
        return None, ()
    if len(words) < 8 or words[7].strip("\"'").lower() in ("", "none", "unused"):
        sub.fail(first, f"joint {words[0]} is free: expected a soil file (SSIfile)")
    soil = InputFile(sub.path.parent / words[7].strip("\"'"), f"{sub.path}:{first}", sub.read)
    k = {name: soil.number(name, 0.0) for name in ("Kyy", "Kytx", "Ktxtx", "Kxx", "Kxty", "Ktyty")}
    for name in ("Kxx", "Kyy", "Ktxtx", "Ktyty"):
        if k[name] <= 0.0:
            soil.fail(soil.line(name), f"{name}: expected a stiffness above 0, got {k[name]:g}")
    side = [[k["Kyy"], -k["Kytx"]], [-k["Kytx"], k["Ktxtx"]]]
    fore = [[k["Kxx"], k["Kxty"]], [k["Kxty"], k["Ktyty"]]]
    return np.array([side, fore]), (f"{soil.path.name}:1-{len(soil.lines)}",)


def _water(main: InputFile, z: Array) -> tuple[Array, tuple[str, ...]]:
    """Mass of water (n,) [kg/m] that moves along, outside by the coefficient Ca and inside of flooded members."""
    none = np.zeros_like(z)
    if not main.has("CompHydro") or main.count("CompHydro") != 1:
        return none, ()
    hydro = main.file("HydroFile")
    count = hydro.count("NPropSetsCyl" if hydro.has("NPropSetsCyl") else "NPropSets", 0)
    if not count:
        return none, ()
    rows, first = hydro.rows("PropSetID", count, 3)
    diameter, wall = (hydro.value(first, word) for word in rows[0][1:3])
    coefficients, at = hydro.rows("SimplCd", 1, 3)
    added = hydro.value(at, coefficients[0][2])
    sea = main if main.has("WtrDens") else hydro
    density = sea.number("WtrDens", 1025.0)
    outside = added * density * math.pi / 4.0 * diameter**2
    inside = 0.0
    if hydro.count("NFillGroups", 0):
        inside = density * math.pi / 4.0 * (diameter - 2.0 * wall) ** 2
    level = sea.number("MSL2SWL", 0.0)
    return np.where(z <= level, outside + inside, 0.0), (f"{hydro.path.name}:{first}-{at}",)

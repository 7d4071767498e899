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

STEP_METRES = 1e-6
"""Setting: distance [m] between the two sides of a step of the section."""


STATIONS = 201
"""Setting: stations in addition to those of members, for water: its surface is exact to 0.1 m in a pile of 45 m."""


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
        if math.hypot(x, y) > STEP_METRES:
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
    own = z + STEP_METRES * _repeats(z)
    own[-1] = min(own[-1], foot - STEP_METRES)
    z = np.union1d(own, np.linspace(own[0], own[-1], STATIONS))
    table = np.array([np.interp(z, own, column) for column in table.T]).T
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
    members, first = sub.rows("MemberID", sub.count("NMembers"), 5, "MJointID1")
    typed = "mtype" in sub.heading("MemberID", "MJointID1")[0]
    found = []
    for i, words in enumerate(members):
        if typed and [word.lower() for word in words[5:6]] not in (["1"], ["1c"], ["1.0"]):
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
    """Mass of water (n,) [kg/m] that moves along, outside by the coefficient Ca and inside of filled members."""
    found = np.zeros_like(z)
    if not main.has("CompHydro") or main.count("CompHydro") != 1:
        return found, ()
    hydro = main.file("HydroFile")
    if not hydro.count("NMembers", 0):
        return found, ()
    tables = _hydro_tables(hydro)
    sea = main if main.has("WtrDens") else hydro
    density, level = sea.number("WtrDens", 1025.0), sea.number("MSL2SWL", 0.0)
    filled = _filled(hydro, density)
    rows, first = hydro.rows("MemberID", hydro.count("NMembers"), 5, "MJointID1")
    mode = hydro.heading("MemberID", "MJointID1")[0].index("mcoefmod")
    for i, words in enumerate(rows):
        if not (set(words[1:3]) <= tables.heights.keys() and set(words[3:5]) <= tables.sizes.keys()):
            hydro.fail(first + i, f"member {words[0]}: a joint or section is not in the tables above")
        ends = np.array([tables.heights[joint] for joint in words[1:3]])
        share = (z - ends[0]) / (ends[1] - ends[0] or math.inf)
        diameter, wall = (np.outer(1.0 - share, tables.sizes[words[3]]) + np.outer(share, tables.sizes[words[4]])).T
        added = tables.coefficient("".join(words[mode : mode + 1]), words[0], z - level, share)
        surface, inner = filled.get(words[0], (-math.inf, 0.0))
        mass = added * density * diameter**2 * (z <= level) + inner * (diameter - 2.0 * wall) ** 2 * (z <= surface)
        within = (z >= ends.min() - 10.0 * STEP_METRES) & (z <= ends.max()) & (found == 0.0)
        found += np.where(within, math.pi / 4.0 * mass, 0.0)
    return found, (f"{hydro.path.name}:{first}-{first + len(rows) - 1}",)


class _HydroTables(NamedTuple):
    """Heights of joints, diameter and wall of sections, and Ca: one number, by depth (2, n), by member at both ends."""

    heights: dict[str, float]
    sizes: dict[str, tuple[float, float]]
    simple: float
    by_depth: Array
    by_member: dict[str, tuple[float, float]]

    def coefficient(self, mode: str, member: str, z: Array, share: Array) -> Array:
        """Ca (n,) of a member at heights above the water and shares of its length, by its ``MCoefMod`` 1, 2 or 3."""
        if mode == "2" and self.by_depth.size:
            return np.asarray(np.interp(-z, *self.by_depth))
        first, last = self.by_member.get(member, (self.simple, self.simple)) if mode == "3" else (self.simple,) * 2
        return np.asarray(first * (1.0 - share) + last * share)


def _hydro_tables(hydro: InputFile) -> _HydroTables:
    """Read HydroDyn's tables of joints, sections and coefficients."""

    def table(name: str, counted: str, columns: tuple[str, ...]) -> list[tuple[str, tuple[float, ...]]]:
        count = hydro.count(f"{counted}Cyl" if hydro.has(f"{counted}Cyl") else counted, 0) if counted else 1
        if not count:
            return []
        words = hydro.heading(name, columns[0])[0]
        at = [words.index(column.lower()) for column in columns]
        rows, first = hydro.rows(name, count, max(at) + 1, columns[0])
        return [(row[0], tuple(hydro.value(first + i, row[k]) for k in at)) for i, row in enumerate(rows)]

    depths = table("Dpth", "NCoefDpth", ("DpthCa", "Dpth"))
    stem = next((line.split()[0] for line in hydro.lines if line.lower().startswith("memberid_hyd")), "MemberID")
    members = table(stem, "NCoefMembers", ("MemberCa1", "MemberCa2"))
    return _HydroTables(
        {key: row[0] for key, row in table("JointID", "NJoints", ("Jointzi",))},
        {key: (row[0], row[1]) for key, row in table("PropSetID", "NPropSets", ("PropD", "PropThck"))},
        table("SimplCd", "", ("SimplCa",))[0][1][0], np.array([row for _, row in depths]).T[::-1],
        {key: (row[0], row[1]) for key, row in members},
    )  # fmt: skip


def _filled(hydro: InputFile, density: float) -> dict[str, tuple[float, float]]:
    """Height of the water inside [m] and its density [kg/m³], by filled member."""
    groups = hydro.count("NFillGroups", 0)
    rows, first = hydro.rows("FillNumM", groups, 4) if groups else ([], 0)
    found: dict[str, tuple[float, float]] = {}
    for i, words in enumerate(rows):
        count = int(hydro.value(first + i, words[0]))
        if len(words) < count + 3:
            hydro.fail(first + i, f"expected {count} members, FillFSLoc and FillDens, got {len(words) - 1} values")
        inner = density if words[count + 2].strip("\"'").lower() == "default" else None
        fill = hydro.value(first + i, words[count + 2]) if inner is None else inner
        found |= dict.fromkeys(words[1 : count + 1], (hydro.value(first + i, words[count + 1]), fill))
    return found

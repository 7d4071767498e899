"""Machines from OpenFAST: main file, ElastoDyn with tower and blades, SubDyn with soil, HydroDyn's added mass.

FAST 7 has what ElastoDyn has in its main file. Axes are OpenFAST's: x downwind, y to the left looking downwind, z up.
"""

import math
import re
from pathlib import Path

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.turbine.models.blade import BladeSection, blade_of_shapes
from windsysid.turbine.models.input_file import InputFile
from windsysid.turbine.models.machine import Blade, Machine, PointMass, Support, Top
from windsysid.turbine.models.rotor_motion import BLADES
from windsysid.turbine.models.substructure import STATIONS, Substructure, read_substructure

__all__ = ["read_openfast"]

TOWER_UNITS = {"HtFract": "-", "TMassDen": "kg/m", "TwFAStif": "Nm^2", "TwSSStif": "Nm^2"}
BLADE_UNITS = {"BlFract": "-", "StrcTwst": "deg", "BMassDen": "kg/m", "FlpStff": "Nm^2", "EdgStff": "Nm^2"}
"""Columns of the tables, with their units."""


MIN_NODES, MAX_NODES = 3, 500
"""Setting: numbers of nodes of a blade: three shapes need three, and more than 500 only cost memory."""


def read_openfast(path: Path) -> Machine:
    """Read the machine of a main input file of OpenFAST 1 to 5, FAST 8 or FAST 7.

    Raises
    ------
    ConfigurationError
        With file and line: what is missing, out of order or of an unknown kind.
    """
    main = InputFile(path)
    dyn = main.file("EDFile") if main.has("EDFile") else main
    _check_version(dyn)
    if main.has("CompElast") and main.count("CompElast") not in (1, 2):
        main.fail(main.line("CompElast"), f"CompElast: expected 1 (ElastoDyn) or 2, got {main.text('CompElast')}")
    if (blades := dyn.count("NumBl")) != BLADES:
        dyn.fail(dyn.line("NumBl"), f"NumBl: expected {BLADES} blades, got {blades}")
    site = main if main.has("Gravity") else dyn
    gravity = site.number("Gravity")
    if dyn.flag("Furling"):
        dyn.fail(dyn.line("Furling"), "Furling: expected False, got True: furling machines are not read")
    platform = dyn.file("PtfmFile") if dyn.has("PtfmModel") and dyn.count("PtfmModel") else dyn
    below = _below(main, dyn, platform)
    support, tower = _support(dyn, below, platform)
    offshore = bool(below.sources) or bool(np.any(support.water))
    blade, blade_sources = _blade(dyn)
    if main.has("CompElast") and main.count("CompElast") == 2:
        blade_sources += " of ElastoDyn; the model itself bends as BeamDyn's blade"
    used = ["NacMass", "NacCMxn", "NacCMyn", "NacCMzn", "HubMass", "OverHang", "ShftTilt", "Twr2Shft"]
    sources = {
        "tower": ", ".join([tower, *below.sources]),
        "top": dyn.where(*[name for name in used if dyn.has(name)]),
        "blade": blade_sources,
        "rotor_speed": dyn.where("RotSpeed"),
        "gravity": site.where("Gravity"),
        "outputs": f"{dyn.path.name}: OutList",
        "damping": f"{dyn.path.parent.joinpath(dyn.text('TwrFile')).name}: TwrSSDmp, TwrFADmp",
    }
    return Machine(
        path.stem, "OpenFAST", support, _top(dyn), blade, blades, dyn.number("RotSpeed") * math.pi / 30.0, gravity,
        offshore, tuple(dyn.outputs()), sources, tuple(main.read),
    )  # fmt: skip


def _check_version(dyn: InputFile) -> None:
    """Refuse a version of ElastoDyn that is not known."""
    for number, line in enumerate(dyn.lines[:2], start=1):
        if (found := re.search(r"elastodyn\s+v(\d+)", line, re.IGNORECASE)) and found[1] != "1":
            dyn.fail(number, f"expected ElastoDyn v1.xx, got '{line.strip(' -')[:50]}': this version is not known")


def _below(main: InputFile, dyn: InputFile, platform: InputFile) -> Substructure:
    """Foundation of the tower; a platform that floats is refused."""
    for name, most in (("CompSub", 1), ("CompSoil", 0)):
        if main.has(name) and main.count(name) > most:
            expected = " or ".join("01"[: most + 1])
            main.fail(main.line(name), f"{name}: expected {expected}, got {main.text(name)}: not read")
    if main.has("CompSub") and main.count("CompSub") == 1:
        return read_substructure(main, dyn.number("TowerBsHt", 0.0))
    moves = [name for name in ("PtfmSgDOF", "PtfmSwDOF", "PtfmRDOF", "PtfmPDOF") if platform.flag(name)]
    if moves:
        platform.fail(
            platform.line(moves[0]),
            f"{moves[0]}: expected a tower clamped at its foot or on SubDyn (CompSub 1), got a platform that moves; "
            "floating machines are not read",
        )
    return Substructure.none()


def _support(dyn: InputFile, below: Substructure, platform: InputFile) -> tuple[Support, str]:
    """The support, and where the tower's numbers stand."""
    tower = dyn.file("TwrFile")
    table = tower.table("NTwInpSt", TOWER_UNITS)
    base = dyn.number("TowerBsHt", -platform.number("TwrDraft", 0.0))
    top, foot = dyn.number("TowerHt"), base + dyn.number("TwrRBHt", 0.0)
    if top <= foot:
        dyn.fail(dyn.line("TowerHt"), f"TowerHt: expected a height above the tower's foot at {foot:g} m, got {top:g}")
    in_water = platform.has("TwrLdMod") and platform.count("TwrLdMod") == 1
    at = table.columns["HtFract"]
    if in_water:
        at = np.union1d(at, np.linspace(0.0, 1.0, STATIONS))
    columns = {name: np.interp(at, table.columns["HtFract"], column) for name, column in table.columns.items()}
    z = foot + (top - foot) * at
    mass = columns["TMassDen"] * tower.factor("AdjTwMa")
    stiffness, shapes, damping = [], [], []
    for side in ("SS", "FA"):
        adjusted = tower.factor(f"Adj{side}St") * tower.factor(f"{side}StTunr1")
        column = columns[f"Tw{side}Stif"] * adjusted
        tower.check_gyration(table.first, f"Tw{side}Stif", column / np.maximum(mass, 1e-300), top - foot)
        stiffness.append(column)
        shapes.append([_polynomial(tower, f"Tw{side}M{mode}Sh") for mode in (1, 2)])
        damping.append([tower.damping(f"Twr{side}Dmp{mode}") for mode in (1, 2)])
    points = list(below.points)
    if mass_below := platform.number("PtfmMass", 0.0):
        points.append(PointMass(foot, mass_below, platform.number("PtfmRIner", 0.0)))
    water = np.zeros_like(z)
    if in_water:
        area = math.pi / 4.0 * platform.number("TwrDiam") ** 2
        water = np.where(z <= 0.0, platform.number("TwrCA") * platform.number("WtrDens", 1025.0) * area, 0.0)
    joined = np.concatenate([below.z, z])
    support = Support(
        joined, np.concatenate([below.mass, mass]), np.concatenate([below.water, water]),
        np.concatenate([np.tile(below.bending, (2, 1)), np.array(stiffness)], axis=1),
        np.concatenate([below.shear, np.full_like(z, np.inf)]), tuple(points), below.base, foot, np.array(damping),
        np.array(shapes),
    )  # fmt: skip
    return support, f"{tower.path.name}:{table.first}-{table.last}, {dyn.where('TowerHt')}"


def _polynomial(file: InputFile, stem: str) -> Array:
    """Coefficients (7,) of a shape, which is 1 at the end."""
    found = np.array([0.0, 0.0, *(file.number(f"{stem}{power}") for power in range(2, 7))])
    if abs(found.sum() - 1.0) > 0.01:
        file.fail(file.line(f"{stem}6"), f"{stem}: expected coefficients that add up to 1, got {found.sum():.4g}")
    return np.asarray(found / found.sum())


def _top(dyn: InputFile) -> Top:
    """Parts on the tower, without blades."""
    tilt = math.radians(dyn.number("ShftTilt"))
    shaft = np.array([math.cos(tilt), 0.0, math.sin(tilt)])
    apex = np.array([0.0, 0.0, dyn.number("Twr2Shft")]) + dyn.number("OverHang") * shaft
    nacelle = np.array([dyn.number(name, 0.0) for name in ("NacCMxn", "NacCMyn", "NacCMzn")])
    masses = (
        (dyn.number("YawBrMass", 0.0), np.zeros(3)),
        (dyn.positive("NacMass"), nacelle),
        (dyn.number("HubMass", 0.0), apex + dyn.number("HubCM", 0.0) * shaft),
    )
    spin = dyn.number("HubIner", 0.0) + dyn.number("GenIner", 0.0)
    cone = math.radians(dyn.number("PreCone1", 0.0) if dyn.has("PreCone1") else dyn.number("PreCone", 0.0))
    sensor = np.array([dyn.number(name, 0.0) for name in ("NcIMUxn", "NcIMUyn", "NcIMUzn")])
    return Top(masses, spin * np.outer(shaft[:2], shaft[:2]), apex, shaft, cone, sensor)


def _blade(dyn: InputFile) -> tuple[Blade, str]:
    """One blade, and where its numbers stand."""
    file = dyn.file("BldFile1" if dyn.has("BldFile1") else "BldFile")
    table = file.table("NBlInpSt", BLADE_UNITS)
    root = dyn.number("HubRad")
    length = dyn.number("TipRad") - root
    if length <= 0.0:
        dyn.fail(dyn.line("TipRad"), f"TipRad: expected more than HubRad {root:g} m, got {dyn.text('TipRad')}")
    nodes = dyn.count("BldNodes") if dyn.has("BldNodes") else _aerodynamic_nodes(dyn)
    if not MIN_NODES <= nodes <= MAX_NODES:
        raise ConfigurationError(f"{dyn.path}: BldNodes: expected {MIN_NODES} to {MAX_NODES} nodes, got {nodes:g}")
    at = np.append((np.arange(nodes) + 0.5) / nodes, 1.0)
    columns = {name: np.interp(at, table.columns["BlFract"], column) for name, column in table.columns.items()}
    mass = table.columns["BMassDen"] * file.factor("AdjBlMs")
    for name in ("FlpStff", "EdgStff"):
        file.check_gyration(table.first, name, table.columns[name] / np.maximum(mass, 1e-300), length)
    element = np.append(np.full(nodes, length / nodes), 0.0)
    pitch = dyn.number("BlPitch1", 0.0)
    tip = dyn.number("TipMass1", 0.0)
    section = BladeSection(
        at * length, element, np.append((columns["BMassDen"] * file.factor("AdjBlMs") * element)[:-1], tip),
        columns["FlpStff"] * file.factor("AdjFlSt") * file.factor("FlStTunr1"),
        columns["EdgStff"] * file.factor("AdjEdSt"), np.radians(columns["StrcTwst"] + pitch),
    )  # fmt: skip
    stems = ("BldFl1Sh", "BldFl2Sh", "BldEdgSh")
    shapes = [np.polynomial.Polynomial(_polynomial(file, stem)) for stem in stems]
    damping = np.array([file.damping(name) for name in ("BldFlDmp1", "BldFlDmp2", "BldEdDmp1")])
    blade = blade_of_shapes(section, shapes, [False, False, True], damping, root)
    return blade, f"{file.path.name}:{table.first}-{table.last}, {dyn.where('TipRad', 'HubRad')}"


def _aerodynamic_nodes(dyn: InputFile) -> int:
    """Number of blade nodes in FAST 7, whose structure takes those of AeroDyn."""
    if not dyn.has("ADFile"):
        raise ConfigurationError(f"{dyn.path}: expected BldNodes or ADFile, found neither")
    return dyn.file("ADFile").count("BldNodes")

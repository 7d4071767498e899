"""Machines from windIO, a YAML file of a turbine's parts, in the layouts of versions 1 and 2.

Version 2 has a line ``windIO_version``, other names of its parts, and degrees and rpm in place of radians. Axes are
those of the machine. A blade's sections have x to the suction side and y to the trailing edge in version 1, as BeamDyn,
and the other way round in the schema of version 2, whose published turbines keep the former: the axis about which a
blade is stiffer is that of edgewise bending. Source: documentation of windIO, IEA Wind TCP Task 37.
"""

import math
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.turbine.models.blade import BLADE_ELEMENTS, blade_of_beam
from windsysid.turbine.models.input_file import InputFile
from windsysid.turbine.models.machine import Blade, Machine, PointMass, Support, Top
from windsysid.turbine.models.rotor_motion import BLADES
from windsysid.turbine.models.substructure import SHEAR_FACTOR, STATIONS, STEP_METRES
from windsysid.units import RPM

__all__ = ["read_windio"]

GRAVITY, WATER_DENSITY = 9.81, 1025.0
"""Gravity [m/s²] and density of sea water [kg/m³], which windIO does not have or need not have."""

TOWER_DAMPING, BLADE_DAMPING = 0.005, 0.005
"""Size: damping ratios where a file has none: those of the NREL 5 MW and IEA 15 MW turbines' blades and of drawings."""

NAMES: dict[int, dict[str, str]] = {
    1: {
        "axis": "outer_shape_bem.reference_axis", "diameter": "outer_shape_bem.outer_diameter",
        "layers": "internal_structure_2d_fem.layers", "outfitting": "internal_structure_2d_fem.outfitting_factor",
        "elastic": "elastic_properties_mb.six_x_six", "blade": "elastic_properties_mb.six_x_six",
        "twist": "outer_shape_bem.twist", "rigid": "elastic_properties_mb", "mass": "system_mass",
        "inertia": "system_inertia", "location": "system_center_mass", "drivetrain": "nacelle.drivetrain",
        "geometry": "nacelle.drivetrain", "yaw": "nacelle.drivetrain.elastic_properties_mb.yaw_mass",
        "speed": "control.torque.VS_maxspd",
    },
    2: {
        "axis": "reference_axis", "diameter": "outer_shape.outer_diameter", "layers": "structure.layers",
        "outfitting": "structure.outfitting_factor", "elastic": "structure.elastic_properties",
        "blade": "structure.elastic_properties", "twist": "outer_shape.twist", "rigid": "elastic_properties",
        "mass": "mass", "inertia": "inertia", "location": "location", "drivetrain": "drivetrain",
        "geometry": "drivetrain.outer_shape", "yaw": "yaw.elastic_properties.mass",
        "speed": "control.rated_rotor_speed",
    },
}  # fmt: skip
"""Where each version has its numbers."""

ANGLE, SPEED = {1: 1.0, 2: math.pi / 180.0}, {1: 1.0, 2: 1.0 / RPM}
"""Units of angles and rotor speed by version [rad, rad/s]."""


class YamlNode:
    """A value of a YAML file that knows its line.

    Parameters
    ----------
    node
        Of PyYAML.
    file
        The file.
    name
        Path of the value, for messages.
    """

    def __init__(self, node: Any, file: InputFile, name: str) -> None:
        self.node, self.file, self.name = node, file, name

    @property
    def line(self) -> int:
        """Number of the line."""
        return int(self.node.start_mark.line) + 1

    def fail(self, message: str) -> NoReturn:
        """Raise a ConfigurationError that begins with file and line."""
        self.file.fail(self.line, f"{self.name}: {message}")

    def find(self, path: str) -> "YamlNode | None":
        """The value at a path of names; None where there is none."""
        found = self.node
        for name in path.split("."):
            pairs = found.value if found.id == "mapping" else ()
            found = next((value for key, value in pairs if key.value == name), None)
            if found is None:
                return None
        return YamlNode(found, self.file, f"{self.name}.{path}".lstrip("."))

    def get(self, path: str) -> "YamlNode":
        """The value at a path of names; an error where there is none."""
        if (found := self.find(path)) is None:
            self.fail(f"expected '{path}', found none")
        return found

    def items(self) -> "list[YamlNode]":
        """Elements of a list."""
        if self.node.id != "sequence":
            self.fail("expected a list")
        return [YamlNode(node, self.file, self.name) for node in self.node.value]

    def number(self, path: str, default: float | None = None) -> float:
        """The number at a path; `default` where there is none."""
        if default is not None and self.find(path) is None:
            return default
        found = self.get(path)
        return self.file.value(found.line, str(found.node.value), f"{found.name}: ")

    def numbers(self, path: str, count: int = 0) -> Array:
        """The list of numbers (n,) at a path, of `count` at least."""
        return self.get(path).numbers_of(count)

    def numbers_of(self, count: int = 0) -> Array:
        """The numbers (n,) of this list, of `count` at least."""
        values = [self.file.value(item.line, str(item.node.value), f"{self.name}: ") for item in self.items()]
        if len(values) < max(count, 1):
            self.fail(f"expected {max(count, 1)} or more numbers, got {len(values)}")
        return np.array(values)

    def curve(self, path: str, at: Array, values: str = "values") -> Array:
        """A list of values over a grid from 0 to 1, at points (n,) of that."""
        found = self.get(path)
        grid, height = found.numbers("grid", 2), found.numbers(values, 2)
        if len(grid) != len(height):
            found.get(values).fail(f"expected {len(grid)} numbers as in 'grid', got {len(height)}")
        if (falls := np.flatnonzero(np.diff(grid) <= 0.0)).size:
            found.get("grid").fail(f"expected an ascending grid, got {grid[falls[0] + 1]:g} after {grid[falls[0]]:g}")
        return np.asarray(np.interp(at, grid, height))

    def where(self, *paths: str) -> str:
        """File and lines of some values."""
        lines = sorted({found.line for path in paths if (found := self.find(path)) is not None})
        return f"{self.file.path.name}:{', '.join(map(str, lines))}" if lines else "assumed"


def read_windio(path: Path) -> Machine:
    """Read the machine of a windIO file: tower, monopile, nacelle, hub and blades.

    Raises
    ------
    ConfigurationError
        With file and line: what is missing, out of order or of an unknown version; or if PyYAML is not installed.
    """
    root, version = _load(path)
    parts, names = root.get("components"), NAMES[version]
    if (blades := root.number("assembly.number_of_blades")) != BLADES:
        root.get("assembly.number_of_blades").fail(f"expected {BLADES} blades, got {blades:g}")
    support, tower = _support(root, parts, names)
    top, at_top = _top(root, parts, names, ANGLE[version])
    blade, of_blade = _blade(parts, names, ANGLE[version])
    sea = parts.find("monopile") is not None
    assumed = ["no soil: clamped at the sea bed"] * sea + ["damping"] * (support.rayleigh is None)
    sources = {
        "tower": tower, "top": at_top, "blade": of_blade, "rotor_speed": root.where(names["speed"]),
        "gravity": "assumed", "outputs": "",
        "damping": parts.where("tower.structure.elastic_properties.structural_damping"),
    }  # fmt: skip
    speed = root.number(names["speed"]) * SPEED[version]
    return Machine(
        path.stem, "windIO", support, top, blade, BLADES, speed, GRAVITY, sea, (), sources, (path,), tuple(assumed)
    )


def _load(path: Path) -> tuple[YamlNode, int]:
    """The file's first mapping, and the version of its layout."""
    try:
        import yaml
    except ImportError:
        raise ConfigurationError(
            f"{path}: windIO needs PyYAML: install it with: pip install 'windsysid[windio]'"
        ) from None
    file = InputFile(path)
    try:
        node = yaml.compose("\n".join(file.lines), Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except yaml.YAMLError as error:
        mark, text = getattr(error, "problem_mark", None), getattr(error, "problem", error)
        file.fail(mark.line + 1 if mark else 1, f"no YAML: {' '.join(str(text).split())}")
    if node is None or node.id != "mapping":
        file.fail(1, "expected a windIO file with 'assembly' and 'components', found no names")
    root = YamlNode(node, file, "")
    if (version := root.find("windIO_version")) is None:
        return root, 1
    major = str(version.node.value).strip("v").split(".")[0]
    if major not in ("1", "2"):
        version.fail(f"expected version 1 or 2, got '{version.node.value}': this version is not known")
    return root, int(major)


def _support(root: YamlNode, parts: YamlNode, names: dict[str, str]) -> tuple[Support, str]:
    """Tower and monopile, which is clamped at the sea bed, and where their numbers stand."""
    tower = parts.get("tower")
    columns = _beam(root, tower, names)
    foot, points, water = float(columns[0][0]), [], np.zeros_like(columns[0])
    sources = [tower.where(names["axis"], names["diameter"], names["layers"], names["elastic"])]
    if (pile := parts.find("monopile")) is not None:
        below = _beam(root, pile, names)
        bed = -root.get("environment").number("water_depth") if root.find("environment") else None
        if bed is None:
            pile.fail("expected the height of the sea bed: add 'environment: {water_depth: …}' to the file")
        if abs(below[0][-1] - foot) > 0.01 or below[0][0] > bed or bed >= foot:
            pile.fail(f"expected a pile from below the sea bed at {bed:g} m up to the tower's foot at {foot:g} m")
        z = np.concatenate([[bed], below[0][below[0] > bed]])
        low = np.array([z, *(np.interp(z, below[0], column) for column in below[1:])])
        low[0, -1] = foot - STEP_METRES
        diameter = np.interp(z, below[0], _diameter(pile, names, below[0]))
        sea = root.number("environment.water_density", WATER_DENSITY)
        water = np.concatenate([np.where(low[0] <= 0.0, sea * math.pi / 4.0 * diameter**2, 0.0), water])
        columns = np.concatenate([low, columns], axis=1)
        points.append(PointMass(foot, pile.number("transition_piece_mass", 0.0), 0.0))
        sources.append(pile.where(names["axis"], names["diameter"], names["layers"], names["elastic"]))
    z, mass, side, fore, shear = columns
    mu = tower.find("structure.elastic_properties.structural_damping.mu")
    rates = np.zeros(2) if mu is None else tower.numbers("structure.elastic_properties.structural_damping.mu", 6)
    rayleigh = None
    if rates.any():
        rayleigh = np.array([[0.0 * z, 0.0 * z + rates[0]], [0.0 * z, 0.0 * z + rates[1]]])
    return Support(
        z, mass, water, np.array([side, fore]), shear, tuple(points), None, foot, np.full((2, 2), TOWER_DAMPING), None,
        None, rayleigh,
    ), ", ".join(sources)  # fmt: skip


def _beam(root: YamlNode, part: YamlNode, names: dict[str, str]) -> Array:
    """Stations of a tower or pile (5, n): height, mass per length, EI side-side and fore-aft, κGA."""
    axis = part.get(f"{names['axis']}.z")
    grid, height = axis.numbers("grid", 2), axis.numbers("values", 2)
    if len(grid) != len(height) or np.any(np.diff(height) <= 0.0) or np.any(np.diff(grid) <= 0.0):
        axis.fail("expected as many heights as points of the grid, both ascending from the foot")
    at = np.unique(np.concatenate([grid, np.linspace(0.0, 1.0, STATIONS)]))
    z = np.interp(at, grid, height)
    if part.find(names["layers"]) is not None:
        mass, bending, shear = _tube(root, part, names, at)
        found = np.array([z, mass, bending, bending, shear])
    else:
        elastic = part.get(names["elastic"])
        about_x, _, about_y, mass = _sections(elastic, at)
        found = np.array([z, mass, about_x, about_y, np.full_like(z, np.inf)])
    line = part.get(names["diameter"]).line
    part.file.check_gyration(line, part.name, found[2] / np.maximum(found[1], 1e-30), float(z[-1] - z[0]))
    return found


def _diameter(part: YamlNode, names: dict[str, str], z: Array) -> Array:
    """Outer diameter (n,) at heights z (n,)."""
    axis = part.get(f"{names['axis']}.z")
    return part.curve(names["diameter"], np.interp(z, axis.numbers("values"), axis.numbers("grid")))


def _tube(root: YamlNode, part: YamlNode, names: dict[str, str], at: Array) -> tuple[Array, Array, Array]:
    """Mass per length, EI and κGA (n,) of round layers, from the outside inwards."""
    outer = part.curve(names["diameter"], at)
    mass, bending, shear = np.zeros_like(at), np.zeros_like(at), np.zeros_like(at)
    materials = {str(item.get("name").node.value): item for item in root.get("materials").items()}
    for layer in part.get(names["layers"]).items():
        name = str(layer.get("material").node.value)
        if name not in materials:
            layer.get("material").fail(f"expected one of the materials, got '{name}'")
        wall = layer.curve("thickness", at)
        inner = outer - 2.0 * wall
        if np.any(wall < 0.0) or np.any(inner < 0.0):
            layer.get("thickness").fail("expected walls of 0 or more and less than half of the diameter [m]")
        area, second = math.pi / 4.0 * (outer**2 - inner**2), math.pi / 64.0 * (outer**4 - inner**4)
        young = materials[name].number("E")
        mass += materials[name].number("rho") * area
        bending += young * second
        shear += SHEAR_FACTOR * materials[name].number("G", young / 2.6) * area
        outer = inner
    return mass * part.number(names["outfitting"], 1.0), bending, shear


def _sections(elastic: YamlNode, at: Array) -> Array:
    """Bending stiffness about x, its coupling, that about y, and mass per length (4, n), where no force is along z."""
    if (matrix := elastic.find("stiff_matrix")) is not None:
        rows = np.array([item.numbers_of(21) for item in matrix.get("values").items()])
        masses = elastic.get("inertia_matrix")
        weights = np.array([item.numbers_of(21)[0] for item in masses.get("values").items()])
        grid = matrix.numbers("grid", 2)
        if len(grid) != len(rows) or len(masses.numbers("grid")) != len(weights):
            matrix.fail(f"expected {len(grid)} rows as in 'grid', got {len(rows)}")
        mass = np.interp(at, masses.numbers("grid"), weights)
        upper = [np.interp(at, grid, rows[:, i]) for i in (11, 12, 13, 15, 16, 18)]
    else:
        matrix = elastic.get("stiffness_matrix")
        mass = elastic.curve("inertia_matrix", at, "mass")
        keys = ("K33", "K34", "K35", "K44", "K45", "K55")
        zero = np.zeros_like(at)
        upper = [elastic.curve("stiffness_matrix", at, key) if matrix.find(key) else zero for key in keys]
    axial, with_x, with_y, about_x, cross, about_y = upper
    some = np.where(axial > 0.0, axial, 1.0)
    return np.array([about_x - with_x**2 / some, cross - with_x * with_y / some, about_y - with_y**2 / some, mass])


def _top(root: YamlNode, parts: YamlNode, names: dict[str, str], angle: float) -> tuple[Top, str]:
    """Yaw bearing, nacelle and hub, and where their numbers stand."""
    shape, train, hub = parts.get(names["geometry"]), parts.get(names["drivetrain"]), parts.get("hub")
    downwind = root.find("assembly.rotor_orientation")
    sign = 1.0 if downwind is not None and str(downwind.node.value).lower() == "downwind" else -1.0
    tilt = sign * shape.number("uptilt") * angle
    shaft = np.array([math.cos(tilt), 0.0, math.sin(tilt)])
    apex = np.array([sign * abs(shape.number("overhang")), 0.0, shape.number("distance_tt_hub")])
    rigid, of_hub = train.get(names["rigid"]), hub.get(names["rigid"])
    at_hub = of_hub.numbers(names["location"], 3) if of_hub.find(names["location"]) else np.zeros(3)
    up = np.array([-math.sin(tilt), 0.0, math.cos(tilt)])
    turn = np.array([shaft, [0.0, 1.0, 0.0], up]).T
    masses = (
        (parts.number(names["yaw"], 0.0), np.zeros(3)),
        (rigid.number(names["mass"]), rigid.numbers(names["location"], 3)[:3]),
        (of_hub.number(names["mass"]), apex + turn @ at_hub[:3]),
    )
    inertia = _tensor(rigid.numbers(names["inertia"], 3))
    inertia += turn @ _tensor(of_hub.numbers(names["inertia"], 3)) @ turn.T
    if masses[1][0] <= 0.0 or masses[2][0] <= 0.0:
        rigid.fail("expected masses of nacelle and hub above 0")
    cone = sign * abs(hub.number("cone_angle")) * angle
    keys = [f"{names['geometry']}.{key}" for key in ("uptilt", "overhang", "distance_tt_hub")]
    where = parts.where(*keys, f"{names['drivetrain']}.{names['rigid']}", f"hub.{names['rigid']}")
    return Top(masses, inertia[:2, :2], apex, shaft, cone), where


def _tensor(values: Array) -> Array:
    """Inertia (3, 3) from I_xx, I_yy, I_zz and, where given, I_xy, I_xz, I_yz."""
    a, b, c, xy, xz, yz = np.append(values, np.zeros(3))[:6]
    return np.array([[a, xy, xz], [xy, b, yz], [xz, yz, c]])


def _blade(parts: YamlNode, names: dict[str, str], angle: float) -> tuple[Blade, str]:
    """The blade, and where its numbers stand."""
    blade = parts.get("blade")
    elastic = blade.get(names["blade"])
    along = (np.arange(BLADE_ELEMENTS) + 0.5) / BLADE_ELEMENTS
    fine = np.linspace(0.0, 1.0, STATIONS)
    line = np.array([blade.curve(f"{names['axis']}.{name}", fine) for name in "xyz"])
    length = float(np.sum(np.linalg.norm(np.diff(line, axis=1), axis=0)))
    about_x, cross, about_y, mass = _sections(elastic, along)
    flap, edge = (about_y, about_x) if np.median(about_x) > np.median(about_y) else (about_x, about_y)
    tensor = np.array([[flap, -cross], [-cross, edge]]).transpose(2, 0, 1)
    blade.file.check_gyration(elastic.line, "blade", flap / np.maximum(mass, 1e-30), length)
    twist = blade.curve(names["twist"], along) * angle
    c, s = np.cos(twist), np.sin(twist)
    axes = np.array([[c, s], [-s, c]]).transpose(2, 0, 1)
    bending = axes @ tensor @ axes.transpose(0, 2, 1)
    mu = blade.find(f"{names['blade']}.structural_damping.mu")
    rates = mu.numbers_of(6)[:2] if mu is not None else np.zeros(2)
    own = np.sqrt(np.outer(rates, rates))
    element = np.full(BLADE_ELEMENTS, length / BLADE_ELEMENTS)
    root = parts.number("hub.diameter") / 2.0
    found = blade_of_beam(element, mass * element, bending, axes @ (own * tensor) @ axes.transpose(0, 2, 1), root)
    if not rates.any():
        masses = np.einsum("p,pkd,pkd->k", found.mass, found.displacement, found.displacement)
        own = np.diag(2.0 * BLADE_DAMPING * np.sqrt(np.diag(found.stiffness) * masses))
        found = found._replace(damping=own)
    return found, f"{blade.file.path.name}:{elastic.line}" + ("" if rates.any() else ", damping assumed")

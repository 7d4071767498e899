"""Machines from HAWC2: support, parts on top and blades of a chain of main bodies (`read_hawc2`).

HAWC2's axes are x to the right looking upwind, y downwind, z down. A blade's are x to the leading edge, y to the
suction side, z to the tip. Source: Larsen and Hansen, How 2 HAWC2, the user's manual, Risø-R-1597.
"""

import math
from pathlib import Path

import numpy as np

from windsysid._types import Array
from windsysid.turbine.models.blade import BLADE_ELEMENTS, blade_of_beam
from windsysid.turbine.models.hawc2.bodies import Body, PlacedBody, bending_stiffness, placed_bodies, rayleigh
from windsysid.turbine.models.hawc2.htc_file import HtcBlock, read_htc
from windsysid.turbine.models.hawc2.seabed import soil_stiffness, water_mass
from windsysid.turbine.models.machine import Blade, Machine, PointMass, Support, Top
from windsysid.turbine.models.rotor_motion import BLADES
from windsysid.turbine.models.substructure import STEP_METRES

__all__ = ["read_hawc2"]

TO_MACHINE = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Rotation from HAWC2's axes to those of a machine: downwind, to the right looking upwind, up."""

GRAVITY = 9.81
"""Gravity [m/s²] that HAWC2 takes where a file has none."""


def read_hawc2(path: Path) -> Machine:
    """Read the machine of a main input file of HAWC2.

    Raises
    ------
    ConfigurationError
        With file and line: what is missing, out of order or of an unknown kind.
    """
    main = read_htc(path)
    structure = main.block("new_htc_structure")
    places = placed_bodies(structure)
    blades = _blades(main, structure, places)
    chain = _chain(blades[0], places)
    at = _tower_index(chain)
    support, sources = _support(main, structure, chain[: at + 1])
    on_top = _on_top(chain[: at + 1], blades, places)
    top, roots = _top(chain[at].end, on_top, blades)
    speed, speed_at = _rotor_speed(main, structure)
    water = main.first("hydro")
    properties = water.first("water_properties") if water else None
    gravity = properties.commands("gravity") if properties else []
    sources |= {
        "top": ", ".join(dict.fromkeys(m.where for p in on_top for m in p.body.masses)),
        "blade": f"{blades[0].body.sections[1].path.name}:{blades[0].body.lines}",
        "rotor_speed": speed_at, "gravity": gravity[0].where if gravity else "assumed", "outputs": "",
    }  # fmt: skip
    return Machine(
        path.stem, "HAWC2", support, top, _blade(blades[0], top, roots), BLADES, speed,
        float(gravity[0].numbers(1, 1)[0]) if gravity else GRAVITY, water is not None, (), sources,
        tuple(main.file.read), ("soil curves in kN per metre",) * (support.soil is not None),
    )  # fmt: skip


def _on_top(support: list[PlacedBody], blades: list[PlacedBody], places: dict[str, PlacedBody]) -> list[PlacedBody]:
    """Bodies that are neither support nor blades; they stand on the tower."""
    found = [placed for placed in places.values() if not any(placed is one for one in [*support, *blades])]
    for placed in found:
        if not any(one is support[-1] for one in _chain(placed, places)):
            placed.body.block.file.fail(placed.body.block.line, f"body {placed.body.name}: not on the tower: not read")
    return found


def _blades(main: HtcBlock, structure: HtcBlock, places: dict[str, PlacedBody]) -> list[PlacedBody]:
    """The blades, as the block ``aero`` links them, or by their names."""
    aero = main.first("aero")
    names = [e.words[3].lower() for e in aero.commands("link") if len(e.words) > 3] if aero else []
    names = names or [name for name in places if name.startswith("blade")]
    found = [places[name] for name in names if name in places]
    if len(found) != BLADES:
        structure.file.fail(structure.line, f"expected {BLADES} blades, got {len(found)} ({', '.join(names)})")
    return found


def _chain(last: PlacedBody, places: dict[str, PlacedBody]) -> list[PlacedBody]:
    """Bodies from the ground to one."""
    found = [last]
    while found[0].parent:
        found.insert(0, places[found[0].parent])
    return found


def _tower_index(chain: list[PlacedBody]) -> int:
    """Index of the tower: the last upright body of that name, or the longest one that is upright."""
    upright = [i for i, placed in enumerate(chain) if abs(placed.axes[2, 2] - 1.0) < STEP_METRES and placed.upright]
    named = [i for i in upright if chain[i].body.name == "tower"]
    if not upright:
        chain[0].body.block.file.fail(chain[0].body.block.line, f"{chain[0].body.name}: expected an upright body")
    return named[-1] if named else max(upright, key=lambda i: chain[i].body.length)


def _support(main: HtcBlock, structure: HtcBlock, chain: list[PlacedBody]) -> tuple[Support, dict[str, str]]:
    """Tower and what it stands on, and where the numbers stand."""
    z, mass, shear = [], [], []
    stiffness, rates, water, soil = [], [], [], []
    points: list[PointMass] = []
    sources = []
    for placed in chain:
        body = placed.body
        if not placed.upright or not np.allclose(placed.axes, np.eye(3), atol=STEP_METRES):
            body.block.file.fail(body.block.line, f"body {body.name}: expected an upright one with global axes")
        along = body.stations()
        foot = -float(placed.origin[2])
        first = foot + along + STEP_METRES * (placed is not chain[0])
        tensor = bending_stiffness(body, along)
        body.check_sections(tensor[:, 0, 0] if placed is chain[-1] else None, along)
        z.append(first)
        mass.append(body.column(1, along))
        shear.append(body.shear(along))
        stiffness.append([tensor[:, 0, 0], tensor[:, 1, 1]])
        rates.append(rayleigh(body, len(along)))
        water.append(water_mass(main, body.name, along, first))
        soil.append(soil_stiffness(main, body.name, first))
        points += [PointMass(foot - offset[2], m, inertia[1, 1]) for m, offset, inertia in body.point_masses()]
        sources.append(f"{body.sections[1].path.name}:{body.lines}")
    ground = np.concatenate(soil)
    support = Support(
        np.concatenate(z), np.concatenate(mass), np.concatenate(water), np.concatenate(stiffness, axis=1),
        np.concatenate(shear), tuple(points), _base(structure, chain[0].body, bool(ground.any())), float(z[-1][0]),
        np.zeros((2, 2)), None, ground if ground.any() else None, np.concatenate(rates, axis=2),
    )  # fmt: skip
    damping = ", ".join(placed.body.damping.where for placed in chain if placed.body.damping)
    return support, {"tower": ", ".join(sources), "damping": damping or "none"}


def _base(structure: HtcBlock, body: Body, in_soil: bool) -> Array | None:
    """Foundation of the lowest body: None where it is clamped, nothing but the soil where it stands in that."""
    constraints = structure.block("constraint")
    for block in constraints.all("fix0"):
        if block.word("body", "mbdy", "main_body").lower() == body.name:
            return None
    if not in_soil:
        constraints.file.fail(constraints.line, f"expected 'fix0' of {body.name} or its soil: floating is not read")
    return np.zeros((2, 2, 2))


def _top(origin: Array, parts: list[PlacedBody], blades: list[PlacedBody]) -> tuple[Top, float]:
    """Parts on the tower, and the distance of the blades' roots from the rotor's centre."""
    masses, inertia = [], np.zeros((3, 3))
    for placed in parts:
        rotation = TO_MACHINE @ placed.axes
        for mass, offset, own in placed.body.all_masses():
            masses.append((mass, TO_MACHINE @ (placed.origin + placed.axes @ offset - origin)))
            inertia += rotation @ own @ rotation.T
    roots = np.array([TO_MACHINE @ (blade.origin - origin) for blade in blades])
    spans = np.array([TO_MACHINE @ blade.axes[:, 2] for blade in blades])
    normal = np.cross(spans[1] - spans[0], spans[2] - spans[0])
    shaft = normal * math.copysign(1.0, normal[0]) / np.linalg.norm(normal)
    cone = math.asin(float(np.mean(spans @ shaft)))
    hub = float(np.mean(np.linalg.norm(roots - roots.mean(axis=0), axis=1))) / math.cos(cone)
    apex = roots.mean(axis=0) - hub * math.sin(cone) * shaft
    return Top(tuple(masses), inertia[:2, :2], apex, shaft, cone), hub


def _blade(placed: PlacedBody, top: Top, root: float) -> Blade:
    """The blade: twisted sections along its curve."""
    body = placed.body
    length = np.full(BLADE_ELEMENTS, body.length / BLADE_ELEMENTS)
    along = np.cumsum(length) - length / 2.0
    tensor = bending_stiffness(body, along)
    body.check_sections(tensor[:, 1, 1], along)
    span, leading = (TO_MACHINE @ placed.axes[:, i] for i in (2, 0))
    forward = np.cross(top.shaft, span)
    start = math.atan2(float(leading @ np.cross(span, forward)), float(leading @ forward))
    twist = np.radians(np.interp(along, body.arc, body.nodes[:, 3])) + start
    c, s = np.cos(twist), np.sin(twist)
    axes = np.array([[s, c], [-c, s]]).transpose(2, 0, 1)
    turned = axes.transpose(0, 2, 1)
    of_mass, factors = rayleigh(body, BLADE_ELEMENTS).transpose(1, 0, 2)
    rates = np.sqrt(factors[:, None] * factors[None]).transpose(2, 0, 1)
    mass = body.column(1, along) * length
    for m, offset, _ in body.point_masses():
        mass[np.argmin(np.abs(along - offset[2]))] += m
    blade = blade_of_beam(length, mass, axes @ tensor @ turned, axes @ (rates * tensor) @ turned, root)
    along_axes = np.einsum("pde,pkd->pke", axes, blade.displacement[:-1])
    added = np.einsum("p,ep,pke,ple->kl", mass, of_mass, along_axes, along_axes)
    return blade._replace(damping=blade.damping + added)


def _rotor_speed(main: HtcBlock, structure: HtcBlock) -> tuple[float, str]:
    """Usual rotor speed [rad/s]: the rated one of DTU's controller, or that at the start; and where it stands."""
    dll = main.first("dll")
    for block in dll.all("type2_dll") if dll else ():
        if block.commands("name") and "dtu_we" in block.word("name").lower() and (values := block.first("init")):
            for entry in values.commands("constant"):
                if entry.words[1:2] == ("3",):
                    return float(entry.numbers(2, 1)[0]), f"{entry.where} (rated)"
    for block in structure.block("orientation").all("relative"):
        for entry in block.commands("mbdy2_ini_rotvec_d1", "body2_ini_rotvec_d1", "main_body2_ini_rotvec_d1"):
            return float(entry.numbers(4, 1)[0]), f"{entry.where} (at the start)"
    structure.file.fail(structure.line, "expected a rotor speed (mbdy2_ini_rotvec_d1), found none")

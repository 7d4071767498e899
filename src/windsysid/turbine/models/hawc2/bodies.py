"""Main bodies of HAWC2: their axis, sections, masses and damping, and where they are (`placed_bodies`)."""

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.turbine.models.hawc2.htc_file import Command, HtcBlock, read_sections
from windsysid.turbine.models.input_file import InputFile
from windsysid.turbine.models.substructure import STATIONS

__all__ = ["Body", "PlacedBody", "bending_stiffness", "placed_bodies", "rayleigh"]

BEAM, FULL = 19, 30
"""Setting: columns of sections of a beam (r, m, …, E, G, I_x, I_y, …), and of those with a stiffness matrix."""

MIN_TABLE_SHARE = 0.99
"""Setting: share of a body's length that its table must reach: tables are written with some digits only."""

BODY = ("body", "mbdy", "main_body")
"""Setting: commands that name a body."""

DAMPING = ("damping", "damping_posdef", "damping_aniso", "damping_aniso_v2")
"""Setting: commands of Rayleigh damping: M_x M_y M_z [1/s] and K_x K_y K_z [s]."""


class Body:
    """A main body.

    Parameters
    ----------
    name
        Its own.
    block
        Its block, or that of the body of which it is a copy.
    """

    def __init__(self, name: str, block: HtcBlock) -> None:
        self.name, self.block = name, block
        if block.commands("type") and block.word("type").lower() != "timoschenko":
            block.command("type").fail(f"expected timoschenko, got {block.word('type')}")
        self.masses = block.commands("concentrated_mass")
        unknown = [e for e in block.commands("damping*", "gravity*") if e.words[0] not in DAMPING]
        if unknown:
            unknown[0].fail(f"expected {' or '.join(DAMPING)}: this command is not known")
        self.damping: Command | None = next(iter(block.commands(*DAMPING)), None)
        self.nodes = _nodes(block)
        self.arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.nodes[:, :3], axis=0), axis=1))])

    @property
    def length(self) -> float:
        """Length of the axis [m]."""
        return float(self.arc[-1])

    @cached_property
    def sections(self) -> tuple[Array, InputFile, int]:
        """Rows of the table, its file and first line."""
        return read_sections(self.block.block("timoschenko_input"))

    def check_sections(self, stiffness: Array | None, along: Array) -> None:
        """Refuse a table that ends before the axis does, or a stiffness (n,), where given, unlike its masses."""
        rows, file, line = self.sections
        if rows[-1, 0] < MIN_TABLE_SHARE * self.length:
            file.fail(
                line + len(rows) - 1,
                f"body {self.name}: expected sections up to its length of {self.length:.4g} m, got {rows[-1, 0]:.4g} m",
            )
        if stiffness is not None:
            mass = np.maximum(self.column(1, along), 1e-30)
            file.check_gyration(line, f"body {self.name}", stiffness / mass, self.length)

    @property
    def lines(self) -> str:
        """Lines of the table."""
        rows, _, line = self.sections
        return f"{line}-{line + len(rows) - 1}"

    def stations(self) -> Array:
        """Distances along the axis (n,): rows of the table up to its length, and some between for soil and water."""
        along = np.unique(np.concatenate([self.sections[0][:, 0], np.linspace(0.0, self.length, STATIONS)]))
        return np.asarray(along[(along >= 0.0) & (along <= self.length)])

    def column(self, index: int, along: Array) -> Array:
        """A column of the table at some distances (n,)."""
        rows = self.sections[0]
        return np.asarray(np.interp(along, rows[:, 0], rows[:, index]))

    def shear(self, along: Array) -> Array:
        """Shear stiffness κGA (n,) [N]."""
        if self.sections[0].shape[1] == FULL:
            return self.column(9, along)
        return np.asarray(self.column(13, along) * self.column(9, along) * self.column(15, along))

    def point_masses(self) -> list[tuple[float, Array, Array]]:
        """Concentrated masses: mass [kg], position (3,) [m] and inertia (3, 3) [kg·m²] about it in the body's axes."""
        found = []
        for entry in self.masses:
            node, *offset, mass, a, b, c = entry.numbers(1, 8)
            if node != int(node) or not 1 <= node <= len(self.nodes):
                entry.fail(f"expected a node from 1 to {len(self.nodes)}, got {node:g}")
            if min(mass, a, b, c) < 0.0:
                entry.fail("expected mass and inertia of 0 or more")
            inertia = np.diag([a, b, c])
            if len(entry.words) >= 12:
                for (i, j), value in zip(((0, 1), (0, 2), (1, 2)), entry.numbers(9, 3), strict=True):
                    inertia[i, j] = inertia[j, i] = -value
            found.append((mass, self.nodes[int(node) - 1, :3] + np.array(offset), inertia))
        return found

    def all_masses(self) -> list[tuple[float, Array, Array]]:
        """Concentrated masses, and the mass of the axis in parts between stations."""
        along = self.stations()
        middle, mass = (along[1:] + along[:-1]) / 2.0, self.column(1, along)
        parts = np.diff(along) * (mass[1:] + mass[:-1]) / 2.0
        at = np.array([np.interp(middle, self.arc, self.nodes[:, i]) for i in range(3)]).T
        return [*self.point_masses(), *((float(m), r, np.zeros((3, 3))) for m, r in zip(parts, at, strict=True))]


class PlacedBody(NamedTuple):
    """A body, the one on whose last node it stands ('' for the ground), its origin (3,) [m] and axes (3, 3)."""

    body: Body
    parent: str
    origin: Array
    axes: Array

    @property
    def end(self) -> Array:
        """Position (3,) of the last node [m]."""
        return np.asarray(self.origin + self.axes @ self.body.nodes[-1, :3])

    @property
    def upright(self) -> bool:
        """True if the body's axis is straight and points up."""
        nodes = self.body.nodes
        return bool(np.all(np.abs(nodes[:, [0, 1, 3]]) < 1e-6) and np.all(np.diff(nodes[:, 2]) < 0.0))


def placed_bodies(structure: HtcBlock) -> dict[str, PlacedBody]:
    """Read all bodies of a structure with their places.

    Raises
    ------
    ConfigurationError
        With file and line: a body that is unknown, or has no place.
    """
    bodies = _bodies(structure)
    orientation = structure.block("orientation")
    bases = [(_named(bodies, block.command(*BODY)), block) for block in orientation.all("base")]
    found = {b.name: PlacedBody(b, "", at.command("inipos").numbers(1, 3), _rotation(at, "")) for b, at in bases}
    waiting = list(orientation.all("relative"))
    while waiting:
        ready = [b for b in waiting if _named(bodies, _of(b, 1)).name in found]
        if not ready:
            waiting[0].file.fail(waiting[0].line, f"body {_of(waiting[0], 1).words[1]}: its place is not given")
        for block in ready:
            below, body = found[_named(bodies, _of(block, 1)).name], _named(bodies, _of(block, 2))
            if _of(block, 1).words[2:3] not in (("last",), (str(len(below.body.nodes)),)):
                _of(block, 1).fail(f"expected the last node of {below.body.name}, got others: not read")
            if body.name in found:
                _of(block, 2).fail(f"body {body.name}: expected one place, got two")
            found[body.name] = PlacedBody(body, below.body.name, below.end, below.axes @ _rotation(block, "2"))
        waiting = [b for b in waiting if b not in ready]
    if lost := [body for name, body in bodies.items() if name not in found]:
        lost[0].block.file.fail(lost[0].block.line, f"body {lost[0].name}: no block of 'orientation' places it")
    return found


def _bodies(structure: HtcBlock) -> dict[str, Body]:
    blocks = {block.word("name").lower(): block for block in structure.all("main_body")}
    found = {}
    for name, block in blocks.items():
        source = block
        for entry in block.commands("copy_main_body"):
            if (source := blocks.get(block.word("copy_main_body").lower(), block)) is block:
                entry.fail(f"unknown body '{' '.join(entry.words[1:])[:40]}'")
        found[name] = Body(name, source)
    return found


def _named(bodies: dict[str, Body], entry: Command) -> Body:
    name = " ".join(entry.words[1:2]).lower()
    if name not in bodies:
        entry.fail(f"unknown body '{name[:40]}': expected one of {', '.join(bodies)[:80]}")
    return bodies[name]


def _of(block: HtcBlock, which: int) -> Command:
    return block.command(*(f"{stem}{which}" for stem in BODY))


def _rotation(block: HtcBlock, which: str) -> Array:
    """Rotation (3, 3) by all lines of Euler's angles, each about the axes as turned so far."""
    names = [f"{stem}{which}_eulerang" for stem in BODY]
    found = np.eye(3)
    for entry in block.entries:
        if entry.words[0] in names:
            for axis, angle in enumerate(np.radians(entry.numbers(1, 3))):
                turn, c, s = np.eye(3), math.cos(angle), math.sin(angle)
                i, j = (axis + 1) % 3, (axis + 2) % 3
                turn[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
                found = found @ turn
        elif entry.words[0].endswith(("_eulerpar", "_axisangle", "_orientation")):
            entry.fail(f"expected {names[1]}: other forms of rotation are not read")
    return found


def _nodes(block: HtcBlock) -> Array:
    """Nodes (n, 4) of the axis: x, y, z [m], twist [deg]."""
    axis = block.block("c2_def")
    rows = axis.commands("sec")
    count = int(axis.command("nsec").numbers(1, 1)[0])
    if len(rows) != count or count < 2:
        axis.command("nsec").fail(f"expected as many lines 'sec', two or more, got {len(rows)}")
    for i, row in enumerate(rows, start=1):
        if row.numbers(1, 1)[0] != i:
            row.fail(f"expected section {i}, got {row.words[1]}")
    return np.array([row.numbers(2, 4) for row in rows])


def bending_stiffness(body: Body, along: Array) -> Array:
    """Stiffness (n, 2, 2) [N·m²] to curvatures of the deflections along the body's x and y at some distances (n,).

    A full matrix counts with its bending and axial part: at the point where forces along the axis are zero.
    """
    rows = body.sections[0]
    found = np.zeros((len(rows), 2, 2))
    full = rows.shape[1] == FULL
    if full:
        matrices = np.zeros((len(rows), 6, 6))
        matrices[:, *np.triu_indices(6)] = rows[:, 9:]
        part = (matrices + np.triu(matrices, 1).transpose(0, 2, 1))[:, 2:5, 2:5]
        bent = np.linalg.inv(np.linalg.inv(part)[:, 1:, 1:])
        found[:, 0, 0], found[:, 1, 1] = bent[:, 1, 1], bent[:, 0, 0]
        found[:, 0, 1] = found[:, 1, 0] = -bent[:, 0, 1]
    else:
        found[:, 0, 0], found[:, 1, 1] = rows[:, 8] * rows[:, 11], rows[:, 8] * rows[:, 10]
    angle = np.radians(rows[:, 6 if full else 16])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
    found = turn @ found @ turn.transpose(0, 2, 1)
    values = [np.interp(along, rows[:, 0], found[:, i, j]) for i in (0, 1) for j in (0, 1)]
    return np.array(values).T.reshape(-1, 2, 2)


def rayleigh(body: Body, size: int) -> Array:
    """Damping (2, 2, n) of deflections along x and y: its share of the mass [1/s] and of the stiffness [s]."""
    if body.damping is None:
        return np.zeros((2, 2, size))
    values = body.damping.numbers(1, 6)
    if np.any(values < 0.0):
        body.damping.fail("expected factors of 0 or more")
    pairs = np.array([[values[0], values[4]], [values[1], values[3]]])
    return np.repeat(pairs[:, :, None], size, axis=2)

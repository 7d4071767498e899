"""Modes of a machine: its support as a beam, the parts on top, and blades in multi-blade coordinates."""

import math
from typing import NamedTuple

import numpy as np

from windsysid._types import Array, Complex
from windsysid.errors import ConfigurationError
from windsysid.turbine.models.beam import BeamMatrices, BeamSection, beam_matrices
from windsysid.turbine.models.machine import DIRECTIONS, Machine, Support
from windsysid.turbine.models.rotor_motion import BLADES, TOP_SIZE, LinearEquations, mass_equations, rotor_equations

__all__ = ["MachineMode", "MachineModes", "TowerMode", "machine_modes", "tower_modes"]

TOWER_ELEMENTS, BASE_ELEMENTS = 30, 12
"""Setting: finite elements of the tower, and of what it stands on: the second mode is exact to 1e-5."""


MIN_SECOND_SHARE = 0.1
"""Setting: share of elastic energy side-side from which a further mode is the tower's second."""

MAX_ROTOR_SHIFT, MIN_TOWER_SHARE = 1.5, 0.25
"""Setting: largest factor between a tower's frequencies with rigid and with bending, turning blades, and smallest share
of elastic energy of its mode: light towers share modes with flapwise motion."""


MIN_VIBRATION = 0.1
"""Setting: imaginary part of an exponent over its size from which it is a mode: damping ratios up to 0.995."""

MIN_RATE = 1e-12
"""Setting: stiffness-proportional damping [s] in place of 0, whose flexibility would be infinite."""


class MachineMode(NamedTuple):
    """Frequency [Hz], damping ratio [1] and shares [1] of elastic energy: side-side, fore-aft, and blades by shape and
    part."""

    frequency: float
    damping: float
    side_side: float
    fore_aft: float
    blades: Array


class MachineModes(NamedTuple):
    """Modes of a machine with its rotor turning, by the moving part; None without blades."""

    side_side: MachineMode
    fore_aft: MachineMode
    second: MachineMode | None
    backward: MachineMode | None
    collective: MachineMode | None
    forward: MachineMode | None


class TowerMode(NamedTuple):
    """A mode of the tower with rigid blades and a rotor that stands, in one direction.

    Attributes
    ----------
    frequency
        [Hz].
    mass
        Modal mass [kg] where the shape is 1 at the tower top.
    tilt
        Slope of the shape at the top [rad/m].
    damping
        Ratio [1].
    damping_time
        Damping over elastic stiffness [s].
    """

    frequency: float
    mass: float
    tilt: float
    damping: float
    damping_time: float


class _SupportPlane(NamedTuple):
    """One direction of the support: matrices in the coordinates of `basis` (2n, m), and the top's rows of that."""

    matrices: BeamMatrices
    damping: Array
    basis: Array

    @property
    def top(self) -> Array:
        """Deflection and slope of the top (2, m)."""
        return self.basis[-2:]


def tower_modes(machine: Machine, direction: int, count: int = 2) -> list[TowerMode]:
    """Lowest modes of the tower in a direction, 0: side-side, 1: fore-aft, with rigid blades."""
    from scipy.linalg import eigh

    frame = _frame(machine, direction)
    top = _top(machine, 0.0)
    picked = np.array([[1.0, 0.0], [0.0, -1.0]]) if direction == 0 else np.eye(2)
    rows = [1, 2] if direction == 0 else [0, 3]
    ends = picked @ frame.top
    mass = frame.matrices.mass + ends.T @ top.mass[np.ix_(rows, rows)] @ ends
    elastic = frame.matrices.stiffness
    stiffness = elastic + frame.matrices.geometric + ends.T @ top.stiffness[np.ix_(rows, rows)] @ ends
    try:
        inverse, shapes = eigh(mass, stiffness, subset_by_index=(len(mass) - count, len(mass) - 1))
    except np.linalg.LinAlgError:
        raise ConfigurationError(
            f"{machine.name}: the tower buckles {DIRECTIONS[direction].replace('_', '-')} under its own weight: "
            f"expected a stiffness that carries it; check units of mass and stiffness ({machine.sources['tower']})"
        ) from None
    squares, shapes = 1.0 / inverse[::-1], shapes[:, ::-1] / np.sqrt(inverse[::-1])
    found = []
    for square, shape in zip(squares, shapes.T, strict=True):
        deflection, slope = frame.top @ shape
        omega, damping = math.sqrt(square), float(shape @ frame.damping @ shape)
        found.append(
            TowerMode(
                omega / (2.0 * math.pi), float(1.0 / deflection**2), float(slope / deflection), damping / (2.0 * omega),
                damping / float(shape @ elastic @ shape),
            )
        )  # fmt: skip
    return found


def machine_modes(machine: Machine, rotor_speed: float) -> MachineModes:
    """Modes of a machine with its rotor turning at a speed [rad/s]."""
    frames = [_frame(machine, i) for i in (0, 1)]
    sizes = [frame.basis.shape[1] for frame in frames]
    top = _top(machine, rotor_speed)
    motions = len(top.mass)
    size = sum(sizes) + motions - TOP_SIZE
    to_top = np.zeros((motions, size))
    to_top[[1, 2], : sizes[0]] = np.array([[1.0], [-1.0]]) * frames[0].top
    to_top[[0, 3], sizes[0] : sum(sizes)] = frames[1].top
    to_top[TOP_SIZE:, sum(sizes) :] = np.eye(motions - TOP_SIZE)
    M, C, K = (to_top.T @ part @ to_top for part in top)
    for frame, at in zip(frames, (0, sizes[0]), strict=True):
        own = slice(at, at + frame.basis.shape[1])
        M[own, own] += frame.matrices.mass
        C[own, own] += frame.damping
        K[own, own] += frame.matrices.stiffness + frame.matrices.geometric
    return _sorted(machine, _modes(machine, frames, LinearEquations(M, C, K)))


def _top(machine: Machine, rotor_speed: float) -> LinearEquations:
    """Equations of the parts on the tower; without blades if the rotor is a mass."""
    own = mass_equations(machine.top, machine.gravity)
    if machine.blade is None:
        return own
    found = rotor_equations(machine.blade, machine.top, rotor_speed, machine.gravity)
    for part, rotor in zip(own, found, strict=True):
        rotor[:TOP_SIZE, :TOP_SIZE] += part
    return found


def _frame(machine: Machine, direction: int) -> _SupportPlane:
    """Matrices of the support in one direction."""
    support = machine.support
    foot, top = support.foot, support.z[-1]
    nodes = np.linspace(foot, top, TOWER_ELEMENTS + 1)
    if foot > support.z[0]:
        nodes = np.concatenate([np.linspace(support.z[0], foot, BASE_ELEMENTS + 1)[:-1], nodes])
    section = BeamSection(
        support.z, support.stiffness[direction], support.shear, support.mass + support.water, support.mass, support.soil
    )
    mass = sum(mass for mass, _ in machine.top.masses)
    mass += BLADES * machine.blade.mass.sum() if machine.blade is not None else 0.0
    full = beam_matrices(nodes, section, support.points, mass, machine.gravity)
    basis = _basis(support, nodes, direction)
    matrices = BeamMatrices(*(basis.T @ part @ basis for part in full))
    if support.base is not None:
        ends = basis[:2]
        matrices = matrices._replace(stiffness=matrices.stiffness + ends.T @ support.base[direction] @ ends)
    if support.rayleigh is None:
        return _SupportPlane(matrices, _tower_damping(machine, full, nodes, basis, direction), basis)
    of_mass, rate = support.rayleigh[direction][0], np.maximum(support.rayleigh[direction][1], MIN_RATE)
    section = section._replace(
        bending=rate * section.bending, shear=rate * section.shear, inertia=of_mass * section.weight, soil=None
    )
    rates = beam_matrices(nodes, section, (), 0.0, 0.0)
    return _SupportPlane(matrices, basis.T @ (rates.stiffness + rates.mass) @ basis, basis)


def _basis(support: Support, nodes: Array, direction: int) -> Array:
    """Coordinates (2n, m) of the support: all of a beam's, or those of a model's shapes above the foot."""
    size = 2 * len(nodes)
    basis = np.eye(size)
    if support.shapes is not None:
        at = int(np.searchsorted(nodes, support.foot))
        height = nodes[-1] - support.foot
        t = (nodes[at:] - support.foot) / height
        basis = np.zeros((size, 2 * at + 4))
        basis[: 2 * at + 2, : 2 * at + 2] = np.eye(2 * at + 2)
        basis[2 * at :: 2, 2 * at], basis[2 * at :: 2, 2 * at + 1] = 1.0, t * height
        basis[2 * at + 1 :: 2, 2 * at + 1] = 1.0
        for i, coefficients in enumerate(support.shapes[direction]):
            shape = np.polynomial.Polynomial(coefficients)
            basis[2 * at :: 2, 2 * at + 2 + i] = shape(t)
            basis[2 * at + 1 :: 2, 2 * at + 2 + i] = shape.deriv()(t) / height
    return basis if support.base is not None else basis[:, 2:]


def _tower_damping(machine: Machine, full: BeamMatrices, nodes: Array, basis: Array, direction: int) -> Array:
    """Damping (m, m) of the tower from ratios that refer to it without its top mass, clamped at its foot.

    c_j = 2 ζ_j k_j/ω_j, where ω_j² = k_j/m_j and m_j lacks the mass on top (ElastoDyn's convention): with it, the ratio
    of the machine is ζ_j √(m_j/m), smaller by √(1 + top mass/m_j).
    """
    from scipy.linalg import eigh

    support = machine.support
    at = 2 * int(np.searchsorted(nodes, support.foot))
    tower = np.linspace(support.foot, support.z[-1], TOWER_ELEMENTS + 1)
    section = BeamSection(support.z, support.stiffness[direction], support.shear, support.mass, support.mass)
    alone = beam_matrices(tower, section, (), 0.0, 0.0)
    if support.shapes is not None:
        shapes = _basis(support._replace(base=None, z=np.array([support.foot, support.z[-1]])), tower, direction)[
            :, -2:
        ]
    else:
        K, M = alone.stiffness[2:, 2:], alone.mass[2:, 2:].copy()
        M[-2, -2] += sum(mass for mass, _ in machine.top.masses)
        shapes = np.vstack([np.zeros((2, 2)), eigh(K, M, subset_by_index=(0, 1))[1]])
    stiffness = shapes.T @ alone.stiffness @ shapes
    mass = np.einsum("ik,ij,jk->k", shapes, alone.mass, shapes)
    times = 2.0 * support.damping[direction] * np.sqrt(mass / np.diag(stiffness))
    modal = stiffness * (times[:, None] + times) / 2.0
    forces = np.zeros((len(basis), 2))
    forces[at:] = alone.stiffness @ shapes @ np.linalg.inv(stiffness)
    found = basis.T @ forces
    return np.asarray(found @ modal @ found.T)


def _modes(machine: Machine, frames: list[_SupportPlane], system: LinearEquations) -> list[MachineMode]:
    """Modes of the equations, by frequency."""
    from scipy.linalg import eig

    size = len(system.mass)
    upper = -np.linalg.solve(system.stiffness, np.hstack([system.damping, system.mass]))
    inverse, vectors = eig(np.vstack([upper, np.hstack([np.eye(size), np.zeros((size, size))])]))
    exponents = 1.0 / inverse
    found = []
    for i in np.argsort(exponents.imag):
        if exponents[i].imag > MIN_VIBRATION * abs(exponents[i]):
            value = complex(exponents[i])
            energies = _energies(machine, frames, vectors[:size, i])
            found.append(MachineMode(value.imag / (2.0 * math.pi), -value.real / abs(value), *energies))
    return found


def _energies(machine: Machine, frames: list[_SupportPlane], shape: Complex) -> tuple[float, float, Array]:
    """Shares of elastic energy: of the support side-side and fore-aft, and of the blades (k, 3)."""
    first = frames[0].basis.shape[1]
    both = first + frames[1].basis.shape[1]
    parts = [(frames[0], shape[:first]), (frames[1], shape[first:both])]
    tower = [float(np.real(np.conj(v) @ frame.matrices.stiffness @ v)) for frame, v in parts]
    blades = np.zeros((0, BLADES))
    if machine.blade is not None:
        amplitudes = np.abs(shape[both:].reshape(-1, BLADES)) ** 2
        blades = np.diag(machine.blade.stiffness)[:, None] * amplitudes * np.array([3.0, 1.5, 1.5])
    total = sum(tower) + blades.sum()
    return tower[0] / total, tower[1] / total, blades / total


def _sorted(machine: Machine, modes: list[MachineMode]) -> MachineModes:
    """Modes by the moving part: those of the tower near those with a rigid rotor; edgewise ones by energy."""
    side_side = _tower_mode(machine, modes, 0)
    fore_aft = _tower_mode(machine, [mode for mode in modes if mode is not side_side], 1)
    if machine.blade is None:
        return MachineModes(side_side, fore_aft, None, None, None, None)
    edge = machine.blade.edge
    whirls = sorted(modes, key=lambda mode: -float(mode.blades[edge, 1:].sum()))[:2]
    backward, forward = sorted(whirls, key=lambda mode: mode.frequency)
    collective = max(modes, key=lambda mode: float(mode.blades[edge, 0]))
    named = {id(mode) for mode in (side_side, fore_aft, *whirls, collective)}
    second = next((mode for mode in modes if id(mode) not in named and mode.side_side > MIN_SECOND_SHARE), None)
    return MachineModes(side_side, fore_aft, second, backward, collective, forward)


def _tower_mode(machine: Machine, modes: list[MachineMode], direction: int) -> MachineMode:
    """The mode with most of the tower's energy in a direction, among those near its mode with a rigid rotor."""
    rigid = tower_modes(machine, direction, 1)[0].frequency
    near = [mode for mode in modes if 1.0 / MAX_ROTOR_SHIFT < mode.frequency / rigid < MAX_ROTOR_SHIFT]
    found = max(near, key=lambda mode: mode[2 + direction], default=None)
    if found is None or found[2 + direction] < MIN_TOWER_SHARE:
        name = DIRECTIONS[direction].replace("_", "-")
        raise ConfigurationError(
            f"{machine.name}: expected a mode of the tower {name} near {rigid:.3g} Hz, found none but the "
            f"blades'; check masses, stiffness and rotor speed ({machine.sources['tower']})"
        )
    return found

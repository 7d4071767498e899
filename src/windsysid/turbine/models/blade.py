"""A blade as point masses that move in its shapes: those of a model's polynomials, or those of its sections' beam.

Sections are twisted: a shape's curvature is about the principal axes of each section, and its deflection is the double
integral of that, out of plane and in plane.
"""

from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.turbine.models.machine import Blade

__all__ = ["BLADE_ELEMENTS", "BladeSection", "blade_of_beam", "blade_of_shapes"]

BLADE_ELEMENTS = 60
"""Setting: elements of a blade that bends as a beam, whose frequencies are then exact to 1e-3."""


class BladeSection(NamedTuple):
    """Properties of a blade at its nodes: distance from the root and length [m], mass [kg], EI flapwise and edgewise
    [N·m²], twist [rad]."""

    span: Array
    length: Array
    mass: Array
    flap: Array
    edge: Array
    twist: Array


def blade_of_shapes(
    section: BladeSection, shapes: list[np.polynomial.Polynomial], edgewise: list[bool], damping: Array, root: float
) -> Blade:
    """The blade of a model that knows its shapes, with the model's own rule of integration.

    Parameters
    ----------
    section
        At the nodes of the model, which are the middles of elements; the last one is the tip, of length 0.
    shapes
        Polynomials in the distance from the root as a share of the blade's length, 1 at the tip.
    edgewise
        Whether each is edgewise.
    damping
        Ratio of each [1].
    root
        Distance of the root from the rotor's centre [m].

    Notes
    -----
    ElastoDyn integrates by rectangles, of which the nodes are the middles; with few nodes its edgewise modal mass is 1
    to 2 % above that of an exact integral. OpenFAST, ElastoDyn.f90, routine Coeff.
    """
    total = float(section.length.sum())
    x = section.span / total
    curvature = np.array([shape.deriv(2)(x) / total**2 for shape in shapes])
    c, s = np.cos(section.twist), np.sin(section.twist)
    directions = np.array([[s, c] if edge else [c, -s] for edge in edgewise])
    slope, displacement = _integrals(curvature[:, None] * directions, section.length)
    stiffness = np.zeros((len(shapes), len(shapes)))
    for i, first in enumerate(edgewise):
        for j, second in enumerate(edgewise):
            if first == second:
                bending = section.edge if first else section.flap
                stiffness[i, j] = np.sum(bending * curvature[i] * curvature[j] * section.length)
    own = np.array([shape(x) for shape in shapes])
    mass = np.sum(section.mass * own**2, axis=1)
    times = 2.0 * damping * np.sqrt(mass / np.diag(stiffness))
    edge = edgewise.index(True)
    return Blade(
        root + section.span, section.mass, displacement.transpose(2, 0, 1), _shortening(slope, section.length),
        stiffness, stiffness * (times[:, None] + times) / 2.0, edge, float(shapes[edge].deriv()(1.0)) / total,
    )  # fmt: skip


def blade_of_beam(length: Array, mass: Array, bending: Array, damping: Array, root: float) -> Blade:
    """The blade with the three lowest modes of a straight cantilever beam of twisted sections.

    Parameters
    ----------
    length, mass
        Of elements from the root on (p,) [m, kg].
    bending, damping
        Bending stiffness [N·m²] and damping [N·m²·s] of the elements, by deflections out of plane (downwind) and in
        plane (against the rotation) (p, 2, 2).
    root
        Distance of the root from the rotor's centre [m].

    Raises
    ------
    ConfigurationError
        If not one of the three modes moves in plane.

    Notes
    -----
    Unknowns are the curvatures κ of the elements, of which deflections w = T κ are integrals. Modes maximise
    κᵀ Tᵀ M T κ over Σ κᵀ EI κ ℓ. Shear and torsion are left out, as ElastoDyn does.
    """
    from scipy.linalg import eigh

    length, mass = np.append(length, 0.0), np.append(mass, 0.0)
    size = len(length)
    slopes, deflections = (np.kron(part.T, np.eye(2)) for part in _integrals(np.eye(size), length))
    energy = np.zeros((2, 2 * size, 2 * size))
    for i, h in enumerate(length[:-1]):
        here = slice(2 * i, 2 * i + 2)
        energy[:, here, here] = h * bending[i], h * damping[i]
    inner = slice(0, 2 * size - 2)
    inertia = deflections.T @ (np.repeat(mass, 2)[:, None] * deflections)
    _, found = eigh(inertia[inner, inner], energy[0, inner, inner], subset_by_index=(2 * size - 5, 2 * size - 3))
    modes = np.vstack([found[:, ::-1], np.zeros((2, 3))])
    shapes = (deflections @ modes).reshape(size, 2, 3)
    shares = np.einsum("p,pdk->dk", mass, shapes**2)
    edge = int(np.argmax(shares[1] / shares.sum(axis=0)))
    if shares[1, edge] < shares[0, edge]:
        raise ConfigurationError("blade: expected an edgewise mode among the three lowest, found none; check stiffness")
    main = [1 if k == edge else 0 for k in range(3)]
    scale = 1.0 / np.array([shapes[-1, main[k], k] for k in range(3)])
    modes, shapes = modes * scale, shapes * scale
    slope = (slopes @ modes).reshape(size, 2, 3).transpose(2, 1, 0)
    stiffness, rates = (modes.T @ part @ modes for part in energy)
    return Blade(
        root + np.cumsum(length) - length / 2.0, mass, shapes.transpose(0, 2, 1), _shortening(slope, length), stiffness,
        rates, edge, float(slope[edge, 1, -1]),
    )  # fmt: skip


def _shortening(slope: Array, length: Array) -> Array:
    """Motion towards the root (p, k, k) of shapes with slopes (k, 2, p)."""
    products = np.einsum("kdp,ldp->klp", slope, slope) * length
    return np.asarray((np.cumsum(products, axis=2) - products / 2.0).transpose(2, 0, 1))


def _integrals(curvature: Array, length: Array) -> tuple[Array, Array]:
    """Slope and deflection (…, p) of a curvature at the middles of elements, by rectangles."""
    half = curvature * length / 2.0
    slope = np.cumsum(2.0 * half, axis=-1) - half
    step = slope * length / 2.0
    return slope, np.asarray(np.cumsum(2.0 * step, axis=-1) - step)

"""A blade as point masses that move in its shapes: those of a model's polynomials, or those of a beam.

Sections are twisted: a shape's curvature is about the principal axes of each section, and its deflection is the double
integral of that, out of plane and in plane.
"""

from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.turbine.models.machine import Blade

__all__ = ["BladeSection", "blade_of_shapes"]


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
    products = np.einsum("kdp,ldp->klp", slope, slope) * section.length
    shortening = np.cumsum(products, axis=2) - products / 2.0
    edge = edgewise.index(True)
    return Blade(
        root + section.span, section.mass, displacement.transpose(2, 0, 1), shortening.transpose(2, 0, 1), stiffness,
        stiffness * (times[:, None] + times) / 2.0, edge, float(shapes[edge].deriv()(1.0)) / total,
    )  # fmt: skip


def _integrals(curvature: Array, length: Array) -> tuple[Array, Array]:
    """Slope and deflection (…, p) of a curvature at the middles of elements, by rectangles."""
    half = curvature * length / 2.0
    slope = np.cumsum(2.0 * half, axis=-1) - half
    step = slope * length / 2.0
    return slope, np.asarray(np.cumsum(2.0 * step, axis=-1) - step)

"""A beam of varying section, by finite elements: stiffness, geometric stiffness and mass.

An element's stiffness is the inverse of its flexibility, ∫ x²/EI + 1/κGA, ∫ x/EI, ∫ 1/EI over its length, so steps of
the section within an element are exact. Mass and the softening by an axial load N, −∫ N w'² dz, take cubic shapes.
Source: Przemieniecki, Theory of Matrix Structural Analysis (1968), chapters 11 and 15.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.turbine.models.machine import PointMass

__all__ = ["BeamMatrices", "BeamSection", "beam_matrices", "cubic_shapes"]

QUADRATURE_POINTS = 4
"""Setting: points of Gauss's quadrature between two stations: exact for polynomials of the order 7."""
_GAUSS = np.polynomial.legendre.leggauss(QUADRATURE_POINTS)


class BeamSection(NamedTuple):
    """Properties of a beam at stations z (n,): EI [N·m²], κGA [N], inertia per length and weight per length [kg/m],
    lateral stiffness of the ground [N/m²]."""

    z: Array
    bending: Array
    shear: Array
    inertia: Array
    weight: Array
    soil: Array | None = None


class BeamMatrices(NamedTuple):
    """Matrices (2n, 2n) of deflections and slopes of n nodes: stiffness, geometric stiffness, mass."""

    stiffness: Array
    geometric: Array
    mass: Array


def cubic_shapes(t: Array, h: float) -> tuple[Array, Array]:
    """Hermite's cubics (4, p) of deflection and slope at both ends of an element of length h, and their slopes."""
    w = np.array([1 - 3 * t**2 + 2 * t**3, h * (t - 2 * t**2 + t**3), 3 * t**2 - 2 * t**3, h * (t**3 - t**2)])
    slopes = [(6 * t**2 - 6 * t) / h, 1 - 4 * t + 3 * t**2, (6 * t - 6 * t**2) / h, 3 * t**2 - 2 * t]
    return w, np.array(slopes)


def beam_matrices(
    nodes: Array, section: BeamSection, points: tuple[PointMass, ...], top_mass: float, gravity: float
) -> BeamMatrices:
    """Assemble the matrices of a beam that stands upright, with point masses on it and a mass on its top.

    Parameters
    ----------
    nodes
        Heights (n,) [m], ascending.
    section
        Its properties.
    points
        Masses on it; their weight and inertia count.
    top_mass
        Mass whose weight only counts here [kg].
    gravity
        [m/s²].
    """
    size = 2 * len(nodes)
    K, G, M = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    above = _weight_above(section, points, top_mass, gravity)
    for e, (a, b) in enumerate(pairwise(nodes)):
        z, w = _quadrature(section.z, a, b)
        here = slice(2 * e, 2 * e + 4)
        shapes, slopes = cubic_shapes((z - a) / (b - a), b - a)
        K[here, here] += _element_stiffness(section, b, b - a, z, w)
        if section.soil is not None:
            K[here, here] += (shapes * w * np.interp(z, section.z, section.soil)) @ shapes.T
        M[here, here] += (shapes * w * np.interp(z, section.z, section.inertia)) @ shapes.T
        G[here, here] -= (slopes * w * above(z)) @ slopes.T
    for point in points:
        shapes, slopes, here = _at(nodes, point.z)
        M[here, here] += point.mass * np.outer(shapes, shapes) + point.inertia * np.outer(slopes, slopes)
    return BeamMatrices(K, G, M)


def _element_stiffness(section: BeamSection, top: float, length: float, z: Array, w: Array) -> Array:
    """Stiffness (4, 4) of an element to `top` from its flexibility, by quadrature at z with the weights w."""
    bending = w / np.interp(z, section.z, section.bending)
    arm = top - z
    shear = np.sum(w / np.interp(z, section.z, section.shear)) if np.all(np.isfinite(section.shear)) else 0.0
    first = np.sum(bending * arm)
    flexibility = np.array([[np.sum(bending * arm**2) + shear, first], [first, np.sum(bending)]])
    rigid = np.array([[-1.0, -length, 1.0, 0.0], [0.0, -1.0, 0.0, 1.0]])
    return np.asarray(rigid.T @ np.linalg.inv(flexibility) @ rigid)


def _quadrature(stations: Array, low: float, high: float) -> tuple[Array, Array]:
    """Points and weights between `low` and `high`, in parts between stations."""
    cuts = np.unique([low, *stations[(stations > low) & (stations < high)], high])
    half = np.diff(cuts)[:, None] / 2.0
    return (cuts[:-1, None] + half + half * _GAUSS[0]).ravel(), (half * _GAUSS[1]).ravel()


def _at(nodes: Array, z: float) -> tuple[Array, Array, slice]:
    """Shapes (4,) and slopes (4,) at a height, and where its element stands in the matrices."""
    e = min(max(int(np.searchsorted(nodes, z, side="right")) - 1, 0), len(nodes) - 2)
    h = nodes[e + 1] - nodes[e]
    shapes, slopes = cubic_shapes(np.array([(z - nodes[e]) / h]), h)
    return shapes[:, 0], slopes[:, 0], slice(2 * e, 2 * e + 4)


def _weight_above(
    section: BeamSection, points: tuple[PointMass, ...], top_mass: float, gravity: float
) -> Callable[[Array], Array]:
    """The weight [N] above a height."""
    parts = np.diff(section.z) * (section.weight[1:] + section.weight[:-1]) / 2.0
    below = np.concatenate([[0.0], np.cumsum(parts)])

    def above(z: Array) -> Array:
        i = np.clip(np.searchsorted(section.z, z, side="right") - 1, 0, len(section.z) - 2)
        t = z - section.z[i]
        slope = (section.weight[i + 1] - section.weight[i]) / (section.z[i + 1] - section.z[i])
        lower = below[i] + t * (section.weight[i] + slope * t / 2.0)
        carried = sum((point.mass * (point.z > z) for point in points), np.zeros_like(z))
        return np.asarray(gravity * (top_mass + below[-1] - lower + carried))

    return above

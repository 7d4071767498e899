"""A machine as its model describes it: support, masses on top, blades."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.mechanics.tower import DIRECTIONS

__all__ = ["DIRECTIONS", "Blade", "Machine", "PointMass", "Support", "Top"]


class PointMass(NamedTuple):
    """Height [m], mass [kg] and inertia about a horizontal axis [kg·m²] of the parts on the support."""

    z: float
    mass: float
    inertia: float


class Support(NamedTuple):
    """Tower and its foundation, as one beam. Directions are side-side and fore-aft.

    Attributes
    ----------
    z
        Stations (n,) [m], ascending; between them properties are linear.
    mass, water
        Mass of the structure and mass that water adds (n,) [kg/m].
    stiffness
        Bending stiffness EI (2, n) [N·m²].
    shear
        Shear stiffness κGA (n,) [N]; infinite for Euler-Bernoulli's beam.
    points
        Masses on it.
    base
        Stiffness of the foundation (2, 2, 2) to deflection and slope, [N/m, N, N·m/rad]; None: clamped.
    foot
        Height [m] of the foot of the tower, above which it is damped and has `shapes`.
    damping
        Damping ratios (2, 2) of the first two modes of the tower without top mass [1].
    shapes
        Coefficients (2, 2, 7) of polynomials in the height above the foot, as a share of the tower's, to which a model
        restricts the tower; None: it bends as a beam does.
    soil
        Lateral stiffness of the ground along the beam (n,) [N/m²]; None: none.
    rayleigh
        Damping by direction (2, 2, n): its share of the mass [1/s] and of the stiffness [s], in place of `damping`;
        None: `damping` holds.
    """

    z: Array
    mass: Array
    water: Array
    stiffness: Array
    shear: Array
    points: tuple[PointMass, ...]
    base: Array | None
    foot: float
    damping: Array
    shapes: Array | None
    soil: Array | None = None
    rayleigh: Array | None = None


class Blade(NamedTuple):
    """One blade as point masses that move in some shapes.

    Attributes
    ----------
    radius
        Distance from the rotor's centre along the blade (p,) [m].
    mass
        (p,) [kg].
    displacement
        Out of plane (downwind) and in plane (against the rotation) per unit of each shape (p, k, 2) [1].
    shortening
        Motion towards the root (p, k, k) [1/m]: half of it times the product of two amplitudes.
    stiffness, damping
        (k, k) [N/m, N·s/m].
    edge
        Index of the first edgewise shape.
    tip_slope
        In-plane slope of that shape at the tip [1/m].
    """

    radius: Array
    mass: Array
    displacement: Array
    shortening: Array
    stiffness: Array
    damping: Array
    edge: int
    tip_slope: float


class Top(NamedTuple):
    """Parts on the tower, without blades.

    Attributes
    ----------
    masses
        (mass [kg], position from the tower top (3,) [m]: downwind, to the right looking upwind, up).
    inertia
        (2, 2) [kg·m²] about the centres of these masses, about the axes downwind and to the right.
    apex
        Rotor centre from the tower top (3,) [m].
    shaft
        Unit vector (3,) downwind along the shaft.
    cone
        Angle [rad] by which the blades lean downwind.
    sensor
        Nacelle accelerometer from the tower top (3,) [m].
    """

    masses: tuple[tuple[float, Array], ...]
    inertia: Array
    apex: Array
    shaft: Array
    cone: float = 0.0
    sensor: Array = np.zeros(3)


class Machine(NamedTuple):
    """A machine as its model describes it.

    Attributes
    ----------
    name, program
        Of the model, and what it was written for.
    support, top
        See there.
    blade
        One of its equal blades; None: the rotor is among the masses of the top.
    blades
        Their number.
    rotor_speed
        Usual one [rad/s].
    gravity
        [m/s²].
    offshore
        True in the sea.
    outputs
        Channels that the model writes.
    sources
        File and lines of the numbers, by topic: tower, top, blade, rotor_speed, gravity, outputs, damping.
    files
        All files that were read.
    assumed
        What the model does not have.
    """

    name: str
    program: str
    support: Support
    top: Top
    blade: Blade | None
    blades: int
    rotor_speed: float
    gravity: float
    offshore: bool
    outputs: tuple[str, ...]
    sources: dict[str, str]
    files: tuple[Path, ...] = ()
    assumed: tuple[str, ...] = ()

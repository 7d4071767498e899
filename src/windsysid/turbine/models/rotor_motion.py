"""Linear equations of three equal blades on a tower top, in multi-blade coordinates.

Every point of the rotor moves by r(ξ, t), ξ being the motion of the top and the collective, cosine and sine parts of
the blades' amplitudes. Lagrange's equations, Σ m (∂r/∂ξ)ᵀ (r̈ + g) = Q, with r = r₀(t) + J(t) ξ + ½ ξᵀ H(t) ξ, are to
first order

    M = Σ m JᵀJ,    C = 2 Σ m Jᵀ J̇,    K = Σ m [Jᵀ J̈ + H · (r̈₀ + g)],

averaged over a turn. H holds the shortening of bent blades and the second order of rotations, hence centrifugal
stiffening and the weight of what leans. Source: Bir, NREL/CP-500-42553 (2008); Skjoldan and Hansen, On the similarity
of the Coleman and Lyapunov-Floquet transformations, J. Sound Vib. 327 (2009).
"""

import math
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.turbine.models.machine import Blade, Top

__all__ = ["BLADES", "TOP_SIZE", "LinearEquations", "mass_equations", "rotor_equations"]

BLADES = 3
"""Setting: number of blades of the transformation."""

TOP_SIZE = 4
"""Setting: motions of the tower top: downwind, to the right looking upwind, and the rotations about these axes."""

AZIMUTHS = 12
"""Setting: azimuths of the average; products of J have four harmonics, so that it is exact."""

_PARTS = np.array([3.0, 1.5, 1.5])
"""Σ of 1, cos² and sin² over three blades."""


class LinearEquations(NamedTuple):
    """M, C and K (n, n) of M ξ̈ + C ξ̇ + K ξ = 0."""

    mass: Array
    damping: Array
    stiffness: Array


def mass_equations(top: Top, gravity: float) -> LinearEquations:
    """M, C, K (4, 4) of the masses on the tower top; their weight above the top counts, that on it does not."""
    M, K = np.zeros((TOP_SIZE, TOP_SIZE)), np.zeros((TOP_SIZE, TOP_SIZE))
    for mass, position in top.masses:
        J, H = _carried(position[None])
        M += mass * J[0] @ J[0].T
        K += mass * gravity * H[0, :, :, 2]
    M[2:, 2:] += top.inertia
    return LinearEquations(M, np.zeros_like(M), K)


def rotor_equations(blade: Blade, top: Top, rotor_speed: float, gravity: float) -> LinearEquations:
    """M, C, K (4 + 3k, 4 + 3k) of the motion of the top and of k shapes of three blades.

    The order is that of the motions of the top, then collective, cosine and sine part of each shape.
    """
    k = len(blade.stiffness)
    turns = [_blades_at(blade, top, 2.0 * math.pi * i / AZIMUTHS) for i in range(AZIMUTHS)]
    r, J, H = (np.array([turn[i] for turn in turns]) for i in range(3))
    mass = np.tile(blade.mass, BLADES) / AZIMUTHS
    J1 = rotor_speed * _derivative(J)
    J2 = rotor_speed * _derivative(J1)
    load = rotor_speed**2 * _derivative(_derivative(r)) + np.array([0.0, 0.0, gravity])
    M = np.einsum("p,npic,npjc->ij", mass, J, J)
    C = 2.0 * np.einsum("p,npic,npjc->ij", mass, J, J1)
    K = np.einsum("p,npic,npjc->ij", mass, J, J2) + np.einsum("p,npijc,npc->ij", mass, H, load)
    own = slice(TOP_SIZE, TOP_SIZE + BLADES * k)
    turning = np.zeros((BLADES, BLADES))
    turning[1, 2], turning[2, 1] = 1.5 * rotor_speed, -1.5 * rotor_speed
    C[own, own] += np.kron(blade.damping, np.diag(_PARTS))
    K[own, own] += np.kron(blade.stiffness, np.diag(_PARTS)) + np.kron(blade.damping, turning)
    return LinearEquations(M, C, K)


def _blades_at(blade: Blade, top: Top, azimuth: float) -> tuple[Array, Array, Array]:
    """r₀ (3p, 3), J (3p, n, 3) and H (3p, n, n, 3) at an azimuth."""
    up = np.cross(top.shaft, [0.0, 1.0, 0.0])
    up = np.asarray(up / np.linalg.norm(up))
    side, parts = np.cross(top.shaft, up), []
    for b in range(BLADES):
        psi = azimuth + 2.0 * math.pi * b / BLADES
        radial = up * math.cos(psi) + side * math.sin(psi)
        span = math.cos(top.cone) * radial + math.sin(top.cone) * top.shaft
        back = up * math.sin(psi) - side * math.cos(psi)
        axes = np.array([math.cos(top.cone) * top.shaft - math.sin(top.cone) * radial, back])
        weights = np.array([1.0, math.cos(psi), math.sin(psi)])
        position = top.apex + blade.radius[:, None] * span
        moves = np.einsum("pkd,dc,m->pkmc", blade.displacement, axes, weights).reshape(len(position), -1, 3)
        J, H = _carried(position, moves)
        inward = np.einsum("pkl,m,n->pkmln", blade.shortening, weights, weights)
        H[:, TOP_SIZE:, TOP_SIZE:] -= inward.reshape(*H[:, TOP_SIZE:, TOP_SIZE:, 0].shape)[..., None] * span
        parts.append((position, J, H))
    r, J, H = (np.concatenate(each) for each in zip(*parts, strict=True))
    return r, J, H


def _carried(position: Array, moves: Array | None = None) -> tuple[Array, Array]:
    """J (p, n, 3) and H (p, n, n, 3) of points (p, 3) on the top that move by `moves` (p, n − 4, 3) on it."""
    moves = np.zeros((len(position), 0, 3)) if moves is None else moves
    axes = np.eye(3)[:2]
    turned = np.cross(axes, position[:, None])
    J = np.concatenate([np.broadcast_to(axes, (len(position), 2, 3)), turned, moves], axis=1)
    H = np.zeros((*J.shape[:2], J.shape[1], 3))
    for i, axis in enumerate(axes, start=2):
        half = np.cross(axis, turned) / 2.0
        H[:, i, 2:TOP_SIZE] += half
        H[:, 2:TOP_SIZE, i] += half
        H[:, i, TOP_SIZE:] = H[:, TOP_SIZE:, i] = np.cross(axis, moves) if moves.shape[1] else moves
    return J, H


def _derivative(values: Array) -> Array:
    """∂/∂ψ of values (12, …) at equidistant azimuths, by their harmonics."""
    found = np.fft.rfft(values, axis=0)
    orders = np.arange(len(found)).reshape(-1, *[1] * (values.ndim - 1))
    orders = np.where(orders == AZIMUTHS // 2, 0, orders)
    return np.asarray(np.fft.irfft(1j * orders * found, n=AZIMUTHS, axis=0))

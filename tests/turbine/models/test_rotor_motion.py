"""The rotor in multi-blade coordinates against closed forms of a hinged blade."""

import math

import numpy as np
import pytest

from windsysid.turbine.models.machine import Blade, Top
from windsysid.turbine.models.rotor_motion import TOP_SIZE, mass_equations, rotor_equations

SPEED, OFFSET, ARM, MASS, SPRING = 1.3, 2.0, 20.0, 500.0, 4e6
FLAT = Top((), np.zeros((2, 2)), np.zeros(3), np.array([1.0, 0.0, 0.0]))


def hinged(direction: int) -> Blade:
    """A point mass on a massless arm, hinged out of plane (0) or in plane (1); the coordinate is the angle."""
    moves = np.zeros((1, 1, 2))
    moves[0, 0, direction] = ARM
    return Blade(
        np.array([OFFSET + ARM]), np.array([MASS]), moves, np.full((1, 1, 1), ARM), np.array([[SPRING]]),
        np.zeros((1, 1)), 0, 0.0,
    )  # fmt: skip


@pytest.mark.parametrize(("direction", "share"), [(1, OFFSET / ARM), (0, 1.0 + OFFSET / ARM)])
def test_a_turning_hinged_blade_stiffens_and_whirls(direction: int, share: float):
    """ω² = k/I + Ω² d/ℓ in plane and k/I + Ω² (1 + d/ℓ) out of plane; whirls in the fixed frame are at ω ∓ Ω."""
    found = rotor_equations(hinged(direction), FLAT, SPEED, 0.0)
    own = slice(TOP_SIZE, None)
    M, C, K = (part[own, own] for part in found)
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    frequencies = np.sort(np.linalg.eigvals(A).imag)[3:]
    omega = math.sqrt(SPRING / (MASS * ARM**2) + share * SPEED**2)
    assert frequencies == pytest.approx(sorted([omega - SPEED, omega, omega + SPEED]), rel=1e-9)


def test_a_rotor_at_rest_is_carried_as_a_mass():
    """Three blades are a point mass at the hub with the inertia of a ring."""
    found = rotor_equations(hinged(1), FLAT, 0.0, 9.81)
    top = found.mass[:TOP_SIZE, :TOP_SIZE]
    polar = 3.0 * MASS * (OFFSET + ARM) ** 2
    assert top == pytest.approx(np.diag([3.0 * MASS, 3.0 * MASS, polar, polar / 2.0]), abs=1e-6 * polar)


def test_weight_above_the_tower_top_overturns():
    centre = np.array([0.5, 0.0, 2.0])
    found = mass_equations(FLAT._replace(masses=((1000.0, centre),)), 10.0)
    assert found.stiffness[2, 2] == pytest.approx(-1000.0 * 10.0 * 2.0)
    assert found.stiffness[3, 3] == pytest.approx(-1000.0 * 10.0 * 2.0)
    assert found.mass[0, 3] == pytest.approx(1000.0 * 2.0)

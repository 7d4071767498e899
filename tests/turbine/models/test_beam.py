"""The beam against closed forms."""

import math

import numpy as np
import pytest
from scipy.linalg import eigh

from windsysid.turbine.models.beam import BeamSection, beam_matrices
from windsysid.turbine.models.machine import PointMass

LENGTH, BENDING, MASS = 80.0, 4e11, 4000.0
NODES = np.linspace(0.0, LENGTH, 31)


def uniform(mass: float = MASS, weight: float = 0.0) -> BeamSection:
    ends = np.array([0.0, LENGTH])
    one = np.ones(2)
    return BeamSection(ends, BENDING * one, np.full(2, np.inf), mass * one, weight * one)


def exact_frequency(ratio: float) -> float:
    """ω of a cantilever with a mass of `ratio` of its own at the tip: 1 + cos λ cosh λ = ratio λ (sin λ cosh λ − …)."""
    low, high = 0.5, 1.88
    for _ in range(80):
        x = 0.5 * (low + high)
        value = 1 + math.cos(x) * math.cosh(x)
        value -= ratio * x * (math.sin(x) * math.cosh(x) - math.cos(x) * math.sinh(x))
        low, high = (x, high) if value > 0.0 else (low, x)
    return low**2 * math.sqrt(BENDING / (MASS * LENGTH**4))


@pytest.mark.parametrize("ratio", [0.0, 0.5, 2.0])
def test_a_cantilever_with_a_tip_mass_has_the_frequency_of_its_closed_form(ratio: float):
    points = (PointMass(LENGTH, ratio * MASS * LENGTH, 0.0),)
    found = beam_matrices(NODES, uniform(), points, 0.0, 0.0)
    omega = math.sqrt(eigh(found.stiffness[2:, 2:], found.mass[2:, 2:], eigvals_only=True)[0])
    expected = exact_frequency(ratio) if ratio else 1.8751040687**2 * math.sqrt(BENDING / (MASS * LENGTH**4))
    assert omega == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("weight", "top", "critical"),
    [(0.0, 1.0, math.pi**2 / 4.0 * BENDING / LENGTH**2), (1.0, 0.0, 7.8373 * BENDING / LENGTH**3)],
)
def test_gravity_softens_a_beam_until_it_buckles_at_eulers_load(weight: float, top: float, critical: float):
    """Under a load at its top, and under its own weight (Greenhill 1881)."""
    found = beam_matrices(NODES, uniform(weight=weight), (), top, 1.0)
    inverse = eigh(-found.geometric[2:, 2:], found.stiffness[2:, 2:], eigvals_only=True)[-1]
    assert 1.0 / inverse == pytest.approx(critical, rel=2e-5)


def test_a_step_within_an_element_is_exact():
    """EI three times as large in the lower 0.4 of the length: deflection by a force at the top."""
    at = 0.4 * LENGTH
    z = np.array([0.0, at - 1e-9, at, LENGTH])
    stiffness = BENDING * np.array([3.0, 3.0, 1.0, 1.0])
    section = BeamSection(z, stiffness, np.full(4, np.inf), np.ones(4), np.zeros(4))
    found = beam_matrices(np.array([0.0, 0.3 * LENGTH, LENGTH]), section, (), 0.0, 0.0)
    deflection = np.linalg.solve(found.stiffness[2:, 2:], np.array([0.0, 0.0, 1.0, 0.0]))[2]
    upper = LENGTH - at
    exact = upper**3 / (3 * BENDING) + (LENGTH**3 - upper**3) / (9 * BENDING)
    assert deflection == pytest.approx(exact, rel=1e-6)


def test_shear_adds_its_own_flexibility():
    section = uniform()._replace(shear=np.full(2, 5e9))
    found = beam_matrices(NODES, section, (), 0.0, 0.0)
    force = np.zeros(len(found.stiffness) - 2)
    force[-2] = 1.0
    deflection = np.linalg.solve(found.stiffness[2:, 2:], force)[-2]
    assert deflection == pytest.approx(LENGTH**3 / (3 * BENDING) + LENGTH / 5e9, rel=1e-9)

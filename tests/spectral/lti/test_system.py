"""One's own equations linearised about a working point, against closed forms."""

import numpy as np
import pytest
import sympy as sp

from tests.identification.test_own_equations import SPRING, sensors
from windsysid import ConfigurationError
from windsysid.mechanics.compile import compile_model
from windsysid.models import Equations, Reading
from windsysid.spectral.lti.system import is_stable, linearise, low_rank, resolve

COMPILED = compile_model(SPRING, sensors())
VALUES = {"m": 2.0, "c": 0.8, "k": 50.0}
P = np.array([[VALUES[name] for name in COMPILED.parameters]])
NOTHING, REST = np.zeros(0), np.zeros(2)


def test_a_spring_is_its_matrices():
    found = linearise(COMPILED, P, NOTHING, np.zeros(1), REST)
    row = [-25.0, -0.4]
    expected = [[0.0, 1.0], row], [[0.0], [0.5]], [[1.0, 0.0], row], [[0.0], [0.5]]
    for matrix, value in zip(found, expected, strict=True):
        np.testing.assert_allclose(matrix[0], value, atol=1e-12)
    np.testing.assert_allclose(
        found.block[0], np.block([[*map(np.array, expected[:2])], [*map(np.array, expected[2:])]])
    )


def test_the_working_point_balances_a_constant_load():
    q, v, k, c, force = sp.symbols("q v k c force", real=True)
    hard = Equations("hard", (q, v), (), (k, c), (force,), (v, force - c * v - k * q - q**3))
    compiled = compile_model(hard, (Reading("position", q, 0.1),))
    p = np.array([[{"k": 1.0, "c": 0.1}[name] for name in compiled.parameters]])
    found = linearise(compiled, p, NOTHING, np.array([10.0]), REST)  # q + q³ = 10 at q = 2
    assert found.A[0, 1, 0] == pytest.approx(-(1.0 + 3.0 * 2.0**2))
    fleeing = Equations("fleeing", (q, v), (), (k, c), (force,), (v, force - c * v + k + q**2))
    with pytest.raises(ConfigurationError, match="expected a state at rest near the prior's mean"):
        linearise(compile_model(fleeing, (Reading("position", q, 0.1),)), p, NOTHING, np.zeros(1), REST + 0.5)


def test_the_resolvent_is_the_transfer_function():
    s = 2j * np.pi * np.array([0.1, 0.8, 3.0])
    left, right, T = resolve(linearise(COMPILED, P, NOTHING, np.zeros(1), REST), s)
    position = 1.0 / (2.0 * s**2 + 0.8 * s + 50.0)
    np.testing.assert_allclose(T[:, :, 0], np.column_stack([position, s**2 * position]))
    np.testing.assert_allclose(right[:, :, 0], np.column_stack([position, s * position]))
    np.testing.assert_allclose(left[:, 0, 1], 2.0 * position)  # a rate of the velocity is a force over the mass
    unstable = P * np.where(np.array(COMPILED.parameters) == "c", -1.0, 1.0)
    with pytest.raises(np.linalg.LinAlgError, match="unstable"):
        resolve(linearise(COMPILED, unstable, NOTHING, np.zeros(1), REST), s)


def test_derivatives_of_low_rank_are_sums_of_few_products():
    rng = np.random.default_rng(1)
    one = np.outer(rng.normal(size=4), rng.normal(size=3))
    two = one + 1e6 * np.outer([0.0, 0.0, 0.0, 1.0], rng.normal(size=3))
    slopes = low_rank(np.array([one, two, np.zeros((4, 3))]))
    assert slopes.owner.tolist() == [0, 1, 1]
    for which, matrix in enumerate((one, two)):
        own = slopes.owner == which
        np.testing.assert_allclose(slopes.left[:, own] @ slopes.right[:, own].T, matrix, rtol=1e-9, atol=1e-9)
    assert low_rank(np.zeros((2, 4, 3))).left.shape == (4, 0)


def test_poles_are_stable_where_no_motion_grows():
    assert is_stable(np.array([-0.1 + 1j, -0.1 - 1j]))
    assert is_stable(np.array([1e-12 + 1j]))
    assert not is_stable(np.array([0.01 + 1j]))
    assert is_stable(np.zeros(0, dtype=np.complex128))

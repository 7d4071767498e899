"""Linear systems against NumPy."""

import numpy as np
import pytest
import sympy as sp

from windsysid.errors import ConfigurationError
from windsysid.identification.fit_equations import Reading
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.equations import Equations
from windsysid.spectral.lti.system import LinearSystem, is_stable, linearise, low_rank, resolve


def system_of(A: np.ndarray) -> LinearSystem:
    rng = np.random.default_rng(1)
    n = len(A)
    return LinearSystem(A[None], rng.normal(size=(1, n, 1)), rng.normal(size=(1, 2, n)), rng.normal(size=(1, 2, 1)))


@pytest.mark.parametrize("A", [np.array([[0.0, 1.0], [-4.0, -0.3]]), np.array([[-1.0, 1.0], [0.0, -1.0]])])
def test_transfer_is_c_times_the_resolvent_times_g(A: np.ndarray):
    system, s = system_of(A), 2j * np.pi * np.array([0.1, 0.4])
    left, right, T = resolve(system, s)
    for i, one in enumerate(s):
        X = np.linalg.inv(one * np.eye(2) - A)
        np.testing.assert_allclose(left[i], system.C[0] @ X)
        np.testing.assert_allclose(right[i], X @ system.G[0])
        np.testing.assert_allclose(T[i], system.C[0] @ X @ system.G[0] + system.E[0])


def test_an_unstable_system_has_no_spectrum():
    with pytest.raises(np.linalg.LinAlgError, match="unstable"):
        resolve(system_of(np.array([[0.0, 1.0], [-4.0, 0.3]])), np.array([1j]))
    assert is_stable(np.array([-1.0 + 1j, 1e-12 - 1j]))
    assert not is_stable(np.array([0.1 + 1j]))


def test_products_of_low_rank_add_up_to_the_derivatives():
    rng = np.random.default_rng(2)
    derivatives = np.array(
        [np.outer(rng.normal(size=4), rng.normal(size=3)), np.zeros((4, 3)), rng.normal(size=(4, 3))]
    )
    slopes = low_rank(derivatives)
    assert np.bincount(slopes.owner, minlength=3).tolist() == [1, 0, 3]
    for which, matrix in enumerate(derivatives):
        own = slopes.owner == which
        np.testing.assert_allclose(slopes.left[:, own] @ slopes.right[:, own].T, matrix, atol=1e-12)


def test_a_pendulum_is_linearised_where_it_hangs():
    x, v, k = sp.Symbol("x", real=True), sp.Symbol("v", real=True), sp.Symbol("k", positive=True)
    pendulum = Equations("pendulum", (x, v), (), (k,), (), (v, -k * sp.sin(x) - v))
    compiled = compile_model(pendulum, (Reading("angle", x, 0.1),))
    nothing = np.zeros(0)
    found = linearise(compiled, np.array([[4.0]]), nothing, nothing, np.array([0.3, 0.0]))
    np.testing.assert_allclose(found.A[0], [[0.0, 1.0], [-4.0, -1.0]], atol=1e-9)
    with pytest.raises(ConfigurationError, match="at rest"):
        linearise(compiled, np.array([[np.nan]]), nothing, nothing, np.array([0.3, 0.0]))

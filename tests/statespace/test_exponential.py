"""The matrix exponential of two states agrees with the closed form, also where its eigenvalues are far apart."""

import numpy as np
import pytest
from scipy.linalg import expm

from windsysid.statespace.process import discretise_block


def companion(first, second):
    """A matrix of the form of `rational` with two given eigenvalues."""
    return np.array([[0.0, 1.0], [-(first * second).real, (first + second).real]])


def closed_form(slow, fast):
    """exp of `companion` of two real eigenvalues, in extended precision."""
    slow, fast = np.longdouble(slow), np.longdouble(fast)
    low, high, gap = np.exp(fast), np.exp(slow), slow - fast
    return (
        np.array([[slow * low - fast * high, high - low], [slow * fast * (low - high), slow * high - fast * low]]) / gap
    )


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("fast", [-2.0, -50.0, -800.0, -1e4, -1e8])
@pytest.mark.parametrize("slow", [-1e-6, -0.3, -1.0])
def test_eigenvalues_far_apart_neither_overflow_nor_cancel(slow, fast):
    found, _ = discretise_block(companion(slow, fast), np.eye(2), 1.0)
    expected = closed_form(slow, fast).astype(float)
    np.testing.assert_allclose(found[:, 0], expected[:, 0], rtol=1e-7 if abs(fast) > 1e7 else 1e-10)
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-15 * np.abs(found).max())


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("fast", [-1500.0, -1e6])
def test_both_states_decay_to_zero_where_both_eigenvalues_are_large(fast):
    found, noise = discretise_block(companion(-1000.0, fast), np.eye(2), 1.0)
    np.testing.assert_array_equal(found, np.zeros((2, 2)))
    np.testing.assert_array_equal(noise, np.eye(2))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("pair", [-0.1 + 3.0j, -1e-3 + 40.0j, -2.0 + 1e-9j, -0.5 + 0.0j])
def test_oscillations_and_equal_eigenvalues_agree_with_scipy(pair):
    A = companion(pair, pair.conjugate())
    found, _ = discretise_block(A, np.eye(2), 0.7)
    np.testing.assert_allclose(found, expm(0.7 * A), rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize(
    "A", [np.zeros((2, 2)), np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.3, 1.0], [0.5, -0.3]])]
)
def test_integrators_and_saddles_agree_with_scipy(A):
    found, _ = discretise_block(A, np.eye(2), 0.7)
    np.testing.assert_allclose(found, expm(0.7 * A), rtol=1e-13, atol=1e-15)

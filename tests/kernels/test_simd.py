"""Vectors of doubles in compiled code do what NumPy does."""

import math

import numba
import numpy as np
import pytest

from windsysid.kernels.simd import LANES, load, splat, square_root, store, vectors, where


@numba.njit
def formula(a, b, out):
    for i in range(a.shape[0]):
        x, y = load(a, i), load(b, i)
        store(out, i, (x + y) * (x - y) / (splat(2.0) * square_root(x)))


def test_the_arithmetic_of_a_vector_is_that_of_its_numbers():
    rng = np.random.default_rng(5)
    a, b = rng.uniform(1.0, 2.0, (3, LANES)), rng.standard_normal((3, LANES))
    out = np.zeros((3, LANES))
    formula(a, b, out)
    np.testing.assert_allclose(out, (a + b) * (a - b) / (2.0 * np.sqrt(a)), rtol=1e-14)


@numba.njit
def functions(a, b, number, out):
    x, y, z = vectors(a), vectors(b), vectors(out)
    for i in range(x.shape[0]):
        z[i, 0] = 2 * x[i] ** 3 - y[i] / 3.0 + 1
        z[i, 1] = abs(x[i]) ** y[i] + max(abs(x[i]), 0.1) + min(x[i], y[i]) + (-y[i]) ** (-2) + x[i] ** 0.0
        z[i, 2] = math.exp(x[i]) * math.atan2(y[i], 2.0) + math.sqrt(abs(x[i])) + math.copysign(1, x[i])
        z[i, 3] = math.log(abs(y[i])) + math.tanh(x[i]) + math.erf(x[i]) + math.sin(number) * math.tan(x[i])
        z[i, 4] = where((x[i] > 0.0) & (y[i] <= 1.0) | (x[i] < -1), x[i], -y[i]) + where(number > 1.0, 2.0, y[i])
        z[i, 5] = 1.5


def test_the_functions_of_a_vector_are_those_of_its_numbers():
    rng = np.random.default_rng(6)
    a, b = rng.standard_normal((2, 100, LANES))
    out = np.zeros((100, 6, LANES))
    functions(a, b, 3.0, out)
    erf = np.vectorize(math.erf)
    expected = (
        2 * a**3 - b / 3.0 + 1,
        np.abs(a) ** b + np.maximum(np.abs(a), 0.1) + np.minimum(a, b) + b**-2.0 + 1.0,
        np.exp(a) * np.arctan2(b, 2.0) + np.sqrt(np.abs(a)) + np.sign(a),
        np.log(np.abs(b)) + np.tanh(a) + erf(a) + np.sin(3.0) * np.tan(a),
        np.where((a > 0.0) & (b <= 1.0) | (a < -1), a, -b) + 2.0,
        np.full_like(a, 1.5),
    )
    np.testing.assert_allclose(out, np.stack(expected, axis=1), rtol=1e-13, atol=1e-13)


@numba.njit
def turned(a, out):
    x, y = vectors(a), vectors(out)
    for i in range(x.shape[0]):
        y[i, 0], y[i, 1] = math.sin(x[i]), math.cos(x[i])


@pytest.mark.parametrize("farthest", [1e-8, 1.0, 100.0, 1e5, 1e9])
def test_sine_and_cosine_are_numpys_to_two_units_in_the_last_place(farthest: float):
    rng = np.random.default_rng(7)
    quarters = np.round(
        rng.uniform(-farthest, farthest, (2000, LANES))
    )  # a sine there is what is left of a cancellation
    a = np.concatenate([rng.uniform(-farthest, farthest, (20000, LANES)), quarters * (math.pi / 2.0)])
    out = np.zeros((len(a), 2, LANES))
    turned(a, out)
    for found, exact in ((out[:, 0], np.sin(a)), (out[:, 1], np.cos(a))):
        assert np.all(np.abs(found - exact) <= 2.0 * np.spacing(np.abs(exact)) + 1e-23)


def test_a_lane_that_is_no_number_leaves_the_others_alone():
    a = np.array([[0.3, np.nan, np.inf, -2.0, 1e300, 0.0, -0.0, 5.0]])
    out = np.zeros((1, 2, LANES))
    turned(a, out)
    with np.errstate(invalid="ignore"):
        np.testing.assert_allclose(out[0], [np.sin(a[0]), np.cos(a[0])], rtol=1e-15)

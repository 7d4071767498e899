"""Vectors of doubles in compiled code do what NumPy does."""

import numba
import numpy as np

from windsysid.kernels.simd import LANES, load, splat, square_root, store


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

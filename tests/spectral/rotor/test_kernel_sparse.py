"""Compiled loops over few entries against NumPy."""

import numpy as np
import pytest

from windsysid.spectral.rotor.kernel_sparse import add_up, element_at


def test_an_element_is_a_polynomial_in_the_frequency():
    rng = np.random.default_rng(1)
    X = rng.normal(size=(3, 7, 2, 2)) + 1j * rng.normal(size=(3, 7, 2, 2))
    a, v, q = X[:, 4, 1, 0]
    found = getattr(element_at, "py_func", element_at)(X, 4, 1, 0, 1.3)
    assert found == pytest.approx(-(1.3**2) * a + 1.3j * v + q)


def test_a_spectrum_that_is_not_positive_has_no_likelihood():
    S = -np.eye(2, dtype=complex)[None]
    value = add_up()(
        S, np.zeros((0, 1, 2, 2), dtype=complex), np.ones((1, 2, 1), dtype=complex), np.ones(1), np.zeros(0),
        np.zeros((0, 0)),
    )  # fmt: skip
    assert not np.isfinite(value)

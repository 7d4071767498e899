"""Singular values of spectral matrices against those of the averaged matrix."""

import numpy as np

from windsysid.modal.singular_values import AVERAGED_BINS, singular_values


def test_values_are_those_of_the_averaged_matrix_whatever_the_units():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(300, 4)) + 1j * rng.normal(size=(300, 4))
    frequency, found = singular_values(np.arange(300.0), values)
    scaled = values / np.sqrt(np.median(np.abs(values) ** 2, axis=0) / np.log(2.0))
    first = scaled[:AVERAGED_BINS]
    expected = np.linalg.eigvalsh(first.T @ first.conj() / AVERAGED_BINS)[::-1]
    np.testing.assert_allclose(found[0], expected)
    assert frequency[0] == (AVERAGED_BINS - 1) / 2
    np.testing.assert_allclose(singular_values(np.arange(300.0), values * [1.0, 1e6, 1.0, 1e-3])[1], found)


def test_a_single_motion_has_one_singular_value():
    motion = np.random.default_rng(1).normal(size=200) + 0j
    found = singular_values(np.arange(200.0), np.outer(motion, [1.0, 0.5j, -2.0]))[1]
    assert np.all(found[:, 1] < 1e-12 * found[:, 0])

"""Index tables of the loops over many entries."""

import numpy as np

from windsysid.spectral.rotor.kernel_dense import elements_of, entries_at, places_of


def test_elements_are_listed_with_unknown_harmonic_row_and_column():
    X = np.zeros((3, 2, 7, 4, 4), dtype=complex)
    X[1, 1, 5, 2, 3] = 1.0
    np.testing.assert_array_equal(elements_of(X), [[1, 5, 2, 3]])


def test_entries_that_are_not_used_are_marked():
    np.testing.assert_array_equal(entries_at(np.array([1, 2]), 2, 2), [[-1, 0], [1, -1]])


def test_a_placement_is_the_sum_of_its_elements():
    rng = np.random.default_rng(1)
    U = np.where(rng.random((5, 3)) < 0.5, rng.normal(size=(5, 3)), 0.0).astype(complex)
    where, values = places_of(U)
    whole = np.zeros_like(U)
    whole[where[:, 1], where[:, 0]] = values
    np.testing.assert_array_equal(whole, U)

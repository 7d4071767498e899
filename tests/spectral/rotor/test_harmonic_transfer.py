"""Matrices coupled over harmonics."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from windsysid._types import Array
from windsysid.mechanics.compile import compile_model
from windsysid.spectral.rotor import harmonic_transfer
from windsysid.spectral.rotor.harmonic_transfer import (
    MAX_HARMONIC,
    MatrixHarmonics,
    affine_matrices,
    coupled,
    element_sizes,
    without_rounding,
)
from windsysid.turbine.file import load_turbine


def test_a_matrix_that_does_not_turn_couples_no_harmonics():
    M = np.zeros((3, 2 * MAX_HARMONIC + 1, 1, 1), dtype=complex)
    M[:, MAX_HARMONIC, 0, 0] = 2.0, 0.3, 50.0  # mass, damping, stiffness
    orders, base = np.arange(-1, 2), np.array([0.2, 0.7])
    found = coupled(M, base, orders, 0.5)[:, :, 0, :, 0]
    w = 2.0 * np.pi * (base[:, None] + 0.5 * orders)
    for i in range(2):
        np.testing.assert_allclose(found[i], np.diag(-2.0 * w[i] ** 2 + 0.3j * w[i] + 50.0))


def test_a_harmonic_couples_neighbours():
    M = np.zeros((3, 2 * MAX_HARMONIC + 1, 1, 1), dtype=complex)
    M[2, MAX_HARMONIC + 1] = 1.0
    found = coupled(M, np.array([0.2]), np.arange(-1, 2), 0.5)[0, :, 0, :, 0]
    np.testing.assert_allclose(found, np.eye(3, k=-1))


def test_parameters_whose_product_counts_are_not_affine():
    """An accelerometer measures gravity as the top leans, gravity times tilt; stiffness and damping are affine."""
    tower = load_turbine("tower")
    compiled = compile_model(tower.model, tower.sensors)
    given = tuple(tower.values[name] for name in compiled.parameters)
    for names, affine in ((("k_fore_aft", "c_side_side"), True), (("gravity", "tilt"), False)):
        steps = tuple((compiled.parameters.index(name), tower.values[name]) for name in names)
        found = affine_matrices(compiled, given, steps, 0.0, (0.0,) * len(compiled.inputs))
        assert (found is not None) == affine


@pytest.mark.parametrize(
    "stiffness",
    [
        lambda a, b: (a + b) ** 2,
        lambda a, b: a * b,
        lambda a, b: a * (a - b),
        lambda a, b: np.abs(a - 1.7) + b,
        np.arctan2,
    ],
)
def test_what_is_no_sum_of_coefficients_is_not_affine(monkeypatch: pytest.MonkeyPatch, stiffness: Callable[..., Array]):
    """A step of all by half of their sizes showed no (a + b)²: a frequency was 4.7 σ off with grade B."""

    def harmonics(model: Any, points: Array, *_: Any) -> MatrixHarmonics:
        X = np.ones((3, len(points), 2 * MAX_HARMONIC + 1, 1, 1), dtype=complex)
        X[2, :, MAX_HARMONIC, 0, 0] = stiffness(points[:, 0], points[:, 1])
        return MatrixHarmonics(X, np.ones_like(X))

    monkeypatch.setattr(harmonic_transfer, "matrix_harmonics", harmonics)
    model: Any = SimpleNamespace(states=("x", "v"))
    found = affine_matrices.__wrapped__(model, (2.0, 2.0), ((0, 2.0), (1, 2.0)), 0.0, ())
    assert found is None


def test_rounding_is_zero_beside_the_size_of_its_matrix():
    X = np.ones((3, 1, 2 * MAX_HARMONIC + 1, 2, 2), dtype=complex)
    sizes = element_sizes(MatrixHarmonics(X, X))
    small = np.full_like(X, 1e-14)
    assert not without_rounding(small, 1e-11 * sizes[0]).any()
    np.testing.assert_array_equal(without_rounding(X, 1e-11 * sizes[0]), X)

"""Assignment of measured modes to a model's: against all assignments, one by one."""

import itertools
import math

import numpy as np
import pytest

from windsysid.modal.matching.assignment import best_assignment, pair_probabilities


def all_assignments(weights: np.ndarray) -> dict[tuple[int, ...], float]:
    """Every one-to-one assignment with its weight; −1 is none."""
    m, n = weights.shape
    found = {}
    for each in itertools.product(range(-1, n), repeat=m):
        used = [k for k in each if k >= 0]
        if len(set(used)) == len(used):
            found[each] = math.prod(weights[i, k] for i, k in enumerate(each) if k >= 0)
    return found


def exact(weights: np.ndarray) -> np.ndarray:
    known = all_assignments(weights)
    marginal = np.zeros(weights.shape)
    for each, weight in known.items():
        for i, k in enumerate(each):
            if k >= 0:
                marginal[i, k] += weight
    return marginal / sum(known.values())


@pytest.mark.parametrize("seed", range(20))
def test_probabilities_are_sums_over_all_assignments(seed: int):
    """Weights over six orders of magnitude."""
    random = np.random.default_rng(seed)
    weights = np.exp(random.normal(-1.0, 3.0, size=(int(random.integers(1, 5)), int(random.integers(1, 5)))))
    found = pair_probabilities(weights)
    np.testing.assert_allclose(found, exact(weights), atol=1e-3)
    assert (found.sum(axis=1) <= 1.0).all()
    assert (found.sum(axis=0) <= 1.0 + 1e-6).all()


@pytest.mark.parametrize("seed", range(20))
def test_the_best_assignment_is_the_one_with_the_largest_weight(seed: int):
    random = np.random.default_rng(100 + seed)
    weights = np.exp(random.normal(0.0, 3.0, size=(int(random.integers(1, 5)), int(random.integers(1, 5)))))
    known = all_assignments(weights)
    best = max(known, key=known.__getitem__)
    assert [-1 if k is None else k for k in best_assignment(weights)] == list(best)


def test_two_modes_that_shapes_tell_apart_are_sure_although_frequencies_do_not():
    weights = np.array([[300.0, 0.3], [0.3, 300.0]])
    np.testing.assert_allclose(pair_probabilities(weights), exact(weights), atol=1e-3)
    assert best_assignment(weights) == [0, 1]


def test_modes_that_may_be_exchanged_are_not_certain():
    """Two modes a hundredth apart without shapes: each other's as likely as their own, whatever the weights."""
    for size in (1e1, 1e3, 1e6, 1e40):
        weights = size * np.array([[1.0, 0.8], [0.9, 1.0]])
        expected = exact(weights)
        np.testing.assert_allclose(pair_probabilities(weights), expected, atol=1e-6)
        assert expected.max() < 0.6


def test_many_modes_are_matched_in_parts():
    """Forty pairs of close modes, and a crowd that is too large for exact sums."""
    pair = np.array([[300.0, 200.0], [200.0, 300.0]])
    found = pair_probabilities(np.kron(np.eye(40), pair))
    np.testing.assert_allclose(found[:2, :2], exact(pair), atol=1e-6)
    crowd = pair_probabilities(np.full((20, 60), 2.0))
    np.testing.assert_allclose(crowd.sum(axis=1), crowd.sum(axis=1)[0])
    assert np.all(crowd.sum(axis=1) < 1.0)

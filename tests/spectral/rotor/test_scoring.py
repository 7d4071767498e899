"""Stages of a search against the posterior of a Gaussian, which is known."""

import numpy as np
import pytest

from windsysid.spectral.rotor.scoring import find_in_stages, find_nearby

TRUTH, PRIOR = np.array([0.4, -0.3]), (np.array([0.0, 0.1]), np.array([2.0, 0.5]))
FISHER = np.array([[40.0, 10.0], [10.0, 30.0]])


def likelihood(u: np.ndarray, every: int) -> tuple[float, np.ndarray, np.ndarray]:
    off = u - TRUTH
    return 0.5 * float(off @ FISHER @ off), FISHER @ off, FISHER


@pytest.mark.parametrize("weight", [1.0, 0.1])
def test_the_mode_is_the_mean_weighted_by_information(weight: float):
    mean, precision = PRIOR[0], np.diag(PRIOR[1] ** -2.0)
    expected = np.linalg.solve(weight * FISHER + precision, weight * FISHER @ TRUTH + precision @ mean)
    found = find_in_stages(likelihood, mean, PRIOR, ((0.03, 4), (weight, 1)), tolerance=1e-12)
    np.testing.assert_allclose(found.point, expected, atol=1e-7)
    np.testing.assert_allclose(found.evaluation.information, weight * FISHER + precision)
    assert found.converged


def test_a_search_nearby_takes_one_step_unseen():
    found = find_nearby(likelihood, TRUTH + 0.05, PRIOR)
    far = find_in_stages(likelihood, TRUTH + 0.05, PRIOR, ((1.0, 1),), tolerance=1e-12)
    assert (found.steps, found.converged) == (1, True)
    np.testing.assert_allclose(found.point, far.point, atol=1e-9)
    assert found.value == pytest.approx(far.value)


def test_a_likelihood_that_is_not_finite_at_the_start_is_an_error():
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        find_in_stages(lambda u, every: (np.nan, u, FISHER), TRUTH, PRIOR, ((1.0, 1),))

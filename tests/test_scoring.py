"""Damped Fisher scoring against closed forms and SciPy's minimum."""

import numpy as np
import pytest
import scipy.optimize
from scipy.stats import multivariate_normal

from windsysid.scoring import Evaluation, SearchLimits, covariance, find_mode, laplace_evidence

LIMITS = SearchLimits(1e-10, max_steps=100)
FREE = np.full(2, np.inf)


def parabola(centre: np.ndarray, information: np.ndarray):
    def evaluate(x: np.ndarray) -> Evaluation:
        off = x - centre
        return Evaluation(0.5 * float(off @ information @ off), information @ off, information)

    return evaluate


def rosenbrock(x: np.ndarray) -> Evaluation:
    """½ |r|² of r = (10 (x₁ − x₀²), 1 − x₀), with the Gauss–Newton information JᵀJ."""
    r = np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])
    slopes = np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])
    return Evaluation(0.5 * float(r @ r), slopes.T @ r, slopes.T @ slopes)


def test_the_mode_of_a_parabola_is_one_undamped_step_away():
    centre, information = np.array([1.0, -2.0]), np.array([[2.0, 0.6], [0.6, 1.0]])
    found = find_mode(
        parabola(centre, information), np.zeros(2), LIMITS._replace(damping=0.0, unseen=1e3), max_step=FREE
    )
    np.testing.assert_allclose(found.point, centre, atol=1e-12)
    assert (found.steps, found.converged) == (1, True)
    assert found.value == pytest.approx(0.0, abs=1e-12)
    assert found.decrement == pytest.approx(centre @ information @ centre)
    np.testing.assert_array_equal(found.evaluation.gradient, -information @ centre)  # one step before


def test_a_curved_valley_leads_to_scipys_minimum():
    found = find_mode(rosenbrock, np.array([-1.2, 1.0]), LIMITS, max_step=FREE)
    expected = scipy.optimize.minimize(scipy.optimize.rosen, [-1.2, 1.0]).x
    assert found.converged
    np.testing.assert_allclose(found.point, expected, atol=1e-4)


def test_no_step_is_longer_than_the_limit_and_its_direction_stays():
    points = []

    def evaluate(x: np.ndarray) -> Evaluation:
        points.append(x)
        off = x - np.array([4.0, 2.0])
        return Evaluation(0.5 * float(off @ off), off, np.eye(2))

    find_mode(evaluate, np.zeros(2), LIMITS._replace(damping=0.0), max_step=np.array([1.0, 1.0]))
    np.testing.assert_allclose(points[:4], [[0.0, 0.0], [1.0, 0.5], [2.0, 1.0], [3.0, 1.5]])


def test_points_without_a_value_are_avoided():
    def evaluate(x: np.ndarray) -> Evaluation:  # −ln x + x: information 1 overshoots to below 0 from 3
        if x[0] <= 0.0:
            raise np.linalg.LinAlgError
        return Evaluation(float(x[0] - np.log(x[0])), 1.0 - 1.0 / x, np.array([[0.1]]))

    found = find_mode(evaluate, np.array([3.0]), LIMITS, max_step=FREE[:1])
    assert found.converged
    assert found.point[0] == pytest.approx(1.0, abs=1e-3)


def test_a_search_that_cannot_descend_says_so():
    def uphill(x: np.ndarray) -> Evaluation:
        return Evaluation(float(x[0] ** 2), np.array([-1.0]), np.array([[1.0]]))  # a wrong gradient

    assert not find_mode(uphill, np.zeros(1), LIMITS, max_step=FREE[:1]).converged
    assert find_mode(uphill, np.zeros(1), LIMITS._replace(stalled=10.0), max_step=FREE[:1]).converged


def test_a_search_is_given_up_when_asked():
    found = find_mode(
        rosenbrock, np.array([-1.2, 1.0]), LIMITS, max_step=FREE, give_up=lambda there, decrease: decrease > 0.0
    )
    assert not found.converged
    assert found.value < rosenbrock(np.array([-1.2, 1.0])).value


def test_a_start_without_a_value_is_an_error():
    def evaluate(x: np.ndarray) -> Evaluation:
        raise np.linalg.LinAlgError

    with pytest.raises(np.linalg.LinAlgError):
        find_mode(evaluate, np.zeros(2), LIMITS, max_step=FREE)


def test_a_prior_adds_its_quadratic():
    off, precision = np.array([0.5, -1.0]), np.diag([4.0, 2.0])
    found = Evaluation(3.0, np.array([1.0, 2.0]), np.eye(2)).with_prior(off, precision, 0.5)
    assert found.value == pytest.approx(1.5 + 0.5 * (4.0 * 0.25 + 2.0))
    np.testing.assert_allclose(found.gradient, [0.5 + 2.0, 1.0 - 2.0])
    np.testing.assert_allclose(found.information, np.diag([4.5, 2.5]))


def test_covariance_is_the_inverse_and_wide_where_rounding_hides_information():
    A = np.array([[2.0, 0.3], [0.3, 1e-6]])
    np.testing.assert_allclose(covariance(A @ A.T), np.linalg.inv(A @ A.T), rtol=1e-6)
    singular = np.array([[1.0, 1.0], [1.0, 1.0 - 1e-16]])
    values = np.linalg.eigvalsh(covariance(singular))
    assert values.min() > 0.0
    assert values.max() > 1e12


def test_the_evidence_of_a_linear_model_is_the_density_of_its_readings():
    rng = np.random.default_rng(1)
    rows, readings = rng.standard_normal((6, 2)), rng.standard_normal(6)
    prior = np.array([[2.0, 0.5], [0.5, 1.0]])
    information = prior + rows.T @ rows
    mode = np.linalg.solve(information, rows.T @ readings)
    log_posterior = float(multivariate_normal(rows @ mode, np.eye(6)).logpdf(readings)) - 0.5 * mode @ prior @ mode
    whole = multivariate_normal(np.zeros(6), np.eye(6) + rows @ np.linalg.inv(prior) @ rows.T)
    assert laplace_evidence(log_posterior, prior, information) == pytest.approx(float(whole.logpdf(readings)))

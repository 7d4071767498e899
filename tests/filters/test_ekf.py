"""The extended Kalman filter against finite differences and the statistics it claims."""

from dataclasses import replace

import numpy as np
import pytest

from tests.filters.textbook import LOADS, STEPS, composed, simulated, textbook
from tests.mechanics.models import CHAIN_VALUES, chain, chain_sensors
from windsysid.filters import EKF, Belief
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine


@pytest.mark.slow
def test_normalised_innovations_have_mean_square_one_when_the_model_is_right():
    # 20 records of 200 samples and 3 readings, a tenth missing: the sum of squares is χ² with 10 700 degrees of
    # freedom, whose mean square has the standard error √(2/10700) = 0.0137. Bounds: four of them; neighbours must be
    # uncorrelated too.
    model = composed()
    whitened = np.stack([
        EKF.run(model, EKF.init(model), *simulated(model, 200, seed=100 + run))[1].whitened for run in range(20)
    ])  # fmt: skip
    neighbours = whitened[:, 1:] * whitened[:, :-1]
    for values, expected, variance in ((whitened**2, 1.0, 2.0), (whitened, 0.0, 1.0), (neighbours, 0.0, 1.0)):
        count = np.count_nonzero(~np.isnan(values))
        assert np.nanmean(values) == pytest.approx(expected, abs=4 * np.sqrt(variance / count))


@pytest.mark.slow
def test_the_estimate_errs_as_much_as_the_filter_says():
    # Normalised estimation error squared of nine states over 400 short runs: χ² with 3600 degrees of freedom,
    # standard error of its mean √(2/3600) = 0.024; bound: four of them.
    model, t = composed(), textbook(STEPS[0])
    total = 0.0
    for run in range(400):
        rng = np.random.default_rng(1000 + run)
        state = rng.multivariate_normal(model.mean, model.cov)
        belief = EKF.init(model)
        for k in range(5):
            if k:
                state = t.F @ state + rng.multivariate_normal(np.zeros(9), t.Q, method="svd")
            reading = t.H @ state + rng.multivariate_normal(np.zeros(3), t.R)
            belief, _ = EKF.step(model, belief, np.zeros(4), reading)
        error = state - belief.mean
        total += float(error @ np.linalg.solve(belief.cov, error))
    assert total / 3600 == pytest.approx(1.0, abs=4 * np.sqrt(2.0 / 3600))


@pytest.fixture(scope="module")
def joint(verne555: Turbine) -> StateSpace:
    """Motion, loads, two biases and the ten coefficients; no load noise, so that a prediction is F P Fᵀ alone."""
    turbine = verne555.with_model(verne555.model)
    sensors = tuple(s.model_copy(update={"bias": 0.2 * (i % 2)}) for i, s in enumerate(turbine.sensors))
    model = compose(
        turbine.model,
        rate=100.0,
        values=turbine.values,
        parameters=[
            (
                Parameter(name, 1.2 * value, 0.3)
                if name[0] == "k"
                else Parameter(name, 0.8 * value, 0.3 * value, False, 300.0)
            )
            for name, value in turbine.coefficients.items()
        ],
        loads=turbine.loads,
        sensors=sensors,
    )
    return replace(model, blocks=model.blocks._replace(load_noise=np.zeros((1, 5, 5))))


def belief_at(model: StateSpace, mean: np.ndarray, cov: np.ndarray) -> Belief:
    """A belief on the way (not the first), on a rotor that turns."""
    inputs = np.concatenate([[0.8, 7.3, 0.4], [3.0, -2.0, 1.0, 4.0, -5.0]])
    return Belief(mean, cov, inputs, 3)


NEXT = np.concatenate([[0.8 + 0.0731, 7.304, 0.4], [2.0, -1.0, 2.0, 3.0, -6.0]])


def somewhere(model: StateSpace) -> tuple[np.ndarray, np.ndarray]:
    """A moving state and the size of each of its entries."""
    size = np.concatenate([np.full(5, 0.05), np.full(5, 0.5), np.full(5, 15.0), np.full(2, 0.2), np.full(10, 0.3)])
    return model.mean + size * np.random.default_rng(33).standard_normal(len(size)), size


def central_difference(function, mean: np.ndarray, size: np.ndarray) -> np.ndarray:
    """∂function/∂mean, in columns, by steps of 1e-4 of each entry's size and Richardson's extrapolation."""

    def slope(j: int, step: float) -> np.ndarray:
        moved = step * size[j] * np.eye(len(mean))[j]
        difference: np.ndarray = (function(mean + moved) - function(mean - moved)) / (2 * step * size[j])
        return difference

    return np.stack([(4 * slope(j, 5e-4) - slope(j, 1e-3)) / 3 for j in range(len(mean))], axis=1)


def test_the_transition_jacobian_equals_central_differences(joint: StateSpace):
    # A prior covariance of one state alone, e_j e_jᵀ, comes out as the product of F's column j with itself.
    mean, size = somewhere(joint)
    n = len(mean)
    zero = np.zeros((n, n))
    numeric = central_difference(lambda m: EKF.predict(joint, belief_at(joint, m, zero), NEXT).mean, mean, size)
    for j in range(n):
        unit = np.zeros((n, n))
        unit[j, j] = 1.0
        exact = EKF.predict(joint, belief_at(joint, mean, unit), NEXT).cov
        column = numeric[:, j]
        np.testing.assert_allclose(exact, np.outer(column, column), rtol=1e-6, atol=1e-8 * np.abs(exact).max())
    assert np.count_nonzero(np.abs(numeric) > 1e-12) > 200  # full columns, not zeros against zeros


def test_a_full_covariance_moves_with_the_same_jacobian(joint: StateSpace):
    mean, size = somewhere(joint)
    n = len(mean)
    root = np.random.default_rng(34).standard_normal((n, n)) * size[:, None]
    P = root @ root.T
    zero = np.zeros((n, n))
    F = central_difference(lambda m: EKF.predict(joint, belief_at(joint, m, zero), NEXT).mean, mean, size)
    exact = EKF.predict(joint, belief_at(joint, mean, P), NEXT).cov
    scale = np.sqrt(np.diag(exact))
    np.testing.assert_allclose(exact / np.outer(scale, scale), (F @ P @ F.T) / np.outer(scale, scale), atol=1e-7)


def test_load_noise_reaches_the_motion_within_its_own_step(joint: StateSpace):
    # Γ Q Γᵀ from P = 0, with Γ from central differences: the load at the end of the step moves the state already.
    mean, _ = somewhere(joint)
    n = len(mean)
    Q = np.diag([1.0, 4.0, 9.0, 16.0, 25.0])
    noisy = replace(joint, blocks=joint.blocks._replace(load_noise=Q[None]))

    def after(load: np.ndarray) -> np.ndarray:
        moved = NEXT.copy()
        moved[3:] += load
        return EKF.predict(joint, belief_at(joint, mean, np.zeros((n, n))), moved).mean

    gain = central_difference(after, np.zeros(5), np.full(5, 10.0))
    gain[10:15] = np.eye(5)
    expected = gain @ Q @ gain.T
    exact = EKF.predict(noisy, belief_at(noisy, mean, np.zeros((n, n))), NEXT).cov
    scale = np.maximum(np.sqrt(np.diag(expected)), 1e-30)
    np.testing.assert_allclose(exact / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-7)
    assert exact[5, 10] > 0.0


def test_the_reading_jacobian_equals_central_differences(joint: StateSpace):
    # With P = e_j e_jᵀ and one reading alone the mean's entry j moves by h_j ν / (h_j² + r): h_j follows, with its
    # sign.
    mean, size = somewhere(joint)
    n, m = len(mean), len(joint.readings)
    zero = np.zeros((n, n))
    everything = np.zeros(m)
    numeric = central_difference(
        lambda at: -EKF.update(joint, belief_at(joint, at, zero), everything)[1].innovation[0], mean, size
    )
    for c in range(m):
        alone = np.full(m, np.nan)
        alone[c] = 0.0
        exact = np.empty(n)
        for j in range(n):
            unit = np.zeros((n, n))
            unit[j, j] = 1.0
            belief, info = EKF.update(joint, belief_at(joint, mean, unit), alone)
            exact[j] = (belief.mean[j] - mean[j]) * info.innovation_std[0, c] ** 2 / info.innovation[0, c]
        np.testing.assert_allclose(exact, numeric[c], rtol=1e-6, atol=1e-9 * np.abs(numeric[c]).max())
    assert np.count_nonzero(np.abs(numeric) > 1e-12) > 100


def test_joint_estimation_finds_a_wrong_stiffness_and_is_honest_about_it():
    # k_2 starts 5 % off; 4 records of 10 s drawn from the true chain. Every ±4σ band must hold the truth (6e-5
    # expected outside each), and the record must have taught much more than the prior knew. From 20 % off the
    # linearisation costs certainty: the error is then 1.2 times what the filter says on average.
    model = compose(
        chain(),
        intervals=STEPS,
        values=CHAIN_VALUES,
        parameters=[Parameter("k_2", 1.05 * CHAIN_VALUES["k_2"], 0.1)],
        loads=LOADS,
        sensors=chain_sensors(bias=0.3),
        mean=composed().mean[:6],
        cov=composed().cov[:6, :6],
    )
    truth = -np.log(1.05)
    for run in range(4):
        inputs, readings = simulated(composed(), 500, seed=200 + run)
        belief, _ = EKF.run(model, EKF.init(model), inputs, readings)
        std = np.sqrt(belief.cov[-1, -1])
        assert std < 0.1 / 20
        assert abs(belief.mean[-1] - truth) < 4 * std

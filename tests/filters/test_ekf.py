"""The extended Kalman filter against a textbook Kalman filter, finite differences and the statistics it claims."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.linalg

from tests.mechanics.models import CHAIN_VALUES, chain, chain_sensors
from windsysid.filters import EKF, Belief
from windsysid.loads import GaussMarkov
from windsysid.statespace import Parameter, StateSpace, compose
from windsysid.turbine import Turbine

RATE = 50.0
LOADS = (GaussMarkov("load_3", 2.0, 1.5), GaussMarkov("load_1", 5.0, 0.5))  # not in the model's order, one load known


def composed() -> StateSpace:
    rng = np.random.default_rng(31)
    root = 0.1 * rng.standard_normal((6, 6))
    return compose(
        chain(),
        rate=RATE,
        values=CHAIN_VALUES,
        loads=LOADS,
        sensors=chain_sensors(bias=0.3),
        mean=0.1 * rng.standard_normal(6),
        cov=root @ root.T + 1e-3 * np.eye(6),
    )


@dataclass(frozen=True)
class Textbook:
    """z₁ = F z₀ + B₀ w₀ + B₁ w₁ + Γ η, y = H z + D w + noise, all matrices written out here from the chain's springs."""

    F: np.ndarray
    B0: np.ndarray
    B1: np.ndarray
    Q: np.ndarray
    H: np.ndarray
    D: np.ndarray
    R: np.ndarray


def textbook() -> Textbook:
    m, k, c = (np.array([CHAIN_VALUES[f"{n}_{i}"] for i in (1, 2, 3)]) for n in "mkc")

    def assemble(s: np.ndarray) -> np.ndarray:
        return np.array([[s[0] + s[1], -s[1], 0.0], [-s[1], s[1] + s[2], -s[2]], [0.0, -s[2], s[2]]])

    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-assemble(k) / m[:, None], -assemble(c) / m[:, None]]])
    G = np.vstack([np.zeros((3, 3)), np.diag(1.0 / m)])
    # RK4 of a linear system with a linear load is the Taylor polynomial of order 4 of the system [x, w, dw/dt]
    h = 1.0 / RATE
    augmented = np.zeros((12, 12))
    augmented[:6, :6], augmented[:6, 6:9], augmented[6:9, 9:] = A, G, np.eye(3)
    power, taylor = np.eye(12), np.eye(12)
    for order in (1, 2, 3, 4):
        power = power @ augmented * h / order
        taylor = taylor + power
    Ad, per_load, per_slope = taylor[:6, :6], taylor[:6, 6:9], taylor[:6, 9:]
    B1 = per_slope / h
    B0 = per_load - B1
    # loads as states, in the order of LOADS: forces on masses 3 and 1
    select = np.array([[0.0, 1.0], [0.0, 0.0], [1.0, 0.0]])
    decay = np.array([np.exp(-h / 1.5), np.exp(-h / 0.5)])
    variance = np.array([2.0**2, 5.0**2]) * (1.0 - decay**2)
    F = scipy.linalg.block_diag(Ad, np.diag(decay), np.eye(1))
    F[:6, 6:8] = B0 @ select + B1 @ select @ np.diag(decay)
    gain = np.vstack([B1 @ select, np.eye(2), np.zeros((1, 2))])
    feed = np.array([[1.0 / m[0], 0.0, 0.0], [0.0, 0.0, 1.0 / m[2]], [0.0, 0.0, 0.0]])
    H = np.zeros((3, 9))
    H[0, :6], H[1, :6], H[2, 1] = A[3], A[5], 1.0
    H[:, 6:8] = feed @ select
    H[1, 8] = 1.0
    below = np.zeros((3, 3))
    return Textbook(
        F,
        np.vstack([B0, below]),
        np.vstack([B1, below]),
        gain @ np.diag(variance) @ gain.T,
        H,
        feed,
        np.diag([0.05, 0.08, 0.002]) ** 2,
    )


def simulated(model: StateSpace, samples: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Known loads and readings drawn from the model itself: state, load noise and sensor noise as it assumes them."""
    t, rng = textbook(), np.random.default_rng(seed)
    known = np.cumsum(rng.standard_normal((samples, 3)), axis=0)
    state = rng.multivariate_normal(model.mean, model.cov)
    readings = np.empty((samples, 3))
    for k in range(samples):
        if k:
            noise = rng.multivariate_normal(np.zeros(9), t.Q, method="svd")
            state = t.F @ state + t.B0 @ known[k - 1] + t.B1 @ known[k] + noise
        readings[k] = t.H @ state + t.D @ known[k] + rng.multivariate_normal(np.zeros(3), t.R)
    return known, readings


def test_ekf_equals_kalman_filter_on_a_linear_model():
    model, t = composed(), textbook()
    inputs, readings = simulated(model, 300, seed=32)
    readings[40, 1] = readings[41:44] = np.nan
    belief, info = EKF.run(model, EKF.init(model), inputs, readings)
    mean, cov = model.mean, model.cov
    for k in range(300):
        if k:
            mean = t.F @ mean + t.B0 @ inputs[k - 1] + t.B1 @ inputs[k]
            cov = t.F @ cov @ t.F.T + t.Q
        seen = ~np.isnan(readings[k])
        H, R = t.H[seen], t.R[np.ix_(seen, seen)]
        innovation = readings[k, seen] - H @ mean - t.D[seen] @ inputs[k]
        S = H @ cov @ H.T + R
        log_likelihood = -0.5 * (
            innovation @ np.linalg.solve(S, innovation) + np.linalg.slogdet(S)[1] + seen.sum() * np.log(2 * np.pi)
        )
        gain = np.linalg.solve(S, H @ cov).T
        mean, cov = mean + gain @ innovation, cov - gain @ S @ gain.T
        std = np.sqrt(np.diag(cov))
        # 1e-9 relative; a state or innovation near zero is held to 1e-9 of its standard deviation
        np.testing.assert_allclose(info.std[k], std, rtol=1e-9)
        np.testing.assert_allclose((info.mean[k] - mean) / np.maximum(np.abs(mean), std), 0.0, atol=1e-9)
        np.testing.assert_allclose(info.innovation_std[k, seen], np.sqrt(np.diag(S)), rtol=1e-9)
        np.testing.assert_allclose(info.innovation[k, seen], innovation, rtol=1e-9, atol=1e-11)
        whitened = np.linalg.solve(np.linalg.cholesky(S), innovation) if seen.any() else innovation
        np.testing.assert_allclose(info.whitened[k, seen], whitened, rtol=1e-9, atol=1e-9)
        assert info.log_likelihood[k] == pytest.approx(log_likelihood, rel=1e-9, abs=1e-9)
    np.testing.assert_allclose(belief.cov / np.outer(std, std), cov / np.outer(std, std), rtol=1e-9, atol=1e-9)


def test_normalised_innovations_have_mean_square_one_when_the_model_is_right():
    # 20 records of 200 samples and 3 readings: the sum of squares is χ² with 12 000 degrees of freedom, whose mean
    # square has the standard error √(2/12000) = 0.0129. Bounds: four of them; neighbours must be uncorrelated too.
    model = composed()
    whitened = np.stack([
        EKF.run(model, EKF.init(model), *simulated(model, 200, seed=100 + run))[1].whitened for run in range(20)
    ])  # fmt: skip
    assert np.mean(whitened**2) == pytest.approx(1.0, abs=4 * np.sqrt(2.0 / whitened.size))
    assert np.mean(whitened) == pytest.approx(0.0, abs=4 / np.sqrt(whitened.size))
    assert np.mean(whitened[:, 1:] * whitened[:, :-1]) == pytest.approx(0.0, abs=4 / np.sqrt(whitened[:, 1:].size))


def test_the_estimate_errs_as_much_as_the_filter_says():
    # Normalised estimation error squared of nine states over 400 short runs: χ² with 3600 degrees of freedom,
    # standard error of its mean √(2/3600) = 0.024; bound: four of them.
    model, t = composed(), textbook()
    total = 0.0
    for run in range(400):
        rng = np.random.default_rng(1000 + run)
        state = rng.multivariate_normal(model.mean, model.cov)
        belief = EKF.init(model)
        for k in range(5):
            if k:
                state = t.F @ state + rng.multivariate_normal(np.zeros(9), t.Q, method="svd")
            reading = t.H @ state + rng.multivariate_normal(np.zeros(3), t.R)
            belief, _ = EKF.step(model, belief, np.zeros(3), reading)
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
            Parameter(name, 1.2 * value, 0.3)
            if name[0] == "k"
            else Parameter(name, 0.8 * value, 0.3 * value, False, 300.0)
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
    # With P = e_j e_jᵀ and one reading alone the mean's entry j moves by h_j ν / (h_j² + r): h_j follows, with its sign.
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
    # k_2 starts 5 % off; 20 records of 10 s drawn from the true chain. Every ±4σ band must hold the truth (6e-5 expected
    # outside each), and the record must have taught much more than the prior knew. From 20 % off the linearisation costs
    # certainty: the error is then 1.2 times what the filter says on average.
    model = compose(
        chain(),
        rate=RATE,
        values=CHAIN_VALUES,
        parameters=[Parameter("k_2", 1.05 * CHAIN_VALUES["k_2"], 0.1)],
        loads=LOADS,
        sensors=chain_sensors(bias=0.3),
        mean=composed().mean[:6],
        cov=composed().cov[:6, :6],
    )
    truth = -np.log(1.05)
    for run in range(20):
        inputs, readings = simulated(composed(), 500, seed=200 + run)
        belief, _ = EKF.run(model, EKF.init(model), inputs, readings)
        std = np.sqrt(belief.cov[-1, -1])
        assert std < 0.1 / 20
        assert abs(belief.mean[-1] - truth) < 4 * std

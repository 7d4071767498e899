"""The unscented filter on bent readings and steps: exact moments, Monte Carlo, and its inventors' transform."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from tests.filters.test_protocol import record, rotor_with_everything
from tests.mechanics.models import Reads, duffing, symbols
from windsysid.filters import EKF, UKF, Belief, Filter
from windsysid.mechanics.equations import Equations
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.parameter import Parameter


def wave(spread: float, *, together: bool, idle: bool = False) -> StateSpace:
    """Reads sin(a + b) or sin(a) of two uncertain numbers around 0.4 and 0.3."""
    a, b, c = symbols("a b c")
    numbers = (a, b, c) if idle else (a, b)
    reading = sp.sin(a + b) if together else sp.sin(a)
    return compose(
        Equations("wave", (), (), numbers, (), ()),
        rate=1.0,
        values={},
        parameters=[Parameter(n.name, {"a": 0.4, "b": 0.3, "c": 1.0}[n.name], spread, False) for n in numbers],
        sensors=(Reads("wave", reading, 0.1),),
    )


def expected_sine(filter_: Filter, spread: float, *, together: bool) -> tuple[float, float]:
    """What the filter expects of the reading before it sees it: mean and variance, without the sensor's noise."""
    model = wave(spread, together=together)
    _, info = filter_.update(model, filter_.init(model), np.zeros(1))
    return -info.innovation.item(), info.innovation_std.item() ** 2 - 0.1**2


def exact_sine(spread: float, *, together: bool) -> tuple[float, float]:
    """Mean and variance of sin x for a Gaussian x, from its characteristic function."""
    centre, variance = (0.7, 2.0 * spread**2) if together else (0.4, spread**2)
    mean = np.exp(-0.5 * variance) * np.sin(centre)
    return float(mean), float(0.5 * (1.0 - np.exp(-2.0 * variance) * np.cos(2.0 * centre)) - mean**2)


def order(filter_: Filter, *, together: bool) -> float:
    """With which power of the spread the error of the expected reading grows."""
    errors = [
        abs(expected_sine(filter_, spread, together=together)[0] - exact_sine(spread, together=together)[0])
        for spread in (0.2, 0.1)
    ]
    return float(np.log2(errors[0] / errors[1]))


def test_the_expected_reading_is_right_to_third_order():
    # Its error then grows with the fourth power of the spread, the extended filter's with the second; along one
    # direction the points have a Gaussian's moments to the fifth, and the error grows with the sixth power.
    assert order(UKF, together=True) == pytest.approx(4.0, abs=0.1)
    assert order(UKF, together=False) == pytest.approx(6.0, abs=0.1)
    assert order(EKF, together=True) == pytest.approx(2.0, abs=0.1)


@pytest.mark.parametrize("together", [True, False])
@pytest.mark.parametrize("spread", [0.1, 0.3, 0.5])
def test_expected_readings_are_nearer_than_the_extended_filters(spread: float, together: bool):
    exact = exact_sine(spread, together=together)
    unscented, extended = (expected_sine(f, spread, together=together) for f in (UKF, EKF))
    for i, better in ((0, 0.1), (1, 0.65)):
        assert abs(unscented[i] - exact[i]) < better * abs(extended[i] - exact[i])


def test_a_state_that_does_nothing_leaves_the_others_where_they_are():
    # The cubature filter's points go out as √n: there this fails.
    outcomes = []
    for idle in (False, True):
        model = wave(0.5, together=True, idle=idle)
        belief, info = UKF.update(model, UKF.init(model), np.array([0.2]))
        outcomes.append([*belief.mean[:2], *belief.cov[:2, :2].ravel(), info.innovation_std.item()])
    np.testing.assert_allclose(outcomes[1], outcomes[0], rtol=1e-13)


def test_load_noise_that_enters_squared_is_not_linearised():
    # ẋ = w²: over a step x gains h/6 (w₀² + (w₀ + w₁)² + w₁²), of which the mean is exact; an additive noise would lose
    # η².
    (x,), (w,) = symbols("x"), symbols("w")
    model = compose(
        Equations("power", (x,), (), (), (w,), (w**2,)),
        rate=4.0,
        values={},
        loads=[GaussMarkov("w", 2.0, 0.5)],
        sensors=(Reads("x", x, 0.1),),
        cov=np.zeros((1, 1)),
    )
    belief = UKF.predict(model, UKF.predict(model, UKF.init(model), np.zeros(1)), np.zeros(1))
    correlation = np.exp(-0.25 / 0.5)
    form = np.array([[2.0, 1.0], [1.0, 2.0]]) * 0.25 / 6.0
    cov = 4.0 * np.array([[1.0, correlation], [correlation, 1.0]])
    assert belief.mean[0] == pytest.approx(np.trace(form @ cov), rel=1e-13)
    exact = 2.0 * np.trace(form @ cov @ form @ cov)
    assert exact < belief.cov[0, 0] < 1.5 * exact  # on the safe side, as squares of squares are


@pytest.mark.slow
def test_a_bent_step_has_the_moments_of_a_monte_carlo():
    # 0.25 s of a Duffing oscillator from a wide prior, its cubic stiffness uncertain: RK4 of a million draws.
    model = compose(
        duffing(),
        rate=4.0,
        values={"a": 4.0, "b": 20.0, "c": 0.3},
        parameters=[Parameter("b", 20.0, 0.2)],
        sensors=(Reads("q", symbols("q")[0], 0.01),),
        mean=[0.5, 0.2],
        cov=np.diag([0.15, 0.3]) ** 2,
    )
    rng = np.random.default_rng(51)
    q, v, theta = model.mean[:, None] + np.sqrt(np.diag(model.cov))[:, None] * rng.standard_normal((3, 1_000_000))

    def rates(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.stack([v, 1.0 - 0.3 * v - 4.0 * q - 20.0 * np.exp(theta) * q**3])

    h, state = 0.25, np.stack([q, v])
    first = rates(*state)
    second = rates(*(state + 0.5 * h * first))
    third = rates(*(state + 0.5 * h * second))
    drawn = np.vstack([state + h / 6.0 * (first + 2.0 * second + 2.0 * third + rates(*(state + h * third))), theta])
    mean, cov = drawn.mean(axis=1), np.cov(drawn)
    std = np.sqrt(np.diag(cov))
    off = {}
    for f in (UKF, EKF):
        belief = f.predict(model, f.predict(model, f.init(model), np.ones(1)), np.ones(1))
        off[f.name] = (
            np.max(np.abs(belief.mean - mean) / std), np.max(np.abs(belief.cov - cov) / np.outer(std, std))
        )  # fmt: skip
    assert off[UKF.name][0] < 0.02
    assert off[UKF.name][1] < 0.1
    assert off[UKF.name][0] < 0.1 * off[EKF.name][0]
    assert off[UKF.name][1] < 0.5 * off[EKF.name][1]


def points_and_weights(mean: np.ndarray, cov: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The 2n + 1 points of van der Merwe and Wan with α = β = 1, κ = 3 − n, weights of mean and covariance."""
    n, alpha, beta = len(mean), 1.0, 1.0
    spread = alpha**2 * (n + (3.0 - n)) - n
    root = np.linalg.cholesky((n + spread) * cov).T
    weights = np.full(2 * n + 1, 0.5 / (n + spread))
    of_cov = weights.copy()
    weights[0] = spread / (n + spread)
    of_cov[0] = weights[0] + 1.0 - alpha**2 + beta
    return np.vstack([mean, mean + root, mean - root]), weights, of_cov


def moved(model: StateSpace, state: np.ndarray, eta: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The step as a black box: a prediction without uncertainty, the load noise put in as a known load."""
    pushed = after.copy()
    pushed[3:] += model.blocks.load_output[0] @ eta
    n = len(state)
    end = EKF.predict(model, Belief(state, np.zeros((n, n)), before, 1), pushed).mean
    end[10:15] += eta
    return end


def test_the_filter_is_the_unscented_transform_as_its_inventors_write_it():
    # 25 coefficients, loads and motions, two biases: sigma points and their weights, the one of the centre negative,
    # with nothing but NumPy around the model's own step and reading. Three samples, one reading missing.
    model = rotor_with_everything()
    still = replace(model, blocks=model.blocks._replace(load_noise=np.zeros((1, 5, 5)), walk=0.0 * model.blocks.walk))
    inputs, _ = record(model)
    readings = 3.0 * np.random.default_rng(52).standard_normal((4, 5))
    readings[2, 1] = np.nan
    belief, _ = UKF.run(model, UKF.init(model), inputs[:30], np.zeros((30, 5)))
    mean, cov, n = belief.mean, belief.cov, len(model.mean)
    for k in range(30, 33):
        whole = np.block([[cov, np.zeros((n, 5))], [np.zeros((5, n)), model.blocks.load_noise[0]]])
        points, weights, of_cov = points_and_weights(np.concatenate([mean, np.zeros(5)]), whole)
        ends = np.array([moved(still, p[:n], p[n:], inputs[k - 1], inputs[k]) for p in points])
        mean = weights @ ends
        cov = (ends - mean).T @ (of_cov[:, None] * (ends - mean))
        cov[range(15, n), range(15, n)] += model.blocks.walk[0]
        points, weights, of_cov = points_and_weights(mean, cov)
        zero = np.zeros((n, n))
        read = np.array(
            [-EKF.update(model, Belief(p, zero, inputs[k], 1), np.zeros(5))[1].innovation[0] for p in points]
        )
        seen = ~np.isnan(readings[k - 30])
        expected = (weights @ read)[seen]
        off = (read - weights @ read)[:, seen]
        S = off.T @ (of_cov[:, None] * off) + np.diag(model.blocks.noise[seen])
        gain = np.linalg.solve(S, off.T @ (of_cov[:, None] * (points - mean))).T
        mean, cov = mean + gain @ (readings[k - 30, seen] - expected), cov - gain @ S @ gain.T

        belief, info = UKF.step(model, belief, inputs[k], readings[k - 30])
        std = np.sqrt(np.diag(cov))
        np.testing.assert_allclose(belief.mean / std, mean / std, atol=1e-8)
        np.testing.assert_allclose(belief.cov / np.outer(std, std), cov / np.outer(std, std), atol=1e-8)
        np.testing.assert_allclose(info.innovation[0, seen], readings[k - 30, seen] - expected, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(info.innovation_std[0, seen], np.sqrt(np.diag(S)), rtol=1e-9)
        L = np.linalg.cholesky(S)
        np.testing.assert_allclose(info.whitening_std[0, seen], np.diag(L), rtol=1e-8)

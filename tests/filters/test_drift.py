"""Filters, smoothers and the bank against NumPy where a two-state load, a bias and a parameter drift."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from tests.filters.test_protocol import chain_with, every_filter
from tests.mechanics.models import CHAIN_VALUES, Reads, chain_sensors, symbols
from windsysid.filters import Filter, smooth
from windsysid.filters.bank import bank_of, run_bank
from windsysid.mechanics.equations import Equations
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.process import LoadBlock


@dataclass(frozen=True)
class Drifts(Reads):
    """A sensor whose bias wanders."""

    drift: float = 0.0


STEP, BIAS, DRIFT = 0.02, 0.3, 0.7
SWING, SPREAD = np.array([[0.0, 1.0], [-9.0, -2.0]]), np.diag([4.0, 36.0])
PUSH = np.array([1.0, 0.2])  # of the load's two states on the first mass


def gusty_chain() -> tuple[StateSpace, np.ndarray, np.ndarray, np.ndarray]:
    """The chain under a swinging load, with one accelerometer whose bias wanders; and its F, Q and H, written out."""
    first, last, middle = chain_sensors()
    sensors = (first, Drifts(last.channel, last.expression, last.noise, BIAS, DRIFT), middle)
    gust = LoadBlock(("gust", "gust_rate"), SWING, SPREAD, {"load_1": PUSH[None]})
    model = chain_with(loads=[gust], sensors=sensors)
    m, k, c = (np.array([CHAIN_VALUES[f"{name}_{i}"] for i in (1, 2, 3)]) for name in "mkc")
    coupled = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0], [0.0, 0.0, 1.0]])
    stiffness, damping = (coupled @ np.diag(values) @ coupled.T / m[:, None] for values in (k, c))
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-stiffness, -damping]])
    push = np.array([0.0, 0.0, 0.0, 1.0 / m[0], 0.0, 0.0])
    # RK4 under a load that runs linearly: the Taylor polynomial of order 4 of [x, w, dw/dt]
    whole = np.zeros((8, 8))
    whole[:6, :6], whole[:6, 6], whole[6, 7] = A, push, 1.0
    taylor = sum((np.linalg.matrix_power(whole * STEP, n) / f for n, f in ((1, 1), (2, 2), (3, 6), (4, 24))), np.eye(8))
    at_end = taylor[:6, 7] / STEP
    at_start = taylor[:6, 6] - at_end
    phi = scipy.linalg.expm(SWING * STEP)
    F = scipy.linalg.block_diag(taylor[:6, :6], phi, np.eye(1))
    F[:6, 6:8] = np.outer(at_start, PUSH) + np.outer(at_end, PUSH @ phi)
    gain = np.vstack([np.outer(at_end, PUSH), np.eye(2), np.zeros((1, 2))])
    Q = gain @ (SPREAD - phi @ SPREAD @ phi.T) @ gain.T
    Q[8, 8] = DRIFT**2 * STEP
    H = np.zeros((3, 9))
    H[0, :6], H[0, 6:8], H[1, :6], H[1, 8], H[2, 1] = A[3], PUSH / m[0], A[5], 1.0, 1.0
    return model, F, Q, H


def line_that_wanders() -> tuple[StateSpace, np.ndarray, np.ndarray]:
    """a + b t read by a sensor whose bias wanders, b wandering otherwise; and F, Q of [bias, a, b]."""
    a, b, t = symbols("a b t")
    model = compose(
        Equations("line", (), (t,), (a, b), (), ()),
        rate=1.0 / STEP,
        values={},
        parameters=[Parameter("a", 1.0, 1.0, False), Parameter("b", 1.0, 1.0, False)],
        sensors=(Drifts("line", a + b * t, 0.1, BIAS, DRIFT), Reads("twice", 2 * a + b * t, 0.2)),
        walk={"b": 0.4},
    )
    return model, np.eye(3), np.diag([DRIFT**2, 0.0, 0.4**2]) * STEP


Course = list[tuple[np.ndarray, np.ndarray]]


def kalman(model: StateSpace, F: np.ndarray, Q: np.ndarray, H: np.ndarray, readings: np.ndarray) -> Course:
    """Mean and covariance after each sample by the textbook; H (T, m, n)."""
    mean, cov, course = model.mean, model.cov, []
    for k, y in enumerate(readings):
        if k:
            mean, cov = F @ mean, F @ cov @ F.T + Q
        S = H[k] @ cov @ H[k].T + np.diag(model.blocks.noise)
        gain = np.linalg.solve(S, H[k] @ cov).T
        mean, cov = mean + gain @ (y - H[k] @ mean), cov - gain @ S @ gain.T
        course.append((mean, cov))
    return course


def rauch_tung_striebel(course: Course, F: np.ndarray, Q: np.ndarray) -> Course:
    """Mean and covariance of each sample given all."""
    smoothed = [course[-1]]
    for mean, cov in course[-2::-1]:
        ahead = F @ cov @ F.T + Q
        gain = np.linalg.solve(ahead, F @ cov).T
        later, spread = smoothed[-1]
        smoothed.append((mean + gain @ (later - F @ mean), cov + gain @ (spread - ahead) @ gain.T))
    return smoothed[::-1]


@every_filter
def test_a_swinging_load_and_a_wandering_bias_are_filtered_and_smoothed_as_by_the_textbook(filter_: Filter):
    model, F, Q, H = gusty_chain()
    readings = 0.3 * np.random.default_rng(5).standard_normal((40, 3))
    inputs = np.zeros((40, 3))
    course = kalman(model, F, Q, np.repeat(H[None], 40, axis=0), readings)
    found = smooth(model, inputs, readings, filter_)
    scale = np.sqrt([np.diag(cov) for _, cov in course])
    np.testing.assert_allclose((found.info.mean - [mean for mean, _ in course]) / scale, 0.0, atol=1e-6)
    np.testing.assert_allclose(found.info.std, scale, rtol=1e-6)
    smoothed = rauch_tung_striebel(course, F, Q)
    np.testing.assert_allclose((found.mean - [mean for mean, _ in smoothed]) / scale, 0.0, atol=1e-6)
    np.testing.assert_allclose(found.std, np.sqrt([np.diag(cov) for _, cov in smoothed]), rtol=1e-6)


def test_a_bank_knows_of_a_swinging_load_and_a_wandering_bias():
    model, F, Q, H = gusty_chain()
    readings = 0.3 * np.random.default_rng(5).standard_normal((40, 3))
    bank, _ = run_bank(bank_of([model] * 2), np.zeros((40, 3)), readings)
    mean, cov = kalman(model, F, Q, np.repeat(H[None], 40, axis=0), readings)[-1]
    np.testing.assert_allclose((bank.mean[0, :, 1] - mean) / np.sqrt(np.diag(cov)), 0.0, atol=1e-6)
    np.testing.assert_allclose(bank.cov[0, :, :, 1], cov, rtol=1e-6, atol=1e-12)


@every_filter
def test_each_parameter_and_bias_wanders_by_its_own_walk(filter_: Filter):
    model, F, Q = line_that_wanders()
    time = np.linspace(-1.0, 1.0, 30)
    H = np.array([[[1.0, 1.0, t], [0.0, 2.0, t]] for t in time])
    readings = np.random.default_rng(6).standard_normal((30, 2))
    course = kalman(model, F, Q, H, readings)
    found = smooth(model, time[:, None], readings, filter_)
    np.testing.assert_allclose(found.info.mean, [mean for mean, _ in course], atol=1e-6)
    smoothed = rauch_tung_striebel(course, F, Q)
    np.testing.assert_allclose(found.mean, [mean for mean, _ in smoothed], atol=1e-7)
    np.testing.assert_allclose(found.std, np.sqrt([np.diag(cov) for _, cov in smoothed]), rtol=1e-6)

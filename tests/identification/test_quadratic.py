"""A likelihood that is exactly quadratic: whatever is learned of it, at once or on line, is generalised least
squares."""

from dataclasses import replace

import numpy as np
import pytest

from tests.mechanics.models import Reads, symbols
from windsysid.filters import EKF
from windsysid.identification.estimate.online import advance, begin, finish
from windsysid.identification.estimate.scoring import information, posterior_mode
from windsysid.mechanics.equations import Equations
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.gauss_markov import GaussMarkov

RATE, SAMPLES = 10.0, 500
PRIOR_MEAN, PRIOR_COV = np.array([1.0, -2.0]), np.array([[0.3, 0.1], [0.1, 0.2]])


def build(theta: np.ndarray) -> StateSpace:
    """A trend a t + b beside three times a load that wanders: both coefficients move the innovations and nothing
    else."""
    a, b, t, w = symbols("a b t w")
    return compose(
        Equations("trend", (), (t,), (a, b), (w,), ()),
        rate=RATE,
        values={"a": theta[0], "b": theta[1]},
        loads=[GaussMarkov("w", 2.0, 1.5)],
        sensors=(Reads("cell", 3 * w + a * t + b, 0.4),),
    )


@pytest.fixture(scope="module")
def record() -> tuple[np.ndarray, np.ndarray]:
    """Inputs (trend, known load) and readings, of which a twentieth is missing."""
    rng = np.random.default_rng(8)
    trend = np.linspace(-1.0, 2.0, SAMPLES)
    readings = 1.7 * trend - 1.1 + 6.0 * rng.standard_normal(SAMPLES)
    readings[rng.random(SAMPLES) < 0.05] = np.nan
    return np.column_stack([trend, np.zeros(SAMPLES)]), readings[:, None]


def least_squares(inputs: np.ndarray, readings: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Posterior mean and covariance from the covariance of all readings at once."""
    seen = np.isfinite(readings[:, 0])
    time = np.arange(len(readings))[seen] / RATE
    cov = 9.0 * 4.0 * np.exp(-np.abs(time[:, None] - time) / 1.5) + 0.4**2 * np.eye(len(time))
    rows = np.column_stack([inputs[seen, 0], np.ones(len(time))])
    before = np.linalg.inv(PRIOR_COV)
    after = np.linalg.inv(before + rows.T @ np.linalg.solve(cov, rows))
    return after @ (before @ PRIOR_MEAN + rows.T @ np.linalg.solve(cov, readings[seen, 0])), after


def test_the_mode_is_that_of_generalised_least_squares(record: tuple[np.ndarray, np.ndarray]):
    found = posterior_mode(build, *record, prior=(PRIOR_MEAN, PRIOR_COV), start=(PRIOR_MEAN + 0.7, PRIOR_COV))
    mean, cov = least_squares(*record)
    np.testing.assert_allclose((found.mean - mean) / np.sqrt(np.diag(cov)), 0.0, atol=1e-6)
    np.testing.assert_allclose(found.cov, cov, rtol=1e-6)


def test_every_estimate_on_line_is_that_of_generalised_least_squares_so_far(record: tuple[np.ndarray, np.ndarray]):
    online, history = advance(build, begin(PRIOR_MEAN, PRIOR_COV, 20, (2, 1)), *record)
    _, last = finish(build, online)
    counts = [*history.samples, *last.samples]
    assert counts[0] == 20
    assert counts[-1] == SAMPLES
    for count, theta, spread in zip(counts, [*history.mean, *last.mean], [*history.cov, *last.cov], strict=True):
        mean, cov = least_squares(*(part[:count] for part in record))
        np.testing.assert_allclose((theta - mean) / np.sqrt(np.diag(cov)), 0.0, atol=1e-5, err_msg=f"{count}")
        np.testing.assert_allclose(spread, cov, rtol=1e-5, err_msg=f"{count}")


def test_a_reading_is_worth_a_half_in_the_square_of_a_scale_and_two_in_its_logarithm(
    record: tuple[np.ndarray, np.ndarray],
):
    # Load and noise e^θ times as large: innovations stay, log s moves by θ. Every reading has log s + z²/2, z ∝ e^−θ:
    # slope z² − 1, information 2.
    def louder(theta: np.ndarray) -> StateSpace:
        model, factor = build(np.array([1.7, -1.1])), float(np.exp(2.0 * theta[0]))
        blocks = model.blocks._replace(noise=model.blocks.noise * factor, load_noise=model.blocks.load_noise * factor)
        return replace(model, blocks=blocks, cov=model.cov * factor)

    model = louder(np.zeros(1))
    z = EKF.run(model, EKF.init(model), *record)[1].whitened
    gradient, fisher = information(louder, *record, np.zeros(1), np.array([1e-6]))
    assert fisher[0, 0] == pytest.approx(2.0 * np.isfinite(z).sum(), rel=1e-5)
    assert gradient[0] == pytest.approx(np.nansum(z**2 - 1.0), rel=1e-4)

"""On a linear model every filter and smoother equals a textbook Kalman filter and smoother."""

import numpy as np
import pytest
import scipy.stats
import sympy as sp

from tests.filters.test_protocol import every_filter
from tests.filters.textbook import composed, dense, kalman, rauch_tung_striebel, simulated
from windsysid.filters import EKF, IEKF, Filter, smooth
from windsysid.filters.bank import bank_of, run_bank
from windsysid.identification.fit_equations import Reading
from windsysid.mechanics.equations import Equations
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.gauss_markov import GaussMarkov


@every_filter
def test_every_filter_equals_a_kalman_filter_on_a_linear_model(filter_: Filter):
    model = composed()
    inputs, readings = simulated(model, 300, seed=32)
    belief, info = filter_.run(model, filter_.init(model), inputs, readings)
    for k, expected in enumerate(kalman(model, inputs, readings)):
        std = np.sqrt(np.diag(expected.cov))
        seen = ~np.isnan(readings[k])
        # 1e-9 relative; a state or innovation near zero is held to 1e-9 of its standard deviation
        np.testing.assert_allclose(info.std[k], std, rtol=1e-9)
        np.testing.assert_allclose(
            (info.mean[k] - expected.mean) / np.maximum(np.abs(expected.mean), std), 0.0, atol=1e-9
        )
        spread = np.sqrt(np.diag(expected.S))
        np.testing.assert_allclose(info.innovation_std[k, seen], spread, rtol=1e-9)
        np.testing.assert_allclose(
            info.innovation[k, seen] / spread, expected.innovation / spread, rtol=1e-9, atol=1e-9
        )
        L = np.linalg.cholesky(expected.S)
        np.testing.assert_allclose(info.whitening_std[k, seen], np.diag(L), rtol=1e-9)
        whitened = np.linalg.solve(L, expected.innovation) if seen.any() else expected.innovation
        np.testing.assert_allclose(info.whitened[k, seen], whitened, rtol=1e-9, atol=1e-9)
        assert info.log_likelihood[k] == pytest.approx(expected.log_likelihood, rel=1e-9, abs=1e-9)
    scale = np.outer(std, std)
    np.testing.assert_allclose(belief.cov / scale, expected.cov / scale, rtol=1e-9, atol=1e-9)


@every_filter
def test_every_smoother_equals_the_textbooks_on_a_linear_model(filter_: Filter):
    model = composed()
    inputs, readings = simulated(model, 300, seed=33)
    mean, cov = rauch_tung_striebel(kalman(model, inputs, readings))
    std = np.sqrt(np.einsum("kii->ki", cov))
    smoothed = smooth(model, inputs, readings, filter_)
    np.testing.assert_allclose((smoothed.mean - mean) / np.maximum(np.abs(mean), std), 0.0, atol=1e-9)
    np.testing.assert_allclose(smoothed.std, std, rtol=1e-9)


@every_filter
def test_the_log_likelihood_is_the_density_of_all_readings_at_once(filter_: Filter):
    # 40 samples as one Gaussian vector of about 105 readings, and SciPy's density of it: no recursion anywhere.
    model = composed()
    inputs, readings = simulated(model, 40, seed=34)
    _, _, _, expectation, cov = dense(model, inputs, 40)
    seen = ~np.isnan(readings.ravel())
    unit = np.tile(np.sqrt(model.blocks.noise), 40)[seen]  # SciPy takes small variances among large ones for none
    off, cov = (readings.ravel() - expectation)[seen] / unit, cov[np.ix_(seen, seen)] / np.outer(unit, unit)
    exact = scipy.stats.multivariate_normal.logpdf(off, cov=cov) - np.log(unit).sum()
    _, info = filter_.run(model, filter_.init(model), inputs, readings)
    assert info.log_likelihood.sum() == pytest.approx(exact, rel=1e-9)


@every_filter
def test_smoothing_is_conditioning_all_states_on_all_readings(filter_: Filter):
    model = composed()
    inputs, readings = simulated(model, 40, seed=35)
    states, cov, H, expectation, reading_cov = dense(model, inputs, 40)
    seen = ~np.isnan(readings.ravel())
    shared, S = (H @ cov)[seen], reading_cov[np.ix_(seen, seen)]
    exact = states + shared.T @ np.linalg.solve(S, readings.ravel()[seen] - expectation[seen])
    std = np.sqrt(np.diag(cov - shared.T @ np.linalg.solve(S, shared)))
    smoothed = smooth(model, inputs, readings, filter_)
    np.testing.assert_allclose(
        (smoothed.mean.ravel() - exact) / std, 0.0, atol=1e-8
    )  # 1e-9 and what the dense solve loses
    np.testing.assert_allclose(smoothed.std.ravel(), std, rtol=1e-8)


def test_iterating_a_linear_reading_changes_nothing():
    model = composed()
    inputs, readings = simulated(model, 300, seed=36)
    (_, once), (_, iterated) = (f.run(model, f.init(model), inputs, readings) for f in (EKF, IEKF))
    np.testing.assert_allclose(iterated.mean / once.std, once.mean / once.std, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(iterated.std, once.std, rtol=1e-12)
    np.testing.assert_allclose(iterated.log_likelihood, once.log_likelihood, rtol=1e-12, atol=1e-12)


# A reading whose offset wanders: a first-order load w, an offset b that is a random walk, and white noise.

OFFSET, DRIFT, NOISE, RMS, TAU, STEP, SAMPLES = 0.3, 0.8, 0.2, 1.5, 0.4, 0.05, 60


def wandering() -> StateSpace:
    w = sp.Symbol("w", real=True)
    cell = Equations("cell", (), (), (), (w,), ())
    reading = Reading("cell", w, NOISE, bias=OFFSET, drift=DRIFT)
    return compose(cell, rate=1.0 / STEP, values={}, loads=[GaussMarkov("w", RMS, TAU)], sensors=[reading])


def wandering_by_hand() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Covariances (T, T) of w, b and the readings without a filter: e^{−|t|/τ}, min(t, t'), and white noise."""
    time = STEP * np.arange(SAMPLES)
    w = RMS**2 * np.exp(-np.abs(time[:, None] - time) / TAU)
    b = OFFSET**2 + DRIFT**2 * np.minimum(time[:, None], time)
    return w, b, w + b + NOISE**2 * np.eye(SAMPLES)


def wandering_readings() -> np.ndarray:
    readings = np.random.default_rng(37).multivariate_normal(np.zeros(SAMPLES), wandering_by_hand()[2])
    readings[20:27] = np.nan
    return np.asarray(readings[:, None])


@every_filter
def test_a_wandering_offset_is_smoothed_as_a_gaussian_process(filter_: Filter):
    model, readings, (w, b, y) = wandering(), wandering_readings(), wandering_by_hand()
    seen = ~np.isnan(readings[:, 0])
    smoothed = smooth(model, np.zeros((SAMPLES, 1)), readings, filter_)
    for name, own in (("w", w), ("bias_cell", b)):
        gain = np.linalg.solve(y[np.ix_(seen, seen)], own[seen]).T
        std = np.sqrt(np.diag(own - gain @ own[seen]))
        i = model.states.index(name)
        np.testing.assert_allclose((smoothed.mean[:, i] - gain @ readings[seen, 0]) / std, 0.0, atol=1e-8)
        np.testing.assert_allclose(smoothed.std[:, i], std, rtol=1e-8)


def test_a_bank_knows_a_wandering_offset():
    model, readings, (_, _, y) = wandering(), wandering_readings(), wandering_by_hand()
    seen = ~np.isnan(readings[:, 0])
    exact = scipy.stats.multivariate_normal.logpdf(readings[seen, 0], cov=y[np.ix_(seen, seen)])
    _, scores = run_bank(bank_of([model]), np.zeros((SAMPLES, 1)), readings)
    found = -(scores.log_std + 0.5 * scores.whitened**2).sum() - 0.5 * seen.sum() * np.log(2.0 * np.pi)
    assert found == pytest.approx(exact, rel=1e-9)

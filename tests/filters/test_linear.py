"""Where theory is exact: on a linear model every filter and smoother equals a Kalman filter and smoother that we did not write for it."""

import numpy as np
import pytest
import scipy.stats

from tests.filters.test_protocol import every_filter
from tests.filters.textbook import composed, dense, kalman, rauch_tung_striebel, simulated
from windsysid.filters import EKF, IEKF, Filter, smooth


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

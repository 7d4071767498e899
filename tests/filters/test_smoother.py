"""What a smoother promises beyond a linear model: every model, singular covariances, memory, and honest bands."""

import numpy as np
import pytest

from tests.filters.test_protocol import (
    LOADS,
    MODELS,
    chain_with,
    every_filter,
    every_model,
    record,
    rotor_with_everything,
)
from windsysid.filters import EKF, UKF, Filter, smooth, smoother
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.random_loads import draw_loads
from windsysid.statespace.compose import compose
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine


@every_filter
@every_model
def test_every_model_is_smoothed_and_ends_where_the_filter_ends(filter_: Filter, name: str):
    model = MODELS[name]()
    inputs, readings = record(model)
    belief, info = filter_.run(model, filter_.init(model), inputs, readings)
    smoothed = smooth(model, inputs, readings, filter_)
    assert smoothed.mean.shape == smoothed.std.shape == (40, len(model.states))
    assert np.isfinite(smoothed.mean).all()
    assert np.isfinite(smoothed.std).all()
    np.testing.assert_array_equal(smoothed.mean[-1], belief.mean)
    np.testing.assert_allclose(smoothed.std[-1] ** 2, np.diag(belief.cov), rtol=1e-12)
    for ours, filters in zip(smoothed.info, info, strict=True):
        np.testing.assert_array_equal(ours, filters)


@every_filter
@pytest.mark.parametrize("samples", [0, 1])
def test_a_record_of_no_or_one_sample_is_the_filters(filter_: Filter, samples: int):
    model = chain_with(loads=LOADS)
    inputs, readings = (array[:samples] for array in record(model))
    _, info = filter_.run(model, filter_.init(model), inputs, readings)
    smoothed = smooth(model, inputs, readings, filter_)
    np.testing.assert_array_equal(smoothed.mean, info.mean)
    np.testing.assert_allclose(smoothed.std, info.std, rtol=1e-12)


@every_filter
@pytest.mark.parametrize("chunk", [1, 7, 20, 39])
def test_chunks_leave_no_seam(filter_: Filter, chunk: int, monkeypatch: pytest.MonkeyPatch):
    model = rotor_with_everything()
    inputs, readings = record(model)
    whole = smooth(model, inputs, readings, filter_)
    monkeypatch.setattr(smoother, "CHUNK_SAMPLES", chunk)
    pieces = smooth(model, inputs, readings, filter_)
    np.testing.assert_array_equal(pieces.mean, whole.mean)
    np.testing.assert_array_equal(pieces.std, whole.std)


@pytest.mark.parametrize("filter_", [EKF, UKF], ids=["extended", "unscented"])
def test_a_parameter_that_stays_has_one_value_throughout(filter_: Filter):
    # And no rounding adds up: 3000 samples, the parameters' pivots being those of a singular step.
    model = chain_with(loads=LOADS, parameters=[Parameter("k_2", 330.0, 0.2), Parameter("c_1", 1.0, 0.3, False, 10.0)])
    rng = np.random.default_rng(61)
    truth = chain_with(loads=LOADS)
    loads = draw_loads(LOADS, truth.compiled.loads, 3000, 50.0, rng)
    clean = integrate(truth.compiled, truth.blocks.p, loads, rate=50.0, start=np.zeros(6), substeps=4).readings
    readings = clean + np.sqrt(truth.blocks.noise) * rng.standard_normal(clean.shape)
    smoothed = smooth(model, np.zeros((3000, 3)), readings, filter_)
    last, std = smoothed.info.mean[-1, -2:], smoothed.info.std[-1, -2:]
    np.testing.assert_allclose((smoothed.mean[:, -2:] - last) / std, 0.0, atol=1e-6)
    np.testing.assert_allclose(smoothed.std[:, -2:] / std, 1.0, atol=1e-6)


@every_filter
def test_a_motion_without_any_uncertainty_stays_the_filters(filter_: Filter):
    model = chain_with(mean=[0.1, 0.0, -0.1, 0.0, 0.2, 0.0], cov=np.zeros((6, 6)))
    inputs, readings = record(model)
    smoothed = smooth(model, inputs, readings, filter_)
    np.testing.assert_array_equal(smoothed.std, 0.0)
    np.testing.assert_array_equal(smoothed.mean, smoothed.info.mean)


@every_filter
def test_one_uncertain_number_is_smoothed_as_by_least_squares(filter_: Filter):
    # Only q_2's start is uncertain and nothing shakes the chain: every covariance has rank one, every state is a line
    # in that start, and the whole record is one least-squares problem for it.
    cov = np.zeros((6, 6))
    cov[1, 1] = 0.3**2
    inputs, readings = record(chain_with())
    readings = 0.1 * readings

    def course(start: float) -> np.ndarray:
        model = chain_with(mean=[0.0, start, 0.0, 0.0, 0.0, 0.0], cov=np.zeros((6, 6)))
        return np.asarray(EKF.run(model, EKF.init(model), inputs, readings)[1].mean)

    def residual(start: float) -> np.ndarray:
        model = chain_with(mean=[0.0, start, 0.0, 0.0, 0.0, 0.0], cov=np.zeros((6, 6)))
        innovation = EKF.run(model, EKF.init(model), inputs, readings)[1].innovation / np.sqrt(model.blocks.noise)
        return np.asarray(innovation[~np.isnan(innovation)])

    slope = residual(1.0) - residual(0.0)
    information = 1.0 / 0.3**2 + slope @ slope
    start = -slope @ residual(0.0) / information
    model = chain_with(cov=cov)
    smoothed = smooth(model, inputs, readings, filter_)
    per_start = course(1.0) - course(0.0)
    scale = np.maximum(np.abs(per_start), 0.01) / np.sqrt(information)
    np.testing.assert_allclose((smoothed.mean - course(start)) / scale, 0.0, atol=1e-6)
    np.testing.assert_allclose((smoothed.std - np.abs(per_start) / np.sqrt(information)) / scale, 0.0, atol=1e-6)


@pytest.mark.parametrize("filter_", [EKF, pytest.param(UKF, marks=pytest.mark.slow)], ids=["extended", "unscented"])
def test_smoothed_loads_of_the_rotor_are_better_than_filtered_and_err_as_they_say(verne555: Turbine, filter_: Filter):
    # 60 records of 1 s of the turning rotor, five loads that nobody measures. Errors within a record are much alike: of
    # 60 × 5 independent squares the mean has the standard error √(2/300) = 0.08; bounds four of them.
    rng = np.random.default_rng(62)
    model = compose(
        verne555.model, rate=100.0, values=verne555.values, loads=verne555.loads, sensors=verne555.sensors,
        cov=np.diag([1e-3] * 5 + [1e-2] * 5) ** 2,
    )  # fmt: skip
    rotor = constant_speed_inputs(verne555.rotor_speed, 1.0, 100.0)
    unknown = np.hstack([rotor, np.zeros((100, 5))])
    squares, filtered = [], []
    for _ in range(60):
        loads = draw_loads(verne555.loads, model.compiled.loads, 100, 100.0, rng)
        start = np.diag(model.cov)[:10] ** 0.5 * rng.standard_normal(10)
        response = integrate(model.compiled, model.blocks.p, np.hstack([rotor, loads]), rate=100.0, start=start)
        readings = response.readings + np.sqrt(model.blocks.noise) * rng.standard_normal(response.readings.shape)
        smoothed = smooth(model, unknown, readings, filter_)
        truth = np.hstack([response.states, loads])
        squares.append(((smoothed.mean - truth) / smoothed.std) ** 2)
        filtered.append(((smoothed.info.mean - truth) / smoothed.std) ** 2)
        assert np.all(smoothed.std <= smoothed.info.std * (1 + 1e-9))
    assert model.states[10:] == model.compiled.loads
    assert np.mean(np.array(squares)[..., 10:]) == pytest.approx(1.0, abs=0.32)
    assert np.mean(np.array(squares)[..., :10]) == pytest.approx(1.0, abs=0.32)
    assert np.mean(np.array(squares)[..., 10:]) < 0.7 * np.mean(np.array(filtered)[..., 10:])

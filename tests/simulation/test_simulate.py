"""The simulator: order of the integrator, statistics of the drawn loads, refusals."""

import numpy as np
import pytest
import scipy.integrate

from windsysid.errors import ConfigurationError
from windsysid.mechanics import compile_model
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.random_loads import gauss_markov_loads
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.turbine.turbine import Turbine


@pytest.fixture(scope="module")
def rotor(verne555: Turbine):
    return compile_model(verne555.model, verne555.sensors, verne555.model.coefficients)


@pytest.fixture(scope="module")
def p(verne555: Turbine, rotor) -> np.ndarray:
    return np.array([verne555.values[name] for name in rotor.parameters])


def test_the_integrator_has_order_4_against_dop853(verne555: Turbine, rotor, p: np.ndarray):
    # Ω constant and loads on a ramp: linear inputs are then exact at every stage, and the error is RK4's own.
    duration, rate, speed = 4.0, 25.0, verne555.rotor_speed
    start = np.concatenate([0.02 * np.ones(5), np.linspace(-0.3, 0.3, 5)])
    slope = np.array([3.0, -2.0, 4.0, -1.0, 2.0])
    turning = constant_speed_inputs(speed, duration, rate)
    time = np.arange(len(turning)) / rate
    inputs = np.column_stack([turning, np.outer(time, slope)])
    out = np.empty(10)

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        rotor.rates(np.ascontiguousarray(x), np.array([speed * t, speed, 0.0]), p, t * slope, out)
        return out.copy()

    exact = scipy.integrate.solve_ivp(
        rates, (0.0, time[-1]), start, method="DOP853", t_eval=time, rtol=1e-13, atol=1e-15
    ).y.T
    steps = np.array([4, 8, 16, 32])
    errors = np.array([
        np.abs(integrate(rotor, p, inputs, rate=rate, start=start, substeps=int(n)).states - exact).max() for n in steps
    ])  # fmt: skip
    orders = -np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert np.all((orders > 3.8) & (orders < 4.2)), f"observed orders {orders}, errors {errors}"


def test_rates_and_readings_belong_to_the_states_beside_them(rotor, p: np.ndarray, verne555: Turbine):
    inputs = np.column_stack([constant_speed_inputs(verne555.rotor_speed, 1.0, 100.0), np.full((100, 5), 2.0)])
    response = integrate(rotor, p, inputs, rate=100.0, start=np.full(10, 0.01))
    np.testing.assert_array_equal(response.states[0], np.full(10, 0.01))
    rates, reading = np.empty(10), np.empty(5)
    for k in (0, 57, 99):
        rotor.rates(response.states[k].copy(), inputs[k, :3].copy(), p, inputs[k, 3:].copy(), rates)
        rotor.reading(response.states[k].copy(), inputs[k, :3].copy(), p, inputs[k, 3:].copy(), reading)
        np.testing.assert_array_equal(response.rates[k], rates)
        np.testing.assert_array_equal(response.readings[k], reading)
    np.testing.assert_allclose(response.readings, response.rates[:, 5:], rtol=1e-12, atol=1e-12)


def test_the_simulator_leaves_its_arguments_alone(rotor, p: np.ndarray):
    inputs, start = np.zeros((5, 8)), np.full(10, 0.01)
    before = p.copy()
    integrate(rotor, p, inputs, rate=100.0, start=start)
    assert not inputs.any()
    np.testing.assert_array_equal(start, np.full(10, 0.01))
    np.testing.assert_array_equal(p, before)


def test_constant_speed_means_that_azimuth_grows_evenly():
    inputs = constant_speed_inputs(7.0, 2.0, 50.0)
    assert inputs.shape == (100, 3)
    np.testing.assert_allclose(inputs[:, 0], 7.0 * np.arange(100) / 50.0)
    assert np.all(inputs[:, 1] == 7.0)
    assert not inputs[:, 2].any()


def test_drawn_loads_have_the_stated_rms_and_correlation_time():
    # Standard errors over n samples with neighbours correlated by ρ = exp(−Δt/τ): of the mean square relative to σ⁴
    # (2/n)(1 + ρ²)/(1 − ρ²), hence half its root for the rms; of ρ itself √((1 − ρ²)/n). Bounds are four of them.
    load = GaussMarkov("load_x", rms=15.0, time_constant=0.5)
    n, rate = 200_000, 20.0
    drawn = gauss_markov_loads([load], ("load_y", "load_x"), n, rate, np.random.default_rng(11))
    assert drawn.shape == (n, 2)
    assert not drawn[:, 0].any()
    w = drawn[:, 1]
    rho = np.exp(-1.0 / (rate * load.time_constant))
    rms_error = 0.5 * np.sqrt(2.0 / n * (1 + rho**2) / (1 - rho**2))
    assert np.sqrt(np.mean(w**2)) == pytest.approx(15.0, rel=4 * rms_error)
    assert abs(w.mean()) < 4 * 15.0 * np.sqrt((1 + rho) / (1 - rho) / n)
    for lag in (1, 5):
        observed = np.mean(w[lag:] * w[:-lag]) / np.mean(w**2)
        assert observed == pytest.approx(rho**lag, abs=4 * lag * np.sqrt((1 - rho**2) / n))


def test_drawn_loads_are_stationary_from_the_first_sample():
    # The rms of the first sample over 4000 independent draws; its standard error is 1/√(2 · 4000) of it.
    names = tuple(f"load_{i}" for i in range(4000))
    loads = [GaussMarkov(name, rms=3.0, time_constant=2.0) for name in names]
    drawn = gauss_markov_loads(loads, names, 2, 100.0, np.random.default_rng(12))
    for k in (0, 1):
        assert np.sqrt(np.mean(drawn[k] ** 2)) == pytest.approx(3.0, rel=4.0 / np.sqrt(8000))


def test_the_same_seed_draws_the_same_loads():
    draw = lambda seed: gauss_markov_loads(  # noqa: E731
        [GaussMarkov("a", 1.0, 1.0)], ("a",), 50, 10.0, np.random.default_rng(seed)
    )
    np.testing.assert_array_equal(draw(1), draw(1))
    assert not np.array_equal(draw(1), draw(2))


def test_a_motion_that_grows_without_bound_is_one_clear_error(rotor, p: np.ndarray):
    unstable = p.copy()
    unstable[rotor.parameters.index("k_x")] = -1e7
    with pytest.raises(ConfigurationError, match=r"grows without bound after .* s: check stiffness"):
        integrate(rotor, unstable, np.zeros((2000, 8)), rate=100.0, start=np.full(10, 0.01))


@pytest.mark.parametrize(
    ("parameters", "inputs", "start"), [((3,), (5, 8), (10,)), (None, (5, 7), (10,)), (None, (5, 8), (9,))]
)
def test_shapes_that_do_not_fit_are_named(rotor, p, parameters, inputs, start):
    given = p if parameters is None else np.zeros(parameters)
    with pytest.raises(ValueError, match=r"expected p .* inputs \(T, 8\), start \(10,\); got"):
        integrate(rotor, given, np.zeros(inputs), rate=100.0, start=np.zeros(start))

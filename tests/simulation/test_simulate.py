"""The simulator: order of the integrator, statistics of the drawn loads, refusals."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.integrate
from scipy.signal import lfilter

from windsysid.errors import ConfigurationError
from windsysid.loads.family import hypothesis
from windsysid.mechanics import compile_model
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.random_loads import draw_loads
from windsysid.simulation.record import simulate_record
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.process import load_on, second_order
from windsysid.turbine.file import load_turbine
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
    drawn = draw_loads([load], ("load_y", "load_x"), n, rate, np.random.default_rng(11))
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


@pytest.mark.slow
def test_drawn_loads_are_stationary_from_the_first_sample():
    # The rms of the first sample over 4000 independent draws; its standard error is 1/√(2 · 4000) of it.
    names = tuple(f"load_{i}" for i in range(4000))
    loads = [GaussMarkov(name, rms=3.0, time_constant=2.0) for name in names]
    drawn = draw_loads(loads, names, 2, 100.0, np.random.default_rng(12))
    for k in (0, 1):
        assert np.sqrt(np.mean(drawn[k] ** 2)) == pytest.approx(3.0, rel=4.0 / np.sqrt(8000))


def test_drawn_first_order_loads_are_scipys_recursion_to_the_bit():
    load, line = GaussMarkov("load_x", 15.0, 0.5), GaussMarkov("load_y", 4.0, 8.0, harmonic=3)
    azimuth = np.linspace(0.0, 40.0, 500)
    drawn = draw_loads([load, line], ("load_x", "load_y"), 500, 20.0, np.random.default_rng(7), azimuth)
    rng = np.random.default_rng(7)
    for one, n, column in ((load, 1, 0), (line, 2, 1)):
        factor, variance = np.exp(-0.05 / one.time_constant), one.rms**2 * -np.expm1(-0.1 / one.time_constant)
        noise = rng.standard_normal((500, n)) * np.sqrt(variance)
        noise[:1] *= one.rms / np.sqrt(variance)
        expected = lfilter([1.0], [1.0, -factor], noise, axis=0)
        if n == 2:
            expected = expected * np.column_stack([np.cos(3 * azimuth), np.sin(3 * azimuth)])
        np.testing.assert_array_equal(drawn[:, column], expected.sum(axis=1))


def test_a_drawn_second_order_load_has_the_correlation_of_a_damped_oscillation():
    # R(t) = σ² e^{−ζωt} (cos ω_d t + ζ/√(1−ζ²) sin ω_d t). Over n samples of a process with that correlation, the
    # standard error of R(t)/σ² is below √(2 Σ ρ²/n), summed over all lags of either sign; bounds are four of them.
    rms, frequency, ratio, rate, n = 3.0, 1.5, 0.2, 20.0, 200_000
    block = load_on("load_x", second_order(rms, frequency, ratio))
    w = draw_loads([block], ("load_x",), n, rate, np.random.default_rng(5))[:, 0]
    t, omega = np.arange(200) / rate, 2.0 * np.pi * frequency
    turn = omega * np.sqrt(1.0 - ratio**2)
    rho = np.exp(-ratio * omega * t) * (np.cos(turn * t) + ratio / np.sqrt(1.0 - ratio**2) * np.sin(turn * t))
    bound = 4.0 * np.sqrt(2.0 * (2.0 * np.sum(rho**2) - 1.0) / n)
    for lag in (0, 1, 3, 7, 20):
        assert np.mean(w[lag:] * w[: n - lag]) / rms**2 == pytest.approx(rho[lag], abs=bound), lag


def test_the_first_sample_of_a_drawn_block_is_stationary_too():
    # Mean square of the first sample over 4000 draws; its standard error is √(2/4000) of it.
    block, rng = load_on("load_x", second_order(3.0, 1.5, 0.2)), np.random.default_rng(6)
    first = [draw_loads([block], ("load_x",), 2, 50.0, rng)[:, 0] for _ in range(4000)]
    np.testing.assert_allclose(np.mean(np.square(first), axis=0), 9.0, rtol=4.0 * np.sqrt(2.0 / 4000))


def test_a_load_that_a_model_does_not_have_is_not_drawn_in_silence():
    with pytest.raises(ConfigurationError, match="load 'load_x': expected one of load_y"):
        draw_loads([GaussMarkov("load_x", 1.0, 1.0)], ("load_y",), 5, 10.0, np.random.default_rng(0))


@pytest.mark.parametrize("name", ["broadband", "second-order", "narrow-band", "rotor-wind"])
def test_the_simulator_plays_every_hypothesis(verne555: Turbine, name: str):
    """What it draws has the variances of the hypothesis at every azimuth, averaged over a turn, within four standard
    errors."""
    supposed = hypothesis(name, verne555, verne555.loads)
    names, rate, samples = supposed.turbine.model.loads, 50.0, 20_000
    azimuth = np.asarray(verne555.rotor_speed * np.arange(samples) / rate, dtype=np.float64)
    drawn = draw_loads(supposed.given(), names, samples, rate, np.random.default_rng(3), azimuth)
    variance = np.zeros(len(names))
    for block in supposed.given():
        for load, rows in block.outputs.items():
            along = np.einsum("kn,nm,km->k", rows, block.cov, rows)
            variance[names.index(load)] += along[0] + 0.5 * along[1:].sum()
    parts = np.square(drawn).reshape(40, -1, len(names)).mean(axis=1)
    error = parts.std(axis=0, ddof=1) / np.sqrt(40)
    assert np.all(np.abs(parts.mean(axis=0) - variance) < 4.0 * error)
    record = simulate_record(verne555, duration=2.0, rate=50.0, loads=name)
    assert np.isfinite(record.values).all()


def test_loads_that_nobody_knows_are_refused(verne555: Turbine):
    playable = "random, wind, wind-feedback, broadband, second-order, narrow-band, rotor-wind"
    with pytest.raises(ConfigurationError, match=rf"loads: expected one of {playable}.*; got 'gusts'"):
        simulate_record(verne555, duration=2.0, rate=50.0, loads="gusts")
    with pytest.raises(ConfigurationError, match="load model rotor-wind: expected a rotor with blades of its own"):
        simulate_record("tower", duration=2.0, rate=50.0, loads="rotor-wind")


def test_the_same_seed_draws_the_same_loads():
    draw = lambda seed: draw_loads(  # noqa: E731
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


def test_a_record_of_a_machine_that_is_hardly_damped_begins_in_stationary_vibration():
    """From rest under its weight a blade swings for minutes, and a spectrum took its decay for less damping: blade 3
    had 0.65 of what it has."""
    machine = load_turbine("nrel5mw")
    quiet = replace(
        machine,
        loads=tuple(replace(load, rms=1e-6 * load.rms) for load in machine.loads),
        sensors=tuple(sensor.model_copy(update={"noise": 1e-6 * sensor.noise}) for sensor in machine.sensors),
    )
    turn = 2.0 * np.pi / machine.rotor_speed
    made = simulate_record(quiet, duration=30.0 * turn, rate=50.0 / turn * 4.0)
    per_turn = 200
    for sensor in machine.sensors:
        read = made[sensor.channel]
        first, last = read[: 2 * per_turn], read[-2 * per_turn :]
        assert np.abs(first - last).max() < 0.02 * np.abs(read).max(), sensor.channel

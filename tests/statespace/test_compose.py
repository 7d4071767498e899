"""Composition: what ends up where in the state, and what is refused."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.mechanics.models import CHAIN_VALUES, chain, chain_sensors
from windsysid.errors import ConfigurationError
from windsysid.statespace.compose import StateSpace, compose, discretise_loads, parameters_given
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.process import LoadBlock
from windsysid.turbine.turbine import Turbine

LOADS = (GaussMarkov("load_3", 2.0, 1.5), GaussMarkov("load_1", 5.0, 0.5))
PARAMETERS = (Parameter("k_2", 330.0, 0.2), Parameter("c_1", 1.0, 0.4, logarithmic=False, scale=50.0))


def composed(**changes: Any) -> StateSpace:
    blocks: dict[str, Any] = {
        "rate": 50.0,
        "values": CHAIN_VALUES,
        "parameters": PARAMETERS,
        "loads": LOADS,
        "sensors": chain_sensors(bias=0.3),
    }
    return compose(chain(), **(blocks | changes))


def test_the_state_is_motion_loads_biases_parameters_in_that_order():
    model = composed()
    motion = ("q_1", "q_2", "q_3", "v_1", "v_2", "v_3")
    assert model.states == (*motion, "load_3", "load_1", "bias_acceleration_3", "k_2", "c_1")
    assert model.inputs == ("load_1", "load_2", "load_3")
    assert model.readings == ("acceleration_1", "acceleration_3", "displacement_2")
    assert list(model.states)[model.parameter_block] == ["k_2", "c_1"]
    assert model.blocks.step == [1.0 / 50.0]
    assert list(model.blocks.sizes) == [6, 2, 1, 2, 0, 3]
    np.testing.assert_array_equal(model.blocks.bias_of, [-1, 0, -1])
    np.testing.assert_array_equal(model.blocks.load_output, [[[0, 1], [0, 0], [1, 0]]])
    np.testing.assert_allclose(model.blocks.noise, [0.05**2, 0.08**2, 0.002**2])


def test_inputs_of_a_rotor_come_before_its_loads(verne555: Turbine):
    model = compose(verne555.model, rate=100.0, values=verne555.values, sensors=verne555.sensors)
    assert model.inputs[:4] == ("rotor_azimuth", "rotor_speed", "rotor_acceleration", "load_x")
    assert model.states == verne555.model.states


def test_the_prior_is_that_of_each_block():
    model = composed(mean=np.arange(6.0), cov=np.diag(np.arange(1.0, 7.0)))
    np.testing.assert_allclose(model.mean, [0, 1, 2, 3, 4, 5, 0, 0, 0, 0, 1.0 / 50.0])
    np.testing.assert_allclose(np.diag(model.cov), [1, 2, 3, 4, 5, 6, 4, 25, 0.09, 0.04, (0.4 / 50.0) ** 2])
    assert np.count_nonzero(model.cov) == 11
    np.testing.assert_array_equal(composed().cov[:6, :6], np.eye(6))
    assert not composed().mean[:6].any()


def test_parameters_given_take_the_place_of_values():
    values = {name: value for name, value in CHAIN_VALUES.items() if name not in ("k_2", "c_1")}
    with_values, without = composed(), composed(values=values)
    np.testing.assert_array_equal(with_values.blocks.p, without.blocks.p)
    assert with_values.blocks.p[with_values.compiled.parameters.index("k_2")] == 330.0


def test_the_model_at_given_parameters_is_the_one_composed_without_them():
    # Loads three times as loud and half as slow, other noise, θ off the prior's centre; 36 and 225 are (3 · 2)² and (3
    # · 5)².
    joint, theta, noise = composed(), np.array([0.1, 0.03]), np.array([0.1, 0.2, 0.3])
    loads = [GaussMarkov(load.load, 3.0 * load.rms, 0.5 * load.time_constant) for load in LOADS]
    values = CHAIN_VALUES | {"k_2": 330.0 * np.exp(0.1), "c_1": 50.0 * 0.03}
    sensors = [replace(s, noise=n) for s, n in zip(chain_sensors(bias=0.3), noise.tolist(), strict=True)]
    expected = composed(parameters=(), values=values, loads=loads, sensors=sensors)
    blocks = discretise_loads(loads, expected.compiled, joint.blocks.step)
    given = parameters_given(joint, expected.compiled, theta, blocks, noise)
    np.testing.assert_allclose(np.diag(given.cov), [1.0] * 6 + [36.0, 225.0, 0.09])
    for name in ("states", "parameters", "readings"):
        assert getattr(given, name) == getattr(expected, name)
    np.testing.assert_array_equal(given.mean, expected.mean)
    np.testing.assert_allclose(given.cov, expected.cov)
    for name, ours, theirs in zip(given.blocks._fields, given.blocks, expected.blocks, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, err_msg=name)


def test_an_unrelated_value_does_no_harm():
    assert composed(values=CHAIN_VALUES | {"colour": 3.0}).states == composed().states


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"values": {k: v for k, v in CHAIN_VALUES.items() if k != "m_2"}}, "parameter 'm_2': .* got none"),
        ({"values": CHAIN_VALUES | {"m_2": float("nan")}}, "parameter 'm_2': expected a finite value, got nan"),
        ({"values": CHAIN_VALUES | {"m_2": float("inf")}}, "parameter 'm_2': expected a finite value, got inf"),
        ({"loads": [GaussMarkov("load_9", 1.0, 1.0)]}, "load 'load_9': expected one of load_1, load_2, load_3"),
        ({"loads": [LOADS[0], LOADS[0]]}, "load 'load_3': two load models have a state of this name"),
        ({"rate": 0.0}, "sampling rate: expected a positive number of Hz, got 0"),
        ({"rate": -5.0}, "sampling rate"),
        ({"rate": float("nan")}, "sampling rate"),
        ({"rate": float("inf")}, "sampling rate"),
        ({"parameters": [PARAMETERS[0], PARAMETERS[0]]}, "listed twice among those to identify: k_2, k_2"),
        ({"parameters": [Parameter("k_7", 1.0, 1.0)]}, "no parameter 'k_7' to identify"),
        ({"mean": np.zeros(5)}, r"prior mean: expected 6 finite numbers, .* got shape \(5,\)"),
        ({"mean": np.full(6, np.nan)}, "prior mean: expected 6 finite numbers"),
        ({"cov": np.eye(5)}, r"prior covariance: expected 6 × 6 finite numbers, .* got shape \(5, 5\)"),
        ({"walk": {"k_3": 0.1}}, "walk: 'k_3' is not identified: expected one of k_2, c_1"),
        ({"walk": {"k_2": -0.1}}, "walk of 'k_2': expected a finite number, 0 or more, got -0.1"),
        ({"sensors": (chain_sensors()[0],) * 2}, "channel 'acceleration_1' is read twice"),
        (
            {"sensors": (replace(chain_sensors()[0], noise=0.0),)},
            "sensor 'acceleration_1': expected a positive noise, got 0.0",
        ),
        ({"sensors": (replace(chain_sensors()[0], noise=float("nan")),)}, "expected a positive noise, got nan"),
    ],
)
def test_what_cannot_be_composed_is_one_clear_line(changes: dict[str, Any], complaint: str):
    with pytest.raises(ConfigurationError, match=complaint) as caught:
        composed(**changes)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("parameter", PARAMETERS, ids=["logarithmic", "linear"])
def test_a_parameter_goes_to_filter_coordinates_and_back(parameter: Parameter):
    mean, std = parameter.prior
    assert parameter.physical(mean) == pytest.approx(parameter.centre, rel=1e-14)
    step = 1e-6
    slope = (parameter.physical(mean + step) - parameter.physical(mean - step)) / (2 * step)
    in_si = parameter.spread * (parameter.centre if parameter.logarithmic else 1.0)
    assert slope * std == pytest.approx(in_si, rel=1e-8)
    np.testing.assert_allclose(parameter.physical([mean, mean]), [parameter.centre] * 2)


def test_a_logarithmic_parameter_stays_positive_and_a_linear_one_may_not():
    stiffness, damping = PARAMETERS
    assert np.all(stiffness.physical(np.linspace(-20.0, 20.0, 9)) > 0.0)
    assert damping.physical(-0.01) == pytest.approx(-0.5)


@pytest.mark.parametrize(
    ("centre", "spread", "logarithmic", "scale"),
    [
        (-1.0, 0.3, True, 1.0), (0.0, 0.3, True, 1.0), (float("nan"), 0.3, True, 1.0), (1.0, 0.0, True, 1.0),
        (1.0, -1.0, False, 1.0), (1.0, float("inf"), True, 1.0), (1.0, 0.3, False, 0.0),
        (1.0, 0.3, False, float("nan")),
    ],
)  # fmt: skip
def test_an_absurd_prior_is_refused(centre: float, spread: float, logarithmic: bool, scale: float):
    with pytest.raises(ConfigurationError, match="prior of 'k': expected"):
        Parameter("k", centre, spread, logarithmic, scale)


@pytest.mark.parametrize(
    ("rms", "tau"), [(0.0, 1.0), (1.0, 0.0), (-1.0, 1.0), (1.0, float("inf")), (float("nan"), 1.0)]
)
def test_an_absurd_load_is_refused(rms: float, tau: float):
    with pytest.raises(ConfigurationError, match="load 'w': expected a positive rms and time constant"):
        GaussMarkov("w", rms, tau)


def test_a_load_is_discretised_exactly():
    # Two half steps make one whole step, and the stationary variance stays what it is.
    swing = LoadBlock(("w", "v"), np.array([[0.0, 1.0], [-4.0, -0.8]]), np.diag([9.0, 36.0]), {"w": np.ones((1, 2))})
    for load in (GaussMarkov("w", 3.0, 0.7), swing):
        (a, q), (half, quarter) = load.discretise(0.1), load.discretise(0.05)
        np.testing.assert_allclose(a, half @ half, rtol=1e-13)
        np.testing.assert_allclose(q, half @ quarter @ half.T + quarter, rtol=1e-10, atol=1e-13)
        np.testing.assert_allclose(a @ load.cov @ a.T + q, load.cov, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize(
    ("drift", "cov", "rows", "complaint"),
    [
        (np.eye(1), np.eye(1), np.ones((1, 1)), "expected a block that returns to its mean"),
        (-np.eye(2), np.eye(1), np.ones((1, 1)), "expected a finite drift 1 × 1"),
        (-np.eye(1), np.eye(1), np.ones((2, 1)), "expected finite rows H₀, C₁, S₁"),
        (-np.eye(1), np.full((1, 1), np.nan), np.ones((1, 1)), "expected a finite covariance"),
    ],
)
def test_a_block_that_makes_no_sense_is_refused(drift: Any, cov: Any, rows: Any, complaint: str):
    with pytest.raises(ConfigurationError, match=complaint):
        LoadBlock(("w",), drift, cov, {"w": rows})


def test_blocks_join_in_order_and_add_up_on_one_load():
    swing = np.array([[0.0, 1.0], [-4.0, -0.8]])
    block = LoadBlock(("w", "v"), swing, np.diag([9.0, 36.0]), {"load_1": np.array([[2.0, 0.5]])})
    model = composed(loads=[*LOADS, block])
    assert model.states[6:10] == ("load_3", "load_1", "w", "v")
    np.testing.assert_array_equal(model.blocks.load_output, [[[0, 1, 2, 0.5], [0, 0, 0, 0], [1, 0, 0, 0]]])
    np.testing.assert_allclose(np.diag(model.cov)[6:10], [4.0, 25.0, 9.0, 36.0])
    turning = LoadBlock(("w",), -np.eye(1), np.eye(1), {"load_1": np.ones((3, 1))})
    with pytest.raises(ConfigurationError, match="needs a model with the input 'rotor_azimuth'"):
        composed(loads=[turning])


def test_unequal_sampling_has_a_table_of_intervals():
    model = composed(rate=None, intervals=[0.02, 0.05], walk={"k_2": 0.1})
    assert model.inputs == ("load_1", "load_2", "load_3", "interval")
    for i, rate in enumerate((50.0, 20.0)):
        uniform = composed(rate=rate, walk={"k_2": 0.1})
        for name in ("load_transition", "load_noise", "walk", "step"):
            np.testing.assert_array_equal(getattr(model.blocks, name)[i], getattr(uniform.blocks, name)[0])
    for wrong in ({"rate": 10.0, "intervals": [0.1]}, {"rate": None}, {"rate": None, "intervals": [0.1, -1.0]}):
        with pytest.raises(ConfigurationError, match="sampling"):
            composed(**wrong)

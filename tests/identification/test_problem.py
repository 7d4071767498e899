"""The model for every value of the unknowns: what `compose` would build, and a first state as uncertain as the record
is loud."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.filters.test_drift import Drifts
from tests.filters.test_protocol import chain_with
from tests.mechanics.models import CHAIN_VALUES, chain, chain_sensors
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import pose
from windsysid.loads.statistics import coordinates_of
from windsysid.mechanics import RotorModel, compile_model
from windsysid.mechanics.sensor_lists import as_sensor
from windsysid.records.record import Record
from windsysid.statespace.compose import discretise_loads, parameters_given
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine


@pytest.mark.parametrize("quantity", ["displacement", "velocity", "acceleration", "moment"])
def test_the_first_state_is_as_uncertain_as_the_loudest_second_asks_for(verne555: Turbine, quantity: str):
    # One mass on a spring and a damper, vibrating at its natural frequency: three times its rms, by hand.
    rigid = verne555.with_model(RotorModel(3, y="locked", lag="locked"))
    critical = 2.0 * rigid.inertia("x") * rigid.natural_frequency("x")
    rigid = rigid.with_values({"c_x": 0.5 * critical})  # well damped, so that stiffness and inertia are told apart
    stiffness, damping, w = rigid.values["k_x"], rigid.values["c_x"], rigid.natural_frequency("x")
    gains = {"displacement": 1.0, "velocity": w, "acceleration": w**2, "moment": abs(stiffness + 1j * w * damping)}
    sensor = as_sensor({"channel": "read", "quantity": quantity, "point": "tower", "axis": "x", "noise": 1e-3})
    turbine = replace(rigid, sensors=(sensor,), loads=tuple(load for load in rigid.loads if load.load == "load_x"))
    time = np.arange(2000) / 100.0
    amplitude = 0.004
    read = amplitude * gains[quantity] * np.sin(w * time)
    azimuth = np.mod(rigid.rotor_speed * time, 2.0 * np.pi)
    record = Record(time, np.column_stack([azimuth, read]), ("rotor_azimuth", "read"), ("rad", sensor.unit))
    std = np.sqrt(np.diag(pose(record, turbine, (sensor,), Prior()).model.cov))
    expected = 3.0 * amplitude * math.sqrt(0.5 * (1.0 + abs(math.sin(w)) / w))  # the loudest of all seconds
    assert std[0] == pytest.approx(expected, rel=0.005)
    assert std[1] == pytest.approx(expected * w, rel=0.005)


def test_parameters_given_make_the_model_that_is_composed_of_their_values():
    # Loads and noise as they were learned, a bias that wanders, a stiffness and a damping given.
    parameters = [Parameter("k_2", 330.0, 0.2), Parameter("c_1", 1.0, 0.4, logarithmic=False, scale=50.0)]
    sensors = [
        Drifts(s.channel, s.expression, s.noise, bias, bias)
        for s, bias in zip(chain_sensors(), (0.3, 0.0, 0.2), strict=True)
    ]
    before = [GaussMarkov("load_1", 5.0, 0.5), GaussMarkov("load_3", 2.0, 1.5)]
    after = [GaussMarkov("load_1", 8.0, 0.4), GaussMarkov("load_3", 1.0, 2.5)]
    prior = {"mean": np.arange(6.0), "cov": np.diag(np.arange(1.0, 7.0)), "rate": None, "intervals": [0.02, 0.05]}
    joint = chain_with(parameters=parameters, sensors=sensors, loads=before, **prior)
    noise = [0.3, 0.02, 0.05]
    compiled = compile_model(chain(), sensors)
    loads = discretise_loads(after, compiled, joint.blocks.step)
    given = parameters_given(joint, compiled, np.array([0.2, 0.03]), loads, noise)
    values = CHAIN_VALUES | {"k_2": 330.0 * math.exp(0.2), "c_1": 1.5}
    quieter = [replace(sensor, noise=std) for sensor, std in zip(sensors, noise, strict=True)]
    composed = chain_with(values=values, sensors=quieter, loads=after, **prior)
    assert given.states == composed.states
    np.testing.assert_allclose(given.mean, composed.mean)
    np.testing.assert_allclose(given.cov, composed.cov)
    for name, ours, wanted in zip(given.blocks._fields, given.blocks, composed.blocks, strict=True):
        np.testing.assert_allclose(ours, wanted, rtol=1e-12, err_msg=name)


def test_what_is_learned_of_loads_and_noise_is_what_the_model_has(verne555: Turbine):
    time = np.arange(200) / 100.0
    read = np.sin(20.0 * time)[:, None] * np.ones(len(verne555.sensors))
    names, units = zip(*((sensor.channel, sensor.unit) for sensor in verne555.sensors), strict=True)
    azimuth = np.mod(verne555.rotor_speed * time, 2.0 * np.pi)
    record = Record(time, np.column_stack([azimuth, read]), ("rotor_azimuth", *names), ("rad", *units))
    problem = pose(record, verne555, verne555.sensors, Prior())
    n = len(problem.parameters)
    unknowns = problem.prior[0].copy()
    factors = {s.name: 1.1 + 0.1 * i for i, s in enumerate(problem.statistics)}
    given = {s.name: s.given for s in problem.statistics}
    unknowns[n:] = coordinates_of(problem.statistics, {name: given[name] * f for name, f in factors.items()})
    model = problem.build(unknowns)
    noise = [s.noise * factors[f"noise_{'blade' if s.blade else 'tower'}_acceleration"] for s in verne555.sensors]
    np.testing.assert_allclose(np.sqrt(model.blocks.noise), noise, rtol=1e-12)
    rms = [15.0 * factors[f"load_rms_{name}"] for name in ("x", "y", "beta_1", "beta_2", "beta_3")]
    np.testing.assert_allclose(np.sqrt(np.diag(model.cov)[10:15]), rms, rtol=1e-12)
    decay = math.exp(-0.01 / (verne555.loads[0].time_constant * factors["load_time_constant"]))
    np.testing.assert_allclose(model.blocks.load_transition[0], decay * np.eye(5), rtol=1e-12)

"""Statistics of loads and noise: coordinates, and what they do to loads and sensors."""

import math

import numpy as np
import pytest

from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import pose
from windsysid.loads.statistics import (
    coordinates_of,
    learned_statistics,
    load_groups,
    moved_loads,
    moved_sensors,
    noise_groups,
    to_logarithms,
    values_of,
)
from windsysid.mechanics import RotorModel
from windsysid.simulation.record import simulate_record
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.turbine.turbine import Turbine


@pytest.fixture
def statistics(verne555: Turbine):
    return (*load_groups(verne555.loads, verne555.model), *noise_groups(verne555.sensors))


def test_every_degree_of_freedom_has_an_rms_and_each_kind_of_sensor_its_noise(statistics):
    assert [(s.name, s.unit, s.given) for s in statistics] == [
        ("load_rms_x", "N", 15.0),
        ("load_rms_y", "N", 15.0),
        ("load_rms_beta_1", "N*m", 15.0),
        ("load_rms_beta_2", "N*m", 15.0),
        ("load_rms_beta_3", "N*m", 15.0),
        ("load_time_constant", "s", 1.0),
        ("noise_tower_acceleration", "m/s^2", 0.05),
        ("noise_blade_acceleration", "rad/s^2", 0.1),
    ]


def test_levels_may_be_wrong_by_a_factor_of_four_or_five_and_a_time_constant_by_two(statistics, verne555: Turbine):
    # exp 1.5 = 4.5 and exp 0.7 = 2.0 at one standard deviation; like loads differ by exp 0.5 about what they share. The
    # prior of ln(rms/√τ) is what the problem of a record takes: of independent η, turned.
    record = simulate_record(verne555, duration=2.0, rate=50.0, seed=0)
    problem = pose(record, verne555, verne555.sensors, Prior())
    n = len(problem.parameters)
    mean, cov = problem.prior
    np.testing.assert_array_equal(mean[n:], 0.0)
    np.testing.assert_array_equal(cov[n:, n:], np.diag(np.square([s.spread for s in problem.statistics])))
    turn = to_logarithms(statistics)
    turn[:5, 5] = 0.0
    expected = np.diag([0.5**2] * 5 + [0.7**2, 1.5**2, 1.5**2])
    for alike in (slice(0, 2), slice(2, 5)):
        expected[alike, alike] += 1.5**2
    np.testing.assert_allclose(turn @ cov[n:, n:] @ turn.T, expected, atol=1e-12)


def test_what_has_no_like_is_tied_to_nothing():
    harmonic = load_groups([GaussMarkov("load_x", 4.0, 8.0, harmonic=3)], RotorModel())
    assert [(s.name, s.spread, s.like) for s in harmonic] == [
        ("load_rms_x_3P", 1.5, ""), ("load_time_constant_3P", 0.7, ""),
    ]  # fmt: skip


def test_the_level_of_the_spectrum_is_a_coordinate_of_its_own(statistics):
    # Above its corner a load's spectrum is 2 rms²/τ ω⁻²: it must not move with the time constant's coordinate.
    for eta_tau in (-1.0, 0.0, 2.0):
        values = values_of(statistics, np.array([0.3, 0.0, 0.0, 0.0, 0.0, eta_tau, 0.0, 0.0]))
        assert values["load_time_constant"] == pytest.approx(np.exp(eta_tau))
        assert values["load_rms_x"] ** 2 / values["load_time_constant"] == pytest.approx(225.0 * np.exp(0.6))


def test_coordinates_and_values_are_each_others_inverse(statistics):
    eta = np.array([0.3, -1.0, 0.7, 0.2, -0.4, 0.1, 0.5, -0.2])
    np.testing.assert_allclose(coordinates_of(statistics, values_of(statistics, eta)), eta, atol=1e-14)
    np.testing.assert_allclose(coordinates_of(statistics, {}), 0.0, atol=1e-15)
    louder = coordinates_of(statistics, {"load_rms_beta_2": 30.0})
    assert values_of(statistics, louder)["load_rms_beta_2"] == pytest.approx(30.0)


def test_loads_and_sensors_move_by_their_own_factors(verne555: Turbine, statistics):
    values = {s.name: s.given for s in statistics} | {"load_rms_beta_1": 30.0, "load_time_constant": 0.5}
    loads = moved_loads(statistics[:6], values, verne555.loads, verne555.model)
    assert [(load.rms, load.time_constant) for load in loads] == [(rms, 0.5) for rms in (15.0, 15.0, 30.0, 15.0, 15.0)]
    sensors = moved_sensors(statistics[6:], values | {"noise_tower_acceleration": 0.2}, verne555.sensors)
    assert [sensor.noise for sensor in sensors] == pytest.approx([0.2, 0.2, 0.1, 0.1, 0.1])


def test_a_harmonic_of_the_file_has_an_rms_and_a_time_constant_of_its_own():
    loads = (GaussMarkov("load_x", 2.0, 1.0), GaussMarkov("load_x", 4.0, 8.0, harmonic=3))
    statistics = load_groups(loads, RotorModel())
    assert [s.name for s in statistics] == [
        "load_rms_x", "load_rms_x_3P", "load_time_constant", "load_time_constant_3P",
    ]  # fmt: skip
    slow, line = moved_loads(statistics, values_of(statistics, np.array([0.0, 0.5, 0.0, 1.0])), loads, RotorModel())
    assert (slow.rms, slow.time_constant) == (2.0, 1.0)
    assert line.rms == pytest.approx(4.0 * np.exp(0.5 + 0.5))
    assert line.time_constant == pytest.approx(8.0 * math.e)


def test_bands_are_two_standard_deviations_of_the_logarithm(statistics):
    cov = np.diag(np.square([0.1, 0.2, 0.2, 0.2, 0.2, 0.3, 0.05, 0.06]))
    at = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.4, 0.1, 0.0])
    learned = {s.name: s for s in learned_statistics(statistics, at, cov)}
    rms = learned["load_rms_x"]  # ln rms = η + η_τ / 2
    assert rms.estimate == pytest.approx(15.0 * np.exp(0.2))
    assert np.log(rms.high / rms.low) == pytest.approx(4.0 * np.hypot(0.1, 0.15))
    noise = learned["noise_tower_acceleration"]
    assert np.log(noise.high / noise.estimate) == pytest.approx(0.1)

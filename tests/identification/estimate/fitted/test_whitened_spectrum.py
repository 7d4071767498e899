"""Scores over frequencies: against those of the filter in time, chance on records of the model, and a load it lacks."""

from dataclasses import replace

import numpy as np
import pytest

from windsysid.checks.dispersion import PartScores, expected_factor
from windsysid.filters import EKF
from windsysid.identification.estimate.fitted.linearisation import Linearisation
from windsysid.identification.estimate.fitted.whitened_spectrum import scores_over_frequency
from windsysid.identification.estimate.scoring import DIFFERENCE_STEP_SIGMAS, information
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import pose
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

CHANNELS = ("tower_x_acceleration", "tower_z_acceleration")


@pytest.fixture(scope="module")
def tower() -> Turbine:
    packaged = load_turbine("tower")
    sensors = tuple(one.model_copy(update={"bias": 0.0}) for one in packaged.sensors)
    return replace(packaged, sensors=sensors, aerodynamic_tolerance=0.0)


def at_the_truth(turbine: Turbine, made: Record) -> Linearisation:
    problem = pose(made, turbine, turbine.sensors, Prior(), None, "broadband")
    unknowns, cov = problem.wide_prior
    model = problem.build(unknowns)
    info = EKF.run(model, EKF.init(model), problem.inputs, problem.readings)[1]
    return Linearisation(problem, made.time, problem.readings, problem.inputs, unknowns, cov, info.whitened)


def scores(turbine: Turbine, made: Record) -> PartScores:
    at = at_the_truth(turbine, made)
    result = scores_over_frequency(at, np.asarray(np.linalg.inv(at.problem.wide_prior[1])))
    assert result is not None
    found, _ = result
    assert found is not None
    return found


@pytest.mark.slow
def test_they_add_up_to_gradient_and_information_of_the_filter(tower: Turbine):
    """Independently: derivatives of the filter's likelihood in time, whose information is that of the record at hand:
    the mean of sixteen records is compared."""
    gradients, fishers = [], []
    for seed in range(16):
        made = simulate_record(tower, duration=600.0, rate=4.0, seed=100 + seed)
        at, found = at_the_truth(tower, made), scores(tower, made)
        widths = DIFFERENCE_STEP_SIGMAS * 0.1 * np.sqrt(np.diag(at.cov))
        gradient, fisher = information(at.problem.build, at.inputs, at.readings, at.unknowns, widths)
        gradients.append([gradient[:4], found.gradients.sum(axis=0)[:4]])
        fishers.append([np.diag(fisher)[:4], np.diag(found.information.sum(axis=0))[:4]])
        assert (np.diff(found.places) > 0.0).all()
    in_time, by_frequency = np.mean(fishers, axis=0)
    assert by_frequency == pytest.approx(in_time, rel=0.15)
    off = np.diff(gradients, axis=1)[:, 0] / np.sqrt(in_time)
    narrow, wide = np.sqrt(np.mean(off**2, axis=0)).reshape(2, 2)
    assert wide.max() < 0.15
    assert narrow.max() < 0.6  # a mode of 0.6 % remembers 84 s: a seventh of the record is its ends


@pytest.mark.slow
def test_on_records_of_the_model_they_scatter_by_chance(tower: Turbine):
    ratios = []
    for seed in range(47_000, 47_008):
        found = scores(tower, simulate_record(tower, duration=400.0, rate=4.0, seed=seed))
        seen = [found.dispersion(axis) for axis in np.eye(4)[[0, 2, 3]]]
        ratios += [one.ratio for one in seen if one is not None]
    assert np.mean(ratios) == pytest.approx(1.0, abs=3.0 * np.std(ratios) / np.sqrt(len(ratios)))


def test_a_peak_that_the_model_lacks_widens_the_direction_that_it_is_in(tower: Turbine):
    made = simulate_record(tower, duration=600.0, rate=4.0, seed=5)
    rng = np.random.default_rng(5)
    narrow = np.convolve(
        rng.standard_normal(made.samples + 99), np.sin(2.0 * np.pi * 0.42 * np.arange(100) / 4.0), "valid"
    )
    held = made["tower_z_acceleration"]
    made = made.with_channels({"tower_z_acceleration": (held + 0.5 * held.std() * narrow / narrow.std(), "m/s^2")})
    found = scores(tower, made)
    side_side, fore_aft = (found.dispersion(axis) for axis in np.eye(4)[[0, 2]])
    assert side_side is not None
    assert fore_aft is not None
    assert expected_factor(side_side) < 1.5
    assert expected_factor(fore_aft) > 4.0


def test_blades_that_turn_have_none():
    turbine = load_turbine("verne555")
    made = simulate_record(turbine, duration=20.0, rate=50.0, seed=1)
    at = at_the_truth(turbine, made)
    assert scores_over_frequency(at, np.eye(len(at.unknowns))) is None


def test_gaps_loads_and_yaw_have_none(tower: Turbine):
    at = at_the_truth(tower, simulate_record(tower, duration=100.0, rate=4.0, seed=1))
    precision = np.eye(len(at.unknowns))
    assert scores_over_frequency(at, precision) is not None
    gap, wave = at.innovations.copy(), at.inputs.copy()
    gap[100:160, 0] = 0.0
    wave[:, -1] = np.sin(at.time)
    assert scores_over_frequency(replace(at, innovations=gap), precision) is None
    assert scores_over_frequency(replace(at, inputs=wave), precision) is None
    assert scores_over_frequency(replace(at, time=at.time**1.1), precision) is None

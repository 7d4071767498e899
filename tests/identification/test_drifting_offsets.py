"""Offsets of accelerometers that wander, which nobody has told."""

import numpy as np
import pytest
from validation.adversary.scenarios import SCENARIOS, record

from tests.findings import codes
from tests.identification.fits import SAMPLES, fitted, identify_without_effects, job_of, record_of
from validation import towers
from windsysid.identification import automatic_choice
from windsysid.identification.condition.spectral_readings import SpectralSamples
from windsysid.identification.effects.random_walk_bias import _wandering, find_random_walks
from windsysid.identification.estimate.spectral.frequency_domain import ask
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.model.prior import Prior
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine


def walked(made: Record, turbine: Turbine, step: float, seed: int) -> Record:
    """The record with a random walk beside each accelerometer, of that standard deviation after one second."""
    steps = np.random.default_rng(seed).standard_normal((made.samples, len(turbine.sensors)))
    walks = step * np.cumsum(steps, axis=0) / np.sqrt(made.rate)
    channels = [sensor.channel for sensor in turbine.sensors]
    return made.with_channels(
        {name: (made[name] + walk, made.unit(name)) for name, walk in zip(channels, walks.T, strict=True)}
    )


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2, 3))])
def test_a_drift_is_as_fast_as_the_readings_wander(verne555: Turbine, seed: int):
    made = simulate_record(verne555, duration=200.0, rate=25.0, seed=seed)
    wandering = walked(made, verne555, 0.1, seed)
    found = find_random_walks(wandering, verne555, verne555.sensors)
    assert found is not None
    said = [found.note]
    read, sensors = found.correct(wandering, verne555, verne555.sensors, filtered=True)
    assert len(said) == 1
    assert said[0].code == "wandering_offsets"
    drifts = np.array([sensor.drift for sensor in sensors])
    assert 0.05 < np.sqrt(np.mean(drifts**2)) < 0.2
    assert read.channels == made.channels
    for sensor in sensors:
        assert sensor.bias >= 3.0 * sensor.drift
        assert np.std(read[sensor.channel]) < np.std(wandering[sensor.channel])
        assert np.mean(read[sensor.channel]) == pytest.approx(np.mean(wandering[sensor.channel]))


@pytest.mark.parametrize("at", [0.3, 3.0])
def test_a_random_walk_is_as_fast_wherever_the_slowest_mode_is(at: float):
    walk = 0.1 * np.cumsum(np.random.default_rng(1).standard_normal(6000)) / np.sqrt(20.0)
    assert _wandering(walk, 20.0, 0.2, at)[1] == pytest.approx(0.1, rel=0.3)  # 60 frequencies: 6 % by chance


@pytest.mark.parametrize("name", ["verne555", "nrel5mw", "tower"])
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_sensors_that_do_not_wander_keep_what_they_have(name: str, seed: int):
    turbine = load_turbine(name)
    made = simulate_record(turbine, duration=300.0, rate=20.0, seed=seed)
    for leaning in (False, True):
        assert find_random_walks(made, turbine, turbine.sensors, leaning=leaning) is None


def test_sensors_that_feel_gravity_drift_only_where_a_caller_asks(verne555: Turbine):
    """A structure that leans slowly reads like a drift there."""
    made = walked(simulate_record(verne555, duration=200.0, rate=25.0, seed=1), verne555, 0.1, 1)
    sensors = tuple(
        sensor.model_copy(update={"feels_gravity": True}) if sensor.channel.startswith("tower") else sensor
        for sensor in verne555.sensors
    )
    for leaning in (False, True):
        found = find_random_walks(made, verne555, sensors, leaning=leaning)
        assert found is not None
        drifting = {channel for channel in found.drifts if channel.startswith("tower")}
        assert len(drifting) == (2 if leaning else 0)


def test_a_slow_trend_is_taken_out_without_a_drift(verne555: Turbine):
    """One period over the record, twice as strong as the vibration: an identification took minutes."""
    made = simulate_record(verne555, duration=100.0, rate=25.0, seed=5)
    swing = np.sin(2.0 * np.pi * np.arange(made.samples) / made.samples + 0.4)
    channels = [sensor.channel for sensor in verne555.sensors]
    trending = made.with_channels({name: (made[name] + 3.0 * swing, made.unit(name)) for name in channels})
    found = find_random_walks(trending, verne555, verne555.sensors)
    assert found is not None
    said = [found.note]
    read, sensors = found.correct(trending, verne555, verne555.sensors, filtered=True)
    assert sensors == verne555.sensors
    assert said[0].channels == tuple(channels)
    assert said[0].data["drifts"] == {}
    for name in channels:
        assert np.std(read[name] - made[name]) < 0.1 * np.std(made[name])


def test_a_few_periods_of_a_mode_are_no_trend():
    """Two and a half periods of the tower's slowest mode, and nothing else."""
    tower = load_turbine("tower")
    frequency = tower.slowest_frequency / (2.0 * np.pi)
    time = np.arange(round(2.5 / frequency * 20.0)) / 20.0
    swing = np.sin(2.0 * np.pi * frequency * time + 0.7)
    made = Record(
        time, np.column_stack([swing] * 2), tuple(s.channel for s in tower.sensors), ("m/s^2",) * 2, name="few"
    )
    assert find_random_walks(made, tower, tower.sensors, leaning=True) is None


def test_gaps_and_short_records_are_no_drift(verne555: Turbine):
    made = simulate_record(verne555, duration=100.0, rate=25.0, seed=5)
    made.values[300:700] = np.nan
    assert find_random_walks(made, verne555, verne555.sensors) is None
    short = walked(made.section(0.0, 10.0), verne555, 0.1, 1)
    assert find_random_walks(short, verne555, verne555.sensors) is None


def test_spectra_give_a_drift_the_density_of_a_random_walk():
    """σ²/ω² at ω; where a band reads at zero it was infinite, and is what the lowest frequency has."""
    tower = load_turbine("tower")
    sensors = [sensor.model_copy(update={"noise": 0.2, "bias": 0.1, "drift": 0.3}) for sensor in tower.sensors]
    made = simulate_record(tower, duration=100.0, rate=20.0, seed=1)
    posed = ask(SpectralSamples.of(made, tower, sensors, []), tower, Prior(), None, "broadband")
    _, density = posed.noise(np.array([[0.0, 0.01, -0.5]]), np.arange(6))
    expected = 0.2**2 / 20.0 + (0.3 / (2.0 * np.pi * np.array([0.01, 0.01, 0.5]))) ** 2
    assert density.sum(axis=0) == pytest.approx(np.repeat(expected, 2)[None])


@pytest.mark.slow
def test_a_healthy_machine_whose_sensors_drift_is_trusted(verne555: Turbine):
    """It went on for minutes, and was condemned."""
    found = identify_without_effects(record("offsets wander", 270_001), verne555, prior=DrawnPrior(seed=270_001))
    truth = SCENARIOS["offsets wander"].machine.truth
    assert found.diagnosis.trusted, found.diagnosis.reasons
    assert max(abs(e.estimate - truth[e.name]) / e.std for e in found.estimates) < 3.5
    assert "wandering_offsets" in codes(found.findings)


@pytest.mark.parametrize("explains", [True, False])
def test_filters_that_differ_from_spectra_are_asked_again_with_the_drift_of_their_sensors(
    monkeypatch: pytest.MonkeyPatch, explains: bool
):
    """What they then answer counts where spectra agree."""
    rng = np.random.default_rng(4)
    made = record_of(rng.standard_normal((SAMPLES, 2)) + np.cumsum(rng.standard_normal((SAMPLES, 2)), axis=0))
    spectral = fitted(made)
    far = fitted(made, "joint", theta=spectral.outcome.theta + 0.1)
    asked = []

    def with_drift(job: Job, start: FittedJob) -> FittedJob:
        asked.append((job, start))
        return fitted(made, "joint") if explains else far

    monkeypatch.setattr(automatic_choice, "run", lambda job, *_, **__: (job, far))
    monkeypatch.setattr(automatic_choice, "estimate", with_drift)
    job = job_of(made, formulation="joint")
    answered, joint = automatic_choice._fitted_beside(job, spectral)
    ((leaning, start),) = asked
    assert start is spectral
    assert leaning.included("random_walk_bias") is not None
    assert answered is (leaning if explains else job)
    assert (joint is far) is not explains


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["flicker noise", "offsets wander"])
def test_filters_are_no_judge_of_a_tower_whose_sensors_drift(kind: str):
    """Filters took a drift for loads, and what they said against spectra condemned a result that was right."""
    made, truth = towers.simulate(kind, 820_001)
    tower, prior = load_turbine("tower"), DrawnPrior(seed=820_001)
    found = identify_without_effects(made, tower, formulation="auto", prior=prior)
    assert found.diagnosis.trusted, found.diagnosis.reasons
    assert max(abs(e.estimate - truth[e.name]) / e.std for e in found.estimates) < 3.0

"""A machine that stands: its turbine file says 0 rpm, and everything takes it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.identification.fits import identify_without_effects as identify
from windsysid.errors import ConfigurationError, RecordError
from windsysid.identification.planning import formulations as planned_ways
from windsysid.identification.planning.plan import plan
from windsysid.inspection import inspect_record
from windsysid.modal.sweep import find_modes
from windsysid.records.record import Record
from windsysid.results.posterior import load_posterior
from windsysid.signals.rotor import rotor_inputs
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine, write_turbine
from windsysid.turbine.turbine import Turbine


@pytest.fixture(scope="module")
def parked(tmp_path_factory: pytest.TempPathFactory) -> Turbine:
    """verne555 with its rotor at rest, from a file."""
    path = tmp_path_factory.mktemp("parked") / "parked.toml"
    write_turbine(replace(load_turbine("verne555"), rotor_speed=0.0), path)
    assert 'speed = "0.0 rad/s"' in path.read_text()
    return load_turbine(path)


@pytest.fixture(scope="module")
def record(parked: Turbine) -> Record:
    return simulate_record(parked, duration=15.0, rate=50.0, seed=4)


@pytest.mark.slow
def test_a_parked_machine_is_identified(parked: Turbine, record: Record, tmp_path: Path):
    assert np.ptp(record["rotor_azimuth"]) == 0.0
    found = identify(record, parked, loads="broadband")
    for name in ("k_x", "k_y", "k_beta_1", "k_beta_2", "k_beta_3"):
        e = found[name]
        assert abs(e.estimate - parked.values[name]) < 4.0 * e.std
        assert e.std < 0.05 * e.estimate
    assert found.conditions.rotor_speed == 0.0
    found.save(tmp_path / "result")
    kept = load_posterior(tmp_path / "result")
    assert kept.turbine.rotor_speed == 0.0
    shown = find_modes(kept)
    assert shown.orders == ()
    assert shown.speeds[shown.usual] == 0.0
    assert "no harmonics" in shown.sentences[0]
    shown.save(tmp_path / "modes")
    assert "parked" in str(shown)


def test_the_modes_of_a_parked_machine_are_those_of_its_springs(parked: Turbine):
    shown = find_modes(replace(parked, model=replace(parked.rotor, lag="locked")))
    frequencies = sorted(float(curve.frequency[shown.usual]) for curve in shown.curves)
    expected = sorted(parked.natural_frequency(name) / (2.0 * np.pi) for name in ("x", "y"))
    np.testing.assert_allclose(frequencies, expected, rtol=1e-3)


def test_a_parked_machine_can_be_planned_and_its_record_inspected(
    parked: Turbine, record: Record, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(planned_ways, "MAX_SIMULATED_SAMPLES", 1000)
    found = plan(parked, duration=20.0, rate=50.0, sensors=parked.sensors[:2])
    assert found.rotor_speed == 0.0
    turning = load_turbine("verne555")
    by_filters = plan(turning, duration=20.0, rate=50.0, rotor_speed=0.0, formulation="joint")
    assert by_filters.rotor_speed == 0.0
    seen = inspect_record(record, parked)
    assert str(seen)


def test_a_parked_record_is_long_enough_by_periods_of_its_slowest_mode(parked: Turbine, record: Record):
    period = 2.0 * np.pi / parked.slowest_frequency
    with pytest.raises(RecordError, match="expected at least 3 periods of the slowest mode"):
        identify(record.section(0.0, 2.0 * period), parked)


def test_a_rotor_that_turns_contradicts_itself_even_where_the_file_says_parked(parked: Turbine, record: Record):
    time = record.time
    azimuth = np.mod(1.0 * time, 2.0 * np.pi)
    turned = record.with_channels(
        {"rotor_azimuth": (azimuth, "rad"), "rotor_speed": (np.full_like(time, 2.0), "rad/s")}
    )
    with pytest.raises(RecordError, match="rotor_azimuth turns at 1 rad/s but rotor_speed says 2 rad/s"):
        rotor_inputs(turned, 0.0)
    consistent = turned.with_channels({"rotor_speed": (np.full_like(time, 1.0), "rad/s")})
    np.testing.assert_allclose(rotor_inputs(consistent, 0.0)[:, 1], 1.0)


def test_wind_on_a_turning_rotor_is_refused_where_it_stands(parked: Turbine, record: Record):
    with pytest.raises(ConfigurationError, match="expected a rotor that turns"):
        identify(record, parked, loads="rotor-wind")


def test_a_turbine_file_can_say_the_coupling_by_the_air_and_the_mean_lag_angle(tmp_path: Path):
    turbine = load_turbine("verne555")
    coupled = replace(
        turbine,
        model=replace(turbine.rotor, air_couples=True, leads=True),
        values={**turbine.values, "c_hub_blade": -1.5, "mean_lag_angle": 0.007},
    )
    write_turbine(coupled, tmp_path / "coupled.toml")
    again = load_turbine(tmp_path / "coupled.toml")
    assert again.rotor.air_couples
    assert again.values["c_hub_blade"] == -1.5
    assert again.rotor.leads
    assert again.values["mean_lag_angle"] == 0.007
    assert not turbine.rotor.air_couples
    assert not turbine.rotor.leads

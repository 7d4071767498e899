"""Accelerometers that are off by a constant which nobody has told."""

from dataclasses import replace

import numpy as np
import pytest
from validation.adversary.scenarios import SCENARIOS, record

from tests.findings import only
from tests.identification.fits import identify_without_effects
from windsysid.identification.effects.bias import find_biases
from windsysid.mechanics.sensors import Accelerometer
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

OFFSETS = (0.05, -0.03, 0.05, -0.1, 0.1)


def off(made: Record, turbine: Turbine, offsets: tuple[float, ...] = OFFSETS) -> Record:
    """The record with a constant beside each channel of the turbine's sensors."""
    channels = [sensor.channel for sensor in turbine.sensors]
    return made.with_channels(
        {name: (made[name] + value, made.unit(name)) for name, value in zip(channels, offsets, strict=True)}
    )


@pytest.mark.slow
def test_sensors_that_are_off_are_found_and_the_result_is_right(verne555: Turbine):
    """A few thousandths of gravity: it was condemned for late blades, after half a minute."""
    made, prior = record("offsets of 5 mg", 200_001).section(0.0, 60.0), DrawnPrior(seed=200_001)
    found = identify_without_effects(made, verne555, formulation="auto", prior=prior)
    truth = SCENARIOS["offsets of 5 mg"].machine.truth
    assert found.diagnosis.trusted, found.diagnosis.reasons
    assert max(abs(e.estimate - truth[e.name]) / e.std for e in found.estimates) < 3.0
    assert only(found.findings, "sensor_offsets").data["offsets"]["tower_y_acceleration"] == pytest.approx(
        -0.03, abs=0.005
    )


def test_an_offset_is_as_large_as_the_readings_are_off(verne555: Turbine):
    made = simulate_record(verne555, duration=60.0, rate=50.0, seed=3)
    found = find_biases(off(made, verne555), verne555, verne555.sensors)
    assert found is not None
    assert found.note.data["offsets"]["tower_y_acceleration"] == pytest.approx(-0.03, abs=0.012)
    sensors = found.correct(made, verne555, verne555.sensors, filtered=True)[1]
    assert [sensor.bias for sensor in sensors] == pytest.approx(np.abs(OFFSETS), abs=0.012)
    holed = off(made, verne555)
    holed.values[500:700, holed.channels.index(verne555.sensors[0].channel)] = np.nan
    name = verne555.sensors[0].channel
    again = find_biases(holed, verne555, verne555.sensors)
    assert again is not None
    assert again.sizes[name] == pytest.approx(0.05, abs=0.01)


@pytest.mark.parametrize("name", ["verne555", pytest.param("nrel5mw", marks=pytest.mark.slow), "tower"])
def test_sensors_that_read_right_keep_what_they_have(name: str):
    """Gravity, which goes with the rotor, and the pull outwards of what turns are no offset."""
    turbine = load_turbine(name)
    for seed in range(4):
        made = simulate_record(turbine, duration=60.0, rate=25.0, seed=seed)
        assert find_biases(made, turbine, turbine.sensors) is None


def test_the_pull_outwards_and_gravity_are_no_offset_of_a_sensor_that_feels_them(verne555: Turbine):
    """An accelerometer along a blade reads Ω² r all the time, one that stands upright reads gravity."""
    about = {"noise": 0.05, "feels_gravity": True}
    outwards = Accelerometer(channel="blade_1_span_acceleration", point="blade_1", axis="span", frame="blade", **about)
    upright = Accelerometer(channel="tower_y_acceleration", point="tower", axis="y", **about)
    machine = replace(verne555, sensors=(outwards, upright))
    made = simulate_record(machine, duration=60.0, rate=50.0, seed=5)
    assert min(abs(float(np.mean(made[sensor.channel]))) for sensor in machine.sensors) > 5.0
    found = find_biases(made, machine, machine.sensors)
    sizes = {} if found is None else found.sizes
    assert upright.channel not in sizes
    pulled = abs(float(np.mean(made[outwards.channel])))
    assert abs(sizes.get(outwards.channel, 0.0)) < 0.03 * pulled  # what blades swing pulls, too


def test_a_vibration_that_is_cut_off_is_no_offset(verne555: Turbine):
    time = np.arange(1500) / 50.0
    decay = 2.0 * np.exp(-0.3 * time) * np.cos(2.0 * np.pi * 1.7 * time + 0.4)
    quiet = simulate_record(verne555, duration=30.0, rate=50.0, seed=3)
    name = "tower_x_acceleration"
    made = quiet.with_channels({name: (decay, quiet.unit(name))})
    assert find_biases(made, verne555, verne555.sensors) is None

"""Stops of the rotor are found where they are, and what is no stop is not one."""

import json

import numpy as np
import pytest
from validation.damping import STOPS_AT, STOPS_IN, stop_record

from windsysid.inspection import inspect_record
from windsysid.records.record import Record

RATE = 10.0


def made(speed: np.ndarray, vibration: np.ndarray | None = None) -> Record:
    """A record of that rotor speed [rad/s] at `RATE`."""
    rng, time = np.random.default_rng(1), np.arange(len(speed)) / RATE
    shaken = np.sin(2.0 * time) * (1.0 if vibration is None else vibration) + 0.01 * rng.standard_normal(len(speed))
    values = np.column_stack([speed, shaken])
    return Record(time, values, ("rotor_speed", "tower_x_acceleration"), ("rad/s", "m/s^2"))


def falling(seconds: float, begins: float = 200.0, length: float = 600.0) -> np.ndarray:
    return 1.3 * np.clip(1.0 - (np.arange(round(length * RATE)) / RATE - begins) / seconds, 0.0, 1.0)


def test_a_stop_and_its_decay_are_found():
    time = np.arange(6000) / RATE
    (stop,) = inspect_record(made(falling(20.0), np.where(time < 218.0, 1.0, np.exp(-(time - 218.0) / 30.0)))).stops
    assert stop.start == pytest.approx(200.0 + 0.9 * 20.0, abs=0.2)
    assert stop.end == pytest.approx(599.9)
    assert stop.fall == pytest.approx(0.4 * 20.0, abs=0.3)
    assert stop.rotor_speed == pytest.approx(1.3)
    assert stop.decays
    assert "dies away" in str(stop)


def test_a_decay_is_measured_from_right_after_the_stop_to_the_second_half_of_its_section():
    time = np.arange(6000) / RATE
    left = np.where(time < 218.0, 1.0, np.exp(-(time - 218.0) / 150.0))
    (stop,) = inspect_record(made(falling(20.0), left)).stops
    early, late = (time > 218.0) & (time < 228.0), time > 0.5 * (218.0 + 599.9)
    expected = np.sqrt(np.mean(left[early] ** 2) / np.mean(left[late] ** 2))
    assert stop.decay == pytest.approx(expected, rel=0.05)  # the sensor has noise, too


def test_a_section_ends_where_the_rotor_turns_again_and_every_stop_is_listed_once():
    speed = falling(20.0, length=400.0)
    flicker = np.where(np.arange(4000) % 7 == 0, 0.02, 0.0)
    twice = inspect_record(made(np.concatenate([speed + flicker, speed]))).stops
    assert [round(stop.start) for stop in twice] == [218, 618]
    assert twice[0].end == pytest.approx(400.0)


@pytest.mark.parametrize(
    "speed",
    [
        np.full(6000, 1.3),
        falling(300.0),  # runs down by itself
        np.zeros(6000),
        np.concatenate([falling(20.0, 200.0, 230.0), np.full(3000, 1.3)]),  # parked for 12 s only
    ],
)
def test_what_is_no_stop_is_not_listed(speed):
    assert inspect_record(made(speed)).stops == ()


def test_a_simulated_stop_is_found_and_reported(tmp_path):
    found = inspect_record(stop_record(0))
    (stop,) = found.stops
    assert stop.start == pytest.approx(STOPS_AT + 0.9 * STOPS_IN, abs=0.3)
    assert "Stops of the rotor" in str(found)
    found.save(tmp_path)
    assert json.loads((tmp_path / "inspection.json").read_text())["stops"][0]["start_s"] == stop.start
    assert "Stops of the rotor" in (tmp_path / "report.html").read_text()

"""Rotor speed under the names that loggers give it."""

import numpy as np
import pytest

import windsysid as ws
from windsysid.inspection.channels import kind_of
from windsysid.inspection.rotor import rotor_of, turns_per_second
from windsysid.spectral.oma.condition import prepare_readings


def record_with(name: str, speed: float, unit: str = "rad/s") -> ws.Record:
    t = np.arange(0.0, 200.0, 0.05)
    shaken = np.random.default_rng(0).normal(size=len(t))
    return ws.Record(
        t, np.column_stack([shaken, np.full(len(t), speed)]), ("tower_x_acceleration", name), ("m/s^2", unit)
    )


@pytest.mark.parametrize(
    "name",
    [
        "rotor_speed",
        "Drehzahl",
        "Rotordrehzahl",
        "rotor_rpm",
        "RotSpeed",
        "rpm",
        "Drehzahl_Rotor",
        "LSS speed",
        "Drehzahl_WEA1",
    ],
)
def test_a_speed_channel_is_known_by_its_usual_names(name: str):
    """With a German name the rotor's harmonics were modes."""
    record = record_with(name, 1.2)
    assert turns_per_second(record) == pytest.approx(1.2 / (2.0 * np.pi))
    if name == "Drehzahl":
        assert {line.name for line in prepare_readings(record, None).lines} >= {"1P", "3P", "6P"}


def test_a_generator_without_a_gear_turns_as_the_rotor_and_one_behind_a_gear_does_not():
    assert turns_per_second(record_with("GenSpeed", 1.2)) > 0.0
    assert rotor_of(record_with("GenSpeed", 120.0)) is None
    assert rotor_of(record_with("Generatordrehzahl", 120.0)) is None
    assert rotor_of(record_with("Drehzahl", 1.2, "m")) is None


def test_a_speed_channel_without_readings_is_passed_over_in_silence(recwarn: pytest.WarningsRecorder):
    assert rotor_of(record_with("GenSpeed", np.nan)) is None
    assert not recwarn.list


def test_a_drehzahl_is_no_vibration():
    assert kind_of("Rotordrehzahl", "rad/s") == "rotor speed"

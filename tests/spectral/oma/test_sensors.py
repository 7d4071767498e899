"""Sensors of operational modal analysis: which channels are taken, and as what."""

from pathlib import Path

import numpy as np
import pytest

import windsysid as ws
from windsysid.errors import ConfigurationError
from windsysid.spectral.oma.sensors import ModalSensor, choose_sensors, derivative_order, read_modal_sensors


def record(**units: str) -> ws.Record:
    values = np.random.default_rng(1).normal(size=(300, len(units)))
    return ws.Record(np.arange(300) / 10.0, values, tuple(units), tuple(units.values()), name="site")


def chosen(given: ws.Record) -> tuple[list[str], tuple[str, ...]]:
    sensors, notes = choose_sensors(given, None)
    return [sensor.channel for sensor in sensors], notes


def test_accelerometers_are_preferred_to_other_kinds():
    given = record(tower_x_displacement="m", tower_x_acceleration="m/s^2", nacelle_x_acceleration="m/s^2")
    assert chosen(given) == (["tower_x_acceleration", "nacelle_x_acceleration"], ())
    assert chosen(record(tower_x_displacement="m")) == (["tower_x_displacement"], ())


def test_channels_of_water_and_of_rotating_blades_are_left_out_with_notes():
    channels, notes = chosen(record(tower_x_acceleration="m/s^2", wave_acceleration="m/s^2", Spn1ALxb1="m/s^2"))
    assert channels == ["tower_x_acceleration"]
    assert [note.split(":")[1].strip() for note in notes] == ["Spn1ALxb1", "wave_acceleration"]


def test_a_kind_that_is_worse_than_that_of_the_structure_needs_no_note():
    assert chosen(record(tower_x_acceleration="m/s^2", blade_x_displacement="m"))[1] == ()


@pytest.mark.parametrize(
    ("quantity", "order"), [("acceleration", 2), ("velocity", 1), ("displacement", 0), ("strain", 0), ("load", 0)]
)
def test_the_order_of_the_derivative_follows_from_the_quantity(quantity: str, order: int):
    given = record(a="m/s^2")
    assert derivative_order(ModalSensor.model_validate({"channel": "a", "quantity": quantity}), given) == order


def test_channels_that_are_listed_are_taken_as_they_are():
    given = record(wave_acceleration="m/s^2", wind_speed="m/s")
    listed = [ModalSensor(channel="wave_acceleration", direction=(0.0, 0.0, 1.0))]
    assert choose_sensors(given, listed) == (tuple(listed), ())
    with pytest.raises(ws.ConfigurationError, match="no channel 'x'"):
        choose_sensors(given, ["x"])


def test_a_sensor_list_is_read_and_its_faults_are_named(tmp_path: Path):
    path = tmp_path / "sensors.toml"
    path.write_text('[[sensor]]\nchannel = "a"\nposition = [0.0, 1.0, 2.0]\n', encoding="utf-8")
    assert read_modal_sensors(path) == (ModalSensor(channel="a", position=(0.0, 1.0, 2.0)),)
    path.write_text('[[sensor]]\nchannel = "a"\ndirection = [0.0, 0.0, 0.0]\n', encoding="utf-8")
    with pytest.raises(ws.ConfigurationError, match=r"sensor 1: .*direction"):
        read_modal_sensors(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('lines = [["a", "b"]]\n[[node]]\nname = "a"\nposition = [0, 0, 0]\n', "got 0 'b'"),
        ('[[node]]\nname = "a"\nposition = [0, 0]\n', "node.1.position"),
        ('[[node]]\nname = "a"\nposition = [0, 0, 0]\nfollows = "c"\n', "got 0 'c'"),
        ("lines = [1]\n", "lines.1"),
        ("plates = 1\n", "got plates, sensor"),
    ],
)
def test_a_wrong_geometry_ends_in_one_line(tmp_path, text, message):
    (tmp_path / "sensors.toml").write_text(text + '[[sensor]]\nchannel = "top"\n')
    with pytest.raises(ConfigurationError) as error:
        read_modal_sensors(tmp_path / "sensors.toml")
    assert message in str(error.value)

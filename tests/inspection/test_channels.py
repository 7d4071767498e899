"""What a channel measures decides what counts as a fault of it: a controlled quantity rests at limits of its own."""

import numpy as np
import pytest

from windsysid.inspection import Inspection, inspect_record
from windsysid.inspection.channels import kind_of
from windsysid.records.record import Record

RATE, SAMPLES = 20.0, 6000


def noise(seed: int, smooth: int = 200) -> np.ndarray:
    rng = np.random.default_rng(seed)
    x = np.convolve(rng.standard_normal(SAMPLES + smooth - 1), np.hanning(smooth), "valid")
    return np.asarray(x / x.std())


def inspected(**channels: tuple[np.ndarray, str]) -> Inspection:
    time, shaken = np.arange(SAMPLES) / RATE, noise(1, 20)[:, None]
    record = Record(time, shaken, ("tower_x_acceleration",), ("m/s^2",), name="record")
    return inspect_record(record.with_channels(channels))


@pytest.mark.parametrize(
    ("channel", "unit", "kind"),
    [
        ("BldPitch1", "rad", "pitch"), ("BlPitchC1", "rad", "pitch"), ("Pitch angle 1", "rad", "pitch"),
        ("blade_1_pitch", "rad", "pitch"), ("pitch_rate", "rad/s", "other"), ("NacYaw", "rad", "yaw"),
        ("YawPzn", "rad", "yaw"), ("GenPwr", "W", "power"), ("GenTq", "N*m", "other"), ("GenSpeed", "rad/s", "other"),
        ("LSSTipVxa", "rad/s", "other"), ("RotSpeed", "rad/s", "rotor speed"), ("TipClrnc1", "m", "other"),
        ("Blade 1 tower clearance", "m", "other"), ("Wave1Elev", "m", "other"), ("RtVAvgxh", "m/s", "other"),
        ("HorWindV", "m/s", "other"), ("B1N3Alpha", "rad", "other"),
    ],
)  # fmt: skip
def test_quantities_of_operation_and_surroundings_are_no_vibration(channel: str, unit: str, kind: str):
    assert kind_of(channel, unit) == kind


@pytest.mark.parametrize(
    ("channel", "unit", "kind"),
    [
        ("PtfmPitch", "rad", "displacement"), ("PtfmYaw", "rad", "displacement"), ("YawBrRDyt", "rad", "displacement"),
        ("tower_pitch_velocity", "rad/s", "velocity"), ("generator_acceleration", "m/s^2", "acceleration"),
        ("RotTorq", "N*m", "load"), ("tower_roll", "rad", "displacement"),
        ("blade_1_lag_velocity", "rad/s", "velocity"), ("level_3_displacement", "m", "displacement"),
    ],
)  # fmt: skip
def test_motions_of_the_structure_are_vibration(channel: str, unit: str, kind: str):
    assert kind_of(channel, unit) == kind


@pytest.mark.parametrize(
    ("channel", "values", "unit"),
    [
        ("BldPitch1", np.maximum(0.0, 2.0 + 3.0 * noise(2)), "deg"),
        ("BldPitch2", np.maximum(-1.0, 1.0 + 2.0 * noise(3)), "deg"),
        ("GenPwr", np.minimum(5e3, 4.8e3 + 500.0 * noise(4)), "kW"),
        ("GenTq", np.minimum(43.0, 42.0 + 5.0 * noise(5)), "kN*m"),
        ("GenSpeed", np.minimum(1173.0, 1170.0 + 10.0 * noise(6)), "rpm"),
        ("TipClrnc1", 12.0 + 11.0 * noise(7), "m"),
        ("blade_tip_position_y", 80.0 * np.sin(np.arange(SAMPLES) / 8.0), "m"),
        ("BldPitch3", np.zeros(SAMPLES), "deg"),
    ],
)  # fmt: skip
def test_a_controlled_or_computed_quantity_has_no_fault_of_a_sensor(channel: str, values: np.ndarray, unit: str):
    found = inspected(**{channel: (values, unit)})
    assert [f.text for f in found.findings if f.severity != "note"] == []
    assert found.verdict.endswith("use all of it")


@pytest.mark.parametrize(
    ("channel", "values", "unit"),
    [
        ("FAIRTEN1", np.maximum(0.0, 100.0 + 150.0 * noise(8, 60)), "kN"),
        ("RotTorq", np.minimum(4000.0, 3800.0 + 500.0 * noise(9, 60)), "kN*m"),
        ("beta", np.maximum(-0.02, 0.05 * noise(10)), "rad"),
    ],
)
def test_a_slack_line_a_limited_torque_and_an_angle_at_its_stop_are_notes(channel: str, values: np.ndarray, unit: str):
    (found,) = inspected(**{channel: (values, unit)}).findings
    assert (found.kind, found.severity, found.channel) == ("limit", "note", channel)
    assert "amplifier" not in found.text


def test_a_strain_that_is_cut_off_is_still_clipped():
    (found,) = inspected(root_strain=(1e-6 * np.minimum(noise(11, 30), 1.2), "1")).findings
    assert (found.kind, found.channel) == ("clipping", "root_strain")
    assert "the sensor or its amplifier saturates there" in found.text


def test_millimetres_marked_as_metres_are_still_named():
    (found,) = inspected(tower_x_displacement=(40.0 * noise(12, 30), "m")).findings
    assert "mm marked as m" in found.text


def test_jumps_of_a_figure_of_the_solver_need_no_hand():
    values = 1e-6 * (2.0 + noise(13))
    values[300::600] = 8e-5
    (found,) = inspected(ConvError=(values, "1")).findings
    assert (found.kind, found.severity) == ("spikes", "note")
    assert " 1 off" not in found.text


def test_a_rotor_that_stands_has_a_constant_azimuth_and_no_fault():
    found = inspected(
        rotor_speed=(np.zeros(SAMPLES), "rpm"), rotor_azimuth=(np.full(SAMPLES, 90.0), "deg"),
        blade_1_pitch=(np.full(SAMPLES, 90.0), "deg"),
    ).findings  # fmt: skip
    assert {(f.channel, f.severity) for f in found} == {
        (name, "note") for name in ("rotor_speed", "rotor_azimuth", "blade_1_pitch")
    }
    assert all("the rotor stands still" in f.text for f in found if f.channel.startswith("rotor"))

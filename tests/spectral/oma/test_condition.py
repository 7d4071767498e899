"""Conditioned readings: frames, frequency range, sinusoids, transforms."""

from dataclasses import replace

import numpy as np
import pytest

import windsysid as ws
from windsysid.records.record import LOW_PASS
from windsysid.spectral.oma.condition import prepare_readings, transforms

RATE, SAMPLES = 10.0, 2000
BLADES = tuple(f"blade_{b}_root_lag_acceleration" for b in (1, 2, 3))


def record(units: tuple[str, ...] = (), **columns: np.ndarray) -> ws.Record:
    known = {"rotor_azimuth": "rad", "rotor_speed": "rad/s"}
    units = units or tuple(known.get(name, "m/s^2") for name in columns)
    values = np.column_stack(list(columns.values()))
    return ws.Record(np.arange(len(values)) / RATE, values, tuple(columns), units, name="rotor")


def noise(channels: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(SAMPLES, channels))


def azimuth(hz: float = 0.2) -> np.ndarray:
    return 2.0 * np.pi * hz * np.arange(SAMPLES) / RATE


def test_blades_become_a_mean_and_two_whirls():
    columns = dict(zip(BLADES, noise(3).T, strict=True))
    found = prepare_readings(
        record(**columns, tower_x_acceleration=noise(1, 5)[:, 0], rotor_azimuth=np.mod(azimuth(), 2.0 * np.pi)), None
    )
    blades = [f"blades_root_lag_acceleration {way}" for way in ("collective", "forward", "backward")]
    assert found.names == ("tower_x_acceleration", *blades)
    assert [sensor is None for sensor in found.sensors] == [False, True, True, True]
    assert (found.fixed.shape, found.turning.shape) == ((SAMPLES, 2), (SAMPLES, 1))
    assert found.rotor_hz == pytest.approx(0.2, rel=1e-3)
    assert found.orders == (2,) * 4
    assert transforms(found)[1].shape[1] == 4


def test_rotor_harmonics_are_removed_by_the_azimuth():
    tower = 0.1 * noise(1)[:, 0] + 3.0 * np.cos(3.0 * azimuth())
    found = prepare_readings(record(tower_x_acceleration=tower, rotor_azimuth=np.mod(azimuth(), 2 * np.pi)), None)
    amplitude = 2.0 * np.abs(np.mean(found.fixed[:, 0] * np.exp(3j * azimuth())))
    assert amplitude < 1e-3
    assert [line.name for line in found.lines][:3] == ["1P", "2P", "3P"]


def test_a_sinusoid_is_removed_and_named():
    time = np.arange(SAMPLES) / RATE
    found = prepare_readings(
        record(tower_x_acceleration=noise(1)[:, 0] + 5.0 * np.sin(2.0 * np.pi * 1.237 * time)), None
    )
    assert [(line.name, round(line.frequency, 2)) for line in found.lines] == [("line", 1.24)]
    assert "sinusoids were removed at 1.237 Hz" in found.notes[0]


def test_the_frequency_range_ends_below_the_cut_off_of_a_low_pass():
    given = record(tower_x_acceleration=noise(1)[:, 0])
    assert prepare_readings(given, None).high == pytest.approx(0.42 * RATE)
    limited = replace(given, attributes={LOW_PASS: "2.0"})
    assert prepare_readings(limited, None).high == pytest.approx(0.84 * 2.0)


def test_displacements_are_transformed_as_accelerations():
    time, f = np.arange(SAMPLES) / RATE, 1.0
    wave = np.sin(2.0 * np.pi * f * time)
    one, other = noise(2).T
    given = record(("m", "m/s^2"), tower_x_displacement=one, tower_z_acceleration=other)
    readings = prepare_readings(given, list(given.channels))
    both = np.column_stack([wave, -((2.0 * np.pi * f) ** 2) * wave])
    frequency, values = transforms(readings._replace(fixed=both))
    at = int(np.argmin(np.abs(frequency - f)))
    assert values[at, 0] == pytest.approx(values[at, 1], rel=1e-3)


def test_most_of_the_vibration_at_the_beginning_is_a_transient():
    decay = np.exp(-np.arange(SAMPLES) / 50.0)[:, None] * noise(2)
    found = prepare_readings(record(tower_x_acceleration=decay[:, 0], tower_z_acceleration=decay[:, 1]), None)
    assert any("transient" in doubt for doubt in found.doubts)

"""Azimuth and speed from encoder, pulses and harmonics, against known rotors."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from windsysid.errors import RecordError
from windsysid.records.formats import read_record
from windsysid.records.record import Record
from windsysid.signals import rotor_from_blades, rotor_from_encoder, rotor_from_pulses, rotor_from_tower

DATA = Path(__file__).parents[3] / "shared" / "data"
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="the shared data are not beside this checkout")
OMEGA = 1.2671  # rad/s, 12.1 rpm


def off(psi: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Error in degrees, whole turns apart."""
    error = np.degrees(psi - truth)
    return np.asarray(error - 360 * np.round(np.median(error) / 360))


def varying() -> tuple[float, np.ndarray, np.ndarray]:
    """Rate, ψ and Ω of a rotor whose speed wanders by 5 %."""
    t = np.arange(15_000) / 50.0
    speed = 7.0 + 0.35 * np.sin(2 * np.pi * t / 40)
    return 50.0, 7.0 * t + 0.35 * 40 / (2 * np.pi) * (1 - np.cos(2 * np.pi * t / 40)), speed


def test_an_encoder_that_counts_backward_from_its_own_zero():
    rate, psi, speed = varying()
    found = rotor_from_encoder(np.mod(0.7 - psi, 2 * np.pi), rate, sense=-1, zero=0.7)
    assert np.abs(off(found.psi, psi)).max() < 1e-6
    assert np.abs(found.speed - speed)[50:-50].max() < 0.01
    assert not found.known_up_to_constant
    assert rotor_from_encoder(np.mod(psi, 2 * np.pi), rate).known_up_to_constant
    with pytest.raises(RecordError, match="set sense to -1"):
        rotor_from_encoder(np.mod(-psi, 2 * np.pi), rate)


def pulses(psi: np.ndarray, per_turn: int = 1, level: float = 5.0) -> np.ndarray:
    return level * np.exp(-0.5 * ((np.mod(per_turn * psi + np.pi, 2 * np.pi) - np.pi) / 0.35) ** 2) - 1.0


@pytest.mark.parametrize("per_turn", [1, 4])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_pulses_give_a_wandering_speed(per_turn, sign):
    rate, psi, speed = varying()
    found = rotor_from_pulses(sign * pulses(psi, per_turn), rate, per_turn=per_turn)
    error = off(found.psi, psi)
    assert (error - np.median(error))[100:-100].std() < 0.5
    assert (found.speed - speed)[100:-100].std() < 0.02 * 7.0
    assert found.known_up_to_constant


def test_lost_pulses_are_counted():
    rate, psi, _ = varying()
    values = pulses(psi)
    values[np.abs(psi - 2 * np.pi * 50) < 2.0] = -1.0
    found = rotor_from_pulses(values, rate)
    error = off(found.psi, psi)
    assert (error - np.median(error))[100:-100].std() < 1.0
    assert "1 lost" in found.note


def test_pulse_times_lie_between_samples():
    # At 12 samples per turn, sample instants alone would scatter by 30°/√12 = 9°.
    t = np.arange(6000) * 0.1
    psi = 5.3 * t
    found = rotor_from_pulses(np.cos(psi), 10.0)
    error = off(found.psi, psi)
    assert (error - np.median(error)).std() < 2.0


def test_channels_without_pulses_are_refused():
    with pytest.raises(RecordError, match="expected 3 or more"):
        rotor_from_pulses(pulses(np.linspace(-1, 8, 500)), 50.0)
    with pytest.raises(RecordError, match="never changes"):
        rotor_from_pulses(np.zeros(500), 50.0)


@needs_data
def test_pulses_of_a_measured_rotor_give_its_speed_back():
    table = np.genfromtxt(DATA / "bjorko" / "operation_20210707_20Hz.csv", delimiter=",", names=True)
    speed = CubicSpline(table["time_s"], table["rotor_speed_rpm"] * 2 * np.pi / 60)
    t = np.arange(0, 499, 0.02)
    psi = speed.antiderivative()(t)
    found = rotor_from_pulses(pulses(psi), 50.0)
    error = off(found.psi, psi)
    assert (error - np.median(error)).std() < 1.0
    assert (found.speed - speed(t)).std() < 0.005 * speed(t).mean()


@needs_data
@pytest.mark.parametrize("guess", [1.0, 1.08])
def test_the_tower_of_a_measured_rotor_gives_its_speed(guess):
    table = np.genfromtxt(DATA / "bjorko" / "operation_20210707_20Hz.csv", delimiter=",", names=True)
    speed = CubicSpline(table["time_s"], table["rotor_speed_rpm"] * 2 * np.pi / 60)
    t = np.arange(0, 499, 0.02)
    psi = speed.antiderivative()(t)
    noise = 0.3 * np.random.default_rng(0).standard_normal(len(t))
    read = np.cos(3 * psi + 0.7) + 0.5 * np.sin(2 * np.pi * 0.9 * t) + noise
    found = rotor_from_tower(read, 50.0, rotor_speed=guess * speed(t).mean())
    inside = slice(500, -500)
    error = off(found.psi, psi)[inside]
    assert (error - error.mean()).std() < 2.0
    assert (found.speed - speed(t))[inside].std() < 0.01 * speed(t).mean()
    assert found.known_up_to_constant
    assert "constant" in found.note


def test_noise_has_no_rotor_in_it():
    refused = 0
    for seed in range(8):
        with pytest.raises(RecordError, match="no 3P line stands out"):
            rotor_from_tower(np.random.default_rng(seed).standard_normal(12_000), 50.0, rotor_speed=7.0)
        refused += 1
    assert refused == 8


@needs_data
def test_openfast_tower_gives_the_rotor_where_it_shows_it_and_is_refused_where_not():
    # a2: 3P from gravity on the blades, 2.6e-4 m/s², beside a decaying tower mode of up to 2 m/s². c2: the 3P hump of
    # the turbulence has no steady phase.
    record: Record = read_record(DATA / "openfast" / "a2_rot12_decay_min.outb").section(400.0, 600.0)
    truth = np.unwrap(record["rotor_azimuth"])
    found = rotor_from_tower(record["tower_x_acceleration"], record.rate, rotor_speed=1.05 * OMEGA)
    error = off(found.psi, truth)
    assert (error - error.mean()).std() < 1.0
    assert found.speed.mean() == pytest.approx(record["rotor_speed"].mean(), rel=1e-3)
    noisy = read_record(DATA / "openfast" / "c2_turb12_full.outb").section(60.0, 600.0)
    with pytest.raises(RecordError, match="no 3P line stands out"):
        rotor_from_tower(noisy["tower_x_acceleration"], noisy.rate, rotor_speed=OMEGA)


@needs_data
@pytest.mark.parametrize(("file", "bound"), [("a2_rot12_decay_min", 2.0), ("c2_turb12_full", 4.0)])
def test_openfast_blades_give_the_absolute_azimuth(file, bound):
    # The twist of c2's blades under load turns gravity by 1.8° in their axes.
    record = read_record(DATA / "openfast" / f"{file}.outb").section(60.0, 300.0)
    blades = np.array([record[f"blade_{b}_tip_lag_acceleration"] for b in (1, 2, 3)])
    truth = np.unwrap(record["rotor_azimuth"])
    found = rotor_from_blades(blades, record.rate, rotor_speed=0.95 * OMEGA)
    assert np.abs(off(found.psi, truth)).max() < bound
    assert not found.known_up_to_constant
    alone = blades.copy()
    alone[[0, 2]] = np.nan
    lone = rotor_from_blades(alone, record.rate, rotor_speed=OMEGA)
    assert off(lone.psi, truth).std() < 2.0
    assert "not checked" in lone.note
    with pytest.raises(RecordError, match="numbered the other way round"):
        rotor_from_blades(blades[[0, 2, 1]], record.rate, rotor_speed=OMEGA)
    with pytest.raises(RecordError, match="blade 2 reads with the opposite sign"):
        rotor_from_blades(blades * [[1], [-1], [1]], record.rate, rotor_speed=OMEGA)

"""A sensor that reads noise and no vibration is named; one that hears a resonance faintly is not."""

from typing import Literal

import numpy as np
import pytest
from scipy.signal import lfilter

from tests.findings import only, reasons
from windsysid.checks.dead_channel import _is_coherent, find_still, is_constant
from windsysid.identification.identify import identify
from windsysid.identification.model.prior import Prior
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

pytestmark = pytest.mark.usefixtures("without_effects")


RATE, F = 20.0, 1.5


def resonance(rng: np.random.Generator, samples: int, damping: float = 0.02) -> np.ndarray:
    """Noise through one mode at `F`, of unit variance."""
    return response_to(rng.standard_normal(samples + 2000), damping)


def response_to(load: np.ndarray, damping: float) -> np.ndarray:
    """A load through one mode at `F`, of unit variance, without the first 2000 samples."""
    pole = np.exp((-damping + 1j * np.sqrt(1.0 - damping**2)) * 2.0 * np.pi * F / RATE)
    found = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], load)[2000:]
    return np.asarray(found / found.std())


@pytest.mark.parametrize("samples", [600, 2000, 12000])
@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_noise_is_still_and_a_faint_resonance_is_not(samples: int, colour: float):
    rng = np.random.default_rng(4)
    noise = lfilter([1.0], [1.0, -colour], rng.standard_normal((samples, 3)), axis=0)
    readings = noise + np.column_stack([0.0 * noise[:, 0], resonance(rng, samples), np.zeros(samples)])
    readings[:, 2] += 30.0 * np.cos(2.0 * np.pi * 0.9 * np.arange(samples) / RATE)  # gravity, once a turn
    found = find_still(readings, ("a", "b", "c"), rate=RATE, frequencies=[F], rotor_hz=0.9)
    assert found == ("a", "c")


def test_a_hundredth_of_the_power_is_heard_in_ten_minutes():
    rng = np.random.default_rng(5)
    readings = rng.standard_normal((12000, 1)) + 0.1 * resonance(rng, 12000)[:, None] * np.sqrt(10.0)
    assert find_still(readings, ("a",), rate=RATE, frequencies=[F], rotor_hz=0.0) == ()


def test_a_heavily_damped_mode_that_is_coherent_with_another_channel_is_alive():
    """In wind, fore-aft channels of a tower whose mode had 10 to 17 % damping were called dead."""
    alone, beside, noise = 0, 0, 0
    for seed in range(30):
        first, second, dead = np.random.default_rng(seed).standard_normal((3, 3000))
        damped = response_to(0.9 * first + 0.4 * second, 0.3)
        readings = np.column_stack([response_to(first, 0.02), damped, dead[2000:]])
        alone += bool(find_still(damped[:, None], ("b",), rate=RATE, frequencies=[F], rotor_hz=0.0))
        found = find_still(readings, ("a", "b", "c"), rate=RATE, frequencies=[F], rotor_hz=0.0)
        beside, noise = beside + ("b" in found), noise + ("c" in found)
    assert alone >= 5
    assert beside == 0
    assert noise >= 27  # chance lets one of ten vibrate


def test_one_line_in_all_channels_does_not_make_noise_vibrate():
    """Phases are coherent at the line only: hum in a live channel and in a dead one."""
    rng, hum = np.random.default_rng(9), 3.0 * np.cos(2.0 * np.pi * 2.2 * np.arange(2000) / RATE)
    still = 0
    for _ in range(50):
        noise = rng.standard_normal(2000) + hum
        readings = np.column_stack([resonance(rng, 2000) + hum, noise])
        values = np.fft.rfft(readings * np.hanning(2000)[:, None], axis=0)[75:300]
        still += not _is_coherent(values[:, 1] / np.abs(values[:, 1]), values[:, :1] / np.abs(values[:, :1]))
    assert still >= 49


def test_noise_next_to_a_decay_or_a_gust_in_the_middle_of_a_record_is_dead():
    """Their phases vary regularly over frequency, as those that Hann's window gives noise: 10 to 60 % of dead channels
    were coherent with them."""
    alive, time = 0, np.arange(7200.0)
    for seed in range(20):
        load, *dead = np.random.default_rng(seed).standard_normal((3, 9200))
        gust = response_to(load * np.r_[np.zeros(2000), 0.01 + np.exp(-(((time - 3600.0) / 600.0) ** 2))], 0.02)
        decay = response_to(np.r_[np.zeros(5600), 1.0, np.zeros(3599)] + 1e-5 * load, 0.02)
        for live, noise in zip((gust, decay), dead, strict=True):
            readings = np.column_stack([live, noise[2000:]])
            alive += "b" not in find_still(readings, ("a", "b"), rate=RATE, frequencies=[F], rotor_hz=0.0)
    assert alive <= 1


@pytest.mark.parametrize("level", [0.01, 0.1, 0.3, 0.9])
def test_a_copy_of_a_channel_that_measures_another_motion_is_no_sign_of_life(level: float):
    dead, alive, apart = 0, 0, ~np.eye(3, dtype=bool)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        live, own = resonance(rng, 6000), resonance(rng, 6000, 0.1)
        noise = 0.1 * rng.standard_normal((2, 6000))
        late = live + 0.1 * np.roll(live, 1)  # by a delay, too
        readings = np.column_stack([live + noise[0], level * late + noise[1], level * live + 0.3 * own])
        found = find_still(readings, ("a", "b", "c"), rate=RATE, frequencies=[F], rotor_hz=0.0, apart=apart)
        dead, alive = dead + ("b" in found), alive + ("a" not in found and "c" not in found)
        both = find_still(readings[:, :2], ("a", "b"), rate=RATE, frequencies=[F], rotor_hz=0.0)
        assert level < 0.1 or both == ()  # perhaps both measure one motion
    assert dead >= 19
    assert alive == 20


@pytest.mark.parametrize("share", [0.01, 0.04])
def test_a_gap_of_a_channel_leaves_its_copy_found(share: float):
    dead, alive = 0, 0
    for seed in range(20):
        rng = np.random.default_rng(1000 + seed)
        live = resonance(rng, 6000)
        readings = np.outer(live, [1.0, 0.1]) + 0.05 * rng.standard_normal((6000, 2))
        readings[2000 : 2000 + round(6000 * share), 0] = np.nan
        found = find_still(readings, ("a", "b"), rate=RATE, frequencies=[F], rotor_hz=0.0, apart=~np.eye(2, dtype=bool))
        dead, alive = dead + ("b" in found), alive + ("a" not in found)
    assert (dead >= 19, alive) == (True, 20)


def test_a_cable_with_crosstalk_has_no_grade():
    """Stiffness was 20 standard deviations off, of grade A: another axis was taken for a mode of this one."""
    tower = load_turbine("tower")
    true = tower.with_values({"k_side_side": 0.893 * tower.values["k_side_side"]})
    made, rng = simulate_record(true, duration=600.0, rate=5.0, seed=7002), np.random.default_rng(1)
    cases: list[tuple[float, float, Literal["spectral", "auto"]]] = [(0.03, 600.0, "spectral"), (0.1, 60.0, "auto")]
    for level, seconds, formulation in cases:
        copied = level * made["tower_z_acceleration"] + 0.01 * rng.standard_normal(made.samples)
        record = made.with_channels({"tower_x_acceleration": (copied, "m/s^2")}).section(0.0, seconds)
        found = identify(record, tower, formulation=formulation)
        assert only(reasons(found), "dead_channel").channels == ("tower_x_acceleration",)
        assert {one.name: one.grade for one in found.estimates}["k_side_side"] == "C"


@pytest.mark.parametrize(("samples", "share"), [(600, 0.1), pytest.param(6000, 1e-3, marks=pytest.mark.slow)])
def test_chance_makes_something_vibrate_as_seldom_as_stated(samples: int, share: float):
    rng = np.random.default_rng(6)
    count = 2000 if share < 0.01 else 400
    noise = rng.standard_normal((samples, count))
    noise[rng.random(noise.shape) < 0.01] = np.nan
    found = find_still(noise, tuple(map(str, range(count))), rate=RATE, frequencies=[F], rotor_hz=0.9)
    assert count - len(found) <= count * share + 4


@pytest.mark.parametrize(
    ("duration", "rate", "every", "seeds"),
    [
        (60.0, 50.0, 1, range(940, 950)),
        *(
            pytest.param(*one, marks=pytest.mark.slow)
            for one in ((15.0, 50.0, 1, range(900, 930)), (100.0, 55.0, 5, range(960, 980)))
        ),
    ],
)
def test_no_channel_of_a_healthy_rotor_is_called_still(
    verne555: Turbine, duration: float, rate: float, every: int, seeds: range
):  # of the last, the band ends just above the blades' modes
    natural = [verne555.natural_frequency(name) / (2.0 * np.pi) for name in verne555.model.coordinates]
    channels = [sensor.channel for sensor in verne555.sensors]
    for seed in seeds:
        record = simulate_record(verne555, duration=duration, rate=rate, seed=seed)
        readings = np.column_stack([record[channel] for channel in channels])[::every]
        turning = verne555.rotor_speed / (2.0 * np.pi)
        assert find_still(readings, channels, rate=rate / every, frequencies=natural, rotor_hz=turning) == ()


def test_what_is_missing_or_too_short_is_not_judged():
    noise = np.random.default_rng(7).standard_normal((2000, 2))
    noise[:300, 0] = np.nan
    assert find_still(noise, ("a", "b"), rate=RATE, frequencies=[F], rotor_hz=0.0) == ("b",)
    assert find_still(noise[:100], ("a", "b"), rate=RATE, frequencies=[F], rotor_hz=0.0) == ()
    assert find_still(0.0 * noise, ("a", "b"), rate=RATE, frequencies=[F], rotor_hz=0.0) == ()
    assert find_still(noise, ("a", "b"), rate=RATE, frequencies=[], rotor_hz=0.0) == ()


@pytest.mark.parametrize(
    ("dead", "formulation"),
    [
        ("", "spectral"), pytest.param("blade", "joint", marks=pytest.mark.slow),
        pytest.param("", "joint", marks=pytest.mark.slow), pytest.param("blade", "spectral", marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_sensors_without_power_are_never_trusted(
    verne555: Turbine, dead: str, formulation: Literal["joint", "spectral"]
):
    record = simulate_record(verne555, duration=60.0 if formulation == "spectral" else 15.0, rate=50.0, seed=5)
    rng = np.random.default_rng(1)
    noise = {
        sensor.channel: (record[sensor.channel].std() * rng.standard_normal(record.samples), sensor.unit)
        for sensor in verne555.sensors
        if sensor.channel.startswith(dead)
    }
    quiet: Record = record.with_channels(noise)
    found = identify(quiet, verne555, prior=Prior(1.3, 1.3), formulation=formulation, loads="broadband")
    assert not found.diagnosis.trusted
    dead_channels = only(reasons(found), "dead_channel").channels
    assert len(dead_channels) > 1
    assert dead_channels[0] == f"{'blade_1_lag' if dead else 'tower_x'}_acceleration"


def test_a_short_record_of_noise_is_not_taken_for_vibration():
    """Stiffness was 5 to 12 standard deviations off, of grade A: too few frequencies were there to be tested."""
    made = simulate_record(load_turbine("tower"), duration=30.0, rate=4.0, seed=884_002)
    names, rng = ("tower_x_acceleration", "tower_z_acceleration"), np.random.default_rng(884_002)
    noise = {name: (made[name].std() * rng.standard_normal(made.samples), "m/s^2") for name in names}
    found = identify(made.with_channels(noise), "tower")
    assert only(reasons(found), "dead_channel").channels == names
    assert {one.grade for one in found.estimates} == {"C"}
    assert identify(made, "tower").diagnosis.trusted


def test_innovations_as_large_as_those_of_noise_are_still():
    rng = np.random.default_rng(8)
    noise, vibration = rng.standard_normal(100), resonance(rng, 100)
    left = np.column_stack([noise, 0.3 * rng.standard_normal(100), np.zeros(100)])
    readings = np.column_stack([noise, vibration, np.zeros(100)])
    readings[50, 1] = np.nan
    found = find_still(readings, ("a", "b", "c"), rate=RATE, frequencies=[F], rotor_hz=0.0, innovations=left)
    assert found == ("a",)


@pytest.mark.parametrize(
    ("values", "constant"),
    [
        ([0.0, 0.0, 0.0], True),
        ([9.81, 9.81, 9.81 * (1.0 + 5e-16)], True),  # rounding of a unit's conversion
        ([9.81, 9.81, 9.81 * (1.0 + 1e-11)], False),
        ([-1.0, 1.0], False),
    ],
)
def test_a_channel_of_one_value_is_constant_but_for_rounding(values: list[float], constant: bool):
    assert is_constant(np.array(values)) is constant

"""A channel that falls silent while others go on is found, to the sample; vibration that fades is not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from windsysid.identification.condition.readings import without_faulty
from windsysid.inspection.faults.silence import silent_stretches
from windsysid.inspection.screening import screen
from windsysid.records.record import Record

RATE, SAMPLES = 20.0, 6000
CHANNELS = ("tower_x_acceleration", "tower_y_acceleration")


def vibration(seed: int, damping: float = 0.02, frequency: float = 0.5) -> np.ndarray:
    """Two channels (T, 2) of a mode each, with noise of a hundredth."""
    rng = np.random.default_rng(seed)
    pole = np.exp((-damping + 1j * np.sqrt(1.0 - damping**2)) * 2.0 * np.pi * frequency / RATE)
    drive = rng.standard_normal((SAMPLES + 4000, 2))
    x = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], drive, axis=0)[4000:]
    return np.asarray(x / x.std(axis=0) + 0.01 * rng.standard_normal(x.shape))


def record(values: np.ndarray) -> Record:
    return Record(np.arange(len(values)) / RATE, values, CHANNELS, ("m/s^2",) * 2, name="shaken")


def with_noise_only(values: np.ndarray, where: slice, columns: slice = slice(0, 1)) -> np.ndarray:
    values = values.copy()
    values[where, columns] = 0.01 * np.random.default_rng(3).standard_normal(values[where, columns].shape)
    return values


@pytest.mark.parametrize("seed", range(4))
def test_a_silent_stretch_is_found_to_the_sample(seed: int):
    (found,) = silent_stretches(record(with_noise_only(vibration(seed), slice(2000, 2600))), CHANNELS)
    assert (found.channel, found.kind, found.severity) == (CHANNELS[0], "silent", "warning")
    np.testing.assert_allclose(found.spans * RATE, [[2000, 2599]], atol=2.0)
    assert "dead channel: only noise for up to 30 s, 60" in found.text


def test_a_channel_need_not_be_a_good_one():
    values = vibration(7)
    values[2000:2600, 0] = 0.05 * np.random.default_rng(4).standard_normal(600)
    (found,) = silent_stretches(record(values), CHANNELS)
    np.testing.assert_allclose(found.spans * RATE, [[2000, 2599]], atol=8.0)


def test_missing_samples_are_no_silence_and_hide_none():
    values = with_noise_only(vibration(1), slice(2000, 2600))
    values[[500, 2100, 2101, 4000], 0] = np.nan
    values[5000:5400, 0] = np.nan
    (found,) = silent_stretches(record(values), CHANNELS)
    np.testing.assert_allclose(found.spans * RATE, [[2000, 2599]], atol=2.0)


@pytest.mark.parametrize("damping", [0.003, 0.01, 0.05])
def test_vibration_that_fades_is_not_silent(damping: float):
    assert not [one for seed in range(20) for one in silent_stretches(record(vibration(seed, damping)), CHANNELS)]


def test_a_machine_at_rest_is_not_silent_and_neither_is_a_channel_alone():
    still = with_noise_only(vibration(2), slice(2000, 2600), slice(0, 2))
    assert not silent_stretches(record(still), CHANNELS)
    assert not silent_stretches(record(with_noise_only(vibration(2), slice(2000, 2600))), CHANNELS[:1])


def test_a_record_that_begins_or_ends_quietly_is_not_silent():
    for where in (slice(0, 600), slice(5400, 6000)):
        assert not silent_stretches(record(with_noise_only(vibration(4), where)), CHANNELS)


def test_silent_and_frozen_readings_are_missing_to_an_identification():
    values = with_noise_only(vibration(3), slice(2000, 2600))
    values[4000:4100, 1] = values[4000, 1]
    made = record(values)
    faults = screen(made, None, CHANNELS)
    assert {(fault.channel, fault.kind) for fault in faults} == {(CHANNELS[0], "silent"), (CHANNELS[1], "frozen")}
    read, told = without_faulty(made, faults)
    missing = np.isnan(read.values)
    np.testing.assert_allclose(missing.sum(axis=0), [600, 100], atol=3)
    assert missing[2000:2600, 0].all()
    assert missing[4000:4100, 1].all()
    np.testing.assert_array_equal(read.values[~missing], made.values[~missing])
    assert all(fault.text.endswith("taken as missing") for fault in told)
    assert np.isfinite(made.values).all()


@pytest.mark.parametrize("seed", [90, 264, 265, 330, 398])
def test_beats_of_two_close_modes_are_not_silent(seed: int):
    """Of 400 records these five have a beat that fades below an eighth for more than five periods."""
    rng = np.random.default_rng(seed)
    values = np.zeros(24_000)
    for frequency in (0.572, 0.572 * 1.03):
        pole = np.exp((-0.001 + 1j * np.sqrt(1.0 - 1e-6)) * 2.0 * np.pi * frequency / RATE)
        x = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], rng.standard_normal(36_000))[12_000:]
        values += x / x.std()
    values += 0.005 * rng.standard_normal(24_000)
    other = lfilter([1.0], [1.0, -0.9], rng.standard_normal(24_000))
    assert silent_stretches(record(np.column_stack([values, other])), CHANNELS) == []


@pytest.mark.parametrize("broad", [0.0, 0.1])
@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_silence_is_found_under_light_damping_and_in_broad_vibration(broad: float, noise: float):
    found = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        values = vibration(seed, 0.005, 0.4) + broad * rng.standard_normal((SAMPLES, 2))
        values[2000:2800, 0] = noise * rng.standard_normal(800)
        found += any(one.channel == CHANNELS[0] for one in silent_stretches(record(values), CHANNELS))
    assert found >= 7

"""Resampling, despiking, levelling, yaw."""

import numpy as np
import pytest

from windsysid.errors import RecordError
from windsysid.records.record import Record
from windsysid.signals import despike, remove_bias, remove_gravity_and_tilt, resample, to_nacelle, with_nacelle_axes


def record(time, **channels) -> Record:
    units = {"rotor_azimuth": "rad", "nacelle_yaw": "rad"}
    return Record(
        time, np.column_stack(list(channels.values())), tuple(channels), tuple(units.get(n, "m/s^2") for n in channels)
    )


def wave(t):
    return np.sin(2 * np.pi * 1.3 * t) + 0.5 * np.cos(2 * np.pi * 3.1 * t)


def test_jittered_samples_come_onto_the_grid_where_the_motion_was():
    t = np.arange(3000) / 50.0 + 0.006 * np.random.default_rng(0).uniform(-1, 1, 3000)
    got = resample(record(t, a=wave(t)), 40.0)
    inside = slice(50, -50)
    np.testing.assert_allclose(got["a"][inside], wave(got.time)[inside], atol=0.01)
    assert got.is_uniform
    assert got.rate == pytest.approx(40.0)


def test_what_the_new_rate_cannot_hold_does_not_alias():
    # 30 Hz sampled down to 40 Hz would show as 10 Hz.
    t = np.arange(20_000) / 200.0
    got = resample(record(t, a=np.sin(2 * np.pi * 30 * t) + wave(t)), 40.0)
    inside = slice(50, -50)
    np.testing.assert_allclose(got["a"][inside], wave(got.time)[inside], atol=2e-3)


def test_white_noise_stays_white():
    from scipy.signal import welch

    a = np.random.default_rng(0).standard_normal(200_000)
    slow = resample(record(np.arange(200_000) / 100.0, a=a), 20.0)["a"][100:-100]
    f, spectrum = welch(slow, 20.0, nperseg=256)
    assert spectrum[1:-1].mean() == pytest.approx(2.0 / 100.0, rel=0.02)
    for low, high in ((0.1, 4.0), (7.0, 8.5), (8.5, 9.9)):
        assert spectrum[(f > low) & (f < high)].mean() == pytest.approx(2.0 / 100.0, rel=0.05)


def test_long_gaps_stay_gaps_and_short_ones_are_bridged():
    t = np.arange(2000) / 100.0
    a = wave(t)
    a[500:600] = np.nan
    a[1000:1002] = np.nan
    for rate in (100.0, 25.0):
        got = resample(record(t, a=a), rate)
        missing = np.isnan(got["a"])
        np.testing.assert_array_equal(missing, (got.time > 4.9901) & (got.time < 5.9999))
        near = ~missing & (np.abs(got.time - 10.0) < 0.5)
        np.testing.assert_allclose(got["a"][near], wave(got.time)[near], atol=0.01)


def test_rows_that_were_never_recorded_are_a_gap_too():
    t = np.arange(2000) / 100.0
    keep = (t < 5) | (t > 8)
    got = resample(record(t[keep], a=wave(t[keep])), 100.0)
    assert np.isnan(got["a"][(got.time > 5.001) & (got.time < 7.99)]).all()


def test_an_azimuth_is_resampled_unwrapped():
    t = np.arange(4000) / 100.0
    psi = np.mod(1.3 * t + 0.2, 2 * np.pi)
    for rate in (30.0, 230.0):
        got = resample(record(t, rotor_azimuth=psi), rate)
        off = np.angle(np.exp(1j * (got["rotor_azimuth"] - 1.3 * got.time - 0.2)))
        assert np.abs(off).max() < 2e-3
        assert got["rotor_azimuth"].min() >= 0.0
        assert got["rotor_azimuth"].max() < 2 * np.pi


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, 1e12])
def test_a_rate_that_makes_no_sense_is_refused(rate):
    with pytest.raises(RecordError, match="resampling"):
        resample(record(np.arange(100.0), a=np.ones(100)), rate)


def test_spikes_are_found_counted_and_missing():
    rng = np.random.default_rng(2)
    t = np.arange(10_000) / 100.0
    clean = 2 * wave(t) + 0.05 * rng.standard_normal(len(t))
    where = rng.choice(len(t) // 20, 40, replace=False) * 20 + 7
    spiked = clean.copy()
    spiked[where] += rng.choice([-1, 1], 40) * rng.uniform(8, 50, 40)
    found = despike(spiked, 100.0)
    np.testing.assert_array_equal(np.flatnonzero(found.spikes), np.sort(where))
    assert found.found == 40
    np.testing.assert_array_equal(np.isnan(found.values), found.spikes)


@pytest.mark.parametrize("what", ["sine", "noise", "decay", "line", "steps"])
def test_motion_without_spikes_is_left_alone(what):
    t = np.arange(20_000) / 100.0
    values = {
        "sine": np.sin(2 * np.pi * 2 * t),
        "noise": np.random.default_rng(3).standard_normal(len(t)),
        "decay": np.exp(-0.05 * t) * np.sin(2 * np.pi * t),
        "line": 3 + 0.1 * t,
        "steps": np.floor(t),
    }[what]
    assert despike(values, 100.0).found == 0


def test_bias_and_tilt_are_removed_and_reported():
    rng = np.random.default_rng(4)
    a = rng.standard_normal((2, 50_000))
    a -= a.mean(axis=1, keepdims=True)
    tilt = np.radians(12.0)
    seen = (a[0] + 1j * (a[1] + 9.80665)) * np.exp(-1j * tilt)
    level = remove_gravity_and_tilt(seen.real, seen.imag)
    assert level.tilt == pytest.approx(tilt, abs=1e-12)
    assert level.gravity == pytest.approx(9.80665)
    np.testing.assert_allclose([level.lateral, level.upward], a, atol=1e-9)
    assert remove_bias(a[0] + 3.0).bias == pytest.approx(3.0)


def test_a_sensor_that_does_not_feel_gravity_is_refused():
    with pytest.raises(RecordError, match=r"expected a mean of 9\.807"):
        remove_gravity_and_tilt(np.zeros(10), np.ones(10))


def test_yaw_turns_a_known_direction_into_lateral_and_downwind():
    # The nacelle looks east (90°). Pushed north: to the left looking upwind. Pushed west: downwind.
    yaw = np.full(3, np.pi / 2)
    north, west = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    x, z = to_nacelle(north, west, yaw)
    np.testing.assert_allclose(x, [-1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(z, [0, 1, 0], atol=1e-15)


def test_yaw_bridges_gaps_the_short_way_round_north():
    yaw = np.radians([350.0, np.nan, 10.0])
    x, z = to_nacelle(np.ones(3), np.zeros(3), yaw)
    assert z[1] == pytest.approx(-1.0)  # looking north, pushed north: upwind
    assert x[1] == pytest.approx(0.0, abs=1e-12)


def test_a_record_gets_nacelle_axes():
    t = np.arange(100) / 10.0
    whole = record(t, tower_n_acceleration=wave(t), tower_w_acceleration=0 * t, nacelle_yaw=0 * t + np.pi)
    turned = with_nacelle_axes(whole, "tower_n_acceleration", "tower_w_acceleration")
    np.testing.assert_allclose(turned["tower_z_acceleration"], wave(t), atol=1e-12)
    with pytest.raises(RecordError, match="already"):
        with_nacelle_axes(turned, "tower_n_acceleration", "tower_w_acceleration")


def test_values_that_overflow_a_curve_are_refused_and_name_their_channel():
    time = np.arange(50.0) * 0.1
    values = np.ones((50, 1))
    values[20] = 1e305
    record = Record(time, values, ("somebody's",), ("1",))
    with pytest.raises(RecordError, match="'somebody's' reaches 1e\\+305, too large to be resampled"):
        resample(record, 4.0)


def test_an_azimuth_that_has_run_for_a_day_is_resampled_to_the_angle():
    time = np.arange(24 * 3600 * 2) / 2.0
    turned = 7.3 * time
    record = Record(time, np.mod(0.1 * turned, 2.0 * np.pi)[:, None], ("rotor_azimuth",), ("rad",))
    found = resample(record, 0.9)
    off = found["rotor_azimuth"] - 0.73 * found.time
    inside = slice(100, -100)
    assert np.abs(np.mod(off[inside] + np.pi, 2.0 * np.pi) - np.pi).max() < 1e-6

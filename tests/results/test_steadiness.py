"""Level, tails and what channels share: white noise passes, and each departure is measured as it was made."""

import numpy as np
import pytest
from scipy import signal, stats

from windsysid.checks.lines import PARABOLA_LOSS, find_line, line_bound, stand_out_of_a_bend
from windsysid.checks.stationarity import how_late, levels, steadiness
from windsysid.checks.whiteness import Whiteness, examine

RATE, NATURAL, NAMES = 50.0, (1.0, 2.0), ("first", "second")


def examined(z: np.ndarray) -> Whiteness:
    return examine(z, names=NAMES, rate=RATE, frequencies=NATURAL)


def white(seed: int, samples: int = 5000) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((samples, 2))


@pytest.mark.slow
def test_white_noise_is_steady_without_tails_and_shares_nothing():
    # 300 records: standard deviations of chance are standard deviations.
    found = [examined(white(seed, 2500)) for seed in range(300)]
    unsteady = np.array([c.unsteady_sigmas for w in found for c in w.channels])
    tails = np.array([c.tails_sigmas for w in found for c in w.channels])
    assert abs(unsteady.mean()) < 0.2
    assert unsteady.std() == pytest.approx(1.0, abs=0.12)
    assert tails.std() == pytest.approx(1.0, abs=0.12)
    largest = stats.norm.isf(0.5e-3 / 7.0)  # of seven lags, in one record of 1000
    assert sum(w.shared is not None and w.shared.sigmas > largest for w in found) <= 3


def test_short_windows_of_white_noise_have_no_tails_and_one_level():
    """A mean square of few values scatters, and normal values scaled by it have lighter tails: both are chance."""
    window, z = 20, white(8, 100_000)
    sums = levels(z, np.ones(z.shape, dtype=np.bool_), window)
    for column in zip(*sums, strict=True):
        found = steadiness(*map(float, column), window=window)
        assert abs(found.tails) < 0.05
        assert found.unsteady < 0.1


def test_a_level_that_varies_is_measured_and_is_no_tail():
    t = np.arange(20_000) / RATE
    level = 1.0 + 0.6 * np.sin(2.0 * np.pi * t / 80.0)  # of the mean square: 0.6/√2 = 0.42 of its mean
    z = white(3, 20_000) * np.sqrt(level)[:, None]
    for c in examined(z).channels:
        assert c.unsteady == pytest.approx(0.42, abs=0.05)
        assert c.unsteady_sigmas > 8.0
        assert abs(c.tails) < 0.15
        assert c.kurtosis > 0.3  # what a kurtosis of the whole record would say


def test_tails_are_measured_and_are_no_varying_level():
    z = np.random.default_rng(4).standard_t(10.0, (40_000, 2)) / np.sqrt(10.0 / 8.0)  # excess kurtosis 6/(10−4) = 1
    for c in examined(z).channels:
        assert c.tails == pytest.approx(1.0, abs=0.25)
        assert c.unsteady_sigmas < 4.5


def test_what_is_shared_is_found_at_its_lag():
    z = white(5, 10_000)
    z[2:, 0] = 0.8 * z[2:, 0] + 0.6 * z[:-2, 1]  # the first has the second's, two samples later
    shared = examined(z).shared
    assert shared is not None
    assert (shared.first, shared.second, shared.lag) == (0, 1, 2)
    assert shared.correlation == pytest.approx(0.6, abs=0.03)
    assert shared.sigmas == pytest.approx(60.0, abs=4.0)


def resonance(seed: int, samples: int, frequency: float, damping: float) -> np.ndarray:
    """White noise through one degree of freedom."""
    omega = 2.0 * np.pi * frequency
    pole = np.exp((-damping + 1j * np.sqrt(1.0 - damping**2)) * omega / RATE)
    a = [1.0, -2.0 * pole.real, abs(pole) ** 2]
    return np.asarray(signal.lfilter([1.0], a, white(seed, samples)[:, 0]))[:, None]


def test_a_line_beside_a_resonance_is_found_and_the_resonance_is_none():
    # 100 s of a mode 4 % damped at 2 Hz, and a sine 5 % below it that is as strong.
    modes = [(2.0, 0.04)]
    t = np.arange(5000) / RATE
    alarms = 0
    for seed in range(20):
        z = resonance(seed, 5000, *modes[0])
        healthy = find_line(z, NAMES[:1], rate=RATE, modes=modes, rotor_hz=0.0)
        assert healthy is not None
        alarms += healthy.ratio > healthy.bound
        z[:, 0] += np.sqrt(2.0) * z.std() * np.sin(2.0 * np.pi * 1.9 * t)
        found = find_line(z, NAMES[:1], rate=RATE, modes=modes, rotor_hz=0.0)
        assert found is not None
        assert found.frequency == pytest.approx(1.9, abs=0.011)
        assert found.ratio > found.bound
    assert alarms <= 1


def test_a_line_that_hides_in_the_flank_of_a_resonance_is_found():
    # The mean of what surrounds it has the resonance's peak in it: one in six of these was missed against it.
    modes = [(2.0, 0.04)]
    t = np.arange(5000) / RATE
    found, alarms = 0, 0
    for seed in range(100, 130):
        z = resonance(seed, 5000, *modes[0])
        healthy = find_line(z, NAMES[:1], rate=RATE, modes=modes, rotor_hz=0.0)
        z[:, 0] += 1.2 * z.std() * np.sin(2.0 * np.pi * 1.87 * t)
        beside = find_line(z, NAMES[:1], rate=RATE, modes=modes, rotor_hz=0.0)
        assert healthy is not None
        assert beside is not None
        alarms += healthy.ratio > healthy.bound
        found += beside.ratio > beside.bound
    assert found >= 28
    assert alarms <= 1


def test_a_line_amid_two_modes_is_found():
    modes = [(1.0, 0.06), (2.0, 0.04)]
    z = resonance(31, 5000, *modes[0]) + resonance(32, 5000, *modes[1])
    z[:, 0] += 0.3 * z.std() * np.sin(2.0 * np.pi * 1.42 * np.arange(5000) / RATE)
    line = find_line(z, NAMES[:1], rate=RATE, modes=modes, rotor_hz=0.0)
    assert line is not None
    assert line.frequency == pytest.approx(1.42, abs=0.011)
    assert line.ratio > line.bound


@pytest.mark.slow
def test_chance_over_a_parabola_is_as_the_bound_says():
    # 150 000 points of white noise, as many beyond the bound of one in 1000, and of one in 10 000, as it says.
    rng, surroundings, ratios = np.random.default_rng(12), 30, []
    at = np.arange(surroundings + 2, 2046 - surroundings)
    for _ in range(20):
        z = np.hanning(4096)[:, None] * rng.standard_normal((4096, 4))
        ratios.append(stand_out_of_a_bend(np.abs(np.fft.rfft(z, axis=0)) ** 2, at, surroundings).ravel())
    ratio = np.concatenate(ratios)
    for chance in (1e-3, 1e-4):
        beyond = np.quantile(ratio, 1.0 - chance)
        assert line_bound(1, surroundings, chance, PARABOLA_LOSS) == pytest.approx(beyond, rel=0.1)


def test_what_turns_with_the_rotor_and_modes_that_are_no_broader_than_a_line_are_not_looked_at():
    t = np.arange(5000) / RATE
    z = resonance(1, 5000, 2.0, 0.04)
    z[:, 0] += z.std() * np.sin(2.0 * np.pi * 1.95 * t)
    turning = find_line(z, NAMES[:1], rate=RATE, modes=[(2.0, 0.04)], rotor_hz=0.65)
    assert turning is not None
    assert turning.ratio < turning.bound
    narrow = find_line(z, NAMES[:1], rate=RATE, modes=[(1.95, 0.001)], rotor_hz=0.0)
    assert narrow is not None
    assert abs(narrow.frequency - 1.95) > 0.08


@pytest.mark.parametrize("width", [0.3, 1.0, 3.0])
def test_the_flanks_of_a_narrow_resonance_are_no_lines_and_a_line_beyond_them_is_one(width: float):
    # Half-power widths in frequencies 1/T of 100 s; a sine 6 % above the resonance that is as strong.
    modes, alarms, found = [(2.0, 0.01 * width / 2.0)], 0, 0
    for seed in range(200, 220):
        z = resonance(seed, 25_000, *modes[0])[20_000:]
        z[:, 0] += 0.05 * z.std() * white(seed, 5000)[:, 0]
        healthy = find_line(z, NAMES[:1], rate=RATE, modes=modes, rotor_hz=0.0)
        assert healthy is not None
        alarms += healthy.ratio > healthy.bound
        z[:, 0] += np.sqrt(2.0) * z.std() * np.sin(2.0 * np.pi * 2.12 * np.arange(5000) / RATE)
        line = find_line(z, NAMES[:1], rate=RATE, modes=modes, rotor_hz=0.0)
        assert line is not None
        found += line.ratio > line.bound
    assert alarms <= 1
    assert found >= 19


def test_blades_that_come_a_sample_late_are_found_in_their_own_frame():
    rng = np.random.default_rng(7)
    z, psi = rng.standard_normal((8000, 5)), np.linspace(0.0, 1160.0, 8000)
    angles = {2 + i: 2.0 * np.pi * i / 3.0 for i in range(3)}
    by_chance = how_late(z, psi, (0, 1), angles)
    assert by_chance.sigmas < 3.5
    for column, angle in angles.items():
        tangential = -np.sin(psi + angle) * z[:, 0] + np.cos(psi + angle) * z[:, 1]
        z[1:, column] += 0.1 * tangential[:-1]
    z[40] = np.nan
    late = how_late(z, psi, (0, 1), angles)
    assert late.lag == 1
    assert late.sigmas == pytest.approx(0.1 * np.sqrt(3 * 8000), abs=3.5)


def test_blades_are_not_late_in_gusts():
    """Products of two series that swell together scatter more; one of 40 may be beyond 3 σ."""
    angles, beyond = {2 + i: 2.0 * np.pi * i / 3.0 for i in range(3)}, 0
    for seed in range(40):
        rng = np.random.default_rng(100 + seed)
        z, psi = rng.standard_normal((4000, 5)), np.linspace(0.0, 580.0, 4000)
        z *= np.where(np.arange(4000) // 250 % 4, 0.6, 1.7)[:, None]
        beyond += how_late(z, psi, (0, 1), angles).sigmas > 3.0
    assert beyond <= 2


def test_blades_that_are_late_beyond_a_band_only_are_not_late_within_it():
    rng = np.random.default_rng(8)
    z, psi = rng.standard_normal((8000, 5)), np.linspace(0.0, 1160.0, 8000)
    angles = {2 + i: 2.0 * np.pi * i / 3.0 for i in range(3)}
    sharp = signal.butter(8, 0.5, "high", output="sos")  # in half the rate: a quarter of the samples
    for column, angle in angles.items():
        tangential = -np.sin(psi + angle) * z[:, 0] + np.cos(psi + angle) * z[:, 1]
        z[1:, column] += 0.3 * signal.sosfiltfilt(sharp, tangential)[:-1]
    assert how_late(z, psi, (0, 1), angles).sigmas > 10.0
    assert how_late(z, psi, (0, 1), angles, below=0.16).sigmas < 4.0
    for column, angle in angles.items():
        tangential = -np.sin(psi + angle) * z[:, 0] + np.cos(psi + angle) * z[:, 1]
        z[1:, column] += 0.3 * tangential[:-1]
    assert how_late(z, psi, (0, 1), angles, below=0.16).sigmas > 10.0

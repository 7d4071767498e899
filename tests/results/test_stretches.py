"""Innovations judged in stretches: sums that add up, against SciPy and against the whole at once."""

import numpy as np
import pytest
import scipy.signal

from windsysid.checks.innovation_sums import Stretch, measure_stretch
from windsysid.checks.whiteness import Whiteness, examine, judge_stretches

RATE, NATURAL, NAMES = 50.0, (1.0, 3.0), ("first", "second")


def judged(stretches: list[np.ndarray]) -> Whiteness:
    total: Stretch | None = None
    for z in stretches:
        total = measure_stretch(z, rate=RATE, frequencies=NATURAL, before=total)
    assert total is not None
    return judge_stretches(total, names=NAMES, frequencies=NATURAL)


@pytest.fixture(scope="module")
def noise() -> np.ndarray:
    rng = np.random.default_rng(5)
    z = rng.standard_normal((24_000, 2))
    z[rng.random(z.shape) < 0.02] = np.nan
    return z


def test_sizes_and_counts_are_those_of_the_whole(noise: np.ndarray):
    loud = noise.copy()
    loud[:8000] *= 3.0  # what varies from stretch to stretch shows in the size
    loud[[9000, 15_000, 23_000], 0] = 8.0
    whole, parts = examine(loud, names=NAMES, rate=RATE, frequencies=NATURAL), judged(np.split(loud, [8000, 16_000]))
    assert parts.used == whole.used
    assert parts.nis == pytest.approx(whole.nis, rel=1e-12)
    for ours, wanted in zip(parts.channels, whole.channels, strict=True):
        assert ours.nis == pytest.approx(wanted.nis, rel=1e-12)
        assert ours.offset == pytest.approx(wanted.offset, rel=1e-9)
        assert ours.missing == pytest.approx(wanted.missing, rel=1e-12)
    assert parts.channels[0].outliers == 3
    assert parts.channels[0].kurtosis > parts.channels[1].kurtosis


def test_spectra_are_the_mean_of_welchs_over_all_segments(noise: np.ndarray):
    z = np.nan_to_num(noise)
    z[12_000:] += np.sin(2.0 * np.pi * 1.5 * np.arange(12_000) / RATE)[:, None]
    found = judged([z[:12_000], z[12_000:20_000], z[20_000:]])
    length, total, segments = 12_000 // 16, np.zeros((376, 2)), 0
    for part in (z[:12_000], z[12_000:20_000], z[20_000:]):
        scaled = (part - part.mean(axis=0)) / part.std(axis=0)
        count = (len(part) - length) // (length // 2) + 1
        # SciPy's density counts both halves of the spectrum: half the rate is white noise of variance 1
        _, density = scipy.signal.welch(
            scaled, RATE, window="hann", nperseg=length, noverlap=length - length // 2, detrend=False, axis=0
        )
        total, segments = total + count * density * RATE / 2.0, segments + count
    np.testing.assert_allclose(found.spectrum, (total / segments)[2:-1], rtol=1e-9)
    assert found.channels[0].peak_hz == pytest.approx(1.5, abs=0.01)
    one = examine(z[:12_000], names=NAMES, rate=RATE, frequencies=NATURAL)
    assert found.spectrum_bound < one.spectrum_bound  # more segments, less chance


def test_lags_are_averaged_over_all_pairs():
    rng = np.random.default_rng(6)
    z = scipy.signal.lfilter([1.0], [1.0, -0.3], rng.standard_normal((40_000, 2)), axis=0)
    found = judged(np.split(z, 4))
    np.testing.assert_allclose(found.autocorrelation[:4, 0], 0.3 ** np.arange(1, 5), atol=0.02)


def test_channels_that_are_read_now_and_then_keep_their_samples_over_stretches(noise: np.ndarray):
    slow = noise.copy()
    keep = np.zeros(len(slow), dtype=bool)
    keep[3::7] = True
    slow[~keep, 1] = np.nan
    whole, parts = examine(slow, names=NAMES, rate=RATE, frequencies=NATURAL), judged(np.split(slow, [10_001, 17_000]))
    assert parts.used == whole.used
    assert parts.channels[1].used == whole.channels[1].used
    assert parts.channels[1].missing == pytest.approx(whole.channels[1].missing, abs=1e-3)

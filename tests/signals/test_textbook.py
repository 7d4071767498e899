"""Textbook forms give what SciPy gives."""

import numpy as np
import pytest
import scipy.interpolate
import scipy.signal
from scipy.stats import f as fisher

from windsysid.signals.condition import _decimated, _low_pass
from windsysid.signals.textbook import cubic_spline, local_parabolas, minimum, short_spectra, tukey
from windsysid.spectral.transforms.harmonics import TAPER_BINS, TAPER_COUNT, _tapers


@pytest.fixture(scope="module")
def walk() -> np.ndarray:
    return np.random.default_rng(3).normal(size=5001).cumsum()


@pytest.mark.parametrize("size", [255, 256])
def test_spectra_of_segments_are_scipys(walk: np.ndarray, size: int):
    f, middle, density = scipy.signal.spectrogram(
        walk, 20.0, window="hann", nperseg=size, noverlap=size - 50, detrend="constant"
    )
    for ours, wanted in zip(short_spectra(walk, 20.0, size, size - 50), (f, middle, density), strict=True):
        np.testing.assert_allclose(ours, wanted, rtol=1e-10, atol=1e-14)
    welch = scipy.signal.welch(walk, 20.0, nperseg=size)[1]
    np.testing.assert_allclose(short_spectra(walk, 20.0, size, size // 2)[2].mean(axis=1), welch, rtol=1e-10)


@pytest.mark.parametrize("window", [5, 101])
@pytest.mark.parametrize("derivative", [0, 1, 2])
def test_local_parabolas_are_scipys_to_the_ends(walk: np.ndarray, window: int, derivative: int):
    wanted = scipy.signal.savgol_filter(walk, window, 2, deriv=derivative, delta=0.05)
    found = local_parabolas(walk, window, derivative, 20.0)
    np.testing.assert_allclose(found, wanted, atol=1e-10 * np.abs(wanted).max())
    own = scipy.signal.savgol_coeffs(window, 2)[window // 2]
    assert 0.75 * (3 * window**2 - 7) / (window * (window**2 - 4)) == pytest.approx(own, rel=1e-10)


@pytest.mark.parametrize("count", [4, 5, 5001])
def test_a_spline_is_scipys(walk: np.ndarray, count: int):
    t = np.arange(count) + np.random.default_rng(1).uniform(-0.3, 0.3, count)
    at = np.linspace(t[0], t[-1], 3 * count)
    wanted = scipy.interpolate.CubicSpline(t, walk[:count])(at)
    np.testing.assert_allclose(cubic_spline(t, walk[:count], at), wanted, atol=1e-12 * np.ptp(walk))


def test_windows_and_tapers_are_scipys():
    np.testing.assert_allclose(tukey(501, 0.3), scipy.signal.windows.tukey(501, 0.3), atol=1e-14)
    wanted = scipy.signal.windows.dpss(1200, TAPER_BINS, TAPER_COUNT)
    found = _tapers(1200)[0]
    np.testing.assert_allclose(np.abs(np.sum(found * wanted, axis=1)), np.linalg.norm(wanted, axis=1), rtol=1e-10)


def test_the_limit_of_thomsons_test_is_that_of_fishers_distribution():
    for chance in (1e-3, 1e-9):
        ours = (TAPER_COUNT - 1) * (chance ** (-1.0 / (TAPER_COUNT - 1)) - 1.0)
        assert fisher.sf(ours, 2, 2 * TAPER_COUNT - 2) == pytest.approx(chance, rel=1e-9)


def test_decimation_is_that_by_scipys_filter(walk: np.ndarray):
    factor, margin = 4, 160
    across = np.linspace(0.4, 0.6, 41)
    gain = np.cos(0.25 * np.pi * (across - 0.4) / 0.1)
    taps = scipy.signal.firwin2(
        2 * margin + 1, [0.0, *(2.0 * across / factor), 1.0], [1.0, *gain, 0.0], window=("kaiser", 4.0)
    )
    np.testing.assert_allclose(_low_pass(factor, margin), taps / taps.sum(), atol=1e-14)
    wanted = scipy.signal.oaconvolve(walk, taps / taps.sum(), mode="same")[margin::factor]
    found = _decimated(walk, factor, margin)
    inner = slice(margin // factor, -2 * margin // factor)  # the ends are continued
    np.testing.assert_allclose(found[inner], wanted[inner], atol=1e-10)


def test_a_minimum_at_an_end_is_found():
    assert minimum(lambda x: x, -1.0, 2.0, 1e-9) == pytest.approx(-1.0, abs=1e-8)
    assert minimum(np.cos, 2.0, 5.0, 1e-9) == pytest.approx(np.pi, abs=1e-6)

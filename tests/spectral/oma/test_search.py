"""The search for modes: bins, bands, peaks."""

import numpy as np
import pytest

import windsysid as ws
from windsysid.spectral.modal_bands.peak_bands import Peak
from windsysid.spectral.oma.condition import Readings, RemovedLine, prepare_readings, transforms
from windsysid.spectral.oma.search import (
    RecordSpectrum,
    _merged,
    band_bins,
    fit_between,
    is_rotational_peak,
    modes_inside,
    search_modes,
)

from ..oscillators import modal_responses

RATE = 8.0


@pytest.fixture(scope="module")
def readings() -> Readings:
    rng = np.random.default_rng(2)
    q, _ = modal_responses([1.1, 2.6], [0.015, 0.012], RATE, 3000, rng)
    values = (q / q.std(axis=0)) @ np.array([[1.0, 0.6], [0.5, -1.0]]).T + 0.05 * rng.normal(size=(3000, 2))
    names = ("floor_1_displacement", "floor_2_displacement")
    return prepare_readings(ws.Record(np.arange(3000) / RATE, values, names, ("m", "m"), name="frame"), None)


def silent(*_: object) -> None:
    """No progress."""


def test_bins_of_a_band_leave_out_sinusoids(readings: Readings):
    given = readings._replace(lines=(RemovedLine("1P", 1.0, 0.01), RemovedLine("line", 1.2, 0.02)))
    spectrum = RecordSpectrum(given, *transforms(given))
    expected = [
        i for i, f in enumerate(spectrum.frequency) if 0.9 <= f <= 1.3 and abs(f - 1.0) > 0.01 and abs(f - 1.2) > 0.02
    ]
    assert band_bins(spectrum, (0.9, 1.3)).tolist() == expected


def test_a_band_that_sinusoids_cover_is_not_fitted(readings: Readings):
    covered = readings._replace(lines=(RemovedLine("1P", 1.1, 0.5),))
    assert fit_between(RecordSpectrum(covered, *transforms(covered)), (0.9, 1.3), 1, 1) is None


def test_a_band_around_one_mode_gives_its_frequency(readings: Readings):
    fit = fit_between(RecordSpectrum(readings, *transforms(readings)), (0.8, 1.4), 1, 3)
    assert fit is not None
    assert modes_inside(fit, readings.samples / readings.rate) == 1
    assert abs(np.log(fit.fit.modes.frequency[0] / 1.1)) < 3.0 * fit.fit.std(0)[0]


def test_the_search_finds_both_modes_and_nothing_between(readings: Readings):
    found = search_modes(readings, None, None, silent)
    assert sorted(round(float(f), 1) for one in found.bands for f in one.fit.modes.frequency) == [1.1, 2.6]
    given = search_modes(readings, [(1.7, 2.0), (2.3, 2.9)], None, silent)
    assert given.empty == ((1.7, 2.0),)
    assert given.covered == ()


def test_of_neighbouring_peaks_the_higher_one_is_kept():
    peaks = [Peak(1.2, 0.1, 3.0), Peak(1.0, 0.1, 5.0), Peak(1.02, 0.1, 9.0)]
    assert _merged(peaks) == [Peak(1.02, 0.1, 9.0), Peak(1.2, 0.1, 3.0)]


@pytest.mark.parametrize(("frequency", "expected"), [(0.6, True), (0.605, True), (0.7, False), (0.02, False)])
def test_a_peak_at_a_rotor_harmonic_is_one_of_the_wind(readings: Readings, frequency: float, expected: bool):
    peak = Peak(frequency, 0.002, 9.0)
    assert is_rotational_peak(peak, readings._replace(rotor_hz=0.2)) is expected
    assert not is_rotational_peak(peak, readings)

"""Bands around peaks."""

import pytest

from windsysid.spectral.modal_bands.peak_bands import MAX_BAND_PEAKS, Peak, group_peaks, merge_peaks


def peak(frequency: float, rise: float = 10.0, alone: bool = False) -> Peak:
    return Peak(frequency, 0.01, rise, alone)


def test_of_peaks_within_a_half_width_the_higher_stays():
    assert merge_peaks([peak(1.0, 5.0), peak(1.005, 9.0)], []) == [peak(1.005, 9.0)]
    assert merge_peaks([peak(1.0)], [peak(1.001)]) == []


def test_peaks_whose_flanks_overlap_share_a_band():
    bands = group_peaks([peak(1.0), peak(1.05), peak(2.0)], 0.001, 0.1, 5.0)
    assert [count for *_, count in bands] == [2, 1]
    assert bands[0][0] < 1.0 < 1.05 < bands[0][1] <= bands[1][0] < 2.0 < bands[1][1]


def test_a_peak_that_is_to_be_alone_has_a_band_of_its_own():
    assert [count for *_, count in group_peaks([peak(1.0, alone=True), peak(1.05)], 0.001, 0.1, 5.0)] == [1, 1]


def test_no_group_is_larger_than_the_largest():
    peaks = [peak(1.0 + 0.01 * i) for i in range(MAX_BAND_PEAKS + 1)]
    bands = group_peaks(peaks, 0.001, 0.1, 5.0)
    assert [count for *_, count in bands] == [MAX_BAND_PEAKS, 1]
    assert bands[0][1] == pytest.approx(bands[1][0])

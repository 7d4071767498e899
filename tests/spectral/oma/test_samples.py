"""Samples without gaps, spikes and copies."""

from itertools import groupby

import numpy as np
import pytest

import windsysid as ws
from windsysid.spectral.oma.samples import _longest_whole, choose_samples, without_gaps

RATE = 10.0


def record(values: np.ndarray, unit: str = "m") -> ws.Record:
    names = tuple(f"floor_{i}_displacement" for i in range(values.shape[1]))
    return ws.Record(np.arange(len(values)) / RATE, values, names, (unit,) * len(names), name="frame")


def noise(samples: int = 600, channels: int = 2) -> np.ndarray:
    return np.cumsum(np.random.default_rng(1).normal(size=(samples, channels)), axis=0) * 0.1


@pytest.mark.parametrize("seed", range(5))
def test_the_longest_run_without_missing_values_is_that_of_a_plain_search(seed: int):
    missing = np.random.default_rng(seed).random((200, 2)) < 0.05
    rows = [bool(row.any()) for row in missing]
    runs = [[i for i, _ in group] for empty, group in groupby(enumerate(rows), key=lambda pair: pair[1]) if not empty]
    longest = max(runs, key=len)
    assert _longest_whole(missing) == (longest[0], longest[-1] + 1)


def test_nothing_but_missing_values_has_no_run():
    assert np.diff(_longest_whole(np.ones((5, 1), dtype=np.bool_))) == [0]


def test_a_record_without_gaps_stays_as_it_is():
    given = record(noise())
    found, notes = without_gaps(given, given.channels)
    assert notes == []
    np.testing.assert_array_equal(found.values, given.values)


def test_a_long_gap_cuts_out_the_longest_segment():
    values = noise()
    values[100:140] = np.nan
    found, notes = without_gaps(record(values), record(values).channels)
    assert (found.time[0], found.time[-1]) == pytest.approx((14.0, 59.9))
    assert [note for note in notes if "only 14 to 59.9 s, without gaps, were used" in note]


def test_a_channel_without_readings_is_refused_by_name():
    values = noise()
    values[:, 1] = np.nan
    with pytest.raises(ws.RecordError, match="'floor_1_displacement' holds no readings"):
        without_gaps(record(values), record(values).channels)


def test_a_spike_is_replaced_by_the_line_between_its_neighbours():
    values = noise()
    clean = values.copy()
    values[300, 0] += 50.0
    found = choose_samples(record(values), None)
    assert found.values[300, 0] == pytest.approx(0.5 * (clean[299, 0] + clean[301, 0]))
    np.testing.assert_array_equal(found.values[:, 1], clean[:, 1])
    assert any("1 samples of spikes among 600" in note for note in found.notes)
    assert found.doubts == ()


def test_a_copy_is_left_out_of_samples_and_sensors():
    values = noise()
    found = choose_samples(record(np.column_stack([values, 2.0 * values[:, 0]])), None)
    assert [sensor.channel for sensor in found.sensors] == ["floor_0_displacement", "floor_1_displacement"]
    np.testing.assert_array_equal(found.values, values)

"""Readings without gaps."""

import numpy as np
import pytest

from tests.identification.fits import CHANNELS, TOWER, noise, record_of
from windsysid.errors import RecordError
from windsysid.identification.condition.spectral_readings import SpectralSamples, read_bridged
from windsysid.inspection.limits import MAX_FAULT_SHARE
from windsysid.results.finding import Finding


def test_short_gaps_are_straight_lines_and_are_counted():
    readings = noise()
    readings[100:103, 1] = np.nan
    notes: list[Finding] = []
    found = read_bridged(record_of(readings), CHANNELS, notes)
    expected = np.interp([100, 101, 102], [99, 103], readings[[99, 103], 1])
    np.testing.assert_allclose(found[100:103, 1], expected, rtol=1e-12)
    np.testing.assert_array_equal(found[:, 0], readings[:, 0])
    assert [(one.code, one.data["channel"], one.data["count"]) for one in notes] == [
        ("missing_samples_bridged", CHANNELS[1], 3)
    ]


def test_a_channel_with_more_gaps_is_refused_by_name():
    readings = noise()
    readings[: int(2 * MAX_FAULT_SHARE * len(readings)), 0] = np.nan
    with pytest.raises(RecordError, match=f"channel '{CHANNELS[0]}': expected at most 2 % missing .* got 4 %"):
        read_bridged(record_of(readings), CHANNELS, [])


def test_samples_are_the_inputs_and_the_readings_of_a_record():
    record = record_of(noise())
    found = SpectralSamples.of(record, TOWER, TOWER.sensors, [])
    np.testing.assert_array_equal(found.readings, record.values)
    speed = found.inputs[:, TOWER.model.inputs.index("rotor_speed")]
    np.testing.assert_allclose(speed, TOWER.rotor_speed)
    assert (found.record, found.sensors, found.sums) == (record, TOWER.sensors, None)

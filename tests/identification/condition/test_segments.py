"""Segments of a record: checked against those before them, gaps between them filled with missing samples."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from windsysid.errors import RecordError
from windsysid.identification.condition.segments import SegmentReader, require_alike, steps_after
from windsysid.records.record import Record

VALUES = np.random.default_rng(1).normal(size=(300, 2))
RECORD = Record(np.arange(300) / 10.0, VALUES, ("a", "b"), ("m/s^2", "m/s^2"), name="shaken")


def part(first: int, last: int, record: Record = RECORD) -> Record:
    return replace(record, time=record.time[first:last], values=record.values[first:last])


def test_a_gap_between_segments_is_missing_samples():
    reader = SegmentReader([part(0, 100), part(130, 300)], ("a", "b"), continuous=True)
    first, second = list(reader)
    assert (first.samples, second.samples, reader.samples) == (100, 200, 300)
    assert np.isnan(second.values[:30]).all()
    np.testing.assert_array_equal(second.values[30:], VALUES[130:])
    np.testing.assert_allclose(second.time, RECORD.time[100:], atol=1e-12)
    assert (reader.first, reader.last, reader.whole) == (first, second, False)


def test_segments_that_need_not_follow_each_other_stay_as_they_are():
    day = replace(RECORD, time=RECORD.time + 86400.0)
    reader = SegmentReader([RECORD, part(0, 200, day)], ("a",), continuous=False)
    assert [segment.samples for segment in reader] == [300, 200]


def test_a_whole_record_is_its_only_segment():
    reader = SegmentReader(RECORD, ("a",), continuous=True)
    assert [segment.samples for segment in reader] == [300]
    assert reader.whole
    assert reader.faults == []


@pytest.mark.parametrize(
    ("refused", "message"),
    [
        (lambda: list(SegmentReader([], ("a",), continuous=True)), "no pieces: expected at least one"),
        (lambda: list(SegmentReader([RECORD, RECORD], ("a",), continuous=True)), "begins after the one before"),
        (lambda: require_alike(RECORD, 10.2), "expected pieces of 10.2 Hz, got one of 10 Hz"),
        (lambda: require_alike(RECORD, 10.0, ("a", "c", "d")), "channels of the first piece, got none of c, d"),
        (lambda: steps_after(part(0, 100), part(99, 200), 10.0), "got an overlap"),
    ],
)  # fmt: skip
def test_segments_that_do_not_fit_are_refused(refused: Callable[[], object], message: str):
    with pytest.raises(RecordError, match=message):
        refused()


def test_rates_that_differ_by_rounded_stamps_are_the_same():
    require_alike(RECORD, 10.05)
    assert steps_after(part(0, 100), part(101, 200), 10.0) == 2

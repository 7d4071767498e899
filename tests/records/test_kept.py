"""Results that are computed once for each record."""

import gc
import weakref

import numpy as np

from windsysid.records.kept import kept_with_record
from windsysid.records.record import Record


def record_of() -> Record:
    return Record(np.arange(4.0), np.zeros((4, 1)), ("a_acceleration",), ("m/s^2",))


def test_a_result_is_computed_once_for_each_record_and_argument():
    asked = []

    @kept_with_record
    def double(record: Record, factor: float) -> list[float]:
        asked.append((record, factor))
        return [factor]

    first, second = record_of(), record_of()
    assert double(first, 2.0) is double(first, 2.0)
    assert double(first, 3.0) == [3.0]
    double(second, 2.0)
    assert asked == [(first, 2.0), (first, 3.0), (second, 2.0)]


def test_a_record_that_is_its_own_result_is_freed():
    @kept_with_record
    def same(record: Record) -> Record:
        return record

    record = record_of()
    assert same(record) is same(record) is record
    gone = weakref.ref(record)
    del record
    gc.collect()
    assert gone() is None

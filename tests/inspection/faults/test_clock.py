"""Faults of the clock, against gaps and steps that were put into one."""

import numpy as np
import pytest

from windsysid.inspection.faults.clock import clock_faults
from windsysid.records.record import Record


def record_at(time: np.ndarray) -> Record:
    values = np.random.default_rng(0).standard_normal((len(time), 2))
    return Record(time, values, ("a_acceleration", "b_acceleration"), ("m/s^2",) * 2)


def test_a_regular_clock_has_no_fault():
    assert clock_faults(record_at(0.02 * np.arange(1000))) == []


def test_a_gap_is_found_with_its_place_and_the_samples_that_it_lacks():
    time = 0.02 * np.arange(1000)
    (fault,) = clock_faults(record_at(np.delete(time, np.s_[400:500])))
    assert (fault.kind, fault.severity, fault.count) == ("gaps", "warning", 100)
    np.testing.assert_allclose(fault.spans, [[time[399], time[500]]])
    assert fault.data["longest"] == pytest.approx(2.02)
    assert fault.data["share"] == pytest.approx(0.1)


def test_many_short_gaps_are_one_fault_and_irregular_steps_are_counted():
    time = 0.02 * np.arange(2000)
    (fault,) = clock_faults(record_at(np.delete(time, np.arange(50, 2000, 60))))
    assert (fault.kind, fault.count, fault.data["gaps"]) == ("short gaps", 33, 33)
    late = time + np.where(np.arange(2000) % 100 == 50, 0.004, 0.0)
    (fault,) = clock_faults(record_at(late))
    assert (fault.kind, fault.severity, fault.count) == ("irregular sampling", "warning", 40)
    assert fault.data["worst"] == pytest.approx(0.2, abs=1e-6)


def test_rows_that_were_written_twice_are_found():
    time = 0.02 * np.arange(1000)
    record = record_at(time)
    record.values[[300, 301]] = record.values[299]
    (fault,) = clock_faults(record)
    assert (fault.kind, fault.count, fault.data["vibrating"]) == ("repeated rows", 2, 2)
    np.testing.assert_allclose(fault.spans, [[time[300], time[301]]])

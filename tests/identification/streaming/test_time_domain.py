"""Samples of segments: held on disk as the whole record would be read."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from windsysid.errors import RecordError
from windsysid.identification.condition.blockwise import BlockwiseConditioner
from windsysid.identification.model.prior import Prior
from windsysid.identification.streaming.run import StreamingJob
from windsysid.identification.streaming.time_domain import SampleAccumulator
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.turbine import Turbine


@pytest.fixture(scope="module")
def record(verne555: Turbine) -> Record:
    return simulate_record(verne555, duration=30.0, rate=50.0, seed=2)


def begun(record: Record, turbine: Turbine) -> SampleAccumulator:
    job = StreamingJob(turbine, turbine.sensors, Prior(), None, "joint", None, "broadband", None, None, False, {})
    return SampleAccumulator(record, job)


def test_samples_of_segments_are_those_of_the_whole_record(verne555: Turbine, record: Record):
    edges = (0, 700, 1130, record.samples)
    parts = [replace(record, time=record.time[a:b], values=record.values[a:b]) for a, b in pairwise(edges)]
    taken, straight = begun(parts[0], verne555), BlockwiseConditioner(record, verne555, verne555.sensors, None)
    for part in parts:
        taken.replay(part)  # which holds samples, and estimates nothing
    taken._hold(taken.windows.finish())
    expected = [part for part in (straight.take(record), straight.finish()) if part is not None]
    assert taken.samples is not None
    inputs, readings = taken.samples.rows(0, taken.samples.count)
    np.testing.assert_allclose(inputs, np.vstack([part.inputs for part in expected]), atol=1e-6)
    np.testing.assert_allclose(readings, np.vstack([part.readings for part in expected]), atol=1e-6)
    assert taken.problem is None
    assert taken.stored() == ({}, {"chosen": None})


def test_only_the_first_samples_stay_in_memory_until_loads_are_chosen(verne555: Turbine, record: Record):
    taken = begun(record, verne555)
    taken.enough = 50
    for first in range(0, record.samples - 25, 25):
        part = replace(record, time=record.time[first : first + 25], values=record.values[first : first + 25])
        taken.replay(part)
    assert taken.samples is not None
    assert 50 <= sum(len(held.readings) for held in taken.beginning) < taken.samples.count


def test_no_samples_are_no_estimate(verne555: Turbine, record: Record):
    with pytest.raises(RecordError, match="expected at least two samples"):
        begun(record, verne555).estimate()

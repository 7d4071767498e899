"""One's own equations in time: the problem of segments is that of the whole record."""

from dataclasses import replace

import numpy as np

from tests.identification.test_own_equations import AT_REST, PARAMETERS, SPRING, sensors, shaken
from windsysid.identification.condition.segments import SegmentReader
from windsysid.identification.estimate.equations_time import _take, fit_by_filter
from windsysid.identification.model.equations_problem import EquationsJob

JOB = EquationsJob(SPRING, PARAMETERS, sensors(), None, AT_REST, {"m": 2.0}, (), {}, False)


def test_samples_of_segments_are_those_of_the_whole_record_and_stand_on_disk():
    record = shaken(400)
    parts = [replace(record, time=record.time[a:b], values=record.values[a:b]) for a, b in ((0, 150), (150, 400))]
    whole, cut = (SegmentReader(of, JOB.readings, continuous=True) for of in (record, parts))
    problem, samples, _ = _take(JOB, whole)
    same, held, _ = _take(JOB, cut)
    (expected,), (found,) = list(samples), list(held)
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(same.prior[1], problem.prior[1])
    assert whole.samples == cut.samples == 400


def test_a_fit_has_innovations_and_a_history_of_every_sample():
    record = shaken(400)
    reader = SegmentReader(record, JOB.readings, continuous=True)
    found = fit_by_filter(JOB, reader)
    assert found.whiteness is not None
    assert found.info.innovation.shape == (400, 2)
    assert found.history[0].shape == (400, 2)
    assert found.time is reader.first.time
    damping, stiffness = 20.0 * found.unknowns[0], 20.0 * np.exp(found.unknowns[1])
    assert abs(damping - 0.8) < 0.2
    assert abs(stiffness - 50.0) < 1.0

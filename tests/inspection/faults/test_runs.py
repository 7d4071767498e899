"""Runs of True in a mask, against the ones that were put there."""

import numpy as np

from windsysid.inspection.faults.runs import runs_of, spans_of


def test_runs_are_those_that_were_put_there():
    mask = np.zeros(12, dtype=np.bool_)
    mask[[0, 1, 5, 10, 11]] = True
    assert runs_of(mask).tolist() == [[0, 2], [5, 6], [10, 12]]
    assert spans_of(0.5 * np.arange(12.0), mask).tolist() == [[0.0, 0.5], [2.5, 2.5], [5.0, 5.5]]
    assert runs_of(np.zeros(3, dtype=np.bool_)).shape == (0, 2)

"""Planned records, and the information of spectra about what they see."""

import numpy as np
import pytest

from windsysid.identification.planning.spectral_information import PlannedRecord, _of_what_is_seen
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine


def test_a_planned_record_is_the_stationary_end_of_a_simulated_one():
    tower = load_turbine("tower")
    planned = PlannedRecord(tower, 10.0, 20.0, 30.0, 3)
    found, whole = planned.drawn(2), simulate_record(tower, duration=50.0, rate=10.0, seed=5)
    np.testing.assert_array_equal(found.values, whole.values[200:499])
    assert found.duration == pytest.approx(30.0, abs=0.21)
    assert not np.array_equal(found.values, planned.drawn().values)


def test_what_no_record_sees_has_no_information():
    seen = np.diag([4.0, 9.0, 0.0])
    growths = np.array([seen, seen + np.diag([1.0, 0.0, 1e-12])])
    np.testing.assert_allclose(_of_what_is_seen(growths), np.array([seen, np.diag([5.0, 9.0, 0.0])]), atol=1e-9)

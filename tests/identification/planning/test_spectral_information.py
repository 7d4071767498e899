"""Planned records, and the information of spectra about what they see."""

import numpy as np
import pytest

from windsysid.identification.planning.plan import plan
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


def test_what_every_record_leaves_open_is_not_seen_by_their_mean():
    # Each is blind to one direction, linearised at its own estimate: a stiffness and its tolerance of 8 %.
    blind = [np.array([-0.08 * off, 1.0]) for off in (0.98, 1.0, 1.03)]
    growths = np.array([np.outer(v, v) for v in ([[0.0, 1.0], [-1.0, 0.0]] @ one for one in blind)])
    assert np.linalg.eigvalsh(growths.mean(axis=0))[0] > 1e-6
    assert np.abs(np.linalg.eigvalsh(_of_what_is_seen(growths))[:, 0]).max() < 1e-15


def test_directions_of_unknowns_that_only_some_records_have_are_kept():
    growths = np.array([np.diag([4.0, 1.0, 0.0, 0.0]), np.diag([4.0, 0.0, 1.0, 0.0])])
    np.testing.assert_allclose(_of_what_is_seen(growths), growths)


@pytest.mark.parametrize("minutes", [10.0, 20.0])
def test_no_duration_removes_what_a_tolerance_leaves_open(minutes):
    tower = load_turbine("tower")
    found = plan(tower, duration=60.0 * minutes, rate=5.0, within=0.1, formulation="spectral")
    floor = 2.0 * np.hypot(tower.aerodynamic_tolerance, tower.mass_tolerance)
    assert found.needed("k_fore_aft") == np.inf
    assert "k_fore_aft (never)" in found.verdict
    assert found.band("k_fore_aft", 3e8) == pytest.approx(floor, rel=1e-3)
    assert found.band("k_side_side", 3e8) == pytest.approx(2.0 * tower.mass_tolerance, rel=2e-3)

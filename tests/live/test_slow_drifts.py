"""References of slow drifts, and the limit of their test."""

import numpy as np
import pytest

from windsysid.live.watch.slow_drifts import (
    MAX_REFERENCES,
    TEST_EVERY_BLOCKS,
    DriftReference,
    Past,
    drifted_since,
    grew,
    limit_of,
    remembered,
)
from windsysid.monitoring.levels.following import MAX_KEPT_BLOCKS, Kept, Now
from windsysid.monitoring.levels.jumps import LevelBelief, Rates
from windsysid.monitoring.levels.locating import Jump
from windsysid.monitoring.watch import YEAR

WANDER = 1e-10
BLOCKS = np.zeros(1000, dtype=np.float32)


def kept(let_go: int, *, jumps: tuple[Jump, ...] = (), level: float = 0.0, scale: float = 1.0) -> Kept:
    belief = LevelBelief(np.array([level, 0.3]), np.diag([4e-6, 1.0]))
    return Kept(BLOCKS, BLOCKS, let_go, belief, Rates(WANDER, 1.0), scale, jumps)


def test_references_lie_four_weeks_apart_and_are_a_year_of_them():
    past = Past()
    for week in range(1, 120):
        past = remembered(past, kept(1008 * week, level=float(week)), 1008, week, WANDER)
    blocks = [one.block for one in past.references]
    assert len(blocks) == MAX_REFERENCES
    assert set(np.diff(blocks)) == {MAX_KEPT_BLOCKS}
    assert past.references[-1][:3] == (1008 * 117, 117, 117.0)
    assert past.references[-1].std == pytest.approx(2e-3)
    assert past.wandered - past.references[-1].wandered == pytest.approx(2 * 1008 * WANDER)


def test_nothing_is_remembered_beside_a_jump_or_before_anything_was_learned():
    jump = Jump(2000, 2000, 2000, 2010, -0.03, 0.001, 0.0)
    for one in (kept(1008, jumps=(jump,)), kept(1008)._replace(before=None)):
        assert remembered(Past(), one, 1008, 0, WANDER) == Past((), 0.0, WANDER)


def test_a_drift_is_held_against_what_the_level_wanders_by_itself_and_what_is_tolerated():
    reference, now = DriftReference(1008, 5, 0.01, 0.002, 1e-7), Now(-0.02, 0.001, 0.002, 0.0)
    past = Past((reference,), 9e-7, WANDER)
    drift = drifted_since(reference, past, now, kept(9009), 0.005)
    wander = np.sqrt(8e-7 + 1000 * WANDER)
    assert drift.wander == pytest.approx(wander)
    assert (drift.jump.size, drift.jump.std) == pytest.approx((-0.03, 0.003))
    assert (drift.jump.earliest, drift.jump.before, drift.time) == (1008, 0.01, 5)
    assert drift.z == pytest.approx(0.025 / np.hypot(0.003, wander))
    coarse = drifted_since(reference, past, now, kept(9009, scale=4.0), 0.005)
    assert coarse.z == pytest.approx(0.01 / np.hypot(0.003, wander))


def test_a_drift_grew_where_its_band_lies_beyond_half_as_much_again():
    before = Jump(9, 1, 9, 9, -0.02, 0.001, 0.0)
    assert grew(before, before._replace(size=-0.033))
    assert not grew(before, before._replace(size=-0.031))


def test_normal_levels_pass_the_limit_no_more_often_than_stated():
    # Independent tests, of which there are most; the rate is high, so that it shows.
    rate, window, series = 50.0, 600.0, 4
    limit = limit_of(rate, window, series)
    years = 20
    tests = round(years * series * MAX_REFERENCES * YEAR / (TEST_EVERY_BLOCKS * window))
    passed = np.count_nonzero(np.abs(np.random.default_rng(1).standard_normal(tests)) > limit)
    assert passed == pytest.approx(rate * years, abs=4.0 * np.sqrt(rate * years))

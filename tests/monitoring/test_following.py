"""A series followed block by block finds what the watch over all of them finds."""

import math

import numpy as np
import pytest

from windsysid._types import Array
from windsysid.monitoring.levels import following
from windsysid.monitoring.levels.following import Kept, LevelFollower, Now
from windsysid.monitoring.levels.jumps import Observations, Rates, threshold, track
from windsysid.monitoring.levels.locating import Jump, first_belief
from windsysid.monitoring.levels.together import PRIOR_BLOCKS
from windsysid.monitoring.series import RecordBlocks
from windsysid.monitoring.watch import watch

SIGMA = 0.004
LIMIT = threshold(1e-6)


def follow(y: Array, x: Array, *, learn: int = 300, limit: float = LIMIT) -> tuple[list[Now], LevelFollower]:
    follower = LevelFollower("k", True, 0.005, LevelFollower.beginning(0, 0))
    found = []
    for k, one in enumerate(y, 1):
        follower.append(one, SIGMA)
        part = x[:k]
        if k == learn:
            found.append(follower.learn(part, anew=True))
        else:
            found.append(follower.follow(part[-1:], lambda part=part: part, limit))  # type: ignore[misc]
    return found, follower


def simulated(count: int, jump: float, at: int, seed: int) -> Array:
    return SIGMA * np.random.default_rng(seed).standard_normal(count) + jump * (np.arange(count) >= at)


@pytest.mark.parametrize(
    ("jump", "seed"), [pytest.param(*one, marks=pytest.mark.slow) for one in ((-0.03, 1), (0.02, 2), (-0.1, 3))]
)
def test_a_jump_is_found_when_where_and_as_large_as_with_all_blocks_known(jump: float, seed: int):
    y, x = simulated(600, jump, 400, seed), np.zeros((600, 1))
    found, follower = follow(y, x)
    (new,) = [one.new for one in found if one.new is not None]
    blocks = RecordBlocks(
        ("k_x",), np.asarray(600.0 * np.arange(600)), y[:, None], np.full((600, 1), SIGMA), (True,), (1.0,),
        np.empty((600, 0)),
    )  # fmt: skip
    (whole,) = watch(blocks).changes
    assert abs(new.found - whole.found / 600.0) <= 1
    (last,) = follower.kept.jumps  # measured again a day later
    assert (last.earliest, last.latest) == pytest.approx((whole.earliest / 600.0, whole.latest / 600.0), abs=1)
    assert 100.0 * math.expm1(last.size) == pytest.approx(whole.percent, abs=0.05)
    assert last.std < new.std
    assert found[-1].level == pytest.approx(y[400:].mean(), abs=3.0 * SIGMA / math.sqrt(200.0))


def test_a_jump_is_measured_again_by_the_blocks_after_it():
    y = simulated(150, -0.03, 90, 1)
    found, follower = follow(y, np.zeros((150, 1)), learn=60)
    (new,) = [one.new for one in found if one.new is not None]
    (last,) = follower.kept.jumps
    assert [len(one.again) for one in found if one.again] == [1]
    assert (last.found, last.latest) == (new.found, 90)
    assert last.std < 0.9 * new.std
    assert last.size == pytest.approx(y[90:].mean() - y[:90].mean(), abs=2.0 * SIGMA / math.sqrt(60.0))


def test_without_a_jump_a_follower_is_the_filter_of_all_blocks():
    rng = np.random.default_rng(4)
    x = rng.standard_normal((500, 2))
    y = (simulated(500, 0.0, 0, 4) + x @ np.array([0.01, -0.02])).astype(np.float32).astype(np.float64)
    _, follower = follow(y[:200], x[:200], learn=200)
    kept = follower.kept
    assert kept.before is not None
    assert kept.rates is not None
    r = np.full(500, float(np.float32(SIGMA)) ** 2)
    for rates in (kept.rates._replace(likely=(), learned_from=0), kept.rates):
        again = LevelFollower("k", True, 0.005, kept._replace(rates=rates))
        for k in range(200, 500):
            again.append(y[k], SIGMA)
            now = again.follow(x[k : k + 1], lambda part=x[: k + 1]: part, LIMIT)  # type: ignore[misc]
        of = [track(Observations.of(y, r, x), kept.before, one, tolerated=0.005) for one, _ in rates.hypotheses()]
        evidence = np.array([one.progress.evidence for one in of]) + [prior for _, prior in rates.hypotheses()]
        weight = np.exp(evidence - evidence.max()) / np.exp(evidence - evidence.max()).sum()
        level, std = (np.array([getattr(one, name)[-1] for one in of]) for name in ("level", "std"))
        assert now.level == pytest.approx(weight @ level, rel=1e-12)
        blocks = rates.learned_from + PRIOR_BLOCKS
        wider = blocks / (blocks - 2) if rates.learned_from else 1.0
        variance = weight @ (std**2 + (level - weight @ level) ** 2)
        assert now.std**2 == pytest.approx(wider * variance, rel=1e-9)
        if not rates.likely:
            assert now.statistic == pytest.approx(of[0].statistic[-1], abs=1e-9)


def test_what_leaves_is_in_the_belief_before_what_is_kept():
    y, x = simulated(400, 0.0, 0, 5), np.zeros((400, 1))
    _, follower = follow(y, x, learn=100)
    before = follower.kept
    follower.let_go(x, 150)
    assert (len(follower.kept.y), follower.kept.let_go) == (250, 150)
    (stays,) = {one.shape for one in (follower.kept.y, follower.kept.std)}
    assert stays == (250,)
    assert before.rates == follower.kept.rates
    again = LevelFollower("k", True, 0.005, follower.kept)
    for one in (follower, again):
        one.append(0.0, SIGMA)
    x = np.zeros((251, 1))
    ends = [one.follow(x[-1:], lambda: x, LIMIT) for one in (follower, again)]
    assert ends[0] == ends[1]
    assert ends[0].level == pytest.approx(np.append(y, 0.0).mean(), abs=2.0 * SIGMA / 20.0)
    few = LevelFollower("k", True, 0.005, before)
    few.let_go(np.zeros((400, 1)), 395)
    few.append(0.0, SIGMA)
    assert few.follow(x[-1:], lambda: x[:6], LIMIT).std < 0.85 * SIGMA / math.sqrt(6.0)  # of six blocks alone


def test_a_jump_that_lies_between_blocks_that_leave_and_stay_is_kept():
    jump = Jump(100, 90, 110, 120, -0.03, 0.001, 0.0)
    kept = Kept(np.zeros(200, np.float32), np.full(200, SIGMA, np.float32), 0, None, Rates(1e-9, 1.0), 1.0, (jump,))
    follower = LevelFollower("k", True, 0.005, kept)
    follower.kept = follower.kept._replace(before=first_belief(np.zeros(200), np.ones(200), 1, "k", True)[0])
    follower.let_go(np.zeros((200, 1)), 100)
    assert list(follower.kept.jumps) == [jump]
    follower.let_go(np.zeros((100, 1)), 50)
    assert not follower.kept.jumps


def test_more_jumps_than_are_remembered_wait(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(following, "MAX_JUMPS", 1)
    y = simulated(200, 0.05, 120, 6) + 0.05 * (np.arange(200) >= 160)
    found, follower = follow(y, np.zeros((200, 1)), learn=80)
    assert sum(one.new is not None for one in found) == len(follower.kept.jumps) == 1


def test_a_series_of_nothing_has_no_level():
    found, _ = follow(np.full(20, np.nan), np.zeros((20, 1)), learn=12)
    assert all(math.isnan(one.level) for one in found)


def test_numbers_beyond_single_precision_are_missing():
    follower = LevelFollower("k", True, 0.005, LevelFollower.beginning(0, 0))
    for y, std in ((1e300, 1.0), (0.0, 1e-60), (0.0, 0.0), (math.nan, 1.0), (0.0, math.inf)):
        follower.append(y, std)
    assert follower.known == 0


@pytest.mark.slow
def test_a_drift_is_a_wander_but_beside_a_trend_and_the_last_blocks_do_not_lag_behind_it():
    fall = -0.03 * np.arange(2400) / 2400.0
    y, x = simulated(2400, 0.0, 0, 11) + fall, np.zeros((2400, 1))
    _, follower = follow(y, x, learn=200, limit=math.inf)
    level, std = follower.newest_level(x, 40)
    assert abs(level - fall[-1]) < 2.0 * std
    follower.learn(x, anew=False)
    assert follower.kept.rates is not None
    assert follower.wander_beside_trend(x) < 0.25 * follower.kept.rates.wander
    # The level that is followed, with the little wander of a level that was steady, lags.
    steady = LevelFollower("k", True, 0.005, follower.kept._replace(rates=Rates(1e-11, 1.0)))
    steady.append(float(y[-1]), SIGMA)
    lagging = steady.follow(x[:1], lambda: np.zeros((2401, 1)), math.inf)
    assert lagging.level - fall[-1] > 3.0 * lagging.std
    level, std = steady.newest_level(np.zeros((2401, 1)), 40)
    assert abs(level - fall[-1]) < 2.0 * std

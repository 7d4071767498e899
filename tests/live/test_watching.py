"""Levels, alarms and checkpoints from rows of windows."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

from windsysid.errors import ConfigurationError
from windsysid.fleet.rows import Row, empty_row
from windsysid.live.checkpoint import pack, unpack
from windsysid.live.store.contents import Alarm
from windsysid.live.watch import slow_drifts
from windsysid.live.watch import watching as watching_module
from windsysid.live.watch.watching import Taken, Watching, WatchOptions, resume, start
from windsysid.monitoring.levels import following
from windsysid.monitoring.watch import TOLERATED_DRIFT

STEP = 600 * 10**9
BEGIN = 1_700_000_400 * 10**9 // STEP * STEP
SIGMA, NOISE_SIGMA = 0.004, 0.05
SOON = WatchOptions(learn=48)
"""A third of a day to learn from, so that a jump after half a day is found."""


def row(theta: dict[str, float], noise: dict[str, float] | None = None, **more: Any) -> Row:
    """A row that says ln(k / 100 N/m) of coefficients and the logarithm of sensors' noise."""
    found = empty_row("stream", 0, "sha256:0") | {"status": "ok", "state": "unknown", "trusted": True}
    found["parameters"] = [
        {"name": name, "unit": "N/m", "kind": "stiffness", "logarithmic": True, "prior_centre": 100.0,
         "coordinate_scale": 1.0, "own": own, "own_std": SIGMA} for name, own in theta.items()
    ]  # fmt: skip
    found["statistics"] = [
        {"name": name, "unit": "m/s^2", "estimate": math.exp(own), "low": math.exp(own - 2.0 * NOISE_SIGMA),
         "high": math.exp(own + 2.0 * NOISE_SIGMA)} for name, own in (noise or {}).items()
    ]  # fmt: skip
    return found | more


def refused(why: str = "record too short") -> Row:
    return empty_row("stream", 0, "sha256:0") | {"status": "refused", "why": why}


def stream(
    count: int, *, seed: int = 0, at: int = 10**6, jump: dict[str, float] | None = None, back: int = 10**6
) -> list[Row]:
    """Rows of k_x, k_y and one noise, with jumps from window `at` up to window `back`."""
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(count):
        steps = {name: size * (at <= k < back) for name, size in (jump or {}).items()}
        theta = {name: SIGMA * rng.standard_normal() + steps.get(name, 0.0) for name in ("k_x", "k_y")}
        noise = {"noise_tower": NOISE_SIGMA * rng.standard_normal() + steps.get("noise_tower", 0.0)}
        rows.append(row(theta, noise))
    return rows


def feed(watching: Watching, rows: list[Row], first: int = 0) -> list[Taken]:
    return [watching.take(one, BEGIN + k * STEP) for k, one in enumerate(rows, first)]


def last_said(taken: list[Taken]) -> dict[str, Alarm]:
    return {alarm.key: alarm for one in taken for alarm in one.alarms}


def test_a_softer_support_is_one_alarm_that_says_what_when_and_how_much():
    taken = feed(start("T1", SOON), stream(160, at=70, jump={"k_x": -0.03}))
    assert not any(one.alarms for one in taken[:71])
    (alarm,) = last_said(taken).values()
    assert (alarm.kind, alarm.severity, alarm.about, alarm.ended) == ("structure", "alarm", "k_x", None)
    assert alarm.earliest <= BEGIN + 70 * STEP <= alarm.latest
    found = next(k for k, one in enumerate(taken) if one.alarms)
    assert found <= 76
    assert alarm.opened == BEGIN + (found + 1) * STEP
    assert "stiffness of the tower, x (k_x) fell by " in alarm.text
    assert "the sensors did not change" in alarm.text
    assert taken[-1].levels[0].level == pytest.approx(97.0, abs=0.2)
    assert [level.name for level in taken[-1].levels] == ["k_x", "k_y", "noise_tower"]


@pytest.mark.parametrize(
    "more", [pytest.param({"noise_tower": 1.0}, marks=pytest.mark.slow), {"health": [{"channel": "a"}]}]
)
def test_what_jumps_with_a_sensor_is_put_down_to_it(more: dict[str, Any]):
    rows = stream(90, at=70, jump={"k_x": -0.05, "noise_tower": more.get("noise_tower", 0.0)})
    rows[70:] = [one | {name: value for name, value in more.items() if name in one} for one in rows[70:]]
    alarms = last_said(feed(start("T1", SOON), rows))
    assert {alarm.kind for alarm in alarms.values()} == {"sensor"}
    assert {alarm.severity for alarm in alarms.values()} == {"warning"}
    (stiffness,) = [alarm for alarm in alarms.values() if alarm.about == "k_x"]
    assert "check the sensor first" in stiffness.text


def graded(one: Row, **grades: str) -> Row:
    """The row with grades of some coefficients; the others have A."""
    rows = [{**of, "grade": grades.get(of["name"], "A")} for of in one["parameters"]]
    return one | {"parameters": rows, "trusted": "C" not in grades.values(), "reasons": ["why"] if grades else []}


@pytest.mark.slow
def test_a_window_counts_for_the_coefficients_that_it_determines():
    # k_x is off by a fifth and of grade C in half of the windows; k_y falls in all of them.
    rows = [graded(one) for one in stream(100, at=70, jump={"k_y": -0.05})]
    for k in range(0, 100, 2):
        theta = {of["name"]: of["own"] for of in rows[k]["parameters"]}
        rows[k] = graded(row(theta | {"k_x": 0.2}, {"noise_tower": 0.0}), k_x="C")
    taken = feed(start("T1", SOON), rows)
    (alarm,) = last_said(taken).values()
    assert (alarm.about, alarm.kind) == ("k_y", "structure")
    k_x, k_y, noise = taken[98].levels
    assert (k_x.grade, k_y.grade, noise.grade) == ("C", "A", "")
    assert k_x.estimate == pytest.approx(100.0 * math.exp(0.2))  # shown, and not followed
    assert k_x.level == pytest.approx(100.0, rel=0.01)
    assert k_y.level == pytest.approx(95.0, rel=0.01)


def test_a_row_without_grades_counts_where_it_is_trusted():
    rows = stream(60)
    for k in range(0, 60, 2):
        rows[k] |= {"trusted": False}
    taken = feed(start("T1"), rows)
    assert [one.grade for one in taken[58].levels] == ["C", "C", ""]
    assert [one.grade for one in taken[59].levels] == ["A", "A", ""]


def test_a_jump_after_which_most_estimates_are_c_is_the_sensors_first():
    rows = [graded(one) for one in stream(110, at=70, jump={"k_x": -0.05})]
    rows[70:] = [graded(one, **({"k_x": "C"} if k % 3 else {})) for k, one in enumerate(rows[70:])]
    (alarm,) = last_said(feed(start("T1", SOON), rows)).values()
    assert (alarm.about, alarm.kind) == ("k_x", "sensor")
    assert "does not explain" in alarm.text


def test_coefficients_of_grade_c_for_six_hours_are_a_notice():
    rows = [graded(one) for one in stream(100)]
    rows[50:] = [graded(one, k_x="C", k_y="C") for one in rows[50:]]
    (alarm,) = last_said(feed(start("T1", SOON), rows)).values()
    assert (alarm.kind, alarm.severity) == ("data", "notice")
    assert "all coefficients have grade C: why" in alarm.text


def test_what_comes_back_ends_its_alarm_and_is_a_notice():
    alarms = list(last_said(feed(start("T1", SOON), stream(150, at=70, jump={"k_x": -0.05}, back=120))).values())
    first, second = alarms
    assert first.severity == "alarm"
    assert first.ended is not None
    assert BEGIN + 120 * STEP < first.ended < BEGIN + 135 * STEP
    assert (second.severity, second.ended) == ("notice", second.opened)
    assert "reverses an earlier change" in second.text


def test_a_watch_goes_on_from_any_checkpoint_to_the_same_bits(monkeypatch: pytest.MonkeyPatch):
    # Through learning, a jump and what is measured again of it, a gap, and blocks that leave.
    monkeypatch.setattr(following, "MAX_KEPT_BLOCKS", 60)
    monkeypatch.setattr(following, "DROPPED_BLOCKS", 15)
    monkeypatch.setattr("windsysid.live.watch.watching.MAX_KEPT_BLOCKS", 60)
    monkeypatch.setattr("windsysid.live.watch.watching.DROPPED_BLOCKS", 15)
    rows = stream(85, at=40, jump={"k_x": -0.06, "noise_tower": 1.5})
    rows[30:33] = [refused()] * 3
    options = WatchOptions(learn=24)
    windows = [BEGIN + (k + 5 * (k > 76)) * STEP for k in range(len(rows))]
    whole = start("T1", options)
    once = [whole.take(one, at) for one, at in zip(rows, windows, strict=True)]
    assert any(one.alarms for one in once)
    watching = start("T1", options)
    for k, (one, at) in enumerate(zip(rows, windows, strict=True)):
        taken = watching.take(one, at)
        assert taken == once[k], k
        if k % 9 == 5 or 29 < k < 34 or 39 < k < 48 or 57 < k < 63 or 74 < k < 80:  # at every event, and between
            watching = resume(taken.checkpoint, "T1", options)


@contextmanager
def short_weeks() -> Iterator[None]:
    """Weeks of 40 windows."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (following, watching_module, slow_drifts):
            patch.setattr(module, "MAX_KEPT_BLOCKS", 160)
        for module in (following, watching_module):
            patch.setattr(module, "DROPPED_BLOCKS", 40)
        patch.setattr(watching_module, "TEST_EVERY_BLOCKS", 12)
        slow_drifts.limit_of.cache_clear()
        yield


@pytest.fixture
def weeks_of_40_windows() -> Iterator[None]:
    with short_weeks():
        yield


@pytest.fixture(scope="module")
def softening() -> list[Taken]:
    """What is taken of a tower that softens slowly."""
    with short_weeks():
        return feed(start("T1", WatchOptions(learn=24)), drifting(640, -0.06))


def drifting(count: int, end: float, *, seed: int = 0, since: int = 170, over: int = 400) -> list[Row]:
    """Rows in which k_x drifts to `end` from window `since` on, and stays there."""
    rows = stream(count, seed=seed)
    for k, one in enumerate(rows):
        one["parameters"][0]["own"] += end * min(max((k - since) / over, 0.0), 1.0)
    return rows


@pytest.mark.usefixtures("weeks_of_40_windows")
def test_a_tower_that_softens_within_days_is_an_alarm():
    rows = drifting(204, -0.05, since=60, over=150)
    (alarm,) = last_said(feed(start("T1", WatchOptions(learn=24)), rows)).values()
    assert (alarm.about, alarm.kind, alarm.ended) == ("k_x", "structure", None)
    assert "stiffness of the tower, x (k_x) fell slowly, by " in alarm.text


def test_a_tower_that_softens_slowly_is_one_alarm_that_grows_with_it(softening: list[Taken]):
    said = [(k, alarm) for k, one in enumerate(softening) for alarm in one.alarms]
    assert {alarm.key for _, alarm in said} == {said[0][1].key}
    (first, opened), (_, last) = said[0], said[-1]
    assert 170 + 60 < first < 170 + 300
    assert (opened.about, opened.kind, opened.severity) == ("k_x", "structure", "warning")
    assert "stiffness of the tower, x (k_x) fell slowly, by " in opened.text
    assert "its usual variation over such a time is" in opened.text
    assert "the temperature is not recorded" in opened.text
    assert (last.severity, last.opened, last.ended) == ("alarm", opened.opened, None)
    assert last.latest > opened.latest
    assert 3 <= len(said) <= 7


@pytest.mark.usefixtures("weeks_of_40_windows")
def test_a_drift_that_goes_back_ends_its_alarm(softening: list[Taken]):
    rows = drifting(780, -0.06)[600:]
    for k, one in enumerate(rows):
        one["parameters"][0]["own"] += 0.06 * min(k / 100.0, 1.0)
    watching = resume(softening[599].checkpoint, "T1", WatchOptions(learn=24))
    alarms = list(last_said(feed(watching, rows, 600)).values())
    assert alarms[0].ended is not None
    assert BEGIN + 600 * STEP < alarms[0].ended < BEGIN + 760 * STEP
    assert {alarm.severity for alarm in alarms[1:]} <= {"notice"}


@pytest.mark.slow
@pytest.mark.usefixtures("weeks_of_40_windows")
@pytest.mark.parametrize(("end", "tolerated"), [(-0.004, 0.005), (-0.03, 0.03)])
def test_what_does_not_drift_beyond_what_is_tolerated_is_no_alarm(end: float, tolerated: float):
    options = WatchOptions(learn=24, tolerated=TOLERATED_DRIFT | {"k": tolerated})
    assert not last_said(feed(start("T1", options), drifting(440, end, over=200)))


@pytest.mark.slow
@pytest.mark.usefixtures("weeks_of_40_windows")
def test_after_a_jump_no_drift_is_counted_from_before_it():
    taken = feed(start("T1", WatchOptions(learn=24)), stream(640, at=300, jump={"k_x": -0.03}))
    (alarm,) = last_said(taken).values()
    assert "slowly" not in alarm.text


@pytest.mark.slow
@pytest.mark.usefixtures("weeks_of_40_windows")
def test_a_watch_goes_on_from_a_checkpoint_through_a_drift_to_the_same_bits(softening: list[Taken]):
    rows, options = drifting(420, -0.06), WatchOptions(learn=24)
    assert any("slowly" in alarm.text for one in softening[300:420] for alarm in one.alarms)
    watching = resume(softening[299].checkpoint, "T1", options)
    for k, one in enumerate(rows[300:], 300):
        taken = watching.take(one, BEGIN + k * STEP)
        assert taken == softening[k], k
        if k % 7 == 0:
            watching = resume(taken.checkpoint, "T1", options)


@pytest.mark.parametrize("version", [b"watch 1", pytest.param(b"watch 2", marks=pytest.mark.slow)])
def test_a_checkpoint_of_a_version_before_is_read(version: bytes):
    rows = stream(100, at=70, jump={"k_x": -0.04})
    content = feed(start("T1", SOON), rows)[-1].checkpoint
    header, arrays = unpack(content, "checkpoint")
    if version == b"watch 1":
        for one in header["series"]:
            del one["past"]
        header["cases"] = [case[:4] for case in header["cases"]]
    assert header["cases"]
    arrays.insert(2, np.ones(100, dtype=bool))  # whether the windows were trusted
    before = pack(header, arrays).replace(b"watch 3", version)
    (next_row,) = stream(1, seed=5)
    window = BEGIN + 100 * STEP
    assert resume(before, "T1", SOON).take(next_row, window) == resume(content, "T1", SOON).take(next_row, window)


@pytest.mark.slow
def test_a_checkpoint_never_outgrows_the_windows_that_are_kept(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("windsysid.live.watch.watching.MAX_KEPT_BLOCKS", 100)
    monkeypatch.setattr("windsysid.live.watch.watching.DROPPED_BLOCKS", 25)
    sizes = [len(one.checkpoint) for one in feed(start("T1", WatchOptions(learn=12)), stream(260))]
    assert max(sizes[:150]) >= max(sizes[150:]) - 200
    assert sizes[99] > sizes[50]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda content: b"", "another version or damaged"),
        (lambda content: content[:-1], "damaged"),
        (lambda content: content[:200] + b"x" + content[201:], "damaged"),
        (lambda content: content.replace(b"watch 3", b"watch 9"), "another version"),
    ],
)
def test_a_checkpoint_that_does_not_fit_is_one_line(spoil: Any, message: str):
    content = feed(start("T1"), stream(3))[-1].checkpoint
    with pytest.raises(ConfigurationError, match=message) as refusal:
        resume(spoil(content), "T1")
    assert "\n" not in str(refusal.value)
    with pytest.raises(ConfigurationError, match="it is one of 'T1'"):
        resume(content, "T2")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (WatchOptions(learn=5), "learn: expected 12 to 2016"),
        (WatchOptions(alarms_per_year=0.0), "alarms per year"),
        (WatchOptions(window=0.0), "window: expected"),
        (WatchOptions(tolerated={"k": 0.01}), "tolerated: expected a size of 0 or more for c, f, noise"),
    ],
)
def test_options_out_of_range_are_refused(options: WatchOptions, message: str):
    with pytest.raises(ConfigurationError, match=message):
        start("T1", options)


def test_windows_come_in_order():
    watching = start("T1")
    watching.take(row({"k_x": 0.0}), BEGIN)
    with pytest.raises(ConfigurationError, match="take them in order"):
        watching.take(row({"k_x": 0.0}), BEGIN)


def test_a_window_that_is_missing_counts_as_one_that_was_refused():
    rows = stream(34)
    rows[30] = refused()
    refusing, missing = start("T1", WatchOptions(learn=24)), start("T1", WatchOptions(learn=24))
    for k, one in enumerate(rows):
        levels = refusing.take(one, BEGIN + k * STEP).levels
        if k != 30:
            assert [(of.level, of.statistic) for of in missing.take(one, BEGIN + k * STEP).levels] == [
                (of.level, of.statistic) for of in levels
            ], k


def test_refused_and_missing_windows_widen_the_band_and_long_silence_is_said():
    watching = start("T1", WatchOptions(learn=12))
    before = feed(watching, stream(40))[-1].levels[0]
    taken = feed(watching, [refused()] * 40, 40)
    after = taken[-1].levels[0]
    assert after.estimate is None
    assert after.level == before.level
    assert (after.level_high or 0.0) > (before.level_high or 0.0)
    (notice,) = last_said(taken).values()
    assert (notice.kind, notice.severity, notice.ended) == ("data", "notice", None)
    assert "record too short" in notice.text
    assert taken[35].alarms
    (ended,) = feed(watching, stream(1, seed=3), 80)[-1].alarms
    assert (ended.key, ended.ended) == (notice.key, BEGIN + 81 * STEP)


def test_a_state_other_than_the_usual_has_a_level_of_its_own():
    # A parked turbine looks softer by 10 %: no alarm, and the level is that of the running one.
    rng = np.random.default_rng(4)
    rows = stream(240, seed=4)
    for k, one in enumerate(rows):
        one["state"] = "parked" if (k // 20) % 4 == 1 else "running"
        one["scada_wind_speed"] = 8.0 + rng.standard_normal()
        one["parameters"][0]["own"] -= 0.1 * (one["state"] == "parked")
        if k % 50 == 7:
            one["state"] = "transient"
            one["parameters"][0]["own"] = 3.0
    taken = feed(start("T1"), rows)
    assert not last_said(taken)
    assert taken[-1].levels[0].level == pytest.approx(100.0, abs=0.15)


@pytest.mark.slow
def test_the_effect_of_temperature_is_learned_and_no_alarm():
    rows = stream(500, seed=5)
    for k, one in enumerate(rows):
        one["scada_temperature"] = 10.0 + 8.0 * math.sin(2.0 * math.pi * k / 350.0) + 3.0 * math.sin(k / 23.0)
        one["parameters"][0]["own"] -= 0.003 * (one["scada_temperature"] - 10.0)
    rows[250]["scada_temperature"] = None  # left out
    assert not last_said(feed(start("T1"), rows))


def test_another_prior_or_coordinate_is_no_jump():
    rows = stream(140, seed=6)
    for one in rows[90:]:
        first, second = one["parameters"]
        first |= {"prior_centre": 130.0, "own": first["own"] - math.log(1.3)}
        value = 100.0 * math.exp(second["own"])
        second |= {"logarithmic": False, "coordinate_scale": 50.0, "own": value / 50.0}
        second |= {"own_std": second["own_std"] * value / 50.0}
    taken = feed(start("T1", SOON), rows)
    assert not last_said(taken)
    assert [taken[-1].levels[i].level for i in (0, 1)] == pytest.approx([100.0, 100.0], abs=0.2)


def test_a_series_that_comes_later_has_a_level_of_its_own():
    rows = stream(50, seed=7)
    for one in rows[30:]:
        one["parameters"].append(one["parameters"][1] | {"name": "k_beta_1"})
    levels = {level.name: level for level in feed(start("T1", WatchOptions(learn=24)), rows)[-1].levels}
    assert levels["k_beta_1"].level == pytest.approx(100.0, abs=0.3)


@pytest.mark.slow
def test_a_series_that_comes_later_is_learned_from_when_it_is_there():
    rows = stream(140, seed=7)
    rng = np.random.default_rng(8)
    for k, one in enumerate(rows):
        if k >= 30:
            own = SIGMA * rng.standard_normal() - 0.05 * (k >= 100)
            one["parameters"].append(one["parameters"][0] | {"name": "k_beta_1", "own": own})
    alarms = last_said(feed(start("T1", SOON), rows))
    assert [alarm.about for alarm in alarms.values()] == ["k_beta_1"]


def test_one_bad_window_is_no_alarm():
    rows = stream(130, seed=9)
    rows[70]["parameters"][0]["own"] = 5.0
    rows[100]["parameters"][0]["own"] = -1e30
    rows[101]["parameters"][0]["own"] = math.nan
    assert not last_said(feed(start("T1", SOON), rows))


def test_a_change_of_settings_is_said_where_something_jumps_with_it():
    rows = stream(100, seed=10, at=70, jump={"k_x": -0.05})
    for one in rows[70:]:
        one["settings"] = "sha256:1"
    (alarm,) = last_said(feed(start("T1", SOON), rows)).values()
    assert "settings or version changed at the same time" in alarm.text

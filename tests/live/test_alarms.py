"""Jumps as alarms: cause, severity, end, and the sentence."""

from typing import Any

import pytest

from windsysid.live.watch.alarms import Circumstances, blind_alarm, came_back, jump_alarm, takes_back
from windsysid.live.watch.watched import Watched
from windsysid.monitoring.levels.locating import Jump

K_X = Watched("k_x", "N/m", "k", True, 1e6)
WHEN = tuple(1_767_225_600 * 10**9 + k * 600 * 10**9 for k in (0, 1, 4, 5))
SOUND = Circumstances((), noise_watched=True, lost_grade=False, lost_health=False, changed=False)


def jump(size: float, std: float = 0.002, *, before: float = 0.0, found: int = 104) -> Jump:
    return Jump(100, 100, 101, found, size, std, before)


def said(watched: Watched, size: float, *, returns: bool = False, **about: Any):
    return jump_alarm("T1", watched, jump(size), WHEN, SOUND._replace(**about), returns=returns)  # type: ignore[arg-type]


def test_the_sentence_says_what_how_much_when_and_what_to_do():
    alarm = said(K_X, -0.05)
    assert alarm.text == (
        "stiffness of the tower, x (k_x) fell by 4.88 % (-5.26 … -4.5 %) on 2026-01-01 00:00 … 2026-01-01 00:10, found"
        " on 2026-01-01 00:50 UTC: the sensors did not change; compare the records before and after (windsysid"
        " compare) and have the turbine inspected"
    )
    assert (alarm.key, alarm.opened, alarm.ended) == (f"T1:k_x:{WHEN[2]}", WHEN[3], None)
    assert (alarm.earliest, alarm.latest) == WHEN[:2]


@pytest.mark.parametrize(
    ("kind", "size", "severity"),
    [
        ("k", -0.05, "alarm"), ("k", -0.022, "warning"), ("k", 0.05, "warning"), ("f", -0.02, "alarm"),
        ("c", -0.5, "alarm"), ("c", -0.2, "warning"), ("noise", -3.0, "warning"),
    ],
)  # fmt: skip
def test_a_loss_that_is_sure_and_large_is_an_alarm(kind: str, size: float, severity: str):
    assert said(K_X._replace(kind=kind), size).severity == severity


@pytest.mark.parametrize(
    ("about", "why"),
    [
        ({"noisy": ("noise_a", "noise_b")}, "noise of the a (noise_a) and noise of the b (noise_b) changed with it"),
        ({"lost_grade": True}, "does not explain"),
        ({"lost_health": True}, "findings since"),
    ],
)
def test_what_changed_with_a_sensor_is_a_sensors_and_no_alarm(about: dict[str, Any], why: str):
    alarm = said(K_X, -0.1, **about)
    assert (alarm.kind, alarm.severity) == ("sensor", "warning")
    assert why in alarm.text
    assert "check sensor, cable and logger" in alarm.text


def test_a_noise_is_a_sensors_and_unwatched_noise_is_said():
    assert said(K_X._replace(kind="noise"), 1.0).kind == "sensor"
    assert "not watched" in said(K_X, -0.1, noise_watched=False).text


def test_a_return_is_a_notice_that_is_over():
    alarm = said(K_X, 0.1, returns=True)
    assert (alarm.severity, alarm.ended) == ("notice", alarm.opened)


@pytest.mark.parametrize(
    ("level", "std", "over"), [(-0.05, 0.001, False), (-0.03, 0.001, False), (-0.02, 0.001, True), (-0.02, 0.01, False)]
)
def test_an_alarm_is_over_where_the_level_is_surely_nearer_to_what_it_was(level: float, std: float, over: bool):
    assert came_back(jump(-0.05), level, std) is over
    assert came_back(jump(-0.05, before=1.0), 1.0 + level, std) is over


def test_a_jump_that_was_none_is_over():
    assert came_back(jump(0.001, 0.002), 0.5, 0.01)


def test_a_jump_takes_back_an_earlier_one_of_about_its_size():
    assert takes_back(jump(-0.05), jump(0.04, found=200))
    assert not takes_back(jump(-0.05), jump(0.02, found=200))
    assert not takes_back(jump(-0.05), jump(-0.05, found=200))
    assert not takes_back(jump(-0.05, found=300), jump(0.05, found=200))


def test_a_watch_that_sees_nothing_says_so():
    alarm = blind_alarm("T1", WHEN[0], WHEN[1], None, "no window received")
    assert (alarm.kind, alarm.severity, alarm.ended) == ("data", "notice", None)
    assert "since 2026-01-01 00:00 UTC: no window received" in alarm.text

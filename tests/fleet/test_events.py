"""What came and went is one event; ice is named by the weather of the day on which it came."""

from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
import pytest

from windsysid._types import Array
from windsysid.fleet.events import FleetEvent, events_of
from windsysid.monitoring.changes import DetectedJump, Watch, WatchedSeries
from windsysid.monitoring.series import DAY, RecordBlocks

DAYS = 120
BEGIN = datetime(2026, 1, 1, tzinfo=UTC)
TIME: Array = DAY * np.arange(DAYS, dtype=np.float64)
AIR = {"T01": (BEGIN.timestamp() + TIME, np.where(TIME < 20.0 * DAY, -6.0, 9.0).astype(np.float64))}
"""Frost for twenty days, then spring."""


def watch_of(*jumps: tuple[float, float], spreads: Sequence[float] = ()) -> Watch:
    """A turbine that has these jumps: day, percent; by how much each is known, 0.1 % unless it is said."""
    column = np.ones((DAYS, 1))
    log = np.zeros(DAYS)
    for day, size in jumps:
        log[day * DAY <= TIME] += 0.01 * size
    level: Array = np.exp(log)
    blocks = RecordBlocks(
        ("k",), TIME, column, column, (True,), (1.0,), np.empty((DAYS, 0)), (), {},
        tuple("x" * DAYS), begin=BEGIN,
    )  # fmt: skip
    series = WatchedSeries(
        "k", "N/m", level=level, low=level, high=level, adjusted=level, whitened=level, statistic=level, limit=1.0,
        drift=(0.0, 0.0, 0.0), slopes={}, wander=0.0, scatter=1.0, smallest=1.0,
    )  # fmt: skip
    spreads = spreads or [0.1] * len(jumps)
    changes = tuple(
        DetectedJump(
            "k", day * DAY, day * DAY, day * DAY, day * DAY, size, size - spread, size + spread, "the turbine",
            f"k {size:+g} %",
        )
        for (day, size), spread in zip(jumps, spreads, strict=True)
    )  # fmt: skip
    return Watch(blocks, (series,), changes, 0.1, 0, ())


def events(*jumps: tuple[float, float], spreads: Sequence[float] = ()) -> list[FleetEvent]:
    """Of one turbine that has these jumps."""
    return events_of({"T01": watch_of(*jumps, spreads=spreads)}, [], [], AIR)


def kinds_of_fleet(*jumps: float) -> list[str]:
    """Kinds of events where sisters jump by so many percent on one day, and as many more do not."""
    watches = {f"T{i:02d}": watch_of((50.0, size)) for i, size in enumerate(jumps)}
    watches |= {f"S{i:02d}": watch_of() for i in range(len(jumps))}
    return sorted(event.kind for event in events_of(watches, [], [], dict.fromkeys(watches, AIR["T01"])))


def test_what_three_sisters_and_half_of_all_have_on_one_day_is_the_sites():
    assert kinds_of_fleet(-4.0, -4.0, -4.0) == ["shared"]
    assert kinds_of_fleet(-4.0, -4.0) == ["turbine", "turbine"]


def test_jumps_of_sisters_in_two_directions_are_not_one():
    assert kinds_of_fleet(-4.0, -4.0, 4.0) == ["turbine"] * 3


def test_what_fell_in_the_frost_and_came_back_in_the_thaw_is_ice():
    (event,) = events((15.0, -4.0), (30.0, 4.1))
    assert event.kind == "ice"
    assert event.sentence.startswith("k fell by 3.9 % on 2026-01-16")
    assert "rose again on 2026-01-31" in event.sentence
    assert "at -6 °C when it fell" in event.sentence


def test_a_fall_of_doubtful_size_that_is_taken_back_for_sure_is_ice_and_no_turbine_that_rose():
    (event,) = events((15.0, -4.0), (30.0, 4.1), spreads=[5.0, 0.1])
    assert event.kind == "ice"
    assert event.sentence.startswith("k fell by 3.9 % on 2026-01-16")


def test_ice_that_grows_and_falls_off_in_steps_is_one_event():
    (event,) = events((10.0, -1.0), (11.0, -2.0), (12.0, -1.2), (25.0, 1.5), (28.0, 2.7))
    assert event.kind == "ice"
    assert "fell by 4.1 % on 2026-01-11 00:00+00:00 … 2026-01-13" in event.sentence
    assert "rose again on 2026-01-26 00:00+00:00 … 2026-01-29" in event.sentence


def test_what_falls_in_steps_is_told_once_with_the_size_that_the_blocks_have():
    (event,) = events((40.0, -1.5), (41.0, -1.5))
    assert event.sentence.startswith("k fell by 2.96 % in 2 steps on 2026-02-10 00:00+00:00 … 2026-02-11")


def test_an_alarm_whose_jump_may_be_none_is_no_event():
    assert events((40.0, -1.0), spreads=[1.5]) == []
    (event,) = events((40.0, -1.0), (50.0, -3.0), spreads=[1.5, 0.1])
    assert event.sentence == "k -3 %"


@pytest.mark.parametrize(
    "jumps",
    [
        [(40.0, -4.0), (55.0, 4.0)],  # in spring
        [(15.0, 4.0), (30.0, -4.0)],  # ice makes nothing stiffer
        [(15.0, -4.0), (30.0, 1.0)],  # came back by a quarter only
        [(15.0, -4.0), (90.0, 4.0)],  # months later
    ],
)
def test_what_is_not_like_ice_is_the_turbine(jumps: list[tuple[float, float]]):
    assert {event.kind for event in events(*jumps)} == {"turbine"}


def test_a_loss_after_the_ice_is_named_by_itself():
    kinds = {event.kind: event.sentence for event in events((10.0, -4.0), (20.0, 4.0), (45.0, -3.0))}
    assert set(kinds) == {"ice", "turbine"}
    assert kinds["turbine"] == "k -3 %"

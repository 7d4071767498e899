"""The demo plays what it says: one tower gets softer, one loses a sensor, one stays as it is."""

import asyncio
import itertools
import time

import numpy as np
import pytest

from windsysid.live.blocks.block import Block
from windsysid.live.configuration.settings import PageSettings
from windsysid.live.demo import DemoPlan, DemoTower, demo, story
from windsysid.live.engine import Delays, Engine, Followed
from windsysid.live.store import open_store
from windsysid.live.watch.watching import WatchOptions
from windsysid.live.windows.timeline import SECOND, TurbineWindows

NOW = 1_767_614_400 * SECOND
SHORT = DemoPlan(window=60.0, history=12, softer_after=6, fails_after=6)
"""Three pieces: two that are learned from, one as it was, and then what happens."""


def tower(number: int, plan: DemoPlan = SHORT) -> DemoTower:
    return demo(PageSettings(), plan, now=NOW)[1][number]


def of(number: int, pieces: int) -> list[Block]:
    return list(itertools.islice(tower(number).blocks(), pieces * 6))


def test_blocks_follow_each_other_without_a_gap_from_a_windows_begin():
    blocks = of(0, 2)
    assert TurbineWindows.of("T1", SHORT.window).start(blocks[0].start) == blocks[0].start
    for one, next_ in itertools.pairwise(blocks):
        assert next_.start - one.start == 60 * SECOND
        assert len(one.values) == 600
    assert blocks[0].start < NOW - 2 * 86400 * SECOND


def test_the_same_demo_is_played_every_time_and_no_two_towers_are_alike():
    first, again, other = of(0, 1), of(0, 1), of(1, 1)
    assert all(np.array_equal(a.values, b.values) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[0].values, other[0].values)


def test_a_sensor_of_t3_sticks_and_dies_when_its_time_has_come():
    blocks = of(2, 5)
    column = blocks[0].channels.index("tower_x_acceleration")
    values = [block.values[:, column] for block in blocks]
    assert all(np.ptp(samples) > 0.0 for samples in values[:18])
    assert np.ptp(values[18]) == 0.0
    assert all(np.isnan(samples).all() for samples in values[19:])
    assert all(np.isfinite(block.values[:, column + 1]).all() for block in blocks)


def test_the_story_has_the_times_of_the_records():
    _, towers = demo(PageSettings(), now=NOW)
    told = story(towers)
    assert "T2 loses 5 % of its stiffness on 02 Jan 18:08 UTC of the records, 60 s after learning." in told
    assert "A sensor of T3 fails on 02 Jan 19:03 UTC" in told


@pytest.mark.slow
def test_the_watch_sees_what_happens_and_nothing_else():
    plan = DemoPlan(speed=1e9)
    settings, towers = demo(PageSettings(), plan)
    store = open_store(":memory:")
    options = WatchOptions(plan.window, plan.history, settings.alarms_per_year)
    followed = [Followed(member, plan.window, options=options) for member in settings.turbines]
    engine = Engine(followed, store, delays=Delays(lateness=0.0))
    windows = plan.history + plan.fails_after + 6

    async def play() -> None:
        stop = asyncio.Event()
        playing = [asyncio.create_task(one.run(engine.push, stop)) for one in towers]
        until = time.monotonic() + 1200.0
        while min(len(store.results(one.turbine)) for one in towers) < windows:
            assert time.monotonic() < until
            await asyncio.sleep(0.5)
        stop.set()
        await asyncio.gather(*playing)

    try:
        asyncio.run(play())
        begins = {one.turbine: one.begin for one in towers}
        found = {(alarm.turbine, alarm.kind) for alarm in store.alarms()}
        assert found == {("T2", "structure"), ("T3", "sensor")}
        softer = begins["T2"] + round((plan.history + plan.softer_after) * plan.window * SECOND)
        first = min(alarm.opened for alarm in store.alarms(turbine="T2"))
        assert 0 <= first - softer <= 12 * plan.window * SECOND  # a minute of the reader's
    finally:
        engine.drain()
        store.close()

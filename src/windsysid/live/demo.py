"""Three simulated towers, faster than real time: one loses stiffness, one loses a sensor, one does not change.

Nothing of it is drawn beforehand: samples are simulated while they are played, and go the way that a logger's go.
"""

import asyncio
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np

from windsysid.fleet.members import Member
from windsysid.live.blocks.block import Block
from windsysid.live.configuration.settings import PageSettings, Settings
from windsysid.live.sources.cutting import blocks_of
from windsysid.live.sources.source import Commits, Push, SourceState, stopped_within
from windsysid.live.windows.timeline import SECOND, TurbineWindows
from windsysid.records.record import Record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["DemoPlan", "DemoTower", "demo", "story"]

RATE_HZ = 10.0
"""Of the loggers [Hz]: thirty times a tower's frequency."""

BLOCK_SECONDS = 60.0

WINDOWS_AT_ONCE = 6
"""Windows that are simulated at once, in one wind."""

LOG_WIND_STD = 0.2
"""Scatter of the wind from piece to piece, as the standard deviation of its logarithm."""

START_BEFORE_NOW_SECONDS = 3 * 86400.0
"""Time before now at which the demo begins, so that it does not overtake the clock."""


@dataclass(frozen=True)
class DemoPlan:
    """Settings of the demo.

    Attributes
    ----------
    speed
        Speed as a multiple of real time.
    window
        [s].
    history
        Windows that the watch learns from; they are played as fast as they are taken.
    softer_after, fails_after
        Windows after these, in whole pieces of `WINDOWS_AT_ONCE`, when T2 loses stiffness and when T3 loses a sensor.
    softer_by
        Relative loss of both stiffnesses.
    """

    speed: float = 120.0
    window: float = 600.0
    history: int = 24
    softer_after: int = 12
    fails_after: int = 18
    softer_by: float = 0.05


def demo(
    page: PageSettings, plan: DemoPlan = DemoPlan(), *, now: int | None = None
) -> tuple[Settings, list["DemoTower"]]:
    """Settings of a temporary service, and its input.

    Parameters
    ----------
    now
        The moment of the demo's begin [ns since 1970]; today by default.
    """
    members = tuple(Member(name, "tower") for name in ("T1", "T2", "T3"))
    begin = (time.time_ns() if now is None else now) - round(START_BEFORE_NOW_SECONDS * SECOND)
    settings = Settings(
        store=":memory:", turbines=members, page=page, window=plan.window, lateness=0.0, learn=plan.history,
        alarms_per_year=1.0,
    )  # fmt: skip
    return settings, [DemoTower(member.name, plan, begin, seed) for seed, member in enumerate(members)]


def story(towers: "Sequence[DemoTower]") -> str:
    """Events of the demo, in times of the records, which a busy machine does not change."""
    plan = towers[0].plan
    softer, fails = (
        datetime.fromtimestamp(tower.begin / SECOND + plan.window * (plan.history + after), UTC).strftime("%d %b %H:%M")
        for tower, after in zip(towers[1:], (plan.softer_after, plan.fails_after), strict=True)
    )
    pace = plan.window * plan.softer_after / plan.speed
    return " ".join((
        f"Demo: three simulated towers, {plan.speed:g} times faster than real time.",
        f"The watch learns from {plan.history * plan.window / 3600.0:g} h first, as fast as this machine can.",
        f"T2 loses {100.0 * plan.softer_by:g} % of its stiffness on {softer} UTC of the records, {pace:.0f} s after"
        " learning.",
        "The alarm follows when the newest estimate of T2 is an hour later.",
        f"A sensor of T3 fails on {fails} UTC. T1 does not change.",
        "A busy machine takes longer, as does the first run, which compiles models; times of the records stay.",
    ))  # fmt: skip


class DemoTower:
    """A tower that is simulated while it is played."""

    def __init__(self, turbine: str, plan: DemoPlan, begin: int, seed: int) -> None:
        self.turbine, self.plan, self.seed = turbine, plan, seed
        windows = TurbineWindows.of(turbine, plan.window)
        self.begin = windows.start(begin) + windows.length
        self.state = SourceState()

    def describe(self) -> str:
        """Name of the tower."""
        return f"simulated tower {self.turbine}"

    async def run(self, push: Push, stop: asyncio.Event) -> None:
        """Play the learning records at full speed, then the rest at the plan's speed.

        A demo that has caught up with the clock goes on at the clock's pace.
        """
        self.state = self.state._replace(state="running")
        blocks = self.blocks()
        live = self.begin + round(self.plan.history * self.plan.window * SECOND)
        began: float | None = None
        commits = Commits(self)
        while (block := await asyncio.to_thread(next, blocks)) and not stop.is_set():
            if block.start >= live:
                if began is None:
                    await commits.finish()  # the past is taken before the demo begins
                    began = time.monotonic()
                end = block.start + round(BLOCK_SECONDS * SECOND)
                fast = began + (end - live) / SECOND / self.plan.speed - time.monotonic()
                if await stopped_within(stop, max(fast, (end - time.time_ns()) / SECOND)):
                    return
            await commits.push(push, block)

    def blocks(self) -> Iterator[Block]:
        """All blocks, without end."""
        piece = 0
        while True:
            start = self.begin + round(piece * WINDOWS_AT_ONCE * self.plan.window * SECOND)
            yield from blocks_of(self._record(piece), self.turbine, start, seconds=BLOCK_SECONDS)
            piece += 1

    def _record(self, piece: int) -> Record:
        """Readings of the tower's sensors in a segment."""
        from windsysid.simulation.record import simulate_record

        after = (piece + 1) * WINDOWS_AT_ONCE - self.plan.history  # windows of the demo when the piece is over
        seed = 1000 * self.seed + piece
        tower = _in_wind(load_turbine("tower"), np.random.default_rng(seed))
        if self.turbine == "T2" and after > self.plan.softer_after:
            tower = _softer(tower, self.plan.softer_by)
        record = simulate_record(tower, duration=WINDOWS_AT_ONCE * self.plan.window, rate=RATE_HZ, seed=seed)
        if self.turbine == "T3" and after > self.plan.fails_after:
            first = after - WINDOWS_AT_ONCE <= self.plan.fails_after
            record = _failing(record, self.plan.window if first else 0.0)
        return record


def _in_wind(tower: Turbine, rng: np.random.Generator) -> Turbine:
    """The tower in another wind: loads scatter from piece to piece."""
    strength = float(np.exp(LOG_WIND_STD * rng.standard_normal()))
    return replace(tower, loads=tuple(replace(load, rms=strength * load.rms) for load in tower.loads))


def _softer(tower: Turbine, share: float) -> Turbine:
    springs = [known.name for known in tower.model.parameters if known.kind == "stiffness"]
    return tower.with_values({name: (1.0 - share) * tower.values[name] for name in springs})


def _failing(record: Record, stuck: float) -> Record:
    """A record whose first accelerometer sticks for a while [s] and is dead from then on."""
    values = np.array(record.values)
    column = record.channels.index("tower_x_acceleration")
    held = record.time < stuck
    values[held, column] = values[0, column]
    values[~held, column] = np.nan
    return replace(record, values=values)

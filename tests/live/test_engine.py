"""Nothing is lost, nothing counted twice, and what was closed stays as it is, whatever the stream does."""

import json
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import windsysid as ws
from tests.live.memory import MemoryStore
from tests.live.streaming import NOON, blocks_of, record
from windsysid.errors import StoreError, WindsysidError
from windsysid.fleet.members import Member
from windsysid.fleet.rows import Row, empty_row, row_of
from windsysid.fleet.work.guard import StoppedError
from windsysid.live import engine as module
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockRefused
from windsysid.live.engine import TURN_SECONDS, Delays, Engine, Followed
from windsysid.live.store.contents import Commit
from windsysid.live.store.store import ContentError
from windsysid.live.windows.estimate import Estimated, Here
from windsysid.live.windows.streams import StreamHealth
from windsysid.live.windows.timeline import SECOND, Gathered, TurbineWindows, gather
from windsysid.records.record import Record
from windsysid.results.identification import finite
from windsysid.turbine.file import load_turbine

WAIT = 120.0
"""Far longer than anything here takes [s]."""

START = TurbineWindows.of("T01", 60.0).start(NOON)


class Counting:
    """Takes a window at once: its row says how many samples it had; it may be told to wait."""

    compiling = False

    def __init__(self) -> None:
        self.free = threading.Event()
        self.free.set()
        self.stopped = threading.Event()

    def take(self, gathered: Gathered, source: str, member: Member, formulation: str, settings: str) -> Estimated:
        while not self.free.wait(0.01):
            if self.stopped.is_set():
                raise StoppedError
        found = gathered.record
        row = empty_row(source, 0, settings) | {"status": "ok", "start": found and found.start}
        return Estimated(row | {"samples": found and int(np.isfinite(found.values[:, 0]).sum())}, 0.0)

    def close(self) -> None:
        self.stopped.set()


class Clock:
    """The service's clock: it stands an hour after the stream begins until it is moved."""

    def __init__(self) -> None:
        self.now = NOON + 3600 * SECOND

    def __call__(self) -> int:
        return self.now


class Site:
    """An engine over a store in memory that outlives it."""

    def __init__(self) -> None:
        self.store, self.clock, self.estimator = MemoryStore(), Clock(), Counting()
        self.engine: Engine | None = None
        self.told: list[tuple[str, dict[str, Any]]] = []

    def start(self, names: Sequence[str] = ("T01",), window: float = 60.0, **options: Any) -> Engine:
        self.estimator = Counting()
        turbines = [Followed(Member(name, "tower"), window=window) for name in names]
        tell = lambda event, **told: self.told.append((event, told))  # noqa: E731
        self.engine = Engine(turbines, self.store, now=self.clock, on_event=tell, **options)
        return self.engine

    def end(self) -> None:
        if self.engine is not None:
            self.engine.drain(2.0)
            self.engine = None

    def counts(self) -> dict[str, int]:
        """What the turbine's status says after everything is done."""
        self.end()
        return dict(self.store.kept_statuses["T01"].counts)

    def samples(self) -> list[int]:
        return [result.row["samples"] for result in self.store.results("T01")]


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    here = Site()
    monkeypatch.setattr(module, "estimators", lambda _: [here.estimator])
    yield here
    here.estimator.free.set()
    here.end()


def stream(seconds: float, *, first: float = 0.0, size: int = 20) -> list[Block]:
    """Blocks of 20 Hz from the beginning of a window of T01; `first` seconds are left out."""
    given = blocks_of(record(round(seconds * 20)), 20.0, size, start=START)
    return [block for block in given if block.start >= START + first * SECOND]


def push(engine: Engine, blocks: Sequence[Block]) -> None:
    for future in [engine.push(block) for block in blocks]:
        future.result(WAIT)


def finish(engine: Engine) -> None:
    assert engine.finish(WAIT)


def test_windows_are_whole_and_in_order(site):
    engine = site.start()
    push(engine, stream(300.0, size=37))
    finish(engine)
    assert site.samples() == [1200] * 5
    assert [result.window for result in site.store.results("T01")] == [START + 60 * SECOND * k for k in range(5)]
    assert site.store.blocks == {}


def test_a_window_closes_when_the_stream_is_late_enough(site):
    engine = site.start(delays=Delays(lateness=10.0))
    push(engine, stream(69.0))
    assert not site.store.kept_results
    push(engine, stream(72.0, first=69.0))
    assert engine.wait_idle(WAIT)
    assert site.samples() == [1200]


def test_order_of_arrival_within_lateness_changes_nothing(site):
    engine = site.start(delays=Delays(lateness=30.0))
    blocks = stream(300.0)
    rng = np.random.default_rng(0)
    late = sorted(blocks, key=lambda block: block.sequence + rng.uniform(0.0, 25.0))
    push(engine, late)
    finish(engine)
    assert site.samples() == [1200] * 5
    assert "too late" not in site.counts()


def test_repeated_blocks_change_nothing(site):
    engine = site.start()
    blocks = stream(180.0)
    for block in blocks:
        push(engine, [block, block])
    push(engine, blocks[:10])
    finish(engine)
    assert site.samples() == [1200] * 3
    assert site.counts()["repeated"] == len(blocks) + 10


def test_blocks_of_closed_windows_are_counted_and_told(site):
    engine = site.start(delays=Delays(lateness=10.0))
    blocks = stream(180.0)
    push(engine, blocks[:20] + blocks[40:])
    assert engine.wait_idle(WAIT)
    push(engine, blocks[25:30])
    push(engine, [replace(blocks[0], sequence=10_000)])
    alarm = next(iter(site.store.kept_alarms.values()))
    assert alarm.kind == "data"
    assert "raise lateness" in alarm.text
    assert site.counts()["too late"] + site.counts()["repeated"] == 6
    assert site.samples()[0] == 800


def test_a_lone_stamp_far_ahead_closes_nothing(site):
    engine = site.start()
    blocks = stream(120.0)
    stray = replace(blocks[30], sequence=5000, start=blocks[30].start + 2000 * SECOND)
    push(engine, [*blocks[:30], stray, *blocks[30:]])
    finish(engine)
    assert site.samples()[:2] == [1200, 1200]


def test_a_stream_that_jumps_ahead_goes_on_there(site):
    engine = site.start()
    blocks = [replace(b, start=b.start + (0 if b.sequence < 60 else 2040 * SECOND)) for b in stream(180.0)]
    push(engine, blocks)
    finish(engine)
    assert site.samples() == [1200] * 3
    assert site.counts()["clock jumps"] == 1


def test_a_clock_set_back_leaves_results_as_they_are_and_is_told(site):
    engine = site.start(delays=Delays(lateness=10.0))
    blocks = stream(240.0)
    push(engine, blocks[:150])
    assert engine.wait_idle(WAIT)
    push(engine, [replace(block, start=block.start - 150 * SECOND) for block in blocks[150:160]])
    assert site.samples() == [1200, 1200]
    assert [alarm.kind for alarm in site.store.kept_alarms.values()] == ["data"]


def test_a_sender_that_counts_from_the_beginning_again_loses_nothing(site):
    engine = site.start()
    blocks = stream(120.0)
    push(engine, [replace(block, sequence=block.sequence % 40) for block in blocks])
    finish(engine)
    assert site.samples() == [1200, 1200]
    assert site.counts()["numbering restarted"] >= 1


def test_a_rate_that_changes_cuts_the_window_in_which_it_does(site):
    engine = site.start()
    fast = [block for block in stream(80.0) if block.start < START + 80 * SECOND]
    slow = blocks_of(record(1500, 10.0), 10.0, 10, start=START + 80 * SECOND)
    push(engine, [*fast, *(replace(block, sequence=80 + block.sequence) for block in slow)])
    finish(engine)
    assert site.samples()[:3] == [1200, 400, 600]  # 20 s at 20 Hz, 40 s at 10 Hz: the longer one
    assert site.counts()["samples cut by a clock jump"] == 400


def test_windows_of_another_length_after_a_restart_cut_the_one_that_is_open(site):
    blocks = stream(400.0)
    engine = site.start()
    push(engine, blocks[:90])
    site.end()
    engine = site.start(window=70.0)
    push(engine, blocks[80:])
    finish(engine)
    results = site.store.results("T01")
    assert [(r.window - START) // SECOND for r in results[:2]] == [0, 60]
    assert results[1].until == START + 90 * SECOND  # its last sample
    assert [r.row["samples"] for r in results[:2]] == [1200, 600]
    boundary = TurbineWindows.of("T01", 70.0)
    assert [r.window for r in results[2:]] == [boundary.start(r.window) for r in results[2:]]
    assert 0 <= results[2].window - results[1].until < 70 * SECOND  # what comes before is too late
    assert [r.row["samples"] for r in results[2:-1]] == [1400] * (len(results) - 3)
    late = (results[2].window - results[1].until) // SECOND
    assert site.counts()["too late"] in (late, late - 1)  # a block may reach over the boundary


def test_a_rotor_that_stops_and_starts_is_told_by_its_windows(site, monkeypatch):
    """The row is the real one: short windows are refused, and say how the rotor turned."""
    monkeypatch.setattr(module, "estimators", lambda _: [Here()])
    engine = Engine([Followed(Member("T01", "verne555"), window=60.0)], site.store, now=site.clock)
    site.engine = engine
    rated = load_turbine("verne555").rotor_speed
    assert rated is not None
    shares = np.repeat([1.0, 1.0, 0.0, 0.0, 1.0, 1.0], 60 * 20)
    shares[2 * 1200 - 600 : 2 * 1200] = np.linspace(1.0, 0.0, 600)
    noise = record(len(shares))
    values = np.column_stack([noise.values, rated * shares])
    turning = Record(noise.time, values, (*noise.channels, "rotor_speed"), (*noise.units, "rad/s"))
    push(engine, blocks_of(turning, 20.0, 20, start=START))
    finish(engine)
    states = [result.row["state"] for result in site.store.results("T01")]
    assert states == ["running", "transient", "parked", "parked", "running", "running"]
    site.end()
    assert site.store.kept_statuses["T01"].state == "running"
    assert not [alarm for alarm in site.store.alarms() if alarm.kind == "structure"]


def test_a_turbine_with_scada_of_files_is_refused(site):
    with pytest.raises(WindsysidError, match="T01: scada is for files"):
        Engine([Followed(Member("T01", "tower", scada="scada.csv"))], site.store)


def test_publishers_hear_up_to_where_nothing_is_missing(site):
    engine = site.start(delays=Delays(lateness=10.0))
    blocks = stream(200.0)
    push(engine, blocks[:30])
    push(engine, blocks[31:50])
    site.clock.now += 2 * SECOND
    push(engine, [blocks[50]])
    assert site.store.kept_statuses["T01"].sequences == {"": 29}
    site.clock.now += 2 * SECOND
    push(engine, [blocks[30]])
    assert site.store.kept_statuses["T01"].sequences == {"": 50}
    push(engine, blocks[55:80])  # the first window is closed: what was missing in it, 51 to 54, is given up
    site.clock.now += 2 * SECOND
    push(engine, [blocks[80]])
    assert site.store.kept_statuses["T01"].sequences == {"": 80}


def test_two_loggers_number_their_blocks_by_themselves(site):
    engine = site.start()
    tower = stream(120.0)
    blades = [
        replace(b, stream="blades", channels=("blade_1_strain",), units=("1",), values=b.values[:, :1]) for b in tower
    ]
    for a, b in zip(tower, blades, strict=True):
        push(engine, [a, b])
    finish(engine)
    assert site.samples() == [1200, 1200]
    assert site.counts().get("repeated", 0) == 0


def test_an_engine_killed_anywhere_leaves_the_results_of_one_that_was_not(site):
    blocks = stream(300.0)
    push(site.start(), blocks)
    finish(site.engine)
    site.end()
    undisturbed = site.store.results("T01")
    rng = np.random.default_rng(0)
    for _ in range(4):
        site.store = MemoryStore()
        at = 0
        while at < len(blocks):
            engine = site.start()
            if rng.random() < 0.5:
                site.estimator.free.clear()  # nothing is estimated in this life
            n = int(rng.integers(1, 120))
            push(engine, blocks[max(0, at - 10) : at + n])  # the sender sends again what it does not know of
            at += n
            site.end()  # leaves what is not done in the store, as a kill does
        finish(site.start())
        site.end()
        again = site.store.results("T01")
        assert [json.dumps(r.row) for r in again] == [json.dumps(r.row) for r in undisturbed]
        assert [(r.window, r.until, r.levels, r.checkpoint) for r in again] == [
            (r.window, r.until, r.levels, r.checkpoint) for r in undisturbed
        ]


def test_a_store_that_refuses_for_a_while_loses_nothing(site):
    engine = site.start()
    blocks = stream(180.0)
    failing = iter([False, True, False, True, True] * 1000)
    site.store.refuse = lambda commit: WindsysidError("disk full") if next(failing) else None
    for block in blocks:
        while True:
            future = engine.push(block)
            if future.exception(WAIT) is None:
                break
    site.store.refuse = lambda commit: None
    finish(engine)
    assert site.samples() == [1200] * 3


def test_a_block_that_a_closed_store_refuses_may_come_again(site):
    engine = site.start()
    blocks = stream(60.0)
    push(engine, blocks[:10])
    submit = site.store.submit

    def closed(commit: Commit) -> Any:
        raise StoreError("the store is closed")

    site.store.submit = closed
    with pytest.raises(StoreError, match="closed"):
        engine.push(blocks[10])
    site.store.submit = submit
    push(engine, blocks[10:])
    finish(engine)
    assert site.samples() == [1200]


def test_a_result_that_the_store_refuses_is_written_later(site):
    engine = site.start()
    refusals = [True, True]

    def refuse(commit: Commit) -> Exception | None:
        return WindsysidError("disk full") if commit.results and refusals and refusals.pop() else None

    site.store.refuse = refuse
    push(engine, stream(180.0))
    finish(engine)
    assert site.samples() == [1200] * 3
    assert site.counts()["windows"] == 3


def test_blocks_that_can_never_be_taken_are_refused_counted_and_told(site):
    engine = site.start()
    good = stream(10.0)[0]
    for bad, said in (
        (replace(good, turbine="T99"), "not followed"),
        (replace(good, rate=-1.0), "rate"),
        (replace(good, start=site.clock.now + 7200 * SECOND), "ahead of the service's clock"),
        (replace(good, values=np.zeros((4000, 2))), "no longer than a window"),
    ):
        with pytest.raises(BlockRefused, match=said):
            engine.push(bad)
    assert len(site.store.kept_alarms) == 1
    assert site.counts()["refused"] == 3


def test_an_error_of_placing_that_nobody_foresaw_refuses_that_block_alone(site, monkeypatch):
    engine = site.start()
    blocks = stream(60.0)
    take = StreamHealth.take

    def broken(health: Any, block: Block) -> Any:
        if block.sequence == 7:
            raise FloatingPointError("no number")
        return take(health, block)

    monkeypatch.setattr(StreamHealth, "take", broken)
    push(engine, blocks[:7])
    for _ in range(2):  # also when it comes again
        with pytest.raises(BlockRefused, match=r"^block cannot be placed \(FloatingPointError: no number\)$"):
            engine.push(blocks[7])
    push(engine, blocks[8:])
    finish(engine)
    assert site.samples() == [1180]
    assert "no number" in next(iter(site.store.kept_alarms.values())).text
    assert site.counts()["refused"] == 2


def test_a_block_that_the_database_can_never_hold_is_refused_and_forgotten(site):
    engine = site.start()
    blocks = stream(60.0)
    site.store.refuse = lambda commit: (
        ContentError("text cannot hold NUL") if any(block.sequence == 7 for _, block in commit.blocks) else None
    )
    push(engine, blocks[:7])
    assert isinstance(engine.push(blocks[7]).exception(WAIT), BlockRefused)
    push(engine, blocks[8:])
    assert engine.push(blocks[6]).exception(WAIT) is None
    finish(engine)
    assert site.samples() == [1180]
    assert site.counts()["refused"] == 1


def test_a_window_that_cannot_be_joined_has_a_row_that_says_so_and_holds_up_no_other(site, monkeypatch):
    def broken(blocks: Any, window: int, *more: Any) -> Any:
        if window == START:
            raise ZeroDivisionError("by what")
        return gather(blocks, window, *more)

    monkeypatch.setattr("windsysid.live.windows.closing.gather", broken)
    engine = site.start()
    push(engine, stream(120.0))
    finish(engine)
    first, second = site.store.results("T01")
    assert first.row["status"] == "failed"
    assert "cannot be joined (ZeroDivisionError: by what)" in first.row["why"]
    assert second.row["samples"] == 1200


def test_a_silent_turbine_is_told_and_its_windows_close_in_the_end(site):
    engine = site.start(delays=Delays(silence=100.0, patience=1000.0))
    push(engine, stream(40.0))
    site.clock.now += 200 * SECOND
    wait_for(lambda: site.store.kept_alarms)
    alarm = next(iter(site.store.kept_alarms.values()))
    assert "no block for 200 s" in alarm.text
    assert site.store.kept_statuses["T01"].state == "silent"
    assert not site.store.kept_results
    site.clock.now += 1000 * SECOND
    wait_for(lambda: site.store.kept_results)
    assert site.samples() == [800]
    site.clock.now += 1 * SECOND
    push(engine, [block for block in stream(130.0) if block.start >= START + 120 * SECOND])
    assert site.store.kept_alarms[alarm.key].ended is not None


def test_an_engine_that_is_behind_says_so_and_slows_its_senders_down(site):
    engine = site.start(delays=Delays(lateness=0.0))
    site.estimator.free.clear()
    push(engine, stream(250.0))
    futures = [engine.push(block) for block in stream(400.0, first=250.0)]
    assert engine.state().turbines["T01"].windows == 6
    assert not futures[-1].done()
    assert len(site.store.blocks) == 400  # on disk all the same
    site.clock.now += 200 * SECOND
    wait_for(lambda: any("behind" in alarm.text for alarm in site.store.kept_alarms.values()))
    site.estimator.free.set()
    finish(engine)
    assert all(future.done() for future in futures)
    assert len(site.samples()) == 7
    wait_for(lambda: all(alarm.ended for alarm in site.store.kept_alarms.values()))


def test_a_block_that_is_sent_again_is_not_acknowledged_before_the_others_of_its_turbine(site):
    engine = site.start()
    site.estimator.free.clear()
    sent = stream(900.0)
    futures = [engine.push(block) for block in sent]
    last = futures[-1]
    again = [engine.push(sent[k]) for k in (-1, -1, 0)]
    assert not last.done()
    assert not any(one.done() for one in again)  # a sender would go on, and fill what a broker keeps unacknowledged
    site.estimator.free.set()
    for future in (last, *again):
        future.result(WAIT)
    assert engine.push(sent[-1]).result(WAIT) is None


def test_ending_leaves_what_is_open_or_waits_in_the_store(site):
    engine = site.start(delays=Delays(lateness=0.0))
    push(engine, stream(100.0))
    assert engine.wait_idle(WAIT)
    site.estimator.free.clear()
    push(engine, stream(150.0, first=100.0))
    site.end()
    assert len(site.samples()) == 1
    assert {window for _, window, _, _ in site.store.blocks} == {START + 60 * SECOND, START + 120 * SECOND}
    engine = site.start(delays=Delays(lateness=0.0))
    push(engine, stream(180.0, first=150.0))
    finish(engine)
    assert site.samples() == [1200] * 3


def test_sensor_alarms_open_and_end_also_over_a_restart(site):
    engine = site.start()
    values = record(40 * 60 * 20).values.copy()
    values[12_000:24_000, 0] = values[12_000, 0]
    given = Record(np.arange(len(values)) / 20.0, values, *_names())
    blocks = blocks_of(given, 20.0, 100, start=START)
    push(engine, blocks[:200])
    (alarm,) = [alarm for alarm in site.store.kept_alarms.values() if alarm.kind == "sensor"]
    assert alarm.about == "tower_x_acceleration"
    assert site.store.kept_healths[("T01", "tower_x_acceleration")].state == "stuck"
    site.end()
    push(site.start(), blocks[200:])
    ended = site.store.kept_alarms[alarm.key]
    assert ended.ended is not None
    assert site.store.kept_healths[("T01", "tower_x_acceleration")].state == "good"


def _names() -> tuple[tuple[str, ...], tuple[str, ...]]:
    given = record(2)
    return given.channels, given.units


def test_the_row_of_a_window_is_the_one_of_the_same_samples_in_a_file():
    given = ws.simulate("tower", duration=700.0, rate=20.0, seed=3)
    store = MemoryStore()
    start = TurbineWindows.of("T01", 600.0).start(NOON)
    engine = Engine([Followed(Member("T01", "tower"))], store, workers=0)
    push(engine, blocks_of(given, 20.0, (7, 300, 41), start=start))
    finish(engine)
    engine.drain(2.0)
    row: Row = dict(store.results("T01")[0].row)
    same = Record(
        given.time[:12_000], given.values[:12_000], given.channels, given.units, name=row["record"], start=row["start"]
    )
    begun = empty_row(row["source"], row["source_bytes"], row["settings"])
    expected = finite(row_of(begun, same, load_turbine("tower"), None, "spectral"))
    assert row["status"] == "ok"
    assert row == expected
    assert json.dumps(row) == json.dumps(expected)


def wait_for(condition: Any) -> None:
    """Until it is so; the clock of the engine looks once a second."""
    tick = threading.Event()
    for _ in range(round(WAIT / 0.05)):
        if condition():
            return
        tick.wait(0.05)
    raise AssertionError("it never came")


def test_threads_take_short_turns_while_an_engine_runs(monkeypatch: pytest.MonkeyPatch):
    turns: list[float] = []
    monkeypatch.setattr("sys.setswitchinterval", turns.append)
    for own, expected in ((0.005, TURN_SECONDS), (1e-4, 1e-4)):
        monkeypatch.setattr("sys.getswitchinterval", lambda own=own: own)
        Engine([], MemoryStore(), workers=0).drain()
        assert turns[-2:] == [expected, own]

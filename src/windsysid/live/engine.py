"""The engine: blocks in, rows and levels and alarms into the store, nothing lost.

A block is checked, placed in its windows, tested for faults of sensors, and handed to the store; the
sender is acknowledged when it is on disk. A window that the stream has left behind is closed, read back from the
store, and estimated in a worker process. Rows of one turbine are taken in by its watch in the order of windows, and
row, levels, alarms and the watch's checkpoint are one transaction that also takes the window's blocks away.

If the engine is killed, only work is lost: blocks wait in the store until their window has its
result, and a result is a function of the window's blocks and of the checkpoint before it.
"""

import contextlib
import queue
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from dataclasses import replace
from typing import NamedTuple

from windsysid.errors import StoreError
from windsysid.fleet.work.guard import StoppedError
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockLimits, BlockRefused, check, refusing
from windsysid.live.blocks.gate import Gate
from windsysid.live.engine_state import EngineState, TurbineState
from windsysid.live.follower import Followed, Follower, Placed, WindowTask
from windsysid.live.store.contents import Alarm, Commit, Severity, StoredBlock
from windsysid.live.store.store import ContentError, Store
from windsysid.live.watch.open_alarms import TOO_LATE
from windsysid.live.watch.watching import resume, start
from windsysid.live.windows.closing import conclude, estimate, unpack
from windsysid.live.windows.estimate import Estimated, Estimator, estimators
from windsysid.live.windows.streams import StreamHealth, Verdict
from windsysid.live.windows.timeline import SECOND, sample_time
from windsysid.records.moments import moment_text
from windsysid.turbine.file import load_turbine

__all__ = ["Delays", "Engine", "EngineState", "Followed", "TurbineState"]

MAX_LEAD_NS = 300 * SECOND
"""Largest lead of a block over the service's clock [ns]."""

MAX_PENDING_BLOCKS, MAX_PENDING_BYTES = 4096, 128_000_000
"""Greatest number of blocks, and of their bytes, on their way to the store: beyond, `Engine.push` waits."""

MAX_WAITING_WINDOWS = 4
"""Windows of a turbine that may wait for a worker: beyond, blocks are stored and not acknowledged."""

MAX_BEHIND_WINDOWS = 2
"""Windows' lengths by which a turbine's oldest waiting window may be behind before that is an alarm."""

TICK_SECONDS = 1.0
"""Interval of the search for silent turbines [s]."""

TURN_SECONDS = 5e-4
"""Time that a thread keeps Python's lock while others wait for it [s], a tenth of Python's own: a thread that reads 600
rows of a store releases the lock at every row (``python -m validation.live_engine --turbines 100 --speed 10``)."""


class Delays(NamedTuple):
    """Waiting times of an engine [s].

    Attributes
    ----------
    lateness
        Stream time that a window is kept open after its end, for blocks out of order.
    silence
        Time without a block after which a turbine is called silent.
    patience
        Time without a block after which a silent turbine's windows are closed; what comes for them is too late.
    """

    lateness: float = 30.0
    silence: float = 300.0
    patience: float = 3600.0


class Engine:
    """Estimation of many turbines from blocks of samples, with all results in a store.

    Parameters
    ----------
    turbines
        That are followed; blocks of others are refused.
    store
        Where everything goes, and from where the engine goes on.
    workers
        Processes that estimate, one for each processor by default; 0 estimates in a thread of this process.
    delays
        How long it waits for blocks.
    now
        The service's clock [ns since 1970].
    on_event
        Function that receives events for logs: the name of the event, and its data by keyword.
    limits
        Of a block.

    Raises
    ------
    ConfigurationError
        If a turbine's files are wrong.
    StoreError
        If the store refuses.
    """

    def __init__(
        self, turbines: Sequence[Followed], store: Store, *, workers: int | None = None, delays: Delays = Delays(),
        now: Callable[[], int] = time.time_ns, on_event: Callable[..., None] | None = None,
        limits: BlockLimits = BlockLimits(),
    ) -> None:  # fmt: skip
        self._store, self._now, self._limits = store, now, limits
        self._lateness, self._silence, self._patience = (round(x * SECOND) for x in delays)
        self._tell = on_event or (lambda *_, **__: None)
        self._tasks: queue.Queue[WindowTask | None] = queue.Queue()
        self._stopping = threading.Event()
        self._gate = Gate(MAX_PENDING_BLOCKS, MAX_PENDING_BYTES)
        self._idle = threading.Condition()
        self._sums, self._summing = Counter[str](), threading.Lock()
        self._rate = 0.0
        self._followers = {followed.member.name: self._follower(followed) for followed in turbines}
        self._restore()
        self._turn = sys.getswitchinterval()
        sys.setswitchinterval(min(self._turn, TURN_SECONDS))
        self._estimators = estimators(workers)
        self._threads = [
            threading.Thread(target=self._work, args=(estimator,), name=f"window-{i}", daemon=True)
            for i, estimator in enumerate(self._estimators)
        ]
        self._threads.append(threading.Thread(target=self._watch_clock, name="clock", daemon=True))
        for thread in self._threads:
            thread.start()

    # blocks

    def push(self, block: Block) -> Future[None]:
        """Take a block; the future ends when it is on disk, or was before.

        It waits while `MAX_PENDING_BLOCKS` blocks are on their way to the store. Where a turbine's windows wait in a
        row, its blocks are stored and the futures end when the row is shorter: senders that wait for them are slowed
        down.

        Raises
        ------
        BlockRefused
            If it can never be taken: not a block, of a turbine that is not followed, or of the future.
        """
        begun = time.thread_time()
        follower = self._followers.get(block.turbine)
        if follower is None:
            raise BlockRefused(f"turbine {block.turbine[:60]!r} is not followed: list it in the settings")
        if self._stopping.is_set():
            raise RuntimeError("the engine was ended: no more blocks")
        try:
            block = self._checked(block)
            size = block.values.nbytes
            self._gate.enter(size)
            try:
                with follower.lock, refusing("placed"):
                    done = self._take(follower, block)
            except BaseException:
                self._gate.leave(size)
                raise
        except BlockRefused as error:
            self._count_refusal(follower, error)
            raise
        done.add_done_callback(lambda _: self._gate.leave(size))
        self._count(blocks=1, samples=len(block.values), blocks_ns=round((time.thread_time() - begun) * SECOND))
        return done

    def _checked(self, block: Block) -> Block:
        block = check(block, self._limits)
        if block.start > self._now() + MAX_LEAD_NS:
            raise BlockRefused(
                f"block starts at {moment_text(block.start, 0)}, ahead of the service's clock: set the logger's"
                " clock, or the service's"
            )
        return block

    def _count_refusal(self, follower: Follower, error: BlockRefused) -> None:
        """Count a refusal and open an alarm for it; an error of the store does not replace the refusal."""
        with follower.lock, contextlib.suppress(StoreError):
            follower.counts["refused"] += 1
            self._data_alarm(follower, "refused", "notice", f"a block was refused: {error}")

    def _take(self, follower: Follower, block: Block) -> "Future[None]":
        """Place a block, look at its sensors, and hand it to the store."""
        placed = follower.place(block, self._silence)
        now = self._now()
        follower.received = now
        follower.counts["blocks"] += 1
        follower.counts["samples"] += len(block.values)
        if placed.arrival != "new":
            follower.counts[placed.arrival] += 1
            if placed.arrival == "too late":
                follower.counts["late samples"] += len(block.values)
                self._data_alarm(follower, "too late", "notice", TOO_LATE)
            return self._on_disk(follower, follower.stored())
        if placed.sequence != block.sequence:
            block = replace(block, sequence=placed.sequence)
        try:
            stored = self._store.submit(self._commit_of(follower, block, placed, now))
        except BaseException:
            follower.forget(block, placed)
            raise
        follower.last = stored
        done = self._on_disk(follower, stored, lambda: follower.forget(block, placed))
        for window in follower.over(self._lateness):
            self._close(follower, window)
        return done

    def _commit_of(self, follower: Follower, block: Block, placed: Placed, now: int) -> Commit:
        """Build the commit of a new block: the block, the turbine's status, and the health of its sensors."""
        health = follower.streams[block.stream].health
        if health is None:
            health = follower.streams[block.stream].health = StreamHealth()
        verdicts = health.take(block)
        alarms = [alarm for verdict in verdicts for alarm in self._sensor_alarms(follower, verdict)]
        if follower.state in ("waiting", "silent"):
            follower.state = "running"
        alarms += follower.alarms.ended("silent", now)
        statuses = []
        if now - follower.told >= SECOND or verdicts:
            follower.told = now
            statuses.append(follower.status())
        return Commit(
            blocks=[StoredBlock(window, block) for window in placed.windows], statuses=statuses,
            healths=[verdict.health(follower.name) for verdict in verdicts], alarms=alarms,
        )  # fmt: skip

    def _on_disk(
        self, follower: Follower, stored: Future[None], forget: Callable[[], None] | None = None
    ) -> Future[None]:
        """Make a future that is done once `stored` is and few windows of the turbine wait: it confirms the block.

        `forget` undoes the placement of the block of `stored`; without it, `stored` is of another block.
        """
        done: Future[None] = Future()

        def committed(future: Future[None]) -> None:
            error = future.exception()
            if forget is not None and isinstance(error, ContentError):
                error = BlockRefused(str(error))
                self._count_refusal(follower, error)
            with follower.lock:
                if error is not None and forget is not None:
                    forget()
                withhold = error is None and len(follower.order) > MAX_WAITING_WINDOWS and not self._stopping.is_set()
                if withhold:
                    follower.withheld.append(done)
            if error is not None:
                done.set_exception(error)
            elif not withhold:
                done.set_result(None)

        stored.add_done_callback(committed)
        return done

    # windows

    def _close(self, follower: Follower, window: int, until: int | None = None) -> None:
        self._tasks.put(follower.close(window, self._now(), until))

    def _work(self, estimator: Estimator) -> None:
        """Take closed windows until the engine ends."""
        while not self._stopping.is_set():
            task = self._tasks.get()
            if task is None:
                return
            follower = self._followers[task.turbine]
            try:
                found = self._estimate(follower, task, estimator)
                with follower.lock:
                    follower.estimates[task.window] = found
                self._take_rows(follower)
            except StoppedError:
                return
            except Exception as error:  # the store failed: the window waits there
                if self._stopping.is_set():  # its worker was ended under it
                    return
                self._tell("window failed", turbine=task.turbine, window=task.window, why=str(error))
                if self._stopping.wait(1.0):
                    return
                self._tasks.put(task)

    def _estimate(self, follower: Follower, task: WindowTask, estimator: Estimator) -> Estimated:
        if follower.last is not None:
            follower.last.exception()  # all blocks of the window are on disk
        begun = time.thread_time()
        blocks = [block for _, block in self._store.waiting(task.turbine, task.window)]
        reading = time.thread_time() - begun
        read = estimate(follower, task, blocks, estimator)
        with follower.lock:
            follower.counts.update({name: count for name, count in read.counts.items() if count})
        seconds = read.found.seconds
        self._count(windows_ns=round((reading + read.joining) * SECOND), estimates_ns=round(seconds * SECOND))
        return read.found

    def _take_rows(self, follower: Follower) -> None:
        """Let the watch take in the rows that are next in line."""
        with follower.taking:
            while True:
                with follower.lock:
                    task = follower.order[0] if follower.order else None
                    found = None if task is None else follower.estimates.get(task.window)
                if task is None or found is None:
                    return
                self._take_row(follower, task, found)
                row = found.row
                self._tell("window", turbine=task.turbine, window=task.window, status=row["status"], why=row["why"])
                with self._idle:
                    self._idle.notify_all()

    def _take_row(self, follower: Follower, task: WindowTask, found: Estimated) -> None:
        """Pass a row to the watch, and wait until the store has the results."""
        begun, row = time.thread_time(), found.row
        concluded = follower.concluded
        if concluded is None:  # else the store refused it before
            concluded = follower.concluded = conclude(follower, task, found, self._now())
            follower.counts["windows"] += 1
        with follower.lock:
            if follower.state != "silent":
                follower.state = "running" if row["state"] in (None, "unknown") else row["state"]
            follower.rotor_speed = row["rotor_speed"]
            drifting = [a for verdict in concluded.verdicts for a in self._sensor_alarms(follower, verdict)]
            healths = [verdict.health(follower.name) for verdict in concluded.verdicts]
            alarms = [*concluded.alarms, *drifting]
            stored = self._store.submit(
                Commit((), [follower.status()], healths, results=[concluded.result], alarms=alarms)
            )
        self._count(windows=1, watch_ns=round((time.thread_time() - begun) * SECOND))
        stored.result()
        with follower.lock:
            follower.means, follower.concluded = concluded.means, None
            del follower.estimates[task.window]
            follower.order.popleft()
            free: list[Future[None]] = []
            if len(follower.order) <= MAX_WAITING_WINDOWS:
                free, follower.withheld = follower.withheld, []
        for future in free:
            future.set_result(None)

    # alarms

    def _sensor_alarms(self, follower: Follower, verdict: Verdict) -> list[Alarm]:
        self._tell("sensor", turbine=follower.name, channel=verdict.channel, state=verdict.state, text=verdict.text)
        return follower.alarms.sensor(verdict)

    def _data_alarm(self, follower: Follower, cause: str, severity: Severity, text: str) -> None:
        opened = follower.alarms.data(cause, severity, text, self._now())
        if opened:
            self._tell("data", turbine=follower.name, cause=cause, text=text)
            self._store.submit(Commit(statuses=[follower.status()], alarms=opened))

    def acknowledge(self, key: str, by: str, remark: str = "") -> Alarm:
        """Acknowledge an alarm; KeyError if there is none of this key."""
        return self._store.acknowledge(key, by=by, remark=remark, at=self._now())

    # the clock

    def _watch_clock(self) -> None:
        """Look for turbines that fell silent or behind."""
        last, before = 0, time.monotonic()
        while not self._stopping.wait(TICK_SECONDS):
            since = time.monotonic()
            self._rate = (self._sums["blocks"] - last) / max(since - before, 1e-9)
            last, before = self._sums["blocks"], since
            for follower in self._followers.values():
                try:
                    with follower.lock:
                        self._look_at(follower)
                except Exception as error:  # the store failed: the next look may be luckier
                    self._tell("store failed", turbine=follower.name, why=str(error))

    def _look_at(self, follower: Follower) -> None:
        now = self._now()
        self._look_for_silence(follower, now)
        behind = now - follower.order[0].closed if follower.order else 0
        if behind > MAX_BEHIND_WINDOWS * follower.windows.length:
            text = (
                f"estimates are {behind / SECOND:.0f} s behind, {len(follower.order)} windows wait, no data are lost:"
                " give the service more processors, or fewer turbines"
            )
            self._data_alarm(follower, "behind", "warning", text)
        ended = follower.alarms.quiet(now)
        if behind <= follower.windows.length:
            ended += follower.alarms.ended("behind", now)
        if ended:
            self._store.submit(Commit(statuses=[follower.status()], alarms=ended))

    def _look_for_silence(self, follower: Follower, now: int) -> None:
        """Say that a turbine fell silent; after a while, close its windows."""
        quiet = now - follower.received
        if follower.received and quiet > self._silence and follower.state != "silent":
            follower.state = "silent"
            text = f"no block for {quiet / SECOND:.0f} s: check logger, network and broker"
            self._data_alarm(follower, "silent", "warning", text)
        if quiet > self._patience:
            for window in sorted(follower.open):
                if window + follower.windows.length < now:
                    self._close(follower, window)

    # waiting and ending

    def wait_idle(self, timeout: float | None = None) -> bool:
        """Wait until no closed window waits; False where it took longer than `timeout` [s]."""
        with self._idle:
            return self._idle.wait_for(lambda: not any(f.order for f in self._followers.values()), timeout)

    def finish(self, timeout: float | None = None) -> bool:
        """Close all windows as they are and wait for them, at the end of a replay. Later blocks are too late."""
        for follower in self._followers.values():
            with follower.lock:
                for window in sorted(follower.open):
                    self._close(follower, window)
        return self.wait_idle(timeout)

    def drain(self, timeout: float = 4.0) -> bool:
        """End within `timeout` [s], and say whether no closed window waits; open windows stay open in the store."""
        until = time.monotonic() + timeout
        idle = self.wait_idle(max(0.0, timeout - 1.5))
        self._stopping.set()
        self._gate.open()
        for _ in self._estimators:
            self._tasks.put(None)
        for estimator in self._estimators:
            estimator.close()
        statuses = []
        for follower in self._followers.values():
            with follower.lock:
                statuses.append(follower.status())
                free, follower.withheld = follower.withheld, []
            for future in free:
                future.set_result(None)
        last = self._store.submit(Commit(statuses=statuses))
        for thread in self._threads:
            thread.join(max(0.0, until - time.monotonic()))
        with contextlib.suppress(TimeoutError):
            last.exception(max(0.1, until - time.monotonic()))
        sys.setswitchinterval(self._turn)
        return idle

    def state(self) -> EngineState:
        """State of all turbines and of the engine."""
        now, turbines = self._now(), {}
        for name, follower in self._followers.items():
            with follower.lock:
                behind = now - follower.order[0].closed if follower.order else 0
                turbines[name] = TurbineState(len(follower.order), max(0.0, behind / SECOND))
        with self._summing:
            sums = Counter(self._sums)
        seconds = {part: sums[f"{part}_ns"] / SECOND for part in ("blocks", "windows", "estimates", "watch")}
        counts = (sums["blocks"], sums["samples"], sums["windows"])
        compiling = any(estimator.compiling for estimator in self._estimators)
        return EngineState(turbines, *counts, self._rate, self._gate.inside, seconds, len(self._estimators), compiling)

    def _count(self, **numbers: int) -> None:
        with self._summing:
            for name, number in numbers.items():
                self._sums[name] += number

    # the start

    def _follower(self, followed: Followed) -> Follower:
        member = followed.member
        settings = member.settings(followed.formulation)
        options = followed.options._replace(window=followed.window)
        known = self._store.checkpoint(member.name)
        if known is None:
            follower = Follower(followed, settings, start(member.name, options))
        else:
            until, checkpoint = known
            means, watch = unpack(checkpoint)
            follower = Follower(followed, settings, resume(watch, member.name, options))
            follower.means, follower.closed_until = means, until
        tables = {"turbine": load_turbine(member.turbine).name, "formulation": followed.formulation}
        self._store.configure(member.name, settings, tables | {"window": followed.window, **options._asdict()})
        return follower

    def _restore(self) -> None:
        """Go on where the store stands: statuses, open alarms, and windows that have no result."""
        for status in self._store.statuses():
            if status.turbine in self._followers:
                self._followers[status.turbine].restore(status)
        for alarm in self._store.alarms(open_only=True, most=100_000):
            if alarm.turbine in self._followers and alarm.ended is None:
                self._followers[alarm.turbine].alarms.restore(alarm)
        for follower in self._followers.values():
            self._go_on(follower)

    def _go_on(self, follower: Follower) -> None:
        """Take up the windows that the store has blocks of."""
        ends: dict[int, int] = {}
        for window, block in self._store.waiting(follower.name):
            follower.note(block, block.sequence, {window: follower.grown(block, window)})
            follower.see(block)
            ends[window] = max(ends.get(window, 0), sample_time(block, len(block.values)))
        # a window of other boundaries was cut by settings that were changed since: it ends with its last sample
        foreign = {window: end for window, end in ends.items() if follower.windows.start(window) != window}
        with follower.lock:
            for window in sorted({*foreign, *follower.over(self._lateness)}):
                self._close(follower, window, foreign.get(window))

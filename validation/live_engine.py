"""How fast is the live engine, and do its bands cover the true values?

``python -m validation.live_engine --turbines 50 --rate 100 --hours 1``: so many towers through the engine and SQLite as
fast as they go, blocks of 1 s as Arrow. Printed are processor time a sample by part, how many turbines that is in real
time on two cores, memory and the store's size at several instants, and the time from push to commit.

``python -m validation.live_engine --turbines 1000 --hours 0.233 --speed 1``: blocks are pushed when they are due, as on
a site. All turbines begin at one moment, while their windows end at moments of their own: windows that the beginning
cut are distinguished from whole ones, which come after eleven minutes. Printed besides are how long a window that is
over waits for its estimate, and whether the pace was kept.

``python -m validation.live_engine --turbines 50 --hours 24 --block 10``: a day, as fast as it goes: is memory flat?

``python -m validation.live_engine --coverage 40``: so many towers whose coefficients are drawn from their priors, each
followed for some hours: how often ±2σ of the windows' estimates and of the levels covers the true value.
"""

import argparse
import itertools
import os
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np

from windsysid.fleet.members import Member
from windsysid.identification.identify import identify
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import decode, encode_arrow
from windsysid.live.engine import Engine, Followed
from windsysid.live.store.opening import open_store
from windsysid.live.store.store import Store
from windsysid.live.watch.watching import WatchOptions
from windsysid.live.windows.timeline import SECOND, TurbineWindows
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine

__all__ = ["coverage", "main", "speed"]

BEGIN = 1_767_225_600 * SECOND
"""2026-01-01T00:00:00Z."""

RECORDS = 3
"""Simulated records that all turbines share."""

WINDOW = 600.0
LOOKS = 10
"""Instants at which memory is read."""


def speed(turbines: int, rate: float, hours: float, *, workers: int, pace: float, block: float, folder: Path) -> None:
    """Push streams through engine and store, and print what it cost."""
    records = [_record(seed, rate) for seed in range(RECORDS)]
    identify(records[0], "tower", formulation="spectral")  # compiled before the clock runs
    payloads = [_payloads(record, rate, block, single=seed % 2 == 0) for seed, record in enumerate(records)]
    store = open_store(str(folder / "live.db"))
    names = [f"T{i:04d}" for i in range(turbines)]
    told: dict[tuple[str, int], int] = {}

    def tell(what: str, *, turbine: str = "", window: int = 0, **_: object) -> None:
        if what == "window":
            told[turbine, window] = time.time_ns()

    engine = Engine([Followed(Member(name, "tower")) for name in names], store, workers=workers, on_event=tell)
    starts = {name: BEGIN if pace else TurbineWindows.of(name, WINDOW).start(BEGIN) for name in names}
    pushes, decoding, waits, lag = round(3600.0 * hours / block), 0.0, _Waits(), 0.0
    begun, process, own = time.monotonic(), time.process_time(), time.thread_time()
    print(
        f"{turbines} turbines, {rate:g} Hz, 2 channels, blocks of {block:g} s, {hours:g} h of each; {workers} workers;"
        f" {f'{pace:g} times real time' if pace else 'as fast as it goes'}",
        flush=True,
    )
    print(
        f"{'hours':>6} {'blocks/s':>9} {'waiting':>8} {'engine MB':>10} {'workers MB':>11} {'store MB':>9}", flush=True
    )
    looks = {round(i * pushes / LOOKS) for i in range(LOOKS + 1)}
    for k in range(pushes):
        for i, name in enumerate(names):
            if pace:
                ahead = begun + (k + i / turbines) * block / pace - time.monotonic()
                lag = max(lag, -ahead)
                if ahead > 0.002:
                    time.sleep(ahead)
            at = time.thread_time()
            payload = payloads[i % RECORDS][k % len(payloads[0])]
            one = decode(payload, turbine=name)
            decoding += time.thread_time() - at
            one = replace(one, sequence=k, start=starts[name] + round(k * block * SECOND))
            waits.start(engine.push(one))
        if k in looks:
            _look(engine, k * block, time.monotonic() - begun, folder)
    passed = time.monotonic() - begun
    behind = [turbine.behind for turbine in engine.state().turbines.values()]
    engine.finish()
    whole = time.monotonic() - begun
    _look(engine, pushes * block, whole, folder)
    own = time.thread_time() - own
    process = time.process_time() - process
    state = engine.state()
    engine.drain()
    parts = {"decode": decoding, "check, place, health": state.seconds["blocks"]}
    parts["store, and all else here"] = process - own - state.seconds["windows"] - state.seconds["watch"]
    parts["window to record"], parts["watch"] = state.seconds["windows"], state.seconds["watch"]
    parts["estimate"] = state.seconds["estimates"]
    total = sum(parts.values())
    print(f"\nprocessor time of {state.samples} samples, {state.windows} windows")
    for name, spent in (*parts.items(), ("all", total)):
        print(f"{name:<26} {1e6 * spent / state.samples:8.2f} µs a sample {100 * spent / total:6.1f} %")
    each = total / state.samples * rate
    print(f"\n{state.blocks / whole:.0f} blocks/s in {whole:.0f} s")
    print(f"a turbine at {rate:g} Hz takes {100 * each:.3f} % of a processor: {2.0 / each:.0f} in real time on two")
    print(f"push to commit: median {waits.at(50):.0f} ms, 95 % {waits.at(95):.0f} ms, 99 % {waits.at(99):.0f} ms")
    if pace:
        _told_of_pace(store, names, told, pushes * block, passed, lag, max(behind))
    statuses = Counter(row["status"] for name in names for row in (result.row for result in store.results(name)))
    print(f"windows: {', '.join(f'{number} {status}' for status, number in statuses.items())}")
    store.close()


def _told_of_pace(
    store: Store, names: Sequence[str], told: dict[tuple[str, int], int], seconds: float, passed: float, lag: float,
    behind: float,
) -> None:  # fmt: skip
    """Result of a run at the pace of a site: whether it kept up, and how long a window that is over waits."""
    results = [result for name in names for result in store.results(name)]
    end = BEGIN + round(seconds * SECOND)
    over = [result for result in results if result.until <= end - 30 * SECOND]  # the others the end of the run closed
    for what, some in (
        ("cut by the run's begin", [result for result in over if result.window < BEGIN]),
        ("whole", [result for result in over if result.window >= BEGIN]),
    ):
        took = [(told[result.turbine, result.window] - result.closed) / SECOND for result in some]
        if took:
            median, high, most = np.percentile(took, (50, 95, 100))
            print(
                f"{len(took)} windows {what}, from the block that closed them to the estimate on disk: median"
                f" {median:.2f} s, 95 % {high:.2f} s, longest {most:.2f} s"
            )
    print(
        f"{seconds:.0f} s of stream were pushed in {passed:.0f} s; the farthest behind its pace {lag:.2f} s; at the end"
        f" the oldest window had waited {behind:.1f} s"
    )


def _record(seed: int, rate: float) -> Record:
    """Readings of the accelerometers of a tower in a window."""
    record = simulate_record("tower", duration=WINDOW, rate=rate, seed=seed)
    return record.select(name for name in record.channels if name.endswith("acceleration"))


def _payloads(record: Record, rate: float, seconds: float, *, single: bool) -> list[bytes]:
    """A record as blocks of so many seconds, in single precision or double."""
    values = record.values.astype(np.float32) if single else record.values
    n = round(rate * seconds)
    return [
        encode_arrow(Block("", 0, 0, rate, record.channels, record.units, values[low : low + n]))
        for low in range(0, record.samples, n)
    ]


class _Waits:
    """Delay of blocks on their way to the store: of all of them, in classes of 1 ms."""

    def __init__(self) -> None:
        self.counts, self.lock = Counter[int](), threading.Lock()

    def start(self, future: "Future[None]") -> None:
        begun = time.perf_counter()

        def done(_: "Future[None]") -> None:
            with self.lock:
                self.counts[int(1e3 * (time.perf_counter() - begun))] += 1

        future.add_done_callback(done)

    def at(self, percent: float) -> float:
        """A percentile [ms]."""
        total, passed = sum(self.counts.values()), 0
        for wait in sorted(self.counts):
            passed += self.counts[wait]
            if passed >= percent / 100.0 * total:
                return wait + 1.0
        return float("nan")


def _look(engine: Engine, seconds: float, passed: float, folder: Path) -> None:
    state = engine.state()
    waiting = sum(turbine.windows for turbine in state.turbines.values())
    here, workers = _memory(os.getpid()), sum(_memory(child) for child in _children())
    stored = sum(file.stat().st_size for file in folder.glob("live.db*")) / 1e6
    print(
        f"{seconds / 3600:6.2f} {state.blocks / max(passed, 1e-9):9.0f} {waiting:8d} {here:10.0f} {workers:11.0f}"
        f" {stored:9.0f}",
        flush=True,
    )


def _children() -> list[int]:
    found = []
    for task in Path("/proc/self/task").iterdir():
        found += [int(child) for child in (task / "children").read_text().split()]
    return found


def _memory(process: int) -> float:
    """Resident [MB]."""
    try:
        pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
    except OSError:
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def coverage(towers: int, windows: int, first: int, *, workers: int, rate: float = 20.0) -> None:
    """Follow towers of drawn truth, and print how often bands hold it."""
    nominal = load_turbine("tower")
    store = open_store(":memory:")
    names = [f"T{i:04d}" for i in range(towers)]
    options = WatchOptions(window=WINDOW, learn=12)
    engine = Engine([Followed(Member(name, "tower"), options=options) for name in names], store, workers=workers)
    truths = {}
    for i, name in enumerate(names):
        rng = np.random.default_rng([first, i])
        spread = {"k": 0.15, "c": 0.3}
        drawn = {
            q: nominal.values[q] * float(np.exp(spread[q[0]] * rng.standard_normal()))
            for q in ("k_side_side", "k_fore_aft", "c_side_side", "c_fore_aft")
        }
        truths[name] = drawn
        record = simulate_record(nominal.with_values(drawn), duration=WINDOW * windows, rate=rate, seed=first + i)
        record = record.select(channel for channel in record.channels if channel.endswith("acceleration"))
        for block in _blocks(record, name, rate):
            engine.push(block)
        engine.wait_idle()
    engine.finish()
    engine.drain()
    inside: dict[tuple[str, str], list[float]] = {}
    for name in names:
        results = store.results(name)
        for result in results:
            for level in result.levels:
                truth = truths[name].get(level.name)
                if truth is not None:
                    _judge(inside, ("window", level.name), truth, level.estimate, level.low, level.high)
        for level in results[-1].levels:
            if level.name in truths[name]:
                truth = truths[name][level.name]
                _judge(inside, ("last level", level.name), truth, level.level, level.level_low, level.level_high)
    print(f"{towers} towers, {windows} windows of {WINDOW:g} s at {rate:g} Hz, seeds from {first}")
    print(f"{'':<12}{'':<16}{'bands':>7} {'hold the truth':>15} {'mean error in σ':>16} {'rms':>5}")
    for (kind, series), z in sorted(inside.items(), reverse=True):
        held = float(np.mean(np.abs(z) <= 2.0))
        told = f"{100 * held:13.1f} % {np.mean(z):16.2f} {np.sqrt(np.mean(np.square(z))):5.2f}"
        print(f"{kind:<12}{series:<16}{len(z):7d} {told}")
    for kind in ("window", "last level"):
        z = list(itertools.chain.from_iterable(z for key, z in inside.items() if key[0] == kind))
        held = float(np.mean(np.abs(z) <= 2.0)) if z else float("nan")
        error = float(np.sqrt(held * (1.0 - held) / max(1, len(z))))
        print(f"{kind:<12}{'all':<16}{len(z):7d} {100 * held:13.1f} % (±{100 * error:.1f} %)")
    refused = Counter(r.row["why"] for name in names for r in store.results(name) if r.row["status"] != "ok")
    for why, number in refused.items():
        print(f"{number} windows without an estimate: {why}")
    alarms = [alarm for alarm in store.alarms(most=100_000) if alarm.kind != "data"]
    print(f"false alarms: {len(alarms)}")
    store.close()


def _judge(
    inside: dict[tuple[str, str], list[float]],
    key: tuple[str, str],
    truth: float,
    middle: float | None,
    low: float | None,
    high: float | None,
) -> None:
    """The error in standard deviations, by the half of the band in which the truth lies."""
    if middle is not None and low is not None and high is not None and low < middle < high:
        half = high - middle if truth > middle else middle - low
        inside.setdefault(key, []).append(2.0 * (truth - middle) / half)


def _blocks(record: Record, name: str, rate: float) -> Iterator[Block]:
    n, start = round(60.0 * rate), TurbineWindows.of(name, WINDOW).start(BEGIN)
    for i, low in enumerate(range(0, record.samples, n)):
        values = record.values[low : low + n]
        yield Block(name, i, start + i * 60 * SECOND, rate, record.channels, record.units, values)


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turbines", type=int, default=50)
    parser.add_argument("--rate", type=float, default=100.0, help="[Hz]")
    parser.add_argument("--hours", type=float, default=1.0, help="of stream time")
    parser.add_argument("--speed", type=float, default=0.0, help="times real time; 0 is as fast as it goes")
    parser.add_argument("--block", type=float, default=1.0, help="length of a block [s]; 600 must be a multiple")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--coverage", type=int, default=0, metavar="TOWERS")
    parser.add_argument("--windows", type=int, default=24, help="of each tower's coverage")
    parser.add_argument("--first", type=int, default=17_000, help="seed of the first tower")
    given = parser.parse_args(arguments)
    if given.coverage:
        coverage(given.coverage, given.windows, given.first, workers=given.workers)
        return
    with tempfile.TemporaryDirectory() as folder:
        speed(
            given.turbines, given.rate, given.hours, workers=given.workers, pace=given.speed, block=given.block,
            folder=Path(folder),
        )  # fmt: skip


if __name__ == "__main__":
    main()

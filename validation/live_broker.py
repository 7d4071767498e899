"""Does anything get lost between a logger and the store, and how long does it take?

``python -m validation.live_broker --kills 200``: broker, publisher and service are killed (signal 9) at random
instants, one after the other, while blocks of three turbines are on their way; afterwards every block must be in the
store, once, bit for bit.

``python -m validation.live_broker --malformed 10000``: nonsense between good blocks: the service must live on, in the
same memory, with every good block.

``python -m validation.live_broker --turbines 100 300 --seconds 60``: simulated towers at 100 Hz in blocks of 1 s, in
real time through publisher, mosquitto, engine and SQLite: how long it takes from the last sample of a block until it is
committed, and where the service's time goes. Windows of 10 minutes end all the time from the first half minute on, at
first with what came since the beginning: after 11 minutes (``--seconds 840``) they are whole, and the time from the
message that closed a window to its estimate on disk is measured for these alone.

The disk is not tried here: after a power cut it is SQLite and its file system that keep their word.
"""

import argparse
import asyncio
import contextlib
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np

from windsysid.fleet.members import Member
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import encode_arrow, encode_json
from windsysid.live.configuration.source_settings import Broker
from windsysid.live.engine import Engine, Followed
from windsysid.live.sources.broker import Marks, properties_of
from windsysid.live.sources.connection import Connection
from windsysid.live.sources.mqtt import MqttSource
from windsysid.live.sources.publisher import Publisher
from windsysid.live.store.opening import open_store
from windsysid.live.windows.timeline import SECOND, TurbineWindows
from windsysid.simulation.record import simulate_record

__all__ = ["main"]

LONG = 7200.0
"""A window [s] that no run here fills: its blocks stay in the store, where they are counted."""

CHANNELS, UNITS = ("tower_x_acceleration", "tower_z_acceleration"), ("m/s^2", "m/s^2")
TURBINES = ("T01", "T02", "T03")
PLACE = 10**18
"""Stands for the number and the start of a block in prepared payloads: it has as many digits."""

LOAD_SECONDS = 0.005
"""Interval at which blocks that are due are sent [s]."""

PACE = 0.02
"""Between two rounds of blocks while parts are killed [s]."""

SETTLED = 0.7
"""Share of the kills before which the service is waited for: it starts longer than it lives otherwise."""


def block_of(number: int, turbine: str) -> Block:
    """Block `number` of a turbine: always the same."""
    start = TurbineWindows.of(turbine, LONG).start(1_767_614_400 * SECOND) + number * SECOND
    values = np.random.default_rng([number, TURBINES.index(turbine)]).standard_normal((20, 2)).astype(np.float32)
    return Block(turbine, number, start, 20.0, CHANNELS, UNITS, values)


# the parts, each a process of its own


def serve(port: int, home: Path, turbines: list[str], window: float, report: Path | None) -> None:
    """A service: MQTT, engine, SQLite; ends in order on SIGTERM."""
    store = open_store(str(home / "store.sqlite"))
    told: dict[str, int] = {}

    def tell(what: str, *, turbine: str = "", window: int = 0, **_: object) -> None:
        if what == "window":
            told[f"{turbine} {window}"] = time.time_ns()

    engine = Engine([Followed(Member(name, "tower"), window) for name in turbines], store, workers=None, on_event=tell)
    source = MqttSource(Broker(f"mqtt://127.0.0.1:{port}"), turbines)
    timing = _Timing(engine) if report is not None else None

    async def run() -> None:
        stop = asyncio.Event()

        def end() -> None:
            if report is not None and timing is not None:  # while the threads still are
                report.write_text(json.dumps(timing.told() | {"refused": source.state.refused}))
            stop.set()

        asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, end)
        running = asyncio.ensure_future(source.run(timing.push if timing else engine.push, stop))
        while not running.done():
            done, _ = await asyncio.wait([running], timeout=0.1)
            if source.state.state == "running":
                (home / "ready").touch()
            if done:
                running.result()

    asyncio.run(run())
    engine.drain(4.0)
    if report is not None:
        results = [(one, told.get(f"{name} {one.window}")) for name in turbines for one in store.results(name)]
        estimates = [
            (one.window / SECOND, one.until / SECOND, (at - one.closed) / SECOND, one.row["status"])
            for one, at in results
            if at is not None
        ]
        report.write_text(json.dumps(json.loads(report.read_text()) | {"estimates": estimates}))
    store.close()


class _Timing:
    """Stands before an engine and looks at the clock."""

    def __init__(self, engine: Engine) -> None:
        self.engine, self.stages, self._lock = engine, list[tuple[float, float, float]](), threading.Lock()
        self.began = self.cpu = 0.0
        self.threads: Counter[str] = Counter()

    def push(self, block: Block) -> Future[None]:
        """Push, and note when what was over: reached us, taken, committed [s after the block's last sample]."""
        if not self.began:
            self.began, self.cpu, self.threads = time.monotonic(), time.process_time(), thread_seconds()
        end = block.start / SECOND + len(block.values) / block.rate
        came = time.time() - end
        future = self.engine.push(block)
        taken = time.time() - end

        def committed(_: Future[None]) -> None:
            with self._lock:
                self.stages.append((came, taken, time.time() - end))

        future.add_done_callback(committed)
        return future

    def told(self) -> dict[str, Any]:
        """Times of every block, and processor time from the first one on, by thread."""
        threads = thread_seconds()
        threads.subtract(self.threads)
        state = self.engine.state()
        return {
            "stages": self.stages, "threads": threads, "cpu": time.process_time() - self.cpu,
            "wall": time.monotonic() - self.began, "engine": state.seconds, "windows": state.windows,
        }  # fmt: skip


def thread_seconds() -> Counter[str]:
    """Processor time of each thread of this process [s]."""
    threads: Counter[str] = Counter()
    for thread in threading.enumerate():
        with contextlib.suppress(OSError):
            fields = Path(f"/proc/self/task/{thread.native_id}/stat").read_text().rpartition(")")[2].split()
            threads[thread.name] += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")  # type: ignore[assignment]
    return threads


def publish(port: int, home: Path) -> None:
    """A publisher that goes on from its buffer, until a file says that it is enough."""
    with Publisher(Broker(f"mqtt://127.0.0.1:{port}"), buffer=home / "buffer.sqlite", patience=2.0) as publisher:
        number = max(publisher.ring.flows().values(), default=-1) + 1
        publisher.send(*(block_of(number - 1, turbine) for turbine in TURBINES if number))  # killed between them
        while not (home / "enough").exists():
            publisher.send(*(block_of(number, turbine) for turbine in TURBINES))
            number += 1
            time.sleep(PACE)
        publisher.wait()
        (home / "sent").write_text(json.dumps({"number": number, "resent": publisher.resent}))


async def load(port: int, home: Path, turbines: list[str], seconds: float) -> None:
    """Loggers of many turbines in real time: 100 Hz, blocks of 1 s that end when they are sent, with QoS 1.

    Payloads are encoded before, since a logger has a processor of its own; what is due is written together.
    """
    prepared = []
    for seed in range(2):
        record = simulate_record("tower", duration=600.0, rate=100.0, seed=seed)
        values = record.values[:, [record.channels.index(name) for name in CHANNELS]].astype(np.float32)
        prepared += [
            encode_arrow(Block("", PLACE, PLACE, 100.0, CHANNELS, UNITS, values[low : low + 100]))
            for low in range(0, len(values) - 99, 100)
        ]
    connection = await Connection.open(Broker(f"mqtt://127.0.0.1:{port}"))
    connection.subscribe(["windsysid/+/committed"])
    committed: dict[str, int] = {}
    hearing = asyncio.ensure_future(_hear(connection, committed))
    began = time.time_ns() + SECOND
    cpu, sent, count, number = time.process_time(), 0, len(turbines), 0
    while sent < round(seconds) * count:
        await asyncio.sleep(LOAD_SECONDS)
        while sent < round(seconds) * count:
            second, i = divmod(sent, count)
            number = began + second * SECOND + i * SECOND // count  # of the block: its start; it ends a second later
            if number + SECOND > time.time_ns():
                break
            payload = prepared[(second + i % 2 * 600) % len(prepared)].replace(b"%d" % PLACE, b"%d" % number)
            marks = {"sequence": str(number), "stream": ""} | ({"after": str(number - SECOND)} if second else {})
            connection.publish(f"windsysid/{turbines[i]}/blocks", payload, marks.items())
            sent += 1
        connection.send()
    cpu = time.process_time() - cpu
    end = time.monotonic() + 60.0
    while min(committed.values(), default=0) <= number - SECOND and time.monotonic() < end and not hearing.done():
        await asyncio.sleep(0.1)
        connection.send()
    (home / "load.json").write_text(json.dumps(cpu))
    hearing.cancel()
    await connection.close()


async def _hear(connection: Connection, committed: dict[str, int]) -> None:
    """Note up to which number the blocks of each turbine are committed."""
    while True:
        for message in await connection.messages():
            committed[message.topic] = int(message.payload)


class Parts:
    """Broker, service and publisher as processes of ours."""

    def __init__(self, home: Path) -> None:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.port = probe.getsockname()[1]
        self.home = home
        (home / "mosquitto.conf").write_text(
            f"listener {self.port} 127.0.0.1\nallow_anonymous true\npersistence true\npersistence_location {home}/\n"
            "autosave_interval 1\nuser root\n"
        )
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        self.commands: dict[str, list[str]] = {"broker": ["mosquitto", "-c", str(home / "mosquitto.conf")]}

    def part(self, name: str, *words: str) -> None:
        """Start command of a part."""
        self.commands[name] = [sys.executable, "-m", "validation.live_broker", "--part", name, *words]

    def start(self, name: str) -> None:
        """Start a part, or start it again."""
        log = (self.home / f"{name}.log").open("ab")
        self.running[name] = subprocess.Popen(self.commands[name], stdout=log, stderr=log)
        if name == "broker":
            until(self._listens, "the broker listens")

    def _listens(self) -> bool:
        try:
            socket.create_connection(("127.0.0.1", self.port), 1.0).close()
        except OSError:
            return False
        return True

    def kill(self, name: str) -> None:
        """As when its machine loses power, but for the disk's own cache."""
        self.running[name].kill()
        self.running[name].wait()

    def end(self, name: str) -> int:
        """Ask a part to end in order; its exit code."""
        self.running[name].terminate()
        return self.running[name].wait(60.0)

    def close(self) -> None:
        """End what still runs."""
        for process in self.running.values():
            process.kill()
            process.wait()


def until(condition: Callable[[], bool], what: str, seconds: float = 300.0) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"waited in vain until {what}")
        time.sleep(0.02)


# what is tried


def kills(count: int, home: Path, seed: int) -> str:
    """Kill one part after the other; what is in the store afterwards."""
    rng, parts, killed = random.Random(seed), Parts(home), Counter[str]()
    parts.part("serve", str(parts.port), str(home), *TURBINES)
    parts.part("publish", str(parts.port), str(home))
    try:
        for name in ("broker", "serve", "publish"):
            parts.start(name)
        until((home / "ready").exists, "the service is ready")
        for _ in range(count):
            name = rng.choice(("broker", "serve", "publish"))
            if rng.random() < SETTLED:
                until((home / "ready").exists, "the service is ready")
            time.sleep(rng.uniform(0.0, 1.0))
            parts.kill(name)
            if name == "serve":
                (home / "ready").unlink(missing_ok=True)
            killed[name] += 1
            time.sleep(rng.uniform(0.0, 0.5))
            parts.start(name)
        (home / "enough").touch()
        until((home / "sent").exists, "everything is committed", 600.0)
        code = parts.end("serve")
    finally:
        parts.close()
    sent = json.loads((home / "sent").read_text())
    return (
        f"{count} kills ({', '.join(f'{name} {n}' for name, n in sorted(killed.items()))}); the service ended with"
        f" {code}\n{compared(home, sent['number'])}"
    )


def compared(home: Path, number: int) -> str:
    """Content of the store compared with the sent blocks."""
    store = open_store(str(home / "store.sqlite"), read_only=True)
    lost = twice = wrong = 0
    for turbine in TURBINES:
        found = Counter[int]()
        for _, block in store.waiting(turbine):
            found[block.sequence] += 1
            wrong += encode_arrow(block) != encode_arrow(block_of(block.sequence, turbine))
        lost += sum(k not in found for k in range(number))
        twice += sum(n - 1 for n in found.values())
    store.close()
    return f"{number * len(TURBINES)} blocks sent: lost {lost}, twice {twice}, not bit for bit {wrong}"


def malformed(count: int, home: Path, seed: int) -> str:
    """Send nonsense between good blocks; what the service makes of it."""
    rng, parts = random.Random(seed), Parts(home)
    parts.part("serve", "--report", str(home / "report.json"), str(parts.port), str(home), *TURBINES)
    try:
        parts.start("broker")
        parts.start("serve")
        until((home / "ready").exists, "the service is ready")
        broker, pid = Broker(f"mqtt://127.0.0.1:{parts.port}"), parts.running["serve"].pid
        good, memory = asyncio.run(_mislead(broker, count, rng, pid))
        alive = parts.running["serve"].poll() is None
        code = parts.end("serve")
    finally:
        parts.close()
    refused = json.loads((home / "report.json").read_text())["refused"]
    store = open_store(str(home / "store.sqlite"), read_only=True)
    found = [block.sequence for _, block in store.waiting("T01")]
    store.close()
    log = (home / "serve.log").read_text()
    return (
        f"{count} malformed messages, {refused} refused; the service {'lived on' if alive else 'died'} and ended with"
        f" {code}, {log.count('Traceback')} tracebacks\ngood blocks between them: {good} sent, {len(set(found))} in the"
        f" store, {len(found) - len(set(found))} twice\nmemory of the service after each fifth [MB]: "
        + ", ".join(f"{each:.0f}" for each in memory)
    )


async def _mislead(broker: Broker, count: int, rng: random.Random, pid: int) -> tuple[int, list[float]]:
    """Send nonsense between good blocks; the number of these, and the service's memory after each fifth [MB]."""
    connection = await Connection.open(broker)
    connection.subscribe(["windsysid/T01/committed"])
    committed: dict[str, int] = {}
    hearing = asyncio.ensure_future(_hear(connection, committed))
    good, memory = 0, []
    for k in range(count):
        connection.publish("windsysid/T02/blocks", *nonsense(rng))
        if k % 20 == 0:
            marks = properties_of(Marks(good, after=good - 1 if good else None))
            connection.publish("windsysid/T01/blocks", encode_json(block_of(good, "T01")), marks)
            good += 1
        connection.send()
        while k % 100 == 99 and connection.unconfirmed:
            await asyncio.sleep(0.001)
        if k % (count // 5) == count // 5 - 1:
            async with asyncio.timeout(300.0):
                while max(committed.values(), default=0) != good - 1:
                    await asyncio.sleep(0.02)
            memory.append(_memory(pid))
    hearing.cancel()
    await connection.close()
    return good, memory


def nonsense(rng: random.Random) -> tuple[bytes, list[tuple[str, str]]]:
    """A message that is no block, in one of many ways."""
    arrow = bytearray(encode_arrow(block_of(rng.randrange(100), "T02")))
    text = json.loads(encode_json(block_of(rng.randrange(100), "T02")))
    odd: Any = rng.choice(
        [None, "", [], {}, -1, 1e400, "x" * 50, True, 2**80, float("nan"), "\x00\n\x1b[31m", {"a": {}}]
    )
    kind = rng.randrange(6)
    if kind == 0:
        payload = rng.randbytes(rng.randrange(2000))
    elif kind == 1:
        payload = bytes(arrow[: rng.randrange(len(arrow) - 20)])
    elif kind == 2:  # a broken head: the samples' own bits are nobody's to judge
        for _ in range(rng.randrange(1, 20)):
            arrow[rng.randrange(4, 400)] = rng.randrange(256)
        arrow[0] = 0
        payload = bytes(arrow)
    elif kind == 3:
        text[rng.choice(["start", "rate", "channels", "stream", "sequence"])] = odd
        text["extra"] = odd
        payload = json.dumps(text).encode()
    elif kind == 4:
        text["channels"][CHANNELS[0]] = odd
        payload = json.dumps(text).encode()
    else:
        payload = b"{" + b'"a":[' * rng.randrange(1, 50_000)
    marks = properties_of(Marks(rng.randrange(2**62), rng.choice(["", "a", "../x", "#", "%s", "ä" * 100]), None))
    return payload, marks if rng.random() < 0.5 else []


def _memory(pid: int) -> float:
    """Of a process [MB]."""
    line = next(x for x in Path(f"/proc/{pid}/status").read_text().splitlines() if x.startswith("VmRSS"))
    return int(line.split()[1]) / 1024.0


def timed(turbines: int, seconds: float, home: Path) -> str:
    """Turbines in real time; how long their blocks take, and where the service's time goes."""
    parts, names = Parts(home), [f"T{i:04d}" for i in range(turbines)]
    parts.part("serve", "--report", str(home / "report.json"), "--window", "600", str(parts.port), str(home), *names)
    parts.part("load", "--seconds", str(seconds), str(parts.port), str(home), *names)
    try:
        parts.start("broker")
        parts.start("serve")
        until((home / "ready").exists, "the service is ready")
        parts.start("load")
        parts.running["load"].wait(seconds + 300.0)
        publisher = json.loads((home / "load.json").read_text())
        broker = Path(f"/proc/{parts.running['broker'].pid}/stat").read_text().rpartition(")")[2].split()
        parts.end("serve")
    finally:
        parts.close()
    told = json.loads((home / "report.json").read_text())
    stages = np.array(told["stages"])
    stages = stages[len(stages) // 3 :]  # the first ones wait for what is loaded once
    came, taken, committed = stages.T
    late = committed[round(0.8 * len(committed)) :]
    parts_of = {
        "publisher, broker, decoding": came, "engine": taken - came, "store": committed - taken, "all": committed,
    }  # fmt: skip
    lines = [
        f"{turbines} turbines, {seconds:g} s: {len(told['stages'])} of {round(seconds) * turbines} blocks committed,"
        f" {told['windows']} windows estimated; {np.mean(committed < 1.0):.1%} within 1 s, last fifth's median"
        f" {1e3 * np.median(late):.0f} ms"
    ]
    begin = min((window for window, *_ in told["estimates"]), default=0.0) + 600.0
    for what, some in (
        ("cut by the run's begin", [one for one in told["estimates"] if one[0] < begin]),
        ("whole", [one for one in told["estimates"] if one[0] >= begin]),
    ):
        if some:
            low, high, most = np.percentile([took for _, _, took, _ in some], (50, 95, 100))
            ok = sum(status == "ok" for *_, status in some)
            lines.append(
                f"  {len(some)} windows {what} ({ok} ok), from the message that closed them to the estimate on disk:"
                f" median {low:.2f} s   95th percentile {high:.2f} s   longest {most:.2f} s"
            )
    for name, span in parts_of.items():
        low, high, most = 1e3 * np.percentile(span, (50, 95, 100))
        lines.append(f"  {name:28} median {low:6.0f} ms   95th percentile {high:6.0f} ms   longest {most:6.0f} ms")
    busy = {name: took for name, took in told["threads"].items() if took > 0.02 * told["cpu"]}
    each = 1e6 / max(len(told["stages"]), 1)
    listed = ", ".join(f"{name} {each * took:.0f}" for name, took in sorted(busy.items(), key=lambda x: -x[1]))
    own = (int(broker[11]) + int(broker[12])) / os.sysconf("SC_CLK_TCK")
    lines.append(
        f"  µs of processor time a block: service {each * told['cpu']:.0f} ({listed}), broker {each * own:.0f},"
        f" publisher {each * publisher:.0f}; together {(told['cpu'] + own + publisher) / told['wall']:.0%} of one"
        " processor"
    )
    return "\n".join(lines)


def main() -> None:
    """Try the requested part."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=0)
    parser.add_argument("--malformed", type=int, default=0)
    parser.add_argument("--turbines", type=int, nargs="*", default=[])
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--part", help=argparse.SUPPRESS)
    parser.add_argument("--report", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--window", type=float, default=LONG, help=argparse.SUPPRESS)
    parser.add_argument("words", nargs="*", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    words = asked.words
    if asked.part == "serve":
        serve(int(words[0]), Path(words[1]), words[2:], asked.window, asked.report)
    elif asked.part == "publish":
        publish(int(words[0]), Path(words[1]))
    elif asked.part == "load":
        asyncio.run(load(int(words[0]), Path(words[1]), words[2:], asked.seconds))
    else:
        if shutil.which("mosquitto") is None:
            parser.error("mosquitto is not installed: apt-get install mosquitto")
        tried: list[Callable[[Path], str]] = []
        if asked.kills:
            tried.append(lambda home: kills(asked.kills, home, asked.seed))
        if asked.malformed:
            tried.append(lambda home: malformed(asked.malformed, home, asked.seed))
        tried += [lambda home, n=n: timed(n, asked.seconds, home) for n in asked.turbines]  # type: ignore[misc]
        for run in tried:
            with tempfile.TemporaryDirectory() as home:
                print(run(Path(home)), flush=True)


if __name__ == "__main__":
    main()

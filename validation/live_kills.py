"""Is anything lost when a live service is killed? ``python -m validation.live_kills --runs 200 --store sqlite``.

Three loggers' streams go through the engine into a store. Their sender never sends again what was acknowledged. The
service (`--kill service`) or the database's server (`--kill server`) is killed with signal 9 at random instants and
started again, or its disk is full for a while (`--kill disk`), until the streams are through. Then the store must hold
what it holds without a kill: every row, level and checkpoint with the same bits, every block in one row and once.
After each kill of the service every acknowledged block must be in the store or in a result.

POSIX only: the service is a fork. That a crash of the whole machine loses nothing is not tried here: for that, a
commit is flushed to the disk before it is acknowledged.
"""

import argparse
import contextlib
import hashlib
import os
import random
import resource
import signal
import sys
import tempfile
import threading
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from validation.postgres_server import Server, postgres
from windsysid.errors import StoreError
from windsysid.fleet.members import Member
from windsysid.live.blocks.block import Block
from windsysid.live.engine import Delays, Engine, Followed
from windsysid.live.store import open_store
from windsysid.live.store.encoding import pack_levels, pack_row
from windsysid.live.store.sql_store import SqlStore
from windsysid.live.windows.timeline import SECOND, TurbineWindows
from windsysid.simulation.record import simulate_record

__all__ = ["Tally", "main"]

START = 1_767_225_600 * SECOND  # 2026-01-01
WINDOWS = {"T01": 120.0, "T02": 60.0, "T03": 60.0}
"""Length of each turbine's windows [s]: those of 120 s are identified, those of 60 s are refused, which is quick."""

PARTS = {"T01": (("", (0, 1, 2, 3, 4), 2.0),), "T02": (("nacelle", (0, 1, 2), 3.0), ("tower", (3, 4), 5.0)),
         "T03": (("", (0, 1, 2, 3, 4), 7.0),)}  # fmt: skip
"""Of each turbine the streams: name, columns of its record, and length of a block [s]."""

UNDERWAY = 12
"""Blocks that the sender sends before an answer to the first."""


AGAIN = 75
"""Exit status of a service whose database does not answer: whoever runs it starts it again."""


@dataclass
class Tally:
    """Outcome of a run."""

    kills: int = 0
    streams: int = 0
    blocks: int = 0
    windows: int = 0
    repeated: int = 0
    restarts: int = 0
    lost: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        return (
            f"{self.kills} kills in {self.streams} runs of the streams, {self.blocks} blocks acknowledged, of"
            f" {self.repeated} the kill came between commit and acknowledgement; {self.restarts} times the service"
            f" found no server at its start, and was started again; {self.windows} windows compared;"
            f" lost, twice or different: {len(self.lost)}"
        )


def blocks_of(duration: float) -> list[Block]:
    """The blocks of all streams in order of time; some come out of order."""
    found: list[tuple[float, Block]] = []
    for seed, (turbine, parts) in enumerate(PARTS.items()):
        record = simulate_record("tower", duration=duration, rate=10.0, seed=seed)
        for name, columns, seconds in parts:
            size = round(10 * seconds)
            for number, first in enumerate(range(0, record.samples, size)):
                values = record.values[first : first + size, columns].astype("float32" if seed else "float64")
                channels, units = (tuple(of[i] for i in columns) for of in (record.channels, record.units))
                block = Block(turbine, number, START + first * SECOND // 10, 10.0, channels, units, values, name)
                late = 1.5 * seconds if number % 9 == 4 else 0.0
                found.append((first / 10 + seconds + late, block))
    return [block for _, block in sorted(found, key=lambda entry: entry[0])]


# the service


def key_of(block: Block) -> str:
    """Identity of a block for the sender."""
    return f"{block.turbine}/{block.stream}/{block.sequence}"


def serve(url: str, memory: Path, blocks: list[Block]) -> None:
    """Take the blocks that were not acknowledged; what is, is written into the sender's memory at once."""
    store = opened(url)
    if resource.getrlimit(resource.RLIMIT_FSIZE)[0] != resource.RLIM_INFINITY:
        threading.Thread(target=make_room, args=(store,), daemon=True).start()
    clock = START

    engine = Engine(
        [Followed(Member(name, "tower"), window) for name, window in WINDOWS.items()], store, workers=0,
        delays=Delays(lateness=20.0), now=lambda: clock,
    )  # fmt: skip
    acknowledged = remembered(memory)
    handle = os.open(memory, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    room = threading.Semaphore(UNDERWAY)
    failures: list[BaseException] = []
    futures = []
    for block in blocks:
        clock = max(clock, block.start + 10 * SECOND)
        if key_of(block) in acknowledged:
            continue
        room.acquire()

        def told(future: Any, line: bytes = f"{key_of(block)}\n".encode()) -> None:
            error = future.exception()
            if error is None:
                os.write(handle, line)
            else:
                failures.append(error)
            room.release()

        future = engine.push(block)
        future.add_done_callback(told)
        futures.append(future)
    for future in futures:
        future.result(timeout=300)
    if not engine.finish(timeout=300):
        raise TimeoutError("windows wait for ever")
    if failures:
        raise failures[0]
    engine.drain()
    store.close()


def opened(url: str) -> SqlStore:
    """The store, as soon as the server has noticed that the service before is dead."""
    deadline = time.monotonic() + 60
    while True:
        try:
            return open_store(url)
        except StoreError:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.02)


def make_room(store: SqlStore) -> None:
    """Let files grow again half a second after the disk was full."""
    while True:
        time.sleep(0.05)
        if store.trouble:
            time.sleep(0.5)
            resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
            return


def remembered(memory: Path) -> set[str]:
    """Blocks that the sender knows to be acknowledged."""
    return set(memory.read_text().splitlines()) if memory.exists() else set()


def begin(url: str, memory: Path, blocks: list[Block], limit: int | None = None) -> int:
    """Start the service; its process. With a limit no file of its grows beyond [bytes]."""
    process = os.fork()
    if process:
        return process
    code = 1
    try:
        if limit is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
        serve(url, memory, blocks)
        code = 0
    except StoreError:
        code = AGAIN
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


# what a store holds


def contents(url: str) -> dict[str, str]:
    """Everything that a store has, but when windows were closed and who fell behind: a hash of each thing."""
    store = open_store(url)
    found: dict[str, str] = {}
    for turbine in WINDOWS:
        for result in store.results(turbine):
            name = f"{turbine} {(result.window - START) / SECOND:.0f} s"
            found[f"row of {name}"] = _hash(pack_row(result.row))
            found[f"levels of {name}"] = _hash(pack_levels(result.levels))
        checkpoint = store.checkpoint(turbine)
        found[f"checkpoint of {turbine}"] = _hash(repr(checkpoint).encode())
        for window, block in store.waiting(turbine):
            found[f"waiting {window} {key_of(block)}"] = _hash(block.values.tobytes())
    for alarm in store.alarms(most=10_000):
        if alarm.kind == "data":
            continue  # that estimates fall behind depends on the machine
        found[f"alarm {alarm.turbine} {alarm.kind} {alarm.about} {alarm.text}"] = ""
    store.close()
    return found


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def missing(url: str, acknowledged: set[str], blocks: list[Block]) -> tuple[list[str], int]:
    """Acknowledged blocks that are neither in the store nor in a result; and how many are there unacknowledged."""
    store = opened(url)
    there: set[tuple[str, int]] = set()
    done: set[tuple[str, int]] = set()
    for turbine in WINDOWS:
        there |= {(key_of(block), window) for window, block in store.waiting(turbine)}
        done |= {(turbine, result.window) for result in store.results(turbine)}
    store.close()
    lost = []
    for block in blocks:
        if key_of(block) in acknowledged:
            for window in TurbineWindows.of(block.turbine, WINDOWS[block.turbine]).of_block(block):
                known = (key_of(block), window) in there
                if known == ((block.turbine, window) in done):
                    lost.append(f"{key_of(block)}: {'kept beside its result' if known else 'lost'}")
    return lost, len({key for key, _ in there} - acknowledged)


# killing


class Trial:
    """The streams through one store after the other, and how each compares with the first, which was not disturbed."""

    def __init__(self, home: Path, blocks: list[Block], server: Server | None, seed: int) -> None:
        self.home, self.blocks, self.server = home, blocks, server
        self.tally = Tally()
        self._random = random.Random(seed)
        url, memory = self._fresh()
        serve(url, memory, blocks)  # here, so that the kernels are compiled before the first fork
        self._expected = contents(url)
        print(f"undisturbed: {len(blocks)} blocks, {len(self._expected)} rows, levels and checkpoints")

    def _fresh(self) -> tuple[str, Path]:
        """The URL of a store that is not there yet, and the memory of a sender that sent nothing."""
        number = self.tally.streams
        url = str(self.home / f"{number}.sqlite") if self.server is None else self.server.emptied()
        return url, self.home / f"{number}.sent"

    def through(self, kill: str, runs: int) -> None:
        """Let the streams through once, with at most so many kills."""
        self.tally.streams += 1
        url, memory = self._fresh()
        if kill == "service":
            self._kill_services(url, memory, runs)
        elif kill == "server":
            self._kill_servers(url, memory, runs)
        else:
            self.tally.kills += 1
            limit = self._random.randrange(200_000, 600_000)  # an empty store takes less
            self._await(begin(url, memory, self.blocks, limit))
        found = contents(url)
        for name in sorted(self._expected.keys() | found.keys()):
            if self._expected.get(name) != found.get(name):
                how = "different" if name in found and name in self._expected else "there" if name in found else "lost"
                self.tally.lost.append(f"{name}: {how}")
        self.tally.windows += sum(name.startswith("row of") for name in found)
        self.tally.blocks += len(remembered(memory))
        if self.server is None:
            Path(url).unlink()

    def _await(self, process: int) -> None:
        if os.waitpid(process, 0)[1]:
            self.tally.lost.append("the service failed")

    def _kill_services(self, url: str, memory: Path, runs: int) -> None:
        for _ in range(runs):
            process = begin(url, memory, self.blocks)
            time.sleep(self._random.uniform(0.05, 1.5))
            os.kill(process, signal.SIGKILL)
            _, status = os.waitpid(process, 0)
            if not os.WIFSIGNALED(status):
                if status:
                    self.tally.lost.append("the service failed")
                return
            self.tally.kills += 1
            lost, repeated = missing(url, remembered(memory), self.blocks)
            self.tally.lost += lost
            self.tally.repeated += repeated
        self._await(begin(url, memory, self.blocks))

    def _kill_servers(self, url: str, memory: Path, runs: int) -> None:
        assert self.server is not None
        process = begin(url, memory, self.blocks)
        for _ in range(runs):
            time.sleep(self._random.uniform(0.05, 2.0))
            self.server.kill()
            self.tally.kills += 1
            time.sleep(self._random.uniform(0.0, 0.3))
            self.server.start()
            ended, status = os.waitpid(process, os.WNOHANG)
            if ended and os.waitstatus_to_exitcode(status) == AGAIN:
                self.tally.restarts += 1
                process = begin(url, memory, self.blocks)
            elif ended:
                if status:
                    self.tally.lost.append("the service failed")
                return
        self._await(process)


@contextlib.contextmanager
def _server(store: str) -> Iterator[Server | None]:
    if store == "sqlite":
        yield None
    else:
        with postgres() as server:
            yield server


def main() -> int:
    """Run the trial; 1 where anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200, help="how many times something is killed")
    parser.add_argument("--store", choices=("sqlite", "postgres"), default="sqlite")
    parser.add_argument("--kill", choices=("service", "server", "disk"), default="service")
    parser.add_argument("--seconds", type=float, default=600.0, help="length of the streams")
    parser.add_argument("--seed", type=int, default=0, help="of the instants")
    options = parser.parse_args()
    if (options.kill == "server") > (options.store == "postgres") or (options.kill == "disk") > (
        options.store == "sqlite"
    ):
        parser.error("only postgres has a server to kill, and only sqlite a file on a disk of ours")
    begun = time.perf_counter()
    blocks = blocks_of(options.seconds)
    with tempfile.TemporaryDirectory() as home, _server(options.store) as server:
        trial = Trial(Path(home), blocks, server, options.seed)
        while trial.tally.kills < options.runs:
            trial.through(options.kill, options.runs - trial.tally.kills)
    for line in trial.tally.lost[:20]:
        print(line)
    print(f"{options.store}, {options.kill}: {trial.tally}\n{time.perf_counter() - begun:.0f} s")
    return 1 if trial.tally.lost else 0


if __name__ == "__main__":
    sys.exit(main())

"""Is an archive what it says? Killed in every way, it has the bytes of one left alone; two workers do twice as much.

``python -m validation.fleet_work --kills 20 --seed 5 [--dask]``: records into an archive, undisturbed; then with so
many workers killed (signal 9) at random instants, the run itself now and then, and the disk full once. With ``--dask``
the workers are those of a Dask scheduler on this machine, which is killed once, too. Nothing may be lost or there
twice, and the files of both archives must have the same bytes.

``python -m validation.fleet_work --speed 1000``: so many records by one and by two workers.

``python -m validation.fleet_work --reading``: what reading alone costs, by format.

``python -m validation.fleet_work --cost 5``: what ten minutes of a tower at 100 Hz cost, and a year of 100 towers; ten
minutes of rotors under wind; and, on paper, ten years of 100 towers: processors, storage and network.
"""

import argparse
import contextlib
import os
import random
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from windsysid.fleet.archive import add_rows, read_table
from windsysid.fleet.batch import batch
from windsysid.fleet.members import single
from windsysid.fleet.rows import Row
from windsysid.fleet.work.worker import take
from windsysid.records.formats import read_record, write_record
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine

__all__ = ["kills", "main", "write_records"]

BEGIN = datetime(2025, 9, 1, tzinfo=UTC)
RECORDS = 16
"""Good records of a campaign of kills, and a damaged one."""

TURBINES = ("T01", "T02")
ROTORS = ("verne555", "nrel5mw")
DAY_RECORDS = 144
YEAR_RECORDS = 100 * 365 * DAY_RECORDS
YEARS, CORES = 10, 16
"""Of the archive on paper: 100 turbines for so many years, and processors that read it at once."""
RUN_KILLED = 0.15
"""Share of the kills that end the run, and not a worker; they are not counted among the workers'."""

GIVEN_UP = "died again and again"
"""Output of a run that ends because workers of Dask die at one task, whoever kills them."""

SAMPLE_SECONDS = 0.5

_CLEAN = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}  # Python keeps a module that it could not write whole


def write_records(folder: Path, count: int, *, duration: float = 300.0, rate: float = 10.0) -> Path:
    """Records of two towers, four a day, one of them damaged, and the fleet file."""
    machine = load_turbine("tower")
    text = ""
    for number, name in enumerate(TURBINES, 1):
        text += f'[[turbine]]\nname = "{name}"\npattern = "{name}/*"\nturbine = "tower"\n'
        for i in range(count // len(TURBINES)):
            start = BEGIN + timedelta(hours=6 * i)
            record = simulate_record(machine, duration=duration, rate=rate, seed=1000 * number + i)
            record = replace(record, start=start.isoformat().replace("+00:00", "Z"))
            write_record(record, folder / name / f"{start:%Y%m%d_%H%M}.csv")
    (folder / "fleet.toml").write_text(text)
    (folder / "T01" / "damaged.csv").write_text("time [s],tower_x_acceleration [m/s^2]\n0,1\n1,wet\n")
    return folder / "fleet.toml"


def kills(count: int, seed: int, home: Path, *, dask: bool = False) -> tuple[str, bool]:
    """Kill workers, runs and the scheduler, and fill the disk; what came of it, and whether the archive is whole."""
    rng = random.Random(seed)
    fleet = write_records(home / "data", RECORDS)
    begun = time.monotonic()
    batch(home / "data", fleet=fleet, archive=home / "calm", workers=2)
    longest = 0.5 * (time.monotonic() - begun)  # so that workers come to work between kills
    command = [
        sys.executable, "-m", "windsysid", "batch", str(home / "data"), "--fleet", str(fleet), "--output",
        str(home / "wild"),
    ]  # fmt: skip
    with _cluster(home) if dask else contextlib.nullcontext() as cluster:
        command += ["--workers", "2"] if cluster is None else ["--scheduler", cluster.address]
        told = [_fill_disk(command, cluster)]
        if cluster is not None:
            told.append(_kill_scheduler(command, cluster, rng, longest))
        told.append(_kill_workers(command, cluster, count, rng, longest, home / "wild"))
        left = sum(row["status"] == "failed" for name in TURBINES for row in _rows(home / "wild", name, ["status"]))
        if left:
            subprocess.run(command, check=True, capture_output=True, env=_CLEAN)
            told.append(f"{left} records were left alone after three deaths in a row, and taken by the next run")
    same = _contents(home / "calm") == _contents(home / "wild")
    rows = [row for name in TURBINES for row in _rows(home / "wild", name, ["source"])]
    sources = {row["source"] for row in rows}
    told.append(f"{len(rows)} rows of {RECORDS + 1} records, {len(rows) - len(sources)} twice")
    told.append(f"same bytes as undisturbed: {same}")
    return "\n".join(told), same and len(rows) == RECORDS + 1


def _rows(archive: Path, turbine: str, columns: list[str]) -> list[Row]:
    rows: list[Row] = read_table(archive, turbine, columns).to_pylist()
    return rows


class _Cluster:
    """A Dask scheduler of this machine and two workers of it."""

    def __init__(self, home: Path) -> None:
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            self.port = found.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.home = home
        self.scheduler: subprocess.Popen[bytes] | None = None
        self.nannies: list[subprocess.Popen[bytes]] = []

    def start(self, limit: Callable[[], None] | None = None) -> None:
        """Start what is not running; workers with a limit of their files, where one is given."""
        if self.scheduler is None:
            self.scheduler = self._run("scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")
        while len(self.nannies) < len(TURBINES):
            self.nannies.append(
                self._run(
                    "worker", self.address, "--nthreads", "1", "--nworkers", "1", "--no-dashboard",
                    "--local-directory", str(self.home), limit=limit,
                )
            )  # fmt: skip

    def stop(self) -> None:
        """End all of it."""
        self.stop_workers()
        self.kill_scheduler()

    def stop_workers(self) -> None:
        """End the workers, and those who start them again."""
        for nanny in self.nannies:
            below = _below(nanny.pid)
            nanny.kill()
            nanny.wait()
            for pid in below:
                _kill(pid)
        self.nannies = []

    def kill_scheduler(self) -> None:
        """End the scheduler by signal 9."""
        if self.scheduler is not None:
            self.scheduler.kill()
            self.scheduler.wait()
            self.scheduler = None

    def _run(self, what: str, *options: str, limit: Callable[[], None] | None = None) -> "subprocess.Popen[bytes]":
        return subprocess.Popen(
            [sys.executable, "-m", "dask", what, *options],
            preexec_fn=limit, env=_CLEAN, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip


@contextlib.contextmanager
def _cluster(home: Path) -> Iterator[_Cluster]:
    cluster = _Cluster(home)
    try:
        yield cluster
    finally:
        cluster.stop()


def _fill_disk(command: list[str], cluster: _Cluster | None) -> str:
    """A run that can write no file of more than 2 kB."""
    if cluster is not None:
        cluster.start(_small_files)
    limit = None if cluster is not None else _small_files
    full = subprocess.run(command, preexec_fn=limit, env=_CLEAN, capture_output=True, text=True)
    if cluster is not None:
        cluster.stop_workers()
    lines = full.stderr.replace(f"{tempfile.gettempdir()}{os.sep}", "").strip().splitlines()
    return f"disk full: exit code {full.returncode}, {len(lines)} line: {lines[0] if lines else ''}"


def _kill_scheduler(command: list[str], cluster: _Cluster, rng: random.Random, longest: float) -> str:
    """A run whose scheduler is killed when the first file is there."""
    cluster.start()
    wild = Path(command[command.index("--output") + 1])
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=_CLEAN)
    while run.poll() is None and not list(wild.rglob("*.parquet")):
        time.sleep(0.1)
    time.sleep(rng.uniform(0.0, 0.2 * longest))
    taken = len(_contents(wild))
    cluster.kill_scheduler()
    lines = run.communicate()[1].strip().splitlines()
    cluster.stop_workers()
    return f"scheduler killed after {taken} files: exit code {run.returncode}, {len(lines)} line: {' '.join(lines)}"


def _kill_workers(
    command: list[str], cluster: _Cluster | None, count: int, rng: random.Random, longest: float, wild: Path
) -> str:
    """Runs until so many workers were killed and one run came to its end."""
    workers = runs = ended = given_up = 0
    while workers < count or not ended:
        if cluster is not None:
            cluster.start()
        run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=_CLEAN)
        while run.poll() is None:
            time.sleep(rng.uniform(0.0, longest))
            if workers >= count:
                run.wait()
                break
            if rng.random() < RUN_KILLED:
                run.kill()
                runs += 1
                continue
            above = [run.pid] if cluster is None else [nanny.pid for nanny in cluster.nannies]
            found = [pid for pid in (each for one in above for each in _below(one)) if _works(pid)]
            if found and run.poll() is None:
                workers += _kill(rng.choice(found))
        said = run.communicate()[1]
        if run.returncode == 2 and GIVEN_UP in said and len(said.splitlines()) == 1:
            given_up += 1  # too many deaths at one task: the same command goes on
        elif run.returncode not in (0, -signal.SIGKILL):
            raise SystemExit(f"a run ended with exit code {run.returncode}: {said}")
        if run.returncode == 0:
            ended += 1
            if workers < count:
                _forget_days(wild, rng)  # work for the next run
    told = f"{workers} workers and {runs} runs killed, {ended} runs to their end"
    return f"{told}, {given_up} given up with one line after many deaths" if given_up else told


def _works(pid: int) -> bool:
    """Test whether a process opens records, or is the worker of Dask who started one that does."""
    try:
        told = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ")
    except OSError:
        return False
    return b"windsysid.fleet.work.worker" in told or b"spawn_main" in told


def _small_files() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


def _forget_days(archive: Path, rng: random.Random) -> None:
    files = sorted(archive.rglob("*.parquet"))
    for path in rng.sample(files, k=len(files) // 2):
        path.unlink()


def _below(pid: int) -> list[int]:
    """Processes that a process started, and those that they started."""
    found: list[int] = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            for child in map(int, path.read_text().split()):
                found += [child, *_below(child)]
    return found


def _kill(pid: int) -> bool:
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def _contents(archive: Path) -> dict[str, bytes]:
    return {path.relative_to(archive).as_posix(): path.read_bytes() for path in archive.rglob("*.parquet")}


class _Run(NamedTuple):
    """Cost of a run.

    Attributes
    ----------
    seconds
        From its begin to its end.
    waited
        [s] of them that a worker was ready and had no processor, since others had it; the workers' mean.
    processor
        [s] of the processors, of all processes.
    memory
        [MB] the largest resident set of a worker at the end of the first quarter of the time, and at the last.
    """

    seconds: float
    waited: float
    processor: float
    memory: tuple[float, float]


def speed(count: int, home: Path) -> str:
    """Records by one worker and by two: processor time, efficiency, memory."""
    fleet = write_records(home / "data", count, duration=120.0)
    batch(home / "data" / "T01" / "20250901_0000.csv", turbine="tower", archive=home / "first", workers=1)  # compiles
    runs: dict[int, _Run] = {}
    for n in (1, 2):
        runs[n] = _measured(partial(batch, home / "data", fleet=fleet, archive=home / f"by_{n}", workers=n))
    told = [f"{count} records of 120 s at 10 Hz, starts of the workers included"]
    for n, run in runs.items():
        told.append(
            f"{n} workers: {run.seconds:.0f} s, {run.waited:.0f} s of them without a processor; processor"
            f" {1000.0 * run.processor / count:.0f} ms a record; memory of a worker {run.memory[0]:.0f} MB after a"
            f" quarter, {run.memory[1]:.0f} MB at the end"
        )
    alone = {n: run.seconds - run.waited for n, run in runs.items()}
    size = sum(path.stat().st_size for path in (home / "by_1").rglob("*.parquet"))
    same = _contents(home / "by_1") == _contents(home / "by_2")
    told.append(
        f"efficiency {50.0 * runs[1].seconds / runs[2].seconds:.0f} %, {50.0 * alone[1] / alone[2]:.0f} % without the"
        f" waits for others; {size / count / 1000.0:.1f} kB a record; same bytes: {same}"
    )
    return "\n".join(told)


def cost(count: int, home: Path) -> str:
    """Processor time and storage of ten-minute records at 100 Hz, and of a year of 100 towers."""
    told, paper = [], {}
    rows: list[Row] = []
    for first, ending in enumerate(("csv", "parquet")):
        usual, size, found = _costs("tower", count, ending, 1000 * first, home)
        rows += found
        paper[ending] = usual, size
        year = YEAR_RECORDS * usual / 3600.0
        told.append(
            f"{ending}: {usual:.2f} s of processor time a record, {size / 1e6:.1f} MB; a year of 100 towers:"
            f" {year:.0f} h of one processor, {YEAR_RECORDS * size / 1e12:.0f} TB to be read,"
            f" {8.0 * size / usual / 1e6:.0f} Mbit/s by each worker"
        )
    for name in ROTORS:
        usual, size, found = _costs(name, count, "parquet", 0, home)
        trusted = sum(row["trusted"] is True for row in found)
        told.append(
            f"{name}, parquet: {usual:.2f} s of processor time a record, {size / 1e6:.1f} MB;"
            f" {trusted} of {len(found)} trusted"
        )
    sizes = {}
    for many in (len(rows) // 2, len(rows)):
        add_rows(home / f"{many}.parquet", rows[:many])
        sizes[many] = (home / f"{many}.parquet").stat().st_size
    (few, small), (many, large) = sizes.items()
    row_size = (large + (DAY_RECORDS - many) * (large - small) / (many - few)) / DAY_RECORDS  # equal rows hide the size
    told.append(
        f"archive: {row_size / 1e3:.1f} kB a row in a day of {DAY_RECORDS}, {YEAR_RECORDS * row_size / 1e9:.1f} GB in"
        f" {YEAR_RECORDS // DAY_RECORDS} files"
    )
    return "\n".join([*told, "", on_paper(paper, row_size)])


def on_paper(costs: dict[str, tuple[float, int]], row_size: float) -> str:
    """100 towers for `YEARS` years, as a table, from processor time [s] and size [bytes] of a record by format, and the
    size of a row [bytes]."""
    records = YEARS * YEAR_RECORDS
    seconds, sizes = (np.array([each[i] for each in costs.values()], dtype=np.float64) for i in (0, 1))
    days, real_time = records * seconds / CORES / 86_400.0, YEARS * 365 * 86_400.0
    rows = {
        "processor time of a record, s": seconds,
        "size of a record, MB": sizes / 1e6,
        "processor time of all, h": records * seconds / 3600.0,
        "of a turbine-year, h": records * seconds / 3600.0 / (100 * YEARS),
        f"days with {CORES} processors": days,
        "processors that keep up with 100 turbines": records * seconds / real_time,
        "records, TB": records * sizes / 1e12,
        f"network for {CORES} processors, Mbit/s": 8e-6 * records * sizes / (86_400.0 * days),
        "network for 100 turbines as they measure, Mbit/s": 8e-6 * records * sizes / real_time,
        "rows, GB": np.full(len(costs), records * row_size / 1e9),
    }
    lines = [f"| 100 towers, {YEARS} years, {records / 1e6:.1f} million records | {' | '.join(costs)} |"]
    lines += [f"|{' --- |' * (1 + len(costs))}"]
    lines += [f"| {what} | {' | '.join(map(_number, values))} |" for what, values in rows.items()]
    return "\n".join(lines)


def _number(value: float) -> str:
    return f"{value:.3g}" if value < 1000.0 else f"{value:,.0f}".replace(",", " ")


def _costs(turbine: str, count: int, ending: str, seed: int, home: Path) -> tuple[float, int, list[Row]]:
    """The median of the processor time of so many records [s], the size of a file [bytes], and the rows."""
    member, machine = single(turbine), load_turbine(turbine)
    seconds, size, rows = [], 0, []
    for i in range(count + 1):
        start = (BEGIN + timedelta(minutes=10 * i)).isoformat().replace("+00:00", "Z")
        path = home / f"{turbine}_{i}.{ending}"
        record = simulate_record(machine, duration=600.0, rate=100.0, seed=seed + i)
        write_record(replace(record, start=start), path)
        begun = time.process_time()
        rows.append(take(str(path), member, "spectral", "", lambda _: None))
        seconds.append(time.process_time() - begun)
        size = path.stat().st_size
    return sorted(seconds[1:])[count // 2], size, rows  # the first one compiles


def reading(home: Path) -> str:
    """Processor time of reading ten minutes of a tower at 100 Hz, by format: the median of five."""
    record = replace(simulate_record("tower", duration=600.0, rate=100.0), start=BEGIN.isoformat())
    paths = [home / f"record.{ending}" for ending in ("csv", "parquet", "nc", "tdms")]
    for path in paths[:-1]:
        write_record(record, path)
    _write_tdms(record, paths[-1])
    told = []
    for path in paths:
        seconds = []
        for _ in range(6):
            begun = time.process_time()
            read_record(path)
            seconds.append(time.process_time() - begun)
        told.append(f"{path.suffix[1:]} {1000.0 * sorted(seconds[1:])[2]:.0f} ms")  # the first one imports
    return f"reading {record.samples} samples of {len(record.channels)} channels: {', '.join(told)}"


def _write_tdms(record: Record, path: Path) -> None:
    from nptdms import ChannelObject, TdmsWriter

    timing = {"wf_increment": 1.0 / record.rate, "wf_start_offset": 0.0, "wf_samples": record.samples}
    with TdmsWriter(path) as writer:
        writer.write_segment([
            ChannelObject("mast", name, record[name], properties={"unit_string": unit, **timing})
            for name, unit in zip(record.channels, record.units, strict=True)
        ])  # fmt: skip


def _measured(work: Callable[[], object]) -> _Run:
    """Run something that starts workers, and look at them meanwhile."""
    waits: dict[int, float] = {}
    sizes: list[tuple[float, float]] = []
    done = threading.Event()

    def look() -> None:
        while not done.wait(SAMPLE_SECONDS):
            now = []
            for pid in filter(_works, _below(os.getpid())):
                with contextlib.suppress(OSError, IndexError):
                    waits[pid] = int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9
                    now.append(int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * resource.getpagesize() / 1e6)
            sizes.append((time.monotonic(), max(now, default=0.0)))

    def processor() -> float:
        used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        return sum(one.ru_utime + one.ru_stime for one in used)

    watcher = threading.Thread(target=look)
    begun, before = time.monotonic(), processor()
    watcher.start()
    try:
        work()
    finally:
        seconds = time.monotonic() - begun
        done.set()
        watcher.join()
    early = [size for at, size in sizes if at - begun < 0.25 * seconds]
    return _Run(
        seconds, sum(waits.values()) / max(len(waits), 1), processor() - before,
        (max(early, default=0.0), max((size for _, size in sizes), default=0.0)),
    )  # fmt: skip


def main() -> int:
    """Run the requested part; 1 where something was lost."""
    parser = argparse.ArgumentParser(prog="python -m validation.fleet_work", description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, metavar="N", help="kill so many workers")
    parser.add_argument("--dask", action="store_true", help="of a Dask scheduler, which is killed, too")
    parser.add_argument("--speed", type=int, metavar="N", help="take so many records by one and by two workers")
    parser.add_argument("--cost", type=int, metavar="N", help="take so many records of ten minutes at 100 Hz")
    parser.add_argument("--reading", action="store_true", help="read ten minutes at 100 Hz from each format")
    parser.add_argument("--seed", type=int, default=0, help="of the instants")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as home:
        if options.kills is not None:
            told, whole = kills(options.kills, options.seed, Path(home) / "kills", dask=options.dask)
            print(told)
            if not whole:
                return 1
        if options.speed is not None:
            print(speed(options.speed, Path(home) / "speed"))
        if options.reading:
            print(reading(Path(home)))
        if options.cost is not None:
            print(cost(options.cost, Path(home) / "cost"))
    return 0


if __name__ == "__main__":
    sys.exit(main())

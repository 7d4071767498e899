"""Is anything lost when a process is killed while it writes? ``python -m validation.kills --runs 100``.

A process saves results, records and checkpoints in a loop, each version over the one before, in a folder that holds
files of the user's too. It is killed (signal 9) at a random instant. After each kill the old version or the new one
must be read, whole and unmixed; a version that was reported as saved must not be lost; the user's files must be as they
were. POSIX only: the writer is a fork. That a crash of the whole machine loses nothing is not tried here: for that,
files and folders are flushed to the disk before each rename and after it.
"""

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import h5netcdf
import numpy as np

from windsysid.checks.verdict import Diagnosis
from windsysid.identification.estimate.online import History, begin, restored, stored
from windsysid.identification.streaming.checkpoint import Checkpoint
from windsysid.output.folders import Saveable, result_file
from windsysid.output.locks import HOME, LOCK, PART
from windsysid.records.formats import read_record, write_record
from windsysid.records.record import Record
from windsysid.reports.html import Section, report_page
from windsysid.results.identification import Estimate, Identification
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.file import load_turbine

__all__ = ["Tally", "main", "run"]

KINDS = ("result", "record.nc", "record.csv", "checkpoint.npz")
LONGEST = 0.3
"""The writer lives at most this long [s]: some rounds of its loop."""

FRESH = 10
"""Every so many kills the writer starts in an empty folder."""

CYCLE = 4
"""Versions that differ: their content is made once, so that the writer spends its time on writing."""


@dataclass
class Tally:
    """Outcome: kills, how many of them left something half done, versions saved, what was lost."""

    kills: int = 0
    half_done: int = 0
    versions: int = 0
    lost: tuple[str, ...] = ()

    def __str__(self) -> str:
        return (
            f"{self.kills} runs killed, {self.half_done} of them with something half written; {self.versions} versions"
            f" saved; lost or mixed: {len(self.lost)}" + "".join(f"\n  {loss}" for loss in self.lost)
        )


def run(kills: int, home: Path, seed: int = 0) -> Tally:
    """Kill a writer in `home` so many times; what happened."""
    rng = random.Random(seed)
    results, tally, lost = [_result(version) for version in range(CYCLE)], Tally(), []
    for kill in range(kills):
        if kill % FRESH == 0:
            place, saved = home / f"place_{kill}", dict.fromkeys(KINDS, 0)
            users = _user_files(place, results)
        order = KINDS[kill % len(KINDS) :] + KINDS[: kill % len(KINDS)]  # each is the first that is written, in turn
        before, saved = saved, _killed(place, results, {kind: saved[kind] for kind in order}, rng.uniform(0.0, LONGEST))
        tally.kills += 1
        tally.half_done += any(name.endswith(PART) or name.startswith("new-") for name in _names(place))
        for kind in KINDS:
            try:
                found = _version(place, kind)
            except Exception as error:  # whatever it is: what was saved cannot be read
                lost.append(f"kill {kill}: {kind} {saved[kind]} cannot be read: {error}")
                continue
            if found == (saved[kind] + 1) % CYCLE:
                saved[kind] += 1
            elif found != saved[kind] % CYCLE:
                lost.append(f"kill {kill}: {kind} {saved[kind]} was saved, {found} of {CYCLE} was found")
            tally.versions += saved[kind] - before[kind]
        for path, content in users.items():
            if not path.is_file() or path.read_bytes() != content:
                lost.append(f"kill {kill}: the user's {path.name} was lost")
        if kill % FRESH == FRESH - 1 or kill == kills - 1:  # what was left half done is gone after the next run
            _write_all(place, results, {kind: saved[kind] + 1 for kind in KINDS})
            left = [name for name in _names(place) if name.endswith((PART, LOCK)) or name.startswith(("new-", "lock"))]
            lost += [f"kill {kill}: {name} stayed" for name in left]
    tally.lost = tuple(lost)
    return tally


def _killed(place: Path, results: list["_Result"], saved: dict[str, int], seconds: float) -> dict[str, int]:
    """The versions that a writer reported as saved before it was killed."""
    told, tells = os.pipe()
    writer = os.fork()
    if writer == 0:
        try:
            versions = dict(saved)
            while True:
                versions = {kind: version + 1 for kind, version in versions.items()}
                _write_all(place, results, versions, tells)
        finally:
            os._exit(1)
    os.close(tells)
    time.sleep(seconds)
    os.kill(writer, signal.SIGKILL)
    _, status = os.waitpid(writer, 0)
    if not os.WIFSIGNALED(status):
        raise RuntimeError("the writer ended by itself: nothing was tried")
    with os.fdopen(told) as lines:
        for line in lines:
            kind, version = line.split()
            saved = {**saved, kind: int(version)}
    return saved


def _write_all(place: Path, results: list["_Result"], versions: dict[str, int], tells: int | None = None) -> None:
    """One version of everything over the one before."""
    for kind, version in versions.items():
        value = float(version % CYCLE)
        if kind == "result":
            results[version % CYCLE].save(place / kind, overwrite=True)
        elif kind.startswith("record"):
            record = Record(np.arange(200.0), np.full((200, 3), value), ("a", "b", "c"), ("m",) * 3)
            write_record(record, place / kind, overwrite=True)
        else:
            online = begin(np.full(3, value), np.eye(3), 10, (1, 1))
            history = History(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3)))
            Checkpoint(place / kind, {}).write(stored(online, history), {})
        if tells is not None:
            os.write(tells, f"{kind} {version}\n".encode())


def _version(place: Path, kind: str) -> int:
    """The version that is there, of `CYCLE`; an error where it is not whole."""
    if kind == "result":
        return _version_of_result(place / kind)
    if kind.startswith("record"):
        values = read_record(place / kind).values
        if values.shape != (200, 3) or len(np.unique(values)) != 1:
            raise ValueError("a mixed record")
        return int(values[0, 0])
    with Checkpoint(place / kind, {}).opened() as arrays:
        return int(restored(_no_model, arrays)[0].theta[0])


def _version_of_result(folder: Path) -> int:
    names = {json.loads(result_file(folder, "summary.json").read_text(encoding="utf-8"))["record"]}
    with h5netcdf.File(result_file(folder, "identification.nc"), "r") as file:
        names.add(file.attrs["record"])
    report = result_file(folder, "report.html")
    if report.exists():
        names.add(report.read_text(encoding="utf-8").split("<p>")[-1].split("</p>")[0].strip())
    (name,) = names
    version = int(name.removeprefix("version "))
    if report.exists() != bool(version % 2):
        raise ValueError(f"the report of another version with version {version}")
    return version


def _no_model(_: object) -> StateSpace:
    raise AssertionError("these checkpoints hold no filters")


def _user_files(place: Path, results: list["_Result"]) -> dict[Path, bytes]:
    """Files of the user's next to the result and below it, once the first result is there."""
    _write_all(place, results, dict.fromkeys(KINDS, 0))
    names = ("notes.txt", "result/notes.txt", "result/figures/plot.svg", "result/record.csv", "result/.hidden")
    users = {place / name: f"the user's {name}".encode() for name in names}
    for path, content in users.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return users


def _names(place: Path) -> list[str]:
    return [path.name for folder in (place, place / "result" / HOME) if folder.is_dir() for path in folder.iterdir()]


class _Result(Saveable):
    """A result whose files have been made."""

    def __init__(self, content: dict[str, bytes]):
        self.content = content

    def files(self) -> dict[str, bytes]:
        return self.content


def _result(version: int) -> _Result:
    """A small identification; every second version has a report, as the command line saves it."""
    diagnosis = Diagnosis((), None, (), 0.0, 0, (0.0, 1.0))
    estimate = Estimate("k_x", "N/m", "stiffness", 1.0, 0.9, 1.1, 0.05, 0.9, 1.0, None, None)
    samples = 100 + version
    history = np.ones((samples, 1))
    found = Identification(
        method="EKF", formulation="joint", record=f"version {version}", turbine="tower", sensors=("a",),
        section=(0.0, 10.0),
        rate=10.0, samples=samples, elapsed=0.1, estimates=(estimate,), modes=(),
        parameters=(Parameter("k_x", 1.0, 0.3, True),),
        time=np.arange(samples) / 10.0, mean=history, std=history, cov=np.eye(1), readings=("a",), innovation=history,
        whitened=history, log_likelihood=0.0, machine=load_turbine("tower").exact(), diagnosis=diagnosis,
    )  # fmt: skip
    page = report_page("Report", "", [Section("Result", text=[found.record])])
    return _Result(found.files() | ({"report.html": page} if version % 2 else {}))


def main() -> int:
    """Run the trial; 1 where anything was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=100, help="how many times the writer is killed")
    parser.add_argument("--seed", type=int, default=0, help="of the instants")
    options = parser.parse_args()
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as home:
        tally = run(options.runs, Path(home), options.seed)
    print(f"{tally}\n{time.perf_counter() - begun:.0f} s")
    return 1 if tally.lost else 0


if __name__ == "__main__":
    sys.exit(main())

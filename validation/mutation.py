"""Mutation tests: deliberate faults that the tests detect.

    python -m validation.mutation [--only MODULE] [--list] [--sample N] [--jobs N] [--full]

Every mutant of `validation.mutants` and `validation.recent_mutants` is put into a copy of the sources, and the tests
most likely to notice it run on that copy until the first one fails. With --full those that survive meet the whole
default suite. What was found is kept in results/mutation/results.jsonl under a hash of the mutant, the sources and the
tests that ran, so that an interrupted run goes on, and only what changed runs again; the test that noticed a mutant
last time goes first.

In the end all tests that noticed something run without any fault. Each job has a folder for its copy, which stays, and
a cache of kernels: Numba finds kernels by where their sources lie. Mutants of sources that kernels hold come last, for
they compile anew.
"""

import argparse
import hashlib
import json
import os
import random
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from validation.mutants import MUTANTS, TESTS, Mutant
from validation.recent_mutants import RECENT_MUTANTS, RECENT_TESTS

__all__ = ["EVERY_MUTANT", "LIKELY_TESTS", "NotFoundOnceError", "locate", "main"]

EVERY_MUTANT: tuple[Mutant, ...] = (*MUTANTS, *RECENT_MUTANTS)
"""Of old modules and of those that version 0.1.0 did not have."""


def _joined_tests() -> dict[str, tuple[str, ...]]:
    """Test files by module, of both lists: two modules may have one base name."""
    return {
        name: tuple(dict.fromkeys((*TESTS.get(name, ()), *RECENT_TESTS.get(name, ()))))
        for name in (*TESTS, *RECENT_TESTS)
    }


LIKELY_TESTS = _joined_tests()
"""For each module the test files most likely to notice a mutant."""

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "results" / "mutation"

PATIENCE = 1200.0
"""Seconds after which tests that still run have noticed something."""

COMPILED = (
    "bank_kernel.py", "ekf.py", "gaussian.py", "iekf.py", "particle.py", "particlekernels.py", "raoblackwell.py",
    "smoother.py", "transition.py", "ukf.py",
)  # fmt: skip
"""Sources whose change compiles all kernels of filters anew."""


_FAILED = re.compile(r"^(?:FAILED|ERROR) ([^\s\[]+)", re.MULTILINE)


class NotFoundOnceError(Exception):
    """A mutant's text does not stand exactly once in the sources: they have moved on."""


def locate(mutant: Mutant, root: Path = ROOT) -> Path:
    """The one source file, relative to `root`, that holds the mutant's text: one called `module` or, where files were
    renamed, any other.

    Raises
    ------
    NotFoundOnceError
        If there is none, or the text stands in several places.
    """
    for name in (mutant.module, "*.py"):
        found = []
        for path in sorted((root / "src" / "windsysid").rglob(name)):
            found += [path] * path.read_text(encoding="utf-8").count(mutant.old)
        if len(found) == 1:
            return found[0].relative_to(root)
    raise NotFoundOnceError(
        f"'{mutant.name}': expected its text once, as in {mutant.module}, found it {len(found)} times"
    )


class Results:
    """Results of mutants, in a file of one JSON object a line; the last line on a mutant counts."""

    def __init__(self, path: Path) -> None:
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        self.known: dict[str, dict[str, Any]] = {}
        for line in lines:
            if line.endswith("}"):  # not cut off
                row = json.loads(line)
                self.known[row["mutant"]] = row

    def add(self, row: dict[str, Any]) -> None:
        """Keep a result."""
        self.known[row["mutant"]] = row
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")


class Bench:
    """A copy of the sources and tests on which mutants are tried, with a cache of kernels that outlives them."""

    def __init__(self, folder: Path) -> None:
        self.copy, self.cache = folder / "copy", folder / "cache"
        shutil.rmtree(self.copy, ignore_errors=True)
        hidden = shutil.ignore_patterns(".*", "__pycache__", "*.egg-info")
        self.copy.mkdir(parents=True)
        for part in ("src", "tests", "validation", "benchmarks", "examples", "docs"):
            shutil.copytree(
                ROOT / part, self.copy / part, ignore=hidden
            )  # with the files' times, by which Numba knows them
        for path in (*ROOT.glob("*.md"), *ROOT.glob("*.toml"), *ROOT.glob("*.txt"), ROOT / "Makefile"):
            shutil.copy2(path, self.copy)

    def try_(self, mutant: Mutant, tests: Sequence[str], killer: str) -> tuple[str, str]:
        """Put a fault in and run tests: ``killed``, ``survived`` or ``error``, and the failed test or the error."""
        path = self.copy / locate(mutant, self.copy)
        text, times = path.read_text(encoding="utf-8"), (path.stat().st_atime_ns, path.stat().st_mtime_ns)
        kernels = set(self.cache.glob("kernels_*"))
        path.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")
        try:
            code, found, said = self._pytest([killer]) if killer.partition("::")[0] in tests else (0, "", "")
            if code != 1:
                code, found, said = self._pytest(tests)
        finally:
            path.write_text(text, encoding="utf-8")
            os.utime(path, ns=times)
        if kernels and mutant.module in COMPILED:
            for folder in set(self.cache.glob("kernels_*")) - kernels:  # a fault's own
                shutil.rmtree(folder)
        if code == 1 and found.endswith(".py"):  # tests that could not be collected have noticed nothing
            code = 2
        return {0: ("survived", ""), 1: ("killed", found)}.get(code, ("error", said[-500:]))

    def failing(self, tests: Sequence[str]) -> set[str]:
        """Those of some tests that fail without a fault."""
        return set(_FAILED.findall(self._pytest(tests, "--maxfail=0")[2])) if tests else set()

    def _pytest(self, tests: Sequence[str], *options: str) -> tuple[int, str, str]:
        environment = os.environ | {"PYTHONPATH": str(self.copy / "src"), "WINDSYSID_CACHE": str(self.cache)}
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-x",
            "-rfE",
            "--tb=no",
            "-p",
            "no:cacheprovider",
            *options,
            *tests,
        ]
        try:
            ran = subprocess.run(
                command, cwd=self.copy, env=environment, capture_output=True, text=True, timeout=PATIENCE, check=False
            )
        except subprocess.TimeoutExpired:
            return 1, "out of time", ""
        failed = _FAILED.findall(ran.stdout)
        return ran.returncode, failed[0] if failed else "", ran.stdout + ran.stderr


def files_of_tests(mutant: Mutant, *, full: bool) -> list[str]:
    """The test files for a mutant, relative to the root, the likeliest first."""
    every = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "tests").rglob("test_*.py"))
    if full:
        return every
    found = [path for name in LIKELY_TESTS[mutant.module] for path in every if path.rpartition("/")[2] == name]
    room = f"tests/{locate(mutant).parent.name}/"
    return sorted(found, key=lambda path: not path.startswith(room))  # the tests of its own room know it best


def hash_of(mutant: Mutant, tests: Sequence[str]) -> str:
    """Inputs of a result: the mutant, all sources, and the tests with their helpers."""
    digest = hashlib.sha256("\0".join(mutant).encode())
    helpers = [path for path in (ROOT / "tests").rglob("*.py") if not path.name.startswith("test_")]
    for path in (*sorted((ROOT / "src").rglob("*.py")), *sorted(helpers), *(ROOT / test for test in tests)):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:20]


def judge(mutants: Sequence[Mutant], results: Results, jobs: int, *, full: bool) -> Iterator[dict[str, Any]]:
    """Try every mutant that is not known yet; their results as they come."""
    waiting = []
    for mutant in mutants:
        try:
            locate(mutant)
        except NotFoundOnceError as error:
            yield {"mutant": mutant.name, "status": "not found", "killer": str(error)}
            continue
        tests = files_of_tests(mutant, full=full)
        row, key = results.known.get(mutant.name, {}), hash_of(mutant, tests)
        if row.get("key") == key or (full and row.get("status") == "killed"
                                                       and row["key"] == hash_of(mutant,
                                                       files_of_tests(mutant, full=False))):  # fmt: skip
            yield row
        else:
            waiting.append((mutant.module in COMPILED, mutant, key, tests, row.get("killer", "")))
    waiting.sort(key=lambda item: item[0])
    benches: SimpleQueue[Bench] = SimpleQueue()
    for i in range(min(jobs, len(waiting))):
        benches.put(Bench(FOLDER / f"job{i}"))

    def try_one(mutant: Mutant, key: str, tests: Sequence[str], killer: str) -> dict[str, Any]:
        bench, begun = benches.get(), time.monotonic()
        try:
            status, by = bench.try_(mutant, tests, killer)
        finally:
            benches.put(bench)
        seconds = round(time.monotonic() - begun, 1)
        return {"mutant": mutant.name, "key": key, "status": status, "killer": by, "seconds": seconds}

    with ThreadPoolExecutor(max(1, jobs)) as pool:
        for row in pool.map(lambda item: try_one(*item[1:]), waiting):
            results.add(row)
            yield row
    if waiting:
        killers = {row.get("killer", "") for row in map(results.known.get, (m.name for m in mutants)) if row}
        failing = benches.get().failing(sorted(killer for killer in killers if "::" in killer))
        for mutant in mutants:
            row = results.known.get(mutant.name, {})
            if row.get("status") == "killed" and row["killer"] in failing:
                results.add(row | {"status": "error", "key": "", "killer": f"{row['killer']} fails without any fault"})
                yield results.known[mutant.name]


def table(mutants: Sequence[Mutant], found: dict[str, dict[str, Any]]) -> str:
    """Module, mutants, killed, survivors by name, score."""
    lines = [f"{'module':<20} mutants  killed  score  not killed"]
    total, killed = 0, 0
    for module in dict.fromkeys(mutant.module for mutant in mutants):
        rows = [found[mutant.name] for mutant in mutants if mutant.module == module]
        there = [row for row in rows if row["status"] != "not found"]
        dead = sum(row["status"] == "killed" for row in there)
        others = [
            row["mutant"] + ("" if row["status"] == "survived" else f" ({row['status']})")
            for row in rows
            if row["status"] != "killed"
        ]
        score = f"{100 * dead / len(there):.0f} %" if there else "–"
        lines.append(f"{module:<20} {len(rows):7d} {dead:7d} {score:>6}  {'; '.join(others)}".rstrip())
        total, killed = total + len(there), killed + dead
    lines.append(f"{'all':<20} {len(mutants):7d} {killed:7d} {100 * killed / max(total, 1):4.1f} %")
    if total < len(mutants):
        lines.append(
            f"{len(mutants) - total} not found: the sources have moved on, and validation/mutants.py has to follow"
        )
    return "\n".join(lines)


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m validation.mutation", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", metavar="MODULE", action="append", help="mutants of this module, such as bank.py, or of this name"
    )
    parser.add_argument("--list", action="store_true", help="say what the mutants mean and try none")
    parser.add_argument("--sample", metavar="N", type=int, help="so many of them, drawn at random")
    parser.add_argument("--jobs", metavar="N", type=int, default=1, help="at a time")
    parser.add_argument("--full", action="store_true", help="the whole default suite on what survives")
    asked = parser.parse_args()
    mutants = [
        m for m in EVERY_MUTANT if not asked.only or {m.module, m.module.removesuffix(".py"), m.name} & set(asked.only)
    ]
    if asked.sample is not None:
        chosen = random.sample(mutants, min(asked.sample, len(mutants)))
        mutants = [mutant for mutant in mutants if mutant in chosen]
    if asked.list:
        for mutant in mutants:
            print(f"{mutant.module}: {mutant.name}: {mutant.meaning}")
        return
    results = Results(FOLDER / "results.jsonl")
    found: dict[str, dict[str, Any]] = {}
    for full in (False, True) if asked.full else (False,):
        left = [m for m in mutants if not full or found[m.name]["status"] == "survived"]
        for row in judge(left, results, asked.jobs, full=full):
            found[row["mutant"]] = row
            print(f"{row['status']:<9} {row['mutant']}: {row['killer']} ({row.get('seconds', 0)} s)", flush=True)
    print(f"\n{table(mutants, found)}")


if __name__ == "__main__":
    main()

"""Whole commands: from the shell's prompt to the next.

    python benchmarks/processes.py           (make bench)

*First run*: the cache folder is empty (`XDG_CACHE_HOME`), as after an installation, so that equations are derived,
kernels compiled and Matplotlib lists its fonts. *Later runs*: median of several. Seconds are elapsed time; the
processor time of all threads, which a busy machine changes less, is given in addition. The record is 100 s at 100 Hz of
the scale model.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from sheets import Sheet, number, present


def sheets(short: bool) -> Iterator[Sheet]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        record = str(folder / "record.nc")
        run(
            folder / "made",
            "simulate",
            "--turbine",
            "verne555",
            "--duration",
            "100",
            "--rate",
            "100",
            "--output",
            record,
        )
        identify = ("identify", record, "--turbine", "verne555", "--overwrite", "--output", str(folder / "result"))
        commands = {
            "windsysid --help": ("--help",),
            "windsysid identify --help": ("identify", "--help"),
            "windsysid turbines": ("turbines",),
            "windsysid identify --no-report": (*identify, "--no-report"),
            "windsysid identify": identify,
        }
        if not short:
            commands["windsysid study"] = ("study", "--overwrite", "--output", str(folder / "study"))
        rows, costs = [], {}
        for i, (title, command) in enumerate(commands.items()):
            cache = folder / f"cache{i}"
            first = run(cache, *command)
            later = np.median([run(cache, *command) for _ in range(1 if short else 3)], axis=0)
            rows.append((title, *map(number, (*first, *later))))
            costs |= {f"{title}, first run": first[0], f"{title}, later runs": float(later[0])}
        yield Sheet(
            "Whole commands, seconds",
            ("command", "first run", "of the processor", "later runs", "of the processor"), rows, costs,
        )  # fmt: skip


def run(cache: Path, *arguments: str) -> tuple[float, float]:
    """Seconds by the clock and of the processor."""
    surrounding = {k: v for k, v in os.environ.items() if k != "WINDSYSID_CACHE"} | {"XDG_CACHE_HOME": str(cache)}
    used, begun = _used(), time.perf_counter()
    command = [sys.executable, "-m", "windsysid", *arguments]
    said = subprocess.run(command, env=surrounding, capture_output=True, text=True, check=False)
    if said.returncode:
        raise SystemExit(f"windsysid {' '.join(arguments)} failed: {said.stderr.strip().splitlines()[-1]}")
    return time.perf_counter() - begun, _used() - used


def _used() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return children.ru_utime + children.ru_stime


if __name__ == "__main__":
    present(__doc__, sheets)

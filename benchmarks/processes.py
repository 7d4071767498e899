"""Whole commands: from the shell's prompt to the next.

    python benchmarks/processes.py           (make bench)

*First run*: the cache folder is empty (`XDG_CACHE_HOME`), as after an installation, so that equations are derived and
kernels compiled; `--short` leaves it out, and all commands share a cache. *Later runs*: median of five, or one of a
command that takes minutes. Seconds are elapsed time; the processor time of all threads, which a busy machine changes
less, is given in addition.

Records: the packaged examples of ten minutes (`building`: five channels at 50 Hz; `tower`: two at 20 Hz), 100 s at
100 Hz of the scale model, and ten minutes at 10 Hz of the NREL 5 MW turbine's rotor. pyOMA-2, where its environment
exists, reads the same building, identifies subspaces, and draws and saves its stabilisation diagram.
"""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from sheets import Sheet, number, present

PEERS = Path(__file__).resolve().parents[1] / ".venv-peers" / "bin" / "python"

RECORDS = 10
"""Setting: records of ten minutes in the folder for `batch`."""

LONG_SECONDS = 60.0
"""Setting: a command whose first run takes longer is repeated once."""

SUBSPACE = """
import logging, sys
import matplotlib
matplotlib.use("Agg")
import pandas as pd
from pyoma2.algorithms import SSI
from pyoma2.setup import SingleSetup
logging.disable(logging.CRITICAL)
read = pd.read_csv(sys.argv[1])
setup = SingleSetup(read.to_numpy()[:, 1:], fs=1.0 / (read.iloc[1, 0] - read.iloc[0, 0]))
setup.add_algorithms(SSI(name="SSI", method="cov", br=30, ordmax=40))
setup.run_by_name("SSI")
setup["SSI"].plot_stab(freqlim=(0.0, 15.0))[0].savefig(sys.argv[2])
"""


def sheets(short: bool) -> Iterator[Sheet]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows, costs = [], {}
        for i, (title, command) in enumerate(commands(folder, short=short).items()):
            cache = folder / ("made" if short else f"cache{i}")
            first = run(cache, *command)
            runs = 1 if short or first[0] > LONG_SECONDS else 5
            later = np.median([run(cache, *command) for _ in range(runs)], axis=0)
            rows.append((title, *(("", "") if short else map(number, first)), *map(number, later)))
            costs |= {} if short else {f"{title}, first run": first[0]}
            costs |= {f"{title}, later runs": float(later[0])}
        if PEERS.exists() and not short:
            script = [str(PEERS), "-c", SUBSPACE, str(folder / "building.csv"), str(folder / "stable.png")]
            peer = [execute(script, _surroundings()) for _ in range(4)]
            later = np.median(peer[1:], axis=0)
            rows.append(("pyOMA-2: subspaces and diagram of the building", *map(number, (*peer[0], *later))))
        yield Sheet(
            "Whole commands, seconds",
            ("command", "first run", "first, of the processor", "later runs", "later, of the processor"), rows, costs,
        )  # fmt: skip


def commands(folder: Path, *, short: bool = False) -> dict[str, tuple[str, ...]]:
    """Make the records in a folder; the commands by title."""
    made = folder / "made"
    run(made, "examples", str(folder))
    scale, rotor = str(folder / "scale.nc"), str(folder / "rotor.nc")
    run(made, "simulate", "--turbine", "verne555", "--duration", "100", "--rate", "100", "--output", scale)
    run(
        made, "simulate", "--turbine", "nrel5mw", "--loads", "wind", "--duration", "600", "--rate", "10", "--output",
        rotor,
    )  # fmt: skip
    for seed in map(str, range(1, RECORDS + 1)):
        to = str(folder / "archive" / f"{seed}.csv")
        run(made, "simulate", "--turbine", "tower", "--duration", "600", "--rate", "50", "--seed", seed, "--output", to)
    building, tower = str(folder / "building.csv"), str(folder / "tower_year1.csv")
    to = ("--overwrite", "--output", str(folder / "result"))
    answers = {
        "oma": ("oma", building, *to),
        "identify, tower": ("identify", tower, "--turbine", "tower", *to),
        "identify": ("identify", scale, "--turbine", "verne555", *to),
        "identify, rotor": ("identify", rotor, "--turbine", "nrel5mw", *to),
    }
    found = {
        "windsysid --help": ("--help",),
        "windsysid identify --help": ("identify", "--help"),
        "windsysid turbines": ("turbines",),
        "windsysid inspect": ("inspect", tower, *to),
        f"windsysid batch, {RECORDS} records": (
            "batch",
            str(folder / "archive"),
            "--turbine",
            "tower",
            "--workers",
            "1",
            "--output",
            str(folder / "rows"),
        ),
    }
    for title, command in answers.items():
        name, _, of = title.partition(",")
        found[f"windsysid {name} --no-report{',' if of else ''}{of}"] = (*command, "--no-report")
        found[f"windsysid {title}"] = command
    return found if short else found | {"windsysid study": ("study", "--overwrite", "--output", str(folder / "study"))}


def run(cache: Path, *arguments: str, source: Path | None = None) -> tuple[float, float]:
    """Seconds by the clock and of the processor of a command, of another checkout if its `source` is given."""
    around = _surroundings() | {"XDG_CACHE_HOME": str(cache)}
    around |= {} if source is None else {"PYTHONPATH": str(source)}
    if arguments[0] == "batch":  # which goes on with an archive
        shutil.rmtree(arguments[arguments.index("--output") + 1], ignore_errors=True)
    return execute([sys.executable, "-m", "windsysid", *arguments], around)


def _surroundings() -> dict[str, str]:
    """Variables of this environment except those that change what processes cost: modules are compiled once."""
    unset = ("WINDSYSID_CACHE", "OPENBLAS_NUM_THREADS", "PYTHONDONTWRITEBYTECODE")
    return {name: value for name, value in os.environ.items() if name not in unset}


def execute(command: Sequence[str], around: dict[str, str]) -> tuple[float, float]:
    """Seconds by the clock and of the processor of a process with an environment."""
    used, begun = _used(), time.perf_counter()
    said = subprocess.run(command, env=around, capture_output=True, text=True, check=False)
    if said.returncode:
        raise SystemExit(f"{' '.join(command)[:300]} failed: {said.stderr.strip().splitlines()[-1]}")
    return time.perf_counter() - begun, _used() - used


def _used() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return children.ru_utime + children.ru_stime


if __name__ == "__main__":
    present(__doc__, sheets)

"""One command in this checkout and in an older one, in turns: processor time and clock, start of Python included.

    git worktree add ../older COMMIT
    python benchmarks/before.py ../older [--runs 5] [--records 20]

The command is `identify --prior-scale 1.3 --no-report` of the reference record, 100 s of the scale model at 100 Hz, or
with ``--records`` `batch` of so many records of a tower, 10 minutes at 100 Hz as CSV, by one worker.
Both run in this environment, warm, each with a cache of its own.
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
START = "from windsysid.cli import main; main()"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("older", type=Path, help="another checkout of this repository")
    parser.add_argument("--runs", type=int, default=5, help="of each, after one that compiles")
    parser.add_argument("--records", type=int, default=0, help="take so many records by batch instead")
    options = parser.parse_args()
    checkouts = {"older": options.older.resolve(), "this": HERE}
    seen: dict[str, list[tuple[float, float]]] = {name: [] for name in checkouts}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        name, seconds = ("tower", 600) if options.records else ("verne555", 100)
        (folder / "records").mkdir()
        for seed in range(1, max(options.records, 1) + 1):
            made = ["simulate", "--turbine", name, "--duration", str(seconds), "--rate", "100", "--seed", str(seed)]
            run(checkouts["older"], folder, *made, "--output", str(folder / "records" / f"{seed}.csv"))
        for turn in range(options.runs + 1):
            for which, checkout in checkouts.items():
                result = folder / which / f"result{turn}"
                command = ["identify", str(folder / "records" / "1.csv"), "--prior-scale", "1.3", "--no-report"]
                if options.records:
                    command = ["batch", str(folder / "records"), "--workers", "1"]
                cost = run(checkout, folder / which, *command, "--turbine", name, "--output", str(result))
                if turn:
                    seen[which].append(cost)
    for which, costs in seen.items():
        used, clock = (statistics.median(column) for column in zip(*costs, strict=True))
        print(f"{which}: {used:.2f} s of the processor, {clock:.2f} s by the clock")
    ratios = [new[0] / old[0] for new, old in zip(seen["this"], seen["older"], strict=True)]
    print(f"this ÷ older, of the processor: {statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})")


def run(checkout: Path, folder: Path, *arguments: str) -> tuple[float, float]:
    """Seconds of the processor and by the clock."""
    folder.mkdir(exist_ok=True)
    unset = ("WINDSYSID_CACHE", "OPENBLAS_NUM_THREADS", "PYTHONDONTWRITEBYTECODE")
    kept = {name: value for name, value in os.environ.items() if name not in unset}
    around = kept | {"PYTHONPATH": str(checkout / "src"), "XDG_CACHE_HOME": str(folder / "cache")}
    before, begun = used(), time.perf_counter()
    said = subprocess.run(
        [sys.executable, "-c", START, *arguments], env=around, capture_output=True, text=True, check=False
    )
    if said.returncode:
        raise SystemExit(f"{checkout}: windsysid {' '.join(arguments)} failed: {said.stderr.strip()[-300:]}")
    return used() - before, time.perf_counter() - begun


def used() -> float:
    """Processor time of all processes that have ended [s]."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return children.ru_utime + children.ru_stime


if __name__ == "__main__":
    main()

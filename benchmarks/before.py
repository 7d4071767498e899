"""The commands of `processes.py` in this checkout and in an older one, in turns: processor time, start of Python
included.

    git worktree add ../older COMMIT
    python benchmarks/before.py ../older [--runs 5] [--only TEXT]

Both run in this environment, warm, each with a cache of its own, on the same records.
"""

import argparse
import statistics
import tempfile
from pathlib import Path

from processes import commands, run
from rich.console import Console
from sheets import Sheet, number

HERE = Path(__file__).resolve().parents[1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("older", type=Path, help="another checkout of this repository")
    parser.add_argument("--runs", type=int, default=5, help="of each, after one that compiles")
    parser.add_argument("--only", default="", help="commands whose title contains this")
    options = parser.parse_args()
    checkouts = {"older": options.older.resolve() / "src", "this": HERE / "src"}
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title, command in commands(folder, short=True).items():
            if options.only not in title:
                continue
            seen: dict[str, list[float]] = {which: [] for which in checkouts}
            for turn in range(options.runs + 1):
                for which, source in checkouts.items():
                    used = run(folder / which, *command, source=source)[1]
                    seen[which] += [used] if turn else []
            ratios = [new / old for new, old in zip(seen["this"], seen["older"], strict=True)]
            medians = [statistics.median(costs) for costs in (*seen.values(), ratios)]
            rows.append((title, *map(number, medians), f"{min(ratios):.2f} to {max(ratios):.2f}"))
    headings = ("command", "older", "this", "this ÷ older", "over the turns")
    Console(width=140).print(Sheet("Processor time, seconds", headings, rows, {}).table(), highlight=False)


if __name__ == "__main__":
    main()

"""`compare` on windows of OpenFAST records: false alarms between windows of one record, and a tower that is softer.

``python -m validation.window_pairs --openfast FOLDER`` identifies windows as `validation.windows` does, from two
accelerometers and a tower file, and compares all ordered pairs of windows of one record that share no time, and all
pairs of a record with that of the changed machine: the 5 MW turbine with 90 % of its side-side tower stiffness, and the
15 MW turbine on 70 % of its soil stiffness. Without a change odds exceed x : 1 in no more than one case of x (Markov's
inequality), and the probability `chance` is below p in a share p of the cases.
"""

import argparse
import itertools
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from validation.field import markdown
from validation.windows import RECORDS, Window, turbine_of, windows
from windsysid.errors import WindsysidError
from windsysid.identification.identify import identify
from windsysid.monitoring.change import QuantityChange
from windsysid.monitoring.comparison import compare
from windsysid.records.formats import read_record
from windsysid.results.identification import Identification

__all__ = ["main"]

CHANGED = {"c2": "d1", "m1": "m2"}
"""Records of a machine and of the same machine after its side-side stiffness was changed."""

LEVELS = (0.01, 0.1, 0.5)
"""Probabilities for which false alarms are counted."""


def found_in(folder: Path, window: Window) -> Identification | None:
    """Identify a window; None where that ends in an error."""
    machine = RECORDS[window.record]
    try:
        record = read_record(folder / f"{machine.file}.outb")
        return identify(record, turbine_of(machine), section=window[1:])
    except WindsysidError:
        return None


def same_record(done: Sequence[tuple[Window, Identification]]) -> list[QuantityChange]:
    """Changes of coefficients that both results may be requested, of windows of one record without common time."""
    changes = []
    for (one, before), (other, after) in itertools.permutations(done, 2):
        apart = one.last <= other.first or other.last <= one.first
        if one.record == other.record and apart:
            unusable = {e.name for found in (before, after) for e in found.estimates if e.grade == "C"}
            changes += [c for c in compare(before, after).coefficients if c.name not in unusable]
    return changes


def false_alarms(changes: Sequence[QuantityChange], which: str) -> tuple[str, ...]:
    """A row of the table: share of coefficients with a probability below each level, and with odds beyond its
    inverse."""
    some = [c for c in changes if c.name.startswith(which)]
    chance, odds = np.array([c.chance for c in some]), np.array([c.log_odds for c in some])
    shares = [f"{np.mean(chance < level):.1%}" for level in LEVELS]
    beyond = [f"{np.mean(odds > -np.log(level)):.1%}" for level in LEVELS[:2]]
    return (which or "all", str(len(some)), *shares, *beyond)


def detections(done: Sequence[tuple[Window, Identification]], before: str, after: str) -> tuple[str, ...]:
    """A row of the table: pairs of windows of two records, and those in which side-side stiffness moved."""
    pairs = [(a, b) for one, a in done for other, b in done if (one.record, other.record) == (before, after)]
    found = [c for a, b in pairs for c in compare(a, b).coefficients if c.name == "k_side_side"]
    truth = 100.0 * ((RECORDS[after].side_side / RECORDS[before].side_side) ** 2 - 1.0)
    held = sum(c.low <= truth <= c.high for c in found)
    moved, percent = sum(c.moved for c in found), np.median([c.percent for c in found])
    return (f"{before}, {after}", str(len(pairs)), str(moved), f"{percent:.1f}", f"{truth:.1f}", str(held))


def main() -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(prog="python -m validation.window_pairs", description=__doc__.splitlines()[0])
    parser.add_argument("--openfast", type=Path, required=True, help="folder of the records (*.outb)")
    parser.add_argument("--records", nargs="+", default=list(RECORDS), help="names of records (all)")
    parser.add_argument("--seconds", nargs="+", type=float, default=[270.0, 180.0], help="lengths of windows")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    parts = list(windows(asked.records, asked.seconds))
    with ProcessPoolExecutor(asked.jobs) as pool:
        results = list(pool.map(found_in, [asked.openfast] * len(parts), parts))
    done = [(part, found) for part, found in zip(parts, results, strict=True) if found is not None]
    changes = same_record(done)
    print(f"{len(done)} of {len(parts)} windows of {', '.join(f'{s:g}' for s in asked.seconds)} s\n")
    headings = ["coefficients", "pairs", *(f"p < {level:g}" for level in LEVELS)]
    headings += [f"odds > {1.0 / level:g} : 1" for level in LEVELS[:2]]
    print("Pairs of windows of one record, coefficients of grade A or B in both:\n")
    print(markdown(headings, [false_alarms(changes, which) for which in ("", "k_", "c_")]))
    headings = ["records", "pairs", "k_side_side moved", "median change [%]", "truth [%]", "±2σ holds"]
    rows = [detections(done, *pair) for pair in CHANGED.items() if set(pair) <= set(asked.records)]
    print(f"\nRecords of a machine before and after a change:\n\n{markdown(headings, rows)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())

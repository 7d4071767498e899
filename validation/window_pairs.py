"""Calibration of `compare` on windows of OpenFAST records: false alarms, detections, and what its odds are worth.

``python -m validation.window_pairs --openfast FOLDER`` identifies windows as `validation.windows` does, from two
accelerometers and a tower file, and compares every two windows of one machine that have no time in common. Exchanging
the two gives the same odds, so each pair counts once. Results are kept in ``--output``, so that a run that was stopped
goes on; results of another version are not noticed there.

The machines are the NREL 5 MW turbine on land (c2, and d1 with side-side stiffness × 0.90), and the IEA 15 MW turbine
at sea: on a monopile (k, m1; parked: p), on soil of 70 % of the stiffness (m2), and clamped (l). Without a change odds
exceed x : 1 in no more than one case of x (Markov's inequality), and the probability `chance` is below p in a share p.
Windows of one record share the mean wind, c2 and d1 the same turbulence, and each window is in many pairs: shares
scatter more than their counts suggest.

Odds are posterior odds from even prior odds. The reliability table weights changed and unchanged stiffnesses equally.
"""

import argparse
import itertools
import math
import pickle
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from validation.field import markdown
from validation.windows import RECORDS, Window, turbine_of, windows
from windsysid.errors import WindsysidError
from windsysid.identification.identify import identify
from windsysid.monitoring.change import MIN_CHANGE_ODDS, Comparison, QuantityChange
from windsysid.monitoring.comparison import compare
from windsysid.records.formats import read_record
from windsysid.reports.html import Section, report_page
from windsysid.reports.interactive.plot import Axis, Plot, PlotCurve
from windsysid.results.posterior import Posterior

__all__ = ["main"]

STRUCTURES = {"c": "land", "d": "land", "l": "clamped", "m2": "soil"}
"""Structures by the beginning of a record's name; the others stand on a monopile."""

LEVELS = (0.01, 0.05)
"""Probabilities for which false alarms are counted."""

ODDS = (0.0, 0.1, 1 / 3, 1.0, 3.0, 10.0, 100.0, math.inf)
"""Edges of the odds of the reliability table."""

MIN_CHANGE_PERCENT = 1.0
"""Change of a stiffness between two structures [%] that counts as one; winds change a frequency by 0.1 %."""


class Pair(NamedTuple):
    """Two windows and what `compare` says of them, or why it refuses them."""

    before: Window
    after: Window
    found: Comparison | None
    refused: str = ""
    unusable: frozenset[str] = frozenset()
    same_state: bool = True

    @property
    def one_record(self) -> bool:
        """True if both windows are of one record."""
        return self.before.record == self.after.record

    def truth(self, name: str) -> float:
        """Change of a stiffness [%], by the frequencies of the linearised structures."""
        mode = name.removeprefix("k_")
        a, b = (float(getattr(RECORDS[one.record], mode)) for one in (self.before, self.after))
        return 100.0 * ((b / a) ** 2 - 1.0)

    def moved(self, name: str) -> bool:
        """True if the structures differ in this stiffness."""
        names = self.before.record, self.after.record
        return _structure(names[0]) != _structure(names[1]) and abs(self.truth(name)) > MIN_CHANGE_PERCENT


def _structure(record: str) -> str:
    if record == "d1":
        return "land, softer"
    return STRUCTURES.get(record) or STRUCTURES.get(record[0], "monopile")


def found_in(folder: Path, kept: Path, window: Window) -> Posterior | str:
    """Identify a window, or take it from the folder that keeps results; the error where it ends in one."""
    path, machine = kept / f"{window.record}_{window.first:g}_{window.last:g}.pickle", RECORDS[window.record]
    if not path.exists():
        try:
            record = read_record(folder / f"{machine.file}.outb")
            found: Posterior | str = identify(record, turbine_of(machine), section=window[1:]).posterior
        except WindsysidError as error:
            found = str(error)
        path.with_suffix(".part").write_bytes(pickle.dumps(found))
        path.with_suffix(".part").replace(path)
    return pickle.loads(path.read_bytes())  # type: ignore[no-any-return]


def pairs_of(done: Sequence[tuple[Window, Posterior]]) -> list[Pair]:
    """Every two windows of one machine without common time, compared."""
    pairs = []
    for (one, before), (other, after) in itertools.combinations(done, 2):
        apart = one.record != other.record or one.last <= other.first or other.last <= one.first
        if not apart or RECORDS[one.record].place != RECORDS[other.record].place:
            continue
        same = (before.turbine.aerodynamic_tolerance > 0.0) == (after.turbine.aerodynamic_tolerance > 0.0)
        try:
            found, refused = compare(before, after), ""
        except WindsysidError as error:
            found, refused = None, str(error).partition(": ")[2]
        pairs.append(Pair(one, other, found, refused, frozenset((*before.unusable, *after.unusable)), same))
    return pairs


def changes_in(pairs: Sequence[Pair], *, grade_c: bool = False) -> list[tuple[Pair, QuantityChange]]:
    """Coefficients of pairs, with or without those of grade C in either result."""
    return [
        (pair, change)
        for pair in pairs
        for change in (pair.found.coefficients if pair.found else ())
        if grade_c or change.name not in pair.unusable
    ]


def unchanged(pairs: Sequence[Pair]) -> list[Pair]:
    """Pairs of one structure in one state, operating or parked."""
    return [one for one in pairs if _structure(one.before.record) == _structure(one.after.record) and one.same_state]


def false_alarms(label: str, changes: Sequence[QuantityChange]) -> tuple[str, ...]:
    """A row: shares of coefficients with a probability below each level, and with odds beyond 10 and 100."""
    chance, odds = (np.array([getattr(c, what) for c in changes]) for what in ("chance", "log_odds"))
    shares = [np.mean(chance < level) for level in LEVELS] + [np.mean(odds > math.log(x)) for x in (10.0, 100.0)]
    return (label, str(len(changes)), *(f"{share:.1%}" for share in shares))


def alarm_table(pairs: Sequence[Pair]) -> str:
    """False alarms by coefficient, of windows of one record, of different records, and of a parked and an operating
    tower, whose damping differs."""
    still = [one for one in pairs if _structure(one.before.record) == _structure(one.after.record)]
    rows = []
    for where, some in (
        ("one record", [one for one in still if one.one_record]),
        ("other records", [one for one in still if one.same_state and not one.one_record]),
        ("same state", [one for one in still if one.same_state]),
        ("parked, operating", [one for one in still if not one.same_state]),
    ):
        changes = [change for _, change in changes_in(some)]
        for name in ("", *sorted({change.name for change in changes})) if changes else ():
            own = [change for change in changes if name in ("", change.name)]
            rows.append(false_alarms(f"{where}: {name or 'A or B'}", own))
        if changes:
            rows.append(false_alarms(f"{where}: A, B or C", [c for _, c in changes_in(some, grade_c=True)]))
    return markdown(["coefficients", "n", *(f"p < {level:g}" for level in LEVELS), "odds > 10", "odds > 100"], rows)


def reliability(pairs: Sequence[Pair]) -> list[tuple[str, int, int, float, float]]:
    """Of each range of odds its name, counts of unchanged and changed stiffnesses, their mean stated probability of a
    change, and the observed one, both kinds weighted equally."""
    stated = [
        (change.log_odds, pair.moved(change.name)) for pair, change in changes_in(pairs) if change.kind == "stiffness"
    ]
    odds, moved = np.array([one[0] for one in stated]), np.array([one[1] for one in stated], dtype=bool)
    probability = 1.0 / (1.0 + np.exp(-odds))
    weight = np.where(moved, 1.0 / max(moved.sum(), 1), 1.0 / max((~moved).sum(), 1))
    rows = []
    for low, high in itertools.pairwise(ODDS):
        within = (np.exp(np.minimum(odds, 700.0)) >= low) & (np.exp(np.minimum(odds, 700.0)) < high)
        if within.any():
            mean, seen = (float(np.average(x[within], weights=weight[within])) for x in (probability, moved))
            rows.append((_between(low, high), int((within & ~moved).sum()), int((within & moved).sum()), mean, seen))
    return rows


def _between(low: float, high: float) -> str:
    """A range of odds in words."""
    ends = [f"{x:.0f} : 1" if x >= 1.0 else f"1 : {1.0 / x:.0f}" if x else "" for x in (low, high)]
    return f"below {ends[1]}" if not low else f"above {ends[0]}" if math.isinf(high) else " … ".join(ends)


def detections(pairs: Sequence[Pair]) -> list[tuple[str, ...]]:
    """A row of side-side stiffness for every two structures, and for c2 and d1 every shorter window of the two."""
    groups: dict[str, list[tuple[Pair, QuantityChange]]] = {}
    for pair, change in changes_in(pairs, grade_c=True):
        if change.name == "k_side_side" and pair.moved(change.name):
            names = " → ".join(sorted(_structure(one.record) for one in (pair.before, pair.after)))
            shorter = min(one.last - one.first for one in (pair.before, pair.after))
            groups.setdefault(f"{names}, {shorter:g} s", []).append((pair, change))
    return [_detected(label, some) for label, some in sorted(groups.items())]


def _detected(label: str, some: Sequence[tuple[Pair, QuantityChange]]) -> tuple[str, ...]:
    """How many changes were found, and how well."""
    usable = [one for one in some if one[1].name not in one[0].unusable]
    held = sum(change.low <= pair.truth(change.name) <= change.high for pair, change in usable)
    moved, suspect = (sum(getattr(change, how) for _, change in usable) for how in ("moved", "suspect"))
    off = [change.percent - pair.truth(change.name) for pair, change in usable]
    truth = float(np.median([abs(pair.truth(change.name)) for pair, change in some]))
    error = f"{np.median(off):+.1f}" if off else ""
    return (label, f"{truth:.1f}", str(len(some)), str(len(usable)), str(moved), str(suspect), error, str(held))


def page_of(rows: Sequence[tuple[str, int, int, float, float]], text: str) -> bytes:
    """The reliability diagram as a page."""
    stated, observed = np.array([row[3:] for row in rows]).T
    curves = [
        PlotCurve("observed", observed, look="dots"),
        PlotCurve("calibrated", stated, colour="reference", dashed=True),
    ]
    plot = Plot("Reliability", stated, curves, Axis("stated probability of a change"), Axis("observed frequency"))
    return report_page("What the odds of compare are worth", text, [Section("Stiffness", plots=[plot], file=text)])


def report(pairs: Sequence[Pair]) -> tuple[str, list[tuple[str, int, int, float, float]]]:
    """All tables as text, and the rows of the reliability table."""
    still = [one for one in unchanged(pairs) if one.found]
    refused = [one.refused for one in pairs if one.refused]
    mixed = [one for one in pairs if not one.same_state]
    alarms = sum(any(c.name not in one.unusable for c in one.found.moved) for one in still if one.found)
    rows = reliability(pairs)
    shown = [(label, str(no), str(yes), f"{stated:.3f}", f"{seen:.3f}") for label, no, yes, stated, seen in rows]
    told = [
        f"{len(pairs)} pairs; {len(refused)} refused{''.join(f': {why}' for why in sorted(set(refused)))};"
        f" {len(mixed)} of a parked and an operating tower",
        f"{len(still)} of one structure and state: 'changed' at {MIN_CHANGE_ODDS:g} : 1 in {alarms}"
        f" ({alarms / max(len(still), 1):.2%})",
        alarm_table(pairs),
        markdown(["odds of a change", "unchanged", "changed", "stated probability", "observed"], shown),
        markdown(
            ["k_side_side", "truth ± [%]", "pairs", "A or B", "changed", "suspected", "median error [%]", "±2σ holds"],
            detections(pairs),
        ),
    ]  # fmt: skip
    return "\n\n".join(told), rows


def main() -> int:
    """Print the tables and write the page."""
    parser = argparse.ArgumentParser(prog="python -m validation.window_pairs", description=__doc__.splitlines()[0])
    parser.add_argument("--openfast", type=Path, required=True, help="folder of the records (*.outb)")
    parser.add_argument("--output", type=Path, default=Path("build/window_pairs"), help="folder of results and page")
    parser.add_argument("--records", nargs="+", default=list(RECORDS), help="names of records (all)")
    parser.add_argument("--seconds", nargs="+", type=float, default=[270.0, 180.0], help="lengths of windows")
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args()
    asked.output.mkdir(parents=True, exist_ok=True)
    parts = list(windows(asked.records, asked.seconds))
    with ProcessPoolExecutor(asked.jobs) as pool:
        results = list(pool.map(found_in, [asked.openfast] * len(parts), [asked.output] * len(parts), parts))
    done = [(part, found) for part, found in zip(parts, results, strict=True) if not isinstance(found, str)]
    text, rows = report(pairs_of(done))
    print(f"{len(done)} of {len(parts)} windows of {', '.join(f'{s:g}' for s in asked.seconds)} s\n\n{text}")
    (asked.output / "reliability.html").write_bytes(page_of(rows, text))
    return 0


if __name__ == "__main__":
    sys.exit(main())

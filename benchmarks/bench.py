"""The whole benchmark: `make bench`.

    python benchmarks/bench.py --peers .venv-peers/bin/python [--short] [--only PART …]

Every part runs in a process of its own, one after the other: those that compare with other libraries in the peers'
environment. The tables go to docs/performance_tables.md, the numbers to benchmarks/results.json. Before it replaces
that file it compares windsysid's costs with those committed there, both as ratios to the C reference of their own run,
which takes the machine out, and names what got slower by more than 15 %. `--short` leaves out the long cases, compares,
and writes nothing. `--only PART …` measures these parts alone, and keeps the tables of the others under the commit at
which they were measured.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path

import speed
from rich.console import Console
from roofline import SIZES
from sheets import Sheet, number

from windsysid.filters import EKF
from windsysid.filters.bank import LANES

HERE = Path(__file__).parent
RESULTS, PAGE = HERE / "results.json", HERE.parent / "docs" / "performance_tables.md"

OURS, THEIRS = ("speed", "roofline", "processes", "scaling", "growth", "compiling"), ("peers", "smc")
"""Parts, by the environment that they run in."""

COMMANDS = {
    "windsysid --help": 0.25, "windsysid identify --help": 0.25, "windsysid turbines": 0.25, "windsysid inspect": 0.8,
    "windsysid oma --no-report": 1.0, "windsysid oma": 1.4, "windsysid identify --no-report, tower": 1.2,
    "windsysid identify, tower": 1.6, "windsysid identify --no-report": 2.5, "windsysid identify": 2.9,
    "windsysid identify --no-report, rotor": 3.0, "windsysid identify, rotor": 3.4,
}  # fmt: skip
"""Targets of whole commands in later runs [s of the processor]."""

FLOORS, BANK = ("÷ C", "÷ C, vectors"), (f"the same, {LANES} side by side, each",)
"""Headings of the C references, and the row of the bank's lanes."""

SUBSPACES = "pyOMA-2: subspaces and diagram of the building"
"""Row of the script that does with pyOMA-2 what `oma` does."""

LONG = ("smc",)
"""Parts that have no short form."""

SLOWER = 1.15
"""Ratio of costs from which a part is named."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peers", help="Python of the peers' environment; without it they are left out")
    parser.add_argument("--short", action="store_true", help="leave out the long cases, write nothing")
    parser.add_argument("--only", nargs="+", choices=(*OURS, *THEIRS), help="measure these parts, keep the others")
    given = parser.parse_args()
    console = Console(width=140)
    about = [*speed.surroundings(), *_peer_versions(given.peers)]
    console.print("\n".join(about), highlight=False)
    sheets: list[Sheet] = []
    for python, parts in ((sys.executable, OURS), (given.peers, THEIRS)):
        for part in parts:
            if given.only and part not in given.only:
                continue
            if python is None:
                console.print(f"{part} left out: no environment of the peers")
            elif given.short and part in LONG:
                console.print(f"{part} left out: it takes minutes")
            else:
                sheets += run(python, part, given.short)
    judged = targets(sheets)
    console.print(judged.table(), highlight=False)
    costs = {name: cost for sheet in sheets for name, cost in sheet.costs.items()}
    floor = find(sheets, "One core", (EKF.name,), "C")
    earlier = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {"floor": None, "costs": {}}
    slower = compared(costs, floor, earlier)
    if slower is None:
        console.print("not compared with an earlier benchmark: there is none, or no C reference in one of the two")
    else:
        console.print(slower.table() if slower.rows else "nothing got slower by more than 15 %", highlight=False)
    if not given.short:
        new = {sheet.title for sheet in sheets}
        kept = [one for one in earlier.get("tables", []) if given.only and one["sheet"]["title"] not in new]
        if floor:
            costs |= _kept_costs(costs, floor, earlier if kept else None)
        else:  # costs without a C reference of their own run cannot be compared
            floor, costs = earlier["floor"], earlier["costs"]
        write(about, floor, costs, sheets, kept)


def write(
    about: list[str], floor: float | None, costs: dict[str, float], sheets: Sequence[Sheet], kept: list[dict]
) -> None:
    """Write the numbers and the page; `kept` are tables of earlier runs, each with what that run was."""
    tables = [{"about": about, "sheet": sheet._asdict()} for sheet in sheets] + kept
    numbers = {"about": about, "floor": floor, "costs": costs, "tables": tables}
    RESULTS.write_text(json.dumps(numbers, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    judged = targets([*sheets, *(Sheet(**one["sheet"]) for one in kept)])
    PAGE.write_text(page(about, [judged, *sheets], kept), encoding="utf-8")


def _kept_costs(costs: dict[str, float], floor: float | None, earlier: dict | None) -> dict[str, float]:
    """Costs that were not measured again, in the units of this run's C reference."""
    if earlier is None or not (floor and earlier["floor"]):
        return {}
    return {name: cost * floor / earlier["floor"] for name, cost in earlier["costs"].items() if name not in costs}


def run(python: str, part: str, short: bool) -> list[Sheet]:
    """A part's tables, printed as they come."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sheets.json"
        command = [python, str(HERE / "sheets.py"), part, "--json", str(path), *(["--short"] if short else [])]
        subprocess.run(command, check=True)
        return [Sheet(**sheet) for sheet in json.loads(path.read_text(encoding="utf-8"))]


def compared(costs: dict[str, float], floor: float | None, earlier: dict) -> Sheet | None:
    """Costs that rose since an earlier benchmark, each relative to its own C reference; None where that is missing."""
    if not (floor and earlier["floor"]):
        return None
    rows = []
    for name, cost in costs.items():
        before, now = earlier["costs"].get(name, 0.0) / earlier["floor"], cost / floor
        if before and now > SLOWER * before:
            rows.append((name, number(before), number(now), number(now / before)))
    return Sheet(
        "Slower than in benchmarks/results.json, in units of the C reference", ("", "then", "now", "÷"), rows, {}
    )


def targets(sheets: Sequence[Sheet]) -> Sheet:
    """The targets, and what this run has of them."""
    extended = partial(find, sheets, "joint, extended", heading="÷ windsysid")
    peers = [
        extended(row)
        for row in (("filterpy", "NumPy"), ("Stone-Soup", "NumPy"), ("dynamax", "XLA"), ("cuthbert", "XLA"))
    ]
    turbines, processes = partial(find, sheets, "Turbines"), partial(find, sheets, "Whole commands")
    answer, peer = (processes((row,), "later, of the processor") for row in ("windsysid oma", SUBSPACES))
    many, ten = turbines(("1000",), "µs per sample"), turbines(("10",), "µs per sample")
    floors = [find(sheets, "One core", (EKF.name,), variant) for variant in FLOORS]
    particles = "2000 particles, 10000 samples"
    rows = [
        _judged("joint EKF ÷ the faster C", 1.3, max((ratio for ratio in floors if ratio), default=None)),
        _judged(
            f"{BANK[0]}: ÷ the faster C",
            1.3,
            max((ratio for ratio in (find(sheets, "One core", BANK, v) for v in FLOORS) if ratio), default=None),
        ),
        *(
            _judged(
                f"spectral likelihood, {m} readings, {r} modes ÷ C",
                1.3,
                find(sheets, "Spectral likelihood", (str(m), str(r)), "÷ C"),
            )
            for m, r in SIZES
        ),
        _judged("fastest peer ÷ joint EKF", -10.0, min((ratio for ratio in peers if ratio), default=None)),
        _judged("filterpy on windsysid's compiled equations ÷ joint EKF", -10.0, extended(("filterpy", "windsysid's"))),
        _judged("filterpy by differences ÷ joint EKF", -300.0, extended(("filterpy", "NumPy, differences"))),
        _judged("filterpy with exact Jacobians in NumPy ÷ joint EKF", -300.0, extended(("filterpy", "NumPy"))),
        _judged(
            "SIR, 2000 particles, 10 000 samples, s",
            2.0,
            find(sheets, particles, ("windsysid, 2 threads",), "clock s"),
        ),
        _judged("particles ÷ SIR, one thread each", -20.0, find(sheets, particles, ("particles",), "÷ ours")),
        _judged("1000 turbines at 100 Hz, × real time", -1.0, turbines(("1000",), "× real time")),
        _judged("a sample among 1000 turbines ÷ among 10", 1.1, many / ten if many and ten else None),
        *(
            _judged(f"{row}, processor s", bound, processes((row,), "later, of the processor"))
            for row, bound in COMMANDS.items()
        ),
        _judged("windsysid oma ÷ pyOMA-2's subspaces and diagram", 1.0, answer / peer if answer and peer else None),
        _judged(
            "windsysid identify, first run, processor s",
            6.0,
            processes(("windsysid identify",), "first, of the processor"),
        ),
    ]
    return Sheet("Targets", ("", "target", "measured", ""), rows, {})


def _judged(title: str, bound: float, found: float | None) -> tuple[str, ...]:
    """A row: at most `bound`, or at least −`bound` where that is negative."""
    target = f"≤ {bound:g}" if bound > 0.0 else f"≥ {-bound:g}"
    if found is None:
        return title, target, "", "not measured"
    return title, target, number(found), "hit" if (found <= bound if bound > 0.0 else found >= -bound) else "MISS"


def find(sheets: Iterable[Sheet], title: str, row: tuple[str, ...], heading: str) -> float | None:
    """The number under a heading in the row that begins with these cells, in a table whose title begins so."""
    for sheet in sheets:
        if sheet.title.startswith(title) and heading in sheet.headings:
            for cells in sheet.rows:
                value = cells[sheet.headings.index(heading)].replace(" ", "")
                if tuple(cells[: len(row)]) == row and value:
                    return float(value)
    return None


def page(about: Iterable[str], sheets: Iterable[Sheet], kept: Iterable[dict] = ()) -> str:
    """The tables as Markdown; those that were not measured again stand last, with what their run was."""
    lines = ["<!-- Written by `make bench`. -->", "", "# The tables of speed", "", *(f"- {line}" for line in about)]
    for sheet in sheets:
        lines += ["", sheet.markdown()]
    before: list[str] = []
    for one in kept:
        if one["about"] != before:
            before = one["about"]
            lines += ["", "## Not measured again", "", *(f"- {line}" for line in before)]
        lines += ["", Sheet(**one["sheet"]).markdown()]
    return "\n".join(lines) + "\n"


def _peer_versions(python: str | None) -> Iterable[str]:
    """Versions of the libraries compared with."""
    if python is None:
        return
    pins = (HERE / "peers.txt").read_text(encoding="utf-8").splitlines()
    names = [pin.split("==")[0] for pin in pins if pin and not pin.startswith("#")]
    script = (
        "import sys; from importlib.metadata import version; print(', '.join(f'{n} {version(n)}' for n in"
        " sys.argv[1:]))"
    )
    yield subprocess.run([python, "-c", script, *names], capture_output=True, text=True, check=True).stdout.strip()


if __name__ == "__main__":
    main()

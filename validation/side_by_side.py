"""Compare this checkout with another one on the same records: grades, coverage, interval widths and processor time.

``python -m validation.side_by_side --other TREE [--only SET …] [--kinds NAME …] [--runs N] [--openfast FOLDER]``
simulates records with the generators of this checkout's validation modules. Both checkouts analyse each in turns, each
in a process of its own. Results are kept in a folder as they come: an interrupted command continues, and ``--kept``
prints the tables of all that is there. TREE must not need other packages than this checkout.

A quantity is usable with grade A or B; in a checkout without grades, if the result or the mode is trusted. Errors are
in standard deviations of the intervals, in the coordinate, value or logarithm, in which these are symmetric.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["kinds", "main", "scored", "shifts", "summary_rows"]

ROOT = Path(__file__).parents[1]
FOLDER = Path("results/side_by_side")
SIDES = ("other", "this")
SETS = ("spectral", "calibration", "towers", "oma", "adversary", "auto", "field_spectral")

Run = dict[str, Any]
Made = tuple[Any, Any, Run]
"""Record, true values by name (of modes: pairs of frequency and damping ratio), and options of `analyse`."""


def kinds(which: str, openfast: Path | None = None) -> Iterator[tuple[str, bool, Callable[[int], Made]]]:
    """Kinds of records of a set: name, whether they are healthy, and what makes the record of a seed."""
    import windsysid as ws
    from validation import auto, calibration, field, field_spectral, mismatch, oma, spectral, towers
    from validation.adversary.scenarios import HEALTHY, SCENARIOS, record, scenario

    def exact(machine: str, loads: str, make: Callable[[int], Any], options: Run, seed: int) -> Made:
        turbine = mismatch.total_coefficients(ws.load_turbine(machine).exact(), loads, seed)
        truth = {name: turbine.values[name] for name in turbine.model.coefficients if turbine.values[name]}
        return make(seed), truth, {"turbine": machine, "exact": True, "values": truth, "seed": seed, **options}

    def tower(name: str, seed: int) -> Made:
        return *towers.simulate(name, seed), {"turbine": "tower", "seed": seed}

    def adverse(name: str, seed: int) -> Made:
        one = scenario(name, seed)
        return record(name, seed), one.machine.truth, {
            "turbine": "verne555", "seed": seed, "formulation": one.formulation
        }  # fmt: skip

    def operational(make: Callable[[int], tuple[Any, Any]], seed: int) -> Made:
        return *make(seed), {}

    def window(label: str, section: tuple[float, float], seed: int) -> Made:
        assert openfast is not None
        return ws.read_record(openfast / field.FILES[label]), field_spectral.truth_of(label), {
            "turbine": field.ROTOR, "exact": True, "seed": seed, "uniform": True, "formulation": "spectral",
            "section": section,
        }  # fmt: skip

    if which == "spectral":
        for loads in spectral.LOADS:
            yield loads, True, partial(
                exact, "verne555", loads, auto.simulated("verne555", loads), {"formulation": "spectral"}
            )  # fmt: skip
    elif which == "calibration":
        one = calibration.scenarios()["reference"]
        make = partial(one.record, one.turbine)
        yield "reference", True, partial(exact, "verne555", "random", make, {"formulation": "joint"})
    elif which == "towers":
        yield from ((name, name == "healthy", partial(tower, name)) for name in towers.KINDS)
    elif which == "adversary":
        yield from ((name, one.wrong == HEALTHY, partial(adverse, name)) for name, one in SCENARIOS.items())
    elif which == "auto":
        yield from ((name, False, partial(exact, *one, {})) for name, one in auto.KINDS.items())
    elif which == "field_spectral" and openfast is not None:
        sections = field.WINDY, *field_spectral.windows(270.0), *field_spectral.windows(120.0)
        for label, (start, end) in product(("c2", "d1"), sections):
            yield f"{label}, {start:g} … {end:g} s", True, partial(window, label, (start, end))
    elif which == "oma":
        yield from ((name, ok, partial(operational, make)) for name, ok, make in _structures(oma))


def _structures(oma: Any) -> Iterator[tuple[str, bool, Callable[[int], Any]]]:
    """Records of structures with known modes."""
    yield "four modes apart", True, oma.modes_apart_record
    yield "frame of 5 storeys", True, partial(oma.frame_record, 5)
    yield from ((f"one load {name}", True, partial(oma.shared_load_record, load)) for name, load in oma.SHARED.items())
    yield "sea", False, oma.sea_record
    yield from ((f"machine ± {100 * x:g} %", False, partial(oma.machine_record, x)) for x in (0.003, 0.01, 0.03))
    yield from ((f"load as f^{x}", True, partial(oma.steep_load_record, x)) for x in oma.SLOPES)


def work() -> None:
    """Analyse the records that standard input names, with the checkout that is first on the path."""
    out, sys.stdout = sys.stdout, sys.stderr
    for line in sys.stdin:
        print(json.dumps(analyse(**json.loads(line))), file=out, flush=True)


def analyse(record: str, seed: int = 0, *, exact: bool = False, uniform: bool = False, **options: Any) -> Run:
    """Processor time [s] and estimates, or modes where no turbine is given; the prior is drawn with a seed."""
    import windsysid as ws

    with np.load(record) as kept:
        made = ws.Record(kept["time"], kept["values"], tuple(kept["channels"]), tuple(kept["units"]), name="simulated")
    begun = time.process_time()
    if "turbine" not in options:
        modes = [_operational(mode) for mode in ws.oma(made).modes]
        return {"modes": modes, "seconds": time.process_time() - begun}
    turbine = ws.load_turbine(options.pop("turbine"))
    turbine = (turbine.exact() if exact else turbine).with_values(options.pop("values", {}))
    if uniform:
        from validation.field import AIR, LogUniformPrior

        prior: Any = LogUniformPrior(seed=seed, air=AIR)
    else:
        from windsysid.study.drawn_prior import DrawnPrior

        prior = DrawnPrior(seed=seed)
    try:
        found: Any = ws.identify(made, turbine, prior=prior, **options)  # attributes differ between checkouts
    except ws.WindsysidError as error:
        return {"refused": str(error), "seconds": time.process_time() - begun}
    seconds, verdict, quantities = time.process_time() - begun, "A" if found.diagnosis.trusted else "C", {}
    for e, q in zip(found.estimates, found.parameters, strict=True):
        three = [(e.tip or {}).get(key, getattr(e, key)) if uniform else getattr(e, key) for key in ENDS]
        quantities[e.name] = _quantity(three, getattr(e, "grade", verdict), logarithmic=q.logarithmic)
    for mode in found.modes:
        f = getattr(mode, "frequency", None)
        three = mode.frequency_hz if f is None else [getattr(f, key) for key in ENDS]
        name = mode.name.partition(" (")[0].replace("tower x", "tower")
        quantities.setdefault(name, _quantity(three, getattr(f, "grade", verdict)))
    return {"quantities": quantities, "seconds": seconds}


ENDS = ("estimate", "low", "high")


def _quantity(ends: Sequence[float], grade: str, *, logarithmic: bool = False) -> Run:
    """Coordinate and standard deviation of an estimate with the ends of its interval."""
    value, low, high = ends
    at, width = (math.log(value), math.log(high / low)) if logarithmic else (value, high - low)
    return {"at": at, "std": 0.25 * width, "log": bool(logarithmic), "grade": grade}


def _operational(mode: Any) -> list[Run]:
    """Frequency and damping ratio of a mode, both as logarithms."""
    if hasattr(mode, "damping_ratio"):
        both = [(one.estimate, one.relative_std, one.grade) for one in (mode.frequency, mode.damping_ratio)]
    else:
        parts = (mode.frequency, mode.frequency_std / mode.frequency), (mode.damping, mode.ln_damping_std)
        both = [(*part, "A" if mode.trusted else "C") for part in parts]
    return [{"at": math.log(value), "std": float(std), "log": True, "grade": grade} for value, std, grade in both]


def _matched(run: Run, truth: Any) -> Run:
    """Result of the modes nearest to the true ones, within 5 %, and the number of usable modes that are none."""
    from scipy.optimize import linear_sum_assignment

    modes: list[list[Run]] = run["modes"]
    quantities: Run = {}
    off = np.array([[abs(mode[0]["at"] - math.log(f)) for mode in modes] for f, _ in truth]).reshape(len(truth), -1)
    pairs = [(i, j) for i, j in zip(*linear_sum_assignment(np.minimum(off, 0.05)), strict=True) if off[i, j] < 0.05]
    for i, j in pairs:
        quantities |= {f"f {i + 1}": modes[j][0], f"ζ {i + 1}": modes[j][1]}
    none = [mode for j, mode in enumerate(modes) if j not in {j for _, j in pairs}]
    return {"quantities": quantities, "seconds": run["seconds"], "none": sum(one["grade"] != "C" for one, _ in none)}


def scored(run: Run, truth: Any) -> Run:
    """Result of one checkout, each quantity with its error in standard deviations and its relative width."""
    if not isinstance(truth, Mapping):
        run = _matched(run, truth)
        truth = {f"{kind} {i + 1}": v for i, mode in enumerate(truth) for kind, v in zip("fζ", mode, strict=True)}
    kept = {}
    for name, q in run.get("quantities", {}).items():
        true = truth.get(name, truth.get(name.rstrip("_123")))
        if true is not None:
            z = (q["at"] - (math.log(true) if q["log"] else true)) / q["std"]
            kept[name] = {**q, "z": z, "width": q["std"] / (1.0 if q["log"] else abs(true))}
    return {**run, "quantities": kept, "expected": len(truth) if "none" in run else len(kept) or len(truth)}


def _worker(tree: Path) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-P", Path(__file__).resolve(), "--work"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        text=True, cwd=tree, env={**os.environ, "PYTHONPATH": f"{tree / 'src'}{os.pathsep}{tree}"},
    )  # fmt: skip


def _sent(worker: "subprocess.Popen[str]", job: Run) -> Run:
    assert worker.stdin is not None
    assert worker.stdout is not None
    print(json.dumps(job), file=worker.stdin, flush=True)
    return dict(json.loads(worker.stdout.readline()))


def kept_in(folder: Path) -> list[Run]:
    """Results that a folder holds."""
    file = folder / "runs.jsonl"
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()] if file.exists() else []


def run_missing(sets: Sequence[str], names: Sequence[str], seeds: Sequence[int], given: argparse.Namespace) -> None:
    """Analyse in both checkouts what the folder does not hold: one record of each kind before the next."""
    given.folder.mkdir(parents=True, exist_ok=True)
    path = (given.folder / "record.npz").resolve()
    done = {(run["set"], run["name"], run["seed"]) for run in kept_in(given.folder)}
    workers = {"other": _worker(given.other.resolve()), "this": _worker(ROOT)}
    for which, seed in product(sets, seeds):
        for i, (name, healthy, make) in enumerate(kinds(which, given.openfast)):
            if (which, name, seed) in done or not name.startswith(tuple(names)):
                continue
            record, truth, options = make(seed)
            channels, units = np.array(record.channels), np.array(record.units)
            np.savez(path, time=record.time, values=record.values, channels=channels, units=units)
            run: Run = {"set": which, "name": name, "seed": seed, "healthy": healthy}
            for side in SIDES[:: -1 if (i + seed) % 2 else 1]:
                run[side] = scored(_sent(workers[side], {"record": str(path), **options}), truth)
            with (given.folder / "runs.jsonl").open("a", encoding="utf-8") as file:
                file.write(json.dumps(run) + "\n")
            print(f"{which}, {name}, seed {seed}", file=sys.stderr, flush=True)
    for worker in workers.values():
        worker.communicate()


def is_usable(q: Run) -> bool:
    """Test whether a quantity is usable."""
    return bool(q["grade"] != "C")


def is_wrong(q: Run) -> bool:
    """Test whether a usable interval does not contain the true value."""
    return is_usable(q) and abs(q["z"]) > 2.0


HEADINGS = (
    "set", "records", "checkout", "usable", "of healthy", "all in ±2σ", "usable in ±2σ", "worst, σ", "width", "false",
    "seconds", "ratio",
)  # fmt: skip


def summary_rows(runs: Sequence[Run]) -> Iterator[tuple[str, ...]]:
    """Of each set and checkout: shares usable and covered, worst error, width and time over the other's (medians)."""
    for which, side in product(dict.fromkeys(run["set"] for run in runs), SIDES):
        mine = [run for run in runs if run["set"] == which]
        every = [q for run in mine for q in run[side]["quantities"].values()]
        sizes = [abs(q["z"]) for q in every if is_usable(q)]
        widths = [a["width"] / b["width"] for _, a, b in _pairs(mine, side, "other") if is_usable(a) and is_usable(b)]
        ratios = [run[side]["seconds"] / run["other"]["seconds"] for run in mine]
        yield (
            which, str(len(mine)), side, _usable(mine, side), _usable([run for run in mine if run["healthy"]], side),
            _percent(sum(abs(q["z"]) <= 2.0 for q in every), len(every)),
            _percent(sum(z <= 2.0 for z in sizes), len(sizes)), f"{max(sizes):.1f}" if sizes else "",
            f"{np.median(widths):.2f}" if widths else "", str(sum(run[side].get("none", 0) for run in mine)),
            f"{np.median([run[side]['seconds'] for run in mine]):.2f}", f"{np.median(ratios):.2f}",
        )  # fmt: skip


def _usable(runs: Sequence[Run], side: str) -> str:
    usable = sum(is_usable(q) for run in runs for q in run[side]["quantities"].values())
    return _percent(usable, sum(max(run[each]["expected"] for each in SIDES) for run in runs))


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else ""


def _pairs(runs: Sequence[Run], a: str, b: str) -> Iterator[tuple[str, Run, Run]]:
    """Quantities that both checkouts give, with their record."""
    for run in runs:
        for name in [name for name in run[a]["quantities"] if name in run[b]["quantities"]]:
            label = f"{run['set']}, {run['name']}, seed {run['seed']}: {name}"
            yield label, run[a]["quantities"][name], run[b]["quantities"][name]


def shifts(runs: Sequence[Run]) -> list[str]:
    """Shifts of usable estimates of healthy records, and the intervals that are wrong in one checkout only."""
    lines = []
    for which in dict.fromkeys(run["set"] for run in runs if run["healthy"]):
        pairs = list(_pairs([run for run in runs if run["set"] == which and run["healthy"]], *SIDES))
        moved = [abs(b["at"] - a["at"]) / a["std"] for _, a, b in pairs if is_usable(a) and is_usable(b)]
        if moved:
            middle, high = np.quantile(moved, [0.5, 0.95])
            lines += [f"{which}, healthy: shift {middle:.3f} σ (median), {high:.3f} (95 %), {max(moved):.3f} (largest)"]
    both = list(_pairs(runs, *SIDES))
    worse = [one for one in both if is_wrong(one[2]) and not is_wrong(one[1])]
    fewer = sum(is_wrong(a) and not is_wrong(b) for _, a, b in both)
    lines.append(f"usable and beyond ±2σ: {len(worse)} in this checkout only, {fewer} in the other only")
    return lines + [f"  {x}: {a['z']:+.2f} σ, grade {a['grade']} → {b['z']:+.2f} σ, {b['grade']}" for x, a, b in worse]


def main(given: Sequence[str] | None = None) -> None:
    """Print the table."""
    from rich.table import Table

    from windsysid.output.console import render

    parser = argparse.ArgumentParser(prog="python -m validation.side_by_side", description=__doc__)
    parser.add_argument("--other", type=Path, help="another checkout")
    parser.add_argument("--only", nargs="+", choices=SETS, default=SETS, help="sets of records (all)")
    parser.add_argument("--kinds", nargs="+", default=[""], metavar="NAME", help="kinds whose names begin so (all)")
    parser.add_argument("--runs", type=int, default=1, help="records of each kind (1)")
    parser.add_argument("--first", type=int, default=610_000, help="first seed (610000)")
    parser.add_argument("--openfast", type=Path, help="folder of the OpenFAST records")
    parser.add_argument("--folder", type=Path, default=FOLDER, help=f"where results are kept ({FOLDER})")
    parser.add_argument("--kept", action="store_true", help="show what is kept and analyse nothing")
    options = parser.parse_args(given)
    if not options.kept:
        if options.other is None:
            parser.error("expected --other TREE or --kept")
        run_missing(options.only, options.kinds, range(options.first, options.first + options.runs), options)
    runs = kept_in(options.folder)
    table = Table(title="the same records in two checkouts", title_justify="left")
    for heading in HEADINGS:
        table.add_column(heading, justify="left" if heading in ("set", "checkout") else "right")
    for row in summary_rows(runs):
        table.add_row(*row)
    print(render(table, width=150))
    print("\n".join(shifts(runs)))


if __name__ == "__main__":
    work() if sys.argv[1:] == ["--work"] else main()

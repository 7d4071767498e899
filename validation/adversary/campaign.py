"""Identify records that windsysid did not make, and count coefficients of grade A or B that ±2σ does not hold.

``python -m validation.adversary [--only NAME ...] [--runs N] [--first SEED]`` prints a table. What is found is kept in
a folder as it comes: interrupted, the same command goes on. Each record is identified as a user would, with the
packaged turbine file and priors drawn 30 % off. A coefficient is held where ±2σ covers the true value; errors z are in
standard deviations.
"""

import argparse
import json
import re
import sys
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import windsysid as ws
from validation.adversary.instruments import NOISE
from validation.adversary.loads import RMS
from validation.adversary.scenarios import HEALTHY, SCENARIOS, Scenario, record, scenario
from windsysid.checks.limits import MAX_WIDENING
from windsysid.errors import WindsysidError
from windsysid.output.console import render
from windsysid.study.drawn_prior import DrawnPrior

__all__ = ["FOLDER", "GROUPS", "identify_one", "kept_as", "main", "of_statistics", "summarise"]

GROUPS = {"k_tower": ("k_x", "k_y"), "k_blade": "k_beta", "c_tower": ("c_x", "c_y"), "c_blade": "c_beta"}
"""Coefficients that are alike, by the beginnings of their names."""

FOLDER = Path("results/adversary")

Run = dict[str, Any]


def identify_one(name: str, seed: int, loads: str = "auto", folder: Path | None = None) -> Run:
    """Identify one record of a scenario, the loads taken for `loads`; with `folder`, its innovations are kept there."""
    kind, begun = scenario(name, seed), time.process_time()
    run: Run = {"scenario": name, "seed": seed}
    try:
        found = ws.identify(
            record(name, seed), "verne555", prior=DrawnPrior(seed=seed),
            formulation=kind.formulation,  # type: ignore[arg-type]
            loads=loads if kind.formulation == "auto" else "auto",
        )  # fmt: skip
    except WindsysidError as error:
        return run | {"refused": str(error)}
    z = []
    for e, q, std in zip(found.estimates, found.parameters, np.sqrt(np.diag(found.cov)), strict=True):
        truth = kind.machine.truth.get(e.name)
        z.append(None if truth is None else float(q.coordinate(e.estimate) - q.coordinate(truth)) / float(std))
    if folder is not None:
        np.savez_compressed(
            folder / kept_as(name, seed),
            whitened=found.whitened.astype(np.float32),
            loads=np.empty(0) if found.loads is None else found.loads.mean.astype(np.float32),
        )
    diagnosis = found.diagnosis
    return run | {
        "names": [e.name for e in found.estimates],
        "z": z,
        "grades": [e.grade for e in found.estimates],
        "relative": [
            e.estimate / kind.machine.truth[e.name] - 1.0 if e.name in kind.machine.truth else None
            for e in found.estimates
        ],
        "trusted": diagnosis.trusted,
        "findings": [finding.summary() for finding in found.findings],
        "rate": found.rate,
        "statistics": {s.name: [s.estimate, s.low, s.high] for s in found.statistics},
        "innovations": diagnosis.summary()["innovations"],
        "seconds": time.process_time() - begun,
    }


def kept_as(name: str, seed: int) -> str:
    """Name of the file that keeps the innovations of a record."""
    return f"{re.sub('[^a-z0-9.]+', '-', name.lower())}-{seed}.npz"


def run_all(names: list[str], seeds: range, folder: Path, loads: str = "auto", *, only_kept: bool = False) -> list[Run]:
    """Identify what the folder does not hold yet, a seed of every scenario before the next seed; all that it holds."""
    folder.mkdir(parents=True, exist_ok=True)
    results = folder / "runs.jsonl"
    lines = results.read_text(encoding="utf-8").splitlines() if results.exists() else []
    runs = [json.loads(line) for line in lines if line.endswith("}")]
    done = {(run["scenario"], run["seed"]) for run in runs}
    todo = [] if only_kept else [(name, seed) for seed in seeds for name in names if (name, seed) not in done]
    begun = time.perf_counter()
    for i, (name, seed) in enumerate(todo, start=1):
        run = identify_one(name, seed, loads, folder)
        with results.open("a", encoding="utf-8") as file:
            file.write(json.dumps(run) + "\n")
        runs.append(run)
        left = (time.perf_counter() - begun) / i * (len(todo) - i) / 60.0
        print(f"\r{i} of {len(todo)} records, {left:.0f} minutes left   ", end="", file=sys.stderr, flush=True)
    return [run for run in runs if run["scenario"] in names and run["seed"] in seeds]


def summarise(runs: list[Run]) -> dict[str, float]:
    """Shares of grades, coverage of ±2σ of all coefficients and of those of grade A or B, their worst error, the lowest
    coverage of a group, and the median over records of the largest factor on an interval."""
    found = [run for run in runs if "z" in run]
    every, usable = _errors(found), _errors(found, "AB")
    letters = [grade for run in found for grade in run["grades"]]
    pooled = np.concatenate([*usable.values()])
    groups = [_share(z) for z in usable.values() if z.size]
    return {
        "runs": len(runs),
        "refused": len(runs) - len(found),
        **{grade: letters.count(grade) / max(len(letters), 1) for grade in "ABC"},
        "covered": _share(np.concatenate([*every.values()])),
        "usable": pooled.size,
        "covered of usable": _share(pooled),
        "least": min(groups, default=float("nan")),
        "worst": float(np.max(np.abs(pooled), initial=0.0)),
        "factor": float(np.median([_factor(run) for run in found])) if found else float("nan"),
    }


def _factor(run: Run) -> float:
    """The largest factor on an interval that an interval covers; 1 where none is reported."""
    wide = [one["data"]["factor"] for one in run["findings"] if one["code"] == "wider_intervals"]
    return max([factor for factor in wide if factor <= MAX_WIDENING], default=1.0)


def _errors(runs: list[Run], grades: str = "ABC") -> dict[str, NDArray[np.float64]]:
    """Errors in standard deviations, by group, of coefficients with one of these grades."""
    return {
        group: np.array(
            [
                z
                for run in runs
                for n, z, grade in zip(run["names"], run["z"], run["grades"], strict=True)
                if n.startswith(beginnings) and z is not None and grade in grades
            ]
        )
        for group, beginnings in GROUPS.items()
    }


def _share(z: NDArray[np.float64]) -> float:
    return float(np.mean(np.abs(z) < 2.0)) if z.size else float("nan")


STATISTICS = {"load_rms": RMS, "load_time_constant": 1.0, "noise_tower": NOISE[0], "noise_blade": NOISE[-1]}
"""Loads and noise of the reference, by the beginnings of their statistics' names."""


def of_statistics(runs: list[Run]) -> dict[str, float]:
    """Coverage of ±2σ for statistics of loads and noise, in records that have those of the reference."""
    usual = Scenario(HEALTHY)
    like = [
        run["statistics"]
        for run in runs
        if "statistics" in run
        and SCENARIOS[run["scenario"]]._replace(duration=usual.duration, rate=usual.rate) == usual
    ]
    held = {
        beginning: [low < truth < high for s in like for n, (_, low, high) in s.items() if n.startswith(beginning)]
        for beginning, truth in STATISTICS.items()
    }
    return {beginning: float(np.mean(each)) for beginning, each in held.items() if each}


CAUSES = {
    "instrument": ("channel_level", "dead_channel", "late_blades"),
    "line": ("line_influence", "spectral_line", "tone_influence", "tone_left"),
    "loads": (
        "correlated_innovations", "correlated_loads", "heavy_tails", "level_over_frequency",
        "narrow_band_load_ambiguous", "narrow_band_load_possible", "narrow_band_load_preferred", "nonstationary_level",
        "rotor_harmonic_left", "unexplained_level", "unexplained_peak", "wider_intervals",
    ),
    "machine": ("amplitude_dependence", "nonlinear_force"),
}  # fmt: skip
"""Cause that a reason names, by code."""


def cause_of(reason: Mapping[str, Any]) -> str:
    """The cause that a reason names, from its summary; ``other`` where it names none."""
    if reason["code"] == "nonstationary_level" and reason["data"]["alone"]:
        return "instrument"
    return next((cause for cause, codes in CAUSES.items() if reason["code"] in codes), "other")


def _named(run: Run) -> str:
    """The cause that the first reason of a result names."""
    if "refused" in run or run["trusted"]:
        return "refused" if "refused" in run else ""
    causes = [cause_of(one) for one in run["findings"] if one["severity"] == "reason"]
    return next((cause for cause in causes if cause != "other"), "other")


def main() -> None:
    """Print the table."""
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.adversary", description=__doc__)
    parser.add_argument("--only", nargs="+", default=[""], metavar="NAME", help="scenarios whose names begin so (all)")
    parser.add_argument("--runs", type=int, default=40, help="records of each scenario (40)")
    parser.add_argument("--first", type=int, default=1000, help="seed of the first (1000)")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where results are kept (results/adversary)")
    parser.add_argument(
        "--loads", default="auto", help="load model asked for (auto); broadband spares minutes a record"
    )
    parser.add_argument("--kept", action="store_true", help="show what is kept and identify nothing")
    options = parser.parse_args()
    names = [name for name in SCENARIOS if name.startswith(tuple(options.only))]
    if not names:
        parser.error(f"--only: expected the beginning of a scenario's name, got {' '.join(options.only)}")
    seeds = range(options.first, options.first + options.runs)
    runs = run_all(names, seeds, options.folder, options.loads, only_kept=options.kept)
    table = Table(title="priors 30 % off: grades and how often ±2σ holds, in % of coefficients", title_justify="left")
    left = ("scenario", "wrong", "named")
    for heading in (*("scenario", "n", "wrong", "A", "B", "C", "all", "A+B", "least", "|z|", "factor"), "named"):
        table.add_column(heading, justify="left" if heading in left else "right", no_wrap=heading == "scenario")
    wholes = {"healthy": [n for n in names if SCENARIOS[n].wrong == HEALTHY], "all": names}
    for label, members in {**{name: [name] for name in names}, **wholes}.items():
        mine = [run for run in runs if run["scenario"] in members]
        if not mine:
            continue
        s = summarise(mine)
        named = Counter(cause for cause in map(_named, mine) if cause)
        said = ", ".join(f"{cause} {count}" for cause, count in named.most_common())
        wrong = SCENARIOS[label].wrong if label in SCENARIOS else ""
        percent = [s[key] for key in ("A", "B", "C", "covered", "covered of usable", "least")]
        held = ["" if np.isnan(p) else f"{100 * p:.0f}" for p in percent]
        worst = f"{s['worst']:.1f}" if s["usable"] else ""
        table.add_row(label, str(len(mine)), wrong, *held, worst, f"{s['factor']:.1f}", said)
    print(render(table))
    shares = ", ".join(f"{name} {100 * share:.0f} %" for name, share in of_statistics(runs).items())
    if shares:
        print(f"of records with loads and noise of the reference, ±2σ holds {shares}")
    faulty = [run for run in runs if SCENARIOS[run["scenario"]].wrong != HEALTHY and _named(run) not in ("", "refused")]
    right = sum(_named(run) == SCENARIOS[run["scenario"]].wrong for run in faulty)
    print(f"the cause named first is the true one in {right} of {len(faulty)} faulty records that give a reason")


if __name__ == "__main__":
    main()

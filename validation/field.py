"""Somebody else's physics: identified from three records of an aeroelastic simulation, compared with the truth, the
bound, and the requirements.

OpenFAST's NREL 5 MW turbine has flexible blades and tower, tilt, cone and aerodynamics that no model here has. Three
records of it are identified as a user would, from accelerometers and the azimuth: ``a2``, a free decay; ``c2``,
turbulent wind of 12 m/s; ``d1``, the same wind on a tower whose elastic stiffness is 0.90 of the other's. The turbine
file must not be its own answer: priors are centred up to 1.5 times off, uniformly in the logarithm (`LogUniformPrior`),
with several seeds, and the share of the information that came from the data is given with every estimate.

Least standard deviations of a mode that a broadband load of unknown level drives for T seconds: σ_f/f = √(ζ/(ωT)),
σ_ζ/ζ = 1/√(ζωT), and σ_k/k = 2 σ_f/f for the stiffness behind it.

``python -m validation.field --openfast FOLDER [--output DIR]`` prints the table, and writes it with every number and a
figure; results that DIR holds already are taken from there. The records are not part of windsysid.
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from windsysid.errors import RecordError, WindsysidError
from windsysid.identification.condition.readings import add_noise, with_noise
from windsysid.identification.identify import identify
from windsysid.identification.model.prior import Prior
from windsysid.mechanics.compile import compile_model
from windsysid.modal.analysis import modes_with_slopes
from windsysid.monitoring.change import MIN_CHANGE_ODDS, Comparison
from windsysid.monitoring.comparison import compare
from windsysid.output.console import render
from windsysid.output.folders import result_file
from windsysid.records.formats import read_record
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.results.mode import Mode
from windsysid.results.posterior import SIGMAS, Posterior, load_posterior
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Case", "Found", "LogUniformPrior", "Row", "Target", "frequency_bound", "judge"]

FILES = {"a2": "a2_rot12_decay_min.outb", "c2": "c2_turb12_full.outb", "d1": "d1_turb12_full_KSS090.outb"}

WINDY = (60.0, 600.0)
"""[s] The wind blows on a turbine at rest: what is used of c2 and d1."""

HALVES = ((60.0, 330.0), (330.0, 600.0))
"""[s]"""

FACTOR = 1.5
"""Largest factor by which priors are centred off."""

AIR = 1.0
"""Relative prior standard deviation of damping under wind; the file knows the structure's damping alone."""

NOISE = 1.0
"""[%] Added to the accelerometers of a2, of the standard deviation of each."""

DECAY, TOWER, ROTOR = "nrel5mw", "tower", "nrel5mw_full"
"""Packaged turbines: for the free decay, and the two for wind."""

READ = 3.4
"""[Hz] How often the rotor's sensors are read under wind: above 1.7 Hz there are modes that it has not."""

WIDEST = 1.3
"""Bands over the bound that were requested."""

HELD = 3.0
"""Standard deviations within which the truth should be."""

RATIO, RATIO_WITHIN, ODDS = 0.8964, 0.02, 1000.0
"""Stiffness of d1 over that of c2 in truth, how near it should be found, and the odds that it changed."""

TRUTH: Mapping[str, Mapping[str, float]] = {
    "a2": {
        "k_x": 1773892.0, "c_x": 6283.98, "k_beta": 66822.1, "c_beta": 93.37,
        "lag backward": 0.8955, "lag collective": 1.1112, "lag forward": 1.3052,
    },
    "c2": {
        "k_x": 1773892.0, "k_beta": 66822.1, "tower": 0.3153, "tower damping": 0.00566,
        "lag backward": 0.8908, "lag collective": 1.0402, "lag forward": 1.2990,
    },
    "d1": {
        "k_x": RATIO * 1773892.0, "k_beta": 66822.1, "tower": 0.2986,
        "lag backward": 0.8907, "lag collective": 1.0323, "lag forward": 1.2988,
    },
}  # fmt: skip
"""From the simulator's input and linearisation, blades at the tip, frequencies in Hz; the damping under wind from a
decay in steady wind of 12 m/s. Those of d1 are linearised with its own tower: a softer tower takes the collective mode
down, too, because the tower's top rolls."""

LAGS = ("lag backward", "lag collective", "lag forward")


@dataclass(frozen=True)
class LogUniformPrior(Prior):
    """Priors whose centres are drawn anew for each seed, uniformly between the reference ÷ and × `FACTOR` in the
    logarithm.

    The declared standard deviation is that of the same distribution: ln F/√3 for what is identified in logarithms; for
    damping that of the reference over the centre less one, E(e^u − 1)² = sinh(2a)/2a − 2 sinh(a)/a + 1 with a = ln F.

    Attributes
    ----------
    seed
        What the centres are drawn with.
    air
        Relative standard deviation of damping that is declared besides.
    """

    seed: int = 0
    air: float = 0.0

    def parameters(self, turbine: Turbine, names: Sequence[str], *, linear: bool) -> tuple[Parameter, ...]:
        """The parameters with centres drawn."""
        rng, a = np.random.default_rng([self.seed, 6]), math.log(FACTOR)
        of_damping = math.hypot(math.sqrt(math.sinh(2.0 * a) / (2.0 * a) - 2.0 * math.sinh(a) / a + 1.0), self.air)
        drawn = []
        for q in super().parameters(turbine, names, linear=linear):
            centre = q.centre * math.exp(rng.uniform(-a, a))
            spread = a / math.sqrt(3.0) if q.logarithmic else of_damping * abs(centre)
            drawn.append(replace(q, centre=centre, spread=spread))
        return tuple(drawn)


class Case(NamedTuple):
    """One identification.

    Attributes
    ----------
    record
        ``a2``, ``c2`` or ``d1``.
    turbine
        Name of a packaged one.
    seed
        Of the prior, and of the noise of a2.
    section
        [s]; None for all of it.
    """

    record: str
    turbine: str
    seed: int
    section: tuple[float, float] | None = WINDY

    @property
    def name(self) -> str:
        """Path of its result."""
        part = "" if self.section is None else f"_{self.section[0]:g}_{self.section[1]:g}"
        return f"{self.record}_{self.turbine}{part}_seed{self.seed}"


class Found(NamedTuple):
    """A quantity as one identification found it: estimate, standard deviation, share of information from data."""

    estimate: float
    std: float
    informed: float


class Target(NamedTuple):
    """Requirement; None where there was none.

    Attributes
    ----------
    within
        Relative error.
    held
        Standard deviations within which the truth is.
    widest
        Standard deviation over the bound.
    """

    within: float | None = None
    held: float | None = None
    widest: float | None = None

    def __str__(self) -> str:
        """In a few words."""
        parts = [
            "" if self.within is None else f"within {100.0 * self.within:g} %",
            "" if self.held is None else f"±{self.held:g}σ",
            "" if self.widest is None else f"≤ {self.widest:g} × bound",
        ]
        return ", ".join(part for part in parts if part)


class Row(NamedTuple):
    """A quantity compared with its truth.

    Attributes
    ----------
    record, model, quantity, unit
        What it is.
    truth
        None where it is not known.
    found
        By seed.
    bound
        Least relative standard deviation; None where none is stated.
    target
        Requirements.
    missed
        What of the target no seed, or not every seed, meets, in words; empty where all is met.
    """

    record: str
    model: str
    quantity: str
    unit: str
    truth: float | None
    found: tuple[Found, ...]
    bound: float | None
    target: Target
    missed: tuple[str, ...]

    @property
    def worst(self) -> Found:
        """The seed furthest from the truth, or with the widest band where that is not known."""
        if self.truth is None:
            return max(self.found, key=lambda f: f.std)
        truth = self.truth
        return max(self.found, key=lambda f: abs(f.estimate - truth))

    @property
    def verdict(self) -> str:
        """Met or not."""
        return ("missed: " + ", ".join(self.missed)) if self.missed else "met" if str(self.target) else ""

    def cells(self) -> tuple[str, ...]:
        """As text under `HEADINGS`, the worst seed's numbers."""
        w, half = self.worst, SIGMAS * self.worst.std
        error = deviation = ""
        if self.truth is not None:
            error = f"{100.0 * (w.estimate / self.truth - 1.0):+.2f} %"
            deviation = f"{max((f.estimate - self.truth) / f.std for f in self.found if f is w):+.1f}"
        over = "" if self.bound is None else f"{max(f.std / abs(f.estimate) for f in self.found) / self.bound:.2f}"
        return (
            self.record, self.model, self.quantity, "" if self.truth is None else f"{self.truth:.5g}",
            f"{w.estimate:.5g} ± {half:.2g} {self.unit}".rstrip(), error, deviation, over,
            f"{100.0 * min(f.informed for f in self.found):.0f} %", str(self.target), self.verdict,
        )  # fmt: skip


HEADINGS = (
    "record",
    "turbine file",
    "quantity",
    "truth",
    "found ±2σ",
    "error",
    "error/σ",
    "σ over bound",
    "from data",
    "target",
    "",
)


def frequency_bound(frequency: float, ratio: float, seconds: float) -> float:
    """Least σ_f/f of a mode [Hz, 1] under a broadband load of unknown level for so long [s]; σ_ζ/ζ is 1/ζ of it."""
    return math.sqrt(ratio / (2.0 * math.pi * frequency * seconds))


def judge(
    record: str, model: str, quantity: str, unit: str, truth: float | None, found: Sequence[Found], bound: float | None,
    target: Target
) -> Row:  # fmt: skip
    """A row of the table: a part of the target is missed where any of the seeds misses it."""
    missed = []
    if truth is None:
        target = Target(widest=target.widest)
    if truth is not None and target.within is not None:
        error = max(abs(f.estimate / truth - 1.0) for f in found)
        if error > target.within:
            missed.append(f"{100.0 * error:.2g} % off")
    if truth is not None and target.held is not None:
        deviation = max(abs(f.estimate - truth) / f.std for f in found)
        if deviation > target.held:
            missed.append(f"truth {deviation:.1f}σ away")
    if bound is not None and target.widest is not None:
        width = max(f.std / abs(f.estimate) for f in found) / bound
        if width > target.widest:
            missed.append(f"band {width:.2f} × bound")
    return Row(record, model, quantity, unit, truth, tuple(found), bound, target, tuple(missed))


def identified(case: Case, record: Record) -> Identification:
    """One identification, as a user would make it."""
    turbine = load_turbine(case.turbine).exact()
    sensors = turbine.sensors
    if case.record == "a2":
        record, added = add_noise(record, [sensor.channel for sensor in sensors], NOISE, case.seed)
        sensors, prior = with_noise(sensors, added), LogUniformPrior(seed=case.seed)
        return identify(record, turbine, sensors=sensors, formulation="joint", prior=prior)
    prior = LogUniformPrior(seed=case.seed, air=AIR)
    rate = None if case.turbine == TOWER else READ
    return identify(record, turbine, formulation="joint", section=case.section, prior=prior, rate=rate)


class Result(NamedTuple):
    """Result of an identification in its folder, and the time that it took [s]."""

    posterior: Posterior
    modes: Mapping[str, Mode]
    prior_modes: Mapping[str, Mode]
    seconds: float
    loads: str


def results(cases: Sequence[Case], folder: Path, kept: Path) -> dict[Case, Result]:
    """Every case, taken from `kept` where its result is there already; a line on standard error for each."""
    records: dict[str, Record] = {}
    done = {}
    for i, case in enumerate(cases, start=1):
        where, begun = kept / case.name, time.perf_counter()
        if not result_file(where, "identification.nc").is_file():
            if case.record not in records:
                records[case.record] = read_record(folder / FILES[case.record])
            result = identified(case, records[case.record])
            result.save(where, overwrite=True)
        done[case] = _read(where)
        print(f"[{i}/{len(cases)}] {case.name}: {time.perf_counter() - begun:.0f} s", file=sys.stderr, flush=True)
    return done


def _read(folder: Path) -> Result:
    posterior = load_posterior(folder)
    summary = json.loads(result_file(folder, "summary.json").read_text(encoding="utf-8"))
    prior = np.diag([q.prior[1] ** 2 for q in posterior.parameters])
    modes = [_modes(posterior, cov) for cov in (posterior.cov, prior)]
    return Result(posterior, modes[0], modes[1], summary["elapsed_s"], _loads(summary["findings"]))


def _loads(findings: Sequence[Mapping[str, Any]]) -> str:
    """The name of the load model, from the findings of a result."""
    return next((one["data"]["model"] for one in findings if one["code"] == "load_model_chosen"), "")


def _modes(posterior: Posterior, cov: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> dict[str, Mode]:
    turbine = posterior.turbine
    compiled = compile_model(turbine.model)
    p = np.array([turbine.values[name] for name in compiled.parameters])
    found, _ = modes_with_slopes(
        turbine.model, compiled, p, turbine.rotor_speed, posterior.parameters, posterior.theta, cov
    )
    return {mode.name: mode for mode in found}


def coefficient(result: Result, name: str) -> Found:
    """A coefficient, those of blades at the tip."""
    posterior = result.posterior
    i = [q.name for q in posterior.parameters].index(name)
    q, std = posterior.parameters[i], math.sqrt(posterior.cov[i, i])
    value = float(posterior.turbine.values[name])
    unit = posterior.turbine.tip_lever**2 if "_beta" in name else 1.0
    spread = std * (value if q.logarithmic else q.scale)
    return Found(value / unit, spread / unit, 1.0 - min((std / q.prior[1]) ** 2, 1.0))


def mode(result: Result, name: str, what: str) -> Found | None:
    """``frequency`` or ``damping_ratio`` of a mode; None where the result has no such mode."""
    name = next((known for known in (name, f"{name} (1)") if known in result.modes), name)
    if name not in result.modes or name not in result.prior_modes:
        return None
    found, before = getattr(result.modes[name], what), getattr(result.prior_modes[name], what)
    return Found(found.estimate, found.std, 1.0 - min((found.std / before.std) ** 2, 1.0))


def _of_mode(results: Sequence[Result], name: str, what: str) -> list[Found]:
    return [found for found in (mode(result, name, what) for result in results) if found is not None]


def decay_rows(found: Sequence[Result]) -> list[Row]:
    """Results on a2."""
    truth, rows = TRUTH["a2"], []
    for name, unit, within in (("k_x", "N/m", 0.01), ("c_x", "N·s/m", 0.05)):
        rows.append(
            judge("a2", DECAY, name, unit, truth[name], [coefficient(r, name) for r in found], None, Target(within))
        )
    for kind, unit, within in (("k_beta", "N/m", 0.01), ("c_beta", "N·s/m", 0.10)):
        for blade in (1, 2, 3):
            values = [coefficient(r, f"{kind}_{blade}") for r in found]
            rows.append(
                judge("a2", DECAY, f"{kind}_{blade} at the tip", unit, truth[kind], values, None, Target(within))
            )
    for name in LAGS:
        values = _of_mode(found, name, "frequency")
        rows.append(judge("a2", DECAY, f"{name}, frequency", "Hz", truth[name], values, None, Target(0.005)))
    return rows


def wind_rows(record: str, turbine: str, found: Sequence[Result]) -> list[Row]:
    """Results on c2 or d1 with one of the turbine files."""
    truth, seconds = TRUTH[record], WINDY[1] - WINDY[0]
    name = "tower side-side" if turbine == TOWER else "tower x"
    ratios = _of_mode(found, name, "damping_ratio")
    ratio = truth.get("tower damping", max(float(np.mean([v.estimate for v in ratios])), 1e-6))
    bound = frequency_bound(truth["tower"], ratio, seconds)
    rows = [
        judge(record, turbine, "tower, frequency", "Hz", truth["tower"], _of_mode(found, name, "frequency"), bound,
        Target(0.005, HELD, WIDEST)),
        judge(record, turbine, "tower, damping ratio", "", truth.get("tower damping"), ratios, bound / ratio,
        Target(None, HELD, WIDEST)),
    ]  # fmt: skip
    if turbine == TOWER:
        return rows
    rows.append(
        judge(
            record,
            turbine,
            "k_x",
            "N/m",
            truth["k_x"],
            [coefficient(r, "k_x") for r in found],
            2.0 * bound,
            Target(None, HELD, WIDEST),
        )
    )
    for lag in LAGS:
        f, z = _of_mode(found, lag, "frequency"), _of_mode(found, lag, "damping_ratio")
        if len(f) < len(found):
            rows.append(
                Row(
                    record,
                    turbine,
                    f"{lag}, frequency",
                    "Hz",
                    truth[lag],
                    tuple(f) or (Found(math.nan, math.nan, 0.0),),
                    None,
                    Target(0.01, HELD, WIDEST),
                    ("mode not found",),
                )
            )
            continue
        total = max(float(np.mean([v.estimate for v in z])), 1e-6)
        least = frequency_bound(truth[lag], total, seconds)
        rows.append(judge(record, turbine, f"{lag}, frequency", "Hz", truth[lag], f, least, Target(0.01, HELD, WIDEST)))
        rows.append(
            judge(record, turbine, f"{lag}, damping ratio", "", None, z, least / total, Target(None, None, WIDEST))
        )
    for blade in (1, 2, 3):
        values = [coefficient(r, f"k_beta_{blade}") for r in found]
        rows.append(
            judge(
                record, turbine, f"k_beta_{blade} at the tip", "N/m", truth["k_beta"], values, None, Target(None, HELD)
            )
        )
    return rows


class Changed(NamedTuple):
    """A comparison of two records, by seed, and whether the requirements is met."""

    question: str
    turbine: str
    answers: tuple[str, ...]
    target: str
    met: bool


CHANGED_HEADINGS = ("question", "turbine file", "answer, by seed", "target", "")


def stiffness_ratio(turbine: str, found: Sequence[tuple[Posterior, Posterior]]) -> Changed:
    """The tower's stiffness in d1 over that in c2, and the odds that it changed."""
    name = "k_side_side" if turbine == TOWER else "k_x"
    answers, met = [], True
    for before, after in found:
        change = next(c for c in compare(before, after).coefficients if c.name == name)
        ratio, half = 1.0 + 0.01 * change.percent, 0.005 * (change.high - change.low)
        met = met and bool(abs(ratio - RATIO) <= RATIO_WITHIN and change.log_odds > math.log(ODDS))
        answers.append(f"{ratio:.4f} ± {half:.4f}, odds 10^{change.log_odds / math.log(10.0):.1f} : 1")
    return Changed(
        f"{name}, d1 over c2", turbine, tuple(answers), f"{RATIO:g} ± {RATIO_WITHIN:g}, odds {ODDS:g} : 1", met
    )


def halves(record: str, turbine: str, found: Sequence[tuple[Posterior, Posterior]]) -> Changed:
    """The two halves of a record against each other: nothing should have moved."""
    answers, met = [], True
    for before, after in found:
        moved = [str(change) for change in compare(before, after).coefficients if change.moved]
        met = met and not moved
        answers.append("; ".join(moved) or f"nothing moved; {_nearest(compare(before, after))}")
    return Changed(
        f"{record}, second half over first", turbine, tuple(answers), f"no odds beyond {MIN_CHANGE_ODDS:g} : 1", met
    )


def _nearest(comparison: Comparison) -> str:
    change = max(comparison.coefficients, key=lambda c: c.log_odds)
    return f"at most {change.name} {change.percent:+.2g} %, odds 10^{change.log_odds / math.log(10.0):.1f} : 1"


def figure(rows: Sequence[Row]) -> "Figure":
    """Estimates over the truth with ±2σ bands, a mark per seed; left stiffness and frequencies, right damping."""
    from matplotlib.figure import Figure

    from windsysid.reports.figures.plots import ESTIMATE, REFERENCE, tidy

    known = [row for row in rows if row.truth is not None and row.found]
    sides = [[row for row in known if _is_damping(row) == damping] for damping in (False, True)]
    drawn = Figure(figsize=(12.6, 1.0 + 0.3 * max(map(len, sides))), layout="constrained")
    for ax, side, what in zip(drawn.subplots(1, 2), sides, ("stiffness and frequency", "damping"), strict=True):
        for place, row in enumerate(reversed(side)):
            truth = row.truth or math.nan
            for k, f in enumerate(row.found):
                y = place + 0.22 * (k - 0.5 * (len(row.found) - 1))
                error, half = 100.0 * (f.estimate / truth - 1.0), 100.0 * SIGMAS * f.std / truth
                ax.errorbar(error, y, xerr=half, fmt="o", color=ESTIMATE, markersize=3, linewidth=1.2)
        ax.axvline(0.0, color=REFERENCE, linestyle="--", linewidth=0.9)
        ax.set_yticks(range(len(side)), [f"{r.record}, {r.model}: {r.quantity}" for r in reversed(side)], fontsize=7)
        ax.set_xlabel(f"{what}: error and ±2σ [%]")
        tidy(ax)
    return drawn


def _is_damping(row: Row) -> bool:
    return row.quantity.startswith("c_") or "damping" in row.quantity


def markdown(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table for the docs."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (headings, ["---"] * len(headings), *rows))


def study(
    folder: Path, kept: Path, seeds: int, turbines: Sequence[str]
) -> tuple[list[Row], list[Changed], list[tuple[str, ...]]]:
    """All rows, all comparisons, and of the identifications which are trusted and how long they took."""
    cases = [Case("a2", DECAY, seed, None) for seed in range(seeds)]
    for turbine in turbines:
        cases += [Case(record, turbine, seed) for seed in range(seeds) for record in ("c2", "d1")]
        cases += [
            Case("c2", turbine, seed, half) for seed in range(seeds if turbine == TOWER else 1) for half in HALVES
        ]
    found = results(cases, folder, kept)

    def of(record: str, turbine: str, section: tuple[float, float] | None = WINDY) -> list[Result]:
        return [r for case, r in found.items() if case._replace(seed=0) == Case(record, turbine, 0, section)]

    rows, changed = decay_rows(of("a2", DECAY, None)), []
    for turbine in turbines:
        whole = [of(record, turbine) for record in ("c2", "d1")]
        rows += [
            row for record, each in zip(("c2", "d1"), whole, strict=True) for row in wind_rows(record, turbine, each)
        ]
        pairs = [(a.posterior, b.posterior) for a, b in zip(*whole, strict=True)]
        parts = [(a.posterior, b.posterior) for a, b in zip(*(of("c2", turbine, half) for half in HALVES), strict=True)]
        changed += [stiffness_ratio(turbine, pairs), halves("c2", turbine, parts)]
    told: list[tuple[str, ...]] = []
    for record, turbine, section in dict.fromkeys(case[:2] + case[3:] for case in found):
        group = of(record, turbine, section)
        trusted, seconds = sum(r.posterior.trusted for r in group), [r.seconds for r in group]
        part = "all" if section is None else f"{section[0]:g} … {section[1]:g} s"
        told.append(
            (
                record,
                turbine,
                part,
                f"{trusted} of {len(group)}",
                f"{min(seconds):.0f} … {max(seconds):.0f} s",
                ", ".join(sorted({r.loads for r in group})),
            )
        )
    return rows, changed, told


def main() -> None:
    """Print the tables, and write them where asked."""
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.field", description=__doc__.splitlines()[0])
    parser.add_argument("--openfast", type=Path, required=True, help=f"folder of {', '.join(FILES.values())}")
    parser.add_argument(
        "--output", type=Path, default=Path("results/field"), help="results, kept and reused (results/field)"
    )
    parser.add_argument("--seeds", type=int, default=3, help="priors to start from (3)")
    parser.add_argument(
        "--without-rotor", action="store_true", help=f"c2 and d1 with the file '{TOWER}' only: two minutes"
    )
    given = parser.parse_args()
    absent = [name for name in FILES.values() if not (given.openfast / name).is_file()]
    if absent:
        raise RecordError(
            f"{given.openfast}: expected the records {', '.join(FILES.values())}, got no {', '.join(absent)}"
        )
    turbines = (TOWER,) if given.without_rotor else (TOWER, ROTOR)
    rows, changed, told = study(given.openfast, given.output / "identifications", max(given.seeds, 1), turbines)
    sheets: list[tuple[str, Sequence[str], list[tuple[str, ...]]]] = [
        (f"{given.seeds} priors, each ×/÷ {FACTOR:g} off; of every quantity the seed that errs most", HEADINGS,
        [row.cells() for row in rows]),
        (
            "What changed", CHANGED_HEADINGS,
            [(c.question, c.turbine, "; ".join(c.answers), c.target, "met" if c.met else "missed") for c in changed],
        ),
        ("Identifications", ("record", "turbine file", "section", "trusted", "time in the filter", "loads"), told),
    ]  # fmt: skip
    tables = []
    for title, headings, lines in sheets:
        tables.append(Table(title=title, title_justify="left"))
        for heading in headings:
            tables[-1].add_column(heading)
        for line in lines:
            tables[-1].add_row(*line)
    print(render(*tables, width=180))
    given.output.mkdir(parents=True, exist_ok=True)
    text = "\n\n".join(f"**{title}**\n\n{markdown(headings, lines)}" for title, headings, lines in sheets)
    (given.output / "field.md").write_text(text + "\n", encoding="utf-8")
    figure(rows).savefig(given.output / "field.png", dpi=120)
    summary = {
        "rows": [
            row._asdict() | {"target": str(row.target), "found": [f._asdict() for f in row.found]} for row in rows
        ],
        "changed": [c._asdict() for c in changed],
        "identifications": told,
    }
    (given.output / "summary.json").write_text(
        json.dumps(summary, indent=2, ensure_ascii=False) + "\n", encoding="utf-8"
    )


if __name__ == "__main__":
    try:
        main()
    except WindsysidError as error:
        sys.exit(str(error))

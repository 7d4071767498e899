"""Blades of a real turbine from their spectra: two OpenFAST records, whole and in windows, and records simulated at
other speeds.

The records, the priors and the truths are those of `validation.field`; the formulation is ``spectral``, the turbine
file ``nrel5mw_full``. A window counts with its error, and with its error over its own standard deviation: where bands
are true, the rms of that is 1.

Of the blades' stiffness the truth is that of a blade free to flap (docs/richer.md): 0.9906 of that of the edgewise mode
alone, which is what fits the linearisation of the full turbine.

``python -m validation.field_spectral --openfast FOLDER [--seeds N] [--lengths 270 120 60]`` prints the tables;
``python -m validation.field_spectral --simulated [--rpm 7 9 …] [--loads wind-feedback …] [--first SEED] [--runs N]``
those of simulated records, whose truth is known to the last digit.
"""

import argparse
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from validation.field import AIR, FILES, LAGS, RATIO, ROTOR, TRUTH, WINDY, LogUniformPrior, frequency_bound
from windsysid.identification.identify import identify
from windsysid.modal.analysis import modes
from windsysid.output.console import render
from windsysid.records.formats import read_record
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["Seen", "look", "windows"]

MODES = ("tower", *LAGS)
FREE_TO_FLAP = 0.9906
"""Stiffness of a blade free to flap over that of its edgewise mode (docs/richer.md)."""

RPM = 2.0 * math.pi / 60.0
SIMULATED_SECONDS, SIMULATED_RATE = 540.0, 25.0


class Seen(NamedTuple):
    """One identification compared with the truth.

    Attributes
    ----------
    label, section, seed
        The record, its part [s], and what the prior was drawn with.
    errors, deviations
        Relative error of every mode and coefficient by name, and error over its standard deviation.
    widths
        Relative standard deviation of every mode over the bound.
    stiffness
        ln k_x and its standard deviation.
    trusted, why
        Whether the diagnosis trusts it, and what speaks against it.
    seconds
        Processor time of the identification.
    """

    label: str
    section: tuple[float, float]
    seed: int
    errors: Mapping[str, float]
    deviations: Mapping[str, float]
    widths: Mapping[str, float]
    stiffness: tuple[float, float]
    trusted: bool
    why: tuple[str, ...]
    seconds: float


def look(
    label: str, record: Record, section: tuple[float, float], turbine: Turbine, truth: Mapping[str, float], seed: int
) -> Seen:
    """Identify a part of a record with a prior that is drawn anew."""
    begun = time.process_time()
    prior = LogUniformPrior(seed=seed, air=AIR)
    found = identify(record, turbine, section=section, formulation="spectral", prior=prior)
    seconds = time.process_time() - begun
    errors, deviations, widths = {}, {}, {}
    for mode in found.modes:
        name = mode.name.partition(" (")[0].replace("tower x", "tower")
        if name in truth and name not in errors:
            f, std = mode.frequency.estimate, mode.frequency.std
            errors[name], deviations[name] = f / truth[name] - 1.0, (f - truth[name]) / std
            ratio = truth.get(f"{name} damping", max(mode.damping_ratio.estimate, 1e-4))
            widths[name] = std / f / frequency_bound(truth[name], ratio, section[1] - section[0])
    for e in found.estimates:
        known = truth.get(e.name, truth.get(e.name.rstrip("_123")))
        if e.kind in ("stiffness", "damping") and known is not None:
            value, std = (e.estimate, e.std) if e.tip is None else (e.tip["estimate"], e.tip["std"])
            errors[e.name], deviations[e.name] = value / known - 1.0, (value - known) / std
    return Seen(
        label, section, seed, errors, deviations, widths, _logarithm(found), found.diagnosis.trusted,
        tuple(found.diagnosis.reasons), seconds,
    )  # fmt: skip


def _logarithm(found: Identification) -> tuple[float, float]:
    k = found["k_x"]
    return math.log(k.estimate), k.std / k.estimate


def windows(length: float) -> list[tuple[float, float]]:
    """Disjoint windows of `length` [s]."""
    first, last = WINDY
    return [(first + k * length, first + (k + 1) * length) for k in range(int((last - first) / length + 1e-9))]


def truth_of(record: str) -> dict[str, float]:
    """Truths of a record, blades free to flap."""
    return {**TRUTH[record], "k_beta": FREE_TO_FLAP * TRUTH[record]["k_beta"]}


def of_openfast(folder: Path, seeds: int, lengths: Sequence[float]) -> Iterator[Seen]:
    """The records, whole with every prior, and in windows with the first."""
    turbine = load_turbine(ROTOR).exact()
    for label in ("c2", "d1"):
        record, truth = read_record(folder / FILES[label]), truth_of(label)
        parts = [(WINDY, seed) for seed in range(seeds)]
        parts += [(window, 0) for length in lengths for window in windows(length)]
        for section, seed in parts:
            yield look(label, record, section, turbine, truth, seed)


def of_simulation(rpm: Sequence[float], loads: Sequence[str], seeds: Sequence[int]) -> Iterator[Seen]:
    """Records simulated at several speeds, each with a prior drawn anew; the truth of stiffness is the file's, and that
    of the modes is what the model says."""
    for speed in rpm:
        turbine = replace(load_turbine(ROTOR).exact(), rotor_speed=speed * RPM)
        compiled = _compiled(turbine)
        p = np.array([turbine.values[name] for name in compiled.parameters])
        truth = {name: turbine.values[name] for name in ("k_x", "k_roll")}
        truth["k_beta"] = turbine.values["k_beta_1"] / turbine.tip_lever**2
        for name, frequency, _ in modes(turbine.model, compiled, p, turbine.rotor_speed):
            if (known := name.partition(" (")[0].replace("tower x", "tower")) in MODES:
                truth.setdefault(known, frequency)
        damping = {"c_x": turbine.values["c_x"], "c_beta": turbine.values["c_beta_1"] / turbine.tip_lever**2}
        for kind in loads:
            filed = truth if "wind" in kind else truth | damping  # the wind's is not the file's
            for seed in seeds:
                record = simulate_record(
                    turbine, duration=SIMULATED_SECONDS, rate=SIMULATED_RATE, seed=seed, loads=kind
                )
                yield look(f"{kind}, {speed:g} rpm", record, (0.0, SIMULATED_SECONDS), turbine, filed, seed)


def _compiled(turbine: Turbine):  # type: ignore[no-untyped-def]
    from windsysid.mechanics.compile import compile_model

    return compile_model(turbine.model, turbine.sensors)


def whole_table(seen: Sequence[Seen]) -> list[tuple[str, ...]]:
    """Error, error over σ and σ over the bound of everything with a truth, of the prior that errs most."""
    rows: list[tuple[str, ...]] = []
    for label in dict.fromkeys(s.label for s in seen):
        of = [s for s in seen if s.label == label]
        for name in of[0].errors:
            worst = max(of, key=lambda s: abs(s.errors[name]))
            bound = f"{max(s.widths[name] for s in of):.2f}" if name in worst.widths else ""
            cells = f"{100.0 * worst.errors[name]:+.2f} %", f"{worst.deviations[name]:+.1f}"
            rows.append((label, name, *cells, bound))
    return rows


def window_table(seen: Sequence[Seen]) -> list[tuple[str, ...]]:
    """rms error of frequencies, and rms of error over σ, by record and length."""
    rows: list[tuple[str, ...]] = []
    for key in dict.fromkeys((s.label, round(s.section[1] - s.section[0])) for s in seen):
        of = [s for s in seen if (s.label, round(s.section[1] - s.section[0])) == key]
        for name in MODES:
            e, z = (np.array([s._asdict()[kind][name] for s in of]) for kind in ("errors", "deviations"))
            rms = f"{100.0 * math.sqrt(np.mean(e**2)):.2f} %", f"{math.sqrt(np.mean(z**2)):.2f}"
            rows.append((key[0], f"{key[1]} s", name, str(len(of)), *rms, f"{sum(s.trusted for s in of)}"))
    return rows


def coverage_table(seen: Sequence[Seen]) -> list[tuple[str, ...]]:
    """Coverage of ±2σ and ±3σ, for all and for those that are trusted."""
    rows: list[tuple[str, ...]] = []
    for label in (*dict.fromkeys(s.label for s in seen), "all"):
        for which in ("all", "trusted"):
            of = [s for s in seen if label in (s.label, "all") and (s.trusted or which == "all")]
            if not of:
                continue
            shared = [name for name in of[0].deviations if all(name in s.deviations for s in of)]
            groups = {"modes": MODES, "stiffness": [n for n in shared if n.startswith("k_")]}
            groups["damping"] = [n for n in shared if n.startswith("c_")]
            for what, names in groups.items():
                if not names:
                    continue
                z = np.array([[s.deviations[name] for name in names] for s in of])
                held = [f"{100.0 * np.mean(np.abs(z) < k):.1f} %" for k in (2.0, 3.0)]
                far = f"{np.abs(z).max():.1f}"
                numbers = f"{z.mean():+.2f}", f"{math.sqrt(np.mean(z**2)):.2f}", far
                rows.append((label, which, str(len(of)), what, *held, *numbers))
    return rows


def ratio_lines(seen: Sequence[Seen]) -> list[str]:
    """k_x of d1 over that of c2, by prior."""
    lines = []
    for seed in sorted({s.seed for s in seen}):
        pair = {s.label: s.stiffness for s in seen if s.seed == seed}
        if {"c2", "d1"} <= set(pair):
            (a, sa), (b, sb) = pair["c2"], pair["d1"]
            ratio = math.exp(b - a)
            lines.append(f"k_x, d1 over c2: {ratio:.4f} ± {2.0 * ratio * math.hypot(sa, sb):.4f} (truth {RATIO:g})")
    return lines


def told(seen: Sequence[Seen]) -> list[str]:
    """Trust and processor time of each identification."""
    lines = []
    for s in seen:
        verdict = "trusted" if s.trusted else f"not trusted: {'; '.join(s.why)}"
        lines.append(f"{s.label}, {s.section[0]:g} … {s.section[1]:g} s, seed {s.seed}: {s.seconds:.1f} s, {verdict}")
    return lines


def _print(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    for heading in headings:
        table.add_column(heading)
    for row in rows:
        table.add_row(*row)
    print(render(table, width=140))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m validation.field_spectral", description=__doc__.splitlines()[0])
    parser.add_argument("--openfast", type=Path, help="folder of the OpenFAST records")
    parser.add_argument("--seeds", type=int, default=3, help="priors to start from (3)")
    parser.add_argument("--lengths", type=float, nargs="*", default=[270.0, 120.0, 60.0], help="of windows [s]")
    parser.add_argument("--simulated", action="store_true", help="simulate records instead")
    parser.add_argument("--rpm", type=float, nargs="+", default=[7.0, 9.0, 10.5, 12.1, 13.5])
    parser.add_argument("--loads", nargs="+", default=["wind-feedback"])
    parser.add_argument("--first", type=int, default=5000, help="first seed (5000)")
    parser.add_argument("--runs", type=int, default=4, help="records at each speed under each kind of loads (4)")
    given = parser.parse_args()
    if given.simulated:
        seen = []
        for one in of_simulation(given.rpm, given.loads, range(given.first, given.first + given.runs)):
            seen.append(one)
            z = ", ".join(f"{name} {value:+.1f}" for name, value in one.deviations.items())
            print(f"{told([one])[0]}\n    error/σ: {z}", flush=True)
        headings = ["records", "which", "number", "of", "±2σ", "±3σ hold", "mean error/σ", "rms error/σ", "worst"]
        _print(f"simulated, {SIMULATED_SECONDS:g} s", headings, coverage_table(seen))
        return
    if given.openfast is None:
        parser.error("expected --openfast FOLDER or --simulated")
    seen = []
    for one in of_openfast(given.openfast, given.seeds, given.lengths):
        seen.append(one)
        print(told([one])[0], flush=True)
    whole = [s for s in seen if s.section == WINDY]
    _print(
        f"whole records, {given.seeds} priors, of each quantity the one that errs most",
        ("record", "quantity", "error", "error/σ", "σ over bound"), whole_table(whole),
    )  # fmt: skip
    print("\n".join(ratio_lines(whole)))
    headings = ["record", "window", "mode", "windows", "rms error", "rms error/σ", "trusted"]
    _print("windows", headings, window_table([s for s in seen if s.section != WINDY]))


if __name__ == "__main__":
    main()

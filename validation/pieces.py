"""Do pieces give what the whole record gives?

``python -m validation.pieces [--openfast FOLDER] [--only NAME …]`` identifies each record twice, as a whole and in
pieces, and prints by how many standard deviations the coefficients differ at most: on stationary records (the reference
scenario, simulated turbulent wind, one's own equations, and with FOLDER the tower under the wind of OpenFAST's record
c2), by spectra, and on loads whose rms changes threefold within the record. Then it counts what 40 s of the reference
scenario cost: passes of single filters and of banks, and models built.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, NamedTuple
from unittest.mock import patch

import numpy as np
import sympy as sp

from windsysid.filters import bank
from windsysid.filters.protocol import Filter
from windsysid.identification.estimate import load_selection as load_choice
from windsysid.identification.estimate import scoring as posterior_mode
from windsysid.identification.identify import identify
from windsysid.identification.model import turbine_problem as problem
from windsysid.identification.streaming.identify_pieces import identify_pieces
from windsysid.models import Equations, GaussMarkov, Parameter, Reading, fit
from windsysid.output.console import render
from windsysid.records.formats import read_record
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.random_loads import draw_loads
from windsysid.simulation.record import simulate_record
from windsysid.statespace import compose
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["Case", "Comparison", "compare", "count_work", "cut", "modulated"]

STATIONARY, MODULATED = 0.1, 0.5
"""Standard deviations that pieces may be off the whole record."""

WINDY = (60.0, 600.0)
"""[s] of c2."""


class Case(NamedTuple):
    """A record to identify both ways, and how far they may be apart [standard deviations]."""

    name: str
    whole: Callable[[], Identification]
    pieces: Callable[[], Identification]
    within: float


class Comparison(NamedTuple):
    """Result of a run.

    Attributes
    ----------
    name
        Of the case.
    off
        The greatest difference of a coefficient [standard deviations].
    width
        The greatest ratio of its standard deviations, less 1.
    mode
        Frequency of the first mode [Hz], as a whole and in pieces; NaN where there is none.
    trusted
        Whether each is trusted.
    same_loads
        Whether both took the loads for the same.
    within
        Requirements.
    """

    name: str
    off: float
    width: float
    mode: tuple[float, float]
    trusted: tuple[bool, bool]
    same_loads: bool
    within: float


def cut(record: Record, seconds: float) -> list[Record]:
    """The record in pieces of so many seconds."""
    edges = np.searchsorted(record.time, np.arange(record.time[0], record.time[-1] + seconds, seconds) - 1e-9)
    edges[-1] = record.samples
    return [replace(record, time=record.time[a:b], values=record.values[a:b]) for a, b in pairwise(edges) if b - a > 1]


def compare(case: Case) -> Comparison:
    """Identify a record both ways."""
    whole, found = case.whole(), case.pieces()
    off = max(abs(e.estimate - whole[e.name].estimate) / e.std for e in found.estimates)
    width = max(abs(e.std / whole[e.name].std - 1.0) for e in found.estimates)
    mode = _first_mode(whole), _first_mode(found)
    loads = [[one for one in i.findings if one.code == "load_model_chosen"] for i in (whole, found)]
    trusted = whole.diagnosis.trusted, found.diagnosis.trusted
    return Comparison(case.name, off, width, mode, trusted, loads[0] == loads[1], case.within)


def _first_mode(found: Identification) -> float:
    return found.modes[0].frequency.estimate if found.modes else np.nan


def modulated(turbine: Turbine, duration: float, rate: float, seed: int) -> Record:
    """The reference scenario with loads that are three times as loud in its second half, and a third as loud in its
    last quarter."""
    from windsysid.mechanics.compile import compile_model

    rng = np.random.default_rng(seed)
    model = compile_model(turbine.model, turbine.sensors)
    p = np.array([turbine.values[name] for name in model.parameters])
    samples = round(duration * rate)
    rotor = constant_speed_inputs(turbine.rotor_speed, duration, rate)[:samples]
    loads = draw_loads(turbine.loads, model.loads, samples, rate, rng)
    time = np.arange(samples) / rate
    loads *= np.where(time < 0.5 * duration, 1.0, np.where(time < 0.75 * duration, 3.0, 1.0 / 3.0))[:, None]
    exact = integrate(model, p, np.hstack([rotor, loads]), rate=rate, start=np.zeros(len(model.states)))
    readings = exact.readings + rng.standard_normal(exact.readings.shape) * [s.noise for s in turbine.sensors]
    return Record(
        time, np.column_stack([np.mod(rotor[:, 0], 2.0 * np.pi), rotor[:, 1], readings]),
        ("rotor_azimuth", "rotor_speed", *(s.channel for s in turbine.sensors)),
        ("rad", "rad/s", *(s.unit for s in turbine.sensors)), name="modulated loads",
    )  # fmt: skip


def _own(pieces: float | None) -> Identification:
    """Two masses on springs under a random force that are not measured, as equations of one's own."""
    q1, v1, q2, v2, w = sp.symbols("q1 v1 q2 v2 w", real=True)
    m, k1, k2, c1, c2 = sp.symbols("m k1 k2 c1 c2", positive=True)
    a1 = (w - k1 * q1 - c1 * v1 + k2 * (q2 - q1) + c2 * (v2 - v1)) / m
    a2 = (-k2 * (q2 - q1) - c2 * (v2 - v1)) / m
    model = Equations("two masses", (q1, v1, q2, v2), (), (m, k1, k2, c1, c2), (w,), (v1, a1, v2, a2))
    truth = {"m": 2.0, "k1": 900.0, "k2": 500.0, "c1": 1.2, "c2": 0.7}
    sensors = (Reading("low", a1, 0.02), Reading("high", a2, 0.02))
    load = GaussMarkov("w", 5.0, 0.5)
    built = compose.compose(model, rate=50.0, values=truth, loads=[load], sensors=sensors, cov=np.eye(4))
    rng = np.random.default_rng(3)
    force = draw_loads([load], built.compiled.loads, 10_000, 50.0, rng)
    exact = integrate(built.compiled, built.blocks.p, force, rate=50.0, start=np.zeros(4), substeps=4).readings
    noisy = exact + 0.02 * rng.standard_normal(exact.shape)
    record = Record(np.arange(len(noisy)) / 50.0, noisy, ("low", "high"), ("m/s^2",) * 2, name="two masses")
    parameters = [Parameter(name, 1.2 * truth[name], 0.3) for name in ("k1", "k2")]
    parameters += [Parameter(name, 1.5 * truth[name], 0.7) for name in ("c1", "c2")]
    return fit(
        model, record if pieces is None else cut(record, pieces), parameters=parameters, sensors=sensors, loads=[load],
        cov=0.01 * np.eye(4), values={"m": 2.0},
    )  # fmt: skip


def _both(
    name: str, record: Record, turbine: Turbine, seconds: float, within: float,
    formulation: Literal["joint", "spectral"] = "joint",
) -> Case:  # fmt: skip
    return Case(
        f"{name}, {record.duration:.0f} s in pieces of {seconds:g} s",
        lambda: identify(record, turbine, formulation=formulation),
        lambda: identify_pieces(cut(record, seconds), turbine, formulation=formulation),
        within,
    )


def cases(openfast: Path | None) -> Iterator[Case]:
    """The records, the cheap ones first."""
    scale, tower = load_turbine("verne555").exact(), load_turbine("tower").exact()
    reference = simulate_record(scale, duration=100.0, rate=100.0, seed=1)
    yield _both("reference scenario", reference, scale, 10.0, STATIONARY)
    yield _both("reference scenario", reference, scale, 37.0, STATIONARY)
    yield _both("modulated loads", modulated(scale, 100.0, 100.0, 1), scale, 10.0, MODULATED)
    yield Case("own equations, 200 s in pieces of 15 s", lambda: _own(None), lambda: _own(15.0), STATIONARY)
    noisy = simulate_record(scale, duration=200.0, rate=50.0, seed=1)
    yield _both("spectra, reference scenario", noisy, scale, 50.0, STATIONARY, "spectral")
    standing = simulate_record(tower, duration=3600.0, rate=5.0, seed=1)
    yield _both("spectra, tower", standing, tower, 600.0, STATIONARY, "spectral")
    yield _both("tower", simulate_record(tower, duration=600.0, rate=20.0, seed=1), tower, 60.0, STATIONARY)
    if openfast is not None:
        c2 = read_record(openfast / "c2_turb12_full.outb").select(["tower_x_acceleration", "tower_z_acceleration"])
        yield _both("tower c2", c2.section(*WINDY), tower, 60.0, STATIONARY)
    wind = simulate_record(scale, duration=60.0, rate=50.0, seed=0, loads="wind")
    yield _both("simulated wind", wind, scale, 10.0, STATIONARY)


class Work(NamedTuple):
    """Passes of single filters and of banks, with the samples that they took, and models built."""

    filters: int
    filtered: int
    banks: int
    banked: int
    models: int


@contextmanager
def count_work() -> Iterator[list[int]]:
    """Count what goes on inside: the numbers of a `Work`, which grow."""
    count = [0] * len(Work._fields)
    passed, banked, built = Filter._filter, bank.run_bank, compose.parameters_given

    def filter_(self: Filter, model: Any, belief: Any, inputs: Any, readings: Any, **more: Any) -> Any:
        count[0] += len(inputs) > 0 and belief.samples == 0
        count[1] += len(inputs)
        return passed(self, model, belief, inputs, readings, **more)

    def run(of: Any, inputs: Any, *more: Any) -> Any:
        count[2] += len(inputs) > 0
        count[3] += len(inputs) * of.filters
        return banked(of, inputs, *more)

    def build(*given: Any) -> Any:
        count[4] += 1
        return built(*given)

    with ExitStack() as stack:
        stack.enter_context(patch.object(Filter, "_filter", filter_))
        for module in (load_choice, posterior_mode):
            stack.enter_context(patch.object(module, "run_bank", run))
        stack.enter_context(patch.object(problem, "parameters_given", build))
        yield count


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, and print both tables."""
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.pieces", description=__doc__)
    parser.add_argument("--openfast", type=Path, metavar="FOLDER", help="where c2's .outb is")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="cases whose names begin so; none but the counts: -")
    options = parser.parse_args(arguments)
    table = Table(title="Pieces against the whole record", title_justify="left")
    for heading in ("record", "most off, σ", "asked", "σ off, %", "first mode, Hz", "trusted", "same loads"):
        table.add_column(heading)
    for case in cases(options.openfast):
        if options.only and not case.name.startswith(tuple(options.only)):
            continue
        c = compare(case)
        mode = "" if np.isnan(c.mode[0]) else f"{c.mode[0]:.4f}, {c.mode[1]:.4f}"
        trusted = ", ".join("yes" if t else "no" for t in c.trusted)
        same = "yes" if c.same_loads else "no"
        table.add_row(c.name, f"{c.off:.3f}", f"{c.within:g}", f"{100 * c.width:.2f}", mode, trusted, same)
        print(f"{c.name}: {c.off:.3f} σ", flush=True)
    print(render(table))
    scale = load_turbine("verne555").exact()
    record = simulate_record(scale, duration=40.0, rate=100.0, seed=1)
    work = Table(title="40 s of the reference scenario (4000 samples)", title_justify="left")
    for heading in ("", "filter passes", "samples", "bank runs", "samples × filters", "models"):
        work.add_column(heading)
    runs: dict[str, Callable[[], object]] = {
        "whole": lambda: identify(record, scale, formulation="joint"),
        "pieces": lambda: identify_pieces(cut(record, 8.0), scale),
    }
    for name, run in runs.items():
        with count_work() as count:
            run()
        work.add_row(name, *map(str, count))
    print(render(work))


if __name__ == "__main__":
    main()

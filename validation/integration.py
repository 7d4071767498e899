"""The table of integration methods: rms error of velocity and displacement against truth.

``python -m validation.integration`` prints it. Truth is the simulator's own motion: of the scale model
(windsysid's simulator; tower and blade) and, where the data are at hand, of OpenFAST's NREL 5 MW tower (a2: free decay;
c2: turbulent wind, from 60 s on). White noise, and a bias with a drift, are added to the exact acceleration.

Errors are relative to the rms of the true motion without its mean: ``total``, with all that lies below the cut-off and
is not knowable, and ``band``, both sides high-passed at 1.5 times the cut-off. The cut-off is half the rotor frequency.
"""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.records.record import Record
from windsysid.signals import METHODS, band_pass, integrate

__all__ = ["Row", "Truth", "integration_table", "openfast_truths", "simulated_truths", "summary", "tabulate"]


NOISE = (0.0, 0.01, 0.05, 0.20)
"""Standard deviation of the noise of a sample, as a share of the acceleration's rms."""

DURATIONS = (30.0, 100.0, 600.0)
"""[s]"""

BIAS = (0.5, 0.5)
"""Bias, and drift over the record, as shares of the acceleration's rms."""


class Truth(NamedTuple):
    """One motion that is known: acceleration, velocity and displacement (T,), and how to integrate it."""

    name: str
    rate: float
    cutoff: float
    acceleration: Array
    velocity: Array
    displacement: Array
    roll_per_metre: float = 0.0


class Row(NamedTuple):
    """One case and method; errors are relative, 1 is as large as the motion itself."""

    motion: str
    duration: float
    noise: float
    drifting: bool
    method: str
    velocity: float
    displacement: float
    velocity_in_band: float
    displacement_in_band: float


def integration_table(
    truths: Sequence[Truth],
    *,
    noise: Sequence[float] = NOISE,
    durations: Sequence[float] = DURATIONS,
    drifting: Sequence[bool] = (False, True),
    seed: int = 0,
) -> list[Row]:
    """Integrate every truth by every method; rows in the order of the arguments, reproducible for a seed.

    A duration longer than a truth stands for all of it; shorter ones are taken from its middle.
    """
    rows = []
    for truth in truths:
        lengths = sorted({min(round(seconds * truth.rate), len(truth.acceleration)) for seconds in durations})
        for samples in lengths:
            start = (len(truth.acceleration) - samples) // 2
            part = slice(start, start + samples)
            exact = (truth.velocity[part], truth.displacement[part])
            scale = float(np.std(truth.acceleration[part]))
            for level in noise:
                for drifts in drifting:
                    rng = np.random.default_rng(seed)
                    read = truth.acceleration[part] + level * scale * rng.standard_normal(samples)
                    if drifts:
                        read = read + scale * (BIAS[0] + BIAS[1] * np.linspace(0.0, 1.0, samples))
                    for method in METHODS:
                        kappa = truth.roll_per_metre if method in ("frequency", "kalman") else 0.0
                        motion = integrate(read, truth.rate, cutoff=truth.cutoff, method=method, roll_per_metre=kappa)
                        total = [_relative(got - true, true) for got, true in zip(motion, exact, strict=True)]
                        band = (1.5 * truth.cutoff, truth.rate / 2.0)
                        inside = [
                            _relative(band_pass(got - true, truth.rate, band), band_pass(true, truth.rate, band))
                            for got, true in zip(motion, exact, strict=True)
                        ]
                        rows.append(Row(truth.name, samples / truth.rate, level, drifts, method, *total, *inside))
    return rows


def _relative(error: Array, true: Array) -> float:
    return float(np.std(error) / np.std(true))


def simulated_truths(*, duration: float = 600.0, seed: int = 0) -> list[Truth]:
    """The scale model's tower and first blade under its random loads, 100 Hz."""
    from windsysid.mechanics.compile import compile_model
    from windsysid.simulation.integrate import constant_speed_inputs
    from windsysid.simulation.integrate import integrate as respond
    from windsysid.simulation.random_loads import draw_loads
    from windsysid.simulation.record import MIN_LEAD_IN_SECONDS
    from windsysid.turbine.file import load_turbine

    turbine, rate = load_turbine("verne555").exact(), 100.0
    model = compile_model(turbine.model)
    n = len(turbine.model.coordinates)
    rotor = constant_speed_inputs(turbine.rotor_speed, MIN_LEAD_IN_SECONDS + duration, rate)
    loads = draw_loads(turbine.loads, model.loads, len(rotor), rate, np.random.default_rng(seed))
    p = np.array([turbine.values[name] for name in model.parameters])
    response = respond(model, p, np.hstack([rotor, loads]), rate=rate, start=np.zeros(2 * n))
    lead = round(MIN_LEAD_IN_SECONDS * rate)
    cutoff = 0.5 * turbine.rotor_speed / (2.0 * np.pi)
    return [
        Truth(
            name, rate, cutoff, response.rates[lead:, n + j], response.states[lead:, n + j], response.states[lead:, j]
        )
        for name, j in (
            ("scale model, tower x", 0),
            ("scale model, blade 1", turbine.model.coordinates.index("beta_1")),
        )
    ]


def openfast_truths(folder: Path) -> Iterator[Truth]:
    """The 5 MW tower's side-side motion in OpenFAST's records a2 and c2, without gravity and as sensors read it."""
    from windsysid.records.formats import read_record
    from windsysid.turbine.file import load_turbine

    tied_roll = load_turbine("nrel5mw").exact().values["kappa"]
    for short, file, start in (("a2", "a2_rot12_decay_min.outb", 0.0), ("c2", "c2_turb12_full.outb", 60.0)):
        record: Record = read_record(folder / file)
        record = record.section(start, float(record.time[-1]) + 1e-6)
        cutoff = 0.5 * float(record["rotor_speed"].mean()) / (2.0 * np.pi)
        velocity, displacement = record["tower_x_velocity"], record["tower_x_displacement"]
        for channel, what, kappa in (
            ("tower_x_acceleration_kinematic", "", 0.0),
            ("tower_x_acceleration", ", feels gravity", tied_roll),
        ):
            yield Truth(f"OpenFAST {short}{what}", record.rate, cutoff, record[channel], velocity, displacement, kappa)


def tabulate(rows: Sequence[Row]) -> object:
    """A Rich table: a line per case, a column per method; "velocity / displacement" in %, total and in band."""
    from rich import box
    from rich.table import Table

    table = Table(title="rms error of velocity / displacement, % of the motion", title_justify="left", box=box.SIMPLE)
    for name in ("motion", "s", "noise %", "bias"):
        table.add_column(name, justify="left" if name == "motion" else "right")
    methods = list(dict.fromkeys(row.method for row in rows))
    for measure in ("total", "band"):
        for method in methods:
            table.add_column(f"{method}\n{measure}", justify="right")
    cases: dict[tuple[str, float, float, bool], dict[str, Row]] = {}
    for row in rows:
        cases.setdefault(row[:4], {})[row.method] = row
    for (motion, seconds, noise, drifting), found in cases.items():
        total = [_pair(found[m].velocity, found[m].displacement) for m in methods]
        band = [_pair(found[m].velocity_in_band, found[m].displacement_in_band) for m in methods]
        table.add_row(motion, f"{seconds:.0f}", f"{100 * noise:.0f}", "drifts" if drifting else "–", *total, *band)
    return table


def _pair(velocity: float, displacement: float) -> str:
    return f"{_percent(velocity)} / {_percent(displacement)}"


def _percent(share: float) -> str:
    percent = 100.0 * share
    return f"{percent:.2f}" if percent < 1.0 else f"{percent:.1f}" if percent < 99.95 else f"{percent:.3g}"


def summary(rows: Sequence[Row]) -> object:
    """A Rich table: per method, median and worst error over `rows`, in percent."""
    from rich import box
    from rich.table import Table

    table = Table(title="over all cases without gravity: median and worst, %", title_justify="left", box=box.SIMPLE)
    table.add_column("method")
    measures = ("velocity", "displacement", "velocity_in_band", "displacement_in_band")
    for measure in measures:
        table.add_column(measure.replace("_", " "), justify="right")
    for method in dict.fromkeys(row.method for row in rows):
        errors = np.array([[getattr(row, measure) for measure in measures] for row in rows if row.method == method])
        middle, worst = np.median(errors, axis=0), errors.max(axis=0)
        table.add_row(method, *(f"{_percent(m)}, {_percent(w)}" for m, w in zip(middle, worst, strict=True)))
    return table


def main(folder: Path | None = None) -> list[Row]:
    """Print the table; `folder` holds OpenFAST's records, ``shared/data/openfast`` next to the checkout by default."""
    from windsysid.output.console import render

    folder = folder or _shared()
    truths = simulated_truths()
    note = ""
    if folder is not None and (folder / "a2_rot12_decay_min.outb").is_file():
        truths += openfast_truths(folder)
    else:
        note = "OpenFAST's records are not beside this checkout; give their folder as an argument"
    rows = integration_table(truths)
    told = [row for row in rows if "gravity" not in row.motion]  # where no method knows more than another
    print(render(tabulate(rows), summary(told), note, width=190))
    return rows


def _shared() -> Path | None:
    for parent in (Path.cwd(), *Path.cwd().parents):
        for folder in (parent / "shared" / "data" / "openfast", parent.parent / "shared" / "data" / "openfast"):
            if folder.is_dir():
                return folder
    return None


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)

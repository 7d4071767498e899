"""Do bands cover the true values where instruments and masses are off? Records of a machine that is not as its file
says.

``python -m validation.tolerances [--runs N] [--first SEED] [--only BEGINNING …]`` prints the table. Each record is
simulated at 1 kHz; a logger that is late by κ samples at t − κ what the others sample at t. The machine is identified
from its file as ``identify`` is asked by default, with the tolerances that a file has by default. It is compared with
what a file that claims to be exact gives (``--exact``). The errors of both on a machine that is as its file says show
what tolerances cost; those on one that is not, what they are worth.
"""

import argparse
import math
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.identification.identify import identify
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.sensors import instrument_parameters
from windsysid.output.console import render
from windsysid.records.record import Record
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.random_loads import draw_loads
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["SCENARIOS", "Errors", "Outcome", "record_of", "run"]

FINE, RATE, DURATION, LEAD_IN = 1000.0, 100.0, 100.0, 30.0
"""[Hz], [Hz], [s], [s]"""


HOLDS = ("±2σ holds", "k_x, k_y", "c_x, c_y", "k_β", "c_β", "beyond 5σ")
HEADINGS = (*HOLDS, "rms error of k", "of c", "σ of k_x", "trusted", "named")


class Errors(NamedTuple):
    """Differences of a machine from its file.

    Attributes
    ----------
    gain, turn
        Of the sensors by number from 0: a share, and [rad].
    mass
        Of bodies by name: a share.
    late
        Of loggers by name [s].
    """

    gain: Mapping[int, float] = {}
    turn: Mapping[int, float] = {}
    mass: Mapping[str, float] = {}
    late: Mapping[str, float] = {}


def gains(turbine: Turbine, rng: np.random.Generator) -> Errors:
    """Gains drawn from their tolerance."""
    return Errors(gain={i: s.gain_tolerance * rng.standard_normal() for i, s in enumerate(turbine.sensors)})


def everything(turbine: Turbine, rng: np.random.Generator) -> Errors:
    """All that has a tolerance, drawn from it."""
    return Errors(
        gains(turbine, rng).gain,
        {i: s.alignment * rng.standard_normal() for i, s in enumerate(turbine.sensors)},
        {body: turbine.mass_tolerance * rng.standard_normal() for body in turbine.model.bodies()},
        {"rotor": 0.001 * rng.standard_normal()},
    )


SCENARIOS: dict[str, Callable[[Turbine, np.random.Generator], Errors]] = {
    "as the file says": lambda turbine, rng: Errors(),
    "tower x sensor 5° off axis": lambda turbine, rng: Errors(turn={0: math.radians(5.0)}),
    "blade logger 2 ms late": lambda turbine, rng: Errors(late={"rotor": 0.002}),
    "all masses 2 % heavier": lambda turbine, rng: Errors(mass=dict.fromkeys(turbine.model.bodies(), 0.02)),
    "gains drawn": gains,
    "everything drawn": everything,
}


def record_of(turbine: Turbine, errors: Errors, seed: int) -> Record:
    """Record of a machine with the file's coefficients whose instruments and masses are off."""
    rng = np.random.default_rng(seed)
    bodies = turbine.model.bodies()
    heavier = {name: turbine.values[name] * (1.0 + off) for body, off in errors.mass.items() for name in bodies[body]}
    built = turbine.with_values(heavier)
    values = dict(built.values)
    for i in range(len(turbine.sensors)):
        gain, turn = instrument_parameters(i)
        values |= {gain: errors.gain.get(i, 0.0), turn: errors.turn.get(i, 0.0)}
    model = compile_model(turbine.model, turbine.sensors, instruments=True)
    rotor = constant_speed_inputs(turbine.rotor_speed, LEAD_IN + DURATION + 0.1, FINE)
    loads = draw_loads(turbine.loads, model.loads, len(rotor), FINE, rng)
    p = np.array([values[name] for name in model.parameters])
    inputs = np.hstack([rotor, loads])
    readings = integrate(model, p, inputs, rate=FINE, start=np.zeros(len(model.states)), substeps=1).readings
    fine = np.arange(len(rotor)) / FINE
    time = np.arange(round(DURATION * RATE)) / RATE
    taken = [LEAD_IN + time - errors.late.get(sensor.sampled_by, 0.0) for sensor in turbine.sensors]
    columns = [np.interp(at, fine, column) for at, column in zip(taken, readings.T, strict=True)]
    noise = rng.standard_normal((len(time), len(columns))) * [sensor.noise for sensor in turbine.sensors]
    psi = np.interp(LEAD_IN + time, fine, rotor[:, 0])
    return Record(
        time=time,
        values=np.column_stack([np.mod(psi, 2.0 * np.pi), np.full(len(time), turbine.rotor_speed), *columns])
        + np.hstack([np.zeros((len(time), 2)), noise]),
        channels=("rotor_azimuth", "rotor_speed", *(sensor.channel for sensor in turbine.sensors)),
        units=("rad", "rad/s", *(sensor.unit for sensor in turbine.sensors)),
        name=f"simulated record, seed {seed}",
    )


class Outcome(NamedTuple):
    """One identified record.

    Attributes
    ----------
    error
        estimate / truth − 1 of each coefficient (n,).
    deviation
        (estimate − truth) / σ of each (n,).
    width
        σ of each in filter coordinates (n,).
    trusted
        Whether the result is.
    named
        Instruments and masses that the record shows to be off.
    """

    error: Array
    deviation: Array
    width: Array
    trusted: bool
    named: tuple[str, ...]


def run(seed: int, scenario: str, *, exact: bool = False) -> Outcome:
    """Simulate and identify one record."""
    turbine = load_turbine("verne555")
    errors = SCENARIOS[scenario](turbine, np.random.default_rng([seed, 7]))
    record = record_of(turbine, errors, seed)
    result = identify(record, turbine.exact() if exact else turbine, prior=DrawnPrior(seed=seed))
    coefficients = [q for q in result.parameters if q.name in turbine.values]  # a load model may have its own
    true = np.array([turbine.values[q.name] for q in coefficients])
    estimate = np.array([result[q.name].estimate for q in coefficients])
    truth, found = (
        np.array([q.coordinate(v) for q, v in zip(coefficients, values, strict=True)]) for values in (true, estimate)
    )
    width = np.sqrt(np.diag(result.cov))[[q.name in turbine.values for q in result.parameters]]
    named = tuple(one.name for one in result.tolerances if one.off or one.contradicted)
    return Outcome(estimate / true - 1.0, (found - truth) / width, width, result.diagnosis.trusted, named)


def main() -> None:
    """Print the table."""
    from rich.console import Console
    from rich.progress import track
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.tolerances", description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="records per row (20)")
    parser.add_argument("--first", type=int, default=5000, help="seed of the first (5000)")
    parser.add_argument("--jobs", type=int, default=None, help="processes (all cores)")
    parser.add_argument("--exact", action="store_true", help="with a file that claims to be exact")
    parser.add_argument("--only", nargs="+", default=[""], metavar="BEGINNING", help="rows whose names begin so (all)")
    options = parser.parse_args()
    rows = [name for name in SCENARIOS if name.startswith(tuple(options.only))]
    jobs = [(name, options.first + i) for name in rows for i in range(options.runs)]
    with ProcessPoolExecutor(options.jobs) as pool:
        waiting = [pool.submit(partial(run, exact=options.exact), seed, name) for name, seed in jobs]
        found = [job.result() for job in track(waiting, description="tolerances", console=Console(stderr=True))]
    table = Table(title=f"{options.runs} runs of {DURATION:g} s, priors 30 % off", title_justify="left")
    table.add_column("record")
    for heading in HEADINGS:
        table.add_column(heading, justify="right")
    for name in rows:
        mine = [one for one, (of, _) in zip(found, jobs, strict=True) if of == name]
        off = np.abs([one.deviation for one in mine])
        holds = [off, off[:, [0, 2]], off[:, [1, 3]], off[:, 4::2], off[:, 5::2]]
        shares = [f"{100.0 * np.mean(part < 2.0):.0f} %" for part in holds]
        error = np.array([one.error for one in mine])
        rms = [f"{100.0 * math.sqrt(np.mean(error[:, i::2] ** 2)):.2f} %" for i in (0, 1)]
        every = [what for one in mine for what in one.named]
        counts = ", ".join(f"{what} {every.count(what)}" for what in dict.fromkeys(every))
        width = f"{100.0 * np.mean([one.width[0] for one in mine]):.2f} %"
        trusted = f"{sum(one.trusted for one in mine)} of {len(mine)}"
        table.add_row(name, *shares, str(int((off > 5.0).sum())), *rms, width, trusted, counts)
    print(render(table))


if __name__ == "__main__":
    main()

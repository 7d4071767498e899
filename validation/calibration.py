"""Are the bands true? Monte Carlo: how often ±2σ covers the true value, and how far the errors are from the least that
is possible.

Every run simulates a record of the scale model, draws priors 30 % off, and identifies it as a user would: nothing gives
the statistics of loads and noise. ``python -m validation.calibration [--scenario NAME] [--runs N]`` prints the table.

The errors are compared with the Bayesian Cramér–Rao bound (van Trees 1968, ch. 2.4): the inverse of the expected Fisher
information of coefficients and statistics together, at the truth, plus the prior's.
"""

import argparse
import math
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.identification.condition.readings import usable_sensors
from windsysid.identification.estimate.scoring import DIFFERENCE_STEP_SIGMAS, information
from windsysid.identification.identify import identify
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import pose
from windsysid.mechanics.compile import compile_model
from windsysid.output.console import render
from windsysid.records.record import Record
from windsysid.simulation.integrate import constant_speed_inputs, integrate
from windsysid.simulation.random_loads import draw_loads, draw_within_steps
from windsysid.simulation.record import simulate_record
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["Run", "Scenario", "bound", "calibrate", "judge", "scenarios"]


RATE = 100.0
DURATION = 100.0

ONLINE = (50.0, 100.0)
"""When the on-line estimate is judged [s]."""

BOUND_RUNS = 20
"""Records over which the Fisher information is averaged."""


class Scenario(NamedTuple):
    """Options of the records.

    Attributes
    ----------
    record
        The record of a turbine for a seed.
    turbine
        What made it: the file's turbine, with its loads and noise as they truly are.
    """

    record: Callable[[Turbine, int], Record]
    turbine: Turbine


class Run(NamedTuple):
    """One identified record, the last axis being the coefficients.

    Attributes
    ----------
    seed
        What the record and the prior were drawn with.
    deviation
        (estimate − truth) / σ of the result, and of the on-line estimate at `ONLINE` (1 + 2, n).
    error
        The same, not divided: relative error of stiffness, difference over 2√(km) of damping, as the filter's
        coordinates have them.
    relative
        Relative errors (1 + 2, n).
    """

    seed: int
    deviation: Array
    error: Array
    relative: Array


def stationary(turbine: Turbine, seed: int) -> Record:
    """The reference scenario: stationary vibration under random loads."""
    return simulate_record(turbine, duration=DURATION, rate=RATE, seed=seed)


def free_decay(turbine: Turbine, seed: int) -> Record:
    """A release from 30 mm off rest."""
    return measured(turbine, constant_speed_inputs(turbine.rotor_speed, DURATION, RATE), seed, 0.03)


def measured(turbine: Turbine, rotor: Array, seed: int, offset: float = 0.0) -> Record:
    """Simulate the sensors of the turbine under its random loads, the rotor turning as `rotor` (T, 3).

    The hub is released `offset` [m] from rest, at 45° between x and y.
    """
    rng = np.random.default_rng(seed)
    model = compile_model(turbine.model, turbine.sensors)
    asked = turbine.loads, model.loads, len(rotor), RATE
    loads, within = draw_loads(*asked, rng), draw_within_steps(*asked, rng.spawn(1)[0])
    start = np.zeros(len(model.states))
    start[:2] = offset / math.sqrt(2.0)
    p = np.array([turbine.values[name] for name in model.parameters])
    response = integrate(model, p, np.hstack([rotor, loads]), rate=RATE, start=start, substeps=2, within=within)
    readings = response.readings
    readings = readings + rng.standard_normal(readings.shape) * [sensor.noise for sensor in turbine.sensors]
    return Record(
        time=np.arange(len(rotor)) / RATE,
        values=np.hstack([np.mod(rotor[:, :1], 2.0 * np.pi), rotor[:, 1:2], readings]),
        channels=("rotor_azimuth", "rotor_speed", *(sensor.channel for sensor in turbine.sensors)),
        units=("rad", "rad/s", *(sensor.unit for sensor in turbine.sensors)),
        name=f"simulated record, seed {seed}",
    )


def quieter(turbine: Turbine, loads: float, noise: float) -> Turbine:
    """The turbine with weaker loads and less noise."""
    return replace(
        turbine,
        loads=tuple(replace(load, rms=load.rms / loads) for load in turbine.loads),
        sensors=tuple(sensor.model_copy(update={"noise": sensor.noise / noise}) for sensor in turbine.sensors),
    )


@lru_cache(maxsize=1)
def scenarios() -> dict[str, Scenario]:
    """``reference``; and ``free-decay``, very informative: loads twenty and noise ten times weaker than the file's."""
    turbine = load_turbine("verne555").exact()
    return {
        "reference": Scenario(stationary, turbine),
        "free-decay": Scenario(free_decay, quieter(turbine, loads=20.0, noise=10.0)),
    }


def judge(record: Record, turbine: Turbine, seed: int) -> Run:
    """Identify a record of a turbine whose coefficients are true, from a prior drawn with `seed`."""
    result = identify(record, turbine, formulation="joint", prior=DrawnPrior(seed=seed))
    reference = np.array([turbine.values[q.name] for q in result.parameters])
    truth, estimate = (
        np.array([q.coordinate(value) for q, value in zip(result.parameters, values, strict=True)])
        for values in (reference, [e.estimate for e in result.estimates])
    )
    at = [int(np.searchsorted(result.time, result.time[0] + t - 0.5 / RATE)) - 1 for t in ONLINE]
    means = np.vstack([estimate, result.mean[at]])
    stds = np.vstack([np.sqrt(np.diag(result.cov)), result.std[at]])
    physical = np.stack([q.physical(means[:, k]) for k, q in enumerate(result.parameters)], axis=-1)
    return Run(seed, (means - truth) / stds, means - truth, physical / reference - 1.0)


def _one_run(name: str, seed: int) -> Run:
    scenario = scenarios()[name]
    return judge(scenario.record(scenario.turbine, seed), load_turbine("verne555").exact(), seed)


def calibrate(name: str, runs: int) -> Iterator[Run]:
    """Identify `runs` records of a scenario, seeds 0, 1, …; the same on any number of processors."""
    with ProcessPoolExecutor() as pool:
        yield from pool.map(partial(_one_run, name), range(runs))


def bound(name: str, duration: float, runs: int = BOUND_RUNS) -> Array:
    """Least rms error of each coefficient in filter coordinates (n,): the Bayesian Cramér–Rao bound."""
    scenario, turbine = scenarios()[name], scenarios()[name].turbine
    fishers = []
    for seed in range(runs):
        record = scenario.record(turbine, seed).section(0.0, duration)
        problem = pose(record, turbine, usable_sensors(record, turbine, None), Prior())
        at, prior = problem.prior[0], np.linalg.inv(problem.prior[1])
        widths = DIFFERENCE_STEP_SIGMAS * np.full(len(at), 0.02)
        for _ in range(2):  # the second time with widths that fit the information
            fisher = information(problem.build, problem.inputs, problem.readings, at, widths)[1]
            widths = DIFFERENCE_STEP_SIGMAS / np.sqrt(np.diag(fisher + prior))
        fishers.append(fisher)
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(np.mean(fishers, axis=0) + prior)))[: len(problem.parameters)])


def binomial_interval(runs: int) -> tuple[float, float]:
    """The exact 99.9 % interval of the share of `runs` that ±2σ bands hold when they are right."""
    from scipy.stats import binom, norm

    share = norm.cdf(2.0) - norm.cdf(-2.0)
    return float(binom.ppf(0.0005, runs, share)) / runs, float(binom.ppf(0.9995, runs, share)) / runs


def main() -> None:
    """Print coverage, errors and bounds."""
    from rich.console import Console
    from rich.progress import track
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.calibration", description=__doc__)
    parser.add_argument("--scenario", choices=list(scenarios()), default="reference")
    parser.add_argument("--runs", type=int, default=40, help="records to identify (40)")
    options = parser.parse_args()
    found = calibrate(options.scenario, options.runs)
    runs = list(track(found, description=options.scenario, total=options.runs, console=Console(stderr=True)))
    names = list(load_turbine("verne555").exact().coefficients)
    judged = [*((f"on line, {t:g} s", i + 1, t) for i, t in enumerate(ONLINE)), ("whole record", 0, DURATION)]
    deviation, error, relative = (
        np.array([getattr(r, part) for r in runs]) for part in ("deviation", "error", "relative")
    )
    least = {t: bound(options.scenario, t) for t in sorted({t for _, _, t in judged})}
    low, high = binomial_interval(len(runs))
    for label, i, duration in judged:
        title = f"{options.scenario}, {label}: {len(runs)} runs, priors 30 % off, statistics not given"
        table = Table(title=title, title_justify="left")
        table.add_column("coefficient")
        for heading in ("±2σ holds", "rms of error/σ", "rms error", "over the bound"):
            table.add_column(heading, justify="right")
        holds, z = np.abs(deviation[:, i]) < 2.0, np.sqrt(np.mean(deviation[:, i] ** 2, axis=0))
        ratio = np.sqrt(np.mean(error[:, i] ** 2, axis=0)) / least[duration]
        percent = 100.0 * np.sqrt(np.mean(relative[:, i] ** 2, axis=0))
        for k, name in enumerate(names):
            share = float(holds[:, k].mean())
            mark = "" if low <= share <= high else " !"
            table.add_row(name, f"{100.0 * share:.1f} %{mark}", f"{z[k]:.2f}", f"{percent[k]:.2f} %", f"{ratio[k]:.2f}")
        pooled = [
            f"{100.0 * holds.mean():.1f} %",
            f"{np.sqrt(np.mean(z**2)):.2f}",
            "",
            f"{np.sqrt(np.mean(ratio**2)):.2f}",
        ]
        table.add_row("all", *pooled, end_section=True)
        print(render(table))
    print(
        f"A single coefficient is held in {100 * low:.1f} … {100 * high:.1f} % by true bands, 999 times of 1000 (!"
        " marks what is not)."
    )


if __name__ == "__main__":
    main()

"""Statistics of the verdict's tests on healthy records, with their limits.

``python -m validation.adversary.calibrate [--runs N] [--first SEED]`` simulates ordinary records and filters them with
the truth: with the coefficients, loads and noise that they were made with, and nothing to be found. A limit that
healthy records reach is a false alarm; one far beyond them hides faults. Ten tests may condemn one record in 50
together, so each one in 500: that quantile is distinguished from the tail, which is taken to fall exponentially from
the highest tenth on.
"""

import argparse
import math

import numpy as np
from numpy.typing import NDArray

from validation.adversary.scenarios import SCENARIOS, record
from windsysid.checks.limits import (
    FALSE_ALARM_PROBABILITY,
    MAX_CHANCE_SIGMAS,
    MAX_COLOUR,
    MAX_KURTOSIS,
    MAX_LEVEL_VARIATION,
    MAX_NEAR_MODE_LEVEL,
    MAX_PEAK_LEVEL,
    NEGLIGIBLE_SHARE,
)
from windsysid.checks.lines import find_line
from windsysid.checks.nonlinearity import find_bent
from windsysid.checks.stationarity import how_late
from windsysid.checks.whiteness import examine
from windsysid.filters import EKF
from windsysid.identification.condition.readings import resample_for_model
from windsysid.identification.estimate.clock_lag import PASS_EDGE_FACTOR
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import TurbineProblem, pose
from windsysid.identification.verdict.smoothed_loads import judge_smoothed_loads
from windsysid.loads.statistics import coordinates_of
from windsysid.mechanics.compile import compile_model
from windsysid.modal.analysis import modes as find_modes
from windsysid.output.console import render
from windsysid.turbine.file import load_turbine

__all__ = ["KINDS", "LIMITS", "is_condemned", "measure"]

KINDS = ("reference", "levels 2:1", "levels 5:1", "11 Hz", "20 Hz", "30 s", "200 Hz", "12 bits")
"""Healthy scenarios that take little time."""

LEVELS = {"levels 2:1": (2.0, 1.0, 1.0, 1.5, 2.0), "levels 5:1": (1.0, 0.2, 0.3, 1.0, 1.0)}
"""Of the loads, where they are not the file's."""

SHARE = 1.0 / 500.0
"""Of healthy records that one test may condemn."""

LIMITS = {
    "size of all, ln": 2.0 * math.log1p(NEGLIGIBLE_SHARE),
    "size of a channel, ln": 2.0 * math.log1p(NEGLIGIBLE_SHARE),
    "level over time": MAX_LEVEL_VARIATION,
    "level over time, σ": MAX_CHANCE_SIGMAS,
    "tails": MAX_KURTOSIS,
    "tails, σ": MAX_CHANCE_SIGMAS,
    "shared by two channels": MAX_COLOUR,
    "shared by two channels, σ": MAX_CHANCE_SIGMAS,
    "blades late, σ": MAX_CHANCE_SIGMAS,
    "peak": MAX_PEAK_LEVEL,
    "peak, over its bound": 1.0,
    "around a mode": MAX_NEAR_MODE_LEVEL,
    "line in innovations, over its bound": 1.0,
    "line in readings, over its bound": 1.0,
    "cubes, over their bound": 1.0,
    "level over frequency, over its bounds": 1.0,
    "bending with amplitude, over its bound": 1.0,
}
"""Quantities that are judged."""

TOGETHER = (("level over time", "level over time, σ"), ("tails", "tails, σ"),
            ("shared by two channels", "shared by two channels, σ"), ("peak", "peak, over its bound"),
            ("around a mode", "peak, over its bound"))  # fmt: skip
"""Of these both have to be beyond their limits; of all others each condemns by itself."""


def measure(name: str, seed: int) -> list[float]:
    """The statistics of `LIMITS` of a healthy record."""
    kind, turbine = SCENARIOS[name], load_turbine("verne555")
    made = record(name, seed)
    fine, steps, _ = resample_for_model(made, turbine, None, turbine.sensors)
    problem = pose(fine, turbine, turbine.sensors, Prior())
    truth = _truth(problem, name)
    model = problem.build(truth)
    info = EKF.run(model, EKF.init(model), problem.inputs, problem.readings)[1]
    freedoms = problem.turbine.model.freedoms
    asked = judge_smoothed_loads(model, problem.inputs, problem.readings, info, freedoms=freedoms)
    z = info.whitened[::steps]
    frequencies = problem.frequencies(problem.prior[0])
    w = examine(z, names=model.readings, rate=made.rate, frequencies=frequencies)
    below = min(0.5, PASS_EDGE_FACTOR * max(frequencies) / made.rate)
    late = how_late(z, made["rotor_azimuth"], (0, 1), {2 + i: 2.0 * math.pi * i / 3.0 for i in range(3)}, below=below)
    compiled = compile_model(turbine.model)
    p = np.array([turbine.values[q] for q in compiled.parameters])
    modes = [(f, damping) for _, f, damping in find_modes(turbine.model, compiled, p, kind.machine.speed)]
    turning = kind.machine.speed / (2.0 * math.pi)
    line = find_line(problem.readings[::steps], model.readings, rate=made.rate, modes=modes, rotor_hz=turning)
    n = len(frequencies)
    bent = find_bent(
        z, info.mean[::steps, :n], info.mean[::steps, n : 2 * n], channels=model.readings,
        coordinates=turbine.model.coordinates, chance=FALSE_ALARM_PROBABILITY,
    )  # fmt: skip
    return [
        abs(math.log(w.nis)),
        max(abs(math.log(c.nis)) for c in w.channels),
        max(c.unsteady for c in w.channels),
        max(c.unsteady_sigmas for c in w.channels),
        max(c.tails for c in w.channels),
        max(c.tails_sigmas for c in w.channels),
        0.0 if w.shared is None else abs(w.shared.correlation),
        0.0 if w.shared is None else w.shared.sigmas,
        late.sigmas,
        max(c.peak for c in w.channels),
        max(c.peak for c in w.channels) / w.spectrum_bound,
        max(c.near for c in w.channels),
        max(c.line for c in w.channels) / w.line_bound,
        math.nan if line is None else line.ratio / line.bound,
        math.nan if bent is None else bent.statistic / bent.bound,
        0.0 if w.smooth is None else w.smooth.ratio,
        math.nan if asked is None else abs(asked.bending.sigmas) / asked.bending.bound,
    ]


def is_condemned(row: NDArray[np.float64]) -> bool:
    """Test whether one test or another condemns a record with these statistics."""
    beyond = {name: value > limit for (name, limit), value in zip(LIMITS.items(), row, strict=True)}
    paired = {name for pair in TOGETHER for name in pair}
    return any(beyond[a] and beyond[b] for a, b in TOGETHER) or any(
        beyond[name] for name in beyond if name not in paired
    )


def _truth(problem: TurbineProblem, name: str) -> NDArray[np.float64]:
    """The unknowns that a record was made with."""
    theta = [q.coordinate(SCENARIOS[name].machine.truth[q.name]) for q in problem.parameters]
    given = {s.name: s.given for s in problem.statistics}
    for level, of in zip(LEVELS.get(name, (1.0,) * 5), ("x", "y", "beta_1", "beta_2", "beta_3"), strict=True):
        given[f"load_rms_{of}"] *= level
    return np.concatenate([theta, coordinates_of(problem.statistics, given)])


def main() -> None:
    """Print the table."""
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.adversary.calibrate", description=__doc__)
    parser.add_argument("--runs", type=int, default=25, help="records of each kind (25)")
    parser.add_argument("--first", type=int, default=7000, help="seed of the first (7000)")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.runs)
    found = np.array([measure(name, seed) for seed in seeds for name in KINDS])
    table = Table(title=f"{len(found)} healthy records, filtered with the truth", title_justify="left")
    for heading in ("statistic", "median", "90 %", "1 in 500", "highest", "limit", "records beyond"):
        table.add_column(heading, justify="left" if heading == "statistic" else "right")
    for (name, limit), column in zip(LIMITS.items(), found.T, strict=True):
        there = column[np.isfinite(column)]
        tenth = float(np.quantile(there, 0.9))
        far = tenth + float(np.mean(there[there > tenth] - tenth)) * math.log(0.1 / SHARE)
        values = (float(np.median(there)), tenth, far, float(there.max()), limit)
        table.add_row(name, *(f"{value:.3g}" for value in values), f"{np.sum(there > limit)} of {len(there)}")
    print(render(table))
    print(f"{sum(is_condemned(row) for row in found)} of {len(found)} records condemned by one or another")


if __name__ == "__main__":
    main()

"""Comparison of methods on the same records: inputs of each, errors, coverage of its intervals, and
time.

``python -m windsysid.study.methods [--runs N]`` prints the table that the study's report shows: 100 s sections of the
reference scenario, priors of the joint formulation drawn 30 % off. Errors and intervals are those at the end of the
section.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.filters import FILTERS, Filter
from windsysid.identification.identify import identify
from windsysid.identification.model.turbine_problem import pose
from windsysid.mechanics.compile import compile_model
from windsysid.output.console import render
from windsysid.output.table import Table
from windsysid.records.record import Record
from windsysid.results.identification import Identification
from windsysid.simulation.integrate import integrate
from windsysid.study.arms import identify_section, record_balance
from windsysid.study.drawn_prior import DrawnPrior
from windsysid.study.particles import SIR, identify_section_by_particles
from windsysid.study.scenario import RATE, SECTION, StudyReference, simulate_reference
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["Method", "gather", "method_table", "run_methods"]


WRONG_LOAD_FACTOR = 3.0
"""Factor by which the loads' rms is wrong in the row on the cost of such an error."""


class Method(NamedTuple):
    """One method on several records.

    Attributes
    ----------
    name, told
        In words; required inputs in addition to the measurements.
    names
        Of the coefficients.
    error
        Relative errors of the coefficients (runs, n).
    deviation
        Errors over their standard deviations (runs, n).
    seconds
        Time for each section (runs,) [s].
    """

    name: str
    told: str
    names: tuple[str, ...]
    error: Array
    deviation: Array
    seconds: Array

    def rms_error(self, kind: str) -> float:
        """Relative rms error of the coefficients whose names begin with `kind`."""
        return float(np.sqrt(np.mean(self.error[:, [name.startswith(kind) for name in self.names]] ** 2)))

    @property
    def covered(self) -> float:
        """Share of the coefficients that ±2σ holds."""
        return float(np.mean(np.abs(self.deviation) < 2.0))

    def summary(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "method": self.name,
            "is_told": self.told,
            "rms_error_stiffness_percent": 100.0 * self.rms_error("k_"),
            "rms_error_damping_percent": 100.0 * self.rms_error("c_"),
            "covered_by_2_sigma": self.covered,
            "seconds": float(np.median(self.seconds)),
        }


def run_methods(turbine: Turbine, seed: int) -> list[Method]:
    """Every method on the record of one seed."""
    found = []
    for name, told, run in _methods(turbine, seed):
        begun = time.perf_counter()
        error, deviation = run()
        seconds = np.array([time.perf_counter() - begun])
        found.append(Method(name, told, tuple(turbine.coefficients), error[None], deviation[None], seconds))
    return found


def gather(runs: Sequence[Method]) -> list[Method]:
    """One entry per method from those of many runs."""
    of: dict[tuple[str, str], list[Method]] = {}
    for run in runs:
        of.setdefault((run.name, run.told), []).append(run)
    return [
        same[0]._replace(
            error=np.concatenate([run.error for run in same]),
            deviation=np.concatenate([run.deviation for run in same]),
            seconds=np.concatenate([run.seconds for run in same]),
        )
        for same in of.values()
    ]


def _methods(turbine: Turbine, seed: int) -> Iterator[tuple[str, str, Callable[[], tuple[Array, Array]]]]:
    """Every method on the record of one seed: its name, its inputs, and the run itself."""
    reference = simulate_reference(turbine, seed)
    motion = "motion of every degree of freedom"
    for arm, loads in (("A", reference.inputs[:, 3:]), ("B", None)):
        told = motion if loads is None else f"{motion}, loads"
        yield f"force balance, EKF, arm {arm}", told, partial(_balance, turbine, reference, loads)
        if arm == "A":
            yield f"force balance, SIR, {SIR.particles} particles", told, partial(_particles, turbine, reference)
    record = accelerometers(turbine, reference, seed)
    statistics = "statistics of loads and noise"
    loud = replace(turbine, loads=tuple(replace(load, rms=WRONG_LOAD_FACTOR * load.rms) for load in turbine.loads))
    for f, told, supposed in (
        *((f, statistics, turbine) for f in FILTERS),
        (FILTERS[0], f"the same, loads {WRONG_LOAD_FACTOR:g} × too large", loud),
    ):  # fmt: skip
        yield f"joint, {f.name}", told, partial(_joint, turbine, supposed, record, f, seed)
    yield "joint, posterior mode", "nothing", partial(_mode, turbine, record, seed)


def accelerometers(turbine: Turbine, reference: StudyReference, seed: int) -> Record:
    """The section as the turbine's own accelerometers see it."""
    rng = np.random.default_rng([seed, 3])
    window = slice(round(SECTION[0] * RATE), round(SECTION[1] * RATE))
    model = compile_model(turbine.model, turbine.sensors)
    p = np.array([turbine.values[name] for name in model.parameters])
    start = np.zeros(len(model.states))
    readings = integrate(model, p, reference.inputs, rate=RATE, start=start).readings[window]
    readings = readings + rng.standard_normal(readings.shape) * [sensor.noise for sensor in turbine.sensors]
    section = reference.record.section(*SECTION).select(["rotor_azimuth", "rotor_speed"])
    columns = {s.channel: (readings[:, c], s.unit) for c, s in enumerate(turbine.sensors)}
    return section.with_channels(columns)


def _joint(turbine: Turbine, supposed: Turbine, record: Record, f: Filter, seed: int) -> tuple[Array, Array]:
    """A filter with the coefficients in its state, with the statistics of loads and noise of `supposed`."""
    problem = pose(record, supposed, supposed.sensors, DrawnPrior(seed=seed))
    belief, info = f.run(problem.model, f.init(problem.model), problem.inputs, problem.readings)
    block, parameters = problem.model.parameter_block, problem.parameters
    truth = np.array([turbine.values[q.name] for q in parameters])
    at, off = belief.mean[block], np.array([q.coordinate(value) for q, value in zip(parameters, truth, strict=True)])
    values = np.array([float(q.physical(theta)) for q, theta in zip(parameters, at, strict=True)])
    return values / truth - 1.0, (at - off) / info.std[-1, block]


def _balance(turbine: Turbine, reference: StudyReference, loads: Array | None) -> tuple[Array, Array]:
    """The paper's filter, with these loads or none."""
    return _judged(turbine, identify_section(turbine, reference, record_balance(turbine, reference, loads)))


def _particles(turbine: Turbine, reference: StudyReference) -> tuple[Array, Array]:
    """The paper's other filter, with the loads."""
    balance = record_balance(turbine, reference, reference.inputs[:, 3:])
    return _judged(turbine, identify_section_by_particles(turbine, reference, balance))


def _mode(turbine: Turbine, record: Record, seed: int) -> tuple[Array, Array]:
    """The mode of the posterior, as a user would call for it."""
    return _judged(turbine, identify(record, turbine, formulation="joint", prior=DrawnPrior(seed=seed)))


def _judged(turbine: Turbine, result: Identification) -> tuple[Array, Array]:
    truth = np.array([turbine.values[q.name] for q in result.parameters])
    values = np.array([e.estimate for e in result.estimates])
    off = np.array(
        [q.coordinate(v) - q.coordinate(t) for q, v, t in zip(result.parameters, values, truth, strict=True)]
    )
    return values / truth - 1.0, off / np.sqrt(np.diag(result.cov))


def method_table(methods: Sequence[Method]) -> Table:
    """One row per method: its inputs, rms errors of stiffness and damping, coverage, time."""
    rows = [
        (
            method.name, method.told, *(f"{100.0 * method.rms_error(kind):.2g} %" for kind in ("k_", "c_")),
            f"{100.0 * method.covered:.1f} %", f"{np.median(method.seconds):.2g} s",
        )
        for method in methods
    ]  # fmt: skip
    runs, n = methods[0].error.shape
    return Table(
        ("method", "is told", "rms error k", "rms error c", "±2σ holds", "time"),
        rows,
        f"{SECTION[1] - SECTION[0]:g} s at {RATE:g} Hz, {runs} records, {n} coefficients",
        words=(0, 1),
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m windsysid.study.methods", description=__doc__)
    parser.add_argument("--runs", type=int, default=10, help="records (10)")
    turbine = load_turbine("verne555").exact()
    runs = [one for seed in range(parser.parse_args().runs) for one in run_methods(turbine, seed)]
    print(render(method_table(gather(runs))))


if __name__ == "__main__":
    main()

"""Time-domain estimate of one's own equations.

The unknowns are the parameters θ and, next to them, the noise of every sensor and the level of every load, η. The
record is read recursively (`windsysid.identification.estimate.online`); that history is kept. The result is the mode of
the posterior of the whole record on the likelihood of the state-only filter
(`windsysid.identification.estimate.scoring`).

The search begins where a joint filter ends. Far off, the likelihood has false maxima, because the motion that it
expects has lost the phase of the one that was measured; the joint filter stays in phase. It also keeps what it learns
while linearised at wrong parameters, the more so the smaller the noise of the sensors is given, so it runs again with
all noise 10 and 100 times as large, and the end with the greatest likelihood is the start.
"""

import time
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.dispersion import PartScores
from windsysid.checks.limits import NEGLIGIBLE_SHARE
from windsysid.checks.whiteness import Whiteness
from windsysid.filters import EKF, Info
from windsysid.filters.bank import bank_of, run_bank
from windsysid.identification.condition.samples import Samples, SamplesOnDisk
from windsysid.identification.condition.segments import SegmentReader
from windsysid.identification.estimate.online import begin, spread_over_samples
from windsysid.identification.estimate.search import Solution, solve
from windsysid.identification.model.equations_problem import (
    EquationsJob,
    OwnProblem,
    constant_loads,
    known_columns,
    loads_behind_low_pass,
    read_columns,
)
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.load_model import LoadModel

__all__ = ["EquationsEstimate", "fit_by_filter"]

FIRST_ESTIMATE_DIVISOR = 16
"""Setting: the first estimate on line comes after this fraction of the record."""


class EquationsEstimate(NamedTuple):
    """Result of a formulation for user equations: names of the method and of the equations, and seconds; the mode
    of the posterior of θ and η; the filter there, with its states; what was known of the unknowns at which time [s],
    mean and standard deviation (T, n); the load models as used; notes, doubts, and tests of the innovations."""

    method: str
    name: str
    elapsed: float
    unknowns: Array
    cov: Array
    log_likelihood: float
    info: Info
    states: tuple[str, ...]
    time: Array
    history: tuple[Array, Array]
    loads: tuple[LoadModel, ...]
    notes: tuple[Finding, ...]
    doubts: tuple[Finding, ...]
    whiteness: Whiteness | None = None
    scores: tuple[PartScores, ...] = ()


def fit_by_filter(job: EquationsJob, segments: SegmentReader) -> EquationsEstimate:
    """Identify parameters from the readings in time; exceptions as of `windsysid.models.fit`."""
    problem, samples, notes = _take(job, segments)
    count, rate = segments.samples, segments.last.rate
    columns = _compile(problem)
    started = time.perf_counter()
    nothing = begin(*problem.prior, -(-count // FIRST_ESTIMATE_DIVISOR), columns)
    found = solve(problem, samples, nothing, rate=rate, start=problem.start_from(samples))
    return EquationsEstimate(
        method=f"posterior mode, {EKF.name}",
        name=problem.model.compiled.name,
        elapsed=time.perf_counter() - started,
        unknowns=found.mean,
        cov=found.cov,
        log_likelihood=found.log_likelihood,
        info=found.info,
        states=problem.plain.states,
        time=segments.first.time if segments.whole else segments.first.time[0] + np.arange(count) / rate,
        history=spread_over_samples(*problem.prior, found.history, count),
        loads=problem.loads,
        notes=(*notes, *found.notes),
        doubts=_list_doubts(problem, found),
        whiteness=found.whiteness,
        scores=(found.scores,),
    )


def _take(job: EquationsJob, segments: SegmentReader) -> tuple[OwnProblem, Samples, tuple[Finding, ...]]:
    """The problem that the first segment poses, the samples of all of them, and notes."""
    held: SamplesOnDisk | None = None
    for part in segments:
        if held is None:
            problem, notes = _pose(job, part)
            compiled = problem.model.compiled
            constant = constant_loads(compiled.loads, part, job)
            held = SamplesOnDisk((len(problem.model.inputs), len(job.sensors)))
        inputs = known_columns(compiled, part, job, constant)
        readings = read_columns(part, job.sensors, first=part is segments.first)
        if segments.whole:
            return problem, [(inputs, readings)], notes
        held.append(inputs, readings)
    assert held is not None  # a reader has a segment
    return problem, held, notes


def _pose(job: EquationsJob, part: Record) -> tuple[OwnProblem, tuple[Finding, ...]]:
    """The problem at the rate of a record, with notes on its load models."""
    loads, notes = loads_behind_low_pass(job.loads, part)
    settings: dict[str, Any] = {
        "sensors": job.sensors, "mean": job.mean, "cov": job.cov, "rate": part.rate, "loads": loads, "continuous": True,
    }  # fmt: skip
    joint = compose(job.model, values=job.values, parameters=job.parameters, **settings)
    plain = compose(job.model, values=job.centres, **settings)
    return OwnProblem(joint, plain, loads, job.levels), notes


def _compile(problem: OwnProblem) -> tuple[int, int]:
    """Compile or load the kernels, which no time is charged for; the numbers of inputs and of readings."""
    columns = len(problem.model.inputs), len(problem.model.readings)
    nothing = np.empty((0, columns[0])), np.empty((0, columns[1]))
    for space in (problem.model, problem.plain):
        EKF.run(space, EKF.init(space), *nothing)
    run_bank(bank_of([problem.plain]), *nothing)
    return columns


def _list_doubts(problem: OwnProblem, found: Solution) -> tuple[Finding, ...]:
    """Reasons against the intervals that the innovations do not show."""
    doubts = _list_step_doubts(problem.build(found.mean), found.info, found.inputs)
    if not found.settled:
        doubts += (Finding("fit_not_converged", "reason"),)
    return doubts


def _list_step_doubts(model: StateSpace, info: Info, inputs: Array) -> tuple[Finding, ...]:
    """A doubt where the Runge–Kutta method itself makes more than `NEGLIGIBLE_SHARE` of the damping of a vibration
    about the last state."""
    compiled, h = model.compiled, float(model.blocks.step[0])
    n, nu = len(compiled.states), len(compiled.inputs)
    if not (n and len(inputs)):
        return ()
    value, A = np.empty(n), np.zeros((n, n))
    B, G = np.zeros((n, len(compiled.identified))), np.zeros((n, len(compiled.loads)))
    at = np.ascontiguousarray(info.mean[-1, :n])
    compiled.rates_jacobian(at, inputs[-1, :nu], model.blocks.p, inputs[-1, nu:].copy(), value, A, B, G)
    if not np.isfinite(A).all():
        return ()
    exponents = np.linalg.eigvals(A)
    step = h * exponents[exponents.imag > 1e-6 * np.abs(exponents)]
    stepped = np.log(1.0 + step * (1.0 + step / 2.0 * (1.0 + step / 3.0 * (1.0 + step / 4.0))))
    ratio, own = -stepped.real / np.abs(stepped), -step.real / np.abs(step)
    worse = np.abs(ratio - own) - NEGLIGIBLE_SHARE * np.abs(ratio)
    if not worse.max(initial=-1.0) > 0.0:
        return ()
    i = int(np.argmax(worse))
    size = float(np.abs(step[i]))
    enough = size / h / (72.0 * NEGLIGIBLE_SHARE * max(abs(float(ratio[i])), 1e-4)) ** 0.2
    data = {"frequency": size / h / (2.0 * np.pi), "damping": ratio[i] - own[i], "rate": enough}
    return (Finding("steps_too_long", "reason", data),)

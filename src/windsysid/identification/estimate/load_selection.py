"""Which load model? The simplest is tried on the beginning of the record, and where it does not explain that, or others
cost as little, the others too.

A model explains a record when the spectra of its innovations have no peak within reach of a natural frequency that
noise would not show in one record of a thousand (`windsysid.checks.verdict`). On a rotor no other is then tried. A
fit can take in loads of another colour and leave no peak: under a rigid rotor, where others are cheap, they are
compared all the same, on as many samples as are held. None is tried without influence of loads, as in a free decay:
what the simplest model's loads can do by themselves is then small compared with the motion. Of those that are tried,
the one with the greatest evidence is chosen (`windsysid.identification.estimate.evidence`).
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import NEGLIGIBLE_SHARE
from windsysid.checks.whiteness import Whiteness, examine
from windsysid.errors import WindsysidError
from windsysid.filters import EKF, Info
from windsysid.filters.bank import bank_of, run_bank
from windsysid.identification.estimate.evidence import Ranking, rank
from windsysid.identification.estimate.online import MEMORY, History, Online, advance, begin, finish, join_histories
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.problem import FIRST_LOG_STD
from windsysid.identification.model.turbine_problem import TurbineProblem, pose
from windsysid.loads.hypothesis import HYPOTHESES
from windsysid.loads.statistics import coordinates_of, values_of
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.scoring import laplace_evidence
from windsysid.statespace.compose import StateSpace
from windsysid.turbine.turbine import Turbine

__all__ = ["Candidate", "Choice", "Question", "choose", "is_explained", "warm"]

Start = Callable[[Array, Array], tuple[Array, Array]]


TRIAL_FACTOR = 2
"""Setting: times the first samples that compare models: a difference that matters is overwhelming there."""


class Question(NamedTuple):
    """Part of a problem that does not depend on the load model: arguments of
    `windsysid.identification.model.turbine_problem.pose`.
    """

    record: Record
    turbine: Turbine
    sensors: tuple[Sensor, ...]
    prior: Prior
    chosen: Sequence[str] | None


class Candidate(NamedTuple):
    """A load model after the first samples of a record.

    Attributes
    ----------
    problem
        With its load model.
    online, history
        What it knows after the first samples, and how it came to know it.
    log_evidence
        Of the samples that it has seen, as many for all that are compared.
    white
        Whether it explains what it has seen.
    driven
        Whether its loads make a good part of the motion.
    """

    problem: TurbineProblem
    online: Online
    history: History
    log_evidence: float
    white: bool
    driven: bool


class Choice(NamedTuple):
    """The load model that was chosen, why, and the seconds that its kernels took to load or compile."""

    best: Candidate
    why: Finding
    warming: float


def choose(question: Question, names: Sequence[str], first: int) -> Choice:
    """The load model of those named that explains the beginning of the record, or does it best.

    Parameters
    ----------
    question
        With the record, or so much of it as holds `MEMORY` × `first` samples.
    names
        The models, the cheapest first.
    first
        Samples before the first estimate on line.
    """
    rate, warming = question.record.rate, 0.0
    tried: list[Candidate] = []
    cheap, length = question.turbine.model.rotor is None, TRIAL_FACTOR * first
    for name in names:
        begun = time.perf_counter()
        problem = pose(*question, name)
        warm(problem)
        warming += time.perf_counter() - begun
        try:
            candidate = _take_in(_start_candidate(problem, first), length, rate, _start(problem, tried))
            if candidate.white and not tried:
                later = _take_in(candidate, MEMORY * first, rate, problem.start)
                candidate = later if cheap else later._replace(log_evidence=candidate.log_evidence)
                length = MEMORY * first if cheap else length
        except (WindsysidError, np.linalg.LinAlgError):  # the record drives this model out of bounds
            if len(names) == 1:
                raise
            continue
        tried.append(candidate)
        if _is_enough(tried, cheap=cheap):
            break
    if not tried:
        raise WindsysidError("no load model fits this record: check units, the turbine file and the priors")
    ranking = rank(tried, lambda candidate: candidate.log_evidence)
    seconds = min(length, question.record.samples) / rate
    return Choice(ranking.best, _describe_choice(ranking, seconds), warming)


def _is_enough(tried: Sequence[Candidate], *, cheap: bool) -> bool:
    """Test whether the simplest model needs no rival: it explains the record, and others are costly, or loads hardly
    matter."""
    simplest = tried[0]
    return len(tried) == 1 and ((simplest.white and not cheap) or not simplest.driven)


def warm(problem: TurbineProblem) -> None:
    """Compile or load every kernel."""
    nothing = problem.inputs[:0], problem.readings[:0]
    for model in (problem.model, problem.build(problem.prior[0])):
        EKF.run(model, EKF.init(model), *nothing)
    run_bank(bank_of([model]), *nothing)


def _start_candidate(problem: TurbineProblem, first: int) -> Candidate:
    """Model before any data."""
    online = begin(*problem.prior, first, (problem.inputs.shape[1], problem.readings.shape[1]))
    history = advance(problem.build, online, problem.inputs[:0], problem.readings[:0])[1]
    return Candidate(problem, online, history, -math.inf, white=True, driven=True)


def _take_in(candidate: Candidate, until: int, rate: float, start: Start) -> Candidate:
    """The candidate after so many samples of the record, or all that there are."""
    problem, online = candidate.problem, candidate.online
    part = slice(online.reached, until)
    online, history = advance(problem.build, online, problem.inputs[part], problem.readings[part], start)
    if online.bank is None:  # the record is shorter than the first block
        online, history = finish(problem.build, online, start)
    model, seen = problem.build(online.theta), slice(0, online.samples)
    info = EKF.run(model, EKF.init(model), problem.inputs[seen], problem.readings[seen])[1]
    evidence = _log_evidence(float(info.log_likelihood.sum()), online)
    white = _explains(problem, info, rate)
    driven = _loads_matter(model, problem.inputs[seen], info)
    return Candidate(problem, online, join_histories([candidate.history, history]), evidence, white, driven)


def _log_evidence(log_likelihood: float, known: Online) -> float:
    """Laplace's approximation to the log evidence of the samples that a recursion has seen."""
    prior: Array = np.asarray(np.linalg.inv(known.prior_cov), dtype=np.float64)
    off = known.theta - known.prior_mean
    return laplace_evidence(log_likelihood - 0.5 * float(off @ prior @ off), prior, known.precision)


def _explains(problem: TurbineProblem, info: Info, rate: float) -> bool:
    """True if the innovations have no peak close to a natural frequency."""
    turbine = problem.turbine
    natural = [turbine.natural_frequency(name) / (2.0 * math.pi) for name in turbine.model.coordinates]
    return is_explained(
        examine(info.whitened, names=problem.model.readings, rate=rate, frequencies=natural, gated=info.gated)
    )


def is_explained(whiteness: Whiteness) -> bool:
    """Test whether innovations have no significant peak close to a natural frequency."""
    return not any(channel.peak > whiteness.spectrum_bound for channel in whiteness.channels)


def _loads_matter(model: StateSpace, inputs: Array, info: Info) -> bool:
    """Test whether the loads alone, from rest, cause a good part of the motion in some degree of freedom."""
    n = len(model.compiled.states) // 2
    cov = model.cov.copy()
    cov[: 2 * n, : 2 * n] = 0.0
    at_rest = replace(model, cov=cov)
    nothing = np.full((len(inputs), len(model.readings)), np.nan)
    alone = EKF.run(at_rest, EKF.init(at_rest), inputs, nothing)[1]
    by_loads, motion = np.mean(alone.std[:, :n] ** 2, axis=0), np.mean(info.mean[:, :n] ** 2, axis=0)
    return bool(np.any(by_loads > NEGLIGIBLE_SHARE**2 * motion))


def _start(problem: TurbineProblem, tried: Sequence[Candidate]) -> Start:
    """Start values: the simplest model at the end of its joint filter, others at the prior, with the level of loads as
    the simplest found them."""
    if not tried and problem.loads.name == next(iter(HYPOTHESES)):
        return problem.start
    mean = problem.prior[0].copy()
    if tried:
        values = HYPOTHESES[problem.loads.name].start_from(_compare_levels(tried[0]), problem.loads.statistics)
        mean[problem.unknowns.of("statistics")] = coordinates_of(problem.statistics, values)

    def start(inputs: Array, readings: Array) -> tuple[Array, Array]:
        return mean, np.diag(np.full(len(mean), FIRST_LOG_STD**2))

    return start


def _compare_levels(simplest: Candidate) -> dict[str, float]:
    """Factor by which the loads exceed those in the file, from the level of their spectra, for each statistic."""
    statistics, eta = simplest.problem.statistics, simplest.problem.unknowns.of("statistics")
    levels = [s.name for s in statistics if s.kind == "level"]
    values = values_of(statistics, simplest.online.theta[eta])
    given = {s.name: s.given for s in statistics}

    def level(of: dict[str, float], name: str) -> float:
        return of[name] / math.sqrt(of.get("load_time_constant", 1.0))

    return {name: level(values, name) / level(given, name) for name in levels}


def _describe_choice(ranking: Ranking[Candidate], seconds: float) -> Finding:
    """The chosen model with its margins."""
    best = ranking.best
    data: dict[str, Any] = {"model": best.problem.loads.name}
    if len(ranking.order) == 1:
        data["reason"] = "explains" if best.white else "" if best.driven else "loads hardly matter"
    else:
        rivals = ranking.rivals(lambda one: one.problem.loads.name)
        data |= {"reason": "evidence", "rivals": rivals, "duration": seconds, "explained": best.white}
    return Finding("load_model_chosen", "note", data)

"""The joint formulation: states, loads and coefficients together, from accelerometers.

The unknowns are the coefficients and the statistics of loads and noise
(`windsysid.identification.model.turbine_problem`). The record chooses what its loads are taken for
(`windsysid.identification.estimate.load_selection`), and the rest is the one way from samples to an estimate
(`windsysid.identification.estimate.search`). A record in pieces goes the same way
(`windsysid.identification.streaming.identify_pieces`).
"""

import math
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from windsysid._types import Array
from windsysid.errors import WindsysidError
from windsysid.identification.estimate.clock_lag import shifted
from windsysid.identification.estimate.load_selection import Question, choose, is_explained, warm
from windsysid.identification.estimate.online import MEMORY, join_histories, spread_over_samples
from windsysid.identification.estimate.prior_conflict import solve_with_wide_priors
from windsysid.identification.estimate.scoring import BANK_THREADS, log_likelihoods
from windsysid.identification.estimate.search import Solution, expect_search, solve
from windsysid.identification.model.fit import Outcome, known_loads
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.tolerances import (
    doubt_tolerances,
    learned_tolerances,
    note_tolerances,
    places_of_shared,
)
from windsysid.identification.model.turbine_problem import TurbineProblem, pose
from windsysid.identification.verdict.smoothed_loads import judge_smoothed_loads
from windsysid.loads.family import candidates
from windsysid.loads.hypothesis import HYPOTHESES
from windsysid.loads.narrow_band import NarrowBand
from windsysid.loads.statistics import coordinates_of, learned_statistics
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.smoothed_loads import SmoothedLoads
from windsysid.results.tolerance import Tolerance
from windsysid.statespace.unknowns import BlockName
from windsysid.turbine.turbine import Turbine

__all__ = [
    "describe_solution", "first_estimate", "identify_jointly", "identify_jointly_from", "load_models", "where_it_ended",
]  # fmt: skip


FIRST_ESTIMATE_PERIODS = 10.0
"""Setting: periods of the slowest degree of freedom before the first estimate on line."""

NOISE_FACTORS = 1.0, 0.7, 0.5, 0.35
"""Setting: shares of the noise where a search has ended, with which another one may begin."""

CHOICE_PASSES = 4.0
"""Setting: for progress only: how often the choice of a load model goes through the samples that it looks at."""


def identify_jointly(
    record: Record, turbine: Turbine, sensors: Sequence[Sensor], prior: Prior, chosen: Sequence[str] | None = None, *,
    loads: str = "auto",
) -> Outcome:  # fmt: skip
    """Identify the chosen parameters, or every coefficient that the sensors see, from a record.

    `loads` names a load model (`windsysid.loads.family`), or leaves the choice to the record.
    """
    started = time.perf_counter()
    question = Question(record, turbine, tuple(sensors), prior, chosen)
    first, count = first_estimate(turbine, record.rate), record.samples
    expect_search(count, count + CHOICE_PASSES * min(MEMORY * first, count))
    choice = choose(question, load_models(record, turbine, loads), first)
    expect_search(count, count)
    problem, best = choice.best.problem, choice.best
    given = problem.parameters
    samples = [(problem.inputs, problem.readings)]
    problem, solution = solve_with_wide_priors(problem, samples, best.online, rate=record.rate)
    elapsed = time.perf_counter() - started - choice.warming
    history = join_histories([best.history, *filter(None, [solution.history])])
    known = spread_over_samples(*problem.prior, history, solution.samples)
    found = describe_solution(problem, solution, turbine, choice.why, known, elapsed)
    return found._replace(smoothed_loads=_smoothed_loads(problem, solution), given_priors=given)


def identify_jointly_from(
    near: Outcome, record: Record, turbine: Turbine, sensors: Sequence[Sensor], prior: Prior,
    chosen: Sequence[str] | None = None, *, explained: bool = True,
) -> Outcome | None:  # fmt: skip
    """Identify coefficients by filters from the end of another search, without estimates on line: from the spectra of
    a stationary record, or from filters with less knowledge of it.

    The search begins near its end, under the load model of `near`. Returns None if that model has to explain the record
    and does not, or if the search does not converge; `identify_jointly` begins from the prior.
    """
    if explained and near.hypothesis not in (load_models(record, turbine, "auto")[0], NarrowBand.name):
        return None
    problem = pose(record, turbine, sensors, prior, chosen, near.hypothesis)
    warm(problem)
    started = time.perf_counter()
    start = _where_it_ended(near, problem)
    if start is None:
        return None
    samples = [(problem.inputs, problem.readings)]
    expect_search(record.samples)
    try:
        solution = solve(problem, samples, None, rate=record.rate, start=_with_likeliest_noise(problem, *start))
    except (WindsysidError, np.linalg.LinAlgError):
        return None
    if not (solution.settled or solution.exhausted) or (explained and not is_explained(solution.whiteness)):
        return None
    theta, elapsed = problem.unknowns.of("parameters"), time.perf_counter() - started
    only = solution.mean[None, theta], np.sqrt(np.diag(solution.cov)[theta])[None]
    reason = "explains" if explained else "as before"
    why = Finding("load_model_chosen", "note", {"model": near.hypothesis, "reason": reason})
    found = describe_solution(problem, solution, turbine, why, only, elapsed)
    return found._replace(smoothed_loads=_smoothed_loads(problem, solution), given_priors=near.given_priors)


def where_it_ended(near: Outcome, problem: TurbineProblem) -> Array:
    """Mode that a search found, in the unknowns of a problem without the clocks (n,)."""
    mean = problem.wide_prior[0].copy()
    found = {q.name: float(q.physical(t)) for q, t in zip(near.model.parameters, near.theta, strict=True)}
    of = problem.unknowns.of
    mean[of("parameters")] = [q.coordinate(found[q.name]) for q in problem.parameters]
    mean[of("statistics")] = coordinates_of(problem.statistics, {one.name: one.estimate for one in near.statistics})
    mean[of("tolerances")] = [one.estimate / one.spread for one in near.tolerances if one.group != "clock"]
    return mean


def _where_it_ended(near: Outcome, problem: TurbineProblem) -> tuple[Array, Array] | None:
    """Mode that spectra found, in the unknowns of a problem without clocks (n,), and its covariance (n, n); those that
    spectra do not have keep their prior. None if the coefficients differ."""
    if near.joint_cov is None or [*near.model.parameters] != [*problem.parameters]:
        return None
    mean, cov = where_it_ended(near, problem), problem.wide_prior[1].copy()
    ours, theirs = problem.unknowns, near.unknowns
    blocks: tuple[BlockName, ...] = ("parameters", "tolerances")
    if ours.statistics == theirs.statistics:
        blocks = ("parameters", "statistics", "tolerances")
    kept, same = ours.places(*blocks), theirs.places(*blocks)
    cov[np.ix_(kept, kept)] = near.joint_cov[np.ix_(same, same)]
    return mean, cov


def _with_likeliest_noise(problem: TurbineProblem, mean: Array, cov: Array) -> tuple[Array, Array]:
    """A start of a search with the likeliest of some levels of noise: spectra take leakage for noise, too."""
    noise = problem.unknowns.places("statistics")[[one.kind == "noise" for one in problem.statistics]]
    starts = [mean.copy() for _ in NOISE_FACTORS]
    for start, share in zip(starts, NOISE_FACTORS, strict=True):
        start[noise] += math.log(share)
    with ThreadPoolExecutor(BANK_THREADS) as pool:
        found = log_likelihoods(problem.build, [(problem.inputs, problem.readings)], starts, pool)
    return starts[int(np.argmax(np.nan_to_num(found, nan=-np.inf)))], cov


def _smoothed_loads(problem: TurbineProblem, solution: Solution) -> SmoothedLoads | None:
    """Smoothed loads of a record in one block, and their checks."""
    late = solution.mean[problem.unknowns.of("clocks")]
    ((inputs, readings),) = shifted(problem, [(problem.inputs, problem.readings)], late)
    return judge_smoothed_loads(
        problem.build(solution.mean), inputs, readings, solution.info, freedoms=problem.turbine.model.freedoms
    )  # fmt: skip


def load_models(record: Record, turbine: Turbine, loads: str) -> tuple[str, ...]:
    """The load models to choose from: the one that is named, or for ``"auto"`` those that suit the turbine."""
    return candidates(turbine, known_loads(record, turbine)[1]) if loads == "auto" else (loads,)


def first_estimate(turbine: Turbine, rate: float) -> int:
    """Samples before the first estimate on line."""
    slowest = min(turbine.natural_frequency(name) for name in turbine.model.coordinates)
    return math.ceil(FIRST_ESTIMATE_PERIODS * 2.0 * math.pi / slowest * rate)


def describe_solution(
    problem: TurbineProblem, solution: Solution, given: Turbine, why: Finding, history: tuple[Array, Array],
    elapsed: float,
) -> Outcome:  # fmt: skip
    """Outcome of a solution, with notes and reasons.

    Parameters
    ----------
    given
        The turbine before degrees of freedom were locked.
    why
        Why its load model was chosen.
    history
        Mean and standard deviation of the unknowns as they were known on line (T, n).
    elapsed
        Seconds in the filter.
    """
    known = problem.unknowns
    theta, eta, tau = known.of("parameters"), known.of("statistics"), known.of("tolerances", "clocks")
    tolerances = learned_tolerances(problem.tolerances, solution.mean[tau], solution.cov[tau, tau])
    return Outcome(
        turbine=problem.turbine,
        model=problem.model,
        history_mean=history[0][:, theta],
        history_std=history[1][:, theta],
        final=solution.info,
        theta=solution.mean[theta],
        cov=solution.cov[theta, theta],
        rotor=solution.mean_inputs[None, : len(problem.model.compiled.inputs)],
        channels=tuple(sensor.channel for sensor in problem.sensors),
        elapsed=elapsed,
        notes=(*problem.notes, *_describe_loads(problem, why), *note_tolerances(tolerances), *solution.notes),
        statistics=learned_statistics(problem.statistics, solution.mean[eta], solution.cov[eta, eta]),
        doubts=_list_doubts(solution, given, problem.turbine, tolerances),
        loads=solution.loads,
        joint_cov=solution.cov,
        whiteness=solution.whiteness,
        scores=(solution.scores._replace(given=places_of_shared(problem.unknowns, problem.tolerances)),),
        log_likelihood=solution.log_likelihood,
        hypothesis=problem.loads.name,
        tolerances=tolerances,
        sensors=problem.sensors,
    )


def _describe_loads(problem: TurbineProblem, why: Finding) -> tuple[Finding, ...]:
    """Notes on the load model and on its choice."""
    if not problem.loads.statistics:
        return (Finding("loads_known", "note"),)
    taken = Finding("loads_are_states", "note", {"loads": problem.loads.text})
    caution = HYPOTHESES[problem.loads.name].caution
    data = {"model": problem.loads.name, "text": caution}
    return (taken, why, Finding("load_model_caution", "note", data)) if caution else (taken, why)


def _list_doubts(
    solution: Solution, given: Turbine, used: Turbine, tolerances: Sequence[Tolerance]
) -> tuple[Finding, ...]:
    """Reasons against the intervals that innovations do not show."""
    doubts = list(doubt_tolerances(tolerances))
    if not solution.settled:
        code = "search_exhausted" if solution.exhausted else "search_not_converged"
        doubts.append(Finding(code, "reason", {"steps": solution.iterations}))
    if any(one.blade for one in given.model.freedoms) and not any(one.blade for one in used.model.freedoms):
        doubts.append(Finding("blades_locked_unseen", "reason"))
    return tuple(doubts)

"""Detect conflict between prior and data in damping, and widen the prior.

Structural damping is known to half of its value at best, and aerodynamic damping may be several times as much. If the
prior mean is far from the true value, the posterior mode is pulled towards it, and the Fisher information evaluated
there understates the uncertainty: a tower with four times the damping of its file was ten standard deviations off. So
the likelihood is evaluated on the far side: where it rises by more than ½ `NEGLIGIBLE_SHIFT_SIGMAS`² with up to twice
as much damping, all other unknowns following, or with half as much where the prior is above, the prior is made wider,
and the search is made again.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from windsysid._types import Array
from windsysid.checks.estimates import WIDENING_FACTOR, conflict
from windsysid.checks.limits import CONFLICT_SIGMAS
from windsysid.identification.condition.samples import Samples
from windsysid.identification.estimate.clock_lag import shifted
from windsysid.identification.estimate.online import Online
from windsysid.identification.estimate.scoring import BANK_THREADS, MAX_REPEATED_ELEMENTS, log_likelihoods
from windsysid.identification.estimate.search import Solution, solve
from windsysid.identification.limits import MIN_SHIFT_SIGMAS, NEGLIGIBLE_SHIFT_SIGMAS
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import TurbineProblem
from windsysid.results.finding import Finding
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.turbine import Turbine

__all__ = ["find_held", "note_wide_priors", "one_by_one", "solve_with_wide_priors", "with_wide_priors"]

DAMPING_FACTORS = (1.25, 1.5, 2.0)
"""Setting: factors on damping at which the likelihood is evaluated."""

MAX_WIDENINGS = 2
"""Setting: how often priors are widened."""


@dataclass(frozen=True)
class _WidenedPrior(Prior):
    """Another prior, some of whose standard deviations are `WIDENING_FACTOR` times as wide."""

    of: Prior = field(default_factory=Prior)
    names: tuple[str, ...] = ()

    def parameters(self, turbine: Turbine, names: Sequence[str], *, linear: bool) -> tuple[Parameter, ...]:
        """As the other has them, but for their spreads."""
        return tuple(_widened(q, self.names) for q in self.of.parameters(turbine, names, linear=linear))


def _widened(q: Parameter, names: Sequence[str]) -> Parameter:
    return replace(q, spread=WIDENING_FACTOR * q.spread) if q.name in names else q


def find_held(
    log_likelihoods: Callable[[Sequence[Array]], Sequence[float] | Array], unknowns: Array, cov: Array,
    parameters: Sequence[Parameter],
) -> tuple[str, ...]:  # fmt: skip
    """Damping coefficients that are held by their priors.

    Parameters
    ----------
    log_likelihoods
        Of all readings at each of several unknowns (n,), without the prior; not finite where one cannot be computed.
    unknowns, cov
        The mode of the posterior and its covariance (n,), (n, n); `parameters` come first.
    """
    asked = [(j, q) for j, q in enumerate(parameters) if _may_be_held(q, float(unknowns[j]))]
    if not asked:
        return ()
    points = [unknowns, *(point for j, q in asked for point in _beyond(unknowns, cov, j, q))]
    here, *beyond = log_likelihoods(points)
    values = np.reshape(beyond, (len(asked), len(DAMPING_FACTORS)))
    known = np.logical_and.accumulate(np.isfinite(values), axis=1)
    rises = np.max(values, axis=1, initial=here, where=known) > here + 0.5 * NEGLIGIBLE_SHIFT_SIGMAS**2
    return tuple(q.name for (_, q), rise in zip(asked, rises, strict=True) if rise)


def _may_be_held(q: Parameter, theta: float) -> bool:
    mean, std = q.prior
    return q.kind == "damping" and not q.logarithmic and theta > 0.0 and abs(theta - mean) > MIN_SHIFT_SIGMAS * std


def _beyond(unknowns: Array, cov: Array, j: int, q: Parameter) -> list[Array]:
    """Unknowns farther away from the prior than the estimate is."""
    theta, away = float(unknowns[j]), math.copysign(1.0, float(unknowns[j]) - q.prior[0])
    follow = cov[:, j] / cov[j, j]
    return [unknowns + follow * theta * (factor**away - 1.0) for factor in DAMPING_FACTORS]


def one_by_one(log_likelihood: Callable[[Array], float]) -> Callable[[Sequence[Array]], list[float]]:
    """Log likelihoods at several unknowns for `find_held`, from one that raises LinAlgError where it cannot be
    computed."""

    def at_each(points: Sequence[Array]) -> list[float]:
        found = []
        for point in points:
            try:
                found.append(log_likelihood(point))
            except np.linalg.LinAlgError:
                found.append(math.nan)
        return found

    return at_each


def with_wide_priors(identify: Callable[[Prior], Outcome], prior: Prior) -> tuple[Outcome, Prior]:
    """Fit of the spectra under a prior that is widened in a conflict, and that prior. A record with a reason against it
    other than rival explanations, which widen intervals, keeps it."""
    found = identify(prior)
    given = found.model.parameters
    for _ in range(MAX_WIDENINGS):
        if not found.held or any("shifts" not in one.data for one in found.doubts):
            break
        prior = _WidenedPrior(of=prior, names=found.held)
        found = identify(prior)
    return found._replace(given_priors=given), prior


def solve_with_wide_priors(
    problem: TurbineProblem, samples: Samples, online: Online, *, rate: float
) -> tuple[TurbineProblem, Solution]:
    """Fit of the filters under a widened prior, from the end of the search, while that is not too expensive. Arguments
    as for `windsysid.identification.estimate.search.solve`."""
    solution = first = solve(problem, samples, online, rate=rate)
    for _ in range(MAX_WIDENINGS):
        n = len(solution.mean) - len(problem.clocks)
        mean, cov = solution.mean[:n], solution.cov[:n, :n]
        heard = shifted(problem, solution.outliers.left_out_of(samples), solution.mean[n:])
        with ThreadPoolExecutor(BANK_THREADS) as pool:
            of_readings = partial(log_likelihoods, problem.build, heard, pool=pool)
            held = find_held(of_readings, mean, cov, problem.parameters)
        if not (held and solution.settled):
            break
        if solution.updated > MAX_REPEATED_ELEMENTS:
            solution = solution._replace(settled=False, exhausted=True)
            break
        model, block = problem.model, problem.model.parameter_block
        wide = np.array([WIDENING_FACTOR if q.name in held else 1.0 for q in model.parameters])
        prior = model.cov.copy()
        prior[block, block] *= np.outer(wide, wide)
        parameters = tuple(_widened(q, held) for q in model.parameters)
        problem = problem._replace(model=replace(model, parameters=parameters, cov=prior))
        again = solve(problem, samples, None, rate=rate, start=(mean, cov))
        solution = again._replace(updated=solution.updated + again.updated)
    return problem, solution._replace(history=first.history)


def note_wide_priors(found: Outcome) -> Outcome:
    """Fit with notes on widened priors: a finding if one conflicts with the prior as given."""
    notes, doubts = list(found.notes), list(found.doubts)
    for i, (q, given) in enumerate(zip(found.model.parameters, found.priors, strict=True)):
        if q.spread > given.spread:
            mean, std = given.prior
            off = float(found.theta[i] - mean) / math.hypot(std, math.sqrt(found.cov[i, i]))
            notes.append(
                Finding("prior_widened", "note", {"sigmas": off, "factor": q.spread / given.spread}, (q.name,))
            )
            if abs(off) > CONFLICT_SIGMAS:
                doubts.append(conflict(q.name, off))
    return found._replace(notes=tuple(notes), doubts=tuple(doubts))

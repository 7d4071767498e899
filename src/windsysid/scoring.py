"""Damped Fisher scoring for the mode of a posterior.

With J = −log posterior, its gradient g and the Fisher information F (that of the prior included), a step solves

    (F + μ diag F) δ = −g,

the damping μ growing where J does not decrease and shrinking where it decreases as the quadratic model promises. The
promised decrease, twice, is Newton's decrement δ² = −(2 gᵀ δ + δᵀ F δ): of an undamped step its squared length in
standard deviations. It is what convergence is judged by. Sources: Levenberg, Q. Appl. Math. 2, 1944; Nielsen, Damping
parameter in Marquardt's method, IMM-REP-1999-05, Technical University of Denmark.
"""

import operator
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from windsysid._types import Array

__all__ = ["Evaluation", "LocalModel", "SearchLimits", "SearchResult", "covariance", "find_mode", "laplace_evidence"]

SLACK = 1e-9
"""Increase of J, over its size, that is rounding."""

MIN_RAISED_DAMPING = 1e-2
"""Least damping after a step that decreased J by less than half of what it promised: two unknowns that do nearly the
same are curved more than the Fisher information says, and undamped steps overshoot."""

MIN_DAMPING_FACTOR = 0.1
"""Least factor on the damping after a step that was taken."""

MIN_SCALED_INFORMATION = 1e-14
"""Least eigenvalue of scaled information, over the greatest: less is rounding and has no sign."""

Point = TypeVar("Point")
Evaluated = TypeVar("Evaluated", bound="LocalModel")


class SearchLimits(NamedTuple):
    """When a search takes its last step.

    Attributes
    ----------
    tolerance
        Newton's decrement of the last step: 1e-3 is 0.03 standard deviations.
    max_steps
        Evaluations after the first.
    max_refusals
        Steps in a row that do not decrease J before the search stops.
    unseen
        Decrement of an undamped step that is taken as the last one without an evaluation behind it, where an evaluation
        is expensive and the quadratic model is accurate.
    unseen_remainder
        The same of the step that would follow, if decrements go on shrinking by the same factor.
    stalled
        Decrement below which a search that cannot decrease J any more has converged: rounding or differences hide the
        rest.
    damping
        At the start; with 0, for a search that begins near the mode, a step that was refused is halved, not damped.
    refused_damping
        Least damping after a step that was refused: 1 about halves the next, less turns it a little.
    """

    tolerance: float
    max_steps: int
    max_refusals: int = 8
    unseen: float = 0.0
    unseen_remainder: float = 0.0
    stalled: float = 0.0
    damping: float = 1e-3
    refused_damping: float = 1.0


class LocalModel(Protocol):
    """The quadratic model of J at one point: all that a search needs of it."""

    @property
    def value(self) -> float:
        """J."""

    def step(self, damping: float, /) -> Array:
        """The damped step δ (n,)."""

    def decrement(self, step: Array, /) -> float:
        """Twice the decrease of J that a step promises."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """−log posterior at one point.

    Attributes
    ----------
    value, gradient, information
        J, g (n,) and F (n, n).
    """

    value: float
    gradient: Array
    information: Array

    def step(self, damping: float) -> Array:
        """The damped step δ (n,)."""
        damped = self.information + damping * np.diag(np.diag(self.information)) if damping else self.information
        return np.asarray(-np.linalg.solve(damped, self.gradient), dtype=np.float64)

    def decrement(self, step: Array) -> float:
        """Twice the decrease of J that a step promises."""
        return -float((2.0 * self.gradient + self.information @ step) @ step)

    def with_prior(self, off: Array, precision: Array, weight: float = 1.0) -> "Evaluation":
        """A likelihood, weighted, times a Gaussian prior of the precision (n, n) at the distance `off` (n,) from its
        mean."""
        pull = precision @ off
        return Evaluation(
            weight * self.value + 0.5 * float(off @ pull),
            weight * self.gradient + pull,
            weight * self.information + precision,
        )


class SearchResult(NamedTuple, Generic[Point, Evaluated]):
    """End of a search.

    Attributes
    ----------
    point
        The mode.
    evaluation
        The last evaluation of the search: at the mode, or one step before where the last step was taken unseen.
    value
        J at the mode.
    decrement
        Newton's decrement of the last step.
    steps
        Evaluations after the first, and the step that was taken unseen.
    converged
        Whether the last step was small enough.
    """

    point: Point
    evaluation: Evaluated
    value: float
    decrement: float
    steps: int
    converged: bool


def find_mode(
    evaluate: Callable[[Point], Evaluated], start: Point, limits: SearchLimits, *, max_step: Array,
    move: Callable[[Point, Array], Point] = operator.add, first: Evaluated | None = None,
    give_up: Callable[[Evaluated, float], bool] | None = None,
) -> SearchResult[Point, Evaluated]:  # fmt: skip
    """Minimise J.

    Parameters
    ----------
    evaluate
        J with its derivatives at a point; a point at which it raises LinAlgError or is not finite is refused.
    max_step
        How far a step may move each unknown (n,): a longer one is shortened as a whole.
    move
        The point one step on; by default their sum.
    first
        The evaluation at the start, where it is known.
    give_up
        Whether to stop after a step, from the evaluation there and the decrease of J.

    Raises
    ------
    LinAlgError
        If the start cannot be evaluated, or a step cannot be computed.
    """
    search = _Search(start, evaluate(start) if first is None else first, limits)
    while search.goes_on:
        step = search.evaluation.step(search.damping)
        step = search.share * step / max(1.0, float(np.max(np.abs(step) / max_step)))
        if not np.isfinite(step).all():
            raise np.linalg.LinAlgError("the gradient or the information is not finite")
        decrement, point = search.evaluation.decrement(step), move(search.point, step)
        search.steps += 1
        if search.may_stop_unseen(decrement):
            value = search.evaluation.value - 0.5 * decrement
            return SearchResult(point, search.evaluation, value, decrement, search.steps, converged=True)
        try:
            trial = evaluate(point)
        except np.linalg.LinAlgError:
            search.refuse(decrement)
            continue
        decrease = search.evaluation.value - trial.value
        if not decrease > -SLACK * abs(search.evaluation.value):
            search.refuse(decrement)
            continue
        search.accept(point, trial, decrement, decrease)
        if give_up is not None and give_up(trial, decrease):
            break
    return SearchResult(
        search.point, search.evaluation, search.evaluation.value, search.decrement, search.steps, search.converged
    )


class _Search(Generic[Point, Evaluated]):
    """A search under way."""

    def __init__(self, point: Point, evaluation: Evaluated, limits: SearchLimits) -> None:
        self.point, self.evaluation, self.limits = point, evaluation, limits
        self.damping, self.refusals, self.steps, self.small, self.share = limits.damping, 0, 0, 0, 1.0
        self.decrement = self.before = 0.0
        self.converged = self.stopped = False

    @property
    def goes_on(self) -> bool:
        return not (self.converged or self.stopped) and self.steps < self.limits.max_steps

    def may_stop_unseen(self, decrement: float) -> bool:
        """Test whether an undamped step of this decrement is the last, without an evaluation behind it."""
        if self.damping > self.limits.damping or self.share < 1.0:
            return False
        return decrement < self.limits.unseen or decrement**2 < self.limits.unseen_remainder * self.before

    def accept(self, point: Point, trial: Evaluated, decrement: float, decrease: float) -> None:
        """Take a step; by Nielsen's rule, the decrease over what was promised says how far the quadratic model
        reaches."""
        self.point, self.evaluation = point, trial
        self.decrement = self.before = decrement
        self.refusals, self.share = 0, 1.0
        ratio = 2.0 * decrease / max(decrement, 1e-300)
        self.damping *= max(MIN_DAMPING_FACTOR, 1.0 - (2.0 * ratio - 1.0) ** 3)
        if not self.limits.damping:
            self.damping = 0.0
        elif ratio < 0.5:
            self.damping = max(self.damping, MIN_RAISED_DAMPING)
        self.small = self.small + 1 if 2.0 * decrease < self.limits.tolerance else 0
        self.converged = decrement < self.limits.tolerance or self.small == 2

    def refuse(self, decrement: float) -> None:
        """Leave a step, and damp the next one more."""
        self.refusals += 1
        if self.refusals == 1:
            self.decrement = decrement  # of the least damped step from here
        if self.limits.damping:
            self.damping = max(2.0**self.refusals * self.damping, self.limits.refused_damping)
        else:
            self.share *= 0.5
        self.stopped = self.refusals > self.limits.max_refusals or decrement < self.limits.tolerance
        self.converged = self.stopped and self.decrement < max(self.limits.tolerance, self.limits.stalled)


def covariance(information: Array) -> Array:
    """The inverse of information (n, n); a direction whose information rounding makes negative gets a wide variance."""
    size = np.sqrt(np.diag(information))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    narrow = vectors / np.sqrt(np.maximum(values, MIN_SCALED_INFORMATION * values[-1]))
    return np.asarray(narrow @ narrow.T / np.outer(size, size))


def laplace_evidence(log_posterior: float, prior_information: Array, information: Array) -> float:
    """ln ∫ p(y | u) p(u) du by Laplace's approximation at the mode û of the posterior.

    Parameters
    ----------
    log_posterior
        ln p(y | û) − ½ (û − m)ᵀ Λ₀ (û − m).
    prior_information, information
        Λ₀ and Λ (n, n), of a Gaussian prior and of the posterior: ½ ln det Λ₀ − ½ ln det Λ is added.
    """
    sizes = [float(np.linalg.slogdet(of)[1]) for of in (prior_information, information)]
    return log_posterior + 0.5 * (sizes[0] - sizes[1])

"""The mode of the posterior by Fisher scoring on the innovations of a state-only filter.

A joint filter leaves out how its own gain depends on the parameters (Ljung 1979), and what it learns while the state is
still unknown counts too much: its intervals are too narrow (`validation.calibration` prints by how much). The
likelihood of the state-only filter knows both. With whitened innovations z and the standard deviations s they were
divided by,

    log L = −Σ (log s + z²/2) + const,   ∂ log L = −Σ (∂ log s + z ∂z),
    Fisher information ≈ Σ a aᵀ + 2 Σ ∂log s ∂log sᵀ,   a = ∂z + z ∂log s  (the derivative of the innovation, over s),

and derivatives are differences between filters at neighbouring parameters, which run side by side in a bank
(`windsysid.filters.bank`). Source: Ljung, IEEE TAC 24(1), 1979, https://doi.org/10.1109/TAC.1979.1101943; Särkkä &
Svensson, ch. 16.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from windsysid._types import Array
from windsysid.checks.dispersion import Part, join_parts
from windsysid.errors import WindsysidError
from windsysid.filters import EKF, Info
from windsysid.filters.bank import Bank, bank_of, run_bank
from windsysid.identification.condition.samples import Samples
from windsysid.output.progress import passed
from windsysid.scoring import Evaluation, SearchLimits, find_mode
from windsysid.statespace.compose import StateSpace

__all__ = [
    "Changes", "FilteredMode", "InnovationMode", "Look", "Score", "find_innovation_mode", "information",
    "log_likelihoods", "look", "neighbours", "posterior_mode", "score",
]  # fmt: skip


MODE_TOLERANCE = 0.05
"""Numerical: Newton's decrement of the last step: 0.2 σ, of which the step takes all but a few per cent."""

SEARCH = SearchLimits(
    MODE_TOLERANCE, max_steps=40, unseen=MODE_TOLERANCE, unseen_remainder=0.01, stalled=1.0, damping=0.0
)
"""Numerical: an evaluation runs a bank of filters over all samples: so the last step is taken unseen. Searches begin
where the recursion on line ends, near the mode."""

MAX_UPDATED_ELEMENTS, MIN_STEPS = 6e8, 6
"""Setting: elements of covariances that the evaluations of a search may update, and steps that it may take whatever
they cost. 6e8 take 4 s (two cores, 2026); searches that converge take five steps, and a dozen if sensors
of a tower drift."""

MAX_REPEATED_ELEMENTS = 3.0 * MAX_UPDATED_ELEMENTS
"""Setting: elements that the evaluations for a result may have updated before another search, without outliers or
under a wider prior, begins: 15 s."""

MAX_STEP_SIGMAS = 3.0
"""Numerical: standard deviations of its prior, or of a clock's tolerance, by which a step moves an unknown at most."""

DIFFERENCE_STEP_SIGMAS = 0.01
"""Numerical: width of the forward differences, in standard deviations of a parameter with all others fixed: so narrow
that curvature does not matter, and far wider than rounding."""

BANK_THREADS = 2
"""Setting: threads of a bank of filters."""

CHUNK_SAMPLES = 1000
"""Setting: samples between two sums over the bank, which bound its memory: either half is a part of the record."""


class Changes(Protocol):
    """Ways in which readings might change."""

    @property
    def count(self) -> int:
        """Number of columns, c."""

    def of(self, inputs: Array, readings: Array, /) -> Array:
        """By how much readings (T, m) change with each of them (T, m, c); NaN only where the readings are."""


class Score(NamedTuple):
    """Log-likelihood of a record at one θ, its gradient and information.

    Attributes
    ----------
    log_likelihood
        Of the readings.
    gradient
        Of the log-likelihood (n_θ,).
    fisher
        Fisher information (n_θ, n_θ).
    mixed
        Negative second derivatives of the log-likelihood to θ and to changes of the readings (n_θ, c).
    parts
        What parts of the record say, in the order of time.
    """

    log_likelihood: float
    gradient: Array
    fisher: Array
    mixed: Array
    parts: tuple[Part, ...] = ()

    def plus(self, more: "Score") -> "Score":
        """Sum of both evaluations."""
        return Score(
            self.log_likelihood + more.log_likelihood,
            self.gradient + more.gradient,
            self.fisher + more.fisher,
            self.mixed + more.mixed,
            join_parts((*self.parts, *more.parts)),
        )


class Look(NamedTuple):
    """The posterior at one point, and the filters that saw it.

    Attributes
    ----------
    theta, widths
        Where (n_θ,), and the widths of the differences (n_θ,).
    bank
        The filters at θ and its neighbours after the last sample.
    found
        What the readings say.
    """

    theta: Array
    widths: Array
    bank: Bank
    found: Score


class InnovationMode(NamedTuple):
    """The mode of a posterior of innovations.

    Attributes
    ----------
    mean, cov
        θ (n_θ,) and the inverse of Fisher information plus prior information (n_θ, n_θ).
    iterations
        Scoring steps taken.
    settled
        Whether the last step was small enough.
    decrement
        Newton's decrement of the last step.
    look
        The last evaluation: θ is one step away from there where it settled.
    ended
        Whether no search is to go on from there: it has settled, or more steps would be too expensive.
    """

    mean: Array
    cov: Array
    iterations: int
    settled: bool
    decrement: float
    look: Look
    ended: bool


class FilteredMode(NamedTuple):
    """The mode of a posterior of innovations, and the filter there.

    Attributes
    ----------
    mean, cov, iterations, settled
        See `InnovationMode`.
    log_likelihood
        Of the readings at the mode.
    info
        What came out of the state-only filter at the mode.
    """

    mean: Array
    cov: Array
    log_likelihood: float
    iterations: int
    settled: bool
    info: Info


@dataclass(frozen=True, eq=False)
class _BankEvaluation(Evaluation):
    """−log posterior at one point, and the filters that gave it."""

    look: Look


def posterior_mode(
    build: Callable[[Array], StateSpace], inputs: Array, readings: Array, *,
    prior: tuple[Array, Array], start: tuple[Array, Array],
) -> FilteredMode:  # fmt: skip
    """Find the mode of the posterior of θ, and filter there; arguments as for `find_innovation_mode`."""
    mode = find_innovation_mode(build, [(inputs, readings)], prior=prior, start=start)
    model = build(mode.mean)
    info = EKF.run(model, EKF.init(model), inputs, readings)[1]
    return FilteredMode(mode.mean, mode.cov, float(info.log_likelihood.sum()), mode.iterations, mode.settled, info)


def find_innovation_mode(
    build: Callable[[Array], StateSpace], samples: Samples, *, prior: tuple[Array, Array],
    start: tuple[Array, Array], changes: Changes | None = None, tolerance: float = MODE_TOLERANCE,
) -> InnovationMode:  # fmt: skip
    """Find the mode of the posterior of θ.

    Parameters
    ----------
    build
        The state-only model for a value of θ (n_θ,).
    samples
        Blocks of inputs and readings as `windsysid.filters.EKF.run` takes them.
    prior
        Mean and covariance of the Gaussian prior of θ (n_θ,), (n_θ, n_θ).
    start
        Where to start, and the covariance whose inverse scales the first differences.
    changes
        Changes of the readings whose mixed derivatives the evaluations give, too.
    tolerance
        Newton's decrement of the last step.

    Raises
    ------
    WindsysidError
        If the likelihood can be computed neither at the start nor at the prior's mean.
    """
    precision = np.asarray(np.linalg.inv(prior[1]), dtype=np.float64)
    curvature = np.linalg.inv(start[1]) + precision
    with ThreadPoolExecutor(BANK_THREADS) as pool:

        def evaluate(theta: Array) -> _BankEvaluation:
            nonlocal curvature
            there = look(build, samples, theta, DIFFERENCE_STEP_SIGMAS / np.sqrt(np.diag(curvature)), pool, changes)
            score = Evaluation(-there.found.log_likelihood, -there.found.gradient, there.found.fisher)
            found = score.with_prior(theta - prior[0], precision)
            if not all(np.isfinite(part).all() for part in (found.value, found.gradient, found.information)):
                raise np.linalg.LinAlgError("the likelihood or its derivatives are not finite")
            curvature = found.information
            return _BankEvaluation(found.value, found.gradient, found.information, there)

        first = _first_finite(evaluate, (start[0].copy(), prior[0]))
        operations = sum(len(readings) for _, readings in samples) * first.look.bank.cov.size
        steps = min(max(int(MAX_UPDATED_ELEMENTS / max(operations, 1)), MIN_STEPS), SEARCH.max_steps)
        limits = SEARCH._replace(tolerance=tolerance, unseen=tolerance, max_steps=steps)
        mode = find_mode(
            evaluate, first.look.theta, limits, max_step=MAX_STEP_SIGMAS / np.sqrt(np.diag(precision)), first=first
        )
    here = mode.evaluation
    cov = np.asarray(np.linalg.inv(here.information), dtype=np.float64)
    ended = mode.converged or mode.steps == steps < SEARCH.max_steps
    return InnovationMode(mode.point, cov, mode.steps, mode.converged, mode.decrement, here.look, ended)


def _first_finite(evaluate: Callable[[Array], _BankEvaluation], points: Sequence[Array]) -> _BankEvaluation:
    """The evaluation at the first point that has one: a recursion may have lost its way."""
    for point in points:
        try:
            return evaluate(point)
        except np.linalg.LinAlgError:
            continue
    raise WindsysidError(
        "the likelihood or its derivatives are not finite at the start: check units, the turbine file and the priors"
    )


def look(
    build: Callable[[Array], StateSpace], samples: Samples, theta: Array, widths: Array,
    pool: ThreadPoolExecutor | None = None, changes: Changes | None = None,
) -> Look:  # fmt: skip
    """Evaluation of the readings at θ (n_θ,), from differences of the widths given (n_θ,), and of their changes."""
    models, n = [build(values) for values in neighbours(theta, widths)], len(theta)
    bank = bank_of(models, changes.count if changes else 0)
    found = Score(0.0, np.zeros(n), np.zeros((n, n)), np.zeros((n, len(bank.tangents[0]))))
    for inputs, readings in samples:
        moved = changes.of(inputs, readings) if changes else None
        bank, more = score(bank, inputs, readings, widths, pool, moved)
        found = found.plus(more)
    return Look(theta, widths, bank, found)


def information(
    build: Callable[[Array], StateSpace], inputs: Array, readings: Array, theta: Array, widths: Array
) -> tuple[Array, Array]:
    """Gradient of the log-likelihood (n_θ,) and the Fisher information that the readings hold (n_θ, n_θ).

    Parameters
    ----------
    build, inputs, readings
        As for `posterior_mode`.
    theta
        Where (n_θ,).
    widths
        Widths of the differences (n_θ,): `DIFFERENCE_STEP_SIGMAS` standard deviations of each parameter serve well.
    """
    with ThreadPoolExecutor(BANK_THREADS) as pool:
        found = look(build, [(inputs, readings)], theta, widths, pool).found
    return found.gradient, found.fisher


def log_likelihoods(
    build: Callable[[Array], StateSpace], samples: Samples, points: Sequence[Array], pool: ThreadPoolExecutor
) -> Array:
    """Of the readings at several θ (K,), by filters side by side; not finite where a filter loses its way."""
    bank, found = bank_of([build(theta) for theta in points]), np.zeros(len(points))
    for inputs, readings in samples:
        for first in range(0, len(readings), CHUNK_SAMPLES):
            part = slice(first, first + CHUNK_SAMPLES)
            bank, scores = run_bank(bank, inputs[part], readings[part], pool)
            found -= (scores.log_std + 0.5 * np.square(scores.whitened)).sum(axis=(0, 1))
        found -= _of_the_count(readings)
    return found


def _of_the_count(readings: Array) -> float:
    """Constant of a log-likelihood of so many normal readings."""
    return 0.5 * math.log(2.0 * math.pi) * float(np.isfinite(readings).sum())


def neighbours(theta: Array, widths: Array) -> list[Array]:
    """θ, and each parameter one width above."""
    return [theta, *(theta + step for step in np.diag(widths))]


def score(
    bank: Bank, inputs: Array, readings: Array, widths: Array, pool: ThreadPoolExecutor | None = None,
    changes: Array | None = None,
) -> tuple[Bank, Score]:  # fmt: skip
    """Run a bank of `neighbours` over T samples, and of changes of the readings (T, m, c), and take the differences
    between its filters."""
    n, across = len(widths), np.outer(widths, widths)
    log_likelihood, gradient, fisher, parts = 0.0, np.zeros(n), np.zeros((n, n)), list[Part]()
    mixed = np.zeros((n, bank.tangents.shape[1]))
    for first in range(0, len(readings), CHUNK_SAMPLES):
        part = slice(first, first + CHUNK_SAMPLES)
        bank, scores = run_bank(bank, inputs[part], readings[part], pool, None if changes is None else changes[part])
        z, log_s = (array.reshape(-1, bank.filters) for array in scores[:2])  # zero where the reading is missing
        middle = z[:, 0]
        log_likelihood -= float(log_s[:, 0].sum() + 0.5 * middle @ middle)
        moved_z, moved_s = (array[:, 1:] - array[:, :1] for array in (z, log_s))
        mixed -= (scores.slopes[:, 1:] - scores.slopes[:, :1]).T
        samples = len(readings[part])
        half = slice(0, samples // 2 * readings.shape[1])
        whole, first_half = (
            -(moved_s[rows].sum(axis=0) + middle[rows] @ moved_z[rows]) for rows in (slice(None), half)
        )
        seen = 2.0 * (moved_s.T @ moved_s)
        seen_half = 2.0 * (moved_s[half].T @ moved_s[half])
        moved_z += middle[:, None] * moved_s
        seen += moved_z.T @ moved_z
        seen_half += moved_z[half].T @ moved_z[half]
        gradient += whole
        fisher += seen
        parts.append(Part(samples // 2, first_half / widths, seen_half / across))
        parts.append(Part(samples - samples // 2, (whole - first_half) / widths, (seen - seen_half) / across))
        passed(len(readings[part]))
    log_likelihood -= _of_the_count(readings)
    return bank, Score(
        float(log_likelihood), gradient / widths, fisher / across, mixed / widths[:, None], join_parts(parts)
    )

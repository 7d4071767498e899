"""The mode of the posterior by Fisher scoring on the innovations of a state-only filter.

A joint filter leaves out how its own gain depends on the parameters (Ljung 1979), and what it learns while the state is
still unknown counts too much: its bands are too narrow (`validation.calibration` prints by how much). The likelihood of
the state-only filter knows both. With whitened innovations z and the standard deviations s they were divided by,

    log L = −Σ (log s + z²/2) + const,   ∂ log L = −Σ (∂ log s + z ∂z),
    Fisher information ≈ Σ a aᵀ + 2 Σ ∂log s ∂log sᵀ,   a = ∂z + z ∂log s  (the derivative of the innovation, over s),

and derivatives are differences between filters at neighbouring parameters, which run side by side in a bank
(`windsysid.filters.bank`). Source: Ljung, IEEE TAC 24(1), 1979, https://doi.org/10.1109/TAC.1979.1101943; Särkkä &
Svensson, ch. 16.
"""

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, Protocol

import numpy as np

from windsysid._types import Array
from windsysid.checks.constancy import Part, join_parts
from windsysid.errors import WindsysidError
from windsysid.filters import EKF, Info
from windsysid.filters.bank import Bank, bank_of, run_bank
from windsysid.identification.condition.samples import Samples
from windsysid.output.progress import passed
from windsysid.statespace.compose import StateSpace

__all__ = [
    "Changes",
    "Look",
    "Mode",
    "Posterior",
    "Score",
    "find_mode",
    "information",
    "log_likelihoods",
    "look",
    "neighbours",
    "posterior_mode",
    "score",
]


MAX_ITERATIONS = 15
MODE_TOLERANCE = 0.05
"""Newton's decrement, the squared length of a step in standard deviations, below which it is the last."""

LEFT = 0.01
"""The same of the step that would follow, were it as much shorter than this one as this one is than the step before."""

NEARLY_SETTLED = 1.0
"""The same, below which a search that cannot rise any more has settled."""

MAX_STEP_SIGMAS = 3.0
"""No step moves a parameter by more than so many standard deviations of its prior."""

MAX_HALVINGS = 8
"""How often a step that does not raise the posterior is halved."""

INCREMENT = 0.01
"""Width of the forward differences, in standard deviations of a parameter with all others held: so narrow that
curvature does not matter, and far wider than rounding."""

THREADS = 2

CHUNK = 1000
"""Samples between two sums over the bank, which bound its memory: either half is a part of the record."""


class Changes(Protocol):
    """Ways in which readings might change."""

    @property
    def count(self) -> int:
        """How many there are, c."""

    def of(self, inputs: Array, readings: Array, /) -> Array:
        """By how much readings (T, m) change with each of them (T, m, c); NaN only where the readings are."""


class Score(NamedTuple):
    """What a record says about θ at one point.

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
        """What both say together."""
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


class Mode(NamedTuple):
    """Where a search ended.

    Attributes
    ----------
    mean, cov
        θ (n_θ,) and the inverse of Fisher information plus prior information (n_θ, n_θ).
    iterations
        Scoring steps taken.
    settled
        Whether the last step was small enough.
    decrement
        The squared length of the last step in standard deviations.
    look
        The last look that the search went on from: θ is one step away from there where it settled.
    """

    mean: Array
    cov: Array
    iterations: int
    settled: bool
    decrement: float
    look: Look


class Posterior(NamedTuple):
    """The mode of the posterior with its curvature.

    Attributes
    ----------
    mean, cov, iterations, settled
        See `Mode`.
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


def posterior_mode(
    build: Callable[[Array], StateSpace],
    inputs: Array,
    readings: Array,
    *,
    prior_mean: Array,
    prior_cov: Array,
    start: Array,
    start_cov: Array,
) -> Posterior:
    """Find the mode of the posterior of θ, and what the state-only filter says there; arguments as for `find_mode`."""
    mode = find_mode(
        build, [(inputs, readings)], prior_mean=prior_mean, prior_cov=prior_cov, start=start, start_cov=start_cov
    )
    model = build(mode.mean)
    info = EKF.run(model, EKF.init(model), inputs, readings)[1]
    return Posterior(mode.mean, mode.cov, float(info.log_likelihood.sum()), mode.iterations, mode.settled, info)


def find_mode(
    build: Callable[[Array], StateSpace],
    samples: Samples,
    *,
    prior_mean: Array,
    prior_cov: Array,
    start: Array,
    start_cov: Array,
    changes: Changes | None = None,
    tolerance: float = MODE_TOLERANCE,
) -> Mode:
    """Find the mode of the posterior of θ.

    Parameters
    ----------
    build
        The state-only model for a value of θ (n_θ,).
    samples
        Blocks of inputs and readings as `windsysid.filters.EKF.run` takes them.
    prior_mean, prior_cov
        Gaussian prior of θ (n_θ,), (n_θ, n_θ).
    start, start_cov
        Where to start, and the covariance whose inverse scales the first differences.
    changes
        Changes of the readings whose mixed derivatives the looks tell too.
    tolerance
        Newton's decrement below which a step is the last.

    Raises
    ------
    WindsysidError
        If the likelihood can be computed neither at the start nor at the prior's mean, or slopes are not finite.
    """
    information = np.linalg.inv(prior_cov)

    def objective(look: Look) -> float:
        off = look.theta - prior_mean
        value = float(look.found.log_likelihood - 0.5 * off @ information @ off)
        return value if np.isfinite(value) else -np.inf

    widths = INCREMENT * np.sqrt(1.0 / np.diag(np.linalg.inv(start_cov) + information))
    settled, before = False, 0.0
    with ThreadPoolExecutor(THREADS) as pool:
        for begun in (start, prior_mean):  # a recursion may have lost its way
            here = look(build, samples, begun.copy(), widths, pool, changes)
            if np.isfinite(best := objective(here)):
                break
        else:
            raise _not_finite("the likelihood is not finite at the start")
        for count in range(1, MAX_ITERATIONS + 1):  # noqa: B007 (told to the caller)
            theta = here.theta
            curvature = here.found.fisher + information
            pull = here.found.gradient - information @ (theta - prior_mean)
            step = np.asarray(np.linalg.solve(curvature, pull), dtype=np.float64)
            if not np.isfinite(step).all():
                raise _not_finite("the slopes of the likelihood are not finite")
            distance = float(step @ curvature @ step)
            step *= min(1.0, MAX_STEP_SIGMAS / float(np.max(np.abs(step) * np.sqrt(np.diag(information)))))
            if distance < tolerance or distance**2 < LEFT * before:  # so short a step is taken unseen
                theta, settled = theta + step, True
                break
            widths = INCREMENT / np.sqrt(np.diag(curvature))
            for _ in range(MAX_HALVINGS):
                candidate = look(build, samples, theta + step, widths, pool, changes)
                if (value := objective(candidate)) > best:
                    here, best, before = candidate, value, float(step @ curvature @ step)
                    theta = here.theta
                    break
                step = 0.5 * step
            else:
                settled = distance < NEARLY_SETTLED
                break
    return Mode(theta, np.linalg.inv(curvature), count, settled, distance, here)


def _not_finite(what: str) -> WindsysidError:
    return WindsysidError(f"{what}: check units, the turbine file and the priors")


def look(
    build: Callable[[Array], StateSpace], samples: Samples, theta: Array, widths: Array,
    pool: ThreadPoolExecutor | None = None, changes: Changes | None = None,
) -> Look:  # fmt: skip
    """What the readings say at θ (n_θ,), from differences of the widths given (n_θ,), and of changes of themselves."""
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
        Widths of the differences (n_θ,): `INCREMENT` standard deviations of each parameter serve well.
    """
    with ThreadPoolExecutor(THREADS) as pool:
        found = look(build, [(inputs, readings)], theta, widths, pool).found
    return found.gradient, found.fisher


def log_likelihoods(
    build: Callable[[Array], StateSpace], samples: Samples, points: Sequence[Array], pool: ThreadPoolExecutor
) -> Array:
    """Of the readings at several θ (K,), by filters side by side; not finite where a filter loses its way."""
    bank, found = bank_of([build(theta) for theta in points]), np.zeros(len(points))
    for inputs, readings in samples:
        for first in range(0, len(readings), CHUNK):
            part = slice(first, first + CHUNK)
            bank, scores = run_bank(bank, inputs[part], readings[part], pool)
            found -= (scores.log_std + 0.5 * np.square(scores.whitened)).sum(axis=(0, 1))
        found -= _of_the_count(readings)
    return found


def _of_the_count(readings: Array) -> float:
    """What the number of normal readings takes of a log-likelihood, whatever they are."""
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
    for first in range(0, len(readings), CHUNK):
        part = slice(first, first + CHUNK)
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

"""The mode of the posterior by Fisher scoring on the innovations of a state-only filter.

A joint filter leaves out how its own gain depends on the parameters (Ljung 1979), and what it learns while the state is still
unknown counts too much: its bands are too narrow (`windsysid.study.calibration` prints by how much). The likelihood of the
state-only filter knows both. With whitened innovations z and the standard deviations s they were divided by,

    log L = −Σ (log s + z²/2) + const,   ∂ log L = −Σ (∂ log s + z ∂z),
    Fisher information ≈ Σ a aᵀ + 2 Σ ∂log s ∂log sᵀ,   a = ∂z + z ∂log s  (the derivative of the innovation, over s),

and derivatives are differences between filters at neighbouring parameters, which run side by side in a bank
(`windsysid.filters.bank`). Source: Ljung, IEEE TAC 24(1), 1979, https://doi.org/10.1109/TAC.1979.1101943; Särkkä & Svensson, ch. 16.
"""

import math
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.errors import WindsysidError
from windsysid.filters import EKF, Info
from windsysid.filters.bank import Bank, bank_of, run_bank
from windsysid.statespace import StateSpace

__all__ = ["Posterior", "Score", "information", "neighbours", "posterior_mode", "score"]

Array = NDArray[np.float64]

ITERATIONS = 15
SETTLED = 0.05
"""Newton's decrement, the squared length of a step in standard deviations, below which it is the last."""

NEAR = 1.0
"""The same, below which differences are central instead of forward."""

LONGEST = 3.0
"""No step moves a parameter by more than so many standard deviations of its prior."""

HALVINGS = 8
"""How often a step that does not raise the posterior is halved."""

INCREMENT = 0.1
"""Width of the differences, in standard deviations of a parameter with all others held."""

THREADS = 2

CHUNK = 1000
"""Samples between two sums over the bank, which bound its memory."""


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
    """

    log_likelihood: float
    gradient: Array
    fisher: Array


class Posterior(NamedTuple):
    """The mode of the posterior with its curvature.

    Attributes
    ----------
    mean, cov
        θ (n_θ,) and the inverse of Fisher information plus prior information (n_θ, n_θ).
    log_likelihood
        Of the readings at the mode.
    iterations
        Scoring steps taken.
    settled
        Whether the last step was small enough.
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
    """Find the mode of the posterior of θ.

    Parameters
    ----------
    build
        The state-only model for a value of θ (n_θ,).
    inputs, readings
        As `windsysid.filters.EKF.run` takes them.
    prior_mean, prior_cov
        Gaussian prior of θ (n_θ,), (n_θ, n_θ).
    start, start_cov
        Where to start, and the covariance whose inverse scales the first differences.

    Raises
    ------
    WindsysidError
        If the likelihood cannot be computed at the start.
    """
    information = np.linalg.inv(prior_cov)

    def objective(theta: Array, found: Score) -> float:
        off = theta - prior_mean
        value = float(found.log_likelihood - 0.5 * off @ information @ off)
        return value if np.isfinite(value) else -np.inf

    theta, widths = start.copy(), INCREMENT * np.sqrt(1.0 / np.diag(np.linalg.inv(start_cov) + information))
    central, settled = False, False
    with ThreadPoolExecutor(THREADS) as pool:

        def look(at: Array) -> Score:
            bank = bank_of([build(values) for values in neighbours(at, widths, central=central)])
            return score(bank, inputs, readings, widths, central=central, pool=pool)[1]

        found = look(theta)
        best = objective(theta, found)
        if not np.isfinite(best):
            raise WindsysidError(
                "the likelihood is not finite at the start: check units, the turbine file and the priors"
            )
        for count in range(1, ITERATIONS + 1):  # noqa: B007 (told to the caller)
            curvature = found.fisher + information
            pull = found.gradient - information @ (theta - prior_mean)
            step = np.asarray(np.linalg.solve(curvature, pull), dtype=np.float64)
            distance = float(step @ curvature @ step)
            step *= min(1.0, LONGEST / float(np.max(np.abs(step) * np.sqrt(np.diag(information)))))
            last, widths = central and distance < SETTLED, INCREMENT / np.sqrt(np.diag(curvature))
            central = central or distance < NEAR
            if last:  # so short a step is taken unseen
                theta, settled = theta + step, True
                break
            for _ in range(HALVINGS):
                candidate = look(theta + step)
                if (value := objective(theta + step, candidate)) > best:
                    theta, found, best = theta + step, candidate, value
                    break
                step = 0.5 * step
            else:
                settled = central and distance < NEAR
                if settled or central:
                    break
                central, found = True, look(theta)
    model = build(theta)
    info = EKF.run(model, EKF.init(model), inputs, readings)[1]
    return Posterior(theta, np.linalg.inv(curvature), float(info.log_likelihood.sum()), count, settled, info)


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
        Widths of the central differences (n_θ,): a tenth of a standard deviation of each parameter serves well.
    """
    with ThreadPoolExecutor(THREADS) as pool:
        bank = bank_of([build(values) for values in neighbours(theta, widths, central=True)])
        found = score(bank, inputs, readings, widths, central=True, pool=pool)[1]
    return found.gradient, found.fisher


def neighbours(theta: Array, widths: Array, *, central: bool) -> list[Array]:
    """θ, each parameter one width above, and for central differences each one width below."""
    steps = np.diag(widths)
    return [theta, *(theta + step for step in steps), *(theta - step for step in steps if central)]


def score(
    bank: Bank, inputs: Array, readings: Array, widths: Array, *, central: bool, pool: ThreadPoolExecutor | None = None
) -> tuple[Bank, Score]:
    """Run a bank of `neighbours` over T samples and take the differences between its filters."""
    n = len(widths)
    log_likelihood, gradient, fisher = 0.0, np.zeros(n), np.zeros((n, n))
    for first in range(0, len(readings), CHUNK):
        part = slice(first, first + CHUNK)
        bank, scores = run_bank(bank, inputs[part], readings[part], pool)
        known = np.isfinite(readings[part])
        z, log_s = scores.whitened[known], scores.log_std[known]
        log_likelihood -= float(np.sum(log_s[:, 0] + 0.5 * z[:, 0] ** 2)) + 0.5 * math.log(2.0 * math.pi) * len(z)
        width, below = (2.0 * widths, slice(n + 1, None)) if central else (widths, slice(0, 1))
        slopes_z, slopes_s = ((lanes[:, 1 : n + 1] - lanes[:, below]) / width for lanes in (z, log_s))
        gradient -= slopes_s.sum(axis=0) + slopes_z.T @ z[:, 0]
        innovation = slopes_z + z[:, :1] * slopes_s
        fisher += innovation.T @ innovation + 2.0 * slopes_s.T @ slopes_s
    return bank, Score(log_likelihood, gradient, fisher)

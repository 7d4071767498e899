"""The mode of the posterior by Fisher scoring on the innovations of a state-only filter.

A joint filter leaves out how its own gain depends on the parameters (Ljung 1979), and what it learns while the state is still
unknown counts too much: its bands are too narrow (`windsysid.study.calibration` prints by how much). The likelihood of the
state-only filter knows both. With whitened innovations z and the standard deviations s they were divided by,

    log L = −Σ (log s + z²/2) + const,   ∂ log L = −Σ (∂ log s + z ∂z),
    Fisher information ≈ Σ a aᵀ + 2 Σ ∂log s ∂log sᵀ,   a = ∂z + z ∂log s  (the derivative of the innovation, over s),

and derivatives are central differences of the filter in scaled parameters. Source: Ljung, IEEE TAC 24(1), 1979,
https://doi.org/10.1109/TAC.1979.1101943; Särkkä & Svensson, ch. 16.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.errors import WindsysidError
from windsysid.filters import EKF, Info
from windsysid.statespace import StateSpace

__all__ = ["Posterior", "information", "posterior_mode"]

Array = NDArray[np.float64]

ITERATIONS = 15
SETTLED = 0.05
"""Newton's decrement, the squared length of a step in standard deviations, below which it is the last."""

NEAR = 1.0
"""The same, below which differences are central instead of forward."""

HALVINGS = 8
"""How often a step that does not raise the posterior is halved."""

INCREMENT = 0.1
"""Width of the differences, in standard deviations of a parameter with all others held."""

THREADS = 2


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

    def run(theta: Array) -> Info:
        model = build(theta)
        return EKF.run(model, EKF.init(model), inputs, readings)[1]

    def objective(theta: Array, info: Info) -> float:
        off = theta - prior_mean
        value = float(info.log_likelihood.sum() - 0.5 * off @ information @ off)
        return value if np.isfinite(value) else -np.inf

    theta, widths = start.copy(), INCREMENT * np.sqrt(1.0 / np.diag(np.linalg.inv(start_cov) + information))
    info = run(theta)
    best = objective(theta, info)
    if not np.isfinite(best):
        raise WindsysidError("the likelihood is not finite at the start: check units, the turbine file and the priors")
    central = False
    with ThreadPoolExecutor(THREADS) as pool:
        for count in range(1, ITERATIONS + 1):
            gradient, fisher = _score(run, theta, info, widths, pool, central=central)
            curvature = fisher + information
            pull = gradient - information @ (theta - prior_mean)
            step = np.asarray(np.linalg.solve(curvature, pull), dtype=np.float64)
            distance = float(step @ curvature @ step)
            widths = INCREMENT / np.sqrt(np.diag(curvature))
            theta, info, reached = _ascend(run, objective, theta, info, best, step)
            if central and (distance < SETTLED or reached <= best):
                settled, cov = distance < NEAR, np.linalg.inv(curvature)
                return Posterior(theta, cov, float(info.log_likelihood.sum()), count, settled, info)
            central = central or distance < NEAR or reached <= best
            best = reached
    return Posterior(theta, np.linalg.inv(curvature), float(info.log_likelihood.sum()), ITERATIONS, False, info)


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

    def run(at: Array) -> Info:
        model = build(at)
        return EKF.run(model, EKF.init(model), inputs, readings)[1]

    with ThreadPoolExecutor(THREADS) as pool:
        return _score(run, theta, run(theta), widths, pool, central=True)


def _ascend(
    run: Callable[[Array], Info],
    objective: Callable[[Array, Info], float],
    theta: Array,
    info: Info,
    best: float,
    step: Array,
) -> tuple[Array, Info, float]:
    """The first of step, step/2, step/4 … that raises the objective, or where it stood."""
    for _ in range(HALVINGS):
        candidate = run(theta + step)
        value = objective(theta + step, candidate)
        if value > best:
            return theta + step, candidate, value
        step = 0.5 * step
    return theta, info, best


def _score(
    run: Callable[[Array], Info], theta: Array, info: Info, widths: Array, pool: ThreadPoolExecutor, *, central: bool
) -> tuple[Array, Array]:
    """Gradient of the log-likelihood (n_θ,) and Fisher information (n_θ, n_θ), by forward or central differences."""
    known = np.isfinite(info.whitened)
    z = info.whitened[known]
    n = len(theta)
    slopes_z, slopes_s = np.empty((n, z.size)), np.empty((n, z.size))

    def difference(k: int) -> None:
        step = np.zeros(n)
        step[k] = widths[k]
        above = run(theta + step)
        below = run(theta - step) if central else info
        width = 2.0 * widths[k] if central else widths[k]
        slopes_z[k] = (above.whitened[known] - below.whitened[known]) / width
        slopes_s[k] = np.log(above.whitening_std[known] / below.whitening_std[known]) / width

    list(pool.map(difference, range(n)))
    gradient = -slopes_s.sum(axis=1) - slopes_z @ z
    innovation = slopes_z + z * slopes_s
    return gradient, innovation @ innovation.T + 2.0 * slopes_s @ slopes_s.T

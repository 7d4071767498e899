"""The mode of the posterior of equations of one's own, from cross-spectra.

Far from the truth no resonance of the model meets one of the record. So the search begins with all resonances made wide
(by a share of their frequencies), and the likelihood is let in little by little. The information of wide resonances on
natural frequencies is kept and that on damping is discarded. Then come the spectra as they are; what a finite record
does to them (`LinearModel.smear`) is taken at the last mode found, until that stays.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from windsysid._types import Array, Complex
from windsysid.spectral.lti.likelihood import LinearModel
from windsysid.spectral.rotor.scoring import find_in_stages
from windsysid.spectral.transforms.cross_spectra import CrossSpectra, PooledBins

__all__ = ["LinearFit", "fit_linear"]

WIDENING_STAGES = ((0.3, 0.05), (0.1, 0.2))
"""Setting: share of the frequency by which resonances are widened, and weight of the likelihood, of the first
stages."""

WEIGHT_STAGES = ((0.03, 3), (0.2, 3), (1.0, 1))
"""Setting: weight of the likelihood of the next stages, and step between the rows in use."""

MAX_SMEAR_ITERATIONS = 8
"""Numerical: largest number of searches with the effect of a finite record on the spectra."""

MAX_STEP_SIGMAS = 0.1
"""Numerical: step of an unknown in standard deviations below which these searches have converged."""

FREQUENCY_STD = 0.02
"""Setting: relative standard deviation within which the natural frequencies of the first stages are kept."""

ALIGNMENT_STEPS = 6
"""Numerical: Gauss–Newton steps towards these natural frequencies."""

START_SIGMAS = (0.0, 0.5, 1.0, 2.0, 4.0)
"""Setting: standard deviations above the prior mean at which a start is tried, until one is stable."""


class LinearFit(NamedTuple):
    """Log-likelihood of a record, its gradient and information.

    Attributes
    ----------
    unknowns, cov
        Mode of the posterior (n,) and Laplace's covariance (n, n).
    log_likelihood
        At the mode.
    rows, smear
        The rows of the last search, and what a finite record adds to their spectra.
    settled
        Whether the search ended by itself.
    """

    unknowns: Array
    cov: Array
    log_likelihood: float
    rows: PooledBins
    smear: Complex
    settled: bool


def fit_linear(model: LinearModel, spectra: CrossSpectra) -> LinearFit:
    """The mode of the posterior from the centre of the prior, or the nearest point of more damping that is stable.

    Raises
    ------
    LinAlgError
        If the spectrum there is not positive definite, or the equations are unstable.
    """
    mean, std = model.prior
    factor, unknowns = spectra.last.overlap, _stable_start(model)
    for widening, weight in WIDENING_STAGES:
        rows = model.rows(spectra, unknowns, widening)
        evaluate = _evaluator(model, rows, factor, None, widening)
        unknowns = find_in_stages(evaluate, unknowns, model.prior, [(weight, 1)], rough=True).point
        unknowns = _aligned(model, unknowns)
    for stage in WEIGHT_STAGES:
        rows = model.rows(spectra, unknowns)
        evaluate = _evaluator(model, rows, factor, None)
        unknowns = find_in_stages(evaluate, unknowns, model.prior, [stage], rough=True).point
    stays = False
    rows = model.rows(spectra, unknowns)
    for _ in range(MAX_SMEAR_ITERATIONS):
        smear = model.smear(spectra, rows, unknowns)
        mode = find_in_stages(_evaluator(model, rows, factor, smear), unknowns, model.prior, [(1.0, 1)])
        sigmas = np.abs(mode.point - unknowns) * np.sqrt(np.diag(mode.evaluation.information))  # each step, others held
        stays = mode.converged and float(np.max(sigmas)) < MAX_STEP_SIGMAS
        unknowns = mode.point
        if stays:
            break
    off = (mode.point - mean) / std
    cov = np.linalg.inv(mode.evaluation.information)
    log_likelihood = -(mode.value - 0.5 * float(off @ off))
    return LinearFit(mode.point, 0.5 * (cov + cov.T), log_likelihood, rows, smear, stays)


def _evaluator(
    model: LinearModel, rows: PooledBins, factor: float, smear: Complex | None, widening: float = 0.0
) -> Callable[[Array, int], tuple[float, Array, Array]]:
    """J, g and F of the rows; of every n-th, as much as all of them would be."""

    def evaluate(unknowns: Array, every: int) -> tuple[float, Array, Array]:
        if every == 1:
            return model.likelihood(rows, factor, unknowns, smear, widening)
        some = slice(every // 2, None, every)
        few = PooledBins(rows.first[some], rows.frequency[some], rows.counts[some], rows.power[some])
        share = float(few.counts.sum() / rows.counts.sum())
        return model.likelihood(few, factor * share, unknowns, None, widening)

    return evaluate


def _aligned(model: LinearModel, unknowns: Array) -> Array:
    """The most probable θ beforehand that has the natural frequencies of `unknowns`, η as they are."""
    at, n = model.unknowns.of("parameters"), len(model.parameters)
    mean, std = (values[at] for values in model.prior)
    wanted = model.natural_frequencies(unknowns[None])[0]
    steps = 1e-4 * np.minimum(std, 1.0)
    theta = unknowns[at].copy()
    for _ in range(ALIGNMENT_STEPS):
        points = np.concatenate([theta[None], theta + np.diag(steps), theta - np.diag(steps)])
        found = model.natural_frequencies(points)
        if found.shape[1] != len(wanted) or not len(wanted):
            return unknowns
        slopes = (found[1 : n + 1] - found[n + 1 :]) / (2.0 * steps[:, None])
        information = slopes @ slopes.T / FREQUENCY_STD**2 + np.diag(std**-2.0)
        pull = slopes @ (wanted - found[0]) / FREQUENCY_STD**2 - (theta - mean) / std**2
        theta = theta + np.clip(np.linalg.solve(information, pull), -std, std)
    aligned = unknowns.copy()
    aligned[at] = theta
    return aligned if model.stable(aligned) else unknowns


def _stable_start(model: LinearModel) -> Array:
    """The centre of the prior; where a motion grows there, linear parameters as far above as it takes."""
    mean, std = model.prior
    linear = model.unknowns.vector(parameters=[not q.logarithmic for q in model.parameters])
    for above in START_SIGMAS:
        start = np.asarray(mean + above * linear * std)
        if model.stable(start):
            return start
    return mean

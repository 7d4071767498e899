"""Rao's score test of regressors that a fit does not have.

At the mode of the posterior the gradient to the fit's own unknowns is zero. Of c regressors with the sums of
`windsysid.identification.estimate.fitted.linearisation`, and Λ the information on the fit's unknowns, the prior
included,

    g = Jᵀ z,   I = Jᵀ J − Xᵀ Λ⁻¹ X,   X = J_θᵀ J,   S = gᵀ I⁻¹ g,

S is χ² with c degrees of freedom where the innovations are white and nothing is missing in the model; φ̂ = I⁻¹ g has
the covariance I⁻¹, and Δθ = Λ⁻¹ X φ is by how much the fit would change with regressors of size φ, to first order. A
fit that lacks large ones has its loads far off, and φ̂ with it; (JᵀJ)⁻¹ Jᵀz is unbiased under any loads, and is what is
included.

Real innovations are not quite white, so S is divided by their spectral density next to the frequencies of the
regressors, the mean of 2K values of a periodogram: S/(c · density) has Fisher's F distribution with c and 2K degrees of
freedom.

Sources: Rao, Proc. Camb. Phil. Soc. 44, 1948, https://doi.org/10.1017/S0305004100023987; de Jong & Penzer, J. Am.
Statist. Ass. 93, 1998, https://doi.org/10.1080/01621459.1998.10474129.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import SCREENING_PROBABILITY
from windsysid.identification.estimate.fitted.linearisation import Linearisation, RegressorColumn

__all__ = ["RegressorCandidate", "ScoreTest", "log_tail_of_f", "newton_step", "promising", "score_tests"]

MIN_LEFT_SHARE = 0.05
"""Setting: share of the information on a regressor that the fit's unknowns leave at least: by a linearisation
less is its own error."""

MIN_LEFT_SHARE_OF_STEP = 0.001
"""Setting: as `MIN_LEFT_SHARE`, of steps, whose information belongs to one point: against singular ones only."""

HANN_VARIANCE_FACTOR = 1.94
"""Numerical: variance of the mean of neighbouring frequencies under Hann's window, over that of independent ones."""

NEIGHBOUR_PERIODS = (8.0, 60.0)
"""Setting: periods over the record next to those of what varies a few times in it; loads are smooth there."""


class RegressorCandidate(NamedTuple):
    """Regressors that a fit may lack.

    Attributes
    ----------
    code, channel
        Of the effect, and the reading that shows it.
    columns
        The regressors.
    density_range
        Frequencies, in periods over the record, from and to which the innovations tell the density at theirs.
    places
        At how many places such regressors were looked for: the chance of any is so many times that of one.
    """

    code: str
    channel: str
    columns: tuple[RegressorColumn, ...]
    density_range: tuple[float, float] = NEIGHBOUR_PERIODS
    places: float = 1.0


class ScoreTest(NamedTuple):
    """Result of the score test of one candidate.

    Attributes
    ----------
    candidate
        The regressors that were tested.
    log10_p
        Logarithm of the chance that a record without them has such a statistic, at any of the places.
    size, cov
        Of the regressors where the fit's unknowns stay (c,), (JᵀJ)⁻¹ Jᵀz, and the covariance of φ̂ (c, c).
    shift
        By how much the fit's unknowns would change with regressors of that size (n,), in their standard deviations.
    widening
        What they add to the covariance of the unknowns (n, n).
    """

    candidate: RegressorCandidate
    log10_p: float
    size: Array
    cov: Array
    shift: Array
    widening: Array


def newton_step(at: Linearisation, columns: Sequence[RegressorColumn], precision: Array) -> tuple[Array, ...]:
    """Step to the mode of regressors, or of changes of those that a fit includes, and its unknowns but clocks together,
    whose prior has a precision (n, n): `size` φ̂, `cov`, `shift` and `widening` as of `ScoreTest`. Λ is that of the
    sums: with the fit's, one step older, I would be the difference of nearly equal numbers of different points."""
    sums = at.sums(columns)
    follow = np.linalg.solve(sums.fisher + precision, sums.mixed)
    cov = _inverse_of_rest(sums.information, sums.mixed.T @ follow, MIN_LEFT_SHARE_OF_STEP)
    size = cov @ sums.gradient
    return size, cov, follow @ size / np.sqrt(np.diag(at.cov)), follow @ cov @ follow.T


def promising(at: Linearisation, candidates: Sequence[RegressorCandidate]) -> list[RegressorCandidate]:
    """Candidates whose statistic with the fit's unknowns fixed is beyond `SCREENING_PROBABILITY`: I is seldom less than
    half of JᵀJ, and S is at most twice as large then."""
    return [
        one.candidate for one in score_tests(at.held, candidates) if one.log10_p < math.log10(SCREENING_PROBABILITY)
    ]


def score_tests(at: Linearisation, candidates: Sequence[RegressorCandidate]) -> list[ScoreTest]:
    """Test candidates, all in one pass over the record; those that no reading shows are left out."""
    if not candidates:
        return []
    sums = at.sums([column for one in candidates for column in one.columns])
    periodogram, found, first = _periodogram(at.innovations), [], 0
    for one in candidates:
        own = slice(first, first + len(one.columns))
        first = own.stop
        if not (np.isfinite(sums.gradient[own]).all() and sums.energy[:, own].sum() > 0.0):
            continue
        follow = at.cov @ sums.mixed[:, own]
        cov = _inverse_of_rest(sums.information[own, own], sums.mixed[:, own].T @ follow)
        alone = np.linalg.pinv(sums.information[own, own], hermitian=True) @ sums.gradient[own]
        density, freedom = _density(periodogram, sums.energy[:, own].sum(axis=1), one.density_range)
        count = len(one.columns)
        statistic = float(sums.gradient[own] @ cov @ sums.gradient[own]) / (count * density)
        log10_p = (log_tail_of_f(statistic, count, freedom) + math.log(one.places)) / math.log(10.0)
        shift, widening = follow @ alone / np.sqrt(np.diag(at.cov)), follow @ cov @ follow.T
        found.append(ScoreTest(one, min(log10_p, 0.0), alone, np.asarray(density * cov), shift, widening))
    return found


def _inverse_of_rest(information: Array, explained: Array, min_share: float = MIN_LEFT_SHARE) -> Array:
    """The inverse (c, c) of information without the part that the fit's unknowns explain, at least a share of it in
    each direction."""
    values, axes = np.linalg.eigh(information)
    kept = values > 1e-12 * values[-1]
    root = axes[:, kept] / np.sqrt(values[kept])
    shares, axes = np.linalg.eigh(np.eye(root.shape[1]) - root.T @ explained @ root)
    root = root @ axes / np.sqrt(np.maximum(shares, min_share))
    return np.asarray(root @ root.T)


def _periodogram(innovations: Array) -> Array:
    """Of innovations (T, m), one for white noise of variance one; readings that are missing left out."""
    window = np.hanning(len(innovations))
    there = np.maximum(np.mean(innovations != 0.0, axis=0), 1e-9)
    return np.asarray(np.abs(np.fft.rfft(window[:, None] * innovations, axis=0)) ** 2 / np.sum(window**2) / there)


def _density(periodogram: Array, energy: Array, density_range: tuple[float, float]) -> tuple[float, float]:
    """The density of the innovations between two frequencies, each reading (m,) weighted by how much of the regressors
    it has, and the degrees of freedom of that mean."""
    low, high = (int(np.clip(round(edge), 1, len(periodogram) - 1)) for edge in density_range)
    share = energy / energy.sum()
    means = periodogram[low : max(high, low + 1)].mean(axis=0)
    density = float(share @ means)
    alone = 2.0 * max(high - low, 1) / HANN_VARIANCE_FACTOR
    return density, alone * density**2 / float(np.square(share * means).sum())


def log_tail_of_f(statistic: float, count: float, freedom: float) -> float:
    """Natural logarithm of the chance that F with so many degrees of freedom exceeds a statistic, however small.

    Examples
    --------
    >>> round(log_tail_of_f(3.0, 2.0, 10.0), 6)  # (1 + 2 · 3/10)^−5 has a closed form
    -2.350018
    """
    from scipy.special import betainc, betaln

    x, a, b = freedom / (freedom + count * statistic), 0.5 * freedom, 0.5 * count
    chance = float(betainc(a, b, x))
    if chance > 1e-290:
        return math.log(chance)
    return a * math.log(x) - math.log(a) - float(betaln(a, b))

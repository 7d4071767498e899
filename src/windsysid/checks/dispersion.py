"""Dispersion of scores: the sandwich variance of a quantity over the variance that Fisher information gives.

The score of a fit is a sum over parts of a record, in time or over frequencies. Where the model is true, the scores g_k
of parts are uncorrelated and have their part F_k of Fisher information as covariance. At the mode of the posterior,
with the prior precision Λ and C = (Σ F_k + Λ)⁻¹, part k shifts a quantity aᵀθ by aᵀC g_k, with the variance

    V_kl = aᵀC (δ_kl F_k − F_k C F_l) C a,      ν = (Σ V_kk)² / Σ V_kl²,      r = Σ (aᵀC g_k)² / Σ V_kk,

where V is the covariance of the shifts. r ν is χ² with ν degrees of freedom, one for two halves: r is the sandwich
covariance over the inverse of the information. Loads that change over time, a spectrum of another shape and a mode that
the model lacks raise it for the quantities that they affect. It measures scatter: an error that is the same in all
parts stays unseen. Parts are joined to groups of equal information on the quantity.

A variance is not multiplied by r, which scatters where ν is small, but by its expectation over two explanations: the
model is true, or the dispersion is s², with a scaled-inverse-χ² prior. Their odds follow from r in closed form.

Sources: White, Econometrica 50, 1982, https://doi.org/10.2307/1912526 (the sandwich); Whittle, Ark. Mat. 2, 1953,
https://doi.org/10.1007/BF02590998 (scores over frequencies); Gelman et al., Bayesian Data Analysis, 3rd ed., §2.6 (the
conjugate prior of a variance); Satterthwaite, Biometrics 2, 1946, https://doi.org/10.2307/3002019 (ν).
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import PRIOR_ODDS_OF_MISFIT

__all__ = ["Dispersion", "Part", "PartScores", "expected_factor", "join_parts", "log_density_ratio"]

MAX_STORED_PARTS = 64
"""Setting: number of parts of a record from which on neighbours are joined, so that memory is bounded."""

MAX_GROUPS = 8
"""Setting: groups of equal information on a quantity, at most."""

PRIOR_SHAPE, PRIOR_SCALE = 2.0, 4.0
"""Setting: of the inverse gamma prior of s², with the mean 4 and long tails."""


class Part(NamedTuple):
    """Gradient and Fisher information of a segment of a record, to n unknowns.

    Attributes
    ----------
    samples
        Number of samples.
    gradient, fisher
        Of its log-likelihood (n,), and its Fisher information (n, n).
    """

    samples: int
    gradient: Array
    fisher: Array

    def plus(self, more: "Part") -> "Part":
        """Sum of two segments."""
        return Part(self.samples + more.samples, self.gradient + more.gradient, self.fisher + more.fisher)


def join_parts(parts: Sequence[Part]) -> tuple[Part, ...]:
    """Join neighbouring segments until there are at most `MAX_STORED_PARTS`."""
    found = tuple(parts)
    while len(found) > MAX_STORED_PARTS:
        pairs = [one.plus(other) for one, other in zip(found[::2], found[1::2], strict=False)]
        found = (*pairs, *found[2 * len(pairs) :])
    return found


class Dispersion(NamedTuple):
    """Dispersion of groups about a quantity.

    Attributes
    ----------
    ratio, freedom
        r and ν.
    share
        Share of the quantity's variance that comes from the data and not from priors.
    place
        Time [s] or frequency [Hz] of the group that shifts the quantity most.
    """

    ratio: float
    freedom: float
    share: float
    place: float


class PartScores(NamedTuple):
    """Gradients and information of K parts of a record, near the mode of the posterior of n unknowns.

    Attributes
    ----------
    over
        Axis along which the record is divided.
    places
        Their middles (K,) [s] or [Hz].
    gradients, information
        Of the log-likelihood of each (K, n), and its Fisher information (K, n, n).
    precision, pull
        Prior precision Λ (n, n), and the gradient of the log prior (n,).
    given
        Indices of the unknowns that are taken as given: masses and aerodynamics.
    """

    over: Literal["time", "frequency"]
    places: Array
    gradients: Array
    information: Array
    precision: Array
    pull: Array
    given: tuple[int, ...] = ()

    def between(self, low: float, high: float) -> "PartScores":
        """Scores of the parts between two places."""
        at = (self.places >= low) & (self.places <= high)
        return self._replace(places=self.places[at], gradients=self.gradients[at], information=self.information[at])

    def dispersion(self, quantity: Array) -> Dispersion | None:
        """Dispersion about a linear combination of the first unknowns; None if fewer than two groups inform it."""
        free = np.setdiff1d(np.arange(len(self.pull)), np.array(self.given, dtype=np.intp))
        a = np.concatenate([quantity, np.zeros(len(self.pull) - len(quantity))])[free]
        g, F = self.gradients[:, free], self.information[:, free][:, :, free]
        C = np.linalg.inv(F.sum(axis=0) + self.precision[np.ix_(free, free)])
        step, u = C @ (g.sum(axis=0) + self.pull[free]), C @ a
        own = np.einsum("n,kno,o->k", u, F, u)
        if not own.sum() > 0.0:
            return None
        label = (MAX_GROUPS * (np.cumsum(own) - 0.5 * own) / own.sum()).astype(int)
        groups = [label == each for each in np.unique(label)]
        F = np.array([F[some].sum(axis=0) for some in groups])
        moved, W = np.array([u @ g[some].sum(axis=0) for some in groups]) - F @ step @ u, F @ u
        V = np.diag(W @ u) - W @ C @ W.T
        if np.count_nonzero(np.diag(V) > 0.0) < 2:
            return None
        furthest = groups[int(np.argmax(np.abs(moved)))]
        return Dispersion(
            float(np.sum(moved**2) / np.trace(V)),
            float(np.trace(V) ** 2 / np.sum(V**2)),
            min(float(own.sum() / (a @ u)), 1.0),
            float(own[furthest] @ self.places[furthest] / own[furthest].sum()),
        )


def log_density_ratio(found: Dispersion) -> float:
    """Log of the density of r if the dispersion is s², over that if the model is true."""
    half, x = 0.5 * found.freedom, 0.5 * found.ratio * found.freedom
    log_ratio = math.lgamma(half + PRIOR_SHAPE) - math.lgamma(PRIOR_SHAPE) + x
    return log_ratio + PRIOR_SHAPE * math.log(PRIOR_SCALE) - (half + PRIOR_SHAPE) * math.log(PRIOR_SCALE + x)


def expected_factor(found: Dispersion) -> float:
    """Expected factor on the variance of a quantity, over a true and an untrue model.

    Examples
    --------
    >>> [round(expected_factor(Dispersion(ratio, 8.0, 1.0, 0.0)), 2) for ratio in (1.0, 2.0, 4.0, 16.0)]
    [1.02, 1.23, 3.89, 13.6]
    """
    half, x = 0.5 * found.freedom, 0.5 * found.ratio * found.freedom
    log_odds = math.log(PRIOR_ODDS_OF_MISFIT) + log_density_ratio(found)
    chance = 1.0 / (1.0 + math.exp(-max(min(log_odds, 700.0), -700.0)))
    factor = 1.0 + chance * max((PRIOR_SCALE + x) / (PRIOR_SHAPE + half - 1.0) - 1.0, 0.0)
    return 1.0 + (factor - 1.0) * found.share

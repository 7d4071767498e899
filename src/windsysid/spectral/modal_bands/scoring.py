"""The posterior of a band's modes: its mode by scoring, its width by the Fisher information.

    J = c_h⁻¹ Σ_k n_k [ln det S̄ + tr S̄⁻¹ P_k] + ½ Σ ((θ − θ₀)/s)²,
    g_a = c_h⁻¹ Σ n_k tr(S̄⁻¹ dS_a (1 − S̄⁻¹ P_k)) + prior,        F_ab = c_h⁻¹ Σ n_k tr(S̄⁻¹ dS_a S̄⁻¹ dS_b) + prior

(Au, Operational Modal Analysis, Springer 2017). Steps are Levenberg's, (F + μ diag F) δ = −g, and the covariance is F⁻¹
at the end.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.spectral.modal_bands.model import (
    SLOPE_SPREAD,
    Modes,
    Scores,
    advance,
    coordinates,
    scores,
    with_real_elements,
)
from windsysid.spectral.transforms.dft import Band

__all__ = ["CLEARLY", "ROUGH", "Fit", "evidence", "score", "score_together", "slopes"]

MAX_STEPS = 40
MAX_TRIALS = 12
"""Of steps ever shorter."""

CONVERGED = 0.01
"""Decrease of J that a step promises, below which it is the last: a seventh of a standard deviation."""

ENDED = 0.1
"""Decrease of J that may be left where a search has ended."""

HOPELESS = 40.0
"""How many steps like the last a search may be from where it must come."""

ROUGH = 0.05
"""Of J: how far fits are taken that are only compared."""

CLEARLY = 6.0
"""2 ln of the evidence that a mode more must bring."""

DAMPING_PRIOR = (np.log(0.015), 1.5)
"""Centre and spread of ln ζ: 0.075 … 30 % are within two of it."""

SLOPE_PRIORS = (1.0, SLOPE_SPREAD)
"""Spread of the slopes a of loads and b of what else is in the band, both about 0."""

COHERENCE_PRIOR = 1.0
"""Spread of the elements of C."""

DRIFT_PRIOR = 4.0
"""Spread of the real and the imaginary parts of a column of Ψ, over the norm of the shape where a search begins."""

MAX_MOVES = (0.02, 1.1, 10.0)
"""By how much a step may change ln f, ln ζ and b."""


class Fit(NamedTuple):
    """What scoring found: modes, the covariance (p, p) of a step, −2 ln of the likelihood, and whether it ended by
    itself."""

    modes: Modes
    cov: Array
    deviance: float
    converged: bool

    def std(self, j: int) -> tuple[float, float]:
        """Standard deviations of ln f and ln ζ of mode j."""
        r = len(self.modes.frequency)
        return float(np.sqrt(self.cov[j, j])), float(np.sqrt(self.cov[r + j, r + j]))


def score(
    start: Modes, band: Band, *, max_steps: int = MAX_STEPS, converged: float = CONVERGED, target: float = np.inf
) -> Fit:
    """The mode of the posterior from a start.

    A search whose −2 ln likelihood is so far above `target` that steps like the last would not bring it there is given
    up.
    """
    return score_together([start], [band], max_steps=max_steps, converged=converged, target=target)[0]


def score_together(
    starts: Sequence[Modes],
    bands: Sequence[Band],
    *,
    max_steps: int = MAX_STEPS,
    converged: float = CONVERGED,
    target: float = np.inf,
) -> list[Fit]:
    """The mode of the posterior of several records' modes, which have their frequencies and damping ratios in common.

    Likelihoods add. Shapes, loads and what else is in the band are each record's own, and its part of the joint
    covariance is in its fit. The records' unknowns are eliminated one record after the other (Schur's complement), so
    that the cost grows with their number only.
    """
    shared = starts[0].frequency, starts[0].damping
    modes = [with_real_elements(start._replace(frequency=shared[0], damping=shared[1])) for start in starts]
    priors = [_Prior(one, 1.0 / len(modes)) for one in modes]
    here, cost = _joint(modes, bands, priors)
    mu, grow, ended, small = 1e-2, 2.0, False, 0
    for _ in range(max_steps):
        for _ in range(MAX_TRIALS):
            steps = _limited(_solved(here, len(shared[0]), mu), modes)
            promised = -sum(
                float(s.gradient @ step + 0.5 * step @ s.fisher @ step) for s, step in zip(here, steps, strict=True)
            )
            trial = [advance(one, step) for one, step in zip(modes, steps, strict=True)]
            there, new = _joint(trial, bands, priors)
            if new < cost or promised < converged:
                break
            mu, grow = max(grow * mu, 1e-3), 2.0 * grow
        ended = promised < max(converged, ENDED)
        if not new < cost:
            break
        gained = cost - new
        modes, here, cost = trial, there, new
        # Nielsen's rule: what a step brings, over what it promised, says how far the model of second order reaches
        mu, grow = max(mu * max(0.2, 1.0 - (2.0 * gained / promised - 1.0) ** 3), 1e-9), 2.0
        small = small + 1 if gained < converged else 0
        if promised < converged or small == 2:
            ended = True
            break
        if np.isfinite(target) and 2.0 * (cost - priors[0].cost(modes[0])) - target > HOPELESS * gained:
            break
    covs = _covariances(here, len(shared[0]))
    return [
        Fit(one, cov, 2.0 * found.cost / band.factor, ended)
        for one, cov, found, band in zip(modes, covs, here, bands, strict=True)
    ]


def _joint(modes: Sequence[Modes], bands: Sequence[Band], priors: Sequence["_Prior"]) -> tuple[list[Scores], float]:
    """Slopes of J for each record, and J of all."""
    found = [_posterior(*each) for each in zip(modes, bands, priors, strict=True)]
    return [scores for scores, _ in found], sum(cost for _, cost in found)


def _solved(here: Sequence[Scores], r: int, mu: float) -> list[Array]:
    """Levenberg's step of each record, the first 2 r unknowns being all records'."""
    shared, vector, own = np.zeros((2 * r, 2 * r)), np.zeros(2 * r), []
    for found in here:
        damped = found.fisher + mu * np.diag(np.diagonal(found.fisher))
        across = damped[: 2 * r, 2 * r :]
        solved = np.linalg.solve(damped[2 * r :, 2 * r :], np.column_stack([across.T, found.gradient[2 * r :]]))
        shared += damped[: 2 * r, : 2 * r] - across @ solved[:, :-1]
        vector += found.gradient[: 2 * r] - across @ solved[:, -1]
        own.append(solved)
    common = -np.linalg.solve(shared, vector) if r else vector
    return [np.concatenate([common, -solved[:, -1] - solved[:, :-1] @ common]) for solved in own]


def _covariances(here: Sequence[Scores], r: int) -> list[Array]:
    """Covariance (p, p) of each record's unknowns under all records."""
    if len(here) == 1:
        return [np.asarray(np.linalg.inv(here[0].fisher), dtype=np.float64)]
    shared, own = np.zeros((2 * r, 2 * r)), []
    for found in here:
        across, inner = found.fisher[: 2 * r, 2 * r :], np.linalg.inv(found.fisher[2 * r :, 2 * r :])
        shared += found.fisher[: 2 * r, : 2 * r] - across @ inner @ across.T
        own.append((inner @ across.T, inner))
    common = np.linalg.inv(shared)
    return [
        np.block([[common, -common @ follow.T], [-follow @ common, inner + follow @ common @ follow.T]])
        for follow, inner in own
    ]


def evidence(fit: Fit, bins: int) -> float:
    """−2 ln of the evidence of so many transforms: by Schwarz's approximation, and by Laplace's for Ψ, of which the
    prior says something."""
    modes = fit.modes
    fixed = modes.size - modes.drifting
    found = fit.deviance + fixed * float(np.log(bins))
    if modes.drift is None:
        return found
    spread = _drift_spread(modes)
    size = float(np.sum((coordinates(modes)[-modes.drifting :] / spread) ** 2))
    return found + size + 2.0 * float(np.log(spread).sum()) - float(np.linalg.slogdet(fit.cov[fixed:, fixed:])[1])


def slopes(modes: Modes, band: Band) -> tuple[Scores, Array]:
    """Slopes of J at some modes, and the weights of the prior in the diagonal of its Fisher information, those of Ψ
    last."""
    prior = _Prior(modes, 1.0)
    return _posterior(modes, band, prior)[0], prior.weight


def _drift_spread(modes: Modes) -> Array:
    """Spread of the unknowns of Ψ (2 m r,)."""
    if modes.drift is None:
        return np.empty(0)
    return np.tile(np.repeat(DRIFT_PRIOR * np.linalg.norm(modes.shape, axis=0), len(modes.shape)), 2)


class _Prior:
    """Gaussian in the unknowns that `coordinates` gives; `share` of that of damping."""

    def __init__(self, modes: Modes, share: float) -> None:
        m, r = modes.shape.shape
        loads = r * (r - 1)
        some = int(r > 0)
        self.centre = np.concatenate([np.full(r, DAMPING_PRIOR[0]), np.zeros(loads + some + 1 + modes.drifting)])
        spread = [DAMPING_PRIOR[1]] * r + [COHERENCE_PRIOR] * loads + [SLOPE_PRIORS[0]] * some + [SLOPE_PRIORS[1]]
        self.weight = np.concatenate([spread, _drift_spread(modes)]) ** -2.0
        self.weight[:r] *= share
        first = 2 * r + 2 * m * r - r
        last = modes.size - modes.drifting - 1
        self.at = np.array([*range(r, 2 * r), *range(first, first + loads + some), *range(last, modes.size)])

    def cost(self, modes: Modes) -> float:
        return 0.5 * float(self.weight @ (coordinates(modes) - self.centre) ** 2)


def _posterior(modes: Modes, band: Band, prior: _Prior) -> tuple[Scores, float]:
    """Slopes and value of J."""
    found = scores(modes, band)
    gradient, fisher = found.gradient / band.factor, found.fisher / band.factor
    gradient[prior.at] += prior.weight * (coordinates(modes) - prior.centre)
    fisher[prior.at, prior.at] += prior.weight
    cost = found.cost / band.factor + prior.cost(modes)
    return Scores(found.cost, gradient, fisher), cost if np.isfinite(cost) else np.inf


def _limited(steps: Sequence[Array], modes: Sequence[Modes]) -> list[Array]:
    """Steps that move no mode too far."""
    r = len(modes[0].frequency)
    share = 1.0
    for step, one in zip(steps, modes, strict=True):
        b = len(step) - one.drifting - 1
        moves = [float(np.max(np.abs(part), initial=0.0)) for part in (step[:r], step[r : 2 * r], step[b : b + 1])]
        share = max(share, *(move / most for move, most in zip(moves, MAX_MOVES, strict=True)))
    return [np.asarray(step / share) for step in steps]

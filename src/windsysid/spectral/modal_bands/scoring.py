"""Posterior of a band's modes: mode by Fisher scoring, covariance by the Fisher information.

    J = c_h⁻¹ Σ_k n_k [ln det S̄ + tr S̄⁻¹ P_k] + ½ Σ ((θ − θ₀)/s)²,
    g_a = c_h⁻¹ Σ n_k tr(S̄⁻¹ dS_a (1 − S̄⁻¹ P_k)) + prior,        F_ab = c_h⁻¹ Σ n_k tr(S̄⁻¹ dS_a S̄⁻¹ dS_b) + prior

(Au, Operational Modal Analysis, Springer 2017). The mode is found by Fisher scoring (`windsysid.scoring`), and the
covariance is F⁻¹ there.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.scoring import SearchLimits, find_mode
from windsysid.spectral.modal_bands.model import (
    SLOPE_STD,
    Modes,
    Scores,
    advance,
    coordinates,
    scores,
    with_real_elements,
)
from windsysid.spectral.transforms.dft import Band

__all__ = [
    "COARSE_TOLERANCE", "HALF_TOLERANCE", "ModalFit", "evidence", "prior_slopes", "score", "score_together", "slopes",
]  # fmt: skip

FINE_TOLERANCE, HALF_TOLERANCE, COARSE_TOLERANCE = 1e-3, 0.02, 0.1
"""Numerical: Newton decrement of the last step: 0.03 standard deviations of a result, 0.14 of halves that are compared
with it, 0.3 if only the evidence of model orders is compared."""

SEARCH = SearchLimits(FINE_TOLERANCE, max_steps=40, stalled=0.2, damping=1e-2, refused_damping=1e-3)
"""Numerical: limits of a search. If J cannot decrease any more, a decrease of 0.1 may be left. Starts are rough, so
damping is strong; the nearest of many optima is required, so a refused step is turned in small steps."""

MAX_STEPS_TO_TARGET = 40.0
"""Numerical: steps as large as the last one between a search and its target, beyond which it terminates."""

DAMPING_PRIOR = (np.log(0.015), 1.5)
"""Setting: mean and standard deviation of ln ζ: 0.075 … 30 % are within two of it."""

SLOPE_STDS = (3.0, SLOPE_STD)
"""Setting: prior standard deviations of the slopes a of loads and b of the background, both with mean 0: loads from
f⁻⁶ to f⁶ are within two of it."""

COHERENCE_STD = 1.0
"""Setting: prior standard deviation of the elements of C."""

DRIFT_STD = 4.0
"""Setting: prior standard deviation of real and imaginary parts of a column of Ψ over the norm of the shape at the
start."""

MAX_STEPS_OF_UNKNOWNS = (0.02, 1.1, 10.0)
"""Numerical: largest step of ln f, ln ζ and b."""


class ModalFit(NamedTuple):
    """Result of scoring: modes, the covariance (p, p) of a step, −2 ln of the likelihood, and convergence."""

    modes: Modes
    cov: Array
    deviance: float
    converged: bool

    def std(self, j: int) -> tuple[float, float]:
        """Standard deviations of ln f and ln ζ of mode j."""
        r = len(self.modes.frequency)
        return float(np.sqrt(self.cov[j, j])), float(np.sqrt(self.cov[r + j, r + j]))


def score(
    start: Modes,
    band: Band,
    *,
    max_steps: int = SEARCH.max_steps,
    tolerance: float = FINE_TOLERANCE,
    target: float = np.inf,
) -> ModalFit:
    """The mode of the posterior from a start.

    A search whose −2 ln likelihood is so far above `target` that steps like the last would not bring it there is given
    up.
    """
    return score_together([start], [band], max_steps=max_steps, tolerance=tolerance, target=target)[0]


def score_together(
    starts: Sequence[Modes],
    bands: Sequence[Band],
    *,
    max_steps: int = SEARCH.max_steps,
    tolerance: float = FINE_TOLERANCE,
    target: float = np.inf,
) -> list[ModalFit]:
    """The mode of the posterior of several records' modes, which have their frequencies and damping ratios in common.

    Likelihoods add. Shapes, loads and what else is in the band are each record's own, and its part of the joint
    covariance is in its fit. The records' unknowns are eliminated one record after the other (Schur's complement), so
    that the cost grows with their number only.
    """
    shared = starts[0].frequency, starts[0].damping
    modes = [with_real_elements(start._replace(frequency=shared[0], damping=shared[1])) for start in starts]
    priors = [_Prior(one, 1.0 / len(modes)) for one in modes]
    ends = np.cumsum([one.size for one in modes])[:-1]

    def evaluate(modes: Sequence[Modes]) -> _JointEvaluation:
        found = [_posterior(*each) for each in zip(modes, bands, priors, strict=True)]
        return _JointEvaluation(tuple(scores for scores, _ in found), sum(cost for _, cost in found), len(shared[0]))

    def move(modes: list[Modes], step: Array) -> list[Modes]:
        return [advance(one, part) for one, part in zip(modes, np.split(step, ends), strict=True)]

    def is_hopeless(there: _JointEvaluation, decrease: float) -> bool:
        return 2.0 * there.parts[0].cost / bands[0].factor - target > MAX_STEPS_TO_TARGET * decrease

    found = find_mode(
        evaluate, modes, SEARCH._replace(tolerance=tolerance, max_steps=max_steps),
        max_step=np.concatenate([_max_step(one) for one in modes]), move=move,
        give_up=is_hopeless if np.isfinite(target) else None,
    )  # fmt: skip
    here = found.evaluation.parts
    covs = _covariances(here, len(shared[0]))
    return [
        ModalFit(one, cov, 2.0 * part.cost / band.factor, found.converged)
        for one, cov, part, band in zip(found.point, covs, here, bands, strict=True)
    ]


def _max_step(modes: Modes) -> Array:
    """Largest step of the unknowns of a record (p,)."""
    most, r = np.full(modes.size, np.inf), len(modes.frequency)
    most[:r], most[r : 2 * r], most[modes.size - modes.drifting - 1] = MAX_STEPS_OF_UNKNOWNS
    return most


class _JointEvaluation(NamedTuple):
    """−log posterior of several records, of whose unknowns the first 2 r are the same.

    Attributes
    ----------
    parts
        Of each record.
    value
        J of all.
    modes
        r.
    """

    parts: tuple[Scores, ...]
    value: float
    modes: int

    def step(self, damping: float) -> Array:
        """The damped step of each record's unknowns, one record behind the other."""
        r, own = self.modes, []
        shared, vector = np.zeros((2 * r, 2 * r)), np.zeros(2 * r)
        for found in self.parts:
            damped = found.fisher + damping * np.diag(np.diagonal(found.fisher))
            across = damped[: 2 * r, 2 * r :]
            solved = np.linalg.solve(damped[2 * r :, 2 * r :], np.column_stack([across.T, found.gradient[2 * r :]]))
            shared += damped[: 2 * r, : 2 * r] - across @ solved[:, :-1]
            vector += found.gradient[: 2 * r] - across @ solved[:, -1]
            own.append(solved)
        common = -np.linalg.solve(shared, vector) if r else vector
        return np.concatenate([part for solved in own for part in (common, -solved[:, -1] - solved[:, :-1] @ common)])

    def decrement(self, step: Array) -> float:
        """Twice the decrease of J that a step promises."""
        steps = np.split(step, np.cumsum([len(part.gradient) for part in self.parts])[:-1])
        return -sum(
            float((2.0 * part.gradient + part.fisher @ own) @ own) for part, own in zip(self.parts, steps, strict=True)
        )


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


def evidence(fit: ModalFit, bins: int) -> float:
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


def prior_slopes(modes: Modes) -> tuple[Array, Array]:
    """Gradient of −log prior (p,), and the diagonal of its precision (p,)."""
    prior, gradient, precision = _Prior(modes, 1.0), np.zeros(modes.size), np.zeros(modes.size)
    gradient[prior.at] = prior.weight * (coordinates(modes) - prior.centre)
    precision[prior.at] = prior.weight
    return gradient, precision


def _drift_spread(modes: Modes) -> Array:
    """Spread of the unknowns of Ψ (2 m r,)."""
    if modes.drift is None:
        return np.empty(0)
    return np.tile(np.repeat(DRIFT_STD * np.linalg.norm(modes.shape, axis=0), len(modes.shape)), 2)


class _Prior:
    """Gaussian in the unknowns that `coordinates` gives; `share` of that of damping."""

    def __init__(self, modes: Modes, share: float) -> None:
        m, r = modes.shape.shape
        loads = r * (r - 1)
        some = int(r > 0)
        self.centre = np.concatenate([np.full(r, DAMPING_PRIOR[0]), np.zeros(loads + some + 1 + modes.drifting)])
        spread = [DAMPING_PRIOR[1]] * r + [COHERENCE_STD] * loads + [SLOPE_STDS[0]] * some + [SLOPE_STDS[1]]
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

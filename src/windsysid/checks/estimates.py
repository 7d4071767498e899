"""Conflict of estimates with their priors, and damping that is not positive.

Before the record was seen, estimate and centre of the prior were expected to differ by √(σ₀² − σ²) (the prior
predictive check of Box, J. R. Statist. Soc. A 143, 1980, https://doi.org/10.2307/2982063).

A file's prior may be wrong. That it is several times as wide is a rival explanation of the record: the posterior under
a contaminated prior is a mixture (Berger & Berliner, Ann. Statist. 14, 1986, https://doi.org/10.1214/aos/1176349933).
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import CONFLICT_SIGMAS, NEGLIGIBLE_SHARE, PRIOR_ODDS_OF_MISFIT
from windsysid.checks.widening import mixture_factor
from windsysid.results.finding import Finding
from windsysid.statespace.parameter import Parameter

__all__ = [
    "WIDENING_FACTOR", "Band", "CoefficientCheck", "conflict", "doubt_damping", "doubt_priors", "hold_against_priors",
    "rival_priors",
]  # fmt: skip

WIDENING_FACTOR = 4.0
"""Setting: how many times as wide a prior is if it is wrong."""

Band = tuple[float, float, float]
"""Value, and ±2σ around it: low, high."""


class CoefficientCheck(NamedTuple):
    """An estimate against its prior: share of the information from the data, and distance from the prior's centre in
    the standard deviations that were to be expected.
    """

    name: str
    informed_by_data: float
    shift: float


def hold_against_priors(parameters: Sequence[Parameter], theta: Array, cov: Array) -> tuple[CoefficientCheck, ...]:
    """Each estimate (n_θ,) and its variance, of a covariance (n_θ, n_θ), against its prior."""
    return tuple(_against_prior(q, float(t), float(v)) for q, t, v in zip(parameters, theta, np.diag(cov), strict=True))


def doubt_priors(checks: Sequence[CoefficientCheck]) -> list[Finding]:
    """A reason for each estimate that contradicts its prior."""
    return [conflict(check.name, check.shift) for check in checks if abs(check.shift) > CONFLICT_SIGMAS]


def conflict(name: str, shift: float) -> Finding:
    """Finding on an estimate that differs from its prior by so many standard deviations."""
    return Finding("prior_conflict", "reason", {"sigmas": shift}, (name,))


def rival_priors(parameters: Sequence[Parameter], theta: Array, cov: Array) -> list[Finding]:
    """A reason for each prior on which an interval depends: shifts and widths of all estimates (n_θ,), whose covariance
    are the first rows of `cov`, if that prior is `WIDENING_FACTOR` times as wide, and the probability of that, all in
    closed form."""
    found, names, n = list[Finding](), [q.name for q in parameters], len(parameters)
    std = np.sqrt(np.diag(cov)[:n])
    for i, q in enumerate(parameters):
        off, change, along = float(theta[i]) - q.prior[0], (WIDENING_FACTOR**-2 - 1.0) / q.prior[1] ** 2, cov[:n, i]
        left = max(1.0 + change * float(along[i]), WIDENING_FACTOR**-2)
        log_odds = math.log(PRIOR_ODDS_OF_MISFIT / WIDENING_FACTOR) - 0.5 * (math.log(left) + change * off**2 / left)
        chance = 1.0 / (1.0 + math.exp(-min(log_odds, 700.0)))
        shift, wide = -change * off / left * along, np.sqrt(std**2 - change / left * along**2) / std
        if mixture_factor([(shift[i] / std[i], wide[i], chance)]) > 1.0 + NEGLIGIBLE_SHARE:
            share, moved = _against_prior(q, off, std[i] ** 2).informed_by_data, shift[i] / std[i]
            data = {"share": share, "chance": chance, "sigmas": moved, "wider": wide[i]}
            explained = {"shifts": dict(zip(names, shift, strict=True)), "widths": dict(zip(names, wide, strict=True))}
            found.append(Finding("prior_decides", "reason", {**data, **explained}, (q.name,)))
    return found


def doubt_damping(
    parameters: Sequence[Parameter], theta: Array, cov: Array, modes: Sequence[tuple[str, Band]],
    units: Mapping[str, str],
) -> list[Finding]:  # fmt: skip
    """A reason and a remark for damping that is not positive, of coefficients in their `units` and of `modes`, each
    with its name and its damping ratio with the 95 % interval."""
    dampers, found = _dampers(parameters, theta, cov), list[Finding]()
    lost, lost_modes = _not_positive(dampers), _not_positive(modes)
    if lost or lost_modes:
        data = {"coefficients": [(*one, units.get(one[0], "")) for one in lost], "modes": lost_modes}
        found.append(Finding("damping_not_positive", "reason", data, tuple(name for name, *_ in lost)))
    uncertain = [name for name, (value, low, _) in (*dampers, *modes) if low <= 0.0 < value]
    if uncertain:
        own = tuple(name for name, _ in dampers if name in uncertain)
        found.append(Finding("damping_may_be_negative", "remark", {"names": uncertain}, own))
    return found


def _not_positive(damping: Sequence[tuple[str, Band]]) -> list[tuple[str, float, bool]]:
    """Name and value of negative damping, and whether its whole interval is negative."""
    return [(name, value, high < 0.0) for name, (value, _, high) in damping if value <= 0.0]


def _against_prior(q: Parameter, theta: float, variance: float) -> CoefficientCheck:
    mean, std = q.prior
    informed = float(np.clip(1.0 - variance / std**2, 0.0, 1.0))
    return CoefficientCheck(q.name, informed, (theta - mean) / (std * math.sqrt(informed)) if informed > 0.0 else 0.0)


def _dampers(parameters: Sequence[Parameter], theta: Array, cov: Array) -> list[tuple[str, Band]]:
    """Name and interval of each damping coefficient that may be negative: linear, and expected above zero."""
    found = []
    for q, t, v in zip(parameters, theta, np.diag(cov), strict=True):
        if q.kind == "damping" and not q.logarithmic and q.centre > 0.0:
            value, low, high = (float(q.physical(t + k * math.sqrt(v))) for k in (0.0, -2.0, 2.0))
            found.append((q.name, (value, low, high)))
    return found

"""What estimates say by themselves: against their priors, and damping that is not positive.

Before the record was seen, estimate and centre of the prior were expected to differ by √(σ₀² − σ²) (the prior
predictive check of Box, J. R. Statist. Soc. A 143, 1980, https://doi.org/10.2307/2982063).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.statespace.parameter import Parameter

__all__ = [
    "CONFLICT_SIGMAS",
    "Band",
    "CoefficientCheck",
    "conflict_text",
    "doubt_damping",
    "doubt_priors",
    "hold_against_priors",
]

Band = tuple[float, float, float]
"""Value, and ±2σ around it: low, high."""

CONFLICT_SIGMAS = 4.0
"""Standard deviations between estimate and prior beyond which one of the two is wrong: one in 16 000."""


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


def doubt_priors(checks: Sequence[CoefficientCheck]) -> list[str]:
    """A reason for each estimate that contradicts its prior."""
    return [conflict_text(check.name, check.shift) for check in checks if abs(check.shift) > CONFLICT_SIGMAS]


def conflict_text(name: str, shift: float) -> str:
    """What is said of an estimate so many standard deviations from its prior."""
    return (
        f"{name} and its prior contradict each other: they are {abs(shift):.1f} standard deviations apart; the turbine"
        " file, a unit or the model is wrong"
    )


def doubt_damping(
    parameters: Sequence[Parameter], theta: Array, cov: Array, modes: Sequence[tuple[str, Band]]
) -> tuple[list[str], list[str]]:
    """Reasons and remarks for damping that is not positive, of coefficients and of `modes`, each with its name and its
    damping ratio with the ±2σ band."""
    dampers = _dampers(parameters, theta, cov)
    reasons: list[str] = []
    remarks: list[str] = []
    lost = [f"{name} is {value:.2g}{_describe_certainty(high)}" for name, (value, _, high) in dampers if value <= 0.0]
    lost += [
        f"{name} has {100.0 * value:.2g} %{_describe_certainty(high)}"
        for name, (value, _, high) in modes
        if value <= 0.0
    ]
    if lost:
        reasons.append(
            f"damping is not positive: {', '.join(lost)}. If the motion grew, stop and check the turbine; if not, try"
            " a longer or calmer section or another load model"
        )
    doubtful = ", ".join(name for name, (value, low, _) in (*dampers, *modes) if low <= 0.0 < value)
    if doubtful:
        remarks.append(f"damping may be zero or negative within its band: {doubtful}; a longer record tells")
    return reasons, remarks


def _against_prior(q: Parameter, theta: float, variance: float) -> CoefficientCheck:
    mean, std = q.prior
    informed = float(np.clip(1.0 - variance / std**2, 0.0, 1.0))
    return CoefficientCheck(q.name, informed, (theta - mean) / (std * math.sqrt(informed)) if informed > 0.0 else 0.0)


def _dampers(parameters: Sequence[Parameter], theta: Array, cov: Array) -> list[tuple[str, Band]]:
    """Name and band of each damping coefficient that may be negative: linear, and expected above zero."""
    found = []
    for q, t, v in zip(parameters, theta, np.diag(cov), strict=True):
        if q.kind == "damping" and not q.logarithmic and q.centre > 0.0:
            value, low, high = (float(q.physical(t + k * math.sqrt(v))) for k in (0.0, -2.0, 2.0))
            found.append((q.name, (value, low, high)))
    return found


def _describe_certainty(high: float) -> str:
    return " (negative over its whole band)" if high < 0.0 else ""

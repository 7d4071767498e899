"""The mode of a posterior by Fisher's scoring: steps (F + prior)⁻¹ g, damped after Levenberg, the likelihood let in
little by little."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array

__all__ = ["SETTLED", "Mode", "covariance", "find_mode", "reach_mode"]

STEPS, ROUGH_STEPS = 60, 8
"""Most steps of the last stage, and of a stage before it."""

SETTLED = 1e-3
"""Squared length of a step in standard deviations below which the search ends; of the stages before the last
`ROUGH`."""

ROUGH = 0.1

TRUSTED = 0.5
"""Share of the gain which J's parabola promises from which on steps are damped less: two levels that do nearly the same
are curved more than Fisher's information says, and undamped steps leap to and fro."""

LONGEST = 1.0
"""Longest step of an unknown, where its prior is wider: a factor e of a level."""


NEAR = 0.5
"""Squared length of a step in standard deviations that is taken without another look: a parabola is true enough."""


LEAST_KNOWN = 1e-14
"""Least eigenvalue of scaled information, beside the greatest: what rounding leaves of less has no sign."""


class Mode(NamedTuple):
    """A mode of a posterior.

    Attributes
    ----------
    unknowns, information
        Where it is (n,), and Fisher's information there with that of the prior (n, n).
    value
        J with the prior's part.
    steps
        Steps that were taken.
    settled
        Whether the last step was short.
    """

    unknowns: Array
    information: Array
    value: float
    steps: int
    settled: bool


def covariance(information: Array) -> Array:
    """The inverse of information (n, n), positive also where rounding makes that of a direction negative: it is then
    wide."""
    size = np.sqrt(np.diag(information))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    narrow = vectors / np.sqrt(np.maximum(values, LEAST_KNOWN * values[-1]))
    return np.asarray(narrow @ narrow.T / np.outer(size, size))


def find_mode(
    evaluate: Callable[[Array, int], tuple[float, Array, Array]], start: Array, prior_mean: Array, prior_std: Array,
    stages: Sequence[tuple[float, int]], *, rough: bool = False, enough: float = SETTLED,
) -> Mode:  # fmt: skip
    """Minimise weight · J(u) + ½ Σ ((u − m)/s)² in stages of (weight, every n-th bin).

    Parameters
    ----------
    evaluate
        (u, every n-th bin) → J, g, F.
    start, prior_mean, prior_std
        (n,) each.
    rough
        Whether the last stage, too, ends with a step that is short only beside the bands, and after few steps at most.
    enough
        Squared length in standard deviations of the step that ends the last stage.
    """
    precision, longest = prior_std**-2.0, np.minimum(prior_std, LONGEST)
    u, total, settled = start.copy(), 0, False
    value, information = np.inf, np.diag(precision)
    for stage, (weight, every) in enumerate(stages):
        J, g, F = _posterior(evaluate(u, every), u, weight, prior_mean, precision)
        last = stage == len(stages) - 1 and not rough
        damping, short = 1e-3, enough if last else ROUGH
        for _ in range(STEPS if last else ROUGH_STEPS):
            step = np.clip(-np.linalg.solve(F + damping * np.diag(np.diag(F)), g), -longest, longest)
            length = float(step @ F @ step)
            try:
                tried = _posterior(evaluate(u + step, every), u + step, weight, prior_mean, precision)
                better = tried[0] < J + 1e-9 * abs(J)
            except np.linalg.LinAlgError:
                better = False
            total += 1
            if better:
                share = (J - tried[0]) / max(0.5 * length, 1e-300)  # of the gain that a parabola promises
                u, (J, g, F) = u + step, tried
                damping = max(0.1 * damping, 1e-9) if share > TRUSTED else max(3.0 * damping, 1e-2)
                settled = length < short
                if settled:
                    break
            else:
                damping = max(10.0 * damping, 1e-2)
                if damping > 1e8:
                    break
        value, information = J, F
    return Mode(u, information, value, total, settled)


def reach_mode(
    evaluate: Callable[[Array, int], tuple[float, Array, Array]], start: Array, prior_mean: Array, prior_std: Array
) -> Mode:
    """Minimise the same from a start that is near the mode, with as few looks at all bins as may be."""
    precision, longest = prior_std**-2.0, np.minimum(prior_std, LONGEST)
    u, (J, g, F) = start, _posterior(evaluate(start, 1), start, 1.0, prior_mean, precision)
    for total in range(1, ROUGH_STEPS + 1):
        step = np.clip(-np.linalg.solve(F, g), -longest, longest)
        length = float(step @ F @ step)
        if length < NEAR:
            return Mode(u + step, F, J - 0.5 * length, total, settled=True)
        try:
            tried = _posterior(evaluate(u + step, 1), u + step, 1.0, prior_mean, precision)
        except np.linalg.LinAlgError:
            break
        if tried[0] > J:
            break
        u, (J, g, F) = u + step, tried
    return find_mode(evaluate, u, prior_mean, prior_std, ((1.0, 1),), enough=ROUGH)


def _posterior(
    likelihood: tuple[float, Array, Array], u: Array, weight: float, mean: Array, precision: Array
) -> tuple[float, Array, Array]:
    J, g, F = likelihood
    if not (np.isfinite(J) and np.isfinite(F).all()):
        raise np.linalg.LinAlgError("the spectrum is not finite")
    off = u - mean
    return (
        weight * J + 0.5 * float(off @ (precision * off)),
        weight * g + precision * off,
        weight * F + np.diag(precision),
    )

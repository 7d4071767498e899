"""Widening of intervals by rival explanations, and the grade of a quantity."""

from collections.abc import Sequence

import numpy as np

from windsysid.checks.limits import MAX_WIDENING, NEGLIGIBLE_SHARE

__all__ = ["grade_of", "mixture_factor"]

SIGMAS = 2.0
"""Setting: half-width of every interval in standard deviations: ±2σ, 95.45 % of a normal distribution (the paper's
choice)."""


def grade_of(factor: float, *, excluded: bool) -> str:
    """Return the grade of a quantity from the factor on its interval; C if a reason excludes it that no interval
    covers.

    Examples
    --------
    >>> [grade_of(factor, excluded=False) for factor in (1.05, 2.0, 7.0)]
    ['A', 'B', 'C']
    """
    if excluded or factor > MAX_WIDENING:
        return "C"
    return "B" if factor > 1.0 + NEGLIGIBLE_SHARE else "A"


def mixture_factor(rivals: Sequence[tuple[float, float, float]]) -> float:
    """Factor on ±2σ that covers as much of a mixture of normal distributions as ±2σ of one, for rival explanations as
    a shift [σ], a standard deviation [σ] and a probability each.

    Examples
    --------
    >>> [round(mixture_factor([(shift, 1.0, chance)]), 2) for shift, chance in ((3.0, 0.25), (6.0, 1.0), (23.0, 0.002))]
    [1.95, 3.85, 1.01]
    """
    from scipy.special import ndtr

    if not rivals:
        return 1.0
    shifts, widths, chances = np.abs(np.array([(0.0, 1.0, 0.0), *rivals])).T
    chances[0] = max(1.0 - chances.sum(), 0.0)
    chances /= chances.sum()

    def beyond(half: float) -> float:
        tails = ndtr((shifts - half) / widths) + ndtr((-shifts - half) / widths)
        return float(chances @ tails) - 2.0 * float(ndtr(-SIGMAS))

    low, high = SIGMAS, float((SIGMAS + 10.0) * widths.max() + shifts.max())
    for _ in range(40 if beyond(low) > 0.0 else 0):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if beyond(middle) > 0.0 else (low, middle)
    return low / SIGMAS

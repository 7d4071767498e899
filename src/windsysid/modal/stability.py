"""Stability: unstable ranges of rotor speed, and distance from ground resonance.

Ground resonance threatens where the lag frequency of a blade that turns faster than it vibrates, seen from the ground,
meets the support's,

    Ω − ω_β(Ω) = ω_s,      ω_β² = (k_β + S d Ω²) / I.

Source: Coleman & Feingold, NACA Report 1351 (1958).
"""

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

from windsysid._types import Array
from windsysid.signals.textbook import minimum
from windsysid.turbine.turbine import Turbine
from windsysid.units import RPM

__all__ = ["NEUTRAL_GROWTH", "SPEED_RESOLUTION", "GroundResonance", "Unstable", "meeting_speed", "unstable_ranges"]

Triple = tuple[float, float, float]

NEUTRAL_GROWTH = 1e-6
"""Growth in units of the rotor speed [rad/s] that counts as none: an undamped mode neither grows nor decays."""

SPEED_RESOLUTION = 0.01 / RPM
"""0.01 rpm [rad/s]."""


class Unstable(NamedTuple):
    """A range of rotor speeds in which a mode grows: limits [rad/s], largest growth [1/s] and its speed [rad/s]."""

    low: float
    high: float
    growth: float
    worst: float


class GroundResonance(NamedTuple):
    """Speed at which lag and support frequencies coincide.

    Attributes
    ----------
    support
        ``x`` or ``y``.
    speed
        Ω of the meeting with its interval [rad/s].
    margin
        Its distance from the operating range, relative to the nearer end; zero within.
    damping, growing
        Least damping ratio of all modes at that speed with its interval, and whether any grows there.
    """

    support: str
    speed: Triple
    margin: Triple
    damping: Triple
    growing: bool


def unstable_ranges(
    growth: Callable[[float], float], speeds: Array, resolution: float = SPEED_RESOLUTION
) -> list[Unstable]:
    """Ranges of rotor speed in which `growth` [1/s] is positive, their ends to `resolution` [rad/s].

    Parameters
    ----------
    growth
        Of the fastest growing mode at a speed [rad/s]; may raise ConfigurationError where it is not known.
    speeds
        (S,), rising: where to look first. Where growth peaks below zero between them, the peak is looked for too.
    """

    def over(speed: float) -> float:
        return growth(speed) - NEUTRAL_GROWTH * max(speed, 1.0)

    def peak(low: float, high: float) -> tuple[float, float]:
        best = minimum(lambda s: -over(s), low, high, resolution)
        return best, over(best)

    at = [float(s) for s in speeds]
    value = [over(s) for s in at]
    inner = range(1, len(at) - 1)
    extra = [peak(at[i - 1], at[i + 1]) for i in inner if _may_rise_above_zero(*value[i - 1 : i + 2])]
    at, value = (list(v) for v in zip(*sorted([*zip(at, value, strict=True), *extra]), strict=True))
    ranges = []
    for grows, group in itertools.groupby(range(len(at)), key=lambda i: value[i] > 0.0):
        if not grows:
            continue
        numbers = list(group)
        first, last = numbers[0], numbers[-1]
        low = at[first] if first == 0 else _edge(over, at[first - 1], at[first], resolution)
        high = at[last] if last + 1 == len(at) else _edge(over, at[last + 1], at[last], resolution)
        top = max(range(first, last + 1), key=lambda k: value[k])
        worst, largest = peak(max(low, at[max(top - 1, 0)]), min(high, at[min(top + 1, len(at) - 1)]))
        worst = at[top] if value[top] > largest else worst
        ranges.append(Unstable(low, high, growth(worst), worst))
    return ranges


def _may_rise_above_zero(before: float, here: float, after: float) -> bool:
    """Test whether growth below zero peaks at a speed, and by how much it would have to rise to zero."""
    rise = max(here - before, here - after)
    return here < 0.0 and here >= max(before, after) and here + rise > 0.0


def _edge(over: Callable[[float], float], stable: float, unstable: float, resolution: float) -> float:
    """Speed at which `over` changes its sign, by bisection."""
    while abs(unstable - stable) > resolution:
        middle = 0.5 * (stable + unstable)
        stable, unstable = (stable, middle) if over(middle) > 0.0 else (middle, unstable)
    return 0.5 * (stable + unstable)


def meeting_speed(turbine: Turbine, axis: str) -> float | None:
    """Ω > ω_s of Ω − ω_β(Ω) = ω_s [rad/s], of the mean blade; None where centrifugal stiffening keeps them apart."""
    blades = turbine.rotor.blade_numbers
    stiffness, moment, inertia = (
        sum(turbine.values[f"{name}_{i}"] for i in blades) / len(blades)
        for name in ("k_beta", "blade_first_moment", "blade_inertia")
    )
    support = turbine.natural_frequency(axis)
    stiffening = 1.0 - moment * turbine.values["hinge_offset"] / inertia
    if stiffening <= 0.0:
        return None
    return (support + math.sqrt(max(support**2 - stiffening * (support**2 - stiffness / inertia), 0.0))) / stiffening

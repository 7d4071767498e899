"""Checks by smoothed loads (`windsysid.identification.verdict.smoothed_loads`).

Where loads push a support in two directions at once, its readings share what a model of independent loads has to
explain by sensors off their axes; that moves damping.
"""

from typing import NamedTuple

from windsysid.checks.nonlinearity import Bending
from windsysid.results.finding import Finding

__all__ = ["CorrelatedLoads", "SmoothedLoads", "doubt_correlated"]


class CorrelatedLoads(NamedTuple):
    """Two loads that go together.

    Attributes
    ----------
    loads
        Their names.
    sigmas, bound
        By how many standard deviations of chance, and how many count.
    """

    loads: tuple[str, str]
    sigmas: float
    bound: float


class SmoothedLoads(NamedTuple):
    """Statistics of the smoothed loads.

    Attributes
    ----------
    bending
        What shows most that stiffness or damping goes with amplitude.
    correlated
        The two loads that go together most; None where there are no two, too few sensors, or blades.
    """

    bending: Bending
    correlated: CorrelatedLoads | None


def doubt_correlated(found: CorrelatedLoads | None) -> list[Finding]:
    """A reason where two loads are correlated."""
    if found is None or abs(found.sigmas) <= found.bound:
        return []
    return [Finding("correlated_loads", "reason", found._asdict())]

"""Tolerances of instruments and masses: each an unknown in addition to the coefficients."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from windsysid.checks.limits import MAX_DISAGREEMENT_SIGMAS, MAX_INFORMED_STD_RATIO
from windsysid.checks.widening import SIGMAS
from windsysid.loads.statistics import Statistic
from windsysid.results.sentences.estimates import TOLERANCE_UNITS
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.unknowns import Unknowns

__all__ = ["SHARED", "Group", "Tolerance", "unknowns_of"]

Group = Literal["gain", "alignment", "clock", "masses", "aerodynamics"]

SHARED: tuple[Group, ...] = ("masses", "aerodynamics")
"""Setting: tolerances of which a record says nothing: intervals given these are widened, as results are compared so."""


@dataclass(frozen=True)
class Tolerance:
    """One thing that is as its file says within a tolerance.

    Attributes
    ----------
    group, of
        ``gain`` or ``alignment`` of a channel, ``clock`` of a logger, ``masses`` of a body or of all, ``aerodynamics``
        of a stiffness.
    spread
        Prior standard deviation: a share (gain, masses, aerodynamics), [rad] (alignment) or [s] (clock).
    estimate, std
        What the record says, in the same unit: how much larger the gain or the mass is, how far the axis is turned, how
        late the logger is. NaN until it has been learned.
    """

    group: Group
    of: str
    spread: float
    estimate: float = math.nan
    std: float = math.nan

    @property
    def name(self) -> str:
        """``gain of tower_x_acceleration``."""
        return f"{self.group} of {self.of}"

    @property
    def informed(self) -> bool:
        """True if the record has more information on it than its tolerance."""
        return self.std < MAX_INFORMED_STD_RATIO * self.spread

    @property
    def off(self) -> bool:
        """True if the interval of an informed one excludes its file's value."""
        return self.informed and abs(self.estimate) > SIGMAS * self.std

    @property
    def contradicted(self) -> bool:
        """True if the record shows that it is off by more than its tolerance allows."""
        return abs(self.estimate) > MAX_DISAGREEMENT_SIGMAS * self.spread

    def cells(self) -> tuple[str, str, str]:
        """Name, tolerance and estimate, as text for a table."""
        factor, unit = TOLERANCE_UNITS[self.group]
        spread, value, std = (factor * number for number in (self.spread, self.estimate, self.std))
        return self.name, f"± {spread:.3g} {unit}", f"{round(value, 2) + 0.0:+.2f} ± {std:.2f} {unit}"


def unknowns_of(
    parameters: Sequence[Parameter], statistics: Sequence[Statistic], tolerances: Sequence[Tolerance]
) -> Unknowns:
    """Names of the unknowns of a problem; its clocks are the last of the tolerances."""
    return Unknowns(
        parameters=tuple(q.name for q in parameters),
        statistics=tuple(s.name for s in statistics),
        tolerances=tuple(one.name for one in tolerances if one.group != "clock"),
        clocks=tuple(one.name for one in tolerances if one.group == "clock"),
    )

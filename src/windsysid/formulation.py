"""What the two formulations share: priors, measured loads, and what they hand back."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.filters import Info
from windsysid.record import Record
from windsysid.statespace import GaussMarkov, Parameter, StateSpace
from windsysid.turbine import Turbine

__all__ = ["Outcome", "Prior", "check_finite", "identifiable", "known_loads"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Prior:
    """How the priors differ from the turbine file's references.

    Attributes
    ----------
    stiffness, damping
        Factors on the references: where the priors are centred. A prior that is moved by a factor is widened to
        reach back.
    spread
        Relative standard deviation of stiffness and damping; the turbine file's by default.
    """

    stiffness: float = 1.0
    damping: float = 1.0
    spread: float | None = None

    def __post_init__(self) -> None:
        for name, factor in (("stiffness", self.stiffness), ("damping", self.damping)):
            if not (math.isfinite(factor) and 0.05 <= factor <= 20.0):
                raise ConfigurationError(
                    f"prior scale of {name}: expected a factor between 0.05 and 20, got {factor:g}; "
                    "for a structure further off, write another turbine file"
                )

    def parameters(self, turbine: Turbine, names: Sequence[str], *, linear: bool) -> tuple[Parameter, ...]:
        """The parameters to identify; `linear` keeps stiffness unscaled, as the force balance needs it."""
        chosen = []
        for name in names:
            reference = turbine.values[name]
            coordinate = name.split("_", 1)[1]
            if name.startswith("c_"):
                centre = reference * self.damping
                spread = (self.spread or turbine.spread[1]) * abs(centre)
                critical = 2.0 * turbine.inertia(coordinate) * turbine.natural_frequency(coordinate)
                chosen.append(Parameter(name, centre, max(spread, abs(centre - reference)), False, critical))
            elif linear:
                centre = reference * self.stiffness
                spread = (self.spread or turbine.spread[0]) * centre
                chosen.append(Parameter(name, centre, max(spread, abs(centre - reference)), False, centre))
            else:
                spread = self.spread or turbine.spread[0]
                chosen.append(Parameter(name, reference * self.stiffness, max(spread, abs(math.log(self.stiffness)))))
        return tuple(chosen)


class Outcome(NamedTuple):
    """What a formulation found, in filter coordinates.

    Attributes
    ----------
    turbine
        The turbine with the degrees of freedom that were really used.
    model
        The state-space model that was filtered.
    online
        What a filter running on line knew after each sample.
    final
        The last pass over the record, whose innovations judge the result; the same as `online` where there is one pass.
    theta, cov
        The identified parameters (n_θ,) and their covariance (n_θ, n_θ).
    rotor
        ψ, Ω, dΩ/dt (T, 3).
    channels
        Channels of the record that were used as measurements.
    elapsed
        Seconds in the filter.
    notes
        What a reader must know.
    """

    turbine: Turbine
    model: StateSpace
    online: Info
    final: Info
    theta: Array
    cov: Array
    rotor: Array
    channels: tuple[str, ...]
    elapsed: float
    notes: tuple[str, ...]


def identifiable(turbine: Turbine) -> list[str]:
    """The coefficients of the free degrees of freedom that have a reference to start from."""
    return [name for name in turbine.model.coefficients if turbine.values[name] != 0.0]


def known_loads(record: Record, turbine: Turbine) -> tuple[Array, list[GaussMarkov]]:
    """Measured loads (T, n), zero where there is no channel, and the loads that are therefore states."""
    known = np.zeros((record.samples, len(turbine.model.loads)))
    for column, name in enumerate(turbine.model.loads):
        if name in record:
            known[:, column] = np.nan_to_num(record[name])
    return known, [load for load in turbine.loads if load.load not in record]


def check_finite(mean: Array, cov: Array) -> None:
    """Raise where a filter has diverged."""
    if not (np.isfinite(mean).all() and np.isfinite(cov).all()):
        raise WindsysidError(
            "the filter diverged: expected loads, noise and priors of the size of the record's; "
            "check units and the turbine file, or move the priors with --prior-scale"
        )

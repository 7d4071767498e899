"""What the two formulations share: priors, measured loads, and what they hand back."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.filters import Info
from windsysid.loads import GaussMarkov
from windsysid.mechanics.sensors import Sensor
from windsysid.mechanics.tower import TowerModel
from windsysid.record import LOW_PASS, Record
from windsysid.signals import resample, rotor_inputs, tower_inputs
from windsysid.statespace import Parameter, StateSpace
from windsysid.statistics import Statistic
from windsysid.turbine import Turbine

__all__ = ["TURNING", "Loads", "Outcome", "Prior", "check_finite", "identifiable", "known_inputs", "known_loads"]

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
        if self.spread is not None and not (math.isfinite(self.spread) and self.spread > 0.0):
            raise ConfigurationError(f"prior spread: expected a positive number, such as 0.3, got {self.spread:g}")

    def parameters(self, turbine: Turbine, names: Sequence[str], *, linear: bool) -> tuple[Parameter, ...]:
        """The parameters to identify; `linear` keeps stiffness unscaled, as the force balance needs it.

        Masses, moments and geometry are centred on their references, however far the coefficients' priors are moved.
        """
        chosen = []
        for name in names:
            reference = turbine.values[name]
            if name.startswith("c_"):
                centre = reference * self.damping
                spread = max((self.spread or turbine.spread[1]) * abs(centre), abs(centre - reference))
                coordinate = name.removeprefix("c_")
                critical = 2.0 * turbine.inertia(coordinate) * turbine.natural_frequency(coordinate)
                chosen.append(Parameter(name, centre, spread, False, critical))
                continue
            centre = reference * (self.stiffness if name.startswith("k_") else 1.0)
            relative = self.spread or turbine.spread[0]
            if linear or not name.startswith(_POSITIVE):
                spread = max(relative * abs(centre), abs(centre - reference))
                chosen.append(Parameter(name, centre, spread, False, abs(centre)))
            else:
                chosen.append(Parameter(name, centre, max(relative, abs(math.log(centre / reference)))))
        return tuple(chosen)


_POSITIVE = ("k_", "mass_", "hub_mass", "roll_inertia", "blade_mass", "blade_first_moment", "blade_inertia")
"""What the names of log-scaled parameters begin with: stiffness, masses and their moments."""


class Loads(NamedTuple):
    """The loads that were states: names, mean and standard deviation after each sample (T, n) [N, N·m]."""

    names: tuple[str, ...]
    mean: Array
    std: Array


class Outcome(NamedTuple):
    """What a formulation found, in filter coordinates.

    Attributes
    ----------
    turbine
        The turbine with the degrees of freedom that were really used.
    model
        The state-space model that was filtered.
    history_mean, history_std
        What was known of θ on line, after each sample (T, n_θ).
    final
        The last pass over the record, whose innovations judge the result.
    theta, cov
        The identified parameters (n_θ,) and their covariance (n_θ, n_θ).
    rotor
        The known inputs (T, n_u): ψ, Ω and more.
    channels
        Channels of the record that were used as measurements.
    elapsed
        Seconds in the filter.
    notes
        What a reader must know.
    statistics
        Statistics of loads and noise that were learned with the parameters.
    doubts
        Why the formulation itself would not trust its result, in sentences.
    loads
        The loads that were states, as the filter knew them at the result; None where none were.
    joint_cov
        Covariance of θ and of the coordinates η of `statistics` together (n_θ + n_η, n_θ + n_η); None where no statistics were learned.
    """

    turbine: Turbine
    model: StateSpace
    history_mean: Array
    history_std: Array
    final: Info
    theta: Array
    cov: Array
    rotor: Array
    channels: tuple[str, ...]
    elapsed: float
    notes: tuple[str, ...]
    statistics: tuple[Statistic, ...] = ()
    doubts: tuple[str, ...] = ()
    loads: Loads | None = None
    joint_cov: Array | None = None


def identifiable(turbine: Turbine, chosen: Sequence[str] | None = None) -> list[str]:
    """The parameters to identify: those chosen, or the coefficients of the free degrees of freedom.

    Raises
    ------
    ConfigurationError
        If none is chosen, or a chosen parameter is not one of the turbine's, belongs to a locked degree of freedom, or has no reference to
        start from.
    """
    if chosen is None:
        known = [name for name in turbine.model.coefficients if turbine.values[name] != 0.0]
        if not known:
            raise ConfigurationError(f"turbine '{turbine.name}': expected stiffness or damping to identify, got zeros")
        return known
    if not chosen:
        raise ConfigurationError("parameters: expected at least one name; leave them out for all coefficients")
    for name in chosen:
        locked = name.startswith(("k_", "c_")) and name not in turbine.model.coefficients
        if turbine.values.get(name, 0.0) == 0.0 or locked:
            usable = [
                known
                for known, value in turbine.values.items()
                if value != 0.0 and (known in turbine.model.coefficients or not known.startswith(("k_", "c_")))
            ]
            raise ConfigurationError(
                f"parameter '{name}' cannot be identified here: expected some of {', '.join(usable)}"
            )
    return list(dict.fromkeys(chosen))


TURNING = ("rotor_azimuth", "rotor_speed", "nacelle_yaw")
"""Channels that say how rotor and nacelle turned."""


def known_inputs(record: Record, turbine: Turbine, sensors: Sequence[Sensor]) -> Array:
    """The inputs that the turbine's model asks for (T, n_u), ψ and Ω first; between samples of a uniform grid where times are unequal."""
    if not record.is_uniform:
        even = resample(record.select([c for c in record.channels if c in TURNING]), record.rate)
        inputs = known_inputs(even, turbine, sensors)
        return np.column_stack([np.interp(record.time, even.time, column) for column in inputs.T])
    if isinstance(turbine.model, TowerModel):
        needs_yaw = any(sensor.frame == "tower" for sensor in sensors)
        return tower_inputs(record, turbine.rotor_speed, needs_yaw=needs_yaw)
    return rotor_inputs(record, turbine.rotor_speed)


def known_loads(record: Record, turbine: Turbine) -> tuple[Array, list[GaussMarkov]]:
    """Measured loads (T, n), zero where there is no channel, and the loads that are therefore states, as far as the record's low-pass lets them through."""
    known = np.zeros((record.samples, len(turbine.model.loads)))
    for column, name in enumerate(turbine.model.loads):
        if name in record:
            known[:, column] = np.nan_to_num(record[name])
    low_pass = float(record.attributes.get(LOW_PASS, math.inf))
    return known, [replace(load, low_pass=low_pass) for load in turbine.loads if load.load not in record]


def check_finite(mean: Array, cov: Array) -> None:
    """Raise where a filter has diverged."""
    if not (np.isfinite(mean).all() and np.isfinite(cov).all()):
        raise WindsysidError(
            "the filter diverged: expected loads, noise and priors of the size of the record's; "
            "check units and the turbine file, or move the priors with --prior-scale"
        )

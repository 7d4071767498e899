"""A turbine as numbers: masses, dimensions, reference coefficients, usual instruments."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple, get_args

from windsysid.errors import ConfigurationError
from windsysid.mechanics.model import MechanicalModel
from windsysid.mechanics.rotor import RotorModel
from windsysid.mechanics.sensors import Sensor
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.units import RPM

__all__ = ["MASS_TOLERANCE", "OPERATING", "OperatingState", "Site", "Turbine"]

Site = Literal["onshore", "offshore"]
"""Site of a turbine, on which the prior odds of wave loads depend."""

MASS_TOLERANCE = 0.02
"""Relative standard deviation of a mass that careful people know."""

PARKED_PERIODS = 3
"""Of the slowest mode: the least that a record of a parked machine must hold."""


OPERATING = "operating"
"""State to which the values of a turbine file belong."""


class OperatingState(NamedTuple):
    """Parameters [SI] that differ in a state without production, and the relative prior standard deviation of damping
    there."""

    values: Mapping[str, float]
    damping_spread: float


@dataclass(frozen=True)
class Turbine:
    """Turbine in SI units: mechanical model, reference values, loads and sensors.

    Attributes
    ----------
    name, description, source
        Text; `source` says where the numbers come from.
    assumed
        Names of the values that are assumed because none is published.
    model
        Mechanical model with its free degrees of freedom.
    values
        Every parameter of the model: masses [kg], first moments [kg·m], inertias [kg·m²], stiffness, damping, geometry.
    rotor_speed
        Usual rotor speed [rad/s]; 0: parked.
    spread
        Relative prior standard deviation of stiffness and of damping.
    loads
        Random loads, for simulation and for the joint formulation.
    sensors
        The instruments usually fitted.
    tip_lever
        ℓ [m]: lag angles times ℓ are in-plane tip deflections; 0 where the tip coordinate is not used.
    mass_tolerance
        Relative standard deviation of the mass, with all moments, of each body (`MechanicalModel.bodies`); 0: exactly
        known.
    aerodynamic_tolerance
        Relative standard deviation of a tower's fore-aft stiffness by its operating rotor (`TowerModel`).
    site
        ``onshore`` or ``offshore``.
    odds
        Prior odds [1] of effects by their codes, in place of those of `windsysid.identification.model.prior_odds`.
    states
        By name, the differences from operation: ``parked``, where its file has it.

    See Also
    --------
    load_turbine : A packaged turbine, or one from a TOML file.
    write_turbine : Write a turbine as TOML.

    Examples
    --------
    >>> import windsysid as ws
    >>> tower = ws.load_turbine("tower")
    >>> softer = tower.with_values({"k_side_side": 0.97 * tower.values["k_side_side"]})
    >>> round(softer.values["k_side_side"] / 1e6, 3)  # [MN/m]
    1.721
    """

    name: str
    description: str
    source: str
    assumed: tuple[str, ...]
    model: MechanicalModel
    values: Mapping[str, float]
    rotor_speed: float
    spread: tuple[float, float]
    loads: tuple[GaussMarkov, ...]
    sensors: tuple[Sensor, ...]
    tip_lever: float = 0.0
    mass_tolerance: float = MASS_TOLERANCE
    aerodynamic_tolerance: float = 0.0
    site: Site = "onshore"
    odds: Mapping[str, float] = field(default_factory=dict)
    states: Mapping[str, OperatingState] = field(default_factory=dict)

    def __repr__(self) -> str:
        free = ", ".join(self.model.coordinates)
        return f"<Turbine {self.name}: {free} free, {self.rotor_speed * RPM:.4g} rpm, {len(self.sensors)} sensors>"

    @property
    def coefficients(self) -> dict[str, float]:
        """Reference value of every coefficient of the free degrees of freedom, SI."""
        return {name: self.values[name] for name in self.model.coefficients}

    @property
    def rotor(self) -> RotorModel:
        """The model, where it has a rotor with blades of its own.

        Raises
        ------
        ConfigurationError
            If it has none: a `TowerModel`, for instance.
        """
        if (rotor := self.model.rotor) is not None:
            return rotor
        raise ConfigurationError(
            f"turbine '{self.name}' is of the kind '{self.model.kind}': expected a rotor with blades of its own; "
            "choose another turbine, or the joint formulation"
        )

    def inertia(self, coordinate: str) -> float:
        """Mass [kg] or inertia [kg·m²] that moves with `coordinate` when the others are held."""
        return self.model.inertia(coordinate, self.values)

    def natural_frequency(self, coordinate: str) -> float:
        """ω [rad/s] of `coordinate` on its own spring (and, for a blade, its centrifugal stiffening)."""
        return self.model.natural_frequency(coordinate, self.values, self.rotor_speed)

    def damping(self, coordinate: str) -> float:
        """Damping of `coordinate` [N·s/m or N·m·s/rad]: the sum of its coefficients."""
        return sum((self.values[name] for name in self.model.coefficients_of(coordinate, "damping")), 0.0)

    def critical_damping(self, coordinate: str) -> float:
        """Critical damping of `coordinate` [N·s/m or N·m·s/rad]: 2 m ω."""
        return 2.0 * self.inertia(coordinate) * self.natural_frequency(coordinate)

    @property
    def slowest_frequency(self) -> float:
        """Lowest natural frequency ω [rad/s] of any degree of freedom on its own spring."""
        frequencies = (self.natural_frequency(name) for name in self.model.coordinates)
        return min((w for w in frequencies if w > 0.0), default=1.0)

    @property
    def slowest_decay(self) -> float:
        """The least ζω [1/s] of a degree of freedom by itself, of those that are damped; a thousandth of the slowest
        frequency where none is."""
        decays = (self.damping(name) / (2.0 * self.inertia(name)) for name in self.model.coordinates)
        return min((d for d in decays if d > 0.0), default=1e-3 * self.slowest_frequency)

    @property
    def least_duration(self) -> tuple[float, str]:
        """The shortest record [s] that is worth judging, and why: one revolution, or, parked, periods of the slowest
        mode."""
        if self.rotor_speed > 0.0:
            turn = 2.0 * math.pi / self.rotor_speed
            return turn, f"one revolution ({turn:.3g} s at {self.rotor_speed * RPM:.3g} rpm)"
        shortest = PARKED_PERIODS * 2.0 * math.pi / self.slowest_frequency
        return shortest, f"{PARKED_PERIODS} periods of the slowest mode ({shortest:.3g} s; the rotor is parked)"

    def with_values(self, values: Mapping[str, float]) -> "Turbine":
        """Turbine with other values, such as identified coefficients.

        Raises
        ------
        ConfigurationError
            If it has no parameter of a name.
        """
        unknown = set(values) - set(self.values)
        if unknown:
            raise ConfigurationError(f"turbine '{self.name}' has no parameter '{min(unknown)}'")
        return replace(self, values={**self.values, **values})

    def in_state(self, name: str) -> "Turbine":
        """Return the turbine in a state: itself in operation, else with the damping of that state, its prior, a rotor
        at rest and no blade-passing loads.

        Parameters
        ----------
        name
            ``operating``, or a state of the file.

        Raises
        ------
        ConfigurationError
            If its file does not have the state.

        Examples
        --------
        >>> import windsysid as ws
        >>> ws.load_turbine("tower").in_state("parked").spread
        (0.3, 0.8)
        """
        if name == OPERATING:
            return self
        if (state := self.states.get(name)) is None:
            raise ConfigurationError(
                f"turbine '{self.name}' has no state '{name}': expected {', '.join((OPERATING, *self.states))}; "
                "a tower file has it in [states.parked], any other file with a rotor speed of 0 rpm"
            )
        return replace(
            self, values={**self.values, **state.values}, spread=(self.spread[0], state.damping_spread), states={},
            rotor_speed=0.0, aerodynamic_tolerance=0.0, loads=tuple(load for load in self.loads if not load.harmonic),
        )  # fmt: skip

    def exact(self) -> "Turbine":
        """Turbine with its masses and its sensors known exactly: no tolerances."""
        sensors = tuple(sensor.exact() for sensor in self.sensors)
        return replace(self, mass_tolerance=0.0, aerodynamic_tolerance=0.0, sensors=sensors)

    def at(self, site: str | None) -> "Turbine":
        """Return the turbine at a site, or at that of its file for None.

        Raises
        ------
        ConfigurationError
            If the site is neither ``onshore`` nor ``offshore``.
        """
        site = self.site if site is None else site
        if site not in get_args(Site):
            raise ConfigurationError(f"site: expected {' or '.join(get_args(Site))}; got {site!r:.40}")
        return replace(self, site=site)  # type: ignore[arg-type]

    def with_model(self, model: MechanicalModel) -> "Turbine":
        """Turbine with the degrees of freedom of `model`."""
        return replace(self, model=model)

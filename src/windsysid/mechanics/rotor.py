"""An N-blade rotor on an elastic support, in the plane of the rotor (the paper's Eqs (1)–(20)).

Looking upwind: x is lateral, y is up, the rotor turns counter-clockwise by the azimuth ψ(t), which is an input. Blade i
hangs on a link at the radius d and the angle θ_i = φ_i + ψ + r, φ_i = 2π(i−1)/N, where r is the in-plane roll of the
support, r = κ x + ρ where x leans it and ρ is free; it leads by β_i. With m its mass, S its first and I its second
moment about the link, twice its kinetic energy is

    m |v_L|² + 2 S (θ̇ + β̇) v_L·t + I (θ̇ + β̇)²,     v_L = (ẋ, ẏ) + d θ̇ (−sin θ, cos θ),   t = (−sin(θ+β), cos(θ+β)).

For the paper's blade S = m L and I = I_c + m L² with L = d + h/2. The hub may have another effective mass in x than
in y.

Displacements are counted from static equilibrium (an accelerometer knows no mean), so that gravity acts through the
blades' azimuth only; `datum="unstressed"` keeps the weight on y as Eq (12) prints it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Literal

from windsysid.errors import ConfigurationError
from windsysid.mechanics.kinematics import INPUTS, Kinematics
from windsysid.mechanics.model import Coefficient, Coordinate, MechanicalModel, register_model

if TYPE_CHECKING:
    import sympy as sp

    from windsysid.mechanics.equations import Equations
    from windsysid.mechanics.multi_blade import MultiBlade
    from windsysid.mechanics.sensors import Sensor

__all__ = ["RotorModel"]


@register_model
@dataclass(frozen=True)
class RotorModel(MechanicalModel):
    """Mechanical model of a rotor with lagging blades on a flexible support.

    Parameters
    ----------
    blades
        Number of blades N.
    x, y
        Lateral and vertical motion of the hub: ``"free"`` or ``"locked"``.
    roll
        In-plane roll of the support: ``"locked"`` (the paper), ``"tied"`` to x (r = κ x), or ``"free"`` (r = κ x + ρ,
        with ρ on a spring and a damper of its own; κ may be 0).
    lag
        The blades' lag angles, all ``"free"`` or all ``"locked"``.
    datum
        Origin of y: ``"static"`` equilibrium or the ``"unstressed"`` support (Eq (12) as printed).
    air_couples
        Couple hub and blades by aerodynamic damping, with the coefficient ``c_hub_blade`` (`Kinematics.dissipation`).
    leads
        Measure β_i from the angle ``mean_lag_angle`` by which the mean torque of the wind bends all blades
        (`Kinematics.lag`).

    Examples
    --------
    >>> import windsysid as ws
    >>> model = ws.models.RotorModel(blades=3, y="locked")
    >>> [one.name for one in model.freedoms]
    ['x', 'beta_1', 'beta_2', 'beta_3']
    """

    kind: ClassVar[str] = "rotor"
    required_inputs: ClassVar[tuple[str, ...]] = ("rotor_azimuth",)

    blades: int = 3
    x: Literal["free", "locked"] = "free"
    y: Literal["free", "locked"] = "free"
    roll: Literal["free", "locked", "tied"] = "locked"
    lag: Literal["free", "locked"] = "free"
    datum: Literal["static", "unstressed"] = "static"
    air_couples: bool = False
    leads: bool = False

    def __post_init__(self) -> None:
        if self.blades < 1:
            raise ConfigurationError(f"number of blades: expected 1 or more, got {self.blades}")
        if self.roll == "tied" and self.x == "locked":
            raise ConfigurationError("roll is tied to x, but x is locked: free x, or lock roll")
        if not self.coordinates:
            raise ConfigurationError("every degree of freedom is locked: free at least one")

    @cached_property
    def freedoms(self) -> tuple[Coordinate, ...]:
        """The free degrees of freedom: of the hub and the support, then the blades' lag angles."""
        support = (Coordinate("x", "m", "support"), Coordinate("y", "m", "support"), Coordinate("roll", "rad", "roll"))
        lags = [Coordinate(f"beta_{i}", "rad", "blades", i) for i in self.blade_numbers] if self.lag == "free" else []
        return (*(freedom for freedom in support if getattr(self, freedom.name) == "free"), *lags)

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the free degrees of freedom, in the order of the state vector."""
        return tuple(freedom.name for freedom in self.freedoms)

    @cached_property
    def parameters(self) -> tuple[Coefficient, ...]:
        """Every parameter, in the order of the equations: the paper's ten coefficients for three blades, masses and
        geometry."""
        found = [
            Coefficient("hub_mass_x", "inertia", "kg", "x"),
            Coefficient("hub_mass_y", "inertia", "kg", "y"),
            *_spring("x", "N/m", "N*s/m"),
            *_spring("y", "N/m", "N*s/m"),
            Coefficient("roll_inertia", "inertia", "kg*m^2", "roll"),
            *_spring("roll", "N*m/rad", "N*m*s/rad"),
            Coefficient("kappa", "geometry", "rad/m", "support"),
            Coefficient("eccentricity", "geometry", "m", "hub"),
            Coefficient("eccentricity_angle", "geometry", "rad", "hub"),
            Coefficient("gravity", "geometry", "m/s^2", "site"),
            Coefficient("hinge_offset", "geometry", "m", "hub"),
        ]
        for i in self.blade_numbers:
            units = {"blade_mass": "kg", "blade_first_moment": "kg*m", "blade_inertia": "kg*m^2"}
            found += [Coefficient(f"{name}_{i}", "inertia", unit, f"blade_{i}") for name, unit in units.items()]
            found += _spring(f"beta_{i}", "N*m/rad", "N*m*s/rad")
        if self.air_couples:
            found.append(Coefficient(COUPLING, "damping", "N*s", "air"))
        if self.leads:
            found.append(Coefficient(MEAN_LAG, "geometry", "rad", "blades"))
        return tuple(found)

    @property
    def inputs(self) -> tuple[str, ...]:
        """ψ, Ω and dΩ/dt."""
        return INPUTS

    @property
    def stems(self) -> tuple[str, ...]:
        """Beginnings of the names of the channels that hold the motion of each degree of freedom: ``tower_x``,
        ``blade_1_lag``."""
        return tuple(f"blade_{f.blade}_lag" if f.blade else f"tower_{f.name}" for f in self.freedoms)

    @property
    def blade_numbers(self) -> range:
        """1 … N."""
        return range(1, self.blades + 1)

    def inertia(self, coordinate: str, values: Mapping[str, float]) -> float:
        """Mass [kg] or inertia [kg·m²] that moves with `coordinate` when the others are held, at `values`."""
        v = values
        if blade := self.blade_of(coordinate):
            return v[f"blade_inertia_{blade}"]
        total = 0.0
        for i in self.blade_numbers:
            m, d = v[f"blade_mass_{i}"], v["hinge_offset"]
            about_hub = v[f"blade_inertia_{i}"] + 2.0 * d * v[f"blade_first_moment_{i}"] + m * d**2
            total += about_hub if coordinate == "roll" else m
            if coordinate == "x":
                total += self.lean(v) ** 2 * about_hub
        own = {"x": v["hub_mass_x"], "y": v["hub_mass_y"], "roll": v["roll_inertia"]}[coordinate]
        leaning = self.lean(v) ** 2 * v["roll_inertia"] if coordinate == "x" else 0.0
        return total + own + leaning

    def stiffness(self, coordinate: str, values: Mapping[str, float], rotor_speed: float) -> float:
        """The spring of `coordinate` at `values`; for a blade its stiffening at `rotor_speed` [rad/s] too."""
        stiffness = values[f"k_{coordinate}"]
        if blade := self.blade_of(coordinate):
            stiffness += values[f"blade_first_moment_{blade}"] * values["hinge_offset"] * rotor_speed**2
        return stiffness

    def blade_of(self, coordinate: str) -> int:
        """Number of the blade whose lag angle `coordinate` is, free or locked; 0 for the support's."""
        return next((i for i in self.blade_numbers if coordinate == f"beta_{i}"), 0)

    def lock_unseen(self, sensors: "Sequence[Sensor]") -> "tuple[RotorModel, tuple[str, ...]]":
        """The rotor with blades locked where none of `sensors` sits on one, and x or y where none sees them move."""
        changes: dict[str, str] = {}
        if self.lag == "free" and not any(sensor.blade for sensor in sensors):
            changes["lag"] = "locked"
        seen = set().union(*(sensor.directions for sensor in sensors if not sensor.blade))
        for axis in ("x", "y"):
            coupled = self.lag == "free" and "lag" not in changes  # blades shake the hub, which shakes them back
            if getattr(self, axis) == "free" and axis not in seen and not coupled:
                changes[axis] = "locked"
        locked = tuple(changes)
        if changes.get("x") == "locked" and self.roll == "tied":
            changes["roll"] = "locked"
        return replace(self, **changes) if changes else self, locked  # type: ignore[arg-type]

    def bodies(self) -> Mapping[str, tuple[str, ...]]:
        """The hub with the moving parts of nacelle and tower, and each blade."""
        support = ("hub_mass_x", "hub_mass_y", "roll_inertia")
        blade = ("blade_mass", "blade_first_moment", "blade_inertia")
        return {"hub": support} | {f"blade_{i}": tuple(f"{name}_{i}" for name in blade) for i in self.blade_numbers}

    @property
    def rotor(self) -> "RotorModel":
        """Itself."""
        return self

    def modes(self) -> "MultiBlade":
        """Multi-blade coordinates."""
        from windsysid.mechanics.multi_blade import MultiBlade

        return MultiBlade(self)

    def lean(self, values: Mapping[str, float]) -> float:
        """κ [rad/m], by how much x leans the rotor at coefficients `values`: 0 where roll is locked."""
        return 0.0 if self.roll == "locked" else values["kappa"]

    @property
    def signature(self) -> str:
        """A text that is the same exactly when the equations are."""
        return f"RotorModel({sorted(asdict(self).items())})"

    @cached_property
    def kinematics(self) -> "Kinematics":
        """The symbols of this rotor and the motion of its points."""
        return Kinematics(self)

    def equations(self) -> "Equations":
        """Lagrange's equations of this rotor (paper Eqs (11), (12), (20))."""
        from windsysid.mechanics.equations import lagrange

        k = self.kinematics
        return lagrange(
            f"rotor{self.blades}",
            lagrangian=k.kinetic_energy() - k.potential_energy(),
            dissipation=k.dissipation(),
            coordinates=k.triples,
            loads=[k.symbol(name) for name in self.loads],
            inputs={k.psi: k.omega, k.omega: k.omega_dot, k.omega_dot: k.zero},
            parameters=k.parameters.values(),
        )

    def readings(self, sensors: "Sequence[Sensor]") -> "list[sp.Expr]":
        """Readings of each of `sensors`, in x, a, u, p and w."""
        from windsysid.mechanics.readings import SymbolicRotorMotion

        return [sensor.reading(SymbolicRotorMotion(self.kinematics)) for sensor in sensors]

    def readings_across(self, sensors: "Sequence[Sensor]") -> "list[sp.Expr | None]":
        """Readings with the axis of each of `sensors` rotated by 90°; None where that changes nothing."""
        from windsysid.mechanics.readings import SymbolicRotorMotion

        return [sensor.across(SymbolicRotorMotion(self.kinematics)) for sensor in sensors]


COUPLING = "c_hub_blade"
"""The coefficient of the air that damps hub and blades together."""

MEAN_LAG = "mean_lag_angle"
"""The angle by which the mean torque of the wind makes all blades lead."""

MEAN_LAG_STD = 0.01
"""Prior standard deviation of it [rad]."""


def _spring(coordinate: str, stiffness: str, damping: str) -> tuple[Coefficient, ...]:
    """Stiffness and damping of a degree of freedom, with their units."""
    return (
        Coefficient(f"k_{coordinate}", "stiffness", stiffness, coordinate),
        Coefficient(f"c_{coordinate}", "damping", damping, coordinate),
    )

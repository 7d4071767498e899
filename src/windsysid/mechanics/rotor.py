"""An N-blade rotor on an elastic support, in the plane of the rotor (the paper's Eqs (1)–(20)).

Looking upwind: x is lateral, y is up, the rotor turns counter-clockwise by the azimuth ψ(t), which is an input.
Blade i hangs on a link at the radius d and the angle θ_i = φ_i + ψ + r, φ_i = 2π(i−1)/N, where r is the in-plane
roll of the support, r = κ x + ρ where x leans it and ρ is free; it leads by β_i. With m its mass, S its first and I its second moment about the link,
twice its kinetic energy is

    m |v_L|² + 2 S (θ̇ + β̇) v_L·t + I (θ̇ + β̇)²,     v_L = (ẋ, ẏ) + d θ̇ (−sin θ, cos θ),   t = (−sin(θ+β), cos(θ+β)).

For the paper's blade S = m L and I = I_c + m L² with L = d + h/2. The hub may have another effective mass in x than
in y.

Displacements are counted from static equilibrium (an accelerometer knows no mean), so that gravity acts through the
blades' azimuth only; `datum="unstressed"` keeps the weight on y as Eq (12) prints it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

from windsysid.errors import ConfigurationError

if TYPE_CHECKING:
    import sympy as sp

    from windsysid.mechanics.equations import Equations
    from windsysid.mechanics.sensors import Sensor

from windsysid.mechanics.kinematics import Kinematics

__all__ = ["RotorModel"]


@dataclass(frozen=True)
class RotorModel:
    """Which degrees of freedom of the rotor on its support move, and how.

    Parameters
    ----------
    blades
        Number of blades N.
    x, y
        Lateral and vertical motion of the hub: ``"free"`` or ``"locked"``.
    roll
        In-plane roll of the support: ``"locked"`` (the paper), ``"tied"`` to x (r = κ x), or ``"free"`` (r = κ x + ρ, with ρ on a spring and a
        damper of its own; κ may be 0).
    lag
        The blades' lag angles, all ``"free"`` or all ``"locked"``.
    datum
        Where y is counted from: ``"static"`` equilibrium or the ``"unstressed"`` support (Eq (12) as printed).
    air_couples
        Whether the air that damps hub and blades also couples them, by the coefficient ``c_hub_blade`` (`Kinematics.dissipation`).
    """

    blades: int = 3
    x: Literal["free", "locked"] = "free"
    y: Literal["free", "locked"] = "free"
    roll: Literal["free", "locked", "tied"] = "locked"
    lag: Literal["free", "locked"] = "free"
    datum: Literal["static", "unstressed"] = "static"
    air_couples: bool = False

    def __post_init__(self) -> None:
        if self.blades < 1:
            raise ConfigurationError(f"number of blades: expected 1 or more, got {self.blades}")
        if self.roll == "tied" and self.x == "locked":
            raise ConfigurationError("roll is tied to x, but x is locked: free x, or lock roll")
        if not self.coordinates:
            raise ConfigurationError("every degree of freedom is locked: free at least one")

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the free degrees of freedom, in the order of the state vector."""
        support = [name for name in ("x", "y", "roll") if getattr(self, name) == "free"]
        lags = [f"beta_{i}" for i in self.blade_numbers] if self.lag == "free" else []
        return (*support, *lags)

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of the generalised loads: a force or moment on each free degree of freedom."""
        return tuple(f"load_{name}" for name in self.coordinates)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states: displacements, then velocities."""
        return (*self.coordinates, *(f"{name}_rate" for name in self.coordinates))

    @property
    def blade_numbers(self) -> range:
        """1 … N."""
        return range(1, self.blades + 1)

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The stiffness and damping coefficients of the free degrees of freedom: the paper's ten for three blades."""
        return tuple(f"{kind}_{name}" for name in self.coordinates for kind in ("k", "c"))

    def inertia(self, coordinate: str, values: Mapping[str, float]) -> float:
        """Mass [kg] or inertia [kg·m²] that moves with one degree of freedom when the others are held."""
        v = values
        if coordinate.startswith("beta_"):
            return v["blade_inertia_" + coordinate.removeprefix("beta_")]
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

    def lean(self, values: Mapping[str, float]) -> float:
        """κ [rad/m], by how much x leans the rotor: 0 where roll is locked."""
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
        """What each sensor reads, in x, a, u, p and w."""
        from windsysid.mechanics.readings import reading

        return [reading(sensor, self.kinematics) for sensor in sensors]

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

__all__ = ["INPUTS", "Kinematics", "RotorModel"]

INPUTS = ("rotor_azimuth", "rotor_speed", "rotor_acceleration")
"""Names of the inputs u of every rotor model: ψ [rad, unwrapped], Ω [rad/s], dΩ/dt [rad/s²]."""


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
        from windsysid.mechanics.sensors import reading

        return [reading(sensor, self.kinematics) for sensor in sensors]


class Kinematics:
    """Symbols, positions and energies of a `RotorModel`; SymPy is imported here and not before."""

    def __init__(self, model: RotorModel) -> None:
        import sympy as sp

        self.model = model
        self.sp = sp
        self.zero = sp.Integer(0)
        self.psi, self.omega, self.omega_dot = (sp.Symbol(name, real=True) for name in INPUTS)
        blade_names = ("blade_mass", "blade_first_moment", "blade_inertia", "k_beta", "c_beta")
        names = [
            *("hub_mass_x", "hub_mass_y", "k_x", "c_x", "k_y", "c_y"),
            *("roll_inertia", "k_roll", "c_roll", "kappa"),
            *("eccentricity", "eccentricity_angle", "gravity", "hinge_offset"),
            *(f"{name}_{i}" for i in model.blade_numbers for name in blade_names),
            *(["c_hub_blade"] if model.air_couples else []),
        ]
        self.parameters: dict[str, sp.Symbol] = {name: sp.Symbol(name, real=True) for name in names}
        self.triples = [tuple(self.symbol(name + end) for end in ("", "_rate", "_acc")) for name in model.coordinates]
        self.coordinate = dict(zip(model.coordinates, self.triples, strict=True))

    def symbol(self, name: str) -> "sp.Symbol":
        """The real symbol of that name."""
        return self.sp.Symbol(name, real=True)

    def displacement(self, name: str) -> "sp.Expr":
        """The displacement of hub, support or blade: its symbol if free, 0 if locked; κ x and what is free for a roll."""
        own = self.coordinate[name][0] if name in self.coordinate else self.zero
        if name == "roll" and self.model.roll != "locked" and "x" in self.coordinate:
            return self.parameters["kappa"] * self.coordinate["x"][0] + own
        return own

    def rate(self, expression: "sp.Expr") -> "sp.Expr":
        """The time derivative of an expression in displacements, velocities, ψ and Ω."""
        from windsysid.mechanics.equations import total_derivative

        moving = {q: v for q, v, _ in self.triples} | {v: a for _, v, a in self.triples}
        return total_derivative(expression, moving | {self.psi: self.omega, self.omega: self.omega_dot})

    def blade_angle(self, i: int) -> "sp.Expr":
        """θ_i, the direction of blade i's link in the fixed frame."""
        return self.psi + self.sp.Rational(2 * (i - 1), self.model.blades) * self.sp.pi + self.displacement("roll")

    def lag(self, i: int) -> "sp.Expr":
        """β_i."""
        return self.displacement(f"beta_{i}")

    def hub(self) -> "sp.Expr":
        """Position of the hub centre, x + i y (Eq (1) without its eccentricity)."""
        return self.displacement("x") + self.sp.I * self.displacement("y")

    def turn(self, angle: "sp.Expr") -> "sp.Expr":
        """The unit vector e^{i angle}: points of the rotor plane are complex numbers x + i y."""
        return self.sp.exp(self.sp.I * angle)

    def blade_point(self, i: int, along: float, across: float = 0.0, deflection: float | None = None) -> "sp.Expr":
        """Position of a point of blade i: `along` the blade from its link, `across` in the sense of rotation (Eq (2)).

        On a blade that bends, the point moves by `deflection` · β instead of `along` · β: as if it hinged further in
        or out.
        """
        lever = along if deflection is None else deflection
        link = self.hub() + (self.parameters["hinge_offset"] + (along - lever)) * self.turn(self.blade_angle(i))
        return link + (lever + self.sp.I * across) * self.turn(self.blade_angle(i) + self.lag(i))

    def components(self, vector: "sp.Expr") -> "tuple[sp.Expr, sp.Expr]":
        """Real and imaginary part of an expression in real symbols and e^{i angle}."""
        sp = self.sp
        vector = sp.powsimp(sp.expand(vector), combine="exp")
        vector = vector.replace(
            lambda e: isinstance(e, sp.exp),
            lambda e: sp.cos(sp.expand(e.args[0] / sp.I)) + sp.I * sp.sin(sp.expand(e.args[0] / sp.I)),
        )
        vector = sp.expand(vector)
        imaginary = vector.coeff(sp.I, 1)
        return sp.expand(vector - sp.I * imaginary), imaginary

    def kinetic_energy(self) -> "sp.Expr":
        """T of hub, support and blades."""
        sin, cos, p, half = self.sp.sin, self.sp.cos, self.parameters, self.sp.Rational(1, 2)
        vx, vy = (self.rate(self.displacement(name)) for name in ("x", "y"))
        turning = self.omega + self.rate(self.displacement("roll"))
        unbalance = p["eccentricity_angle"] + self.psi + self.displacement("roll")
        total = half * (
            p["hub_mass_x"] * (vx - p["eccentricity"] * turning * sin(unbalance)) ** 2
            + p["hub_mass_y"] * (vy + p["eccentricity"] * turning * cos(unbalance)) ** 2
            + p["roll_inertia"] * self.rate(self.displacement("roll")) ** 2
        )
        d = p["hinge_offset"]
        for i in self.model.blade_numbers:
            m, S, inertia = (p[f"{name}_{i}"] for name in ("blade_mass", "blade_first_moment", "blade_inertia"))
            theta, beta = self.blade_angle(i), self.lag(i)
            blade_rate = turning + self.rate(beta)
            link_speed_squared = (
                vx**2 + vy**2 + (d * turning) ** 2 + 2 * d * turning * (vy * cos(theta) - vx * sin(theta))
            )
            link_along_tangent = vy * cos(theta + beta) - vx * sin(theta + beta) + d * turning * cos(beta)
            total += half * (m * link_speed_squared + 2 * S * blade_rate * link_along_tangent + inertia * blade_rate**2)
        return self.sp.expand(total)

    def potential_energy(self) -> "sp.Expr":
        """V of springs and gravity."""
        sin, p, half = self.sp.sin, self.parameters, self.sp.Rational(1, 2)
        springs = sum((half * p[f"k_{name}"] * q**2 for name, (q, _, _) in self.coordinate.items()), self.zero)
        weight_moment = (
            p["hub_mass_y"] * p["eccentricity"] * sin(p["eccentricity_angle"] + self.psi + self.displacement("roll"))
        )
        weight = p["hub_mass_y"]
        for i in self.model.blade_numbers:
            m, S = p[f"blade_mass_{i}"], p[f"blade_first_moment_{i}"]
            weight += m
            weight_moment += m * p["hinge_offset"] * sin(self.blade_angle(i))
            weight_moment += S * sin(self.blade_angle(i) + self.lag(i))
        sag = weight * self.displacement("y") if self.model.datum == "unstressed" else self.zero
        return springs + p["gravity"] * (weight_moment + sag)

    def dissipation(self) -> "sp.Expr":
        """Rayleigh's dissipation function of the dampers, D = ½ Σ c q̇² + c_hub_blade Σ_i β̇_i v_i.

        A blade's aerodynamic force falls with the velocity of its section, v_i + r β̇_i, v_i along the tangent where it acts: to each blade ½ c_a (v_i + r β̇_i)².
        The squares are part of the totals c_x, c_y, c_β; what they leave is c_hub_blade = c_a r [N·s]. On a roll it acts at the radius d + I/S.
        """
        half, p, sin, cos = self.sp.Rational(1, 2), self.parameters, self.sp.sin, self.sp.cos
        total = sum((half * p[f"c_{name}"] * v**2 for name, (_, v, _) in self.coordinate.items()), self.zero)
        if not self.model.air_couples:
            return total
        vx, vy, turning = (self.rate(self.displacement(name)) for name in ("x", "y", "roll"))
        for i in self.model.blade_numbers:
            theta = self.blade_angle(i)
            radius = p["hinge_offset"] + p[f"blade_inertia_{i}"] / p[f"blade_first_moment_{i}"]
            along = vy * cos(theta) - vx * sin(theta) + radius * turning
            total += p["c_hub_blade"] * self.rate(self.lag(i)) * along
        return total

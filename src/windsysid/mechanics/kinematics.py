"""Positions, velocities and energies of a rotor's parts, in symbols."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

from windsysid.mechanics.model import Coefficient

if TYPE_CHECKING:
    import sympy as sp


__all__ = ["INPUTS", "Kinematics"]

INPUTS = ("rotor_azimuth", "rotor_speed", "rotor_acceleration")
"""Names of the inputs u of every rotor model: ψ [rad, unwrapped], Ω [rad/s], dΩ/dt [rad/s²]."""


class RotorLayout(Protocol):
    """Layout of a rotor, as its kinematics need it (`windsysid.mechanics.rotor.RotorModel`)."""

    @property
    def blades(self) -> int:
        """Number of blades."""

    @property
    def blade_numbers(self) -> Sequence[int]:
        """Numbers of the blades, from 1."""

    @property
    def coordinates(self) -> Sequence[str]:
        """Names of the free degrees of freedom."""

    @property
    def parameters(self) -> Sequence[Coefficient]:
        """Every parameter, in the order of the equations."""

    @property
    def roll(self) -> str:
        """Roll of the support: locked, tied or free."""

    @property
    def datum(self) -> str:
        """Origin of displacements."""

    @property
    def air_couples(self) -> bool:
        """True if the air couples hub and blades."""

    @property
    def leads(self) -> bool:
        """True if all blades lead by a mean lag angle."""


class Kinematics:
    """Symbols, positions and energies of a `RotorModel`; SymPy is imported here and not before."""

    def __init__(self, model: RotorLayout) -> None:
        import sympy as sp

        self.model = model
        self.sp = sp
        self.zero = sp.Integer(0)
        self.psi, self.omega, self.omega_dot = (sp.Symbol(name, real=True) for name in INPUTS)
        self.parameters: dict[str, sp.Symbol] = {c.name: self.symbol(c.name) for c in model.parameters}
        self.triples = [tuple(self.symbol(name + end) for end in ("", "_rate", "_acc")) for name in model.coordinates]
        self.coordinate = dict(zip(model.coordinates, self.triples, strict=True))

    def symbol(self, name: str) -> "sp.Symbol":
        """The real symbol of that name."""
        return self.sp.Symbol(name, real=True)

    def displacement(self, name: str) -> "sp.Expr":
        """The displacement of hub, support or blade: its symbol if free, 0 if locked; κ x and what is free for a
        roll."""
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
        """β_i, and the mean lag angle β₀ where the blades have one.

        Then a torque k_βi β₀ from outside holds each blade: the spring works on β_i alone.
        """
        own = self.displacement(f"beta_{i}")
        return own + self.parameters["mean_lag_angle"] if self.model.leads else own

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

        A blade's aerodynamic force falls with the velocity of its section, v_i + r β̇_i, v_i along the tangent where it
        acts: to each blade ½ c_a (v_i + r β̇_i)². The squares are part of the totals c_x, c_y, c_β; what they leave is
        c_hub_blade = c_a r [N·s]. On a roll it acts at the radius d + I/S.
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

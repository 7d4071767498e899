"""Equations of motion as data: what the compiler takes and what every mechanical model hands over.

A model is a first-order system, part of which may be implicit in the accelerations a:

    M(x, u, p) a = F(x, u, p, w)            (a linear system, solved numerically, never inverted symbolically)
    ẋ            = f(x, a, u, p, w)

x: states, u: known inputs, p: parameters, w: loads. Plain first-order equations simply have no a. A Lagrangian is
one way to write M, F and f; `lagrange` is that way.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import sympy as sp

__all__ = ["Equations", "lagrange", "total_derivative"]


@dataclass(frozen=True)
class Equations:
    """A symbolic first-order model, ready for `windsysid.mechanics.compile_model`.

    Attributes
    ----------
    name
        A word for files and messages.
    states, inputs, parameters, loads
        The symbols x, u, p and w, in the order in which numbers will be given.
    rates
        The right-hand sides f of ẋ = f(x, a, u, p, w), one per state.
    accelerations, mass, force
        The symbols a with M (n × n, symmetric positive definite) and F (n) of M a = F. Empty for plain equations.
    """

    name: str
    states: tuple[sp.Symbol, ...]
    inputs: tuple[sp.Symbol, ...]
    parameters: tuple[sp.Symbol, ...]
    loads: tuple[sp.Symbol, ...]
    rates: tuple[sp.Expr, ...]
    accelerations: tuple[sp.Symbol, ...] = ()
    mass: sp.Matrix = field(default_factory=lambda: sp.zeros(0, 0))
    force: sp.Matrix = field(default_factory=lambda: sp.zeros(0, 1))

    def __post_init__(self) -> None:
        if len(self.rates) != len(self.states):
            raise ValueError(
                f"model '{self.name}': expected one rate per state, got {len(self.rates)} rates "
                f"for {len(self.states)} states"
            )
        n = len(self.accelerations)
        if self.mass.shape != (n, n) or self.force.shape != (n, 1):
            raise ValueError(
                f"model '{self.name}': expected M {n} × {n} and F {n} × 1 for {n} accelerations, "
                f"got {self.mass.shape} and {self.force.shape}"
            )

    @cached_property
    def signature(self) -> str:
        """A text that is the same exactly when the equations are."""
        parts = (self.states, self.inputs, self.parameters, self.loads, self.accelerations, self.rates)
        return str(sp.srepr(tuple(sp.Tuple(*part) for part in parts)) + sp.srepr((self.mass, self.force)))

    def equations(self) -> "Equations":
        """The equations themselves: an `Equations` is its own recipe."""
        return self

    def readings(self, sensors: Sequence[object]) -> list[sp.Expr]:
        """The expressions that the sensors read; here each sensor brings its own in ``expression``."""
        return [sp.sympify(getattr(sensor, "expression")) for sensor in sensors]  # noqa: B009


def total_derivative(expression: sp.Expr, rates: Mapping[sp.Symbol, sp.Expr]) -> sp.Expr:
    """The time derivative of `expression` by the chain rule, given the rate of everything in it that moves."""
    return sp.Add(*(sp.diff(expression, symbol) * rate for symbol, rate in rates.items()))


def lagrange(
    name: str,
    *,
    lagrangian: sp.Expr,
    dissipation: sp.Expr,
    coordinates: Sequence[tuple[sp.Symbol, sp.Symbol, sp.Symbol]],
    loads: Sequence[sp.Symbol],
    inputs: Mapping[sp.Symbol, sp.Expr],
    parameters: Iterable[sp.Symbol],
) -> Equations:
    """Lagrange's equations d/dt ∂L/∂q̇ − ∂L/∂q = −∂D/∂q̇ + w in the form M a = F.

    Parameters
    ----------
    lagrangian
        L(q, q̇, u, p) = T − V.
    dissipation
        Rayleigh's dissipation function D(q̇, p).
    coordinates
        One (q, q̇, q̈) triple of symbols per degree of freedom.
    loads
        One generalised load per degree of freedom.
    inputs
        The known inputs with the rate of each; an input that L depends on must have its rate among the inputs.
    """
    q = [c[0] for c in coordinates]
    v = [c[1] for c in coordinates]
    a = [c[2] for c in coordinates]
    momentum = [sp.diff(lagrangian, rate) for rate in v]
    mass = sp.Matrix(len(q), len(q), lambda i, j: sp.diff(momentum[i], v[j]))
    known_rates: dict[sp.Symbol, sp.Expr] = dict(zip(q, v, strict=True)) | dict(inputs)
    force = sp.Matrix(
        len(q),
        1,
        lambda i, _: (
            sp.diff(lagrangian, q[i])
            - total_derivative(momentum[i], known_rates)
            - sp.diff(dissipation, v[i])
            + loads[i]
        ),
    )
    return Equations(
        name=name,
        states=(*q, *v),
        inputs=tuple(inputs),
        parameters=tuple(parameters),
        loads=tuple(loads),
        rates=(*v, *a),
        accelerations=tuple(a),
        mass=mass,
        force=force.applyfunc(sp.expand),
    )

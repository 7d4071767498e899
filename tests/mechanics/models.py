"""Small models as a user would bring them: plain first-order equations, and sensors that are expressions."""

from dataclasses import dataclass

import sympy as sp

from windsysid.mechanics.equations import Equations


def symbols(names: str) -> tuple[sp.Symbol, ...]:
    """Real symbols: without that assumption the derivative of |z| is no function Python knows."""
    return tuple(sp.Symbol(name, real=True) for name in names.split())


@dataclass(frozen=True)
class Reads:
    """A sensor of a user's own model: whatever expression it reads."""

    channel: str
    expression: sp.Expr
    noise: float = 0.01
    bias: float = 0.0


def chain() -> Equations:
    """Three masses in a row between a wall and free space: springs, dampers and a load on each."""
    q, v, w = (symbols(f"{name}_1 {name}_2 {name}_3") for name in ("q", "v", "load"))
    m, k, c = (symbols(f"{name}_1 {name}_2 {name}_3") for name in "mkc")
    stretch = [q[0], q[1] - q[0], q[2] - q[1]]
    speed = [v[0], v[1] - v[0], v[2] - v[1]]
    force = [k[i] * stretch[i] + c[i] * speed[i] for i in range(3)]
    rates = [(w[i] - force[i] + (force[i + 1] if i < 2 else 0)) / m[i] for i in range(3)]
    return Equations("chain", (*q, *v), (), (*m, *k, *c), w, (*v, *rates))


CHAIN_VALUES = {
    "m_1": 2.0, "m_2": 1.5, "m_3": 1.0, "k_1": 400.0, "k_2": 300.0, "k_3": 200.0, "c_1": 1.2, "c_2": 0.9, "c_3": 0.5
}  # fmt: skip


def chain_sensors(bias: float = 0.0) -> tuple[Reads, ...]:
    """An accelerometer on the first mass (load included), on the last with a bias, and a displacement in the middle."""
    model = chain()
    return (
        Reads("acceleration_1", model.rates[3], 0.05),
        Reads("acceleration_3", model.rates[5], 0.08, bias),
        Reads("displacement_2", model.states[1], 0.002),
    )


def duffing() -> Equations:
    """q̈ + c q̇ + a q + b q³ = u, the force u being a known input."""
    q, v, a, b, c, u = symbols("q v a b c u")
    return Equations("duffing", (q, v), (u,), (a, b, c), (), (v, u - c * v - a * q - b * q**3))


def bouc_wen() -> Equations:
    """A mass on a hysteretic spring; z is the internal state: ż = A v − β |v| |z| z − γ v z² (exponent n = 2)."""
    q, v, z, w = symbols("q v z load")
    m, c, k, alpha, A, beta, gamma = symbols("m c k alpha A beta gamma")
    acceleration = (w - c * v - alpha * k * q - (1 - alpha) * k * z) / m
    hysteresis = A * v - beta * sp.Abs(v) * sp.Abs(z) * z - gamma * v * z**2
    return Equations("bouc_wen", (q, v, z), (), (m, c, k, alpha, A, beta, gamma), (w,), (v, acceleration, hysteresis))

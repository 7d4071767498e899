"""Derivatives of expressions, and kinds of parameters, told from the equations."""

import sympy as sp

from tests.mechanics.models import bouc_wen, chain, duffing, symbols
from windsysid.mechanics.equations import Equations, derivative


def test_derivatives_are_those_of_sympy_in_the_same_form():
    x, v, a, t = symbols("x v a t")
    branch = sp.Piecewise((x**2 * v, x > 0), (v, True))
    for expression in (
        2 * (x + v) * sp.sin(a * x) * t, x**2 * v - 3 * sp.cos(x * t) ** 2, branch + branch * a,
        abs(x) ** a * sp.exp(v * x), x * v * x**a / (1 + x), sp.Max(x, v) * x, sp.Function("f")(x) * x, sp.Integer(3),
    ):  # fmt: skip
        for symbol in (x, v, a, t):
            assert sp.srepr(derivative(expression, symbol)) == sp.srepr(sp.diff(expression, symbol))


def roles(model: Equations) -> dict[str, tuple[str, str]]:
    return {p.name: model.role(p.name) for p in model.parameters}


def test_the_kind_of_a_parameter_is_that_of_what_it_multiplies():
    """Stiffness multiplies a displacement, damping a velocity, in the force on that coordinate and against it."""
    nothing = ("", "")
    assert roles(duffing()) == {"a": ("stiffness", "q"), "b": nothing, "c": ("damping", "q")}
    found = roles(chain())
    assert {found[f"k_{i}"][0] for i in (1, 2, 3)} == {"stiffness"}
    assert {found[f"c_{i}"][0] for i in (1, 2, 3)} == {"damping"}
    assert {found[f"m_{i}"] for i in (1, 2, 3)} == {nothing}
    assert roles(bouc_wen())["c"] == ("damping", "q")
    assert duffing().role("none") == nothing


def test_a_negative_damping_is_damping_and_what_drives_a_motion_is_not():
    q, v, ζ, ω, drive = sp.symbols("q v ζ ω drive")
    model = Equations("oscillator", (q, v), (), (ζ, ω, drive), (), (v, -2 * ζ * ω * v - ω**2 * q + drive * v))
    assert roles(model) == {"ζ": ("damping", "q"), "ω": ("stiffness", "q"), "drive": ("", "")}

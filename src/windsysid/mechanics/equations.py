"""Equations of motion as data: input of the compiler, output of every mechanical model.

A model is a first-order system, part of which may be implicit in the accelerations a:

    M(x, u, p) a = F(x, u, p, w)            (a linear system, solved numerically, never inverted symbolically)
    ẋ            = f(x, a, u, p, w)

x: states, u: known inputs, p: parameters, w: loads. Plain first-order equations simply have no a. A Lagrangian is
one way to write M, F and f; `lagrange` is that way.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from keyword import iskeyword
from math import prod
from typing import Any

import sympy as sp
from sympy.core.function import AppliedUndef

from windsysid.errors import ConfigurationError
from windsysid.mechanics.model import Kind

__all__ = ["MATH", "Equations", "derivative", "lagrange", "total_derivative"]

MATH = (
    "acos", "asin", "atan", "atan2", "copysign", "cos", "cosh", "erf", "exp", "log", "nan", "pi", "sin", "sinh",
    "sqrt", "tan", "tanh",
)  # fmt: skip
"""Imports of generated source from `math`."""

_TAKEN = frozenset((*MATH, "abs", "max", "min", "where"))


@dataclass(frozen=True)
class Equations:
    """Symbolic first-order equations of motion: ẋ = f(x, a, u, p, w), with M(x, u, p) a = F(x, u, p, w).

    Attributes
    ----------
    name
        A word for files and messages.
    states, inputs, parameters, loads
        The symbols x, u, p and w, in the order in which numbers are given.
    rates
        The right-hand sides f, one for each state.
    accelerations, mass, force
        The symbols a with M (n × n, symmetric positive definite) and F (n). Empty for equations without them.

    Raises
    ------
    ConfigurationError
        If the sizes do not fit; if something is no SymPy symbol or expression (text is refused, since SymPy would
        execute it); if a name is no Python variable or occurs twice; or if an expression has an unknown symbol.

    See Also
    --------
    lagrange : Equations from a Lagrangian.
    fit : Identify parameters of the equations.

    Examples
    --------
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    >>> spring.states, spring.rates
    ((q, v), (v, -k*q - 0.2*v + w))
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
        if not (isinstance(self.name, str) and self.name.isprintable()):
            raise ConfigurationError(f"name of a model: expected a word, got {self.name!r:.60}")
        for what in ("states", "inputs", "parameters", "loads", "accelerations"):
            object.__setattr__(self, what, tuple(getattr(self, what)))
        self._check_names()
        rates = tuple(_expression(rate, f"model '{self.name}': rates") for rate in self.rates)
        object.__setattr__(self, "rates", rates)
        for what in ("mass", "force"):
            if not isinstance(getattr(self, what), sp.MatrixBase):
                raise ConfigurationError(
                    f"model '{self.name}': {what}: expected a SymPy matrix, got {getattr(self, what)!r:.60}"
                )
        if len(self.rates) != len(self.states):
            raise ConfigurationError(
                f"model '{self.name}': expected one rate per state, got {len(self.rates)} rates "
                f"for {len(self.states)} states"
            )
        n = len(self.accelerations)
        if self.mass.shape != (n, n) or self.force.shape != (n, 1):
            raise ConfigurationError(
                f"model '{self.name}': expected M {n} × {n} and F {n} × 1 for {n} accelerations, "
                f"got {self.mass.shape} and {self.force.shape}"
            )
        self.check_expressions((*self.rates, *self.mass, *self.force))

    def _check_names(self) -> None:
        """Names go into source code as they are."""
        seen: set[str] = set()
        for symbol in (*self.states, *self.inputs, *self.parameters, *self.loads, *self.accelerations):
            if not isinstance(symbol, sp.Symbol):
                raise ConfigurationError(f"model '{self.name}': expected SymPy symbols, got {symbol!r:.60}")
            name = symbol.name
            if not name.isidentifier() or iskeyword(name) or name in _TAKEN or name.startswith("_"):
                raise ConfigurationError(
                    f"model '{self.name}': expected names fit for Python variables, got '{name:.60}': rename it"
                )
            if name in seen:
                raise ConfigurationError(
                    f"model '{self.name}': expected each name once, got '{name}' twice: rename one"
                )
            seen.add(name)

    def check_expressions(self, expressions: Iterable[sp.Expr]) -> None:
        """Refuse expressions that hold anything else than this model's symbols and functions that SymPy knows.

        Raises
        ------
        ConfigurationError
            With the name of what is not known.
        """
        known = {*self.states, *self.inputs, *self.parameters, *self.loads, *self.accelerations}
        for expression in expressions:
            unknown = (expression.free_symbols - known) | expression.atoms(AppliedUndef)
            if unknown:
                name = min(map(str, unknown))
                same = name in {symbol.name for symbol in known}
                raise ConfigurationError(
                    f"model '{self.name}': '{name:.60}' in an expression is "
                    + ("not declared as it is among the model's symbols: use the same SymPy symbol, such as "
                        "real=True" if same
                       else "no state, input, parameter, load or acceleration of the model: declare it")
                )  # fmt: skip

    @cached_property
    def signature(self) -> str:
        """A text that is the same exactly when the equations are."""
        parts = (self.states, self.inputs, self.parameters, self.loads, self.accelerations, self.rates)
        return str(sp.srepr(tuple(sp.Tuple(*part) for part in parts)) + sp.srepr((self.mass, self.force)))

    def role(self, name: str) -> tuple[Kind, str]:
        """Kind of the parameter `name`, and the displacement that it acts on: stiffness where it multiplies a
        displacement q in the force on q itself, damping where it multiplies the velocity q̇ there, against the motion;
        empty otherwise.

        Signs are those at rest, without inputs and loads, all other parameters being 1.
        """
        at_rest: dict[sp.Symbol, int] = dict.fromkeys((*self.states, *self.inputs, *self.loads, *self.accelerations), 0)
        at_rest |= dict.fromkeys(self.parameters, 1)
        symbol = next((p for p in self.parameters if p.name == name), sp.Symbol(name))
        rates = dict(zip(self.states, self.rates, strict=True))
        forces = dict(zip(self.accelerations, self.force, strict=True))
        moving = [(q, v, forces.get(rates[v], rates[v])) for q, v in rates.items() if v in rates]

        def resisted(of: int) -> str:
            against = (known for known in moving if sp.diff(known[2], known[of], symbol).subs(at_rest).is_negative)
            return next((known[0].name for known in against), "")

        if stiff := resisted(0):
            return "stiffness", stiff
        damped = resisted(1)
        return ("damping", damped) if damped else ("", "")

    def equations(self) -> "Equations":
        """The equations themselves: an `Equations` is its own recipe."""
        return self

    def readings(self, sensors: Sequence[object]) -> list[sp.Expr]:
        """The expressions that the sensors read; here each sensor brings its own in ``expression``."""
        return [
            _expression(getattr(sensor, "expression", None), f"sensor of model '{self.name}'") for sensor in sensors
        ]

    def readings_across(self, sensors: Sequence[object]) -> list[sp.Expr | None]:
        """None for each of `sensors`: expressions have no axis."""
        return [None] * len(sensors)


def _expression(value: Any, what: str) -> sp.Expr:
    """A SymPy expression or a number, as SymPy has it; never text, which SymPy would execute."""
    try:
        found = sp.sympify(value, strict=True)
    except sp.SympifyError:
        found = None
    if not isinstance(found, sp.Expr):
        raise ConfigurationError(
            f"{what}: expected SymPy expressions, got {value!r:.60}: write it with SymPy's symbols"
        )
    return found


@lru_cache(maxsize=20_000)
def _symbols(expression: sp.Basic) -> frozenset[sp.Basic]:
    """Symbols in an expression."""
    parts = expression.args
    return frozenset[sp.Basic]().union(*(map(_symbols, parts) if parts else [expression.free_symbols]))


@lru_cache(maxsize=20_000)
def derivative(expression: sp.Expr, symbol: sp.Symbol) -> sp.Expr:
    """∂`expression`/∂`symbol` as `sympy.diff`, which looks for the symbol in all parts of each part anew. With
    floating-point numbers its form may differ."""
    parts = expression.args
    if symbol not in _symbols(expression):
        return sp.S.Zero
    if expression.is_Add:
        return sp.Add(*(derivative(part, symbol) for part in parts))
    if not expression.is_Mul:
        return sp.diff(expression, symbol)
    slopes = ((i, derivative(part, symbol)) for i, part in enumerate(parts))
    return sp.Add(*(prod((*parts[:i], slope, *parts[i + 1 :]), start=sp.S.One) for i, slope in slopes if slope != 0))


def total_derivative(expression: sp.Expr, rates: Mapping[sp.Symbol, sp.Expr]) -> sp.Expr:
    """The time derivative of `expression` by the chain rule, given the rate of everything in it that moves."""
    return sp.Add(*(derivative(expression, symbol) * rate for symbol, rate in rates.items()))


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
    """Derive Lagrange's equations d/dt ∂L/∂q̇ − ∂L/∂q = −∂D/∂q̇ + w in the form M a = F.

    Parameters
    ----------
    name : str
        A word for files and messages.
    lagrangian : sympy.Expr
        L(q, q̇, u, p) = T − V.
    dissipation : sympy.Expr
        Rayleigh's dissipation function D(q̇, p).
    coordinates : sequence of (Symbol, Symbol, Symbol)
        A triple (q, q̇, q̈) for each degree of freedom.
    loads : sequence of Symbol
        One generalised load for each degree of freedom.
    inputs : mapping of Symbol to Expr
        The known inputs with the rate of each; an input that L depends on must have its rate among the inputs.
    parameters : iterable of Symbol
        The symbols whose values are numbers.

    Returns
    -------
    Equations
        With the states (q, q̇) (2 n,), M (n, n) and F (n,).

    Raises
    ------
    ConfigurationError
        As raised by `Equations`.

    References
    ----------
    Goldstein, Poole & Safko, Classical Mechanics, 3rd ed., Addison-Wesley 2002, ch. 1.

    Examples
    --------
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, a, w, m, c, k = sp.symbols("q v a w m c k")
    >>> spring = ws.models.lagrange(
    ...     "spring", lagrangian=m * v**2 / 2 - k * q**2 / 2, dissipation=c * v**2 / 2, coordinates=[(q, v, a)],
    ...     loads=[w], inputs={}, parameters=[m, c, k],
    ... )
    >>> spring.mass, spring.force
    (Matrix([[m]]), Matrix([[-c*v - k*q + w]]))
    """
    lagrangian = _expression(lagrangian, f"Lagrangian of model '{name}'")
    dissipation = _expression(dissipation, f"dissipation of model '{name}'")
    inputs = {symbol: _expression(rate, f"inputs of model '{name}'") for symbol, rate in inputs.items()}
    loads = [_expression(load, f"loads of model '{name}'") for load in loads]
    q, v, a = ([triple[i] for triple in coordinates] for i in range(3))
    momentum = [derivative(lagrangian, rate) for rate in v]
    mass = sp.Matrix(len(q), len(q), lambda i, j: derivative(momentum[i], v[j]))
    known_rates: dict[sp.Symbol, sp.Expr] = dict(zip(q, v, strict=True)) | inputs
    force = [
        derivative(lagrangian, x) - total_derivative(p, known_rates) - derivative(dissipation, rate) + load
        for x, rate, p, load in zip(q, v, momentum, loads, strict=False)
    ]
    F = sp.Matrix(len(force), 1, [sp.expand(row) for row in force])
    return Equations(name, (*q, *v), tuple(inputs), tuple(parameters), tuple(loads), (*v, *a), tuple(a), mass, F)

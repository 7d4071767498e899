"""Symbolic equations and readings → the source of four compiled kernels, as one readable Python module.

Where the accelerations are implicit, M a = F is factorised M = L D Lᵀ without pivoting (M is positive definite) along
its nonzero pattern. Derivatives follow from the residual R(a, ·) = F − M a at the solution: ∂a/∂· = M⁻¹ ∂R/∂·, and M⁻¹
itself is required anyway: it is ∂a/∂w for loads on the degrees of freedom. With it,

    ∂y/∂· = ∂y/∂·|_a + Σ_k ∂y/∂a_k · (M⁻¹ ∂R/∂·)_k.
"""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import sympy as sp

from windsysid.errors import ConfigurationError
from windsysid.mechanics.equations import MATH, Equations, derivative
from windsysid.mechanics.sensors import instrument_parameters

if TYPE_CHECKING:
    from windsysid.mechanics.model import Model

__all__ = ["generate_source"]

MIN_MAGNITUDE = 1e-30
"""Least magnitude: |z| is kept that far off zero, so that |z|ⁿ has derivatives to z and n where z = 0, and not 0/0 or 0
· log 0."""


def generate_source(
    model: "Model", sensors: Sequence[Any], identified: Sequence[str], *, instruments: bool = False
) -> str:
    """The Python module that holds a model's four kernels: rates and reading, each without and with Jacobians.

    With `instruments`, a sensor whose gain is off by g and whose axis by φ reads (1 + g) (y cos φ + y₉₀ sin φ), y₉₀
    being what it would read across its axis.
    """
    equations = model.equations()
    _check_agreement(model, equations)
    chosen, motion = _chosen(equations, identified), (equations.signature, *identified)
    readings = model.readings(sensors)
    if instruments:
        off = [tuple(sp.Symbol(name, real=True) for name in instrument_parameters(i)) for i in range(len(sensors))]
        readings = list(map(_read_askew, readings, model.readings_across(sensors), off))
        equations = replace(equations, parameters=(*equations.parameters, *itertools.chain(*off)))
    equations.check_expressions(readings)
    lines = [
        '"""Kernels written by windsysid. Do not edit: a file that was changed is made again."""',
        "",
        f"from math import {', '.join(MATH)}",
        "",
        "from windsysid.kernels.assemble import where",
        "",
        f"NAME = {equations.name!r}",
    ]
    names = {name.upper(): getattr(equations, name) for name in ("states", "inputs", "parameters", "loads")}
    for constant, symbols in {**names, "IDENTIFIED": chosen}.items():
        lines.append(f"{constant} = {tuple(symbol.name for symbol in symbols)!r}")
    lines.append(f"READINGS = {len(readings)}")
    if motion not in _written:
        _written[motion] = _kernels("rates", equations, list(equations.rates), chosen)
    return "\n".join([*lines, *_written[motion], *_kernels("reading", equations, readings, chosen)]) + "\n"


_written: dict[tuple[str, ...], list[str]] = {}
"""Lines of rates, which models with other sensors share: by equations and what is identified."""


def _kernels(name: str, equations: Equations, outputs: Sequence[sp.Expr], chosen: Sequence[sp.Symbol]) -> list[str]:
    """Source lines of a kernel without and with derivatives."""
    slopes = _kernel(f"{name}_jacobian", equations, outputs, chosen)
    return ["", "", *_kernel(name, equations, outputs), "", "", *slopes]


def _chosen(equations: Equations, identified: Sequence[str]) -> list[sp.Symbol]:
    """The symbols of the parameters to identify; ConfigurationError if one is unknown or listed twice."""
    known = {symbol.name: symbol for symbol in equations.parameters}
    for name in identified:
        if name not in known:
            raise ConfigurationError(f"no parameter '{name}' to identify: expected one of {', '.join(known)}")
    if len(set(identified)) < len(identified):
        raise ConfigurationError(f"a parameter is listed twice among those to identify: {', '.join(identified)}")
    return [known[name] for name in identified]


def _read_askew(y: sp.Expr, across: sp.Expr | None, off: Sequence[sp.Symbol]) -> sp.Expr:
    """Reading of a sensor with the gain and angle `off`."""
    gain, turn = off
    return (1 + gain) * (y if across is None else y * sp.cos(turn) + across * sp.sin(turn))


def _check_agreement(model: "Model", equations: Equations) -> None:
    """Refuse a `MechanicalModel` whose declarations disagree with its equations, before arrays are filled in another
    order."""
    for what in ("states", "inputs", "parameters", "loads"):
        told = tuple(getattr(one, "name", one) for one in getattr(model, what, ()))
        found = tuple(symbol.name for symbol in getattr(equations, what))
        if model is not equations and hasattr(model, "freedoms") and told != found:
            raise ConfigurationError(
                f"model '{equations.name}': its {what} are {', '.join(told) or 'none'}, those of its equations "
                f"{', '.join(found) or 'none'}: "
                "expected the same in the same order"
            )


class _Slopes(NamedTuple):
    """Nonzero derivatives of one kernel: an expression by (group, row, column), the group being dx, dp or dw.

    `residual`: of F − M a, at fixed a; `direct`: of the outputs, at fixed a; `through`: of output i to a_k, by (i, k).
    """

    residual: dict[tuple[str, int, int], sp.Expr]
    direct: dict[tuple[str, int, int], sp.Expr]
    through: dict[tuple[int, int], sp.Expr]


def _kernel(
    name: str, equations: Equations, outputs: Sequence[sp.Expr], identified: Sequence[sp.Symbol] | None = None
) -> list[str]:
    """Source lines of one kernel; with derivatives if `identified` is given."""
    a = equations.accelerations
    n = len(a) if a and any(output.has(*a) for output in outputs) else 0
    mass = {(i, j): m for i in range(n) for j in range(i + 1) if (m := equations.mass[i, j]) != 0}
    groups = _groups(equations, identified)
    roles: list[dict[Any, sp.Expr]] = [mass, dict(enumerate(equations.force[:n])), dict(enumerate(outputs))]
    shared, texts, used = _simplified([*roles, *_slopes(equations, outputs, groups, n)])
    mass_text, force_text, output_text, *slope_texts = texts
    early, late = _by_dependence(shared, set(a))
    factor = _Factor(mass, n)

    body = [*_unpack(equations, used), *early, *_assigned("_m%d_%d", mass_text), *_assigned("_f%d", force_text)]
    body += [*factor.lines, *factor.solve({i: f"_f{i}" for i in range(n)}, list(map(str, a[:n]))), *late]
    body += [*_assigned("_value[%d]", output_text), *(factor.inverse() if groups else ())]
    body += [*_jacobians(groups, len(outputs), _Slopes(*slope_texts)), "return"]
    head = f"def {name}(_x, _u, _p, _w, _value{''.join(f', _{group}' for group, _ in groups)}):"
    return [head, *(f"    {line}" for line in body)]


def _simplified(
    roles: Sequence[dict[Any, sp.Expr]],
) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[dict[Any, str]], set[sp.Symbol]]:
    """Shared subexpressions, the text of every expression in terms of them, and all symbols that occur."""
    shared, reduced = sp.cse(
        [expression for role in roles for expression in role.values()],
        symbols=sp.numbered_symbols("_t", real=True),
        order="none",
    )
    texts = iter(_text(expression) for expression in reduced)
    used = set().union(*(e.free_symbols for e in (*reduced, *(e for _, e in shared))))
    return shared, [{key: next(texts) for key in role} for role in roles], used


def _groups(equations: Equations, identified: Sequence[sp.Symbol] | None) -> list[tuple[str, Sequence[sp.Symbol]]]:
    """Variables of a Jacobian kernel, and the name of its matrix; empty without derivatives."""
    if identified is None:
        return []
    return [("dx", equations.states), ("dp", identified), ("dw", equations.loads)]


def _slopes(
    equations: Equations, outputs: Sequence[sp.Expr], groups: Sequence[tuple[str, Sequence[sp.Symbol]]], n: int
) -> _Slopes:
    """All derivatives that are not zero for every argument."""
    a = equations.accelerations
    residual = list(equations.force - equations.mass * sp.Matrix(n, 1, a)) if n else []
    columns = [(group, j, symbol) for group, symbols in groups for j, symbol in enumerate(symbols)]

    def nonzero(rows: Sequence[sp.Expr]) -> dict[tuple[str, int, int], sp.Expr]:
        return {
            (group, i, j): slope
            for group, j, symbol in columns
            for i, row in enumerate(rows)
            if (slope := derivative(row, symbol)) != 0
        }

    through = {
        (i, k): slope
        for i, output in enumerate(outputs)
        for k in range(n if groups else 0)
        if (slope := derivative(output, a[k])) != 0
    }
    return _Slopes(nonzero(residual), nonzero(outputs), through)


def _by_dependence(
    shared: Sequence[tuple[sp.Symbol, sp.Expr]], accelerations: set[sp.Symbol]
) -> tuple[list[str], list[str]]:
    """Shared subexpressions as lines: those that can come before the accelerations are known, and the others."""
    dependent = set(accelerations)
    early: list[str] = []
    late: list[str] = []
    for symbol, expression in shared:
        waits = bool(expression.free_symbols & dependent)
        if waits:
            dependent.add(symbol)
        (late if waits else early).append(f"{symbol.name} = {_text(expression)}")
    return early, late


def _unpack(equations: Equations, used: set[sp.Symbol]) -> Iterator[str]:
    """Arguments into variables with the model's own names."""
    arrays = {"_x": equations.states, "_u": equations.inputs, "_p": equations.parameters, "_w": equations.loads}
    for array, symbols in arrays.items():
        for i, symbol in enumerate(symbols):
            if symbol in used:
                yield f"{symbol.name} = {array}[{i}]"


def _jacobians(groups: Sequence[tuple[str, Sequence[sp.Symbol]]], rows: int, texts: "_Slopes") -> Iterator[str]:
    """The entries of dx, dp and dw from the texts of the slopes and the columns _g of M⁻¹."""
    for (group, i, j), text in texts.residual.items():
        yield f"_r_{group}_{i}_{j} = {text}"
    for group, j in ((group, j) for group, symbols in groups for j in range(len(symbols))):
        pushed = [i for (g, i, column) in texts.residual if g == group and column == j]
        if pushed:
            yield from _accelerations(texts, f"{group}_{{}}_{j}", pushed)
        for i in range(rows):
            terms = [texts.direct[group, i, j]] if (group, i, j) in texts.direct else []
            terms += _terms(texts, i, f"_a_{group}_{{}}_{j}") if pushed else []
            if terms:
                yield f"_{group}[{i}, {j}] = {' + '.join(terms)}"


def _accelerations(texts: "_Slopes", name: str, pushed: Sequence[int]) -> Iterator[str]:
    """Slopes of the accelerations to one variable that outputs depend on, from those of the residuals `pushed`."""
    for k in sorted({k for _, k in texts.through}):
        products = [f"_g{max(k, i)}_{min(k, i)}*_r_{name.format(i)}" for i in pushed]
        yield f"_a_{name.format(k)} = {' + '.join(products)}"


def _terms(texts: "_Slopes", i: int, acceleration: str) -> list[str]:
    """The terms of output i that depend on accelerations, by the pattern of their slopes' names."""
    slopes = {acceleration.format(k): slope for (row, k), slope in texts.through.items() if row == i}
    return [name if slope == "1" else f"({slope})*{name}" for name, slope in slopes.items()]


def _assigned(target: str, texts: dict[Any, str]) -> Iterator[str]:
    return (f"{target % key} = {text}" for key, text in texts.items())


def _text(expression: sp.Expr) -> str:
    """An expression as Python arithmetic that `windsysid.kernels.assemble` compiles."""
    from sympy.printing.codeprinter import PrintMethodNotImplementedError

    try:
        return str(_printer().doprint(expression))
    except PrintMethodNotImplementedError:
        raise ConfigurationError(
            f"cannot compile '{str(expression)[:100]}', a derivative in the model: expected functions of symbols "
            f"declared with real=True"
        ) from None


class _Factor:
    """M = L D Lᵀ written out along the nonzero pattern of M, eliminating the row with fewest neighbours first."""

    def __init__(self, entries: Iterable[tuple[int, int]], n: int) -> None:
        self.lines: list[str] = []
        self.value = {(i, j): f"_m{i}_{j}" for i, j in entries}
        self.neighbours = {
            i: {j for j in range(n) if j != i and (max(i, j), min(i, j)) in self.value} for i in range(n)
        }
        self.below: dict[int, list[int]] = {}
        while len(self.below) < n:
            left = (i for i in range(n) if i not in self.below)
            self._eliminate(min(left, key=lambda i: (len(self.neighbours[i]), i)))
        self.order = list(self.below)

    def _eliminate(self, k: int) -> None:
        value = self.value
        rest = self.below[k] = sorted(self.neighbours[k])
        self.lines.append(f"_d{k} = 1.0/{value[k, k]}")
        for i in rest:
            self.lines.append(f"_l{i}_{k} = {value[max(i, k), min(i, k)]}*_d{k}")
            self.neighbours[i] |= {*rest}
            self.neighbours[i] -= {i, k}
        for i, j in ((i, j) for i in rest for j in rest if j <= i):
            update = f"_l{i}_{k}*{value[max(j, k), min(j, k)]}"
            name = f"_s{i}_{j}_{k}"
            self.lines.append(f"{name} = {value[i, j]} - {update}" if (i, j) in value else f"{name} = -{update}")
            value[i, j] = name

    def inverse(self) -> Iterator[str]:
        """Lines of the columns _g of M⁻¹."""
        for column in range(len(self.order)):
            yield from self.solve({column: "1.0"}, [f"_g{i}_{column}" for i in range(len(self.order))])

    def solve(self, right: dict[int, str], names: list[str]) -> list[str]:
        """Lines that solve M z = right into variables called `names`."""
        lines: list[str] = []
        current = dict(right)
        tag = "".join(names[:1])
        for k in self.order:
            if k not in current:
                continue
            for i in self.below[k]:
                term = f"_l{i}_{k}" if current[k] == "1.0" else f"_l{i}_{k}*{current[k]}"
                name = f"_y{tag}_{i}_{k}"
                lines.append(f"{name} = {current[i]} - {term}" if i in current else f"{name} = -{term}")
                current[i] = name
        for k in reversed(self.order):
            terms = ([f"{current[k]}*_d{k}"] if k in current else []) + [
                f"- _l{i}_{k}*{names[i]}" for i in self.below[k]
            ]
            lines.append(f"{names[k]} = {' '.join(terms) or '0.0'}")
        return lines


@lru_cache(maxsize=1)
def _printer() -> Any:
    """SymPy's printer of plain Python that vectors understand too, with magnitudes kept off zero and the slope of a
    jump left out."""
    from sympy.printing.pycode import PythonCodePrinter

    class Printer(PythonCodePrinter):  # type: ignore[misc]
        def _print_Abs(self, expression: sp.Abs) -> str:
            return f"max(abs({self._print(expression.args[0])}), {MIN_MAGNITUDE})"

        def _print_DiracDelta(self, expression: sp.DiracDelta) -> str:
            return "0.0"

        def _print_sign(self, expression: sp.sign) -> str:
            of = self._print(expression.args[0])
            return f"where({of} == 0.0, 0.0, copysign(1.0, {of}))"

        def _print_Piecewise(self, expression: sp.Piecewise) -> str:
            text = "nan"
            for value, condition in reversed(expression.args):
                text = (
                    self._print(value)
                    if condition == True  # noqa: E712 (SymPy's own truth)
                    else f"where({self._print(condition)}, {self._print(value)}, {text})"
                )
            return text

        def _print_Heaviside(self, expression: sp.Heaviside) -> str:
            return str(self._print(expression.rewrite(sp.Piecewise)))

        def _print_And(self, expression: sp.And) -> str:
            return " & ".join(f"({self._print(part)})" for part in expression.args)

        def _print_Or(self, expression: sp.Or) -> str:
            return " | ".join(f"({self._print(part)})" for part in expression.args)

    return Printer({"fully_qualified_modules": False})

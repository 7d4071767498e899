"""Equations of motion and sensor readings → compiled kernels with exact Jacobians.

A model is written out as one readable Python module in the user's cache folder, named by a hash of what it was made
from, and compiled from there; a warm run imports that module and never SymPy. Per model there are two quantities,
the rates
ẋ and the readings y, each as a value kernel and as a kernel with its Jacobians, with one fixed signature for all
models (`windsysid.jit`).

Where the accelerations are implicit, M a = F is factorised M = L D Lᵀ without pivoting (M is positive definite)
along its nonzero pattern. Derivatives follow from the residual R(a, ·) = F − M a at the solution:
∂a/∂· = M⁻¹ ∂R/∂·, and M⁻¹ itself is wanted anyway: it is ∂a/∂w for loads on the degrees of freedom.
"""

import hashlib
import importlib.util
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib import metadata
from keyword import iskeyword
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Protocol

from platformdirs import user_cache_path

from windsysid.errors import ConfigurationError
from windsysid.jit import JACOBIAN, VALUE, compiled, logger

if TYPE_CHECKING:
    import sympy as sp

    from windsysid.mechanics.equations import Equations

__all__ = ["CompiledModel", "Model", "compile_model"]


class Model(Protocol):
    """What can be compiled: `RotorModel`, or any `Equations`."""

    @property
    def signature(self) -> str:
        """A text that is the same exactly when the equations are."""

    def equations(self) -> "Equations":
        """The symbolic equations."""

    def readings(self, sensors: Sequence[Any]) -> "list[sp.Expr]":
        """The symbolic readings of the sensors."""


@dataclass(frozen=True)
class CompiledModel:
    """A model's kernels and the names of what goes in and out, in order.

    Kernels are compiled when first asked for. Arguments are contiguous float64: x (n_x,), u (n_u,), p (n_p,), w (n_w,);
    `rates` writes ẋ (n_x,), `reading` y (m,); the Jacobians are (n_x or m) × n_x, × len(identified), × n_w.
    """

    module: ModuleType

    @property
    def name(self) -> str:
        """Name of the model."""
        return str(self.module.NAME)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states x."""
        return tuple(self.module.STATES)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs u."""
        return tuple(self.module.INPUTS)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters p."""
        return tuple(self.module.PARAMETERS)

    @property
    def identified(self) -> tuple[str, ...]:
        """Names of the parameters with derivatives."""
        return tuple(self.module.IDENTIFIED)

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of the loads w."""
        return tuple(self.module.LOADS)

    @property
    def readings(self) -> int:
        """Number m of readings."""
        return int(self.module.READINGS)

    @cached_property
    def rates(self) -> Any:
        """Kernel of ẋ."""
        return compiled(self.module.rates, VALUE)

    @cached_property
    def rates_jacobian(self) -> Any:
        """Kernel of ẋ with ∂ẋ/∂x, ∂ẋ/∂p, ∂ẋ/∂w."""
        return compiled(self.module.rates_jacobian, JACOBIAN)

    @cached_property
    def reading(self) -> Any:
        """Kernel of y."""
        return compiled(self.module.reading, VALUE)

    @cached_property
    def reading_jacobian(self) -> Any:
        """Kernel of y with ∂y/∂x, ∂y/∂p, ∂y/∂w."""
        return compiled(self.module.reading_jacobian, JACOBIAN)


def compile_model(model: Model, sensors: Sequence[Any] = (), identified: Sequence[str] = ()) -> CompiledModel:
    """Compile `model` with the readings of `sensors` and derivatives to the parameters `identified`.

    Raises
    ------
    ConfigurationError
        If a name in `identified` is not a parameter of the model, or appears twice.
    """
    structure = [getattr(sensor, "structure", None) or repr(sensor) for sensor in sensors]
    text = "\n".join([model.signature, *structure, "identified", *identified, _version()])
    key = hashlib.sha256(text.encode()).hexdigest()[:20]
    cached = _loaded.get(key)
    if cached is None:
        path = _cache_folder() / f"model_{key}.py"
        if not path.exists():
            _announce()
            _write_atomically(path, generate_source(model, sensors, identified))
        cached = _loaded[key] = CompiledModel(_import(path))
    return cached


_loaded: dict[str, CompiledModel] = {}


def generate_source(model: Model, sensors: Sequence[Any], identified: Sequence[str]) -> str:
    """The Python module that holds a model's four kernels."""
    equations = model.equations()
    for symbol in (*equations.states, *equations.inputs, *equations.parameters, *equations.loads):
        if not symbol.name.isidentifier() or iskeyword(symbol.name) or symbol.name in _MATH or symbol.name[0] == "_":
            raise ConfigurationError(
                f"model '{equations.name}': expected names fit for Python variables, got '{symbol.name}': rename it"
            )
    names = [symbol.name for symbol in equations.parameters]
    for name in identified:
        if name not in names:
            raise ConfigurationError(f"no parameter '{name}' to identify: expected one of {', '.join(names)}")
    if len(set(identified)) < len(identified):
        raise ConfigurationError(f"a parameter is listed twice among those to identify: {', '.join(identified)}")
    chosen = [equations.parameters[names.index(name)] for name in identified]
    readings = model.readings(sensors)
    lines = [
        f'"""{equations.name}: kernels written by windsysid. Do not edit: delete the file and it is made again."""',
        "",
        f"from math import {', '.join(_MATH)}",
        "",
        f"NAME = {equations.name!r}",
    ]
    for constant, symbols in (
        ("STATES", equations.states),
        ("INPUTS", equations.inputs),
        ("PARAMETERS", equations.parameters),
        ("IDENTIFIED", tuple(chosen)),
        ("LOADS", equations.loads),
    ):
        lines.append(f"{constant} = {tuple(symbol.name for symbol in symbols)!r}")
    lines.append(f"READINGS = {len(readings)}")
    for name, outputs in (("rates", list(equations.rates)), ("reading", readings)):
        lines += ["", "", *_kernel(name, equations, outputs)]
        lines += ["", "", *_kernel(f"{name}_jacobian", equations, outputs, chosen)]
    return "\n".join(lines) + "\n"


_MATH = ("copysign", "cos", "cosh", "exp", "log", "pi", "sin", "sinh", "sqrt", "tan", "tanh")


def _kernel(
    name: str, equations: "Equations", outputs: "list[sp.Expr]", identified: "list[sp.Symbol] | None" = None
) -> Iterator[str]:
    """Source lines of one kernel; with derivatives if `identified` is given."""
    import sympy as sp

    a = list(equations.accelerations)
    n = len(a)
    implicit = any(output.has(*a) for output in outputs) if a else False
    mass = {
        (i, j): equations.mass[i, j] for i in range(n) for j in range(i + 1) if implicit and equations.mass[i, j] != 0
    }
    force = list(equations.force) if implicit else []

    groups: list[tuple[str, Sequence[sp.Symbol]]] = []
    residual_entries: dict[tuple[str, int, int], sp.Expr] = {}
    direct_entries: dict[tuple[str, int, int], sp.Expr] = {}
    slope_entries: dict[tuple[int, int], sp.Expr] = {}
    if identified is not None:
        groups = [("_dx", equations.states), ("_dp", identified), ("_dw", equations.loads)]
        residual = list(equations.force - equations.mass * sp.Matrix(n, 1, a)) if implicit else []
        for group, symbols in groups:
            for j, symbol in enumerate(symbols):
                for i, expression in enumerate(residual):
                    if (slope := sp.diff(expression, symbol)) != 0:
                        residual_entries[group, i, j] = slope
                for i, expression in enumerate(outputs):
                    if (slope := sp.diff(expression, symbol)) != 0:
                        direct_entries[group, i, j] = slope
        for i, expression in enumerate(outputs):
            for j, symbol in enumerate(a):
                if implicit and (slope := sp.diff(expression, symbol)) != 0:
                    slope_entries[i, j] = slope

    expressions = [
        *mass.values(), *force, *outputs, *residual_entries.values(), *direct_entries.values(), *slope_entries.values()
    ]  # fmt: skip
    shared, reduced = sp.cse(expressions, symbols=sp.numbered_symbols("_t", real=True), order="none")
    printed = iter([_printer().doprint(expression) for expression in reduced])

    matrices = "".join(f", {group}" for group, _ in groups)
    yield f"def {name}(_x, _u, _p, _w, _value{matrices}):"
    used = set().union(*(e.free_symbols for e in (*reduced, *(e for _, e in shared))))
    for array, symbols in (
        ("_x", equations.states), ("_u", equations.inputs), ("_p", equations.parameters), ("_w", equations.loads)
    ):  # fmt: skip
        for i, symbol in enumerate(symbols):
            if symbol in used:
                yield f"    {symbol.name} = {array}[{i}]"

    after: set[sp.Symbol] = set(a)
    late: list[tuple[sp.Symbol, sp.Expr]] = []
    for symbol, expression in shared:
        if expression.free_symbols & after:
            after.add(symbol)
            late.append((symbol, expression))
        else:
            yield f"    {symbol.name} = {_printer().doprint(expression)}"
    if implicit:
        for i, j in mass:
            yield f"    _m{i}_{j} = {next(printed)}"
        for i in range(n):
            yield f"    _f{i} = {next(printed)}"
        factor = _Factor({(i, j): f"_m{i}_{j}" for i, j in mass}, n)
        yield from (f"    {line}" for line in factor.lines)
        yield from (f"    {line}" for line in factor.solve({i: f"_f{i}" for i in range(n)}, [s.name for s in a]))
    for symbol, expression in late:
        yield f"    {symbol.name} = {_printer().doprint(expression)}"
    for i in range(len(outputs)):
        yield f"    _value[{i}] = {next(printed)}"
    if identified is None:
        yield "    return"
        return

    residual_text = {entry: next(printed) for entry in residual_entries}
    direct_text = {entry: next(printed) for entry in direct_entries}
    slope_text = {entry: next(printed) for entry in slope_entries}
    if implicit:
        for column in range(n):
            yield from (f"    {line}" for line in factor.solve({column: "1.0"}, [f"_g{i}_{column}" for i in range(n)]))
        for (group, i, j), text in residual_text.items():
            yield f"    _r{group}_{i}_{j} = {text}"
    for group, symbols in groups:
        for j in range(len(symbols)):
            rows = [i for (g, i, column) in residual_entries if g == group and column == j]
            solved: dict[int, str] = {}
            for i in range(len(outputs)):
                terms = [direct_text[group, i, j]] if (group, i, j) in direct_text else []
                for (output, k), slope in slope_text.items():
                    if output == i and rows:
                        if k not in solved:
                            solved[k] = f"_a{group}_{k}_{j}"
                            products = [f"_g{max(k, r)}_{min(k, r)}*_r{group}_{r}_{j}" for r in rows]
                            yield f"    {solved[k]} = {' + '.join(products)}"
                        terms.append(solved[k] if slope == "1" else f"({slope})*{solved[k]}")
                if terms:
                    yield f"    {group}[{i}, {j}] = {' + '.join(terms)}"
    yield "    return"


class _Factor:
    """M = L D Lᵀ written out along the nonzero pattern of M, eliminating the row with fewest neighbours first."""

    def __init__(self, entries: dict[tuple[int, int], str], n: int) -> None:
        self.lines: list[str] = []
        value = dict(entries)
        neighbours = {i: {j for j in range(n) if j != i and (max(i, j), min(i, j)) in value} for i in range(n)}
        self.order: list[int] = []
        self.below: dict[int, list[int]] = {}
        while len(self.order) < n:
            k = min((i for i in range(n) if i not in self.order), key=lambda i: (len(neighbours[i]), i))
            rest = sorted(neighbours[k])
            self.order.append(k)
            self.below[k] = rest
            self.lines.append(f"_d{k} = 1.0/{value[k, k]}")
            for i in rest:
                self.lines.append(f"_l{i}_{k} = {value[max(i, k), min(i, k)]}*_d{k}")
                neighbours[i].discard(k)
            for i in rest:
                for j in (j for j in rest if j <= i):
                    update = f"_l{i}_{k}*{value[max(j, k), min(j, k)]}"
                    name = f"_s{i}_{j}_{k}"
                    self.lines.append(
                        f"{name} = {value[i, j]} - {update}" if (i, j) in value else f"{name} = -{update}"
                    )
                    value[i, j] = name
                    if i != j:
                        neighbours[i].add(j)
                        neighbours[j].add(i)

    def solve(self, right: dict[int, str], names: list[str]) -> list[str]:
        """Lines that solve M z = right into variables called `names`."""
        lines: list[str] = []
        current = dict(right)
        tag = names[0]
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
def _announce() -> None:
    """Say once per process that this run is slower than the next."""
    logger.info("first run with this model: deriving and compiling its equations; later runs start from the cache")


@lru_cache(maxsize=1)
def _printer() -> Any:
    """A printer of plain Python arithmetic that Numba compiles."""
    from sympy.printing.pycode import PythonCodePrinter

    return PythonCodePrinter({"fully_qualified_modules": False})


@lru_cache(maxsize=1)
def _version() -> str:
    """What the generated source depends on besides the model: this package's mechanics and SymPy."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return f"{digest.hexdigest()} sympy {metadata.version('sympy')}"


@lru_cache(maxsize=1)
def _cache_folder() -> Path:
    """The user's cache folder, or one for this process alone where that cannot be written."""
    folder = Path(os.environ["WINDSYSID_CACHE"]) if "WINDSYSID_CACHE" in os.environ else user_cache_path("windsysid")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        logger.warning("cannot keep compiled models in %s (%s): they are compiled anew in every process", folder, error)
        return Path(tempfile.mkdtemp(prefix="windsysid-"))


def _write_atomically(path: Path, text: str) -> None:
    """Write so that a second process at the same moment sees the whole file or none."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(text)
    os.replace(temporary, path)


def _import(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"windsysid_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise ImportError(f"cannot import the generated model {path}")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # Numba finds a cached function's globals by its module's name
    spec.loader.exec_module(module)
    return module

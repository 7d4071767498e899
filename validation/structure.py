"""Measures of the structure of a checkout, from its syntax alone: nothing of it is imported.

``python -m validation.structure [PATH]`` prints a table and lists for the checkout at PATH, by default for this one.

- Complexity is 1 + every if, elif, for, while, except, case, assert, `and`, `or`, conditional expression, `for` of a
  comprehension and each of its conditions; a nested function counts for itself. Parameters include keyword-only ones,
  `*args` and `**kwargs`, not `self` and `cls`.
- A kernel is a function that Numba compiles: one with a decorator of `KERNEL_DECORATORS`, one that its module hands to
  `compiled`, and what is nested in one. Nothing else is exempt from the limit of parameters.
- A decision limit is a constant in capitals, at the top level of a module or of a class, that states a number or a
  collection of numbers. Its docstring names its kind where it begins with one of `KINDS` and has a colon in its first
  sentence: "Probability: …", "Log odds: …", "Size in standard deviations: …". Constants of `SETTINGS` steer solvers
  and arithmetic; they decide nothing and are counted apart.
- A module counts as tested where a file under `tests` imports it, or a name from it, by its own path.
"""

import argparse
import ast
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

__all__ = ["Function", "Structure", "complexity_of", "functions_of", "limits_of", "main", "measure"]

MIDDLE = ("identification", "spectral", "results", "checks")
LIMIT_ROOMS = (*MIDDLE, "inspection")
"""Rooms between a record and its estimate, and those whose decision limits are counted."""

MAX_COMPLEXITY, MAX_PARAMETERS, MAX_MODULES = 10, 7, 15
"""Bounds for functions, and for the modules of a folder, `__init__` apart."""

KERNEL_DECORATORS = frozenset({"called", "inlined", "intrinsic", "pasted", "uncounted"})
KINDS, SETTINGS = ("probability", "odds", "size"), ("numerical", "tolerance", "setting")
_KIND = re.compile(rf"(?:log )?({'|'.join([*KINDS, *SETTINGS])})\b[^:.]*:", re.IGNORECASE)
_IMPORT = re.compile(r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+)?import[ \t]+(\([^)]*\)|.+)", re.MULTILINE)
_CAPITALS = re.compile(r"_?[A-Z][A-Z0-9_]*")
_FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)
_BRANCH = {ast.If, ast.For, ast.AsyncFor, ast.While, ast.ExceptHandler, ast.match_case, ast.Assert, ast.IfExp}
_LEAVES = {ast.Name, ast.Constant, ast.alias, ast.Load, ast.Store, ast.Pass}


class Function(NamedTuple):
    """A function: its place, complexity and count of parameters, and whether Numba compiles it."""

    place: str
    complexity: int
    parameters: int
    kernel: bool


class Structure(NamedTuple):
    """Lines by room, counts, constants by the kind that they name, and what lies beyond the bounds above."""

    lines: Counter[str]
    functions: int
    kinds: Counter[str]
    large_folders: list[str]
    complex_functions: list[str]
    long_signatures: list[str]
    repeated_classes: list[str]
    untested: list[str]
    decision_limits: list[str]


def complexity_of(function: ast.AST) -> int:
    """Complexity of one function, without those nested in it."""
    total, waiting = 1, _parts(function)
    while waiting:
        node = waiting.pop()
        kind = type(node)
        if kind in _BRANCH:
            total += 1
        elif isinstance(node, ast.BoolOp):
            total += len(node.values) - 1
        elif isinstance(node, ast.comprehension):
            total += 1 + len(node.ifs)
        if kind not in _FUNCTION:
            waiting += _parts(node)
    return total


def _parts(node: ast.AST) -> list[ast.AST]:
    """Nodes right below a node, but for leaves: `ast.iter_child_nodes` takes three times as long."""
    found: list[ast.AST] = []
    for value in vars(node).values():
        if type(value) is list:
            found += [each for each in value if isinstance(each, ast.AST) and type(each) not in _LEAVES]
        elif isinstance(value, ast.AST) and type(value) not in _LEAVES:
            found.append(value)
    return found


def functions_of(tree: ast.AST, path: str) -> Iterator[Function]:
    """All functions of a module."""
    handed, waiting = _handed(tree), [(tree, False)]
    while waiting:
        node, kernel = waiting.pop()
        if isinstance(node, _FUNCTION):
            kernel |= node.name in handed or any(_name(each) in KERNEL_DECORATORS for each in node.decorator_list)
            names = [getattr(each, "arg", "self") for each in ast.iter_child_nodes(node.args)]
            count = len([name for name in names if name not in ("self", "cls")])
            yield Function(f"{path}:{node.lineno} {node.name}", complexity_of(node), count, kernel)
        waiting += [(child, kernel) for child in _parts(node) if not isinstance(child, ast.expr)]


def _handed(tree: ast.AST) -> set[str]:
    """Names of functions that a module hands to `compiled`."""
    found, waiting = set(), [tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Call) and node.args and _name(node) == "compiled":
            found.add(_name(node.args[0]))
        waiting += _parts(node)
    return found


def _name(node: ast.AST) -> str:
    """Last part of a dotted name, name of what is called, or name of a class; '' of others."""
    node = node.func if isinstance(node, ast.Call) else node
    return str(node.name if isinstance(node, ast.ClassDef) else getattr(node, "id", getattr(node, "attr", "")))


def limits_of(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Name of each numeric constant of a module and of its classes, and the kind that its docstring names, or ''."""
    for body in (tree.body, *(node.body for node in tree.body if isinstance(node, ast.ClassDef))):
        for node, after in zip(body, [*body, ast.Pass()][1:], strict=True):
            if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None or not _has_numbers(node.value):
                continue
            text = getattr(getattr(after, "value", None), "value", None)
            kind = _KIND.match(text) if isinstance(text, str) else None
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = (_name(each) for target in targets for each in ast.walk(target))
            yield from ((name, kind[1].lower() if kind else "") for name in names if _CAPITALS.fullmatch(name))


def _has_numbers(value: ast.AST) -> bool:
    """True if an expression states numbers: alone, in arithmetic, in a collection, or as arguments of a call."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and not isinstance(value.value, bool)
    parts = value.values if isinstance(value, ast.Dict) else ast.iter_child_nodes(value)
    compound = ast.UnaryOp | ast.BinOp | ast.Call | ast.keyword | ast.Tuple | ast.List | ast.Set | ast.Dict
    return isinstance(value, compound) and any(map(_has_numbers, parts))


def measure(root: Path) -> Structure:
    """Measure the checkout at root."""
    package = root / "src" / "windsysid"
    texts = {path.relative_to(package): path.read_text(encoding="utf-8") for path in sorted(package.rglob("*.py"))}
    lines = Counter((*place.parts[:-1], ".")[0] for place, text in texts.items() for _ in text.splitlines())
    functions, classes, limits = list[Function](), Counter[str](), list[tuple[str, str]]()
    for place, text in texts.items():  # one tree at a time: garbage collection goes through all that are kept
        tree, name = ast.parse(text), place.as_posix()
        functions += functions_of(tree, name)
        classes.update({_name(node) for node in tree.body})
        limits += [(f"{name} {one}", kind) for one, kind in limits_of(tree) if place.parts[0] in LIMIT_ROOMS]
    modules = [place for place in texts if place.stem != "__init__"]
    folders = Counter(place.parent.as_posix() for place in modules)
    middle = {place.as_posix(): ".".join(place.with_suffix("").parts) for place in modules if place.parts[0] in MIDDLE}
    imported = {name for path in (root / "tests").rglob("*.py") for name in _imported(path)}
    return Structure(
        lines=lines,
        functions=len(functions),
        kinds=Counter(kind for _, kind in limits),
        large_folders=_above(MAX_MODULES, ((count, name) for name, count in folders.items())),
        complex_functions=_above(MAX_COMPLEXITY, ((one.complexity, one.place) for one in functions)),
        long_signatures=_above(MAX_PARAMETERS, ((one.parameters, one.place) for one in functions if not one.kernel)),
        repeated_classes=sorted(name for name, count in classes.items() if name and count > 1),
        untested=[name for name, dotted in middle.items() if f"windsysid.{dotted}" not in imported],
        decision_limits=[name for name, kind in limits if kind not in SETTINGS],
    )


def _above(bound: int, counted: Iterable[tuple[int, str]]) -> list[str]:
    """Counts above a bound with their names, the largest first."""
    return [f"{count} {name}" for count, name in sorted(counted, key=lambda one: (-one[0], one[1])) if count > bound]


def _imported(path: Path) -> Iterator[str]:
    """Modules, and names in modules, that a file imports, by their full path."""
    for module, names in _IMPORT.findall(path.read_text(encoding="utf-8")):
        listed = [each.split()[0] for each in re.sub(r"[()]|#.*", "", names).split(",") if each.split()]
        yield from (module, *(f"{module}.{name}" for name in listed)) if module else listed


def report(found: Structure) -> Iterator[str]:
    """Lines of the table and of the lists."""
    lists = {
        f"folders with more than {MAX_MODULES} modules": found.large_folders,
        f"functions with more than {MAX_PARAMETERS} parameters, kernels apart": found.long_signatures,
        "class names in more than one module": found.repeated_classes,
        f"modules of {', '.join(MIDDLE)} imported by no test": found.untested,
        f"functions over complexity {MAX_COMPLEXITY}": found.complex_functions,
    }
    rows: dict[str, object] = {f"lines of src/{room}": count for room, count in sorted(found.lines.items())}
    middle = sum(found.lines[room] for room in MIDDLE)
    rows |= {"lines of src": found.lines.total(), f"lines of {' + '.join(MIDDLE)}": middle}
    rows |= {"functions": found.functions, **{title: len(names) for title, names in lists.items()}}
    rows["  of all functions [%]"] = f"{100 * len(found.complex_functions) / max(found.functions, 1):.1f}"
    rows[f"numeric constants of {', '.join(LIMIT_ROOMS)}"] = found.kinds.total()
    rows |= {f"  whose docstring names the kind {kind}": found.kinds[kind] for kind in (*KINDS, *SETTINGS)}
    rows["  decision limits: all but settings"] = len(found.decision_limits)
    rows["  decision limits outside limits.py"] = sum("limits.py " not in name for name in found.decision_limits)
    yield from (f"{title:<{max(map(len, rows))}}  {value}" for title, value in rows.items())
    for title, names in lists.items():
        yield from ("", title, *(f"  {name}" for name in (names[:10] if "complexity" in title else names)))


def main() -> int:
    """Print the measures of a checkout."""
    parser = argparse.ArgumentParser(prog="python -m validation.structure", description=__doc__.splitlines()[0])
    parser.add_argument("path", nargs="?", type=Path, default=Path(__file__).parents[1], help="root of the checkout")
    root = parser.parse_args().path
    if not (root / "src" / "windsysid").is_dir():
        print(f"validation.structure: expected a checkout with src/windsysid, got {root}", file=sys.stderr)
        return 2
    print("\n".join(report(measure(root))))
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""No module takes the names of coefficients, statistics or channels apart: each carries its kind and its part."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import windsysid

SOURCE = Path(windsysid.__file__).parent

NAMING = {"mechanics", "turbine", "cli", "records", "inspection", "study"}
"""Folders whose modules give names, read them from files of other makers, or reproduce one publication."""

NAMES = re.compile(r"^(c_|k_|noise_|load_rms|load_beta|beta_|k_beta|narrow_band_|tower_|blade_)")
"""Beginnings of names of coefficients, statistics and channels."""

TAKEN_APART = {"startswith", "removeprefix", "endswith", "removesuffix"}

MODELS = {"RotorModel", "TowerModel"}

SUSPECT = re.compile(rf"\b({'|'.join(sorted(TAKEN_APART | MODELS))}|getattr)\b|['\"](c_|k_|tower_|blade_)[{{'\"]")
"""Words one of which a module that parses names contains: the syntax of the others is not read."""

OLDER = {"results/posterior.py"}
"""Modules that read files of older versions, which hold names only."""


def parsed_names(text: str) -> Iterator[tuple[int, str]]:
    """Line and reason of every place that parses a name, composes one to look it up, or asks for a model's class."""
    for node in ast.walk(ast.parse(text)) if SUSPECT.search(text) else ():
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in TAKEN_APART:
            yield from ((node.lineno, word) for word in _texts(node.args) if NAMES.match(word))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id == "isinstance" and MODELS & {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}:
                yield node.lineno, "the class of a model"
            if node.func.id == "getattr" and "lag" in _texts(node.args):
                yield node.lineno, "a field of one class of models"
        if isinstance(node, ast.JoinedStr) and re.match(r"^(c_|k_|tower_|blade_)$", "".join(_texts(node.values[:1]))):
            yield node.lineno, ast.unparse(node)


def _texts(nodes: list[ast.expr]) -> list[str]:
    """Every text among expressions, and the first text of every one that is composed."""
    found = []
    for node in nodes:
        parts = (
            node.elts if isinstance(node, ast.Tuple) else node.values[:1] if isinstance(node, ast.JoinedStr) else [node]
        )
        found += [part.value for part in parts if isinstance(part, ast.Constant) and isinstance(part.value, str)]
    return found


@pytest.mark.parametrize(
    "line",
    [
        'q.name.startswith("c_")', 'names = {f"k_{name}": 1}', 's.name.startswith(("x", "noise_"))',
        'isinstance(model, RotorModel)', 'getattr(model, "lag", "")', 'name.startswith(f"tower_{axis}_")',
        'name.removeprefix("k_")',
    ],
)  # fmt: skip
def test_the_check_finds_what_it_is_for(line: str):
    assert list(parsed_names(line))


def test_no_module_parses_names():
    found = [
        f"{path.relative_to(SOURCE)}:{line}: {what}"
        for path in sorted(SOURCE.rglob("*.py"))
        if path.relative_to(SOURCE).parts[0] not in NAMING and str(path.relative_to(SOURCE)) not in OLDER
        for line, what in parsed_names(path.read_text(encoding="utf-8"))
    ]
    assert not found, "\n".join(found)

"""Docstrings of everything that `import windsysid` gives: parameters and attributes are named, errors are told."""

import ast
import dataclasses
import inspect
import re
import textwrap
from collections.abc import Iterator
from typing import Any

import pytest

import windsysid

PUBLIC = {name: getattr(windsysid, name) for name in windsysid._PUBLIC}
FUNCTIONS = {name: thing for name, thing in PUBLIC.items() if inspect.isfunction(thing)}
CLASSES = {name: thing for name, thing in PUBLIC.items() if inspect.isclass(thing) and not issubclass(thing, Exception)}


KEYS = {"CompiledModel", "lagrange", "read_sensors"}
"""These stand in `windsysid.mechanics`, whose text is in the key of compiled models: a word more there, and every user
compiles anew. Their docstrings become complete with the next change of that code."""


def complete(things: dict[str, Any]) -> list[Any]:
    """Those that must be complete."""
    return [pytest.param(thing, id=name) for name, thing in sorted(things.items()) if name not in KEYS]


def names(text: str, word: str) -> bool:
    """Whether a docstring names a parameter."""
    return re.search(rf"\b{re.escape(word)}\b", text) is not None


def raises(function: Any) -> bool:
    """Whether a function itself raises, and not only what it calls."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    return any(isinstance(node, ast.Raise) and node.exc is not None for node in ast.walk(tree))


def methods() -> Iterator[Any]:
    """Public methods that stand in a public class itself."""
    for name, found in CLASSES.items():
        for attribute, thing in vars(found).items():
            if isinstance(thing, classmethod | staticmethod):
                thing = thing.__func__
            if inspect.isfunction(thing) and not attribute.startswith("_"):
                yield pytest.param(thing, id=f"{name}.{attribute}")


@pytest.mark.parametrize(
    "function", [pytest.param(FUNCTIONS[name], id=name) for name in sorted(FUNCTIONS.keys() - KEYS)]
)
def test_a_function_says_what_it_takes_gives_and_refuses(function: Any):
    text = inspect.getdoc(function) or ""
    assert [name for name in inspect.signature(function).parameters if not names(text, name)] == []
    assert "return" in inspect.get_annotations(function)
    assert not raises(function) or "Raises\n------" in text


@pytest.mark.parametrize("found", complete(CLASSES))
def test_a_class_says_what_it_holds(found: Any):
    text = "\n".join(inspect.getdoc(base) or "" for base in found.__mro__)
    fields = [field.name for field in dataclasses.fields(found)] if dataclasses.is_dataclass(found) else []
    fields += [*getattr(found, "_fields", ()), *getattr(found, "model_fields", ())]
    assert [name for name in fields if not name.startswith("_") and not names(text, name)] == []


@pytest.mark.parametrize("method", list(methods()))
def test_a_method_is_described_and_says_what_it_refuses(method: Any):
    text = inspect.getdoc(method) or ""
    assert text
    assert not raises(method) or "Raises\n------" in text or "Error" in text

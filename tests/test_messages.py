"""Messages are short enough to be read: 160 characters at most, and so is each clause of a page. All of them are listed
in messages.txt: ``python -m tests.test_messages > tests/messages.txt``."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import windsysid
from tests.results.test_sentences import table

ROOT = Path(windsysid.__file__).parent
PLACEHOLDER = "x" * 10
"""What a value put into a message counts."""

FIELD = re.compile(r"\{[a-z_]+(\[0\])?(:[^{}]*)?\}")
"""What a template is filled in at."""

STATEMENTS = ("CREATE ", "INSERT ", "SELECT ", "UPDATE ", "DELETE ")
"""How what is said to databases begins: no user reads it."""

PAGES = {"reports", "study"}
FILES = sorted(ROOT.rglob("*.py"))
CATALOGUE = Path(__file__).parent / "messages.txt"
CODE = re.compile(
    r"^[<({]|[<>|] |PRAGMA|\(\?|\\[bdw(.]|^\w+\[|^\w+=\w+ |=\"|_[dlar]\w*_…|^ *#? ?…? ?=|[\w?] (=|AND|IN) [?(…]"
)
"""Texts that no user reads: markup, types, patterns, queries, generated code."""


def said(node: ast.AST) -> str | None:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return FIELD.sub(PLACEHOLDER, node.value)
    if isinstance(node, ast.JoinedStr):
        return "".join(said(value) or PLACEHOLDER for value in node.values)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        left, right = said(node.left), said(node.right)
        return None if left is None and right is None else (left or PLACEHOLDER) + (right or PLACEHOLDER)
    return None


def texts(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Every text of a module but its docstrings, with its line."""
    nodes = list(ast.walk(tree))
    seen = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    for node in nodes:  # a message comes before the texts in it
        text = None if id(node) in seen else said(node)
        if text is not None:
            seen.update(map(id, ast.walk(node)))
            if text.lstrip().startswith(STATEMENTS):
                continue
            yield node.lineno, text  # type: ignore[attr-defined]


@cache
def texts_of(path: Path) -> tuple[tuple[int, str], ...]:
    """The texts of a file, which two tests read."""
    return tuple(texts(ast.parse(path.read_text(encoding="utf-8"))))


def test_every_text_for_users_can_be_read_at_once():
    long = []
    for path in FILES:
        name = path.relative_to(ROOT).as_posix()
        for line, text in texts_of(path):
            parts = text.replace(": ", ". ").split(". ") if name.split("/")[0] in PAGES else [text]
            long += [f"{name}:{line}: {part}" for part in parts if len(part) > 160]
    assert not long, "\n".join(long)


def test_a_message_is_measured_whole():
    source = 'raise E("a" f"{b:.3g} c" + (" d" if b else ""))\n"""doc"""\nprint("e {f:.2g} h")'
    found = [text for _, text in texts(ast.parse(source))]
    assert found == ["a" + PLACEHOLDER + " c" + PLACEHOLDER, f"e {PLACEHOLDER} h"]


def catalogue() -> str:
    """The sentences of findings with example values, and every text of three words or more, by module."""
    lines = ["# Findings (values are examples)", table()]
    for path in FILES:
        if path.parent.name != "sentences":
            found = dict.fromkeys(text.replace(PLACEHOLDER, "…").replace("\n", " ") for _, text in texts_of(path))
            known = [text for text in found if len(re.findall("[A-Za-z]{2,}", text)) > 2 and not CODE.search(text)]
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            lines += [f"\n# {module}", *known] if known else []
    return "\n".join(line.strip(" ") for line in lines) + "\n"


def test_the_catalogue_lists_every_message():
    assert CATALOGUE.read_text("utf-8") == catalogue(), "python -m tests.test_messages > tests/messages.txt"


if __name__ == "__main__":
    print(catalogue(), end="")

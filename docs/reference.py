"""The pages that are generated: every public name with its docstring, every command with its own help, and every code
of a finding with its sentence."""

import inspect
from pathlib import Path
from types import ModuleType

from tests.results.test_sentences import table
from typer.testing import CliRunner

import windsysid
from windsysid.cli import app

__all__ = ["NAMESPACES", "write_reference"]

NAMESPACES = (windsysid, windsysid.results, windsysid.models, windsysid.filters, windsysid.signals)
"""Each has a page."""

FINDINGS = """# Codes of findings

Sentences are examples; [findings.md](../findings.md) describes the fields. `python -m tests.results.test_sentences`
prints this table.

"""


def write_reference(folder: Path) -> None:
    """Write ``index.md``, a page for each namespace, ``commands.md`` and ``findings.md``."""
    folder.mkdir(exist_ok=True)
    lines = ["# Reference", ""]
    for namespace in NAMESPACES:
        name = namespace.__name__
        (folder / f"{name}.md").write_text(_page(namespace), encoding="utf-8")
        lines.append(f"- [{name}]({name}.md): {_title(namespace)}")
    (folder / "commands.md").write_text(_commands(), encoding="utf-8")
    (folder / "findings.md").write_text(FINDINGS + table(), encoding="utf-8")
    lines += ["- [Commands](commands.md): every option.", "- [Codes of findings](findings.md): with their sentences."]
    lines += ["", "```{toctree}", ":hidden:", ""]
    lines += [*(namespace.__name__ for namespace in NAMESPACES), "commands", "findings", "```", ""]
    (folder / "index.md").write_text("\n".join(lines), encoding="utf-8")


def _title(namespace: ModuleType) -> str:
    """First sentence of its docstring."""
    return (inspect.getdoc(namespace) or "").split("\n\n")[0].replace("\n", " ")


def _page(namespace: ModuleType) -> str:
    """Every public name of a namespace, functions first; names of other namespaces have their own page."""
    lines = [f"# {namespace.__name__}", "", _title(namespace), ""]
    public = {name: getattr(namespace, name) for name in sorted(namespace.__all__) if not name.startswith("__")}
    for name, thing in sorted(public.items(), key=lambda item: inspect.isclass(item[1])):
        if inspect.ismodule(thing):
            continue
        kind = "class" if inspect.isclass(thing) else "function" if callable(thing) else "data"
        if kind == "class" and issubclass(thing, Exception):
            kind = "exception"
        members = ["   :members:"] if kind == "class" else []
        lines += ["```{eval-rst}", f".. auto{kind}:: {namespace.__name__}.{name}", *members, "```", ""]
    return "\n".join(lines)


def _commands() -> str:
    """The help of every command, as a terminal of 100 columns shows it."""
    listed = [command.name or getattr(command.callback, "__name__", "") for command in app.registered_commands]
    lines = ["# Commands", ""]
    for command in ("", *listed):
        given = [*([command] if command else []), "--help"]
        shown = CliRunner().invoke(app, given, prog_name="windsysid", env={"COLUMNS": "100", "NO_COLOR": "1"}).output
        told = shown.strip("\n ")
        lines += [f"## windsysid {command}".rstrip(), "", "```text", told, "```", ""]
    return "\n".join(lines)

"""The pages that are generated: every public name with its docstring, and every command with its own help."""

import inspect
from pathlib import Path

from typer.testing import CliRunner

import windsysid
from windsysid.cli import app

__all__ = ["write_reference"]

GROUPS = {
    "Records": ("records", "signals", "simulation", "inspection"),
    "Identification": ("identification",),
    "Results": ("results", "reports"),
    "Modes": ("modal", "spectral"),
    "What moved": ("monitoring", "fleet"),
    "Turbines, mechanics and sensors": ("turbine", "mechanics"),
    "Loads and state space": ("loads", "statespace"),
    "Filters": ("filters",),
    "Errors": ("errors",),
}
"""Rooms of the package under the headings that a reader looks for."""

INDEX = """# Reference

- [Python](api.md): everything that `import windsysid` gives.
- [Commands](commands.md): every option.

```{toctree}
:hidden:

api
commands
```
"""


def write_reference(folder: Path) -> None:
    """Write ``index.md``, ``api.md`` and ``commands.md``."""
    folder.mkdir(exist_ok=True)
    (folder / "index.md").write_text(INDEX, encoding="utf-8")
    (folder / "api.md").write_text(_api(), encoding="utf-8")
    (folder / "commands.md").write_text(_commands(), encoding="utf-8")


def _api() -> str:
    """Every public name, under the heading of its room; each room must have one."""
    public = {name: getattr(windsysid, name) for name in sorted(windsysid._PUBLIC)}
    names = dict(sorted(public.items(), key=lambda item: inspect.isclass(item[1])))  # functions come first
    lines = ["# Python", "", "Everything that `import windsysid as ws` gives.", ""]
    left = dict(names)
    for heading, rooms in GROUPS.items():
        lines += [f"## {heading}", ""]
        for name, thing in names.items():
            if _room(name) not in rooms:
                continue
            del left[name]
            kind = "class" if inspect.isclass(thing) else "function" if callable(thing) else "data"
            if kind == "class" and issubclass(thing, Exception):
                kind = "exception"
            members = ["   :members:"] if kind == "class" else []
            lines += ["```{eval-rst}", f".. auto{kind}:: windsysid.{name}", *members, "```", ""]
    if left:
        raise SystemExit(f"docs/reference.py: no heading for the rooms of {', '.join(left)}")
    return "\n".join(lines)


def _room(name: str) -> str:
    return str(windsysid._PUBLIC[name][0]).split(".")[0]


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

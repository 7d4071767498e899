"""What the commands share: options, the output folder, progress, tables."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import typer
from typer.core import TyperCommand, TyperGroup, TyperOption

from windsysid.errors import ConfigurationError
from windsysid.output.console import printable

if TYPE_CHECKING:
    from windsysid.output.progress import Shown

__all__ = [
    "ListsLoads", "Write", "claim_output", "parse_option", "print_and_save", "print_table", "rotor_speeds",
    "show_progress",
]  # fmt: skip

ORDER = (
    "inspect", "identify", "oma", "modes", "compare", "monitor", "damping", "plan", "simulate", "batch", "report",
    "live", "export", "publish", "turbines", "study",
)  # fmt: skip
"""Commands as the help lists them: what is asked of one record, of several, of archives, of running turbines."""


class _InOrder(TyperGroup):
    def list_commands(self, ctx: Any) -> list[str]:
        """All commands, in their `ORDER`."""
        return sorted(super().list_commands(ctx), key=ORDER.index)


app = typer.Typer(
    cls=_InOrder,
    add_completion=True,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Identify the stiffness and damping of a wind turbine from its vibration.",
)

TurbineOption = Annotated[
    str, typer.Option("--turbine", help="A packaged turbine (windsysid turbines lists them) or a TOML file.")
]
Mapping = Annotated[
    Path | None, typer.Option(help="TOML file that says what a record's columns are (docs/records.md).")
]
Overwrite = Annotated[bool, typer.Option("--overwrite", metavar="", help="Replace results that are already there.")]


class ListsLoads(TyperCommand):
    """A command whose help of ``--loads`` ends with the registered hypotheses; they are imported when somebody asks for
    help."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help."""
        from windsysid.loads.family import describe_hypotheses

        for option in self.params:
            if option.name == "loads" and isinstance(option, TyperOption):
                option.help = f"{option.help} {describe_hypotheses()}."
        super().format_help(ctx, formatter)


def parse_option(option: str, text: str, unit: str) -> float:
    """A number with its unit, in SI."""
    from windsysid.units import parse_quantity

    try:
        return parse_quantity(text, unit)
    except ConfigurationError as error:
        raise ConfigurationError(f"{option}: {error}; got '{text}'") from None


Write = Callable[[dict[str, bytes]], None]


def claim_output(context: typer.Context, output: Path | None, *inputs: str | Path, overwrite: bool) -> Write:
    """Take the output folder before any work, until the command ends; what writes a result there."""
    from windsysid.output.folders import claim

    if output is None:
        return lambda _: None
    return context.with_resource(claim(output, overwrite=overwrite, inputs=inputs))


class _Answer(Protocol):
    def to_json(self) -> str: ...

    def files(self) -> dict[str, bytes]: ...


def print_and_save(found: _Answer, output: Path | None, write: Write, *, json: bool = False) -> None:
    """Print an answer, then save it with its report where asked: what cannot be saved has been seen."""
    print(found.to_json().rstrip() if json else found)
    if output is not None:
        with show_progress("report") as progress:
            progress("writing the report")
            write(found.files())
        if not json:
            print(f"report: {printable(output / 'report.html')}")


def rotor_speeds(option: str, given: tuple[str, str] | None) -> tuple[float, float] | None:
    """Two rotor speeds with their units, in rad/s."""
    return None if given is None else (parse_option(option, given[0], "rad/s"), parse_option(option, given[1], "rad/s"))


@contextmanager
def show_progress(title: str) -> Iterator["Shown"]:
    """Say on standard error what is being done and how long it will take: on a terminal, nothing in a pipe."""
    from rich.console import Console

    from windsysid.output.progress import Shown

    console = Console(stderr=True)
    shown = Shown(title)
    with console.status(shown, spinner="dots" if console.encoding.startswith("utf") else "line"):
        yield shown


def print_table(headings: Any, rows: Any, title: str) -> None:
    """Print rows under headings, as wide as the terminal at most."""
    from windsysid.output.console import render
    from windsysid.output.table import Table

    print(render(Table(headings, rows, title, words=range(len(headings)))))

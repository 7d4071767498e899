"""Shared parts of the commands: options, the output folder, progress, tables."""

import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Protocol

import typer
from typer.core import TyperCommand, TyperGroup

from windsysid.errors import ConfigurationError
from windsysid.output.console import printable

if TYPE_CHECKING:
    from windsysid.output.progress import Shown
    from windsysid.output.table import Table

__all__ = [
    "COMMANDS", "HYPOTHESES_HELP", "PACKAGED", "Destination", "NamesTurbine", "app", "claim_output", "compared",
    "kept_of", "name_of", "numbered", "parse_option", "print_and_save", "print_answer", "print_table",
    "print_unsaved", "register_commands", "results_of", "rotor_speeds", "show_progress",
]  # fmt: skip

COMMANDS = {
    "start": "start", "inspect": "records", "identify": "identify", "oma": "oma", "modes": "answers",
    "compare": "answers", "monitor": "answers", "damping": "answers", "plan": "answers", "simulate": "records",
    "batch": "fleet", "report": "fleet", "live": "live", "export": "live", "publish": "publish",
    "examples": "records", "turbine": "records", "turbines": "records", "study": "records", "warm": "warm",
}  # fmt: skip
"""Commands with their modules, as the help lists them: for one record, for several, for archives, for running
turbines."""


def register_commands(name: str = "") -> None:
    """Import the module of a command, or those of all commands if none has that name."""
    for module in (COMMANDS[name],) if name in COMMANDS else dict.fromkeys(COMMANDS.values()):
        import_module(f"windsysid.cli.{module}")


class _InOrder(TyperGroup):
    def list_commands(self, ctx: Any) -> list[str]:
        """All commands, in their order."""
        return sorted(super().list_commands(ctx), key=list(COMMANDS).index)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write what each command does, whole."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, self.commands[name].help or "") for name in self.list_commands(ctx)])


app = typer.Typer(
    cls=_InOrder,
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"max_content_width": 120},
    rich_markup_mode=None,  # boxes take longer to draw than a command's help should take
    help="Identify the stiffness and damping of a wind turbine from its vibration.",
)

PACKAGED = "A packaged turbine (windsysid turbines lists them)"
TurbineOption = Annotated[
    str, typer.Option("--turbine", help=f"{PACKAGED}, a TOML file or a model (windsysid turbine).")
]
Mapping = Annotated[Path | None, typer.Option(help="TOML file that describes a record's columns (docs/records.md).")]
Output = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER", help="For report.html and data; by default results/NAME, or NAME-2 … if that exists."
    ),
]
Json = Annotated[
    bool, typer.Option("--json", metavar="", help="Print the summary as JSON; nothing is saved without --output.")
]
Verbose = Annotated[bool, typer.Option("--verbose", metavar="", help="Print everything, not only the first screen.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", metavar="", help="Overwrite existing results.")]


MAX_LISTED = 12
"""Setting: largest number of folders that a line names."""

HYPOTHESES_HELP = "; ".join(
    (
        "broadband: first-order Gauss–Markov",
        "second-order: second-order processes",
        "narrow-band: first-order Gauss–Markov, and a narrow-band process on the support",
        "rotor-wind: wind on the turning rotor",
    )
)
"""The load hypotheses that come with the package: their own texts are in `windsysid.loads`, which imports much."""


class NamesTurbine(TyperCommand):
    """A command whose turbine is named by ``--turbine``: a bare name is refused with the option in one line."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the options."""
        if not args or args[0].startswith("-"):
            return super().parse_args(ctx, args)
        from windsysid.turbine.file import packaged_turbines

        takes_result = any(option.param_type_name == "argument" for option in self.params)
        if not takes_result or args[0].endswith(".toml") or args[0] in packaged_turbines():
            raise ConfigurationError(
                f"{ctx.info_name}: a turbine is named by --turbine: windsysid {ctx.info_name} --turbine {args[0]}"
            )
        return super().parse_args(ctx, args)


def parse_option(option: str, text: str, unit: str) -> float:
    """A number with its unit, in SI."""
    from windsysid.units import parse_quantity

    try:
        return parse_quantity(text, unit)
    except ConfigurationError as error:
        raise ConfigurationError(f"{option}: {error}; got '{text}'") from None


class Destination(NamedTuple):
    """The output folder of a command, and the function that writes a result there; None where nothing is saved."""

    folder: Path | None
    write: Callable[[dict[str, bytes]], None]


def claim_output(
    context: typer.Context, output: Path | None, name: str, *inputs: str | Path, overwrite: bool, json: bool = False
) -> Destination:
    """Take the output folder before any work, until the command ends: `output`, or a default that is called `name`."""
    from windsysid.output.folders import claim, is_free

    if output is None and json:
        return Destination(None, lambda _: None)
    folder = output or next(folder for folder in numbered(name) if overwrite or is_free(folder))
    return Destination(folder, context.with_resource(claim(folder, overwrite=overwrite, inputs=inputs)))


def results_of(folders: Sequence[Path], *commands: str, least: int = 1) -> list[Path]:
    """Those of several folders that one of some commands wrote, each record and section once; a line names the others.

    If more of them are of one command than of the other, only these are taken. If fewer than `least` remain, all are
    returned.
    """
    from windsysid.output.folders import written_by

    writers = {folder: written_by(folder) for folder in folders}
    counts = Counter(writers.values())
    most = max(map(counts.__getitem__, commands))
    wanted = list(filter(lambda command: counts[command] == most, commands))
    left, known = dict[Path, str](), dict[str, Path]()
    for folder, command in writers.items():
        if command in wanted:
            twin = known.setdefault(_data_of(folder), folder)
            if twin is not folder:
                left[folder] = f"same record as {twin.name}"
        elif folder.exists():
            left[folder] = {"": "no result"}.get(command, command)
    if len(writers) - len(left) < least or not known:
        return list(folders)
    _name_folders(left, wanted)
    return [folder for folder in writers if folder not in left]


def compared(folders: Sequence[Path]) -> list[Path]:
    """Those of several folders whose results can be compared with that of the first one, which stays."""
    from windsysid.output.folders import written_by

    command = written_by(folders[0])
    return results_of(folders, command, least=2) if command in ("identify", "oma") else list(folders)


def kept_of(folders: Sequence[Path], command: str) -> list[Path]:
    """Those of the folders that a user named which a command must not overwrite: all but its own earlier results."""
    from windsysid.output.folders import written_by

    return [folder for folder in folders if written_by(folder) != command]


def _data_of(folder: Path) -> str:
    """Hash and name of the record of a result, and its section; the folder where there is no hash."""
    from windsysid.output.folders import summary_of

    summary = summary_of(folder)
    known = {**(summary.get("provenance") or {}), **summary}
    return f"{known.get('record_hash') or folder} {known.get('record')} {known.get('section')}"


def _name_folders(left: dict[Path, str], wanted: Sequence[str]) -> None:
    """Name folders that were left out, with the reason of each, on standard error."""
    listed = [f"{folder} ({why})" for folder, why in left.items()]
    more = f" and {len(left) - MAX_LISTED} more" * (len(left) > MAX_LISTED)
    told = f"left out of the results of {' and '.join(wanted)}: {', '.join(listed[:MAX_LISTED])}{more}"
    if left:
        print(printable(told), file=sys.stderr)


def numbered(name: str, ending: str = "") -> Iterator[Path]:
    """Paths below ``results``: ``NAME``, ``NAME-2``, ``NAME-3`` … with an ending."""
    return (Path("results") / f"{name}{'' if number == 1 else f'-{number}'}{ending}" for number in count(1))


def name_of(source: str | Path, command: str = "") -> str:
    """Name of the results of a file, folder or packaged turbine: without folder and ending, and with the command."""
    path = Path(source).resolve()
    stem = path.name if path.is_dir() else path.stem
    return f"{stem or 'results'}-{command}" if command else stem


class _Answer(Protocol):
    def to_json(self) -> str: ...

    def contents(self) -> "Sequence[Table | str]": ...

    def files(self) -> dict[str, bytes]: ...


def print_answer(found: _Answer, *, json: bool, verbose: bool) -> None:
    """Print an answer as JSON, as a whole, or as its first screen."""
    from windsysid.cli.screen import first_screen

    print_unsaved(found.to_json().rstrip() if json else found if verbose else first_screen(found.contents()))


def print_unsaved(text: object) -> None:
    """Print what is saved next, also if whoever reads the output has seen enough, as ``head`` has."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_and_save(found: _Answer, to: Destination, *, json: bool = False, verbose: bool = False) -> None:
    """Print an answer, or its first screen, then save it with its report, so that it is shown even if saving fails."""
    print_answer(found, json=json, verbose=verbose)
    if to.folder is not None:
        with show_progress("report") as progress:
            progress("writing the report")
            to.write(found.files())
        if not json:
            print(f"results: {printable(to.folder / 'report.html')}")


def rotor_speeds(option: str, given: tuple[str, str] | None) -> tuple[float, float] | None:
    """Two rotor speeds with their units, in rad/s."""
    return None if given is None else (parse_option(option, given[0], "rad/s"), parse_option(option, given[1], "rad/s"))


@contextmanager
def show_progress(title: str) -> Iterator["Shown"]:
    """Report progress and the time left on standard error: on a terminal, nothing in a pipe."""
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

"""The command that walks from a file to an answer: units, names, section, turbine, result, and the command again."""

import os
import shlex
import sys
import webbrowser
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from windsysid.cli.common import Mapping, app, name_of, numbered, print_table, register_commands, show_progress
from windsysid.errors import ConfigurationError, RecordError, WindsysidError
from windsysid.output.console import printable

if TYPE_CHECKING:
    from windsysid.inspection.proposal import Guess, MappingProposal

__all__ = []

NO_TURBINE = "none"
LEAVE_OUT = "-"
MAX_FINDINGS = 4


@app.command()
def start(
    record: Annotated[Path, typer.Argument(help="CSV, Parquet, netCDF, MATLAB, TDMS, OpenFAST … (docs/records.md).")],
    turbine: Annotated[
        str | None, typer.Option(help="A packaged turbine, a TOML file, or none (modes only). Asked for by default.")
    ] = None,
    mapping: Mapping = None,
    yes: Annotated[
        bool, typer.Option("--yes", metavar="", help="Take defaults without questions; units have no default.")
    ] = False,
) -> None:
    """Begin here: read a file, identify the turbine step by step, and print the command that repeats it."""
    from windsysid.records.formats.access.files import check_input

    check_input(record)
    guide = _Guide(yes)
    machine = _turbine(turbine) if turbine else _ask_turbine(guide)
    mapping = mapping or _write_mapping(record, machine, guide)
    options = ["--mapping", str(mapping)] if mapping else []
    options += _section(record, mapping, machine, guide)
    modes_only = machine == NO_TURBINE
    words = ["oma", str(record)] if modes_only else ["identify", str(record), "--turbine", machine]
    page = _run([*words, *options], name_of(record, "oma" if modes_only else ""))
    if not yes and _has_display():
        webbrowser.open(page.as_uri())
    print(printable(f"again: {shlex.join(['windsysid', *words, *options])}"))


def _run(words: list[str], name: str) -> Path:
    """Run a command, with its results in the first free folder of a name; the path of its page."""
    from windsysid.output.folders import is_free

    folder = next(path for path in numbered(name) if is_free(path))
    print(f"\n{printable(shlex.join(['windsysid', *words]))}\n")
    register_commands(words[0])
    typer.main.get_command(app).main([*words, "--output", str(folder)], "windsysid", standalone_mode=False)
    return (folder / "report.html").resolve()


def _ask_turbine(guide: "_Guide") -> str:
    """Prompt for the turbine."""
    from windsysid.turbine.file import packaged_turbines

    if not guide.yes:
        print(f"Packaged turbines: {', '.join(packaged_turbines())}")
    name: str = guide.ask(f"Turbine, a .toml file, or {NO_TURBINE} for modes only", _turbine, default=NO_TURBINE)
    return name


class _Guide(NamedTuple):
    """Questions on the terminal; with `yes`, defaults."""

    yes: bool

    def ask(
        self, question: str, parse: Callable[[str], Any], *, default: str | None = None, offered: str | None = None
    ) -> Any:
        """The answer as `parse` makes it, prompted again if that refuses.

        Parameters
        ----------
        default
            Taken with `yes` or an empty answer; None where no answer is safe.
        offered
            Taken with an empty answer only.
        """
        if self.yes:
            if default is None:
                raise ConfigurationError(
                    f"start --yes: no safe default: {question}; leave --yes out, or give --mapping"
                )
            return parse(default)
        hint = default if default is not None else offered
        while True:
            print(printable(f"{question}{'' if hint is None else f' [{hint}]'}: "), end="", flush=True)
            line = sys.stdin.readline()
            if not line:
                raise ConfigurationError(f"start: the answers ended at: {question}")
            try:
                return parse(line.strip() or hint or "")
            except WindsysidError as error:
                print(printable(error))


def _write_mapping(record: Path, turbine: str, guide: _Guide) -> Path | None:
    """Write the mapping that a record needs, with the units that were requested; None where it needs none."""
    from windsysid.inspection.proposal import propose_mapping

    with show_progress("start") as progress:
        progress(f"reading {record}")
        found = propose_mapping(record)
    print(f"{found.record}: {found.remarks[0] if found.remarks else ''}".rstrip(": "))
    known = _channels_of(turbine)
    if not _asks(found, known):
        return None
    rows = [(guess.written, guess.name or "?", guess.unit or "?") for guess in found.guesses]
    print_table(("in the file", "name", "unit"), rows, "Channels")
    found = _complete(found, known, turbine, guide)
    target = _write_once(f"{name_of(record)}-mapping", found.to_toml().encode())
    print(printable(f"mapping: {target}"))
    return target


def _asks(found: "MappingProposal", known: list[str]) -> bool:
    """Test whether a record needs a mapping, or the turbine knows none of its channels."""
    heard = not known or any((guess.name or guess.written) in known for guess in found.guesses)
    return not found.optional and not (found.timed and heard and not any(map(_needs_line, found.guesses)))


def _needs_line(guess: "Guess") -> bool:
    """Test whether a mapping has to give the name or unit of a channel."""
    return not guess.is_said or guess.name not in (None, guess.written)


def _write_once(name: str, content: bytes) -> Path:
    """Write a TOML file in this folder under a free name, unless one that has this content is there."""
    from windsysid.output.files import claim_file

    names = (Path(path.name) for path in numbered(name, ".toml"))
    target = next(path for path in names if not os.path.lexists(path) or _holds(path, content))
    if not os.path.lexists(target):
        with claim_file(target) as write:
            write(lambda file: file.write(content))
    return target


def _holds(path: Path, content: bytes) -> bool:
    """Test whether a path is a file with this content."""
    return path.is_file() and path.read_bytes() == content


def _channels_of(turbine: str) -> list[str]:
    """Channels that a turbine knows."""
    from windsysid.turbine.file import load_turbine

    return [] if turbine == NO_TURBINE else [sensor.channel for sensor in load_turbine(turbine).sensors]


def _complete(found: "MappingProposal", known: list[str], turbine: str, guide: _Guide) -> "MappingProposal":
    """The proposal with sampling rate and units that the file does not say."""
    from windsysid.records.formats.contents.mapping import TimeRule

    if not found.timed:
        rate = guide.ask("Samples per second, since the file gives no times [Hz]", _positive)
        found = replace(found, timed=True, given=replace(found.given, time=TimeRule(rate=rate)))
    if known and any(guess.name is None for guess in found.guesses):
        print(f"Channels that {turbine} knows: {', '.join(known)}, rotor_speed, rotor_azimuth")
        print("(of a tower x is side-side, z fore-aft)")
    guesses: list[Guess] = []
    for guess in found.guesses:
        sure = {one.name for one in found.guesses if one.name and not one.axis}
        taken = {one.name or one.written for one in guesses} | sure
        done = _complete_guess(guess, known, taken, guide)
        guesses += [done] if done.unit != LEAVE_OUT else []
    _refuse_unknown(guesses, known, turbine, guide)
    return replace(found, guesses=tuple(guesses))


def _refuse_unknown(guesses: "list[Guess]", known: list[str], turbine: str, guide: _Guide) -> None:
    """Refuse channels of which the turbine knows none."""
    if known and not any(guess.name in known for guess in guesses):
        asked = "leave --yes out to name them" if guide.yes else "give one of them such a name"
        raise ConfigurationError(
            f"start: no channel has a name that {turbine} knows: expected {' or '.join(known)}; {asked}, or take "
            f"--turbine {NO_TURBINE} for modes only"
        )


def _complete_guess(guess: "Guess", known: list[str], taken: set[str], guide: _Guide) -> "Guess":
    """A channel with the name that a turbine knows and no other channel has, where it has none, and with its unit."""
    at_top = (guess.name or "").replace("nacelle_", "tower_")  # a tower's model ends there
    if guess.name not in known and at_top in known and at_top not in taken:
        guess = replace(guess, name=at_top)
    described = printable(f"'{guess.written}': {'; '.join((*guess.evidence, *guess.doubts))}")
    if guess.axis and known:
        print(described)
        described = ""
    guess = replace(guess, name=_name(guess, known, taken, guide), axis="")
    unit = partial(_unit, guess.name or guess.written)
    guess = _without_unsuitable_unit(guess, unit)
    if guess.is_said:
        return guess
    print(described, end="\n" * bool(described))
    question = f"Unit of '{guess.written}' (g, mg, m/s^2, rpm …; {LEAVE_OUT} leaves it out)"
    return replace(guess, unit=guide.ask(question, unit, offered=guess.unit), doubts=())


def _name(guess: "Guess", known: list[str], taken: set[str], guide: _Guide) -> str | None:
    """Name of a channel, requested where it has none or only its axis gives the direction."""

    def free(name: str) -> str:
        if name in taken:
            raise ConfigurationError(f"another channel is called {name} already")
        return name

    name: str | None = None if guess.axis else guess.name
    if known and guess.axis:
        offered = next((one for one in (guess.name, *known) if one in known and one not in taken), guess.written)
        name = guide.ask(f"Name of '{guess.written}', of which only the axis is given", free, offered=offered)
    elif known and name is None:
        name = guide.ask(f"Name of '{guess.written}'", free, default=guess.written)
    return name


def _without_unsuitable_unit(guess: "Guess", accept: Callable[[str], str]) -> "Guess":
    try:
        accept(guess.unit or LEAVE_OUT)
    except RecordError:
        return replace(guess, unit=None, evidence=())
    return guess


def _section(record: Path, mapping: Path | None, turbine: str, guide: _Guide) -> list[str]:
    """Options that take the best section of a record; none for all of it."""
    from windsysid.inspection import inspect_record
    from windsysid.records.formats import read_record
    from windsysid.turbine.file import load_turbine

    with show_progress("start") as progress:
        progress(f"inspecting {record}")
        read = read_record(record, mapping=mapping)
        found = inspect_record(read, None if turbine == NO_TURBINE else load_turbine(turbine))
    print(printable(f"inspection: {found.verdict}"))
    for channels, severity, text in found.finding_rows()[:MAX_FINDINGS]:
        print(printable(f"  {severity}, {channels}: {text}"))
    good = [one for one in found.proposals if one.good]
    if not good or good[0].end - good[0].start >= read.duration:
        return []
    best = f"{good[0].start:g} {good[0].end:g}"
    chosen: list[str] = guide.ask("Section to use [s], two numbers, or all", _two_numbers, default=best)
    return ["--section", *chosen] if chosen else []


def _turbine(text: str) -> str:
    """The name of a turbine that can be loaded, or none."""
    from windsysid.turbine.file import load_turbine

    if text != NO_TURBINE:
        load_turbine(text)
    return text


def _unit(channel: str, text: str) -> str:
    """A unit that is known and suits a channel's name, or the mark of a channel to leave out."""
    from windsysid.records.quantities import check_quantity
    from windsysid.units import canonical

    if not text:
        raise ConfigurationError(f"expected a unit, such as m/s^2 or g, or {LEAVE_OUT} to leave the channel out")
    if text != LEAVE_OUT:
        check_quantity(channel, text := canonical(text))
    return text


def _positive(text: str) -> float:
    """A positive number."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e9:
        raise ConfigurationError(f"expected a number above 0, got '{text}'")
    return value


def _two_numbers(text: str) -> list[str]:
    """Begin and end of a section as options; none for all of a record."""
    if text == "all":
        return []
    try:
        begin, end = map(float, text.split())
    except ValueError:
        raise ConfigurationError(f"expected two numbers, such as 0 600, or all; got '{text}'") from None
    return [f"{begin:g}", f"{end:g}"]


def _has_display() -> bool:
    """Test whether a browser can be shown to a user at a terminal."""
    shown = sys.platform in ("darwin", "win32") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
    return shown and sys.stdout.isatty()

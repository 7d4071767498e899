"""Usage errors of the command line in one line: what was expected, what was given, what to do."""

import inspect
from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

import typer

from windsysid.cli.common import COMMANDS, PACKAGED, app

__all__ = ["UsageError", "usage_line"]

UsageError: type[Exception] = typer.BadParameter.__bases__[0]
"""Base class of usage errors: Typer uses Click, or its own copy of it, depending on its version."""
MIN_SIMILARITY = 0.7
"""Setting: smallest ratio of `difflib` at which a known name is offered instead of an unknown one."""
_KINDS = {float: "a number", int: "a whole number", Path: "a path"}


def usage_line(error: Any, arguments: Sequence[str]) -> str:
    """Describe a usage error of the command line.

    Parameters
    ----------
    error
        A `UsageError`.
    arguments
        The command and what was typed after it.
    """
    command = getattr(typer.main.get_command(app), "commands", {}).get("".join(arguments[:1]))
    if command is None:
        return _before_command(*arguments[:1])
    context = command.make_context(f"windsysid {arguments[0]}", [], resilient_parsing=True)
    lines = {
        "MissingParameter": _missing, "NoSuchOption": _unknown_option, "BadOptionUsage": _without_value,
        "BadParameter": _wrong_value,
    }  # fmt: skip
    line = lines.get(type(error).__name__, _too_many)
    return f"{arguments[0]}: {line(error, context, list(arguments[1:]))}"


def _before_command(given: str = "") -> str:
    """Unknown command, or an option in front of the command."""
    if given.startswith("-"):
        return f"no option {given} before a command: options follow it, such as windsysid inspect RECORD {given}"
    if Path(given).exists():
        return f"no command '{given}': expected one before the file: windsysid start {given}"
    return f"no command '{given}': {_instead(given, COMMANDS)}windsysid --help lists all commands"


def _missing(error: Any, context: Any, _: list[str]) -> str:
    """A required option or argument that is missing, and the shortest command that has it."""
    return f"{_name(error.param)} is missing: expected {_described(error.param)}. Type: {_shortest(context)}"


def _unknown_option(error: Any, context: Any, _: list[str]) -> str:
    """An option that the command does not have."""
    known = [name for one in context.command.params for name in one.opts]
    return (
        f"no option {error.option_name}: {_instead(error.option_name, known)}{context.command_path} --help lists all"
        " options"
    )


def _without_value(error: Any, context: Any, _: list[str]) -> str:
    """An option without its value or values, or a flag with a value."""
    option = next(one for one in context.command.params if error.option_name in one.opts)
    expected = "no value" if option.is_flag else _expected(context, option)
    return f"{error.option_name}: expected {expected}; see {context.command_path} --help"


def _wrong_value(error: Any, context: Any, arguments: list[str]) -> str:
    """A value that is no number, no choice or out of range."""
    given = context.command.make_parser(context).parse_args(args=arguments)[0].get(error.param.name, "")
    text = given if isinstance(given, str) else " ".join(map(str, given))
    expected = _expected(context, error.param)
    return f"{_name(error.param)}: expected {expected}, got '{text}'; see {context.command_path} --help"


def _too_many(error: Any, context: Any, arguments: list[str]) -> str:
    """More arguments than the command takes."""
    extra = context.command.make_parser(context).parse_args(args=arguments)[1]
    if not extra:
        return str(error.format_message())
    return f"too many arguments: '{extra[-1]}'; a name with spaces needs quotes. Expected: {_shortest(context)}"


def _name(param: Any) -> str:
    """Name of an option or argument as the help shows it."""
    if param.param_type_name == "argument":
        return str(param.metavar or param.name).upper()
    return str(max(param.opts, key=len))


def _described(param: Any) -> str:
    """Help of an option or argument inside a sentence, with the names of the packaged turbines."""
    text = str(param.help).rstrip(".")
    if PACKAGED in text:
        from windsysid.turbine.file import packaged_turbines

        text = text.replace(PACKAGED, ", ".join(packaged_turbines()))
    first, _, rest = text.partition(" ")
    return f"{first.lower()} {rest}" if first[1:].islower() else text


def _expected(context: Any, param: Any) -> str:
    """Values that an option or argument takes, from its annotation."""
    hints = get_type_hints(inspect.unwrap(context.command.callback), include_extras=True)
    annotation, *told = get_args(hints[param.name])
    kind = _kind(annotation)
    low, high = (getattr(told[0], end, None) for end in ("min", "max"))
    if PACKAGED in param.help:
        return _described(param)
    if low is None:
        return f"{kind} ({param.metavar})" if param.metavar and "one of" not in kind else kind
    return f"{kind} of at least {low:g}" if high is None else f"{kind} from {low:g} to {high:g}"


def _kind(annotation: Any) -> str:
    """Kind of values of an annotation."""
    inner = [one for one in get_args(annotation) if one is not type(None)]
    if get_origin(annotation) is Literal:
        return f"one of {', '.join(inner)}"
    if get_origin(annotation) is tuple:
        return "two numbers" if inner[0] is float else "two values"
    return _kind(inner[0]) if inner else _KINDS.get(annotation, "a value")


def _shortest(context: Any) -> str:
    """The command with all that it requires."""
    words = [context.command_path]
    for param in sorted(context.command.params, key=lambda one: str(one.param_type_name)):
        if param.required:
            name = _name(param)
            words += [name] if param.param_type_name == "argument" else [name, param.metavar or "NAME"]
    return " ".join(words)


def _instead(name: str, known: Iterable[str]) -> str:
    """The known name that is most similar to a mistyped one, as a question; empty if none is similar."""
    return "".join(f"did you mean {near}? " for near in get_close_matches(name, known, 1, MIN_SIMILARITY))

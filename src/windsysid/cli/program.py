"""The command line as a program: start, errors and exit codes."""

import logging
import os
import re
import signal
import sys
from typing import Annotated, NoReturn

import typer

from windsysid._version import __version__
from windsysid.cli.common import app, register_commands
from windsysid.cli.usage import UsageError, usage_line
from windsysid.errors import WindsysidError
from windsysid.output.console import printable, show_what_can_be_shown

__all__ = ["app", "main"]

_ARGUMENT = re.compile(r"(?<![\w./'=-])([a-z_]+)=(?:'([\w-]+)'|True)?(?=[\s;:,.)]|$)")
"""An argument of a Python function in a message: ``rate=``, ``formulation='joint'``, ``overwrite=True``."""


def main() -> None:
    """Run the command line: bad input ends in one line on standard error and exit code 2."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # ends as Ctrl-C does: nothing half done is left
    show_what_can_be_shown()
    try:
        code = _run()
    except WindsysidError as error:
        _refuse(_name_options(str(error)))
    except UsageError as error:
        _refuse(usage_line(error, sys.argv[1:]))
    except BrokenPipeError:  # whoever read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        path = str(error.filename or "")
        where = f"{path if len(path) <= 80 else f'…{path[-80:]}'}: " if path else ""
        _refuse(f"{where}{error.strerror or error}: check the path, its permissions and the space left")
    except MemoryError as error:
        _refuse(f"out of memory ({error}): take a shorter record, --section, a lower --rate, or --in-pieces")
    sys.exit(code)


def _run() -> int:
    """Run the command that was typed; its exit code."""
    try:
        register_commands(*sys.argv[1:2])
        return app(prog_name="windsysid", standalone_mode=False) or 0
    except typer.Abort:
        return 130
    finally:
        sys.stdout.flush()


def _name_options(message: str) -> str:
    """Replace the arguments of Python functions in a message by those options that the command has."""
    commands = getattr(typer.main.get_command(app), "commands", {})
    options = {name for one in sys.argv[1:2] if one in commands for at in commands[one].params for name in at.opts}

    def option(match: re.Match[str]) -> str:
        name = f"--{match[1].replace('_', '-')}"
        return match[0] if name not in options else f"{name} {match[2]}" if match[2] else name

    first = f"--{message.partition(':')[0].replace('_', '-')}"
    message = f"{first}:{message.partition(':')[2]}" if first in options else message
    return _ARGUMENT.sub(option, message)


def _refuse(message: str) -> NoReturn:
    """Report an error in one line."""
    print(f"windsysid: {printable(' '.join(message.split()))}", file=sys.stderr)
    sys.exit(2)


@app.callback(invoke_without_command=True)
def _options(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", metavar="", help="Print the version and stop.")] = False,
) -> None:
    if version:
        print(f"windsysid {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("windsysid: %(message)s"))
    logger = logging.getLogger("windsysid")
    logger.handlers = [handler]
    logger.setLevel(logging.INFO)

"""The command line: reads options, calls the library, prints. Each command imports the heavy modules that it needs."""

from typing import Any

from windsysid.cli.common import register_commands
from windsysid.cli.program import main

__all__ = ["main"]


def __getattr__(name: str) -> Any:
    """Return the program `app` with all of its commands; a command that is run imports its own module only."""
    if name != "app":
        raise AttributeError(f"module 'windsysid.cli' has no attribute '{name}'")
    register_commands()
    from windsysid.cli.common import app

    return app

"""The command line: reads options, calls the library, prints. Heavy modules are imported by the command that needs them."""

from windsysid.cli import answers, identify, records  # noqa: F401  they register their commands
from windsysid.cli.program import app, main

__all__ = ["app", "main"]

"""The command line: reads options, calls the library, prints. Each command imports the heavy modules that it needs."""

from windsysid.cli import answers, fleet, identify, live, oma, publish, records, start  # noqa: F401  registers commands
from windsysid.cli.program import app, main

__all__ = ["app", "main"]

"""Where the pages and figures of answers come from."""

from importlib import import_module
from typing import Any

__all__ = ["pages"]


def pages() -> Any:
    """`windsysid.reports`, imported when somebody asks for one: ``fragment``, ``files`` and ``figure``."""
    return import_module("windsysid.reports")

"""Source of the pages and figures of answers."""

from importlib import import_module
from typing import Any

__all__ = ["pages"]


def pages() -> Any:
    """`windsysid.reports`, imported at first use: ``fragment``, ``files`` and ``figure``."""
    return import_module("windsysid.reports")

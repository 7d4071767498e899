"""Where the pages and figures of answers come from: a room above them, which the root of the package names."""

from collections.abc import Callable
from typing import Any

__all__ = ["pages", "take_pages_from"]

_find: list[Callable[[], Any]] = []


def take_pages_from(find: Callable[[], Any]) -> None:
    """Say how to import the room of the pages when somebody asks for one."""
    _find[:] = [find]


def pages() -> Any:
    """The room of the pages: a module with ``fragment``, ``files`` and ``figure`` (`windsysid.reports`)."""
    return _find[0]()

"""Text for a terminal or a notebook: the one place that knows Rich's console."""

from typing import Any

__all__ = ["render"]


def render(*parts: Any, width: int = 120) -> str:
    """Rich tables and plain lines as text."""
    from rich.console import Console

    console = Console(width=width, color_system=None, highlight=False, markup=False, soft_wrap=True)
    with console.capture() as capture:
        for part in parts:
            console.print(part)
    return capture.get().rstrip("\n")

"""TOML of a user's as plain values; whatever is wrong with it becomes one ValueError."""

import tomllib
from typing import Any

__all__ = ["parse_toml"]


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises
    ------
    ValueError
        In one line, if it is no TOML, or nested deeper than Python can follow.
    """
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("tables or arrays nested too deeply") from None

"""Parsing of TOML and JSON from outside into plain values; every fault becomes a ValueError of one line."""

import json
import os
import re
import stat
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from windsysid.errors import ConfigurationError, unreadable

__all__ = ["parse_json", "parse_toml", "read_tables", "read_toml", "special_file_kind"]

MAX_TOML_CHARACTERS = 1 << 21
"""Largest length of a TOML text; the file of a fleet of 10 000 turbines has 1.5 million characters."""

MAX_KEY_PARTS = 32
"""Largest number of parts of a dotted key; windsysid's own have three. The time of `tomllib` grows with its square."""

_PART = r"""(?:"(?:[^"\\\n]|\\.){0,200}+"|'[^'\n]{0,200}+'|(?<![A-Za-z0-9_-])[A-Za-z0-9_-]++)"""
_LONG_KEY = re.compile(rf"(?:{_PART}[ \t]*+\.[ \t]*+){{{MAX_KEY_PARTS}}}")

_KINDS = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"}


def special_file_kind(path: str | Path) -> str:
    """Kind of a path whose reading may never end, such as a pipe; empty for any other path."""
    try:
        return _KINDS.get(stat.S_IFMT(os.stat(path).st_mode), "")
    except (OSError, ValueError):  # opening the path raises the error that fits
        return ""


def _utf_8(data: bytes) -> str:
    return data.decode("utf-8-sig")


def read_toml(path: Path, decode: Callable[[bytes], str] = _utf_8) -> str:
    """Read the text of a TOML file, which is UTF-8 with or without a byte-order mark unless `decode` is given.

    Raises
    ------
    OSError, ValueError
        If the file cannot be read or decoded, or is a pipe, a device or a socket.
    """
    kind = special_file_kind(path)
    if kind:
        raise ValueError(f"it is {kind}, expected a file")
    with path.open("rb") as file:
        return decode(file.read(4 * MAX_TOML_CHARACTERS))


def read_tables(path: Path, expected: str, decode: Callable[[bytes], str] = _utf_8) -> dict[str, Any]:
    """Read the tables of a TOML file of an expected kind; ConfigurationError if there are none."""
    try:
        return parse_toml(read_toml(path, decode))
    except (OSError, ValueError) as error:
        raise ConfigurationError(unreadable(path, expected, error)) from error


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a TOML text into its tables.

    Raises
    ------
    ValueError
        If it is no TOML, is longer than `MAX_TOML_CHARACTERS`, or is nested deeper than Python can follow.
    """
    if len(text) > MAX_TOML_CHARACTERS:
        raise ValueError(f"more than {MAX_TOML_CHARACTERS} characters, expected a short text")
    if _LONG_KEY.search(text):
        raise ValueError(f"a dotted key of more than {MAX_KEY_PARTS} parts")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("tables or arrays nested too deeply") from None


def parse_json(text: str | bytes) -> Any:
    """Parse a JSON text.

    Raises
    ------
    ValueError
        If it is no JSON, or is nested deeper than Python can follow.
    """
    try:
        return json.loads(text)
    except RecursionError:
        raise ValueError("objects or arrays nested too deeply") from None

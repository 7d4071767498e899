"""TOML and JSON from outside as plain values; whatever is wrong with it becomes one ValueError."""

import json
import os
import re
import stat
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

__all__ = ["irregular", "parse_json", "parse_toml", "read_toml"]

MAX_TOML_LENGTH = 1 << 21
"""Characters of a TOML text; the file of a fleet of 10 000 turbines has 1.5 million."""

MAX_KEY_PARTS = 32
"""Parts of a dotted key; windsysid's own keys have three. The time that `tomllib` takes grows with their square."""

_PART = r"""(?:"(?:[^"\\\n]|\\.){0,200}+"|'[^'\n]{0,200}+'|(?<![A-Za-z0-9_-])[A-Za-z0-9_-]++)"""
_LONG_KEY = re.compile(rf"(?:{_PART}[ \t]*+\.[ \t]*+){{{MAX_KEY_PARTS}}}")

_KINDS = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device"}


def irregular(path: str | Path) -> str:
    """Name the kind of a path that reading could wait for without end, such as a pipe; empty for any other path."""
    try:
        return _KINDS.get(stat.S_IFMT(os.stat(path).st_mode), "")
    except (OSError, ValueError):  # opening the path raises the error that fits
        return ""


def _utf_8(data: bytes) -> str:
    return data.decode("utf-8-sig")


def read_toml(path: Path, decode: Callable[[bytes], str] = _utf_8) -> str:
    """Read the text of a TOML file, in UTF-8 (with or without a byte-order mark) unless another `decode` is given.

    Raises
    ------
    OSError, ValueError
        If it cannot be read, is no regular file, or cannot be decoded.
    """
    kind = irregular(path)
    if kind:
        raise ValueError(f"it is {kind}, expected a file")
    with path.open("rb") as file:
        return decode(file.read(4 * MAX_TOML_LENGTH))


def parse_toml(text: str) -> dict[str, Any]:
    """Parse a TOML text into its tables.

    Raises
    ------
    ValueError
        In one line, if it is no TOML, is longer than `MAX_TOML_LENGTH`, or is nested deeper than Python can follow.
    """
    if len(text) > MAX_TOML_LENGTH:
        raise ValueError(f"more than {MAX_TOML_LENGTH} characters, expected a short text")
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

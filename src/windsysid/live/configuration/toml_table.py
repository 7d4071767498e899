"""One table of a settings file: keys are taken out of it one by one, and every fault is noted instead of raised."""

import difflib
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from windsysid.errors import ConfigurationError
from windsysid.live.sources.cutting import moment_ns
from windsysid.units import parse_quantity

__all__ = ["Secret", "TomlTable"]

_MAX_SECRET_CHARACTERS = 4096
_MAX_SHOWN_CHARACTERS = 40
MAX_KEYS_SHOWN = 3
"""Setting: largest number of unknown keys of a table that a fault names."""


@dataclass(frozen=True)
class Secret:
    """Password or token, which is never printed."""

    value: str = field(repr=False)


class TomlTable:
    """Reads the keys of a table, each with its kind and its bounds.

    What is wrong is a line in `faults`, and the default stands in for the value, so that all faults are found at once.

    Parameters
    ----------
    where
        File and table, as the lines begin.
    given
        The table as it was parsed.
    folder
        What relative paths begin at.
    """

    def __init__(self, where: str, given: Any, folder: Path, faults: list[str]) -> None:
        self.where, self.folder, self.faults = where, folder, faults
        self.known: list[str] = []
        self.given: dict[str, Any] = {}
        if isinstance(given, dict):
            self.given = given
        else:
            self.fault(f"expected a table, got {_shown(given)}")

    def fault(self, what: str) -> None:
        """Note a fault."""
        self.faults.append(f"{self.where}: {what}")

    def value(self, key: str, expected: str, right: Callable[[Any], bool], default: Any, needed: bool = False) -> Any:
        """The value of a key if it is right, otherwise its default."""
        self.known.append(key)
        if key not in self.given:
            if needed:
                self.fault(f"{key} is missing: expected {expected}")
            return default
        got = self.given[key]
        if right(got):
            return got
        self.fault(f"{key}: expected {expected}, got {_shown(got)}")
        return default

    def text(self, key: str, default: str = "", *, expected: str = "a text in quotes", needed: bool = False) -> str:
        """A text that is not empty."""
        found: str = self.value(key, expected, lambda it: isinstance(it, str) and bool(it.strip()), default, needed)
        return found

    def choice(self, key: str, choices: Sequence[str], default: str = "") -> str:
        """One of several words; needed where there is no default."""
        listed = list(choices)
        found: str = self.value(key, f"one of {', '.join(listed)}", lambda it: it in listed, default, not default)
        return found

    def number(self, key: str, default: float, low: float, high: float) -> float:
        """A finite number of `low` to `high`."""

        def right(it: Any) -> bool:
            return isinstance(it, int | float) and not isinstance(it, bool) and low <= it <= high and math.isfinite(it)

        return float(self.value(key, f"a number of {low:g} to {high:g}", right, default))

    def whole(self, key: str, default: int | None, low: int, high: int) -> int | None:
        """A whole number of `low` to `high`."""

        def right(it: Any) -> bool:
            return isinstance(it, int) and not isinstance(it, bool) and low <= it <= high

        found: int | None = self.value(key, f"a whole number of {low} to {high}", right, default)
        return found

    def time(self, key: str, default: str, low: str, high: str) -> float:
        """A time with its unit [s]."""
        least, most = parse_quantity(low, "s"), parse_quantity(high, "s")

        def right(it: Any) -> bool:
            try:
                return isinstance(it, str) and least <= parse_quantity(it, "s") <= most
            except ConfigurationError:
                return False

        found = self.value(key, f'a time of "{low}" to "{high}", with its unit', right, default)
        return parse_quantity(found, "s")

    def moment(self, key: str) -> int | None:
        """A moment with its zone [ns since 1970]; None where there is none."""

        def right(it: Any) -> bool:
            try:
                return bool(moment_ns(it))
            except (ConfigurationError, TypeError, AttributeError):
                return False

        found = self.value(key, 'a moment with its zone in quotes, such as "2026-01-05T12:00:00Z"', right, "")
        return moment_ns(found) if found else None

    def path(self, key: str, *, needed: bool = False, exists: str = "") -> Path | None:
        """A path, absolute; where `exists` says ``file`` or ``folder``, one that is there."""
        named = self.text(key, expected="a path in quotes", needed=needed)
        if not named:
            return None
        path = (self.folder / named).resolve()
        if exists and not (path.is_file() if exists == "file" else path.is_dir()):
            self.fault(f"{key}: expected a {exists} that is there, got '{path}'")
        return path

    def url(self, key: str, schemes: Sequence[str], *, needed: bool = True, hint: str = "a key password_file") -> str:
        """A URL without a password in it."""

        def right(it: Any) -> bool:
            return isinstance(it, str) and it.startswith(tuple(f"{s}://" for s in schemes)) and _host(it)

        expected = f"a URL that begins with {' or '.join(f'{scheme}://' for scheme in schemes)} and names a host"
        found: str = self.value(key, expected, right, "", needed)
        if found and urlsplit(found).password is not None:
            self.fault(f"{key}: holds a password: take it out, and give it by {hint}")
            return ""
        return found

    def secret(self, key: str) -> Secret | None:
        """Secret from the file that `key_file` names, or the environment variable that `key_env` names."""
        path = self.path(f"{key}_file")
        variable = self.text(f"{key}_env", expected="the name of an environment variable in quotes")
        if path is not None and variable:
            self.fault(f"{key}_file and {key}_env: expected one of them, got both")
            return None
        if path is not None:
            return self._secret_of(f"{key}_file", path)
        if not variable:
            return None
        if not os.environ.get(variable):
            self.fault(f"{key}_env: the environment variable '{variable}' is not set: set it for the service")
            return None
        return Secret(os.environ[variable])

    def _secret_of(self, key: str, path: Path) -> Secret | None:
        try:
            with path.open(encoding="utf-8") as file:
                text = file.read(_MAX_SECRET_CHARACTERS).strip()
        except (OSError, ValueError) as error:
            why = getattr(error, "strerror", None) or "it is not a text file"
            self.fault(f"{key}: '{path}' cannot be read ({why}): make it a text file that the service may read")
            return None
        if not text:
            self.fault(f"{key}: '{path}' is empty: expected the secret in it")
            return None
        return Secret(text)

    def tables(self, key: str, headed: str) -> list["TomlTable"]:
        """The tables of a list such as ``[[turbine]]``."""
        listed = self.value(key, f"tables [[{headed}]]", lambda it: isinstance(it, list), [])
        return [
            TomlTable(f"{self.where}: [[{headed}]] {i}", table, self.folder, self.faults)
            for i, table in enumerate(listed, 1)
        ]

    def table(self, key: str) -> "TomlTable":
        """A table such as ``[page]``; empty where there is none."""
        self.known.append(key)
        return TomlTable(f"{self.where}: [{key}]", self.given.get(key, {}), self.folder, self.faults)

    def done(self) -> None:
        """Note the unknown keys of the table as one fault."""
        unknown = [key for key in self.given if key not in self.known]
        near = [(key, difflib.get_close_matches(key, self.known, 1)) for key in unknown[:MAX_KEYS_SHOWN]]
        shown = [
            f"'{key[:_MAX_SHOWN_CHARACTERS]}'" + "".join(f" (meant '{one}'?)" for one in found) for key, found in near
        ]
        if unknown:
            more = f" and {len(unknown) - len(shown)} more" if len(unknown) > len(shown) else ""
            keys = "key" if len(unknown) == 1 else "keys"
            self.fault(f"unknown {keys} {', '.join(shown)}{more}: expected {', '.join(self.known)}")


def _host(url: str) -> bool:
    try:
        parts = urlsplit(url)
        return bool(parts.hostname) and (parts.port is None or parts.port > 0)
    except ValueError:
        return False


def _shown(value: Any) -> str:
    if isinstance(value, dict | list):
        return "a table" if isinstance(value, dict) else "a list"
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN_CHARACTERS else f"{text[: _MAX_SHOWN_CHARACTERS - 1]}…"

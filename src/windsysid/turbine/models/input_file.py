"""Input files of OpenFAST: values by the name that follows them, and tables by their headings.

A line reads ``value  Name  - description``. The place of a value differs between versions, its name seldom does, so
names are looked up, without case and brackets: ``PreCone(1)``, ``PreCone1``.
"""

import math
import re
from pathlib import Path
from typing import NamedTuple, NoReturn

import numpy as np

from windsysid._types import Array
from windsysid.configuration import special_file_kind
from windsysid.errors import ConfigurationError, unreadable
from windsysid.turbine.models.limits import MAX_FILE_BYTES, MAX_GYRATION, MIN_GYRATION, STEEL_SOUND_SPEED

__all__ = ["InputFile", "StationTable", "gyration_problem"]

_ENTRY = re.compile(r"""\s*("[^"]*"|'[^']*'|[^\s,]+(?:\s*,\s*[^\s,]+)*)\s+([A-Za-z]\w*)(?:\((\d+)\))?(?=[\s-]|$)""")
_UNIT = re.compile(r"[\s()*.·-]")


TITLE_LINES = 2
"""Setting: first lines, which are free text in most formats: a value there counts if no other line has its name."""


class StationTable(NamedTuple):
    """Columns of a table by heading, and the numbers of its first and last line."""

    columns: dict[str, Array]
    first: int
    last: int


class InputFile:
    """An input file of OpenFAST, read when it is made.

    Parameters
    ----------
    path
        Of the file.
    asked_by
        Where its name stands, for messages.
    read
        All files of the model so far, to which this one is added.

    Raises
    ------
    ConfigurationError
        If it cannot be read; and by all methods, with file and line, where a value is missing or has another form.
    """

    def __init__(self, path: Path, asked_by: str = "", read: list[Path] | None = None) -> None:
        self.path = path
        self.read = [] if read is None else read
        self.read.append(path)
        named = f" (named in {asked_by})" if asked_by else ""
        try:
            if kind := special_file_kind(path):
                raise OSError(f"it is {kind}, expected a file")
            with path.open("rb") as file:
                content = file.read(MAX_FILE_BYTES)
        except (OSError, ValueError) as error:
            raise ConfigurationError(unreadable(f"{path}{named}", "a file of a model", error)) from None
        self.lines = content.decode("utf-8-sig", errors="replace").splitlines()
        self._entries: dict[str, tuple[str, int]] = {}
        numbered = list(enumerate(self.lines, start=1))
        for number, line in numbered[TITLE_LINES:] + numbered[:TITLE_LINES]:
            if found := _ENTRY.match(line):
                name = found[2] + (found[3] or "")
                self._entries.setdefault(name.lower(), (found[1].strip("\"'"), number))

    def fail(self, line: int, message: str) -> NoReturn:
        """Raise a ConfigurationError that begins with file and line."""
        raise ConfigurationError(f"{self.path}:{line}: {message}")

    def has(self, name: str) -> bool:
        """Test whether there is a value of that name."""
        return name.lower() in self._entries

    def text(self, name: str) -> str:
        """The value of that name as it is written, without quotes."""
        try:
            return self._entries[name.lower()][0]
        except KeyError:
            header = next((line.strip(" -") for line in self.lines if line.strip(" -")), "")
            raise ConfigurationError(
                f"{self.path}: expected a line 'value  {name}', found none (header: '{header[:50]}'); input formats of "
                "FAST 7 and 8 and OpenFAST 1 to 5 are read"
            ) from None

    def line(self, name: str) -> int:
        """Number of the line of that name."""
        self.text(name)
        return self._entries[name.lower()][1]

    def where(self, *names: str) -> str:
        """File and lines of some values: ``tower.dat:12, 14``."""
        return f"{self.path.name}:" + ", ".join(str(n) for n in sorted({self.line(name) for name in names}))

    def number(self, name: str, default: float | None = None) -> float:
        """The number of that name; `default` where the file does not have it."""
        if default is not None and not self.has(name):
            return default
        return self.value(self.line(name), self.text(name), f"{name}: ")

    def value(self, line: int, text: str, of: str = "") -> float:
        """The number that a line has as text; an error says `of` what it is."""
        try:
            return _number(text)
        except ValueError:
            self.fail(line, f"{of}expected a number, got '{text[:40]}'")

    def positive(self, name: str) -> float:
        """A number above 0."""
        value = self.number(name)
        if value <= 0.0:
            self.fail(self.line(name), f"{name}: expected a number above 0, got {value:g}")
        return value

    def factor(self, name: str) -> float:
        """A factor above 0; 1 where the file does not have it."""
        return self.positive(name) if self.has(name) else 1.0

    def damping(self, name: str) -> float:
        """A damping ratio [1] of 0 or more and below 1, written in per cent."""
        value = self.number(name)
        if not 0.0 <= value < 100.0:
            self.fail(self.line(name), f"{name}: expected a damping ratio from 0 to below 100 %, got {value:g}")
        return value / 100.0

    def count(self, name: str, default: int | None = None) -> int:
        """A whole number of 0 or more."""
        value = self.number(name, default)
        if value != int(value) or value < 0.0:
            self.fail(self.line(name), f"{name}: expected a whole number of 0 or more, got {value:g}")
        return int(value)

    def flag(self, name: str) -> bool:
        """A flag; False where the file does not have it."""
        return self.has(name) and self.text(name).lower().strip(".") in ("true", "t")

    def file(self, name: str) -> "InputFile":
        """The input file that the value names, relative to this one."""
        where = f"{self.path}:{self.line(name)}"
        return InputFile(self.path.parent / self.text(name).replace("\\", "/"), where, self.read)

    def table(self, count: str, units: dict[str, str]) -> StationTable:
        """The table of as many rows as the value `count` says, by its headings.

        Parameters
        ----------
        count
            Name of the number of rows, which stands above the table.
        units
            The columns that are needed, and the unit of each as the file has it below the heading. The first runs from
            0 to 1 and ascends.
        """
        rows, at = self.count(count), self._headings_of(count, units)
        headings = [word.lower() for word in self.lines[at].split()]
        width = 1 + max(headings.index(name.lower()) for name in units)
        values = np.array([self._row(at + 2 + i, width) for i in range(rows)]).reshape(rows, width)
        found = StationTable({name: values[:, headings.index(name.lower())] for name in units}, at + 3, at + 2 + rows)
        self._check_stations(next(iter(units)), found)
        return found

    def _headings_of(self, count: str, units: dict[str, str]) -> int:
        """Index of the line of headings below the value `count`, whose columns and units are checked."""
        start, first = self.line(count), next(iter(units)).lower()
        at = next((i for i, line in enumerate(self.lines[start:], start) if first in line.lower().split()), None)
        if at is None:
            self.fail(start, f"{count}: expected a table with the headings {', '.join(units)} below, found none")
        written = self.lines[at].split()
        headings = [word.lower() for word in written]
        for name in units:
            if name.lower() not in headings:
                self.fail(at + 1, f"expected a column {name} beside {next(iter(units))}, got {' '.join(written[:8])}")
        self._check_units(at + 1, headings, units)
        return at

    def heading(self, name: str, column: str = "") -> tuple[list[str], int]:
        """Words of the heading that begins with a name and has a column, in lower case, and its index."""
        for index, line in enumerate(self.lines):
            words = line.lower().split()
            if words[:1] == [name.lower()] and (not column or column.lower() in words):
                return words, index
        self.fail(1, f"expected a table with the heading {name}{f' and a column {column}' * bool(column)}, found none")

    def rows(self, name: str, count: int, width: int, column: str = "") -> tuple[list[list[str]], int]:
        """Words of some rows below a heading (`heading`) and its line of units, and the number of the first."""
        at = self.heading(name, column)[1]
        found = [line.replace(",", " ").split() for line in self.lines[at + 2 : at + 2 + count]]
        for i, words in enumerate(found):
            if len(words) < width:
                self.fail(at + 3 + i, f"expected {width} values under {name}, got '{' '.join(words)[:60]}'")
        if len(found) < count:
            self.fail(len(self.lines), f"expected {count} rows under {name}, got {len(found)}")
        return found, at + 3

    def outputs(self) -> list[str]:
        """Names of the output channels of the list ``OutList``."""
        at = next((i for i, line in enumerate(self.lines) if line.lower().split()[:1] == ["outlist"]), None)
        names: list[str] = []
        for line in self.lines[at + 1 :] if at is not None else ():
            if line.upper().lstrip().startswith("END"):
                break
            quoted = re.match(r'\s*"([^"]*)"', line)
            words = quoted[1] if quoted else (line.split() or [""])[0]
            names += [word.strip(" -") for word in words.split(",") if word.strip(" -")]
        return names

    def check_gyration(self, line: int, name: str, stiffness_per_mass: Array, length: float) -> None:
        """Refuse a stiffness whose size does not fit the mass per length (`gyration_problem`)."""
        if problem := gyration_problem(stiffness_per_mass, length):
            self.fail(line, f"{name}: {problem}")

    def _row(self, index: int, width: int) -> list[float]:
        words = self.lines[index].replace(",", " ").split() if index < len(self.lines) else []
        try:
            return [_number(word) for word in (words + [""] * width)[:width]]
        except ValueError:
            self.fail(index + 1, f"expected a row of {width} numbers, got '{' '.join(words)[:60]}'")

    def _check_units(self, index: int, headings: list[str], units: dict[str, str]) -> None:
        written = self.lines[index].split() if index < len(self.lines) else []
        if len(written) < len(headings) or not written[0].startswith("("):
            return
        for name, unit in units.items():
            got = written[headings.index(name.lower())]
            if _UNIT.sub("", got.lower()) != _UNIT.sub("", unit.lower()):
                self.fail(index + 1, f"{name}: expected the unit ({unit}), got {got}; convert the column")

    def _check_stations(self, name: str, table: StationTable) -> None:
        at = table.columns[name]
        if len(at) < 2 or at[0] != 0.0 or abs(at[-1] - 1.0) > 1e-9:
            self.fail(table.first, f"{name}: expected stations from 0 to 1, got {at[:1]} to {at[-1:]}")
        if (falls := np.flatnonzero(np.diff(at) <= 0.0)).size:
            i = int(falls[0])
            self.fail(table.first + i + 1, f"{name}: expected ascending stations, got {at[i + 1]:g} after {at[i]:g}")


def _number(text: str) -> float:
    """A number as Fortran writes it; ValueError for anything else."""
    value = float(text.upper().replace("D", "E"))
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def gyration_problem(stiffness_per_mass: Array, length: float) -> str:
    """Report an error of EI over mass per length (n,) [N·m³/kg] of a beam; '' if there is none.

    The median section is judged by its radius of gyration, as its material has about steel's speed of sound.
    """
    if not np.all(np.isfinite(stiffness_per_mass)) or np.any(stiffness_per_mass <= 0.0):
        return "expected stiffness and mass above 0"
    share = float(np.sqrt(np.median(stiffness_per_mass))) / STEEL_SOUND_SPEED / length
    if MIN_GYRATION <= share <= MAX_GYRATION:
        return ""
    return (
        f"stiffness over mass means a section of {share * length:.2g} m radius in a beam of {length:.3g} m: expected "
        f"{MIN_GYRATION * length:.2g} to {MAX_GYRATION * length:.2g} m; check units (N·m², kg/m)"
    )

"""Linearisation files of OpenFAST (``.lin``): operating point, order of the states, and the state matrix A.

    ẋ = A x + B u

about one azimuth of a steady state. Values are text in the number format ``OutFmt`` of the main input file: its default
writes four significant digits, so each entry of A has a rounding error, which is read with it.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError, unreadable

__all__ = ["LinearisedModel", "LinearisedState", "read_lin_file"]

_ROW = re.compile(r"\s*(\d+)\s+(\S.*?)\s+([TF])\s+(?:(\d)\s+)?(\S.*)$")
_MATRIX = re.compile(r"\s*A:\s+(\d+)\s*x\s*(\d+)\s*$")
_NUMBER = re.compile(r"[+-]?(\d*)\.?(\d*)(?:[EDed]?([+-]?\d+))?$")
_RATE = "First time derivative of "


@dataclass(frozen=True)
class LinearisedState:
    """A state x_i of a linearised model.

    Attributes
    ----------
    module
        The module that has it: ``ED`` (ElastoDyn), ``BD_1`` (BeamDyn of blade 1), ``AD``, ``HD``, ``SD`` …
    name
        Its description, without module, unit and internal index; of a rate that of the displacement.
    rate
        Whether it is the first time derivative of the state of that name.
    rotating
        Whether it belongs to the rotating frame, that is to one blade.
    order
        1 or 2: the order in time of the equation that it belongs to.
    """

    module: str
    name: str
    rate: bool
    rotating: bool
    order: int


@dataclass(frozen=True, eq=False)
class LinearisedModel:
    """A linearised model at one azimuth.

    Attributes
    ----------
    path : Path
        The file.
    description : str
        The description of the machine in the file.
    rotor_speed, azimuth : float
        Ω [rad/s] and ψ of blade 1 [rad].
    wind_speed : float
        [m/s]; NaN where the file has none.
    states : tuple of LinearisedState (n,)
        In the order of A.
    A : (n, n) array
        State matrix; units of states are SI.
    rounding : (n, n) array
        Largest rounding error of each entry of A, in its unit; zero for zeros and ones.
    digits : int
        Significant digits with which A is written.
    """

    path: Path
    description: str
    rotor_speed: float
    azimuth: float
    wind_speed: float
    states: tuple[LinearisedState, ...]
    A: Array
    rounding: Array
    digits: int


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise ConfigurationError(unreadable(path, "a .lin file of OpenFAST", error)) from None


def read_lin_file(path: str | Path) -> LinearisedModel:
    """Read one ``.lin`` file.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or a header line, a state, a matrix or a number is missing or wrong: file, line,
        what was expected, what to do.
    """
    path = Path(path)
    text = _FileLines(path, _lines(path))
    states = _states(text)
    count = int(text.header("Number of continuous states", default=0.0))
    if len(states) != count:
        raise text.error(None, f"expected {count} states as its header says, got {len(states)} in their list")
    A, rounding, digits = _state_matrix(text)
    if A.shape != (count, count):
        got = "{} x {}".format(*A.shape)
        raise text.error(None, f"expected A of {count} x {count} as its header says, got {got}")
    speed, azimuth = text.header("Rotor Speed", "rad/s"), text.header("Azimuth", "rad")
    wind = text.header("Wind Speed", "m/s", default=math.nan)
    return LinearisedModel(path, text.description(), speed, azimuth, wind, states, A, rounding, digits)


@dataclass(frozen=True)
class _FileLines:
    """The lines of a file, and errors that name one."""

    path: Path
    lines: Sequence[str]

    def error(self, index: int | None, problem: str) -> ConfigurationError:
        """An error at a line, or in the file."""
        where = f"{self.path}" if index is None else f"{self.path}, line {index + 1}"
        return ConfigurationError(f"{where}: {problem}; it may be cut off or changed: linearise again")

    def find(self, start: str) -> int:
        """Index of the first line that starts with some words."""
        for index, line in enumerate(self.lines):
            if line.lstrip().startswith(start):
                return index
        raise self.error(None, f"is no linearisation of OpenFAST, expected a line '{start} …', got none")

    def header(self, name: str, unit: str = "", *, default: float | None = None) -> float:
        """A number of the heading, with its unit."""
        try:
            index = self.find(f"{name}:")
        except ConfigurationError:
            if default is None:
                raise
            return default
        words = self.lines[index].partition(":")[2].split()
        try:
            value = float(words[0])
        except (IndexError, ValueError):
            value = math.nan
        if not math.isfinite(value) or words[1:2] != ([unit] if unit else []):
            raise self.error(index, f"expected '{name}: NUMBER {unit}'".rstrip() + f", got '{' '.join(words)[:40]}'")
        return value

    def description(self) -> str:
        """The description of the machine, as its main input file has it."""
        found = [line for line in self.lines[:12] if line.startswith("Description")]
        return found[0].partition(":")[2].strip() if found else ""


def _states(text: _FileLines) -> tuple[LinearisedState, ...]:
    """Read the list of the continuous states."""
    first = text.find("Order of continuous states:") + 3
    rows = list[tuple[bool, int, str]]()
    for index in range(first, len(text.lines)):
        line = text.lines[index]
        if not line.strip():
            break
        row = _ROW.match(line)
        if row is None or int(row[1]) != len(rows) + 1:
            expected = f"state {len(rows) + 1} as 'NUMBER VALUE T|F ORDER DESCRIPTION'"
            raise text.error(index, f"expected {expected}, got '{line.strip()[:50]}'")
        rows.append((row[3] == "T", int(row[4] or 0), row[5]))
    return _described(rows)


def _described(rows: "Sequence[tuple[bool, int, str]]") -> tuple[LinearisedState, ...]:
    """States from their rows: in the rotating frame or not, order, and description."""
    named = [_named(description) for *_, description in rows]
    pairs = {(module, name) for module, name, rate in named if rate}
    return tuple(
        LinearisedState(module, name, rate, rotating, order or (2 if (module, name) in pairs else 1))
        for (module, name, rate), (rotating, order, _) in zip(named, rows, strict=True)
    )


def _named(description: str) -> tuple[str, str, bool]:
    """Module and name of a state, and whether it is a rate."""
    module, _, rest = description.partition(" ")
    rate = rest.startswith(_RATE)
    words, index, _ = rest.removeprefix(_RATE).partition(" (internal")
    if not index and "," in words:
        words = words.rpartition(",")[0]
    return module, words.strip(), rate


def _state_matrix(text: _FileLines) -> tuple[Array, Array, int]:
    """Read A, its rounding, and its significant digits."""
    index = next((i for i, line in enumerate(text.lines) if _MATRIX.match(line)), 0)
    heading = _MATRIX.match(text.lines[index])
    if heading is None or "0" in heading.groups():
        raise text.error(None, "expected a matrix 'A: n x n' of at least one state, got none")
    shape = (int(heading[1]), int(heading[2]))
    cells = np.array([_cells(text, index + 1 + i, shape[1]) for i in range(shape[0])]).ravel().tolist()
    A = np.array([*map(_value, cells)]).reshape(shape)
    if not np.isfinite(A).all():
        i, j = (int(k) for k in np.argwhere(~np.isfinite(A))[0])
        raise text.error(
            index + 1 + i, f"expected a number in column {j + 1} of A, got '{cells[i * shape[1] + j][:30]}'"
        )
    sizes, digits = zip(*map(_rounding, cells), strict=True)
    return A, np.where(np.isin(np.abs(A), (0.0, 1.0)), 0.0, np.reshape(sizes, shape)), max(digits)


def _cells(text: _FileLines, index: int, columns: int) -> list[str]:
    """The numbers of a row, as text."""
    cells = text.lines[index].split() if index < len(text.lines) else []
    if len(cells) != columns:
        raise text.error(index, f"expected a row of {columns} numbers, got {len(cells)}")
    return cells


def _value(cell: str) -> float:
    """A number as Fortran writes it; NaN where it is none."""
    try:
        return float(cell)
    except ValueError:
        number = _NUMBER.match(cell)
        return float(f"{cell[: number.start(3)].rstrip('DdEe')}e{number[3]}") if number and number[3] else math.nan


def _rounding(cell: str) -> tuple[float, int]:
    """Largest rounding error of a number, and its significant digits."""
    number = _NUMBER.match(cell)
    if number is None:
        return 0.0, 0
    whole, decimals, exponent = number[1], number[2], int(number[3] or 0)
    return 0.5 * 10.0 ** (exponent - len(decimals)), len((whole + decimals).lstrip("0"))

"""Text output of OpenFAST and its modules, and of FAST 6 to 8: heading, line of names from ``Time`` on, units, rows.

The heading has six lines in OpenFAST's own file and another number in files of its modules (``.MD.out`` of MoorDyn):
the names are the first line that begins with ``Time`` and has a line of as many units below it. FAST 6 to 8 write units
in Latin-1 (``kN·m``).
"""

import itertools
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from windsysid.errors import RecordError
from windsysid.records.formats.text.dialect import is_number
from windsysid.records.formats.text.text import encoding_of, line_blocks
from windsysid.records.record import Array

__all__ = ["TextOutput", "read_text_output"]

_MAX_HEADING_LINES = 50


@dataclass(frozen=True)
class TextOutput:
    """Content of a text output.

    Attributes
    ----------
    names, units : tuple of str (m,)
        Names and units, without brackets, of all columns, the time first.
    description : str
        Text above the names.
    table : (T, m) array
        Values as written.
    first_line : int
        Number of the line with the first row.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    description: str
    table: Array
    first_line: int

    @property
    def samples(self) -> int:
        """Number of rows T."""
        return len(self.table)

    def time(self, low: int, high: int) -> Array:
        """Times [s] of the rows low … high − 1."""
        return np.ascontiguousarray(self.table[low:high, 0])

    def rows(self, low: int, high: int) -> Array:
        """Values of the rows low … high − 1, (high − low, m − 1), without the time."""
        return self.table[low:high, 1:]

    @property
    def notes(self) -> dict[str, str]:
        """Remarks on the file, as attributes of its record."""
        return {}

    def place(self, row: int) -> str:
        """Name of a row in messages."""
        return f"line {row + self.first_line}"


def read_text_output(path: Path) -> TextOutput:
    """Read a whole file.

    Raises
    ------
    RecordError
        If names or units are missing, a cell is no number, or a row has another number of cells than the names.
    """
    encoding = encoding_of(path)
    lines = _heading(path, encoding)
    at = _names_at(lines)
    if at is None:
        raise RecordError(
            "is not OpenFAST text output, expected a line of channel names from 'Time' on and a line of units below;"
            " give the file the ending of what it is"
        )
    names = tuple(lines[at].split())
    units = tuple(unit[1:-1] for unit in lines[at + 1].split())
    above = [line.strip() for line in lines[:at] if line.strip()]
    if any(len(line.split()) == len(names) and all(map(is_number, line.split())) for line in above):
        raise RecordError("has rows of numbers above the names; it is damaged; run the simulation again")
    return TextOutput(names, units, above[-1] if above else "", _rows(path, encoding, names, at + 2), at + 3)


def _heading(path: Path, encoding: str) -> list[str]:
    """The first lines of a file."""
    for block in line_blocks(path, encoding):
        return block.text.decode().split("\n", _MAX_HEADING_LINES + 1)[: _MAX_HEADING_LINES + 1]
    return []


def _names_at(lines: list[str]) -> int | None:
    """Index of the line of names; None if there is none."""
    for k, (line, below) in enumerate(itertools.pairwise(lines)):
        names, units = line.split(), below.split()
        if names and names[0].lower() == "time" and len(units) == len(names) and _is_unit(units[0]):
            return k
    return None


def _is_unit(cell: str) -> bool:
    return len(cell) > 1 and cell[0] + cell[-1] in ("()", "[]")


def _rows(path: Path, encoding: str, names: tuple[str, ...], heading: int) -> Array:
    """Read the table (T, m) below `heading` lines."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of a file without rows, which the check of the rows reports
            table = np.loadtxt(path, skiprows=heading, encoding=encoding, comments=None, ndmin=2)
    except ValueError:
        return _rows_one_by_one(path, encoding, names, heading)
    return table if table.shape[1] == len(names) else _rows_one_by_one(path, encoding, names, heading)


def _rows_one_by_one(path: Path, encoding: str, names: tuple[str, ...], heading: int) -> Array:
    """Read the table row by row, to name the place of an error."""
    table: list[list[float]] = []
    for block in line_blocks(path, encoding):
        for number, line in enumerate(block.text.decode().split("\n"), block.first):
            cells = line.split() if number > heading else []
            for name, cell in zip(names, cells, strict=False):
                if not is_number(cell):
                    raise RecordError(
                        f"channel '{name}', line {number}: '{cell[:40]}' is not a number; run the simulation again"
                    )
            if cells and len(cells) != len(names):
                raise RecordError(
                    f"line {number} has {len(cells)} cells, expected {len(names)}; the file may be cut off; remove that"
                    " line or run the simulation again"
                )
            table += [[float(cell) for cell in cells]] if cells else []
    return np.array(table).reshape(-1, len(names))

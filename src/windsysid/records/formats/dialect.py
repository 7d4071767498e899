"""How a text table is written, found from its first lines.

The delimiter is the one that splits the most cells into values: of the cells that it makes, the greatest part are
numbers, times or missing. Decimal commas are believed where some cell cannot be a number in thousands (``0,125``,
``3,1``); ``1,234`` alone could be either and is refused. Above the numbers stand, in this order and each optional:
``sep=;`` as spreadsheets write it, comments (``#`` or ``%``), lines of text that are not as wide as the table, one line
of names, one of units; or the four lines of a Campbell TOA5 file; or nothing, and then the columns are called
``column_1`` … and the first is the time if it increases.
"""

import csv
import itertools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.formats.clock import is_stamp
from windsysid.records.formats.columns import Cell, is_called_time, is_no_time_unit, name_and_unit, split_unit
from windsysid.records.formats.mapping import CsvRule
from windsysid.records.record import AS_WRITTEN
from windsysid.units import canonical, si_unit

__all__ = ["MISSING", "Layout", "counts_rows", "find_layout", "is_number", "split"]

MISSING = ("", "nan", "NaN", "NAN", "-nan", "-NaN", "NA", "N/A", "n/a", "null", "NULL", "None")
"""Cells that say that a value is missing."""

_TOA5_MISSING = ("INF", "-INF", "+INF")  # a Campbell logger's mark of an overflow
_NUMBER = re.compile(r"[+-]?(?:\d++(?:[.,]\d*+)?|[.,]\d++)(?:[eE][+-]?\d+)?|[+-]?(?:inf|infinity|nan)", re.IGNORECASE)
_GROUPED = re.compile(r"[+-]?\d{1,3}(?:[.,']\d{3})+(?:[.,]\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")
_NAMES = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "blanks"}
_SEPARATOR = re.compile(r'"?sep=([,;\t])"?', re.IGNORECASE)
_LOOK = 100  # lines
_COUNTERS = ("unnamed: 0", "index", "level_0", "row")  # names of a first column that counts rows, in lower case

Line = tuple[int, str]


@dataclass(frozen=True)
class Layout:
    """How a text table is written.

    Attributes
    ----------
    delimiter, decimal : str
        A blank stands for runs of blanks.
    cells : tuple of Cell
        The columns.
    first_row : int
        Number of the first line with values.
    headed : bool
        Whether the file names its columns.
    missing : tuple of str
        Cells that mean that a value is missing.
    attributes : dict
        Comments above the header and what a TOA5 file says about itself.
    closed : bool
        Whether a delimiter ends every line.
    """

    delimiter: str
    decimal: str
    cells: tuple[Cell, ...]
    first_row: int
    headed: bool = True
    missing: tuple[str, ...] = MISSING
    attributes: dict[str, str] = field(default_factory=dict)
    closed: bool = False


def find_layout(lines: Sequence[Line], rule: CsvRule, *, timed: bool = True) -> Layout:
    """The layout of a file, from its first lines.

    Parameters
    ----------
    lines : sequence of (int, str)
        Number and text of the first lines that are not blank.
    rule : CsvRule
        What the mapping says; it goes before.
    timed : bool
        Whether one of the columns is the time.

    Raises
    ------
    RecordError
        If the lines are no table, or could be read in two ways.
    """
    said = _SEPARATOR.fullmatch(lines[0][1].strip("\r\n ")) if lines else None
    if said:
        lines = lines[1:]
    commented: list[str] = []
    if rule.header_row:
        preamble = [text for number, text in lines if number < rule.header_row]
        lines = [line for line in lines if line[0] >= rule.header_row]
        if not lines or lines[0][0] != rule.header_row:
            raise RecordError(f"line {rule.header_row} should be the header (csv.header_row) but is blank or missing")
    else:
        count = next((i for i, (_, text) in enumerate(lines) if text.lstrip()[0] not in "#%"), len(lines))
        preamble, lines = [text.strip() for _, text in lines[:count]], lines[count:]
    commented = list(preamble)
    if not lines:
        raise RecordError("holds no table, only comments; expected a header line and rows of numbers")
    delimiter = rule.delimiter or (said and said[1]) or _delimiter([text for _, text in lines[:_LOOK]])
    rows = [split(text, delimiter) for _, text in lines[:_LOOK]]
    above = _preamble(rows) if rule.header_row is None else 0
    preamble, lines, rows = [*preamble, *(text.strip() for _, text in lines[:above])], lines[above:], rows[above:]
    attributes = {"comments": "\n".join(preamble)} if preamble else {}
    if rows[0][0] == "TOA5":
        return _toa5(lines, rows, delimiter, rule, attributes)
    if rule.header_row == 0 or (rule.header_row is None and _is_headless(rows[0])):
        names = _commented_names(commented, delimiter, len(rows[0]))
        cells = tuple(Cell(f"column_{i}", f"column_{i}", AS_WRITTEN + "unknown") for i in range(1, len(rows[0]) + 1))
        first, headed = lines[0][0], names is not None
        cells = names or ((Cell("column_1", "time", None), *cells[1:]) if timed else cells)
        decimal = rule.decimal or _decimal(rows, delimiter)
        return Layout(delimiter, decimal, cells, first, headed, MISSING + rule.missing, attributes)
    header, closed = rows[0], False
    if len(header) > 1 and header[-1] == "" and all(row[-1] == "" for row in rows if len(row) == len(header)):
        closed, header = True, header[:-1]  # every line ends in a delimiter: a last column without name and values
    if not header[0] and _counts(rows[1:]):
        header = ["Unnamed: 0", *header[1:]]
    cells = _named(header)
    if closed:
        rows = [row[:-1] if len(row) == len(header) + 1 and not row[-1] else row for row in rows]
    unit_row = _unit_row(lines, rows, rule)
    if unit_row:
        cells = _with_units(header, rows[unit_row], lines[unit_row][0])
    below = 1 + (unit_row or 0)
    if len(lines) <= below:
        raise RecordError("has 0 rows under the header, expected at least 2; export it again")
    decimal = rule.decimal or _decimal(rows[below:], delimiter)
    return Layout(delimiter, decimal, cells, lines[below][0], True, MISSING + rule.missing, attributes, closed)


def _preamble(rows: list[list[str]]) -> int:
    """How many lines of text stand above the names: none of them as wide as the table, and none of numbers."""
    sizes = Counter(len(row) for row in rows if len(row) > 1)
    width = max(sizes, key=lambda n: (sizes[n], n), default=0)
    first = next((i for i, row in enumerate(rows) if len(row) == width), 0)
    below = rows[first + 1 : first + 3]
    named = not any(map(_is_value, rows[first])) and not all(re.fullmatch(r"\[.*\]|\(.*\)", c) for c in rows[first])
    if not first or not named or len(below) < 2 or any(len(row) != width for row in rows[first:]):
        return 0
    numbers = any(len(row) > 1 and _is_headless(row) for row in rows[:first])
    return 0 if numbers or not _is_headless(below[1]) else first


def split(line: str, delimiter: str) -> list[str]:
    """The cells of one line, without the blanks and quotes around them."""
    if line and '"' not in line:
        return line.split() if delimiter == " " else [cell.strip() for cell in line.split(delimiter)]
    try:
        cells = next(
            csv.reader([line.strip() if delimiter == " " else line], delimiter=delimiter, skipinitialspace=True)
        )
    except csv.Error:  # a cell of more than 128 kB
        return line.split(delimiter)
    return [cell.strip() for cell in cells]


def is_number(cell: str, decimal: str = ".") -> bool:
    """Whether a cell is a number as files write it."""
    if decimal != "." and "." in cell:
        return False
    try:
        float(cell.replace(decimal, "."))
    except ValueError:
        return False
    return cell.isascii() and "_" not in cell  # Python reads 1_000, a file does not mean it


def _is_value(cell: str) -> bool:
    return cell in MISSING or bool(_NUMBER.fullmatch(cell) or _GROUPED.fullmatch(cell)) or is_stamp(cell)


def _is_headless(row: list[str]) -> bool:
    return all(map(_is_value, row)) and row[0] not in MISSING and any(cell not in MISSING for cell in row[1:])


def _delimiter(texts: list[str]) -> str:
    if split(texts[0], ",")[0] == "TOA5":
        return ","
    scores = {}
    for delimiter in _NAMES:
        rows = [split(text, delimiter) for text in texts]
        sizes = Counter(len(row) for row in rows if len(row) > 1)
        if not sizes:
            continue
        size = max(sizes, key=lambda n: (sizes[n], n))
        values = sum(map(_is_value, (cell for row in rows if len(row) == size for cell in row)))
        names = (
            0.5 if len(rows[0]) == size else 0.0
        )  # a table without good values still has a header as wide as its rows
        scores[delimiter] = (values + names) / sum(map(len, rows))
    if not scores:
        raise RecordError(
            f"the line '{texts[0].strip()[:60]}' has one column; expected a table with the time first, its cells"
            " separated by commas, semicolons, tabs or blanks"
        )
    best = max(scores.values())
    if len(texts) == 1 and best <= 0.25:
        raise RecordError("has 0 rows under the header, expected at least 2; export it again")
    winners = [delimiter for delimiter, score in scores.items() if score == best]
    if winners == ["\t", " "]:
        return "\t"
    if len(winners) > 1:
        raise RecordError(
            f"cells could be separated by {' or by '.join(_NAMES[d] for d in winners)}; say which in the mapping file: "
            "[csv] delimiter"
        )
    return winners[0]


def _decimal(rows: list[list[str]], delimiter: str) -> str:
    """The decimal mark; RecordError if commas could be decimal marks or marks of thousands."""
    if delimiter == ",":
        return "."
    commas = [cell for row in rows for cell in row if "," in cell and not is_stamp(cell)]
    numbers = [cell for cell in commas if _NUMBER.fullmatch(cell) or _THOUSANDS.fullmatch(cell)]
    if not numbers:
        return "."
    points = [cell for row in rows for cell in row if "." in cell and _NUMBER.fullmatch(cell)]
    hint = "say what it is in the mapping file: [csv] decimal, and write numbers without marks of thousands"
    if points:
        raise RecordError(
            f"has '{numbers[0]}' as well as '{points[0]}': a comma could be a decimal mark or one of thousands; {hint}"
        )
    if all(_THOUSANDS.fullmatch(cell) for cell in numbers):
        raise RecordError(f"'{numbers[0]}' could be a number with a decimal comma or one in thousands; {hint}")
    if delimiter == " ":
        raise RecordError(f"'{numbers[0]}' between blanks could be one number or two; {hint}, and [csv] delimiter")
    return ","


def counts_rows(cells: Sequence[Cell], rows: list[list[str]]) -> bool:
    """Whether the first column only counts the rows, as an index without a name that pandas writes."""
    return len(cells) > 1 and cells[0].written.lower() in _COUNTERS and _counts(rows)


def _counts(rows: list[list[str]]) -> bool:
    """Whether the first cells are whole numbers that increase; a few rows may have been dropped."""
    numbers = [row[0] for row in rows if row and row[0]]
    if len(numbers) < 2 or not all(re.fullmatch(r"\d{1,15}", text) for text in numbers):
        return False
    steps = [int(later) - int(former) for former, later in itertools.pairwise(numbers)]
    return min(steps) > 0 and sorted(steps)[len(steps) // 2] == 1


def _named(header: list[str]) -> tuple[Cell, ...]:
    for number, cell in enumerate(header, 1):
        if not cell:
            raise RecordError(f"column {number} has no name; expected 'name [unit]'; name it or remove it")
    return tuple(map(name_and_unit, header))


def _commented_names(preamble: list[str], delimiter: str, size: int) -> tuple[Cell, ...] | None:
    """The names from the last comment, if it is a header: as wide as the rows, and the time first."""
    header = split(preamble[-1].lstrip("#% "), delimiter) if preamble else []
    if len(header) != size or not any(is_called_time(read(header[0]).name) for read in (split_unit, name_and_unit)):
        return None
    return _named(header)


def _unit_row(lines: Sequence[Line], rows: list[list[str]], rule: CsvRule) -> int | None:
    """Index of the line with the units, None if there is none."""
    if rule.unit_row == 0 or len(rows) < 2:
        return None
    if rule.unit_row is not None:
        found = [i for i, (number, _) in enumerate(lines[:_LOOK]) if number == rule.unit_row]
        if found != [1]:
            raise ConfigurationError(f"csv.unit_row: expected the line below the header, got {rule.unit_row}")
        return 1
    row = rows[1]
    if all(re.fullmatch(r"\[.*\]|\(.*\)|", cell) for cell in row) and any(row):
        return 1
    texts = [cell for cell in row if cell not in MISSING and not _NUMBER.fullmatch(cell) and not is_stamp(cell)]
    if row[0] in texts and _is_time_unit(row[0]) and sum(map(bool, row)) <= len(texts) + row.count("1"):
        return 1
    return None


def _is_time_unit(cell: str) -> bool:
    try:
        return si_unit(cell) == "s"
    except ConfigurationError:
        return cell.upper() in ("TS", "UTC")


def _with_units(header: list[str], units: list[str], line: int) -> tuple[Cell, ...]:
    if len(units) != len(header):
        raise RecordError(f"line {line}, the units, has {len(units)} cells, expected {len(header)} as in the header")
    cells = []
    for name, unit in zip(header, units, strict=True):
        bare = unit[1:-1].strip() if unit[:1] + unit[-1:] in ("[]", "()") and len(unit) > 1 else unit
        cell = split_unit(name) if bare else name_and_unit(name)
        if cell.unit is not None and name[-1] not in ")]" and is_no_time_unit(bare):
            cell = Cell(name, name)  # T_s in degC: the name only looks like a time
        if bare and cell.unit is not None and not _same(cell.unit, bare):
            raise RecordError(f"column '{name}' is in '{bare}' after line {line}; expected one unit; correct either")
        cells.append(Cell(name, cell.name, bare or cell.unit))
    return tuple(cells)


def _same(unit: str, other: str) -> bool:
    try:
        return canonical(unit) == canonical(other)
    except ConfigurationError:
        return unit == other


def _toa5(
    lines: Sequence[Line], rows: list[list[str]], delimiter: str, rule: CsvRule, attributes: dict[str, str]
) -> Layout:
    if len(rows) < 6 or [lines[i][0] - lines[0][0] for i in range(4)] != [0, 1, 2, 3]:
        raise RecordError("looks like a Campbell TOA5 file, expected four header lines and two rows; export it again")
    environment, names, units, processing = rows[:4]
    if len({len(names), len(units), len(processing)}) > 1:
        raise RecordError(
            f"is a Campbell TOA5 file whose header has {len(names)} names, {len(units)} units and {len(processing)}"
            " processings; expected one each per column; export it again"
        )
    cells = []
    for cell, unit in zip(_named(names), units, strict=True):
        unit = {"RN": "1"}.get(unit, unit)
        cells.append(Cell(cell.written, cell.written, unit or (None if cell.name == cell.written else cell.unit)))
    keys = ("format", "station", "logger", "serial", "system", "program", "signature", "table")
    about = dict(zip(keys, environment, strict=False))
    how = {f"processing {name}": text for name, text in zip(names, processing, strict=True) if text}
    return Layout(
        delimiter,
        rule.decimal or ".",
        tuple(cells),
        lines[4][0],
        True,
        MISSING + _TOA5_MISSING + rule.missing,
        {**attributes, **about, **how},
    )

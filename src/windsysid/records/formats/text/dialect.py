"""Format of a text table, detected from its first lines.

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
from typing import NamedTuple

from windsysid.errors import ConfigurationError, RecordError
from windsysid.records.formats.contents.columns import Cell, is_called_time, is_no_time_unit, name_and_unit, split_unit
from windsysid.records.formats.contents.mapping import CsvRule
from windsysid.records.formats.time.clock import is_stamp
from windsysid.records.record import AS_WRITTEN
from windsysid.units import canonical, si_unit

__all__ = ["MISSING", "Layout", "counts_rows", "find_layout", "is_number", "split"]

MISSING = ("", "nan", "NaN", "NAN", "-nan", "-NaN", "NA", "N/A", "n/a", "null", "NULL", "None")
"""Cells that say that a value is missing."""

_TOA5_MISSING = ("INF", "-INF", "+INF")  # a Campbell logger's mark of an overflow
_NUMBER = re.compile(r"[+-]?(?:\d++(?:[.,]\d*+)?|[.,]\d++)(?:[eE][+-]?\d+)?|[+-]?(?:inf|infinity|nan)", re.IGNORECASE)
_GROUPED = re.compile(r"[+-]?\d{1,3}(?:[.,']\d{3})+(?:[.,]\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")
_IN_BRACKETS = re.compile(r"\[.*\]|\(.*\)")
_NAMES = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "blanks"}
_SEPARATOR = re.compile(r'"?sep=([,;\t])"?', re.IGNORECASE)
_LOOK = 100  # lines
_COUNTERS = ("unnamed: 0", "index", "level_0", "row")  # names of a first column that counts rows, in lower case

Line = tuple[int, str]


@dataclass(frozen=True)
class Layout:
    """Format of a text table.

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
    table, comments = _table(lines, rule)
    if table.rows[0][0] == "TOA5":
        return _toa5(table)
    if rule.header_row == 0 or (rule.header_row is None and _is_headless(table.rows[0])):
        return _headless(table, comments, timed)
    return _headed(table)


class _Table(NamedTuple):
    """The lines of a table, the cells of the first of them, and known properties."""

    lines: Sequence[Line]
    rows: list[list[str]]
    delimiter: str
    rule: CsvRule
    attributes: dict[str, str]


def _table(lines: Sequence[Line], rule: CsvRule) -> tuple[_Table, list[str]]:
    """The table in a file, and the comments above it."""
    separator = _separator(lines)
    comments, lines = _without_comments(lines[1:] if separator else lines, rule.header_row)
    if not lines:
        raise RecordError("holds no table, only comments; expected a header line and rows of numbers")
    texts = [text for _, text in lines[:_LOOK]]
    delimiter = rule.delimiter or separator or _delimiter(texts)
    rows = [split(text, delimiter) for text in texts]
    above = _preamble(rows) if rule.header_row is None else 0
    preamble = "\n".join(comments + [text.strip() for text in texts[:above]])
    attributes = {"comments": preamble} if preamble else {}
    return _Table(lines[above:], rows[above:], delimiter, rule, attributes), comments


def _separator(lines: Sequence[Line]) -> str | None:
    found = _SEPARATOR.fullmatch(lines[0][1].strip("\r\n ")) if lines else None
    return found[1] if found else None


def _without_comments(lines: Sequence[Line], header_row: int | None) -> tuple[list[str], Sequence[Line]]:
    """The comments, or all lines above the header if its number is given; and the lines below."""
    if not header_row:
        count = next((i for i, (_, text) in enumerate(lines) if text.lstrip()[0] not in "#%"), len(lines))
        return [text.strip() for _, text in lines[:count]], lines[count:]
    count = sum(number < header_row for number, _ in lines)
    if count == len(lines) or lines[count][0] != header_row:
        raise RecordError(f"line {header_row} should be the header (csv.header_row) but is blank or missing")
    return [text for _, text in lines[:count]], lines[count:]


def _headless(table: _Table, comments: list[str], timed: bool) -> Layout:
    """The layout of a table without a line of names; the last comment may have them."""
    width = len(table.rows[0])
    cells = _commented_names(comments, table.delimiter, width)
    headed = cells is not None
    if cells is None:
        cells = tuple(Cell(f"column_{i}", f"column_{i}", AS_WRITTEN + "unknown") for i in range(1, width + 1))
        cells = (Cell("column_1", "time", None), *cells[1:]) if timed else cells
    decimal = table.rule.decimal or _decimal(table.rows, table.delimiter)
    missing = MISSING + table.rule.missing
    return Layout(table.delimiter, decimal, cells, table.lines[0][0], headed, missing, table.attributes)


def _headed(table: _Table) -> Layout:
    """The layout of a table with a line of names and perhaps one of units."""
    rows, lines = _without_end(table.rows), table.lines
    header = ["Unnamed: 0", *rows[0][1:]] if not rows[0][0] and _counts(rows[1:]) else rows[0]
    cells, below = _named(header), 1
    if _has_units(lines, rows, table.rule):
        cells, below = _with_units(header, rows[1], lines[1][0]), 2
    if len(lines) <= below:
        raise RecordError("has 0 rows under the header, expected at least 2; export it again")
    decimal = table.rule.decimal or _decimal(rows[below:], table.delimiter)
    missing, closed = MISSING + table.rule.missing, rows is not table.rows
    return Layout(table.delimiter, decimal, cells, lines[below][0], True, missing, table.attributes, closed)


def _without_end(rows: list[list[str]]) -> list[list[str]]:
    """The rows without the empty cell behind a delimiter that ends every line; the same list if some have no such."""
    width = len(rows[0])
    if width < 2 or any(len(row) == width and row[-1] for row in rows):
        return rows
    return [row[:-1] if len(row) == width else row for row in rows]


def _usual_width(rows: list[list[str]]) -> int:
    """The number of cells that most rows have, 0 if no row has more than one."""
    sizes = Counter(len(row) for row in rows if len(row) > 1)
    return max(sizes, key=lambda n: (sizes[n], n), default=0)


def _preamble(rows: list[list[str]]) -> int:
    """Number of lines of text above the names: none of them is as wide as the table, or has one cell of it filled."""
    width = _usual_width(rows)
    first = next((i for i, row in enumerate(rows) if len(row) == width and sum(map(bool, row)) > 1), 0)
    table = rows[first:]
    full = len(table) > 2 and all(len(row) == width for row in table)
    is_table = full and _are_names(table[0]) and _is_headless(["0", *table[2][1:]])
    return first if is_table and not any(map(_is_headless, rows[:first])) else 0


def _are_names(row: list[str]) -> bool:
    return not any(map(_is_value, row)) and not all(map(_IN_BRACKETS.fullmatch, row))


def split(line: str, delimiter: str) -> list[str]:
    """The cells of one line, without the blanks and quotes around them."""
    if line and '"' not in line:
        if " " not in line and line.isprintable():
            return line.split(delimiter)
        return line.split() if delimiter == " " else [cell.strip() for cell in line.split(delimiter)]
    try:
        cells = next(
            csv.reader([line.strip() if delimiter == " " else line], delimiter=delimiter, skipinitialspace=True)
        )
    except csv.Error:  # a cell of more than 128 kB
        return line.split(delimiter)
    return [cell.strip() for cell in cells]


def is_number(cell: str, decimal: str = ".") -> bool:
    """Test whether a cell is a number as files write it."""
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
    scores = _scores(texts)
    best = max(scores.values())
    if len(texts) == 1 and best <= 0.25:
        raise RecordError("has 0 rows under the header, expected at least 2; export it again")
    winners = [delimiter for delimiter, score in scores.items() if score == best]
    if len(winners) > 1 and winners != ["\t", " "]:
        raise RecordError(
            f"cells could be separated by {' or by '.join(map(_NAMES.__getitem__, winners))}; say which in the mapping"
            " file: [csv] delimiter"
        )
    return winners[0]


def _scores(texts: list[str]) -> dict[str, float]:
    """The part of all cells that are values, by delimiter, for those that split most lines in two or more."""
    tables = {delimiter: [split(text, delimiter) for text in texts] for delimiter in _NAMES}
    scores = {delimiter: _share_of_values(rows) for delimiter, rows in tables.items() if _usual_width(rows)}
    if not scores:
        raise RecordError(
            f"the line '{texts[0].strip()[:60]}' has one column; expected a table with the time first, its cells"
            " separated by commas, semicolons, tabs or blanks"
        )
    return scores


def _share_of_values(rows: list[list[str]]) -> float:
    """The part of all cells that are values in rows of the usual width; a header of that width counts as half a one."""
    width = _usual_width(rows)
    wide = [row for row in rows if len(row) == width]
    header = 0.5 if wide[0] is rows[0] else 0.0  # a table without good values still has a header as wide as its rows
    return (sum(map(_is_value, itertools.chain(*wide))) + header) / sum(map(len, rows))


def _decimal(rows: list[list[str]], delimiter: str) -> str:
    """The decimal mark; RecordError if commas could be decimal marks or marks of thousands."""
    if delimiter == ",":
        return "."
    cells = list(itertools.chain(*rows))
    numbers = list(filter(_is_number_with_comma, cells))
    if not numbers:
        return "."
    points = [cell for cell in cells if "." in cell and _NUMBER.fullmatch(cell)]
    hint = "say what it is in the mapping file: [csv] decimal, and write numbers without marks of thousands"
    if points:
        raise RecordError(
            f"has '{numbers[0]}' as well as '{points[0]}': a comma could be a decimal mark or one of thousands; {hint}"
        )
    if all(map(_THOUSANDS.fullmatch, numbers)):
        raise RecordError(f"'{numbers[0]}' could be a number with a decimal comma or one in thousands; {hint}")
    if delimiter == " ":
        raise RecordError(f"'{numbers[0]}' between blanks could be one number or two; {hint}, and [csv] delimiter")
    return ","


def _is_number_with_comma(cell: str) -> bool:
    return "," in cell and not is_stamp(cell) and bool(_NUMBER.fullmatch(cell) or _THOUSANDS.fullmatch(cell))


def counts_rows(cells: Sequence[Cell], rows: list[list[str]]) -> bool:
    """Test whether the first column only counts the rows, as an index without a name that pandas writes."""
    return len(cells) > 1 and cells[0].written.lower() in _COUNTERS and _counts(rows)


def _counts(rows: list[list[str]]) -> bool:
    """Test whether the first cells are whole numbers that increase; a few rows may have been dropped."""
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


def _has_units(lines: Sequence[Line], rows: list[list[str]], rule: CsvRule) -> bool:
    """Test whether the line below the header holds units."""
    if rule.unit_row == 0 or len(rows) < 2:
        return False
    if rule.unit_row is None:
        return _are_units(rows[1])
    if lines[1][0] != rule.unit_row:
        raise ConfigurationError(f"csv.unit_row: expected the line below the header, got {rule.unit_row}")
    return True


def _are_units(row: list[str]) -> bool:
    if any(row) and all(map(_IN_BRACKETS.fullmatch, filter(None, row))):
        return True
    texts = [cell for cell in row if cell not in MISSING and not _NUMBER.fullmatch(cell) and not is_stamp(cell)]
    timed = _quantity(row[0]) == "s" if row[0] else bool(texts) and "" not in map(_quantity, texts)
    return timed and sum(map(bool, row)) <= len(texts) + row.count("1")


def _quantity(cell: str) -> str:
    """SI unit of a cell with a unit, s of one that names a clock; empty for other text."""
    try:
        return si_unit(cell)
    except ConfigurationError:
        return "s" if cell.upper() in ("TS", "UTC") else ""


def _with_units(header: list[str], units: list[str], line: int) -> tuple[Cell, ...]:
    if len(units) != len(header):
        raise RecordError(f"line {line}, the units, has {len(units)} cells, expected {len(header)} as in the header")
    return tuple(_with_unit(name, unit, line) for name, unit in zip(header, units, strict=True))


def _with_unit(name: str, unit: str, line: int) -> Cell:
    bare = unit[1:-1].strip() if _IN_BRACKETS.fullmatch(unit) else unit
    cell = split_unit(name) if bare else name_and_unit(name)
    if cell.unit is not None and name[-1] not in ")]" and is_no_time_unit(bare):
        cell = Cell(name, name)  # T_s in degC: the name only looks like a time
    if bare and cell.unit is not None and not _same(cell.unit, bare):
        raise RecordError(f"column '{name}' is in '{bare}' after line {line}; expected one unit; correct either")
    return Cell(name, cell.name, bare or cell.unit)


def _same(unit: str, other: str) -> bool:
    try:
        return canonical(unit) == canonical(other)
    except ConfigurationError:
        return unit == other


def _toa5(table: _Table) -> Layout:
    """The layout of a Campbell TOA5 file."""
    lines, rows, rule = table.lines, table.rows, table.rule
    if len(rows) < 6 or lines[3][0] - lines[0][0] != 3:
        raise RecordError("looks like a Campbell TOA5 file, expected four header lines and two rows; export it again")
    environment, names, units, processing = rows[:4]
    if len({len(names), len(units), len(processing)}) > 1:
        raise RecordError(
            f"is a Campbell TOA5 file whose header has {len(names)} names, {len(units)} units and {len(processing)}"
            " processings; expected one each per column; export it again"
        )
    cells = tuple(map(_toa5_cell, _named(names), units))
    keys = ("format", "station", "logger", "serial", "system", "program", "signature", "table")
    about = dict(zip(keys, environment, strict=False))
    how = {f"processing {name}": text for name, text in zip(names, processing, strict=True) if text}
    missing = MISSING + _TOA5_MISSING + rule.missing
    attributes = {**table.attributes, **about, **how}
    return Layout(table.delimiter, rule.decimal or ".", cells, lines[4][0], True, missing, attributes)


def _toa5_cell(cell: Cell, unit: str) -> Cell:
    unit = {"RN": "1"}.get(unit, unit)
    return Cell(cell.written, cell.written, unit or (None if cell.name == cell.written else cell.unit))

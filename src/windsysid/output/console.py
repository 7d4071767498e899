"""Text for a terminal, a pipe or a notebook: the one place for their widths and character sets."""

import codecs
import itertools
import re
import shutil
import sys
import textwrap
import unicodedata
from collections.abc import Sequence
from typing import Any

from windsysid.output.table import Table

__all__ = ["longest_word", "plain", "printable", "render", "show_what_can_be_shown"]

DEFAULT_COLUMNS = 120
"""Columns where there is no terminal: a pipe, a file or a notebook gets the same text everywhere."""

_PLAIN = {
    "±": "+/-", "…": "...", "–": "-", "—": "-", "−": "-", "·": "*", "×": "x", "÷": "/", "→": "->", "≤": "<=", "≥": ">=",
    "≈": "~", "≠": "!=",
    "°": "deg", "²": "^2", "³": "^3", "µ": "u", "√": "sqrt ", "∞": "inf", "∂": "d", "“": '"', "”": '"', "„": '"',
    "’": "'", "‘": "'", "•": "*",
    "─": "-", "━": "-", "│": "|", "┃": "|", "═": "=", "║": "|",
}  # fmt: skip


def plain(text: str, encoding: str = "ascii") -> str:
    """Spell `text` as an encoding can show it: σ becomes sigma, ± becomes +/-, é becomes e, anything else ?."""
    try:
        text.encode(encoding)
        return text
    except UnicodeEncodeError:
        return "".join(_one(character, encoding) for character in text)


def _one(character: str, encoding: str) -> str:
    try:
        character.encode(encoding)
        return character
    except UnicodeEncodeError:
        pass
    if character in _PLAIN:
        return plain(_PLAIN[character])
    name = unicodedata.name(character, "")
    if name.startswith("GREEK ") and " LETTER " in name:
        spelt = name.split(" LETTER ")[1].split()[0].lower()
        return spelt.capitalize() if "CAPITAL" in name else spelt
    if name.startswith("BOX DRAWINGS"):
        return "+"
    return unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode() or "?"


def _spelt(error: UnicodeError) -> tuple[str, int]:
    """Error handler of Python for characters that a stream cannot encode."""
    assert isinstance(error, UnicodeEncodeError)
    return plain(error.object[error.start : error.end]), error.end


def show_what_can_be_shown() -> None:
    """Let standard output and error spell characters that their encoding lacks, instead of failing."""
    codecs.register_error("windsysid", _spelt)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="windsysid")


def printable(text: object) -> str:
    """Replace characters that cannot be printed, such as control characters and line ends, by question marks."""
    return "".join(sign if sign.isprintable() else "?" for sign in str(text))


MIN_COLUMNS_TO_SPLIT = 4
"""Setting: a table with fewer columns is not divided: names are folded."""

_CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""Control characters of somebody's names, which a terminal would obey."""


def render(*parts: Any, width: int | None = None) -> str:
    """Render tables, Rich's or ours, and plain lines as text, with an empty line between two tables.

    Tables are at most as wide as `width` or the terminal; cells are wrapped and never cut off.
    """
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    width = width or max(shutil.get_terminal_size((DEFAULT_COLUMNS, 24)).columns, 20)
    lines: list[str] = []
    shown: list[Any] = []
    for part in itertools.chain.from_iterable(_within(one, width) for one in parts):
        is_table = isinstance(part, Table)
        lines += [""] if is_table and shown and isinstance(shown[-1], Table) else []
        lines += _table_lines(part, width, encoding) if is_table else _wrapped(str(part), width)
        shown.append(part)
    return _CONTROLS.sub("?", "\n".join(line.rstrip() for line in lines).rstrip("\n"))


def _within(part: Any, width: int) -> list[Any]:
    """A part of an answer, or a table that is too wide even with its words apart as several with the same first
    column."""
    part = _ours(part) if type(part).__module__ == "rich.table" else part
    if not isinstance(part, Table) or not part.rows or len(part.headings) < MIN_COLUMNS_TO_SPLIT:
        return [part]
    columns = enumerate(zip(part.headings, *part.rows, strict=True))
    groups = _groups([_least(own, is_words=i in part.words) for i, own in columns], width)
    captions = [part.caption, *[""] * (len(groups) - 1)]
    return [_columns(part, group, caption) for group, caption in zip(groups, captions, strict=True)]


def _ours(table: Any) -> Table:
    """A table of Rich as ours."""
    words = [i for i, column in enumerate(table.columns) if column.justify != "right"]
    rows = list(zip(*(column._cells for column in table.columns), strict=True))
    return Table([column.header for column in table.columns], rows, table.title or "", words)


def _groups(least: Sequence[int], width: int) -> list[list[int]]:
    """Columns of such widths that fit next to the first one."""
    groups, left = [[0]], width - least[0]
    for i in range(1, len(least)):
        if left < least[i] + 2 and len(groups[-1]) > 1:
            groups.append([0])
            left = width - least[0]
        groups[-1].append(i)
        left -= least[i] + 2  # columns stand two apart
    return groups


def _columns(table: Table, which: Sequence[int], caption: str) -> Table:
    """Some columns of a table."""
    rows = [[row[i] for i in which] for row in table.rows]
    words = [place for place, i in enumerate(which) if i in table.words]
    return Table([table.headings[i] for i in which], rows, caption, words)


MAX_NAME = 24
"""Setting: largest number of characters of names that are kept on one line."""


def longest_word(texts: Sequence[str]) -> int:
    """Characters of the longest word, where numbers stay with their signs and intervals."""
    return max(map(len, " ".join(texts).replace(" …", "_…").replace(" ± ", "_±_").split()), default=1)


def _least(texts: Sequence[str], *, is_words: bool) -> int:
    """Narrowest width of a column of heading and cells: numbers and names stay on one line, sentences and units in
    brackets are wrapped."""
    longest = max((len(piece) for text in texts[1:] for piece in re.split(r" (?=\[)", text)), default=0)
    if is_words and longest > MAX_NAME:
        return longest_word(texts)
    return max(longest, *map(len, texts[0].split()), 1)


def _table_lines(table: Table, width: int, encoding: str) -> list[str]:
    """Lines of a table: caption, headings, a rule and the rows, in characters that an encoding has."""
    grid = [[plain(str(cell), encoding) for cell in row] for row in (table.headings, *table.rows)]
    widths = _share_width(list(zip(*grid, strict=True)), table.words, width)
    lines = _wrapped(plain(table.caption, encoding), width) if table.caption else []
    for row in grid:
        cells = [_folded(text, own) for text, own in zip(row, widths, strict=True)]
        is_heading, height = row is grid[0], max(map(len, cells))
        filled = [[""] * (height - len(cell)) * is_heading + cell + [""] * (height - len(cell)) for cell in cells]
        for line in range(height):
            lines.append("  ".join(_padded(cell[line], i, widths, table.words) for i, cell in enumerate(filled)))
        lines += [plain("─", encoding) * (sum(widths) + 2 * (len(widths) - 1))] * is_heading
    return lines


def _folded(text: str, width: int) -> list[str]:
    """Lines of a cell; only a word that is wider than its column is broken."""
    return [line for part in text.split("\n") for line in textwrap.wrap(part, width, break_on_hyphens=False) or [""]]


def _padded(text: str, i: int, widths: Sequence[int], words: Sequence[int]) -> str:
    """A line of a cell of column i at the column's width, where East Asian characters take two places."""
    wide = sum(unicodedata.east_asian_width(sign) in "WF" for sign in text)
    return text.ljust(widths[i] - wide) if i in words else text.rjust(widths[i] - wide)


def _share_width(columns: Sequence[Sequence[str]], words: Sequence[int], width: int) -> list[int]:
    """Width of each column: of its longest word, and the narrowest of them get the rest; names are folded where nothing
    else helps."""
    natural = [max(map(len, own)) for own in columns]
    widths = [_least(own, is_words=i in words) for i, own in enumerate(columns)]
    spare = width - sum(widths) - 2 * (len(widths) - 1)  # columns stand two apart
    for i in sorted(range(len(widths)), key=lambda i: natural[i] - widths[i]):
        given = min(max(spare, 0), natural[i] - widths[i])
        widths[i] += given
        spare -= given
    while spare < 0 and max(widths) > 1:
        widths[max(range(len(widths)), key=lambda i: (i in words and widths[i] > 1, widths[i]))] -= 1
        spare += 1
    return widths


def _wrapped(text: str, width: int) -> list[str]:
    """On a terminal, lines broken between words; in a pipe, lines as they are."""
    lines: list[str] = []
    for line in text.split("\n"):
        indent = " " * (len(line) - len(line.lstrip()) + 2)
        lines += (
            textwrap.wrap(line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
            if sys.stdout.isatty()
            else [line]
        ) or [""]
    return lines

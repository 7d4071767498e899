"""Text for a terminal, a pipe or a notebook: the one place for their widths and character sets."""

import codecs
import itertools
import re
import shutil
import sys
import textwrap
import unicodedata
from typing import TYPE_CHECKING, Any

from windsysid.output.table import Table as OurTable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console
    from rich.table import Column, Table

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
    """Render tables, Rich's or ours, and plain lines as text.

    Tables are at most as wide as `width` or the terminal; cells are wrapped and never cut off.
    """
    from rich.console import Console
    from rich.table import Table

    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    width = width or max(shutil.get_terminal_size((DEFAULT_COLUMNS, 24)).columns, 20)
    console = Console(width=width, color_system=None, highlight=False, markup=False, emoji=False, soft_wrap=True)
    with console.capture() as capture:
        for part in itertools.chain.from_iterable(_within(one, width) for one in parts):
            shown = _as_rich(part) if isinstance(part, OurTable) else part
            if isinstance(shown, Table):
                _fit(shown, console, encoding)
                shown.title = _wrapped(str(shown.title), width) if shown.title else None
            console.print(shown if isinstance(shown, Table) else _wrapped(str(shown), width))
    text = "\n".join(line.rstrip() for line in capture.get().split("\n")).rstrip("\n")
    return _CONTROLS.sub("?", text)


def _within(part: Any, width: int) -> list[Any]:
    """A part of an answer, or a table that is too wide even with its words apart as several with the same first
    column."""
    if not isinstance(part, OurTable) or not part.rows or len(part.headings) < MIN_COLUMNS_TO_SPLIT:
        return [part]
    columns = enumerate(zip(part.headings, *part.rows, strict=True))
    groups = _groups([_least(own, i in part.words) for i, own in columns], width)
    captions = [part.caption, *[""] * (len(groups) - 1)]
    return [_columns(part, group, caption) for group, caption in zip(groups, captions, strict=True)]


def _groups(least: "Sequence[int]", width: int) -> list[list[int]]:
    """Columns of such widths that fit next to the first one."""
    groups, left = [[0]], width - least[0]
    for i in range(1, len(least)):
        if left < least[i] + 2 and len(groups[-1]) > 1:
            groups.append([0])
            left = width - least[0]
        groups[-1].append(i)
        left -= least[i] + 2  # columns stand two apart
    return groups


def _columns(table: OurTable, which: "Sequence[int]", caption: str) -> OurTable:
    """Some columns of a table."""
    rows = [[row[i] for i in which] for row in table.rows]
    words = [place for place, i in enumerate(which) if i in table.words]
    return OurTable([table.headings[i] for i in which], rows, caption, words)


MAX_NAME = 24
"""Setting: largest number of characters of names that are kept on one line."""


def longest_word(texts: "Sequence[str]") -> int:
    """Characters of the longest word, where numbers stay with their signs and intervals."""
    return max(map(len, " ".join(texts).replace(" …", "_…").replace(" ± ", "_±_").split()), default=1)


def _least(texts: "Sequence[str]", words: bool) -> int:
    """Narrowest width of a column of heading and cells: numbers and names stay on one line, sentences are wrapped."""
    longest = max(map(len, texts[1:]), default=0)
    if words and longest > MAX_NAME:
        return longest_word(texts)
    return max(longest, *map(len, texts[0].split()), 1)


def _as_rich(table: OurTable) -> "Table":
    from rich.table import Table

    shown = Table(title=table.caption or None, title_justify="left")
    for i, heading in enumerate(table.headings):
        shown.add_column(heading, justify="left" if i in table.words else "right")
    for row in table.rows:
        shown.add_row(*row)
    return shown


def _fit(table: "Table", console: "Console", encoding: str) -> None:
    """Spell characters that the encoding lacks, and fold cells instead of cutting them.

    A table that is too wide for its frame has none. A number stays on one line.
    """
    from rich import box
    from rich.measure import Measurement

    for column in table.columns:
        column.overflow, column.no_wrap = "fold", False
        column.header = plain(str(column.header), encoding)
        column._cells = [plain(str(cell), encoding) for cell in column._cells]
    if Measurement.get(console, console.options.update(max_width=10_000), table).maximum > console.width:
        table.box, table.show_edge, table.pad_edge, table.padding = box.SIMPLE_HEAD, False, False, (0, 1, 0, 0)
        _share_width(table.columns, console.width)


def _share_width(columns: "Sequence[Column]", width: int) -> None:
    """Give each column the width of its longest word, and the narrowest of them the rest."""
    texts = [[str(text) for text in (column.header, *column._cells)] for column in columns]
    natural = [max(map(len, own)) for own in texts]
    least = [_least(own, column.justify == "left") for own, column in zip(texts, columns, strict=True)]
    spare = width - sum(least) - 2 * (len(least) - 1)  # columns stand two apart
    for i in sorted(range(len(least)), key=lambda i: natural[i] - least[i]):
        if columns[i].justify == "right" or spare >= 0:  # names may be folded where nothing else helps
            given = min(max(spare, 0), natural[i] - least[i])
            columns[i].width = least[i] + given
            spare -= given


def _wrapped(text: str, width: int) -> str:
    """On a terminal, lines broken between words; in a pipe, lines as they are."""
    if not sys.stdout.isatty():
        return text
    lines: list[str] = []
    for line in text.split("\n"):
        indent = " " * (len(line) - len(line.lstrip()) + 2)
        lines += textwrap.wrap(
            line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
        ) or [""]
    return "\n".join(lines)

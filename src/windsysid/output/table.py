"""A table of text: columns and rows are said once, a terminal and an HTML page show them."""

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["READING", "Table"]

READING = "± is the 95 % interval. Numbers of grade A and B may be used, those of C not."
"""Explanation of tables of results."""


@dataclass(frozen=True)
class Table:
    """Rows of text under headings; columns in `words` are set left and may wrap, the others, numbers, are set right.

    `windsysid.output.console.render` shows it on a terminal, `windsysid.reports.html.report_page` on a page.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    words: Sequence[int] = (0,)

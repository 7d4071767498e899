"""Result of each part of the benchmark: a table as text, and windsysid's own costs as numbers, which the next
benchmark compares with its own.

    python benchmarks/sheets.py PART [--short] [--json FILE]

runs a part and keeps its tables. A part has a function ``sheets(short)``, or a ``main`` that prints tables with Rich.
"""

import argparse
import importlib
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

__all__ = ["Sheet", "medians", "number", "present"]


class Sheet(NamedTuple):
    """A table; `costs` are windsysid's own times by name, in any unit: only their ratios are compared."""

    title: str
    headings: tuple[str, ...]
    rows: list[tuple[str, ...]]
    costs: dict[str, float]

    def table(self) -> Table:
        table = Table(title=self.title, title_justify="left")
        for column, heading in enumerate(self.headings):
            numbers = all(row[column][:1].isdigit() or not row[column] for row in self.rows)
            table.add_column(heading, justify="right" if numbers else "left")
        for row in self.rows:
            table.add_row(*row)
        return table

    def markdown(self) -> str:
        lines = [self.headings, tuple("---" for _ in self.headings), *self.rows]
        return "\n".join([f"**{self.title}**", "", *(f"| {' | '.join(line)} |" for line in lines)])


def present(doc: str | None, sheets: Callable[[bool], Iterable[Sheet]]) -> None:
    """The command line of a part: print its tables, and write them to a file where one is named."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--short", action="store_true", help="leave out the long cases")
    parser.add_argument("--json", type=Path, help="write the tables to this file too")
    given = parser.parse_args()
    found = []
    for sheet in sheets(given.short):
        Console(width=140).print(sheet.table(), highlight=False)
        found.append(sheet._asdict())
    if given.json:
        given.json.write_text(json.dumps(found, ensure_ascii=False), encoding="utf-8")


def printed(main: Callable[[], None]) -> Iterator[Sheet]:
    """The Rich tables that a program prints.

    windsysid's costs stand under its name or "seconds"; the first row of a name counts.
    """
    tables: list[Table] = []
    usual, arguments = Console.print, sys.argv

    def keep(console: Console, *things: object, **options: object) -> None:
        tables.extend(thing for thing in things if isinstance(thing, Table))
        if not isinstance(things[0] if things else None, Table):
            usual(console, *things, **options)

    Console.print, sys.argv = keep, arguments[:1]  # type: ignore[method-assign]
    try:
        main()
    finally:
        Console.print, sys.argv = usual, arguments  # type: ignore[method-assign]
    for table in tables:
        headings = tuple(str(column.header) for column in table.columns)
        rows = list(zip(*(map(str, column.cells) for column in table.columns), strict=True))
        costs = {}
        for row in rows:
            for heading, cell in zip(headings[1:], row[1:], strict=True):
                if cell and (heading in ("windsysid", "seconds") or row[0].startswith("windsysid")):
                    costs[f"{table.title}: {row[0]}"] = float(cell)
                    break
        yield Sheet(str(table.title), headings, rows, costs)


def medians(
    runs: dict[str, Callable[[], object]], repeats: int, clock: Callable[[], float] = time.process_time
) -> dict[str, float]:
    """Median time of each [s], after one run that does not count.

    Runs take turns, so that a busy machine is busy for all.
    """
    for run in runs.values():
        run()
    times: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(repeats):
        for name, run in runs.items():
            begun = clock()
            run()
            times[name].append(clock() - begun)
    return {name: float(np.median(taken)) for name, taken in times.items()}


def number(value: float) -> str:
    """Three digits, thousands set apart."""
    digits = 0 if abs(value) >= 99.95 else 1 if abs(value) >= 9.995 else 2
    return f"{value:,.{digits}f}".replace(",", " ")


def main() -> None:
    part = importlib.import_module(sys.argv.pop(1))
    present(part.__doc__, getattr(part, "sheets", None) or (lambda _: printed(part.main)))


if __name__ == "__main__":
    main()

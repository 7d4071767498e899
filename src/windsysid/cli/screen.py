"""The first screen of an answer: the most important lines, at most 24 at 80 columns; `--verbose` prints the rest."""

import itertools
import math
import shutil
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from windsysid.output.console import DEFAULT_COLUMNS, render
from windsysid.output.table import READING, Table
from windsysid.units import engineering

if TYPE_CHECKING:
    from windsysid.results.estimate import Estimate
    from windsysid.results.identification import Identification

__all__ = ["first_screen", "identification_parts"]

MAX_SCREEN_LINES = 24
"""Setting: lines of a terminal, of which two are for the end of the screen and the place of the results."""
MAX_REASONS = 3
"""Setting: largest number of reasons against a result that its first screen lists."""


def first_screen(parts: Sequence[Table | str], lines: int = MAX_SCREEN_LINES - 2) -> str:
    """Render parts of an answer in their order, shortened to some lines.

    A table that a screen cannot hold is cut after whole rows; a smaller one, or one with fewer rows than half of the
    lines, is whole, even if the screen becomes longer. The verdict with its first reasons follows the first part that
    does not fit; what else follows is left out. The last line says how to see all.

    Examples
    --------
    >>> print(first_screen(["one", "two", "three"], lines=2))
    one
    … more: --verbose, or the page
    """
    whole = render(*parts)
    if _height(whole) <= lines:
        return whole
    shown = list[Table | str]()
    for i, part in enumerate(parts):
        room = lines - 1 - (_height(render(*shown)) if shown else 0)
        height = _height(render(part))
        if height <= room:
            shown.append(part)
            continue
        verdict = _verdict(parts[i + 1 :], lines // 4)
        is_whole = isinstance(part, Table) and min(height, 2 * len(part.rows)) < lines
        fitting = part if is_whole else _shorten(part, room - (_height(render(*verdict)) if verdict else 0))
        shown += verdict if fitting is None else [fitting, *verdict]
        break
    return render(*shown, "… more: --verbose, or the page")


def _verdict(parts: Sequence[Table | str], lines: int) -> list[Table | str]:
    """The sentence "trust: …" that begins some parts, with as many of its first reasons as fit into some lines."""
    if not (parts and isinstance(parts[0], str) and parts[0].startswith("trust: ")):
        return []
    said = list(itertools.takewhile(lambda part: isinstance(part, str), parts[: 1 + MAX_REASONS]))
    while said and _height(render(*said)) > lines:
        said.pop()
    return said


def _shorten(part: Table | str, lines: int) -> Table | str | None:
    """A part that takes no more than some lines: itself, a table with fewer rows, or None."""
    if _height(render(part)) <= lines:
        return part
    if isinstance(part, Table):
        for count in range(len(part.rows) - 1, 0, -1):
            shorter = replace(part, rows=part.rows[:count])
            if _height(render(shorter)) <= lines:
                return shorter
    return None


def _height(text: str) -> int:
    """Lines that a text takes on the terminal."""
    width = max(shutil.get_terminal_size((DEFAULT_COLUMNS, MAX_SCREEN_LINES)).columns, 20)
    return sum(max(1, math.ceil(len(line) / width)) for line in text.split("\n"))


def identification_parts(found: "Identification") -> list[Table | str]:
    """The first screen of an identification: modes with 95 % intervals and grades, findings with advice, then the
    coefficients."""
    judged = found.diagnosis
    reasons = judged.reasons[:MAX_REASONS]
    wrong = [f"- {reason}" for reason in reasons]
    wrong += [f"- and {len(judged.reasons) - len(reasons)} more"] if len(judged.reasons) > len(reasons) else []
    unseen = [one for one in found.findings if one.code == "coordinate_locked"]
    parts: list[Table | str] = [
        f"{found.turbine}, {found.record}: {found.formulation} formulation",
        *([found.modes_table()] if found.modes else []),
        READING,
        "trust: yes, every number has grade A or B"
        if judged.trusted
        else "trust: NO, see the numbers of grade C, because",
        *wrong,
        *(f"- {one}; if a sensor is there, check the names of its channels" for one in unseen),
        _coefficients(found.estimates),
    ]
    more = len(judged.remarks) + len(found.notes)
    return [*parts, f"{more} remarks and notes: --verbose, or the page"] if more else parts


def _coefficients(estimates: "Sequence[Estimate]") -> Table:
    """Coefficients in engineering units, two in a row where there are many."""
    cells = [(e.name, f"{' '.join(engineering(e.unit, e.estimate))} ± {_share(e)}  {e.grade}") for e in estimates]
    abreast = 1 if len(cells) <= MAX_SCREEN_LINES // 4 else 2
    step = math.ceil(len(cells) / abreast)
    rows = [sum((cells[k] for k in range(i, len(cells), step)), ()) for i in range(step)]
    padded = [(*row, *[""] * (2 * abreast - len(row))) for row in rows]
    return Table(("coefficient", "estimate ± 95 %, grade") * abreast, padded, words=range(0, 2 * abreast, 2))


def _share(e: "Estimate") -> str:
    """Half of the 95 % interval over the estimate."""
    return f"{float(f'{50.0 * (e.high - e.low) / abs(e.estimate):.2g}'):g} %" if e.estimate else "?"

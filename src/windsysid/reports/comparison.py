"""A comparison of two records as a figure and as one page."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.monitoring.change import MIN_CHANGE_ODDS, Comparison, QuantityChange
from windsysid.output.table import Table
from windsysid.reports.figures.drawing import drawn
from windsysid.reports.html import Section, png, report_page
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve

__all__ = ["figure", "files"]


def figure(comparison: Comparison, place: Axes | None = None) -> Figure:
    """Every change with its 95 % interval: stiffness and frequencies, damping, loads and noise, each on a scale of its
    own; orange where a coefficient changed. An interval without an end is left out."""
    return drawn(_plots(comparison), place, "The records determine no change.")


def files(comparison: Comparison) -> dict[str, bytes]:
    """``report.html``, ``changes.png`` and ``summary.json``, by name."""
    before, after = comparison.records
    caption = (
        f"From {before} (A) to {after} (B), priors removed. Orange: a coefficient that changed, at odds of"
        f" {MIN_CHANGE_ODDS:g} : 1 and more; grey: frequencies of modes, loads and noise. An interval without an end"
        " and a change that the records do not determine are in the table only."
    )
    text = [comparison.sentence, *comparison.doubts, *comparison.notes, caption]
    sections = [
        Section("What changed", text=text, plots=_plots(comparison)),
        Section("In numbers", text=READING, tables=[_table(comparison)]),
    ]
    return {
        "report.html": report_page("Changes between two records", f"{before} (A) → {after} (B)", sections),
        "changes.png": png(figure(comparison)),
        "summary.json": comparison.to_json().encode(),
    }


def _groups(comparison: Comparison) -> list[tuple[str, Sequence[QuantityChange]]]:
    """Changes that share a scale, with a title."""
    of_damping = [c for c in comparison.coefficients if c.kind == "damping"]
    rest = [c for c in (*comparison.coefficients, *comparison.modes) if c not in of_damping]
    titled = ("stiffness and frequencies", rest), ("damping", of_damping), ("loads and noise", comparison.statistics)
    return [(title, group) for title, group in titled if group]


def _plots(comparison: Comparison) -> list[Plot]:
    """Changes with their intervals, a plot a group."""
    plots = []
    for title, group in _groups(comparison):
        colours = np.array([_colour(c, comparison) for c in group])
        values = np.array([_finite(c) for c in group]).T
        if not np.isfinite(values).any():
            continue
        curves = [
            PlotCurve(name, at, low, high, "dots", colour)
            for name, colour in KINDS
            if (chosen := colours == colour).any()
            for at, low, high in [np.where(chosen, values, np.nan)]
        ]
        names = [c.name for c in group]
        axes = Axis("", names=names), Axis("change, 95 % interval [%]")
        plots.append(Plot(title, np.arange(len(group)), curves, *axes, marks=[Mark(0.0, across=True)]))
    return plots


KINDS = (("changed", "error"), ("coefficient", "estimate"), ("mode, load or noise", "measured"))
"""Names and colours of changes."""


def _finite(change: QuantityChange) -> tuple[float, float, float]:
    """Change and interval [%]; NaN where it is not determined or has no end."""
    values = (change.percent, change.low, change.high)
    return values if change.is_bounded and all(map(math.isfinite, values)) else (math.nan, math.nan, math.nan)


def _table(comparison: Comparison) -> Table:
    """The table of the terminal, with the ratio of the estimates next to the change without priors."""
    table = comparison.table()
    changes = (*comparison.coefficients, *comparison.modes, *comparison.statistics)
    ratios = ["" if math.isnan(c.ratio_percent) else f"{c.ratio_percent:+.2f}" for c in changes]
    headings = (*table.headings[:3], "B/A − 1 [%]", "priors removed [%]", *table.headings[4:])
    rows = [(*row[:3], ratio, *row[3:]) for row, ratio in zip(table.rows, ratios, strict=True)]
    return Table(headings, rows, table.caption, table.words)


READING = (
    'A and B are the two results, priors included, and B/A − 1 is their ratio. "Priors removed" is the change that the'
    " records show by themselves, with its 95 % interval: a prior pulls both results to the same value and hides a part"
    " of a change, most where a record says little. Judge a change by this column. Its interval takes masses and"
    " instruments as the files give them: their errors are the same in both records and shift A and B alike.",
    "Odds compare no change with one of the size that damage makes (10 % of a stiffness, half of a damping, a load or a"
    " noise); before the records they are even. None of 2176 coefficients without a change reached 100 : 1 in"
    " calibration, which shows nothing of rarer errors, so larger odds than 1000 : 1 are not shown. Frequencies are"
    " those of the models at the mean of the two rotor speeds: they change because coefficients do. Loads and"
    " noise also"
    " differ between records of a sound turbine.",
)


def _colour(change: QuantityChange, comparison: Comparison) -> str:
    if change in comparison.coefficients:
        return "error" if change in comparison.moved else "estimate"
    return "measured"

"""A comparison of two records as a figure and as one page."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.monitoring.change import MOVED_MIN_ODDS, Comparison, QuantityChange
from windsysid.output.table import Table
from windsysid.reports.figures.canvas import canvas
from windsysid.reports.figures.plots import ERROR, ESTIMATE, MEASURED, REFERENCE, symbol, tidy
from windsysid.reports.html import Section, png, report_page
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve

__all__ = ["figure", "files"]


def figure(comparison: Comparison, place: Axes | None = None) -> Figure:
    """Every change with its ±2σ band: stiffness and frequencies, damping, loads and noise, each on a scale of its own;
    orange where a coefficient moved.

    A band that has no end goes to the edge of the drawn; where nothing is determined it is dotted and has no dot.
    """
    groups = _groups(comparison)
    drawn = canvas((12.0, 1.0 + 0.32 * max(len(group) for _, group in groups)), place)
    for ax, (title, group) in zip(drawn.subplots(1, len(groups), squeeze=False)[0], groups, strict=True):
        _draw_changes(ax, group, comparison)
        ax.set_title(title, fontsize=10, loc="left")
    return drawn


def _draw_changes(ax: Axes, group: Sequence[QuantityChange], comparison: Comparison) -> None:
    """One line a change."""
    ends = [end for c in group for end in (c.low, c.percent, c.high) if c.is_bounded and math.isfinite(end)]
    low, high = (min(ends), max(ends)) if ends else (-100.0, 100.0)
    margin = 0.08 * max(high - low, 1e-3)
    left, right = min(low, -margin) - margin, max(high, margin) + margin
    rows = np.arange(len(group))[::-1]
    for row, change in zip(rows, group, strict=True):
        colour = _colour(change, comparison)
        band = [max(change.low, left), min(change.high, right)]
        if change.is_bounded:
            ax.plot(band, [row, row], color=colour, lw=5, alpha=0.45, solid_capstyle="butt")
            ax.plot(min(change.percent, right), row, "o", color=colour, ms=5)
        else:
            ax.plot([left, right], [row, row], color=colour, lw=1.5, ls=":")
    ax.axvline(0.0, color=REFERENCE, ls="--", lw=0.8)
    ax.set_yticks(rows, [symbol(c.name) for c in group])
    ax.set_ylim(-0.7, len(group) - 0.3)
    ax.set_xlim(left, right)
    ax.set_xlabel("change [%], ±2σ")
    tidy(ax)


def files(comparison: Comparison) -> dict[str, bytes]:
    """``report.html``, ``changes.png`` and ``summary.json``, by name."""
    drawn = png(figure(comparison))
    before, after = comparison.records
    caption = (
        f"From {before} (A) to {after} (B), priors removed. Orange: a coefficient that changed, at odds of"
        f" {MOVED_MIN_ODDS:g} : 1 and more; grey: frequencies of modes, loads and noise. An interval without an end"
        " and a change that the records do not determine are in the table only."
    )
    text = [comparison.sentence, *comparison.doubts, *comparison.notes, caption]
    sections = [
        Section("What moved", text=text, plots=_plots(comparison)),
        Section("In numbers", text=READING, tables=[_table(comparison)]),
    ]
    return {
        "report.html": report_page("Changes between two records", f"{before} (A) → {after} (B)", sections),
        "changes.png": drawn,
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
        moved = np.array([c in comparison.moved for c in group])
        others = "measured" if group is comparison.statistics else "estimate"
        values = np.array([_finite(c) for c in group]).T
        if not np.isfinite(values).any():
            continue
        curves = [
            PlotCurve(name, at, low, high, "dots", colour)
            for name, colour, chosen in (("moved", "error", moved), ("others", others, ~moved))
            if chosen.any()
            for at, low, high in [np.where(chosen, values, np.nan)]
        ]
        names = [c.name for c in group]
        axes = Axis("", names=names), Axis("change, ±2σ [%]")
        plots.append(Plot(title, np.arange(len(group)), curves, *axes, marks=[Mark(0.0, across=True)]))
    return plots


def _finite(change: QuantityChange) -> tuple[float, float, float]:
    """Change and interval [%]; NaN where it is not determined or has no end."""
    values = (change.percent, change.low, change.high)
    return values if change.is_bounded and all(map(math.isfinite, values)) else (math.nan, math.nan, math.nan)


def _table(comparison: Comparison) -> Table:
    """The table of the terminal, with the ratio of the estimates next to the change without priors."""
    table = comparison.table()
    changes = (*comparison.coefficients, *comparison.modes, *comparison.statistics)
    ratios = ["" if math.isnan(c.ratio_percent) else f"{c.ratio_percent:+.2f}" for c in changes]
    headings = (*table.headings[:4], "B/A − 1 [%]", "priors removed [%]", *table.headings[5:])
    rows = [(*row[:4], ratio, *row[4:]) for row, ratio in zip(table.rows, ratios, strict=True)]
    return Table(headings, rows, table.caption, table.words)


READING = (
    'A and B are the two results, priors included, and B/A − 1 is their ratio. "Priors removed" is the change that the'
    " records show by themselves, with its ±2σ interval: a prior pulls both results to the same value and hides a part"
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
        return ERROR if change in comparison.moved else ESTIMATE
    return MEASURED

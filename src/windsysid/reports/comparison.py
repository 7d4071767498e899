"""A comparison of two records as a figure and as one page."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.monitoring.change import MOVED_MIN_ODDS, Comparison, QuantityChange
from windsysid.reports.figures.canvas import canvas
from windsysid.reports.figures.plots import ERROR, ESTIMATE, MEASURED, REFERENCE, symbol, tidy
from windsysid.reports.html import Section, png, report_page

__all__ = ["figure", "files"]


def figure(comparison: Comparison, place: Axes | None = None) -> Figure:
    """Every change with its ±2σ band: stiffness and frequencies, damping, loads and noise, each on a scale of its own;
    orange where a coefficient moved.

    A band that has no end goes to the edge of the drawn; where nothing is told it is dotted and has no dot.
    """
    of_damping = [c for c in comparison.coefficients if c.kind == "damping"]
    rest = [c for c in (*comparison.coefficients, *comparison.modes) if c not in of_damping]
    titled = ("stiffness and frequencies", rest), ("damping", of_damping), ("loads and noise", comparison.statistics)
    groups = [(title, group) for title, group in titled if group]
    drawn = canvas((12.0, 1.0 + 0.32 * max(len(group) for _, group in groups)), place)
    for ax, (title, group) in zip(drawn.subplots(1, len(groups), squeeze=False)[0], groups, strict=True):
        _draw_changes(ax, group, comparison)
        ax.set_title(title, fontsize=10, loc="left")
    return drawn


def _draw_changes(ax: Axes, group: Sequence[QuantityChange], comparison: Comparison) -> None:
    """One line a change."""
    ends = [end for c in group for end in (c.low, c.percent, c.high) if c.told and math.isfinite(end)]
    low, high = (min(ends), max(ends)) if ends else (-100.0, 100.0)
    margin = 0.08 * max(high - low, 1e-3)
    left, right = min(low, -margin) - margin, max(high, margin) + margin
    rows = np.arange(len(group))[::-1]
    for row, change in zip(rows, group, strict=True):
        colour = _colour(change, comparison)
        band = [max(change.low, left), min(change.high, right)]
        if change.told:
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
        f"From {before} (A) to {after} (B). Orange: a coefficient that moved, at odds of {MOVED_MIN_ODDS:g} : 1 and"
        " more; grey: frequencies of modes, loads and noise. A band that reaches the edge has no end there; a dotted"
        " line: the records do not tell."
    )
    sections = [
        Section(
            "What moved", text=[comparison.sentence, *comparison.doubts, *comparison.notes], figures=[(drawn, caption)]
        ),
        Section("In numbers", text=[READING], tables=[comparison.table()]),
    ]
    return {
        "report.html": report_page("What moved between two records", f"{before} (A) → {after} (B)", sections),
        "changes.png": drawn,
        "summary.json": comparison.to_json().encode(),
    }


READING = (
    "A and B are the two results, priors included. The change is what the records say without the priors; where a"
    " record says little, it differs from B − A. Change and band are of B over A. Odds compare no change with one of"
    " the size that damage makes (10 % of a stiffness, half of a damping, a load or a noise); before the records they"
    " are even. Frequencies are those of the models at the mean of the two rotor speeds: they move because coefficients"
    " do. Loads and noise also differ between records of a sound turbine."
)


def _colour(change: QuantityChange, comparison: Comparison) -> str:
    if change in comparison.coefficients:
        return ERROR if change in comparison.moved else ESTIMATE
    return MEASURED

"""A comparison of two records as a figure and as one page."""

import numpy as np
from matplotlib.figure import Figure

from windsysid.comparison import HEADINGS, MOVED, Change, Comparison
from windsysid.plots import ERROR, ESTIMATE, MEASURED, REFERENCE, symbol, tidy
from windsysid.report import Section, Table, png, report_page

__all__ = ["changes_figure", "comparison_files"]


def changes_figure(comparison: Comparison) -> Figure:
    """Every change with its ±2σ band, stiffness and frequencies on one scale, damping on another; orange where it moved."""
    of_damping = [c for c in comparison.coefficients if c.name.startswith("c_")]
    rest = [c for c in (*comparison.coefficients, *comparison.modes) if c not in of_damping]
    groups = [
        (title, group) for title, group in (("stiffness and frequencies", rest), ("damping", of_damping)) if group
    ]
    figure = Figure(figsize=(10.0, 1.0 + 0.32 * max(len(group) for _, group in groups)), layout="constrained")
    for ax, (title, group) in zip(figure.subplots(1, len(groups), squeeze=False)[0], groups, strict=True):
        rows = np.arange(len(group))[::-1]
        for row, change in zip(rows, group, strict=True):
            ax.plot(
                [change.low, change.high], [row, row], color=_colour(change), lw=5, alpha=0.45, solid_capstyle="butt"
            )
            ax.plot(change.percent, row, "o", color=_colour(change), ms=5)
        ax.axvline(0.0, color=REFERENCE, ls="--", lw=0.8)
        ax.set_yticks(rows, [symbol(c.name) if c.name.startswith(("k_", "c_")) else c.name for c in group])
        ax.set_ylim(-0.7, len(group) - 0.3)
        ax.set_title(title, fontsize=10, loc="left")
        ax.set_xlabel("change [%], ±2σ")
        tidy(ax)
    return figure


def comparison_files(comparison: Comparison) -> dict[str, bytes]:
    """``report.html``, ``changes.png`` and ``summary.json``, by name."""
    figure = png(changes_figure(comparison))
    before, after = comparison.records
    caption = f"From {before} (A) to {after} (B). Orange: moved, at odds of {MOVED:g} : 1 and more; grey: frequencies of modes."
    sections = [
        Section("What moved", text=[comparison.sentence, *comparison.doubts], figures=[(figure, caption)]),
        Section("In numbers", text=[READING], tables=[Table(HEADINGS, comparison.rows, words=(0, 1))]),
    ]
    return {
        "report.html": report_page("What moved between two records", f"{before} (A) → {after} (B)", sections),
        "changes.png": figure,
        "summary.json": comparison.to_json().encode(),
    }


READING = (
    "What both records say of a coefficient is compared, not what the priors said. Odds are those of a change of the size that damage makes (10 % of a "
    "stiffness, half of a damping) against none, equally likely before. The last column is the probability of a difference this large "
    "without any change. Frequencies are those of the models at A's rotor speed: they move because coefficients do."
)


def _colour(change: Change) -> str:
    if change.name.startswith(("k_", "c_")):
        return ERROR if change.moved else ESTIMATE
    return MEASURED

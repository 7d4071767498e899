"""Structural and aerodynamic damping as a figure and as one page."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.monitoring.separation import DampingSplit, Separation
from windsysid.output.table import Table
from windsysid.reports.figures.canvas import canvas
from windsysid.reports.figures.plots import BAND, ERROR, ESTIMATE, MEASURED, REFERENCE, symbol, tidy
from windsysid.reports.html import Section, png, report_page

__all__ = ["figure", "files"]

COLUMNS = 3


def figure(separation: Separation, place: Axes | None = None) -> Figure:
    """Draw every record's damping in % of critical: structure's share, air's share, and the record's own value."""
    splits, states = separation.splits, separation.states
    columns = min(COLUMNS, len(splits))
    rows = -(-len(splits) // columns)
    order = sorted(
        range(len(states)), key=lambda i: (not states[i].parked, states[i].rotor_speed, states[i].wind_speed or 0.0)
    )
    width = max(3.4, 1.2 + 0.75 * len(states))
    drawn = canvas((width * columns, 3.2 * rows + 0.4), place)
    panels = drawn.subplots(rows, columns, squeeze=False).ravel()
    for ax, split in zip(panels, splits, strict=False):
        _panel(ax, split, order, separation.base)
        ax.set_xticks(range(len(order)), [str(states[i]).replace(", ", "\n") for i in order], fontsize=8)
        ax.set_xlim(-0.6, len(order) - 0.4)
        ax.set_title(symbol(split.name), fontsize=10, loc="left")
        tidy(ax)
    for ax in panels[len(splits) :]:
        ax.remove()
    for ax in panels[: len(splits) : columns]:
        ax.set_ylabel("% of critical")
    handles = {
        label: handle for ax in drawn.axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    drawn.legend(handles.values(), handles.keys(), loc="outside upper center", ncols=4, frameon=False, fontsize=9)
    return drawn


def _panel(ax: Axes, split: DampingSplit, order: list[int], base: str) -> None:
    at, percent = np.arange(len(order)), 0.01 * split.critical
    measured = [split.measured[i].over(percent) for i in order]
    if split.structural is not None:
        structure = split.structural.over(percent)
        air = [part.value / percent if (part := split.aerodynamic[i]) is not None else 0.0 for i in order]
        ax.bar(at, structure.value, 0.55, color=BAND, label=base)
        fill = ["white" if share < 0.0 else ESTIMATE for share in air]
        ax.bar(at, air, 0.55, bottom=structure.value, color=fill, edgecolor=ESTIMATE, label="air")
        ax.axhspan(structure.low, structure.high, color=BAND, alpha=0.35, lw=0, zorder=0)
        ax.axhline(structure.value, color=REFERENCE, ls="--", lw=0.8)
    value, low, high = np.transpose(measured)
    ax.errorbar(
        at, value, yerr=[value - low, high - value], fmt="o", ms=4,
        color=ERROR if split.structural is None else MEASURED,
        ecolor=MEASURED, mec=REFERENCE, mew=0.6, elinewidth=1.4, label="total by the record itself, 95 % interval",
    )  # fmt: skip
    ax.axhline(0.0, color=REFERENCE, lw=0.6)


def files(separation: Separation) -> dict[str, bytes]:
    """``report.html``, ``damping.png`` and ``summary.json``, by name."""
    drawn = figure(separation)
    caption = (
        f"Lower bars: {separation.base}, its 95 % interval shaded; upper bars: the aerodynamic part in that state,"
        " hollow where it is negative. Points: the total damping from each record alone, its prior removed."
    )
    records = Table(("record", "state"), [(state.record, str(state)) for state in separation.states], "Records", (0, 1))
    sections = [
        Section(
            "Structure and air",
            text=[separation.sentence, *separation.lacking, *(f"WARNING: {doubt}" for doubt in separation.doubts),
            *separation.notes],
            figures=[(drawn, caption)],
        ),
        Section("In numbers", tables=[separation.table(), records]),
    ]  # fmt: skip
    subtitle = (
        f"{len(separation.states)} records, {sum(state.parked for state in separation.states)} of them of a parked"
        " rotor"
    )
    return {
        "report.html": report_page("Structural and aerodynamic damping", subtitle, sections),
        "damping.png": png(drawn),
        "summary.json": separation.to_json().encode(),
    }

"""Descriptions of plots as Matplotlib figures, for files and notebooks."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import ConciseDateFormatter
from matplotlib.figure import Figure

from windsysid.reports.figures.canvas import MAX_TICK_CHARACTERS, canvas, label, single
from windsysid.reports.figures.plots import ERROR, ESTIMATE, MEASURED, REFERENCE, symbol, tidy
from windsysid.reports.interactive.plot import Plot, PlotCurve

__all__ = ["drawn"]

COLOURS = {"estimate": ESTIMATE, "measured": MEASURED, "reference": REFERENCE, "error": ERROR, "other": "#2e7d46"}

LOOKS: dict[str, dict[str, Any]] = {
    "dots": {"fmt": "o", "elinewidth": 1.4}, "bars": {"fmt": "none", "elinewidth": 8.0, "alpha": 0.35},
}  # fmt: skip

WIDTH, HEIGHT = 6.2, 2.9
"""Setting: size of a plot [inches]."""

FEW = 60
"""Setting: points up to which they are drawn larger."""

MAX_NAMED, MAX_TICKS, END_GAP = 8, 12, 0.04
"""Setting: curves and ticks that are named, and distance of names at ends of curves [height of the axes]."""


def drawn(plots: Sequence[Plot], place: Axes | None = None, nothing: str = "", columns: int = 2) -> Figure:
    """Draw plots in columns, a single one on the given axes, or a sentence if there are none."""
    if not plots:
        figure = canvas((WIDTH, HEIGHT), place)
        figure.text(0.5, 0.5, nothing, ha="center", va="center", fontsize=9, wrap=True)
        return figure
    if len(plots) == 1:
        figure, ax = single((1.5 * WIDTH, 1.5 * HEIGHT), place)
        _draw(ax, plots[0])
        return figure
    rows, size = -(-len(plots) // columns), 1.0 if columns > 1 else 1.5
    figure = canvas((size * columns * WIDTH, size * rows * HEIGHT), place)
    panels = figure.subplots(rows, columns, squeeze=False).flat
    for plot, ax in zip(plots, panels, strict=False):  # plots end first, so that no panel is taken in vain
        _draw(ax, plot)
    for ax in panels:
        ax.set_visible(False)
    return figure


def _draw(ax: Axes, plot: Plot) -> None:
    for span in plot.spans:
        ax.axvspan(*_times(plot, [span.start, span.end]), color=COLOURS[span.colour], alpha=0.2, lw=0)
    for curve in plot.curves:
        _draw_curve(ax, _times(plot, plot.x), curve)
    _draw_marks(ax, plot)
    _set_axes(ax, plot)
    _name_ends(ax, _times(plot, plot.x), plot.curves if plot.end_names else ())
    ax.set_title(label(plot.title), fontsize=9, loc="left", pad=14 if any(m.name for m in plot.marks) else 4)
    if 1 < len(plot.curves) <= MAX_NAMED and not plot.end_names:
        ax.legend(fontsize=7.5, frameon=False)
    tidy(ax)


def _times(plot: Plot, values: Any) -> Any:
    """Places along x: moments where these are seconds since 1970."""
    values = np.asarray(values, dtype=np.float64)
    return (1e6 * values).astype("datetime64[us]") if plot.x_axis.dates else values


def _draw_curve(ax: Axes, x: Any, curve: PlotCurve) -> None:
    colour, values = COLOURS[curve.colour], np.asarray(curve.values, dtype=np.float64)
    ends = None if curve.low is None else np.array([curve.low, curve.high], dtype=np.float64)
    if curve.look in LOOKS:
        size: Any = {"ms": 5.0 if len(x) <= FEW else 2.0} if curve.look == "dots" else {}
        reach = None if ends is None else np.abs(ends - values)
        ax.errorbar(x, values, yerr=reach, color=colour, label=label(curve.name), **LOOKS[curve.look], **size)
        return
    if ends is not None:
        whole = curve.look == "area"  # with an edge, so that a constant is seen
        ax.fill_between(x, *ends, color=colour, alpha=1.0 if whole else 0.3, lw=0.6 * whole)
    if curve.look == "line":
        ax.plot(x, values, color=colour, lw=1.2, ls="--" if curve.dashed else "-", label=label(curve.name))


def _draw_marks(ax: Axes, plot: Plot) -> None:
    """Draw marks with their names, those of vertical ones above where they have room."""
    last = -np.inf
    for mark in sorted(plot.marks, key=lambda one: one.at):
        colour = COLOURS[mark.colour]
        if mark.across:
            ax.axhline(mark.at, color=colour, ls="--", lw=0.8)
            ax.annotate(label(mark.name), (0.01, mark.at), (0, 2), xycoords=ax.get_yaxis_transform(),
                        textcoords="offset points", fontsize=7.5, color=colour)  # fmt: skip
            continue
        (at,) = _times(plot, [mark.at])
        ax.axvline(at, color=colour, ls=":", lw=0.9)
        low, high = plot.x_axis.limits or (np.nanmin(plot.x), np.nanmax(plot.x))
        if mark.name and low <= mark.at <= high and mark.at - last > 0.06 * (high - low):
            ax.annotate(label(mark.name, MAX_TICK_CHARACTERS), (at, 1.01), xycoords=ax.get_xaxis_transform(),
                        fontsize=7.5, color=colour, ha="center")  # fmt: skip
            last = mark.at


def _name_ends(ax: Axes, x: Any, curves: Sequence[PlotCurve]) -> None:
    """Name curves at their right ends, those of one colour that end together with one text; others at their last
    points."""
    place, ends = ax.transScale + ax.transLimits, list[tuple[float, PlotCurve]]()
    for one in curves:
        known: Any = np.flatnonzero(np.isfinite(one.values)) if one.look == "line" else []
        if len(known) and known[-1] >= 0.99 * (len(x) - 1):
            ends.append((float(np.asarray(one.values)[known[-1]]), one))
        elif len(known):
            ax.annotate(symbol(one.name), (x[known[-1]], np.asarray(one.values)[known[-1]]), (4, -4), fontsize=8,
                        textcoords="offset points", color=COLOURS[one.colour], ha="left", va="top")  # fmt: skip
    for at, colour, names in _groups((float(place.transform((1.0, value))[1]), one) for value, one in ends):
        ax.text(1.01, at, ", ".join(names), transform=ax.transAxes, color=COLOURS[colour], fontsize=8, va="center")


def _groups(ends: Iterable[tuple[float, PlotCurve]]) -> list[tuple[float, str, list[str]]]:
    """Place, colour and names of the curves of one colour that end together."""
    groups: list[tuple[float, str, list[str]]] = []
    for at, one in sorted(ends, key=lambda end: end[0]):
        if groups and at - groups[-1][0] < END_GAP and one.colour == groups[-1][1]:
            groups[-1][2].append(symbol(one.name))
        else:
            groups.append((at, one.colour, [symbol(one.name)]))
    return groups


def _set_axes(ax: Axes, plot: Plot) -> None:
    x_axis, y_axis = plot.x_axis, plot.y_axis
    ax.set(xlabel=x_axis.label, ylabel=y_axis.label)
    if x_axis.log:
        ax.set_xscale("log")
    if y_axis.log:
        ax.set_yscale("log")
    ax.set_xlim((-0.5, len(x_axis.names) - 0.5) if x_axis.names else x_axis.limits)
    ax.set_ylim(y_axis.limits)
    if x_axis.names:
        every = -(-len(x_axis.names) // MAX_TICKS)
        names = [label(name, MAX_TICK_CHARACTERS) for name in x_axis.names[::every]]
        ax.set_xticks(range(0, len(x_axis.names), every), names, rotation=25, ha="right")
    if x_axis.dates:
        ax.xaxis.set_major_formatter(ConciseDateFormatter(ax.xaxis.get_major_locator()))  # type: ignore[no-untyped-call]

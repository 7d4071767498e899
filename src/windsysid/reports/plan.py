"""A plan as a figure and as one page."""

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from windsysid._types import Array
from windsysid.checks.identifiability import standard_deviations
from windsysid.identification.planning.plan import Plan, percent
from windsysid.output.table import Table
from windsysid.reports.figures.canvas import label, single
from windsysid.reports.figures.plots import ERROR, ESTIMATE, MEASURED, REFERENCE, symbol, tidy
from windsysid.reports.html import Section, png, report_page
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve
from windsysid.results.posterior import SIGMAS
from windsysid.units import RPM, spell

__all__ = ["figure", "files"]


TICKS = (1, 3, 10, 30, 60, 180, 600, 1800, 3600, 10800, 36000, 86400, 259200, 864000, 2592000, 8640000, 31536000)
"""Durations [s] that the axis may name."""

MINUTE = 60.0

LABEL_SHARE_FACTOR = 1.12
"""Factor within which curves share a label."""


def _durations(plan: Plan) -> tuple[list[str], Array, Array]:
    """Parameters that the sensors see, durations (T,) [s], and ±2σ of each [%] (T, n)."""
    seen = [name for name in plan.coefficients if math.isfinite(plan.band(name))]
    needed = [duration for duration in map(plan.needed, seen) if duration < 100.0 * plan.duration]
    time = np.geomspace(plan.start_seconds, max(3.0 * max([plan.duration, *needed]), 10.0 * plan.start_seconds), 60)
    sigmas = np.array([standard_deviations(plan.information(t)) for t in time])
    return seen, time, 100.0 * SIGMAS * sigmas[:, [plan.names.index(name) for name in seen]]


def figure(plan: Plan, place: Axes | None = None) -> Figure:
    """±2σ of every parameter against duration, with the wish and the planned duration.

    Stiffness is blue, damping orange, anything else grey.
    """
    seen, time, bands = _durations(plan)
    drawn, ax = single((9.0, 5.2), place)
    _draw_bands(ax, time, dict(zip(seen, bands.T, strict=True)), plan.kinds)
    ax.axhline(100.0 * plan.within, color=REFERENCE, ls="--", lw=1)
    ax.text(1.05 * time[0], 103.0 * plan.within, f"wish: ±{percent(plan.within)}", fontsize=8, va="bottom")
    ax.axvline(plan.duration, color=REFERENCE, ls=":", lw=1)
    planned = f"planned: {spell(plan.duration)}"
    ax.text(plan.duration, 1.01, planned, transform=ax.get_xaxis_transform(), ha="center", fontsize=8)
    ax.set(xlabel="duration", ylabel="95 % interval, ± [% of the value]", xlim=(time[0], time[-1]))
    ticks = [t for t in TICKS if time[0] <= t <= time[-1]]
    ax.set_xticks(ticks, [spell(t) for t in ticks])
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    tidy(ax)
    return drawn


def _draw_bands(ax: Axes, time: Array, curves: dict[str, Array], kinds: Mapping[str, str]) -> None:
    """Draw ±2σ of each parameter against time, with one label where curves end together."""
    groups: list[tuple[str, float, list[str]]] = []
    for name, curve in sorted(curves.items(), key=lambda one: float(one[1][-1])):
        colour = {"stiffness": ESTIMATE, "damping": ERROR}.get(kinds.get(name, ""), MEASURED)
        ax.loglog(time, curve, color=colour, lw=1.2, alpha=0.8)
        shown = symbol(name) if colour != MEASURED else label(name)
        if groups and groups[-1][0] == colour and curve[-1] < LABEL_SHARE_FACTOR * groups[-1][1]:
            groups[-1][2].append(shown)
        else:
            groups.append((colour, float(curve[-1]), [shown]))
    for colour, end, labels in groups:
        text = ", ".join(sorted(labels))
        ax.annotate(text, (time[-1], end), (6, 0), textcoords="offset points", color=colour, va="center", fontsize=9)


def _plot(plan: Plan) -> Plot:
    """`figure` for the page."""
    seen, time, bands = _durations(plan)
    colours = {"stiffness": "estimate", "damping": "error"}
    curves = [
        PlotCurve(name, band, colour=colours.get(plan.kinds.get(name, ""), "measured"))
        for name, band in zip(seen, bands.T, strict=True)
    ]
    marks = [
        Mark(100.0 * plan.within, f"wish: ±{percent(plan.within)}", across=True),
        Mark(plan.duration / MINUTE, f"planned: {spell(plan.duration)}"),
    ]
    x_axis, y_axis = Axis("duration [min]", log=True), Axis("95 % interval, ± [% of the value]", log=True)
    return Plot("Intervals by duration", time / MINUTE, curves, x_axis, y_axis, marks, end_names=True)


def files(plan: Plan) -> dict[str, bytes]:
    """``report.html``, ``plan.png`` and ``summary.json``, by name."""
    caption = "From the data alone, without a prior; ± is the 95 % interval. Blue: stiffness, orange: damping."
    sections = [
        Section("What can these sensors identify?", text=[plan.sentence, *plan.answers],
        tables=[Table(plan.headings, plan.rows)]),
        *([Section("What widens the intervals", tables=[plan.budget.table()])] if plan.budget.rows else []),
        Section("How long it takes", text=[caption], plots=[_plot(plan)]),
        Section("What can be identified", text=plan.directions or ["Every parameter can be identified."]),
        Section("How this was computed", text=plan.notes),
    ]  # fmt: skip
    speed = f"{plan.rotor_speed * RPM:.3g} rpm"
    subtitle = f"{plan.turbine} at {speed} · {', '.join(plan.sensors)} · {spell(plan.duration)} at {plan.rate:g} Hz"
    return {
        "report.html": report_page("Plan of a measurement", subtitle, sections),
        "plan.png": png(figure(plan)),
        "summary.json": plan.to_json().encode(),
    }

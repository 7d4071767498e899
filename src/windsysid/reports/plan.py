"""A plan as a figure and as one page."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid._types import Array
from windsysid.checks.identifiability import standard_deviations
from windsysid.identification.planning.plan import Plan
from windsysid.inspection.sentences import percent
from windsysid.output.table import Table, axes_of
from windsysid.reports.figures.drawing import drawn
from windsysid.reports.html import Section, png, report_page
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve
from windsysid.results.posterior import SIGMAS
from windsysid.units import RPM, spell

__all__ = ["figure", "files"]


MINUTE = 60.0


def _durations(plan: Plan) -> tuple[list[str], Array, Array]:
    """Parameters that the sensors see, durations (T,) [s], and ±2σ of each [%] (T, n)."""
    seen = [name for name in plan.coefficients if math.isfinite(plan.band(name))]
    needed = [duration for duration in map(plan.needed, seen) if duration < 100.0 * plan.duration]
    time = np.geomspace(plan.start_seconds, max(3.0 * max([plan.duration, *needed]), 10.0 * plan.start_seconds), 60)
    sigmas = np.array([standard_deviations(plan.information(t)) for t in time])
    return seen, time, 100.0 * SIGMAS * sigmas[:, [plan.names.index(name) for name in seen]]


def figure(plan: Plan, place: Axes | None = None) -> Figure:
    """95 % interval of every parameter against duration, with the target and the planned duration.

    Stiffness is blue, damping orange, anything else grey.
    """
    return drawn([_plot(plan)], place)


def _plot(plan: Plan) -> Plot:
    """Intervals of the parameters over the duration."""
    seen, time, bands = _durations(plan)
    colours = {"stiffness": "estimate", "damping": "error"}
    curves = [
        PlotCurve(name, band, colour=colours.get(plan.kinds.get(name, ""), "measured"))
        for name, band in zip(seen, bands.T, strict=True)
    ]
    marks = [
        Mark(100.0 * plan.within, f"target: ±{percent(plan.within)}", across=True),
        Mark(plan.duration / MINUTE, f"planned: {spell(plan.duration)}"),
    ]
    x_axis, y_axis = Axis("duration [min]", log=True), Axis("95 % interval, ± [% of the value]", log=True)
    return Plot("Intervals by duration", time / MINUTE, curves, x_axis, y_axis, marks, end_names=True)


def files(plan: Plan) -> dict[str, bytes]:
    """``report.html``, ``plan.png`` and ``summary.json``, by name."""
    caption = "From the data alone, without a prior; ± is the 95 % interval. Blue: stiffness, orange: damping."
    sections = [
        Section("What can these sensors identify?", text=[plan.sentence, *plan.answers],
        tables=[Table(plan.headings, plan.rows, f"Stiffness k, damping c{axes_of(plan.coefficients)}")]),
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

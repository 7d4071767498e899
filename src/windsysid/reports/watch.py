"""A watch over many records as a figure and as one page."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid._types import Array
from windsysid.mechanics.sensors import noise_source
from windsysid.monitoring.changes import Watch
from windsysid.monitoring.series import DAY
from windsysid.output.table import Table, titled
from windsysid.reports.figures.drawing import drawn
from windsysid.reports.html import Section, png, report_page
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve, ShadedRange
from windsysid.units import engineering_unit

__all__ = ["figure", "files"]

MAX_POINTS = 1000
"""Blocks shown of a long series; alarms and levels are shown whole."""


def figure(watch: Watch, place: Axes | None = None) -> Figure:
    """Every series with its level, 95 % interval and alarms on the left, the statistic of its test on the right."""
    return drawn(_plots(watch), place)


def _limits(values: Array) -> tuple[float, float]:
    """Limits of an axis that shows all but the farthest values."""
    low, high = np.percentile(values[np.isfinite(values)], [0.5, 99.5])
    room = 0.3 * (high - low) or 0.01 * abs(high) or 1.0
    return low - room, high + room


def _plots(watch: Watch) -> list[Plot]:
    """Every series, and the statistic of its test, of a series longer than `MAX_POINTS` every so many records."""
    begin = watch.blocks.begin
    origin, unit = (0.0, DAY) if begin is None else (begin.timestamp(), 1.0)
    step = -(-len(watch.blocks.time) // MAX_POINTS)
    x_axis = Axis("day") if begin is None else Axis("", dates=True)

    def moment(time: Any) -> Any:
        return origin + time / unit

    plots = []
    for s in watch.series:
        found = [c for c in watch.changes if c.name == s.name]
        marks = [Mark(moment(c.time), f"{c.percent:+.2g} %", "error", "jumps") for c in found]
        spans = [ShadedRange(moment(c.earliest), moment(c.latest), "jumps", "error") for c in found]
        size, text = engineering_unit(s.unit, s.level[-1])
        adjusted, level, low, high = (values[::step] / size for values in (s.adjusted, s.level, s.low, s.high))
        curves = [
            PlotCurve("records", adjusted, look="dots", colour="measured"), PlotCurve("level", level, low, high)
        ]  # fmt: skip
        name = titled(noise_source(s.name) or s.name)
        y_axis, time = Axis(f"[{text}]", limits=_limits(s.adjusted / size)), moment(watch.blocks.time[::step])
        plots.append(Plot(name, time, curves, x_axis, y_axis, marks, spans, link="time"))
        test = PlotCurve("test ÷ threshold", _highest(s.statistic, step) / s.limit)
        threshold = Mark(1.0, "threshold", "reference", "threshold", across=True)
        plots.append(Plot(f"{name}, test", time, [test], x_axis, Axis("[1]"), [threshold, *marks], link="time"))
    return plots


def files(watch: Watch) -> dict[str, bytes]:
    """``report.html``, ``monitor.png`` and ``summary.json``, by name."""
    caption = (
        "Grey: records less the effect of covariates. Blue: the level as it was known after each, with its 95 %"
        " interval. Next to it: the test for a jump as a share of its threshold. Orange: jumps with an alarm, and"
        " when they happened."
    )
    jumps = Table(
        ("quantity", "when", "found", "change", "95 % interval", "where to look"),
        [
            (
                c.name, watch.blocks.between(c.earliest, c.latest), watch.blocks.when(c.found), f"{c.percent:+.3g} %",
                f"{c.low:+.3g} … {c.high:+.3g} %", c.cause,
            )
            for c in watch.changes
        ],
        words=(0, 5),
    )  # fmt: skip
    sections = [
        Section("What changed", text=[watch.sentence, *watch.notes], tables=[jumps] if watch.changes else []),
        Section("Record by record", text=[caption], plots=_plots(watch)),
        Section("In numbers", text=[READING], tables=watch.tables()),
    ]
    subtitle = f"{len(watch.blocks.time)} records, {watch.alarms_per_year:g} false alarms a year"
    return {
        "report.html": report_page("What changed over many records", subtitle, sections),
        "monitor.png": png(figure(watch)),
        "summary.json": watch.to_json().encode(),
    }


READING = (
    "Levels are those at the covariates' mean while learning. Drift is the change since then, jumps included. The"
    " random walk of a level in a day and the scatter beyond the records' own σ are learned from the records. A"
    " jump of the"
    " size in the last column is found within a day in nine cases of ten."
)


def _highest(values: np.ndarray, step: int) -> np.ndarray:
    """The highest of each `step` values."""
    padded = np.full(-(-len(values) // step) * step, -np.inf)
    padded[: len(values)] = values
    return np.asarray(padded.reshape(-1, step).max(axis=1))

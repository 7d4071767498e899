"""A watch over many records as a figure and as one page."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import ConciseDateFormatter
from matplotlib.figure import Figure

from windsysid._types import Array
from windsysid.mechanics.sensors import noise_source
from windsysid.monitoring.changes import Watch, WatchedSeries
from windsysid.monitoring.series import DAY
from windsysid.output.table import Table
from windsysid.reports.figures.canvas import canvas
from windsysid.reports.figures.plots import BAND, ERROR, ESTIMATE, REFERENCE, symbol, tidy
from windsysid.reports.html import Section, png, report_page
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve, ShadedRange
from windsysid.units import engineering_unit, unit_text

__all__ = ["figure", "files"]

FEW = 400
"""Blocks whose points are drawn large."""

POINTS = 1000
"""Blocks shown of a long series; alarms and levels are shown whole."""


def figure(watch: Watch, place: Axes | None = None) -> Figure:
    """Every series with its level, ±2σ band and alarms on the left, the statistic of its test on the right."""
    when = _moments(watch, watch.blocks.time)
    some = slice(None, None, -(-len(when) // POINTS))
    size = 2.0 if len(when) > FEW else 4.0
    drawn = canvas((12.0, 0.6 + 1.45 * len(watch.series)), place)
    panels = drawn.subplots(len(watch.series), 2, squeeze=False, sharex=True, width_ratios=[3, 2])
    for (left, right), s in zip(panels, watch.series, strict=True):
        left.fill_between(when[some], s.low[some], s.high[some], color=BAND, lw=0)
        left.plot(when[some], s.level[some], color=ESTIMATE, lw=1.2)
        left.plot(when[some], s.adjusted[some], "o", color="#555555", mew=0, ms=size, alpha=0.7, rasterized=True)
        left.set_ylim(_limits(s.adjusted))
        left.set_title(_title(s), fontsize=9, loc="left")
        right.plot(when[some], _highest(s.statistic, some.step) / s.limit, color=ESTIMATE, lw=0.8)
        right.axhline(1.0, color=REFERENCE, ls="--", lw=0.8)
        for ax in (left, right):
            _mark_changes(ax, watch, s.name)
            tidy(ax)
    panels[0, 1].set_title("test for a jump ÷ threshold", fontsize=9, loc="left")
    for ax in panels[-1]:
        if watch.blocks.begin is None:
            ax.set_xlabel("day")
        else:
            ax.xaxis.set_major_formatter(ConciseDateFormatter(ax.xaxis.get_major_locator()))  # type: ignore[no-untyped-call]
    return drawn


def _limits(values: Array) -> tuple[float, float]:
    """Limits of an axis that shows all but the farthest values."""
    low, high = np.percentile(values[np.isfinite(values)], [0.5, 99.5])
    room = 0.3 * (high - low) or 0.01 * abs(high) or 1.0
    return low - room, high + room


def _title(series: WatchedSeries) -> str:
    source = noise_source(series.name)
    name = symbol(source or series.name)
    if source:
        return f"noise, {name}"
    return f"{name} [{unit_text(series.unit)}]" if series.unit else name


def _mark_changes(ax: Axes, watch: Watch, name: str) -> None:
    """Mark the jumps of a series, with the interval in which each happened."""
    for change in watch.changes:
        if change.name == name:
            at, earliest, latest = _moments(watch, np.array([change.time, change.earliest, change.latest]))
            ax.axvline(at, color=ERROR, lw=1.2)
            ax.axvspan(earliest, latest, color=ERROR, alpha=0.25, lw=0)


def _moments(watch: Watch, time: Array) -> Any:
    """Times [s] as dates, or as days if their start is not known."""
    if watch.blocks.begin is None:
        return time / DAY
    return np.datetime64(watch.blocks.begin.replace(tzinfo=None), "s") + time.astype("timedelta64[s]")


def _plots(watch: Watch) -> list[Plot]:
    """Every series, and the statistic of its test, of a series longer than `POINTS` every so many records."""
    begin = watch.blocks.begin
    origin, unit = (0.0, DAY) if begin is None else (begin.timestamp(), 1.0)
    step = -(-len(watch.blocks.time) // POINTS)
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
        name = (noise_source(s.name) or s.name).replace("_", " ")
        y_axis, time = Axis(f"[{text}]", limits=_limits(s.adjusted / size)), moment(watch.blocks.time[::step])
        plots.append(Plot(name, time, curves, x_axis, y_axis, marks, spans, link="time"))
        test = PlotCurve("test ÷ threshold", _highest(s.statistic, step) / s.limit)
        threshold = Mark(1.0, "threshold", "reference", "threshold", across=True)
        plots.append(Plot(f"{name}, test", time, [test], x_axis, Axis("[1]"), [threshold, *marks], link="time"))
    return plots


def files(watch: Watch) -> dict[str, bytes]:
    """``report.html``, ``monitor.png`` and ``summary.json``, by name."""
    drawn = png(figure(watch))
    caption = (
        "Grey: records less the effect of covariates. Blue: the level as it was known after each, with its 95 %"
        " interval. Below: the test for a jump as a share of its threshold. Orange: jumps that set off an alarm, and"
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
        "monitor.png": drawn,
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

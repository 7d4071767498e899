"""A watch over many records as a figure and as one page."""

import numpy as np
from matplotlib.figure import Figure

from windsysid.monitoring.changes import Watch
from windsysid.monitoring.series import DAY
from windsysid.output.table import Table
from windsysid.reports.html import Section, png, report_page
from windsysid.reports.plots import BAND, ERROR, ESTIMATE, MEASURED, REFERENCE, symbol, tidy
from windsysid.units import unit_text

__all__ = ["figure", "files"]

POINTS = 3000
"""Blocks shown of a long series; alarms and levels are shown whole."""


def figure(watch: Watch) -> Figure:
    """Every series with its level, ±2σ band and alarms on the left, the statistic of its test on the right."""
    days = watch.blocks.time / DAY
    some = slice(None, None, -(-len(days) // POINTS))
    drawn = Figure(figsize=(12.0, 0.6 + 1.45 * len(watch.series)), layout="constrained")
    panels = drawn.subplots(len(watch.series), 2, squeeze=False, sharex=True, width_ratios=[3, 2])
    for (left, right), s in zip(panels, watch.series, strict=True):
        left.plot(days[some], s.adjusted[some], ".", color=MEASURED, ms=2, alpha=0.5, rasterized=True)
        left.fill_between(days[some], s.low[some], s.high[some], color=BAND, lw=0)
        left.plot(days[some], s.level[some], color=ESTIMATE, lw=1.2)
        shown = s.adjusted[np.isfinite(s.adjusted)]
        low, high = np.percentile(shown, [0.5, 99.5])
        room = 0.3 * (high - low) or 0.01 * abs(high) or 1.0
        left.set_ylim(low - room, high + room)
        name = symbol(s.name.removeprefix("noise_"))
        title = f"noise, {name}" if s.name.startswith("noise_") else f"{name} [{unit_text(s.unit)}]" if s.unit else name
        left.set_title(title, fontsize=9, loc="left")
        right.plot(days[some], _highest(s.statistic, some.step) / s.limit, color=ESTIMATE, lw=0.8)
        right.axhline(1.0, color=REFERENCE, ls="--", lw=0.8)
        for change in (c for c in watch.changes if c.name == s.name):
            for ax in (left, right):
                ax.axvline(change.time / DAY, color=ERROR, lw=1.2)
                ax.axvspan(change.earliest / DAY, change.latest / DAY, color=ERROR, alpha=0.25, lw=0)
        for ax in (left, right):
            tidy(ax)
    panels[0, 1].set_title("test for a jump ÷ threshold", fontsize=9, loc="left")
    for ax in panels[-1]:
        ax.set_xlabel("day")
    return drawn


def files(watch: Watch) -> dict[str, bytes]:
    """``report.html``, ``monitor.png`` and ``summary.json``, by name."""
    drawn = png(figure(watch))
    caption = (
        "Left: records less the effect of their covariates (grey), the level as it was known after each (blue) with its"
        " ±2σ band. Right: the test for a jump of any size at any time, as a share of its threshold. Orange: jumps that"
        " set off an alarm, with the interval in which they happened."
    )
    jumps = Table(
        ("", "when", "found", "change", "±2σ band", "where to look"),
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
        Section("Record by record", figures=[(drawn, caption)]),
        Section("In numbers", text=[READING], tables=watch.tables()),
    ]
    subtitle = f"{len(watch.blocks.time)} records, {watch.alarms_per_year:g} false alarms a year"
    return {
        "report.html": report_page("What changed over many records", subtitle, sections),
        "monitor.png": drawn,
        "summary.json": watch.to_json().encode(),
    }


READING = (
    "Levels are those at the covariates' mean while learning. Drift is the change since then, jumps included. How far a"
    " level wanders in a day and by how much records scatter more than their own σ is learned from them. A jump of the"
    " size in the last column is found within a day in nine cases of ten."
)


def _highest(values: np.ndarray, step: int) -> np.ndarray:
    """The highest of each `step` values."""
    padded = np.full(-(-len(values) // step) * step, -np.inf)
    padded[: len(values)] = values
    return np.asarray(padded.reshape(-1, step).max(axis=1))

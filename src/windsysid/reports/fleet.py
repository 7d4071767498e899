"""A fleet at a glance as a figure and as one page."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid._types import Array
from windsysid.fleet.overview import OUTLIER_PROBABILITY, Overview
from windsysid.fleet.sisters import Standing
from windsysid.monitoring.changes import Watch
from windsysid.monitoring.series import DAY, MIN_BLOCKS
from windsysid.output.table import Table
from windsysid.reports.figures.drawing import drawn
from windsysid.reports.html import Section, png, report_page
from windsysid.reports.interactive.plot import Axis, Plot, PlotCurve

__all__ = ["figure", "files"]

MAX_POINTS = 400
"""Points shown of a level."""


def figure(overview: Overview, place: Axes | None = None) -> Figure:
    """Levels of every coefficient since the end of learning, and comparison within a type if there are enough."""
    return drawn(_plots(overview), place, NOTHING_WATCHED)


def _availability(overview: Overview) -> Table:
    """Share of each month that identified records cover, turbine by turbine."""
    months = list(dict.fromkeys(month for glance in overview.glances.values() for month in glance.months))
    rows = [
        (name, *(f"{100.0 * glance.months.get(month, 0.0):.0f}" for month in months))
        for name, glance in overview.glances.items()
    ]
    return Table(("turbine", *months), rows, "Share of each month that identified records cover [%]", words=(0,))


def _plots(overview: Overview) -> list[Plot]:
    """Levels of every coefficient, and each turbine against the others of its type if there are enough."""
    plots = []
    for name in _watched(overview):
        plots.append(_level_plot(overview, name))
        mine = [s for s in overview.standings if s.name == name]
        plots += [_sister_plot(name, mine)] if mine else []
    return plots


def _sister_plot(name: str, mine: Sequence[Standing]) -> Plot:
    """Turbines against the mean of the others, with its scatter."""
    half, spread = np.array([(s.high - s.percent, 2.0 * s.spread) for s in mine]).T
    percent, outlier = np.array([s.percent for s in mine]), np.array([s.outlier for s in mine])
    curves = [PlotCurve("scatter of the others", 0.0 * spread, -spread, spread, "bars", "measured")]
    for label_, colour, chosen in (("outlier", "error", outlier), ("others", "estimate", ~outlier)):
        at = np.where(chosen, percent, np.nan)
        curves += [PlotCurve(label_, at, at - half, at + half, "dots", colour)] if chosen.any() else []
    axes = Axis("", names=[s.turbine for s in mine]), Axis("off the mean of the others [%]")
    return Plot(f"{name}: turbines of the same type", np.arange(len(mine)), curves, *axes)


def _level_plot(overview: Overview, name: str) -> Plot:
    """Change of the level of a coefficient since the end of learning, on a common time."""
    watches = {turbine: one for turbine, one in overview.watches.items() if name in _names(one)}
    dated = all(one.blocks.begin is not None for one in watches.values())
    times = [_seconds(one) if dated else one.blocks.time / DAY for one in watches.values()]
    common = np.linspace(min(map(np.min, times)), max(map(np.max, times)), MAX_POINTS)
    curves = []
    for (turbine, one), own in zip(watches.items(), times, strict=True):
        jumped = any(change.name == name for change in one.changes)
        curves.append(PlotCurve(turbine, _change(one, name, own, common), colour="error" if jumped else "measured"))
    x_axis = Axis("", dates=True) if dated else Axis("day")
    return Plot(f"{name}: change of the level", common, curves, x_axis, Axis("change [%]"), link="time", end_names=True)


def _change(one: Watch, name: str, own: Array, common: Array) -> Array:
    """Change of a level [%] since the end of learning at common times, from its own times; NaN outside."""
    level = next(series.level for series in one.series if series.name == name)
    change = 100.0 * (level / level[one.begins] - 1.0)
    at = np.searchsorted(own, common, side="right") - 1
    inside = (common >= own[one.begins]) & (common <= own[-1])
    return np.where(inside, change[np.maximum(at, 0)], np.nan)


def _seconds(one: Watch) -> Array:
    """Times of a watch that has dates [s since 1970]."""
    begin = one.blocks.begin
    return one.blocks.time + (0.0 if begin is None else begin.timestamp())


def _names(one: Watch) -> list[str]:
    """Coefficients of a watch."""
    return [s.name for i, s in enumerate(one.series) if one.blocks.kind(i) != "noise"]


def _watched(overview: Overview) -> list[str]:
    """Coefficients that are watched in any turbine."""
    return list(dict.fromkeys(name for one in overview.watches.values() for name in _names(one)))


def files(overview: Overview) -> dict[str, bytes]:
    """``report.html``, ``fleet.png`` and ``summary.json``, by name."""
    levels = (
        "The level of each turbine at mean covariates, against that at the end of learning; orange where it jumped."
    )
    if overview.standings:
        levels += " Turbines with 95 % intervals against the mean of the others, whose scatter (95 %) is grey;"
        levels += " orange: an outlier."
    sections = [
        Section("What stands out", text=[*_sentences(overview), *overview.notes]),
        Section("Every turbine at a glance", tables=overview.tables()),
        _listed("Usable records of each quantity", "", _usable(overview), folded=True),
        Section("Levels by turbine type", text=[levels, READING], plots=_plots(overview))
        if overview.watches
        else Section("Levels by turbine type", text=[NOTHING_WATCHED]),
        _listed("Data availability", "", _availability(overview)),
        _listed("Sensors", "No sensor fails.", _sensors(overview)),
        _listed("Jumps", "Nothing jumped." if overview.watches else "No turbine is watched.", _jumps(overview)),
        _listed("Records without a result", "Every record has a result.", _without_result(overview)),
        Section("Turbine by turbine", tables=_numbers(overview), folded=True),
    ]
    count = sum(glance.records for glance in overview.glances.values())
    subtitle = (
        f"{overview.size}, {count} records; stated for a healthy fleet: {overview.alarms_per_year:g}"
        f" alarms of a jump a year, an outlier on one page in {1.0 / OUTLIER_PROBABILITY:.0f}"
    )
    return {
        "report.html": report_page("The fleet at a glance", subtitle, sections),
        "fleet.png": png(figure(overview)),
        "summary.json": overview.to_json().encode(),
    }


def _sentences(overview: Overview) -> list[str]:
    return [f"WARNING: {text}" for text in overview.sentences] if overview.events else overview.sentences


def _listed(title: str, nothing: str, table: Table, *, folded: bool = False) -> Section:
    """Section with a table, or with a sentence if it has no rows."""
    if table.rows:
        return Section(title, tables=[table], folded=folded)
    return Section(title, text=[nothing] if nothing else [], folded=folded)


def _sensors(overview: Overview) -> Table:
    rows = [
        (
            one.turbine, one.channel, one.kind, f"{100.0 * one.share:.0f} %", one.first, one.last,
            "have it too" if one.shared else "do not",
        )
        for one in overview.failing
    ]  # fmt: skip
    return Table(("turbine", "channel", "finding", "of the records", "from", "to", "sisters"), rows, words=(0, 1, 2, 6))


def _jumps(overview: Overview) -> Table:
    rows = [
        (
            name, c.name, one.blocks.between(c.earliest, c.latest), f"{c.percent:+.3g} %",
            f"{c.low:+.3g} … {c.high:+.3g} %", c.cause,
        )
        for name, one in overview.watches.items() for c in one.changes
    ]  # fmt: skip
    return Table(("turbine", "quantity", "when", "change", "95 % interval", "where to look"), rows, words=(0, 1, 2, 5))


def _usable(overview: Overview) -> Table:
    rows = [
        (turbine, name, f"{count} of {glance.identified}")
        for turbine, glance in overview.glances.items() for name, count in glance.usable.items()
    ]  # fmt: skip
    return Table(("turbine", "quantity", "grade A or B in"), rows, words=(0, 1))


def _without_result(overview: Overview) -> Table:
    rows = [(name, str(count), why) for name, glance in overview.glances.items() for why, count in glance.reasons]
    return Table(("turbine", "records", "why they have no result"), rows, words=(0, 2))


def _numbers(overview: Overview) -> list[Table]:
    """Levels, drifts and the effects of covariates of each turbine."""
    found: list[Table] = []
    for name, one in overview.watches.items():
        first, *more = one.tables()
        found += [Table(first.headings, first.rows, f"{name}, {first.caption}", first.words), *more]
    return found


NOTHING_WATCHED = (
    f"No turbine has the {MIN_BLOCKS} records with a result of grade A or B that watching needs. Records without a"
    " result, and why they have none, are listed below: correct what is named there, or add records with"
    " windsysid batch."
)

READING = (
    "The alarms of all turbines together are held to the stated rate. Levels are compared at the same covariates."
    " A drop in cold weather that recovers is labelled icing. A change of half of the turbines of a type is"
    " labelled shared."
)

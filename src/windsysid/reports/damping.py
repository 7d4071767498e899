"""Structural and aerodynamic damping as a figure and as one page."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from windsysid.monitoring.separation import DampingBand, DampingSplit, Separation, State
from windsysid.output.table import Table, titled
from windsysid.reports.html import Section, report_page
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["figure", "files"]


def figure(separation: Separation, place: "Axes | None" = None) -> "Figure":
    """Draw every record's damping in % of critical: structure's share, air's share, and the record's own value."""
    from windsysid.reports.figures.drawing import drawn

    return drawn(_plots(separation), place)


def _plots(separation: Separation) -> list[Plot]:
    """Damping of each degree of freedom over the states of operation, parked ones first."""
    states = separation.states
    order = sorted(
        range(len(states)), key=lambda i: (not states[i].parked, states[i].rotor_speed, states[i].wind_speed or 0.0)
    )
    return [_plot(split, [states[i] for i in order], order, separation.base) for split in separation.splits]


def _plot(split: DampingSplit, states: Sequence[State], order: Sequence[int], base: str) -> Plot:
    """Total damping in each record, the structure's as a band, and the air's."""
    curves = [_curve("total of the record alone", [split.measured[i] for i in order], split, "dots", "measured")]
    if split.structural is not None:
        curves.insert(0, _curve(base, [split.structural] * len(order), split, "line", "other"))
        curves.append(_curve("air", [split.aerodynamic[i] for i in order], split, "dots", "estimate"))
    axes = Axis("", names=[str(state) for state in states]), Axis("damping [% of critical]")
    return Plot(titled(split.name), np.arange(len(order)), curves, *axes, [Mark(0.0, across=True)])


def _curve(
    name: str, bands: Sequence[DampingBand | None], split: DampingSplit, look: str, colour: str
) -> PlotCurve:  # fmt: skip
    """Values with their intervals in % of critical, NaN where one is not known."""
    unknown = DampingBand(np.nan, np.nan, np.nan)
    value, low, high = np.transpose([(one or unknown).over(0.01 * split.critical) for one in bands])
    return PlotCurve(name, value, low, high, look, colour)


def files(separation: Separation) -> dict[str, bytes]:
    """``report.html`` and ``summary.json``, by name."""
    caption = (
        f"Green: {separation.base}. Blue: the aerodynamic part in that state. Grey: the total damping from each record"
        " alone, its prior removed. Shaded and bars: 95 % intervals."
    )
    records = Table(("record", "state"), [(state.record, str(state)) for state in separation.states], "Records", (0, 1))
    sections = [
        Section(
            "Structure and air",
            text=[separation.sentence, *separation.lacking, *(f"WARNING: {doubt}" for doubt in separation.doubts),
            *separation.notes, caption],
            plots=_plots(separation),
        ),
        Section("In numbers", tables=[separation.table(), records]),
    ]  # fmt: skip
    subtitle = (
        f"{len(separation.states)} records, {sum(state.parked for state in separation.states)} of them of a parked"
        " rotor"
    )
    return {
        "report.html": report_page("Structural and aerodynamic damping", subtitle, sections),
        "summary.json": separation.to_json().encode(),
    }

"""The record of an inspection as a figure, with its faults."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator

from windsysid._types import Array
from windsysid.reports.figures.canvas import canvas, label
from windsysid.reports.figures.plots import BAND, ERROR, ESTIMATE, MEASURED, REFERENCE, envelope, tidy
from windsysid.reports.interactive.inspection import MAX_PLOTS, broken, gaps_of, some, unit_drawn

if TYPE_CHECKING:
    from windsysid.inspection.inspection import Inspection

__all__ = ["overview"]


def overview(inspection: "Inspection", place: Axes | None = None) -> Figure:
    """Channels over time: faults orange, the proposed sections blue, the best one darker, stops of the rotor dashed."""
    record = inspection.record
    channels = inspection.shown(MAX_PLOTS)
    figure = canvas((10, max(1.15, 2.2 - 0.25 * len(channels)) * len(channels) + 1.0), place)
    if place is None:
        figure.set_layout_engine(ConstrainedLayoutEngine(h_pad=0.03))
    axes = figure.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, channel in zip(axes, channels, strict=True):
        unit, factor = unit_drawn(channel, record.unit(channel))
        values = factor * record[channel]
        time, low, high = broken(*envelope(record.time, values), gaps_of(inspection))
        _mark_sections(ax, inspection)
        ax.fill_between(time, low, high, color=MEASURED, lw=0.6, edgecolor=MEASURED)
        said = _mark_faults(ax, inspection, channel, record.time, values)
        ax.set_title(label(channel.replace("_", " ")), fontsize=8.5, loc="left", pad=2)
        if said:
            ax.set_title(said, fontsize=8, loc="right", pad=2, color=ERROR)
        ax.set_ylabel(f"[{label(unit)}]", fontsize=8)
        ax.yaxis.set_major_locator(MaxNLocator(3))
        tidy(ax)
    for rank, proposal in enumerate(p for p in inspection.proposals if p.good):
        axes[0].annotate(
            f"{rank + 1}", (0.5 * (proposal.start + proposal.end), 1.0), xycoords=axes[0].get_xaxis_transform(),
            ha="center", va="bottom", fontsize=8, color=ESTIMATE, weight="bold", xytext=(0, 1),
            textcoords="offset points",
        )  # fmt: skip
    axes[-1].set_xlabel("time [s]", fontsize=9)
    axes[-1].set_xlim(record.time[0], record.time[-1])
    return figure


def _mark_sections(ax: Axes, inspection: "Inspection") -> None:
    """Shade the sections that are good, and mark where the rotor stops and starts."""
    for rank, proposal in enumerate(inspection.proposals):
        if proposal.good:
            ax.axvspan(proposal.start, proposal.end, color=BAND, alpha=0.75 if rank == 0 else 0.35, lw=0)
            for edge in (proposal.start, proposal.end):
                ax.axvline(edge, color=BAND, lw=0.8)
    for stop in inspection.stops:
        for edge in (stop.start, stop.end):
            ax.axvline(edge, color=REFERENCE, lw=0.8, ls="--")


def _mark_faults(ax: Axes, inspection: "Inspection", channel: str, time: Array, values: Array) -> str:
    """Shade long faults, mark short ones with dots; return their kinds, in words."""
    pixel = (time[-1] - time[0]) / 1000.0
    found = *inspection.of(channel), *gaps_of(inspection)
    faults = [finding for finding in found if finding.severity != "note"]
    for finding in faults:
        spans = some(finding.spans)
        long = spans[:, 1] - spans[:, 0] > pixel
        for a, b in spans[long]:
            ax.axvspan(a, b, color=ERROR, alpha=0.25, lw=0)
        if finding.channel:
            _dot(ax, spans[~long, 0], time, values)
    return ", ".join(dict.fromkeys(finding.kind for finding in faults if finding.channel))


def _dot(ax: Axes, begins: Array, time: Array, values: Array) -> None:
    """Dot the values at these times, as far as there are any."""
    index = np.searchsorted(time, begins)
    index = index[np.isfinite(values[index])]
    if index.size:
        ax.plot(time[index], values[index], "o", ms=3, mfc="none", color=ERROR, lw=0, clip_on=False)

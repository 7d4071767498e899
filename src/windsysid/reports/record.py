"""A record as a figure."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.output.table import titled
from windsysid.records.record import Record
from windsysid.reports.figures.canvas import canvas, label
from windsysid.reports.figures.plots import MEASURED, envelope, tidy
from windsysid.units import unit_text

__all__ = ["figure"]

MAX_PANELS = 12


def figure(record: Record, place: Axes | None = None) -> Figure:
    """Draw channels over time, a panel each, the first `MAX_PANELS` of them; each pixel shows the least and the
    greatest value in it."""
    channels = record.channels[:MAX_PANELS]
    drawn = canvas((10.0, max(1.2, 2.2 - 0.25 * len(channels)) * len(channels) + 0.6), place)
    panels = drawn.subplots(len(channels), 1, sharex=True, squeeze=False)[:, 0]
    for ax, channel in zip(panels, channels, strict=True):
        time, low, high = envelope(record.time, record[channel])
        ax.fill_between(time, low, high, color=MEASURED, edgecolor=MEASURED, lw=0.6)
        ax.set_title(label(titled(channel)), fontsize=8.5, loc="left", pad=2)
        ax.set_ylabel(f"[{label(unit_text(record.unit(channel)))}]", fontsize=8)
        if not np.isfinite(record[channel]).any():
            ax.text(0.5, 0.5, "no reading", transform=ax.transAxes, ha="center", va="center")
        tidy(ax)
    panels[-1].set_xlabel("time [s]")
    if left := len(record.channels) - len(channels):
        panels[-1].set_xlabel(f"time [s]; {left} more channels: record.select([...]).plot() shows them")
    return drawn

"""Modes of a linearised model as a figure and as one page: participations, and a Campbell diagram of several speeds."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid._types import Array
from windsysid.modal.linearisation.result import LinearisedModes
from windsysid.reports import campbell
from windsysid.reports.figures.canvas import label, single
from windsysid.reports.html import Section
from windsysid.units import RPM

__all__ = ["LinearisedModes", "figure", "files", "participations", "shares_of_modes"]

MIN_SHOWN_SHARE = 0.05
"""Setting: smallest participation in any mode of a kind of degree of freedom that has a column."""

MIN_PRINTED_PERCENT = 5
"""Setting: smallest participation [%] whose number is printed."""


def figure(found: LinearisedModes, place: Axes | None = None) -> Figure:
    """The Campbell diagram of several rotor speeds, the participations of one."""
    return campbell.figure(found, place) if len(found.points) > 1 else participations(found, place)


def participations(found: LinearisedModes, place: Axes | None = None) -> Figure:
    """Participation of each kind of degree of freedom in each mode at the usual rotor speed, the lowest mode on top."""
    listed = {kind for mode in found.modes for kind, share in mode.participation.items() if share >= MIN_SHOWN_SHARE}
    kinds = sorted(listed, key=lambda kind: (campbell.is_of_blades(kind), not kind.startswith("tower"), kind))
    shares = np.array([[100.0 * mode.participation.get(kind, 0.0) for kind in kinds] for mode in found.modes])
    title = f"participation [%] at {found.speeds[found.usual] * RPM:.3g} rpm"
    return shares_of_modes(shares, found.modes, kinds, title, place)


def shares_of_modes(
    percent: Array, modes: Sequence[Any], columns: Sequence[str], title: str, place: Axes | None
) -> Figure:
    """Shares (modes, columns) [%] as a table of colours, the first mode on top."""
    drawn, ax = single((2.6 + 0.55 * len(columns), 1.9 + 0.32 * len(modes)), place)
    ax.imshow(percent, cmap="Blues", vmin=0.0, vmax=100.0, aspect="auto")
    for row, column in np.argwhere(percent >= MIN_PRINTED_PERCENT):
        colour = "white" if percent[row, column] > 55.0 else "#111111"
        text = f"{percent[row, column]:.0f}"
        ax.text(column, row, text, ha="center", va="center", fontsize=8, color=colour)
    ax.set_xticks(range(len(columns)), [label(name) for name in columns], rotation=40, ha="right", fontsize=8.5)
    rows = [f"{label(mode.name)}  {mode.frequency.estimate:.4g} Hz" for mode in modes]
    ax.set_yticks(range(len(rows)), rows, fontsize=8.5)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    ax.set_title(title, fontsize=9.5, loc="left")
    return drawn


def files(found: LinearisedModes) -> dict[str, bytes]:
    """``report.html``, with the Campbell diagram of several speeds, ``modes.csv`` and ``summary.json``, by name."""
    parts = campbell.sections(found)
    parts = parts if len(found.points) > 1 else [parts[0], *parts[3:]]
    text = (
        "Participation: share of each kind of degree of freedom in the mode. Forward: the blades' pattern whirls with"
        " the rotor; backward: against it."
    )
    parts.insert(0, Section("Modes", text=[*found.warnings, text], tables=[found.modes_table()]))
    return {"report.html": campbell.page(found, parts), **campbell.data(found)}

"""Operational modes as one Matplotlib figure: spectra with the modes, and the fit in each band."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.reports.figures.canvas import canvas
from windsysid.reports.figures.plots import BAND, ERROR, ESTIMATE, MEASURED, REFERENCE, tidy
from windsysid.spectral.oma.result import OperationalModes

__all__ = ["figure"]

MAX_BANDS, COLUMNS = 24, 4
"""Setting: bands that are drawn, and those in one row."""


def figure(found: OperationalModes, place: Axes | None = None) -> Figure:
    """The spectrum of all channels with the modes, and in each band the model on it."""
    bands = found.bands[:MAX_BANDS]
    rows = -(-len(bands) // COLUMNS)
    drawn = canvas((11.0, 3.4 + 2.2 * rows), place)
    grid = drawn.add_gridspec(1 + rows, COLUMNS, height_ratios=[1.5, *[1.0] * rows])
    above = drawn.add_subplot(grid[0, :])
    _spectrum(above, found)
    for i, band in enumerate(bands):
        ax = drawn.add_subplot(grid[1 + i // COLUMNS, i % COLUMNS])
        ax.semilogy(band.frequency, band.measured, ".", ms=2.5, color=MEASURED)
        ax.semilogy(band.frequency, band.fitted, color=ESTIMATE, lw=1.3)
        inside = [mode for mode in found.modes if band.frequency[0] <= mode.frequency.estimate <= band.frequency[-1]]
        for mode in inside:
            ax.axvline(mode.frequency.estimate, color=REFERENCE if mode.trusted else ERROR, ls=":", lw=0.9)
        ax.set_title(", ".join(mode.name for mode in inside)[:40], fontsize=8.5, loc="left")
        ax.set_yticks([], minor=True)
        ax.tick_params(labelleft=False)
        tidy(ax)
    drawn.supxlabel("frequency [Hz]", fontsize=9)
    return drawn


def _spectrum(ax: Axes, found: OperationalModes) -> None:
    for i, values in enumerate(found.singular_values.T):
        ax.semilogy(found.frequency[1:], values[1:], color=MEASURED, lw=0.9 if i == 0 else 0.5, alpha=1.0 - 0.12 * i)
    for mode in found.modes:
        ax.axvspan(*mode.band, color=BAND, alpha=0.25, lw=0)
        ax.axvline(mode.frequency.estimate, color=ESTIMATE if mode.trusted else ERROR, lw=0.9)
    for _, f in found.lines[:60]:
        ax.axvline(f, color=MEASURED, lw=0.5, ls=":")
    top = max((mode.band[1] for mode in found.modes), default=float(found.frequency[-1]))
    ax.set_xlim(0.0, min(1.3 * top, float(found.frequency[-1])))
    ax.set_title(
        "singular values; blue: modes and their frequency ranges, orange: grade C, dotted: removed lines",
        fontsize=9,
        loc="left",
    )
    tidy(ax)

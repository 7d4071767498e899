"""An identification as a figure."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.reports.figures.drawing import drawn
from windsysid.reports.figures.plots import coefficient_histories
from windsysid.reports.interactive.identification import coefficient_plots
from windsysid.results.identification import Identification

__all__ = ["figure"]


def figure(found: Identification, place: Axes | None = None) -> Figure:
    """The history of every coefficient with its band and reference; the intervals alone where there is none."""
    if len(found.mean) > 1:
        return coefficient_histories(found, place=place)
    return drawn(coefficient_plots(found, ""), place)

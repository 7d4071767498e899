"""An identification as a figure."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.reports.figures.bands import coefficient_bands
from windsysid.reports.figures.plots import coefficient_histories
from windsysid.results.identification import Identification

__all__ = ["figure"]


def figure(found: Identification, place: Axes | None = None) -> Figure:
    """The history of every coefficient with its band and reference; the bands alone where there is none."""
    draw = coefficient_bands if len(found.mean) == 1 else coefficient_histories
    return draw(found, place=place)

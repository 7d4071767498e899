"""An identification as a figure."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.reports.bands import coefficient_bands
from windsysid.reports.plots import coefficient_histories
from windsysid.results.identification import Identification

__all__ = ["figure"]


def figure(found: Identification, place: Axes | None = None) -> Figure:
    """The history of every coefficient with its band and reference; the bands alone where spectra left no history."""
    draw = coefficient_bands if found.formulation == "spectral" else coefficient_histories
    return draw(found, place=place)

"""The histories of an identification as a figure."""

from matplotlib.figure import Figure

from windsysid.reports.plots import coefficient_histories
from windsysid.results.identification import Identification

__all__ = ["figure"]


def figure(found: Identification) -> Figure:
    """The history of every coefficient with its band and reference."""
    return coefficient_histories(found)

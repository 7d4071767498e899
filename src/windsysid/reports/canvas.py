"""Where a picture is drawn: on a figure of its own, or in the place of somebody's axes."""

from typing import cast

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.errors import ConfigurationError

__all__ = ["canvas", "single"]


def canvas(size: tuple[float, float], ax: Axes | None) -> Figure:
    """A new figure of a size [inches]; or, for panels of its own, the place of `ax` in its figure, of which `ax` is
    taken away.

    Raises
    ------
    ConfigurationError
        If `ax` was placed by hand, and not by ``subplots`` or ``add_subplot``.
    """
    if ax is None:
        return Figure(figsize=size, layout="constrained")
    place = ax.get_subplotspec()
    if place is None:
        raise ConfigurationError("ax: expected axes that subplots or add_subplot made, got axes placed by hand")
    within = ax.figure
    ax.remove()
    return cast(Figure, within.add_subfigure(place))


def single(size: tuple[float, float], ax: Axes | None) -> tuple[Figure, Axes]:
    """A new figure of a size [inches] with its only axes, or `ax` and its figure."""
    if ax is not None:
        return cast(Figure, ax.figure), ax
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots()

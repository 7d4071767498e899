"""Figures, of their own or in place of given axes, and labels for names from users and files."""

from functools import cache
from typing import cast

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font

from windsysid.errors import ConfigurationError
from windsysid.reports.html import png

__all__ = ["MAX_TICK_CHARACTERS", "DisplayedFigure", "canvas", "label", "single"]

MAX_LABEL_CHARACTERS, MAX_TICK_CHARACTERS = 60, 24
"""Largest length of a name in a figure, and of a tick label; a longer one is shown without its middle."""


class DisplayedFigure(Figure):
    """A figure that a notebook displays as the value of a cell, whether or not ``matplotlib.pyplot`` was imported."""

    def _repr_png_(self) -> bytes:
        return png(self)


def label(text: str, most: int = MAX_LABEL_CHARACTERS) -> str:
    """Make a name (channel, turbine, unit) safe for a figure.

    Matplotlib interprets text between two dollar signs as a formula, and warns of characters that its font lacks.
    """
    known = _characters()
    seen = "".join(sign if sign.isprintable() and ord(sign) in known else "?" for sign in " ".join(text.split()))
    if len(seen) > most:
        seen = f"{seen[: most // 2 - 1]} … {seen[-(most // 2 - 2) :]}"
    return seen.replace("$", r"\$")


@cache
def _characters() -> frozenset[int]:
    """Code points of Matplotlib's font."""
    return frozenset(get_font(findfont(FontProperties())).get_charmap())


def canvas(size: tuple[float, float], ax: Axes | None) -> Figure:
    """A new figure of a size [inches]; or, for panels of its own, the place of `ax` in its figure, of which `ax` is
    taken away.

    Raises
    ------
    ConfigurationError
        If `ax` was placed by hand, and not by ``subplots`` or ``add_subplot``.
    """
    if ax is None:
        return DisplayedFigure(figsize=size, layout="constrained")
    place = _checked(ax).get_subplotspec()
    if place is None:
        raise ConfigurationError("ax: expected axes that subplots or add_subplot made, got axes placed by hand")
    within = ax.figure
    ax.remove()
    return cast(Figure, within.add_subfigure(place))


def _checked(ax: Axes) -> Axes:
    if isinstance(ax, Axes):
        return ax
    raise ConfigurationError(f"ax: expected axes of Matplotlib, got {type(ax).__name__}")


def single(size: tuple[float, float], ax: Axes | None) -> tuple[Figure, Axes]:
    """A new figure of a size [inches] with its only axes, or `ax` and its figure."""
    if ax is not None:
        return cast(Figure, _checked(ax).figure), ax
    figure = DisplayedFigure(figsize=size, layout="constrained")
    return figure, figure.subplots()

"""A table of text, which a terminal and an HTML page show, and names of channels in words."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

__all__ = ["READING", "Table", "axes_of", "titled"]

READING = "± is the 95 % interval. Numbers of grade A and B may be used, those of C not."
"""Explanation of tables of results."""


@dataclass(frozen=True)
class Table:
    """Rows of text under headings; columns in `words` are set left and may wrap, the others, numbers, are set right.

    `windsysid.output.console.render` shows it on a terminal, `windsysid.reports.html.report_page` on a page.
    """

    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    words: Sequence[int] = (0,)


_AXIS = re.compile(
    r"(?:(?:tower|nacelle|[kc])[ _](?=(?:[xyz]|beta)(?:[ _,]|$))|(?:blade[ _]\d+[ \w]*[ _])?(?=lag[ _]))"
    r"(x|y|z|beta|lag)"
)
_DIRECTIONS = {"x": "side-side", "y": "vertical", "z": "fore-aft", "lag": "edgewise", "beta": "edgewise"}


def titled(channel: str) -> str:
    """Name of a channel in words, with the direction of its axis on tower, nacelle or blade; also of a coefficient.

    Examples
    --------
    >>> titled("tower_x_acceleration"), titled("blade_1_tip_lag_acceleration")
    ('tower x acceleration, side-side', 'blade 1 tip lag acceleration, edgewise')
    """
    words, axis = channel.replace("_", " "), _AXIS.match(channel)
    words = words.replace("side side", "side-side").replace("fore aft", "fore-aft")
    direction = f", {_DIRECTIONS[axis[1]]}" if axis else ""
    return words if words.endswith(direction) else words + direction


def axes_of(names: Iterable[str]) -> str:
    """Directions of the axes in names of channels, coefficients or modes, for a caption; empty if there is none.

    Examples
    --------
    >>> axes_of(["tower x", "tower y", "lag forward"])
    '; lag is edgewise, x is side-side, y is vertical'
    """
    axes = sorted({axis[1] for axis in map(_AXIS.match, names) if axis})
    return "".join(f"{', ' if i else '; '}{axis} is {_DIRECTIONS[axis]}" for i, axis in enumerate(axes))

"""Descriptions of plots, from which a page makes both the interactive plot and the static SVG.

A `Plot` is handed to a page through ``Section(…, plots=[…])``; the page embeds its numbers once as JSON, and
``static/plots.js`` draws them with uPlot. Colours are names of CSS variables, so that both follow the dark mode.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array

__all__ = ["Axis", "Cells", "Mark", "Plot", "PlotCurve", "ShadedRange", "shortened", "thinned", "to_json"]

MAX_POINTS = 1000
"""Setting: points of a curve that a page embeds; a plot is about as many pixels wide."""

MAX_NAME_CHARACTERS = 60
"""Setting: largest length of a name in a plot."""

DIGITS = 4
"""Setting: significant digits of embedded values."""


@dataclass(frozen=True)
class Axis:
    """An axis: label with unit, logarithmic or not, seconds since 1970 shown as dates, limits at the start, and names
    instead of numbers at 0, 1, 2 …"""

    label: str
    log: bool = False
    dates: bool = False
    limits: tuple[float, float] | None = None
    names: Sequence[str] = ()


@dataclass(frozen=True)
class PlotCurve:
    """Values over the plot's x (n,), with the limits of an interval where `low` and `high` are given.

    `look` is ``"line"``, ``"dots"`` (intervals as whiskers), ``"bars"`` (wide whiskers without dots) or ``"area"``
    (between `low` and `high` only); `colour` is ``"estimate"``, ``"measured"``, ``"reference"``, ``"error"`` or
    ``"other"``. NaN leaves a gap.
    """

    name: str
    values: ArrayLike
    low: ArrayLike | None = None
    high: ArrayLike | None = None
    look: str = "line"
    colour: str = "estimate"
    dashed: bool = False


@dataclass(frozen=True)
class Mark:
    """A vertical line at `at`, or a horizontal one where `across`; marks of one `group` are switched together."""

    at: float
    name: str = ""
    colour: str = "reference"
    group: str = ""
    across: bool = False


@dataclass(frozen=True)
class ShadedRange:
    """A shaded range of x; spans of one `group` are switched together."""

    start: float
    end: float
    group: str = ""
    colour: str = "measured"


@dataclass(frozen=True, eq=False)
class Cells:
    """A density over x (n,) and y (m,), both ascending: logarithms to base 10 (n, m), NaN where none is known, in cells
    of a `width` along x; `low` and `high` have the first and last shade. `label` is the unit."""

    x: Array
    y: Array
    values: Array
    width: float
    low: float
    high: float
    label: str


@dataclass(frozen=True)
class Plot:
    """One picture: curves over a common x (n,), marks and shaded ranges, on cells if there are any.

    Plots of one `link` zoom together. The caption stands below and is the name for screen readers. With `end_names`
    each line has its name at its right end; a `tall` plot is nearly twice as high on the screen.

    Examples
    --------
    >>> from windsysid.reports.html import Section, report_page
    >>> from windsysid.reports.interactive.plot import Axis, PlotCurve, Mark, Plot
    >>> plot = Plot(
    ...     "tower top",
    ...     [0.1, 0.2, 0.3],
    ...     [
    ...         PlotCurve("measured", [1.0, 9.0, 2.0], colour="measured"),
    ...         PlotCurve("model", [1, 8, 2], low=[0.8, 6, 1.5], high=[1.3, 9, 3]),
    ...     ],
    ...     Axis("frequency [Hz]"),
    ...     Axis("PSD [(m/s²)²/Hz]", log=True),
    ...     marks=[Mark(0.2, "mode 1", group="modes")],
    ... )
    >>> page = report_page("Spectra", "one channel", [Section("Spectra", plots=[plot])])
    >>> b"<svg" in page, b"uPlot" in page
    (True, True)
    """

    title: str
    x: ArrayLike
    curves: Sequence[PlotCurve]
    x_axis: Axis
    y_axis: Axis
    marks: Sequence[Mark] = ()
    spans: Sequence[ShadedRange] = ()
    caption: str = ""
    link: str = field(default="")
    cells: Cells | None = None
    end_names: bool = False
    tall: bool = False


def shortened(text: str, most: int = MAX_NAME_CHARACTERS) -> str:
    """A name without characters that cannot be printed, and without its middle if it is too long."""
    shown = "".join(sign if sign.isprintable() else "?" for sign in " ".join(text.split()))
    return shown if len(shown) <= most else f"{shown[: most // 2 - 1]} … {shown[-(most // 2 - 2) :]}"


def thinned(x: Array, values: Array, points: int = MAX_POINTS) -> tuple[Array, Array, Array]:
    """Smallest and largest value in each of at most `points` segments, so that no spike is lost; x (m,) at their
    starts, NaN where a segment has no finite value."""
    size = max(1, -(-len(values) // points))
    starts = np.arange(0, len(values), size)
    low = np.minimum.reduceat(np.where(np.isfinite(values), values, np.inf), starts)
    high = np.maximum.reduceat(np.where(np.isfinite(values), values, -np.inf), starts)
    empty = ~np.isfinite(low)
    return x[starts], np.where(empty, np.nan, low), np.where(empty, np.nan, high)


def to_json(plot: Plot) -> str:
    """The numbers and names of a plot as JSON that may stand within a script element; NaN is null."""
    spec = {
        "title": plot.title,
        "x": _numbers(plot.x, DIGITS + 4),
        "curves": [
            {
                "name": c.name, "look": c.look, "colour": c.colour, "dashed": c.dashed, "values": _numbers(c.values),
                **({"low": _numbers(c.low), "high": _numbers(c.high)} if c.low is not None else {}),
            }
            for c in plot.curves
        ],
        "x_axis": _axis(plot.x_axis),
        "y_axis": _axis(plot.y_axis),
        "marks": [{**vars(mark), "at": float(mark.at)} for mark in plot.marks],
        "spans": [{**vars(span), "start": float(span.start), "end": float(span.end)} for span in plot.spans],
        "link": plot.link,
        **({"cells": _cells(plot.cells)} if plot.cells is not None else {}),
        "end_names": plot.end_names,
        "tall": plot.tall,
    }  # fmt: skip
    return json.dumps(spec, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c")


def _cells(cells: Cells) -> dict[str, object]:
    shades = {"width": float(cells.width), "low": float(cells.low), "high": float(cells.high), "label": cells.label}
    columns = [_numbers(column, 3) for column in cells.values]
    return {"x": _numbers(cells.x, DIGITS + 4), "y": _numbers(cells.y), "values": columns, **shades}


def _axis(axis: Axis) -> dict[str, object]:
    limits = None if axis.limits is None else [float(limit) for limit in axis.limits]
    return {"label": axis.label, "log": axis.log, "dates": axis.dates, "limits": limits, "names": list(axis.names)}


def _numbers(values: ArrayLike | None, digits: int = DIGITS) -> list[float | None]:
    """Rounded values; integers where they are, None where not finite."""
    rounded = [float(f"{value:.{digits}g}") for value in np.asarray(values, dtype=np.float64).tolist()]
    return [
        None if not np.isfinite(value) else int(value) if value.is_integer() and abs(value) < 1e6 else value
        for value in rounded
    ]

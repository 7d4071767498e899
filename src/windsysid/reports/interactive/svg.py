"""The static SVG of a plot, for print and for browsers without JavaScript."""

import math
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from html import escape

import numpy as np

from windsysid._types import Array
from windsysid.reports.interactive.plot import Axis, Cells, Plot, PlotCurve

__all__ = ["static_svg"]

WIDTH, HEIGHT = 720.0, 300.0
LEFT, RIGHT, TOP, BOTTOM = 66.0, 14.0, 42.0, 52.0
COLUMN = 1.5
"""Setting: width of a column within which a curve is drawn by its smallest and largest value [px]."""

NAME_ROWS = 3
"""Setting: rows of names of marks above a plot."""

SHADES = 6
"""Setting: shades of cells."""

CHARACTER, LINE, END_NAMES = 3.4, 12.0, 110.0
"""Setting: half the width of a character, height of a line, and room for names at the right ends of curves [px]."""

FEW = 60
"""Setting: points up to which they are drawn larger."""

Place = Callable[[Array], Array]


def static_svg(plot: Plot, identity: str) -> str:
    """The plot as SVG text; `identity` is unique on the page."""
    x_limits, y_limits = _limits(plot, plot.x_axis, of_x=True), _limits(plot, plot.y_axis, of_x=False)
    right = WIDTH - (END_NAMES if plot.end_names else RIGHT)
    to_x = _place(plot.x_axis, x_limits, LEFT, right)
    to_y = _place(plot.y_axis, y_limits, HEIGHT - BOTTOM, TOP)
    inside = [
        *([] if plot.cells is None else _shades(plot.cells, to_x, to_y)),
        *_spans(plot, to_x),
        *(part for curve in plot.curves for part in _curve(curve, to_x(_array(plot.x)), to_y)),
        *_marks(plot, to_x, to_y, right),
    ]
    clip = f"clip-{identity}"
    name = escape(f"{plot.title}: {plot.caption}" if plot.caption else plot.title, quote=True)
    return "".join([
        f'<svg class="static" role="img" aria-label="{name}" viewBox="0 0 {WIDTH:g} {HEIGHT:g}">',
        f'<clipPath id="{clip}"><rect x="{LEFT:g}" y="{TOP:g}" width="{right - LEFT:g}" '
        f'height="{HEIGHT - TOP - BOTTOM:g}"/></clipPath>',
        *_frame(plot, (x_limits, y_limits), (to_x, to_y), right),
        f'<g clip-path="url(#{clip})">', *inside, "</g>",
        *_mark_names(plot, to_x, right),
        *(_end_names(plot, to_x(_array(plot.x)), to_y, right) if plot.end_names else ()),
        "</svg>",
    ])  # fmt: skip


def _array(values: object) -> Array:
    return np.asarray(values, dtype=np.float64)


def _limits(plot: Plot, axis: Axis, *, of_x: bool) -> tuple[float, float]:
    """Limits of an axis: as given, or those of the curves."""
    if axis.limits is not None and axis.limits[1] > axis.limits[0]:
        return axis.limits
    if axis.names:
        return -0.5, len(axis.names) - 0.5
    values = _drawn(plot, of_x=of_x)
    values = values[np.isfinite(values) & ((values > 0.0) | (not axis.log))]
    if not values.size:
        return (0.1, 1.0) if axis.log else (0.0, 1.0)
    low, high = float(values.min()), float(values.max())
    return (low, high) if of_x and high > low else _with_margin(low, high, log=axis.log)


def _drawn(plot: Plot, *, of_x: bool) -> Array:
    """All values along an axis."""
    parts = [plot.x] if of_x else [v for c in plot.curves for v in (c.values, c.low, c.high) if v is not None]
    return np.concatenate([_array(part) for part in parts]) if parts else np.empty(0)


def _with_margin(low: float, high: float, *, log: bool) -> tuple[float, float]:
    if log:
        return low / 1.5, high * 1.5
    margin = 0.06 * (high - low) if high > low else 0.05 * abs(low) or 1.0
    return low - margin, high + margin


def _place(axis: Axis, limits: tuple[float, float], start: float, end: float) -> Place:
    """Values to pixels."""
    low, high = (math.log(v) for v in limits) if axis.log else limits

    def to_pixels(values: Array) -> Array:
        values = np.log(np.where(values > 0.0, values, np.nan)) if axis.log else values
        return np.asarray(start + (end - start) * (values - low) / (high - low))

    return to_pixels


def _curve(curve: PlotCurve, x: Array, to_y: Place) -> list[str]:
    """One curve: its interval, then itself."""
    values, colour = to_y(_array(curve.values)), f"var(--{curve.colour})"
    bounds = None if curve.low is None else (to_y(_array(curve.low)), to_y(_array(curve.high)))
    if curve.look in ("dots", "bars"):
        return _dots(x, values, bounds, colour, bars=curve.look == "bars")
    found = [] if bounds is None else _area(x, bounds, colour, 1.0 if curve.look == "area" else 0.25)
    if curve.look == "line":
        path = "".join(f"M{_outline(x[part], values[part])}" for part in _segments(x, values))
        dash = ' stroke-dasharray="6 4"' if curve.dashed else ""
        found.append(f'<path d="{path}" style="stroke:{colour}" stroke-width="1.2" fill="none"{dash}/>')
    return found


def _dots(x: Array, values: Array, bounds: tuple[Array, Array] | None, colour: str, *, bars: bool) -> list[str]:
    """Dots with whiskers, or bars alone. Dots are rounded squares: printers leave out lines without a length."""
    ends = () if bounds is None else zip(x, *bounds, strict=True)
    whiskers = "".join(f"M{a:.1f} {b:.1f}V{c:.1f}" for a, b, c in ends if math.isfinite(a + b + c))
    look = 'stroke-width="9" stroke-opacity="0.3"' if bars else 'stroke-width="1.6"'
    found = [f'<path d="{whiskers}" style="stroke:{colour}" {look} fill="none"/>']
    size = 1.5 if len(x) > FEW else 3.0
    around = f"h{size:g}v{size:g}h{-size:g}z"
    corners = zip(x - 0.5 * size, values - 0.5 * size, strict=True)
    dots = "".join(f"M{a:.1f} {b:.1f}{around}" for a, b in corners if math.isfinite(a + b))
    round_ = 'stroke-width="2" stroke-linejoin="round"'
    return found if bars else [*found, f'<path d="{dots}" style="stroke:{colour};fill:{colour}" {round_}/>']


def _area(x: Array, bounds: tuple[Array, Array], colour: str, opacity: float) -> list[str]:
    """Values between two bounds."""
    found = []
    for part in _segments(x, *bounds):
        low, high = (_outline(x[part], bound[part], side) for bound, side in zip(bounds, (1, 0), strict=True))
        paint = f"fill:{colour};stroke:{colour};stroke-width:0.6" if opacity == 1.0 else f"fill:{colour}"
        found.append(f'<path d="M{low}L{_reverse(high)}Z" style="{paint}" fill-opacity="{opacity:g}"/>')
    return found


def _segments(*values: Array) -> list[slice]:
    """Segments without gaps, in which all are finite."""
    fine = np.concatenate([[False], np.isfinite(np.sum(values, axis=0)), [False]])
    edges = np.flatnonzero(np.diff(fine.astype(int)))
    return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _outline(x: Array, y: Array, extreme: int | None = None) -> str:
    """Points of a curve, thinned to the smallest and largest (or one of both) of each column of pixels."""
    column = np.floor(x / COLUMN)
    first = np.flatnonzero(np.diff(column, prepend=-np.inf))
    if 2 * len(first) < len(x):
        sides = np.minimum.reduceat(y, first), np.maximum.reduceat(y, first)
        x, y = (x[first], sides[extreme]) if extreme is not None else (np.repeat(x[first], 2), np.ravel(sides, "F"))
    return " ".join(f"{a:.1f} {b:.1f}" for a, b in zip(x.tolist(), y.tolist(), strict=True))


def _reverse(points: str) -> str:
    numbers = points.split(" ")
    return " ".join(f"{x} {y}" for x, y in zip(numbers[-2::-2], numbers[::-2], strict=True))


def _shades(cells: Cells, to_x: Place, to_y: Place) -> list[str]:
    """Cells in a few shades, those of one shade that lie above each other as one rectangle."""
    share = np.clip((cells.values - cells.low) / ((cells.high - cells.low) or 1.0), 0.0, 1.0)
    level = np.nan_to_num(np.round(SHADES * share), nan=0.0).astype(int)
    edges = to_y(np.concatenate([cells.y[:1], 0.5 * (cells.y[1:] + cells.y[:-1]), cells.y[-1:]]))
    left, right = to_x(cells.x - 0.5 * cells.width), to_x(cells.x + 0.5 * cells.width)
    paths: dict[int, list[str]] = {}
    for column, a, b in zip(level, left.tolist(), right.tolist(), strict=True):
        ends = np.flatnonzero(np.diff(column, prepend=-1, append=-1))
        for first, end in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
            rectangle = f"M{a:.1f} {edges[first]:.1f}H{b:.1f}V{edges[end]:.1f}H{a:.1f}Z"
            paths.setdefault(int(column[first]), []).append(rectangle)
    return [
        f'<path d="{"".join(path)}" style="fill:var(--estimate)" fill-opacity="{shade / SHADES:.2f}"/>'
        for shade, path in sorted(paths.items()) if shade
    ]  # fmt: skip


def _spans(plot: Plot, to_x: Place) -> list[str]:
    found = []
    for span in plot.spans:
        start, end = to_x(_array([span.start, span.end]))
        found.append(
            f'<rect x="{start:.1f}" y="{TOP:g}" width="{max(end - start, 1.0):.1f}" height="{HEIGHT - TOP - BOTTOM:g}" '
            f'style="fill:var(--{span.colour})" fill-opacity="0.16"/>'
        )
    return found


def _marks(plot: Plot, to_x: Place, to_y: Place, right: float) -> list[str]:
    found = []
    for mark in plot.marks:
        at = (to_y if mark.across else to_x)(_array([mark.at]))[0]
        path = f"M{LEFT:g} {at:.1f}H{right:g}" if mark.across else f"M{at:.1f} {TOP:g}V{HEIGHT - BOTTOM:g}"
        if math.isfinite(at):
            found.append(
                f'<path d="{path}" style="stroke:var(--{mark.colour})" stroke-width="1" stroke-dasharray="2 3"/>'
            )
        if mark.across:
            found.append(_text(LEFT + 4.0, at - 4.0, mark.name, f"var(--{mark.colour})", "start"))
    return found


def _mark_names(plot: Plot, to_x: Place, right: float) -> list[str]:
    """Names of vertical marks, each in the lowest row that has room."""
    found, rows = list[str](), [-math.inf] * NAME_ROWS
    for mark in sorted((m for m in plot.marks if m.name and not m.across), key=lambda m: m.at):
        at, half = float(to_x(_array([mark.at]))[0]), CHARACTER * len(mark.name)
        row = next((i for i, end in enumerate(rows) if at - half >= end), None)
        if row is not None and LEFT <= at <= right:
            found.append(_text(at, TOP - 5.0 - 12.0 * row, mark.name, f"var(--{mark.colour})", "middle"))
            rows[row] = at + half
    return found


def _end_names(plot: Plot, x: Array, to_y: Place, right: float) -> list[str]:
    """Names of lines at their right ends, from the highest down, each below the one before; of lines that end before,
    at their last points."""
    ends, found = [], list[str]()
    for curve in plot.curves:
        known = np.flatnonzero(np.isfinite(to_y(_array(curve.values))))
        if curve.look != "line" or not len(known):
            continue
        at, end = float(to_y(_array(curve.values))[known[-1]]), float(x[known[-1]])
        if end >= right - 0.01 * (right - LEFT):
            ends.append((at, curve))
        elif end > LEFT:
            found.append(_text(end + 4.0, max(at + 3.5, TOP + 10.0), curve.name, f"var(--{curve.colour})", "start"))
    last, below, places = -math.inf, HEIGHT - BOTTOM + 0.5 * LINE, list[float]()
    ends.sort(key=lambda one: one[0])
    for at, _ in ends:
        places.append(last := max(at, last + LINE))
    for at, (_, curve) in zip(reversed(places), reversed(ends), strict=True):
        at = min(at, below)
        below = at - LINE
        found.append(_text(right + 6.0, at + 3.5, curve.name, f"var(--{curve.colour})", "start"))
    return found


def _frame(
    plot: Plot, limits: Sequence[tuple[float, float]], places: Sequence[Place], right: float
) -> list[str]:  # fmt: skip
    """Grid, ticks and labels."""
    (to_x, to_y), bottom, found = places, HEIGHT - BOTTOM, list[str]()
    names = plot.x_axis.names
    turned = bool(names) and 2.0 * CHARACTER * max(map(len, names)) > (right - LEFT) / len(names)
    for value, name in _ticks(plot.x_axis, limits[0], 8):
        at = to_x(_array([value]))[0]
        found.append(f'<path d="M{at:.1f} {TOP:g}V{bottom:g}" style="stroke:var(--rule)"/>')
        if turned:
            turn = f' transform="rotate(-25 {at:.1f} {bottom + 12:.1f})"'
            found.append(_text(at, bottom + 12.0, name, "var(--quiet)", "end", turn))
        else:
            found.append(_text(at, bottom + 14.0, name, "var(--quiet)", "middle"))
    for value, name in _ticks(plot.y_axis, limits[1], 5):
        at = to_y(_array([value]))[0]
        found.append(f'<path d="M{LEFT:g} {at:.1f}H{right:g}" style="stroke:var(--rule)"/>')
        found.append(_text(LEFT - 6.0, at + 3.5, name, "var(--quiet)", "end"))
    found.append(_text(0.5 * (LEFT + right), HEIGHT - 8.0, plot.x_axis.label, "var(--ink)", "middle"))
    middle = 0.5 * (TOP + bottom)
    upright = f' transform="rotate(-90 12 {middle:g})"'
    return [*found, _text(12.0, middle, plot.y_axis.label, "var(--ink)", "middle", upright)]


def _text(x: float, y: float, text: str, colour: str, anchor: str, more: str = "") -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="11" style="fill:{colour}"{more}>'
        f"{escape(text)}</text>"
    )


def _ticks(axis: Axis, limits: tuple[float, float], most: int) -> list[tuple[float, str]]:
    """Places and names of ticks."""
    low, high = limits
    if axis.names:
        every = -(-len(axis.names) // most)
        return [(float(i), name) for i, name in enumerate(axis.names) if i % every == 0]
    if axis.log and high > 10.0 * low:
        powers = range(math.ceil(math.log10(low)), math.floor(math.log10(high)) + 1)
        return [(10.0**n, _power_of_ten(n)) for n in powers[:: max(1, -(-len(powers) // most))]]
    step = _step((high - low) / most)
    values = (step * np.arange(math.ceil(low / step), math.floor(high / step) + 1)).tolist()
    return _dated(values, step) if axis.dates else [(value, f"{value + 0.0:.6g}") for value in values]


def _power_of_ten(n: int) -> str:
    """Ten to the power of n as text: a number where it is short.

    Examples
    --------
    >>> _power_of_ten(-2), _power_of_ten(-5), _power_of_ten(6)
    ('0.01', '10⁻⁵', '10⁶')
    """
    return f"{10.0**n:g}" if -4 < n < 6 else "10" + str(n).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _dated(values: Sequence[float], step: float) -> list[tuple[float, str]]:
    form = "%Y-%m-%d" if step > 2e4 else "%m-%d %H:%M"
    return [(value, datetime.fromtimestamp(value, UTC).strftime(form)) for value in values]


def _step(least: float) -> float:
    """The next of 1, 2, 5, 10 … above a size."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= 0.999 * least)

"""A Campbell diagram as a figure and as one page."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from windsysid._types import Array
from windsysid.modal.campbell import MEASURED_HEADINGS, Campbell, speed_range
from windsysid.output.table import Table, axes_of
from windsysid.reports.html import Section, report_page
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve, ShadedRange
from windsysid.results.posterior import SIGMAS
from windsysid.units import RPM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Campbell", "data", "figure", "files", "is_of_blades", "page", "plots", "sections"]


BLADE_KINDS = ("lag", "edge", "flap", "torsion", "blade ")

MAX_HARMONIC_RATIO = 2.5
"""Setting: highest frequency that is drawn, relative to the highest harmonic; models have modes far above."""

POINTS, APART = 240, 0.006
"""Setting: rotor speeds at which curves are drawn, and distance of points that were measured at one speed, relative to
the range of speeds, so that their intervals are seen."""


def is_of_blades(name: str) -> bool:
    """Test whether a mode or a degree of freedom is one of the blades, by its name."""
    return name.startswith(BLADE_KINDS)


def figure(found: Campbell, place: "Axes | None" = None) -> "Figure":
    """Frequencies and damping ratios with ±2σ against rotor speed; harmonics dashed, the operating range shaded."""
    from windsysid.reports.figures.drawing import drawn

    return drawn(plots(found), place, columns=1)


def plots(found: Campbell) -> list[Plot]:
    """Frequencies and damping ratios over rotor speed; harmonics dashed, measured modes as points."""
    rpm = found.speeds * RPM
    top = 1.06 * max(float(np.nanmax(curve.frequency + SIGMAS * curve.frequency_std)) for curve in found.curves)
    if found.orders:
        top = min(top, MAX_HARMONIC_RATIO * max(found.orders) * rpm[-1] / 60.0)
    shown = [curve for curve in found.curves if np.nanmin(curve.frequency) < top]
    dense, apart = np.linspace(rpm[0], rpm[-1], POINTS), APART * max(rpm[-1] - rpm[0], 1.0)
    speeds = [mode.speed * RPM for mode in found.measured]
    at = np.array([v + apart * (speeds[:i].count(v) - 0.5 * (speeds.count(v) - 1)) for i, v in enumerate(speeds)])
    x = np.unique(np.concatenate([rpm, dense, at]))
    least = min(0.0, 1.1 * min(float(np.nanmin(100.0 * (c.damping - SIGMAS * c.damping_std))) for c in shown))
    most = 1.06 * max(float(np.nanmax(100.0 * (c.damping + SIGMAS * c.damping_std))) for c in shown)
    ratios = [mode.damping_ratio for mode in found.measured]
    most = max([most, *(105.0 * min(one.high, 2.0 * one.estimate) for one in ratios)])
    harmonics = [(f"{n}P", n * x / 60.0) for n in found.orders]
    lines = [
        PlotCurve(name, np.where(f <= top, f, np.nan), colour="measured", dashed=True) for name, f in harmonics
    ]  # fmt: skip
    curves = [_curve(found, c.name, x, c.frequency, c.frequency_std) for c in shown]
    damped = [_curve(found, c.name, x, 100.0 * c.damping, 100.0 * c.damping_std) for c in shown]
    low, high = (value * RPM for value in found.operating)
    spans = [ShadedRange(low, high, "operating range" if found.orders else "parked")]
    spans += [ShadedRange(one.low * RPM, one.high * RPM, "unstable", "error") for one in found.unstable]
    usual = Mark(float(rpm[found.usual]), group="the record" if found.record else "usual speed")
    x_axis = Axis("rotor speed [rpm]", limits=(float(rpm[0]), float(rpm[-1])))
    common = {"spans": spans, "link": "speed", "end_names": True, "tall": True}
    return [
        Plot("Natural frequencies", x, [*lines, *curves, *_points(found, x, at, "frequency", 1.0)], x_axis,
             Axis("frequency [Hz]", limits=(0.0, top)), [usual], **common),  # type: ignore[arg-type]
        Plot("Damping ratios", x, [*damped, *_points(found, x, at, "damping_ratio", 100.0)], x_axis,
             Axis("damping ratio [%]", limits=(least, most)), [usual, Mark(0.0, across=True)], **common),  # type: ignore[arg-type]
    ]  # fmt: skip


def _curve(found: Campbell, name: str, x: Array, value: Array, std: Array) -> PlotCurve:
    """Values of a mode with ±2σ at the speeds x, as far as it oscillates."""
    seen, colour = np.isfinite(value), "other" if is_of_blades(name) else "estimate"
    middle, half = (np.interp(x, RPM * found.speeds[seen], v[seen], np.nan, np.nan) for v in (value, SIGMAS * std))
    low, high = (middle - half, middle + half) if found.banded else (None, None)
    return PlotCurve(name, middle, low, high, colour=colour)


def _points(found: Campbell, x: Array, at: Array, quantity: str, scale: float) -> Iterator[PlotCurve]:
    """Measured modes with their intervals, those that are not to be trusted apart."""
    for trusted, name, colour in ((True, "measured", "reference"), (False, "measured, not to be trusted", "error")):
        rows = [i for i, mode in enumerate(found.measured) if mode.trusted is trusted]
        values = np.full((3, len(x)), np.nan)
        for i in rows:
            one = getattr(found.measured[i], quantity)
            values[:, np.searchsorted(x, at[i])] = scale * one.estimate, scale * one.low, scale * one.high
        if rows:
            yield PlotCurve(name, values[0], values[1], values[2], "dots", colour)


def sections(found: Campbell) -> list[Section]:
    """Sections of the page, with the diagram."""
    bands = (
        f"; shaded: 95 % intervals {found.band_source}, those of frequencies often as thin as the lines"
        if found.banded
        else ""
    )
    caption = f"In the fixed frame. Blue: tower, green: blades{bands}. Dashed: harmonics of the rotor." + (
        " Points: measured, with 95 % intervals, those of one speed next to each other." if found.measured else ""
    )
    where = f"Distance f / nP − 1 where it is least {speed_range(found.operating)}" if found.orders else "Parked"
    distances = where + (", ± 95 % interval" if found.banded else "") + axes_of(curve.name for curve in found.curves)
    frequencies, ratios = plots(found)
    parts = [
        Section("Resonance and stability", text=found.sentences, tables=[Table(found.headings, found.rows, distances)]),
        Section("Campbell diagram", text=[caption], plots=[frequencies]),
        Section("Damping over rotor speed", plots=[ratios]),
        Section("How this was computed", text=found.notes),
    ]
    if found.measured:
        beside = Table(MEASURED_HEADINGS, found.measured_rows, "", words=(0, 2, 5, 7))
        parts.insert(3, Section("What was measured", tables=[beside]))
    return parts


def files(found: Campbell) -> dict[str, bytes]:
    """``report.html``, ``modes.csv`` and ``summary.json``, by name."""
    return {"report.html": page(found, sections(found)), **data(found)}


def page(found: Campbell, parts: Sequence[Section]) -> bytes:
    """The page of some sections."""
    subtitle = f"{found.title} · {speed_range((found.speeds[0], found.speeds[-1]))}"
    return report_page("Modes against rotor speed", subtitle, parts)


def data(found: Campbell) -> dict[str, bytes]:
    """``modes.csv``, ``summary.json``, and ``measured.csv`` of measured modes, by name."""
    measured = {}
    if found.measured:
        import pandas as pd

        rows = [
            {
                **mode._asdict(),
                **{f"{name}{end}": getattr(getattr(mode, name), value)
                   for name in ("frequency", "damping_ratio")
                   for end, value in (("", "estimate"), ("_low", "low"), ("_high", "high"))},
            }
            for mode in found.measured
        ]  # fmt: skip
        measured["measured.csv"] = pd.DataFrame(rows).to_csv(index=False).encode()
    return {
        **measured,
        "modes.csv": found.to_dataframe().to_csv(index=False).encode(),
        "summary.json": found.to_json().encode(),
    }

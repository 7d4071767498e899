"""A Campbell diagram as a figure and as one page."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.modal.campbell import MEASURED_HEADINGS, Campbell, speed_range
from windsysid.output.table import Table
from windsysid.reports.figures.canvas import canvas
from windsysid.reports.figures.plots import BAND, ERROR, ESTIMATE, MEASURED, REFERENCE, tidy
from windsysid.reports.html import Section, png, report_page
from windsysid.results.posterior import SIGMAS
from windsysid.units import RPM

__all__ = ["Campbell", "data", "figure", "files", "is_of_blades", "page", "sections"]


BLADES, BLADES_BAND = "#2e7d46", "#b7d9c1"
"""Modes of the blades; the support's are blue."""

BLADE_KINDS = ("lag", "edge", "flap", "torsion", "blade ")

MAX_HARMONIC_RATIO = 2.5
"""Setting: highest frequency that is drawn, relative to the highest harmonic; models have modes far above."""

MAX_MARKED_SPEEDS = 12
"""Setting: largest number of rotor speeds that are marked on the curves."""


def is_of_blades(name: str) -> bool:
    """Test whether a mode or a degree of freedom is one of the blades, by its name."""
    return name.startswith(BLADE_KINDS)


def figure(found: Campbell, place: Axes | None = None) -> Figure:
    """Frequencies and damping ratios with ±2σ against rotor speed; harmonics dashed, the operating range shaded."""
    drawn = canvas((10.0, 8.6), place)
    above, below = drawn.subplots(2, 1, sharex=True, height_ratios=[1.9, 1.0])
    rpm = found.speeds * RPM
    top = 1.06 * max(float(np.nanmax(curve.frequency + SIGMAS * curve.frequency_std)) for curve in found.curves)
    if found.orders:
        top = min(top, MAX_HARMONIC_RATIO * max(found.orders) * rpm[-1] / 60.0)
    found = replace(found, curves=tuple(curve for curve in found.curves if np.nanmin(curve.frequency) < top))
    ends = _draw_curves(found, above, below)
    _draw_measured(found, above, below)
    for order in found.orders:
        above.plot(rpm, order * rpm / 60.0, color=MEASURED, ls="--", lw=0.9, zorder=1)
        near = min(0.95 * (rpm[-1] - rpm[0]) + rpm[0], 60.0 * 0.94 * top / order)
        above.text(
            near, order * near / 60.0, f"{order}P", ha="center", va="center", fontsize=8.5, color="#555555",
            bbox={"facecolor": "white", "lw": 0, "pad": 1.2, "alpha": 0.9},
        )  # fmt: skip
    above.set(ylim=(0.0, top), ylabel="frequency [Hz]")
    below.set(xlim=(rpm[0], rpm[-1]), xlabel="rotor speed [rpm]", ylabel="damping ratio [%]")
    low, high = (value * RPM for value in found.operating)
    least = min(0.0, 1.1 * min(float(np.nanmin(100.0 * (c.damping - SIGMAS * c.damping_std))) for c in found.curves))
    below.set_ylim(bottom=least)
    for ax in (above, below):
        ax.axvspan(low, high, color="#f2ead9", lw=0, zorder=0)
        ax.axvline(found.speeds[found.usual] * RPM, color=REFERENCE, ls=":", lw=0.8, zorder=1)
        for each in found.unstable:
            ax.axvspan(each.low * RPM, each.high * RPM, color=ERROR, alpha=0.25, lw=0, zorder=0)
        tidy(ax)
        _label_ends(ax, ends[ax])
    if least < 0.0:
        below.axhline(0.0, color=REFERENCE, lw=0.8)
    words = ("operating range" if found.orders else "parked") + ("; orange: unstable" if found.unstable else "")
    above.text(0.5 * (low + high), 1.012, words, transform=above.get_xaxis_transform(), ha="center", fontsize=8.5)
    return drawn


Ends = dict[Axes, list[tuple[float, str, str]]]
"""Of each axes, the value, name and colour of the curves that reach its right end."""


def _draw_curves(found: Campbell, above: Axes, below: Axes) -> Ends:
    """Draw the modes' frequencies and damping ratios with ±2σ."""
    rpm = found.speeds * RPM
    ends: Ends = {above: [], below: []}
    for curve in found.curves:
        colour, band = (BLADES, BLADES_BAND) if is_of_blades(curve.name) else (ESTIMATE, BAND)
        for ax, value, std in (
            (above, curve.frequency, curve.frequency_std), (below, 100.0 * curve.damping, 100.0 * curve.damping_std),
        ):  # fmt: skip
            ax.fill_between(rpm, value - SIGMAS * std, value + SIGMAS * std, color=band, alpha=0.55, lw=0)
            ax.plot(rpm, value, color=colour, lw=1.0, marker="o" if len(rpm) <= MAX_MARKED_SPEEDS else "", ms=3.5)
            seen = np.flatnonzero(np.isfinite(value))
            if seen[-1] == len(rpm) - 1:
                ends[ax].append((float(value[-1]), curve.name, colour))
            elif np.isfinite(value[found.usual]):
                ax.annotate(
                    curve.name, (rpm[seen[-1]], value[seen[-1]]), (5, 0), textcoords="offset points", fontsize=8.5,
                    color=colour, va="bottom",
                )  # fmt: skip
    return ends


def _draw_measured(found: Campbell, above: Axes, below: Axes) -> None:
    """Draw measured modes as points with ±2σ, hollow where they are not to be trusted."""
    for mode in found.measured:
        fill = REFERENCE if mode.trusted else "white"
        for ax, one, scale in ((above, mode.frequency, 1.0), (below, mode.damping_ratio, 100.0)):
            reach = [[scale * (one.estimate - one.low)], [scale * (one.high - one.estimate)]]
            ax.errorbar(
                mode.speed * RPM, scale * one.estimate, yerr=reach, fmt="o", ms=5, color=REFERENCE, mfc=fill,
                elinewidth=0.9, zorder=4,
            )  # fmt: skip


def _label_ends(ax: Axes, ends: list[tuple[float, str, str]]) -> None:
    """Write each curve's name next to its right end, none over another, a thin line to those that had to move."""
    low, high = ax.get_ylim()
    ends = [end for end in ends if end[0] <= high]
    height = ax.bbox.height / ax.figure.dpi * 72.0
    gap = 11.5 * (high - low) / height
    ends = sorted(ends)
    places = [end[0] for end in ends]
    for _ in range(100):
        for i in range(len(places) - 1):
            overlap = gap - (places[i + 1] - places[i])
            if overlap > 0.0:
                places[i] -= 0.5 * overlap
                places[i + 1] += 0.5 * overlap
        shift = max(0.0, low + 0.4 * gap - places[0])
        places[0] += shift
    for place, (value, name, colour) in zip(places, ends, strict=True):
        moved = abs(place - value) > 0.15 * gap
        ax.annotate(
            name, (1.0, value), (1.03 if moved else 1.012, place), xycoords=("axes fraction", "data"),
            textcoords=("axes fraction", "data"), fontsize=8.5, color=colour, va="center", annotation_clip=False,
            arrowprops={"arrowstyle": "-", "lw": 0.5, "color": colour, "shrinkA": 0, "shrinkB": 0,
            "relpos": (0.0, 0.5)} if moved else None,
        )  # fmt: skip


def sections(found: Campbell, drawn: bytes) -> list[Section]:
    """Sections of the page, with the diagram."""
    bands = (
        f"; shaded: 95 % intervals {found.band_source}, those of frequencies often as thin as the lines"
        if found.banded
        else ""
    )
    caption = (
        f"Frequencies and damping ratios in the fixed frame. Blue: tower, green: blades{bands}. Dashed: harmonics of"
        f" the rotor, dotted: {'the record' if found.record else 'the usual speed'}."
        + (" Points: measured, with 95 % intervals; hollow where they are not to be trusted." if found.measured else "")
    )
    where = f"Distance f / nP − 1 where it is least {speed_range(found.operating)}" if found.orders else "Parked"
    distances = where + (", ± 95 % interval" if found.banded else "")
    parts = [
        Section("Resonance and stability", text=found.sentences, tables=[Table(found.headings, found.rows, distances)]),
        Section("Campbell diagram", figures=[(drawn, caption)]),
        Section("How this was computed", text=found.notes),
    ]
    if found.measured:
        beside = Table(MEASURED_HEADINGS, found.measured_rows, "", words=(0, 2, 5, 7))
        parts.insert(2, Section("What was measured", tables=[beside]))
    return parts


def files(found: Campbell) -> dict[str, bytes]:
    """``report.html``, ``campbell.png``, ``modes.csv`` and ``summary.json``, by name."""
    drawn = png(figure(found))
    return {"report.html": page(found, sections(found, drawn)), "campbell.png": drawn, **data(found)}


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

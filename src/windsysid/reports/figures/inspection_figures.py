"""Figures of an inspection: the record with its faults, spectra, spectrograms."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid._types import Array
from windsysid.inspection.bodies import body_of
from windsysid.inspection.fault import Fault
from windsysid.inspection.spectra import ExpectedLine, Spectrogram, Spectrum, seen_from
from windsysid.reports.figures.canvas import label
from windsysid.reports.figures.plots import (
    ERROR,
    MAX_UNIT_CHARACTERS,
    REFERENCE,
)
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve, ShadedRange, thinned
from windsysid.units import RPM, unit_text

if TYPE_CHECKING:
    from windsysid.inspection.inspection import Inspection

__all__ = [
    "channels_drawn", "density_unit", "drawn_lines", "highest_drawn", "history_plots", "spectrogram_figure",
]  # fmt: skip


MOST_PANELS = 12
MOST_MARKS = 200
SMALL = 7.5
MAX_TITLE_CHARACTERS = 40
"""Largest length of a name above one of three spectra in a row."""

_DRAWN = {"rad/s": ("rpm", RPM), "N*m": ("kN·m", 1e-3), "N": ("kN", 1e-3), "W": ("kW", 1e-3)}


_COLOURS, _STYLES = (REFERENCE, ERROR), (":", "--")
"""Of harmonics and of modes."""


def history_plots(inspection: "Inspection") -> list[Plot]:
    """Channels over time with faults, the proposed sections by rank, and where the rotor stops and starts."""
    record, plots = inspection.record, []
    sections = [
        ShadedRange(one.start, one.end, f"section {rank}", "estimate")
        for rank, one in enumerate((p for p in inspection.proposals if p.good), 1)
    ]
    stops = [
        Mark(edge, "", "reference", "stops of the rotor") for one in inspection.stops for edge in (one.start, one.end)
    ]
    for channel in inspection.shown(MOST_PANELS):
        unit, factor = _unit_drawn(channel, record.unit(channel))
        time, low, high = _broken(*thinned(record.time, factor * record[channel]), inspection.of(""))
        curve = PlotCurve("measured", 0.5 * (low + high), low, high, "area", "measured")
        spans = [*sections, *_faulty_ranges(inspection, channel)]
        axes = Axis("time [s]"), Axis(f"[{unit}]")
        plots.append(Plot(channel.replace("_", " "), time, [curve], *axes, stops, spans, link="time"))
    return plots


def _faulty_ranges(inspection: "Inspection", channel: str) -> list[ShadedRange]:
    """Ranges of faults and gaps, each at least a pixel wide."""
    time = inspection.record.time
    gaps = [finding for finding in inspection.of("") if finding.kind == "gaps"]
    return [
        ShadedRange(a, max(b, a + (time[-1] - time[0]) / 1000.0), finding.kind, "error")
        for finding in (*inspection.of(channel), *gaps) if finding.severity != "note"
        for a, b in _some(finding.spans).tolist()
    ]  # fmt: skip


def _broken(time: Array, low: Array, high: Array, findings: Sequence[Fault]) -> tuple[Array, Array, Array]:
    """Curve that is not drawn across gaps of the time."""
    gaps = [finding.spans for finding in findings if finding.kind == "gaps"]
    if not gaps or time.size < 2:
        return time, low, high
    at = np.unique(np.searchsorted(time, np.concatenate(gaps).mean(axis=1)))
    at = at[(at > 0) & (at < time.size)]
    return np.insert(time, at, time[at]), np.insert(low, at, np.nan), np.insert(high, at, np.nan)


def _unit_drawn(channel: str, unit: str) -> tuple[str, float]:
    if unit == "rad/s" and not ("rotor" in channel and "speed" in channel):
        return "rad/s", 1.0
    if unit == "rad" and ("direction" in channel or "pitch" in channel or "yaw" in channel):
        return "°", 180.0 / np.pi
    if unit == "1" and "strain" in channel:
        return "10⁻⁶", 1e6
    return _DRAWN.get(unit, (label(unit_text(unit), MAX_UNIT_CHARACTERS), 1.0))


def _some(spans: Array) -> Array:
    """At most `MOST_MARKS` of some spans (n, 2)."""
    return spans[:: -(-len(spans) // MOST_MARKS) or 1].reshape(-1, 2)


def channels_drawn(inspection: "Inspection") -> list[Spectrum]:
    """The most informative spectra, not more than fit on a page; simulated ones without gravity come last."""
    return sorted(inspection.spectra, key=lambda spectrum: "kinematic" in spectrum.channel)[:MOST_PANELS]


def density_unit(unit: str) -> str:
    """Unit of the spectral density of a channel."""
    if unit.startswith("as written"):
        return "unit²/Hz"
    return {"1": "1/Hz", "m": "m²/Hz", "rad": "rad²/Hz", "N": "N²/Hz", "W": "W²/Hz"}.get(
        unit, f"({unit_text(unit)})²/Hz"
    )


def highest_drawn(spectrum: Spectrum, blades: int) -> float:
    """Upper end of the frequency axis [Hz]: above 2N P, the modes and the highest listed peak."""
    marked = [line.frequency for line in spectrum.lines if line.mode or line.number in (1, blades, 2 * blades)]
    top = max((1.35 * max(marked, default=0.0), *(1.1 * peak.frequency for peak in spectrum.peaks)))
    return min(float(spectrum.frequency[-1]), top) if marked else float(spectrum.frequency[-1])


def drawn_lines(lines: Sequence[ExpectedLine], blades: int, top: float) -> list[ExpectedLine]:
    """Modes, and 1P, N P and 2N P, below a frequency [Hz]."""
    return [line for line in lines if (line.mode or line.number in (1, blades, 2 * blades)) and line.frequency < top]


def spectrogram_figure(inspection: "Inspection") -> Figure | None:
    """Frequency over rotor speed where that varies, over time where it does not."""
    pictures = inspection.spectrograms
    if not pictures:
        return None
    figure = Figure(figsize=(10.5, 3.6 * len(pictures) + 0.5), layout="constrained")
    for ax, picture in zip(figure.subplots(len(pictures), 1, squeeze=False)[:, 0], pictures, strict=True):
        _spectrogram(figure, ax, picture, inspection)
    return figure


def _spectrogram(figure: Figure, ax: Axes, picture: Spectrogram, inspection: "Inspection") -> None:
    lines, top = _lines_and_top(inspection, picture)
    inside = picture.frequency <= 1.02 * top + picture.frequency[1]
    every = max(1, int(inside.sum()) // 500)
    frequency = picture.frequency[inside][::every]
    with np.errstate(divide="ignore"):
        level = 10.0 * np.log10(picture.density[inside][::every])
    if not np.isfinite(level).any():
        ax.set_axis_off()
        return
    campbell = picture.against == "rotor speed"
    x = picture.position * (RPM if campbell else 1.0)
    once = inspection.rotor.mean / (2.0 * np.pi) if inspection.rotor is not None else 0.0
    low, high = _level_limits(level, level[frequency > 0.5 * once])
    mesh = ax.pcolormesh(x, frequency, level, vmin=low, vmax=high, cmap="Blues", shading="nearest", rasterized=True)
    bar = figure.colorbar(mesh, ax=ax, pad=0.09)
    bar.set_label(f"[dB re {f'1 {density_unit(picture.unit)}'.replace('1 1/', '1/')}]", fontsize=8)
    bar.ax.tick_params(labelsize=8)
    ax.set_facecolor("#e9e9e9")
    right: list[tuple[float, str, str]] = []
    for line in drawn_lines(lines, inspection.blades, top * 1.0001):
        curve, colour = _curve(inspection, picture, line, x), _COLOURS[line.mode]
        ax.plot(*curve, color=colour, ls=_STYLES[line.mode], lw=1.1, alpha=0.9)
        right.append((float(curve[1][-1]), line.name, colour))
    _name_at_right(ax, right, top)
    ax.set_ylim(0.0 if every == 1 else picture.frequency[1], top)
    if x.size > 1:
        ax.set_xlim(x[0] - 0.5 * (x[1] - x[0]), x[-1] + 0.5 * (x[-1] - x[-2]))
    ax.set_xlabel("rotor speed [rpm]" if campbell else "time [s]", fontsize=8.5)
    ax.set_ylabel("frequency [Hz]", fontsize=8.5)
    ax.set_title(label(picture.channel.replace("_", " ")), fontsize=9, loc="left", pad=3)
    ax.spines[["top", "right"]].set_visible(False)
    ax.tick_params(labelsize=8)


def _lines_and_top(inspection: "Inspection", picture: Spectrogram) -> tuple[Sequence[ExpectedLine], float]:
    """Expected lines of the channel, and the upper end of its frequency axis [Hz]."""
    top = float(picture.frequency[-1])
    for spectrum in inspection.spectra:
        if spectrum.channel == picture.channel:
            return spectrum.lines, min(highest_drawn(spectrum, inspection.blades), top)
    return (), top


def _level_limits(level: Array, vibrating: Array) -> tuple[float, float]:
    """Lowest and highest level [dB] that has a colour; slow changes of the load would take all the colours."""
    high = float(np.percentile(vibrating[np.isfinite(vibrating)], 99.9))
    return max(float(np.percentile(level[np.isfinite(level)], 5.0)), high - 60.0), high


def _curve(inspection: "Inspection", picture: Spectrogram, line: ExpectedLine, x: Array) -> tuple[Array, Array]:
    """Position of a line: a harmonic rises with the rotor speed [rpm], a mode stays or splits."""
    if picture.against != "rotor speed":
        return x[[0, -1]], np.full(2, line.frequency)
    return _over_speed(inspection, picture, line) if line.mode else (x, line.number * x / 60.0)


def _over_speed(inspection: "Inspection", picture: Spectrogram, line: ExpectedLine) -> tuple[Array, Array]:
    """A mode's frequency as this channel sees it, over rotor speed [rpm]."""
    speeds, values = [], []
    for speed, modes in inspection.modes_over_speed:
        if line.number <= len(modes):
            name, frequency, _ = modes[line.number - 1]
            turning = body_of(picture.channel) == "rotor"
            seen = {said: f for f, said in seen_from(name, frequency, speed / (2.0 * np.pi), turning)}
            if line.name in seen:
                speeds.append(speed * RPM)
                values.append(seen[line.name])
    return (np.array(speeds), np.array(values)) if speeds else (picture.position[-1:] * RPM, np.array([line.frequency]))


def _name_at_right(ax: Axes, names: Sequence[tuple[float, str, str]], top: float) -> None:
    """Names next to the right end of their lines, moved apart where they would overlap."""
    gap = 0.045 * top
    last = -np.inf
    merged: list[tuple[float, list[str], str]] = []
    for y, text, colour in sorted(n for n in names if n[0] <= 1.02 * top):
        if merged and merged[-1][2] == colour and y - merged[-1][0] < gap:
            merged[-1][1].append(text)
        else:
            merged.append((y, [text], colour))
    for y, texts, colour in merged:
        families = list(dict.fromkeys(text.split()[0] for text in texts))
        text = texts[0] if len(texts) == 1 else f"{len(texts)} modes: {', '.join(families)}"
        last = max(y, last + gap)
        ax.annotate(
            text, (1.0, y), xycoords=ax.get_yaxis_transform(), xytext=(1.012, last),
            textcoords=ax.get_yaxis_transform(),
            fontsize=SMALL, color=colour, va="center", annotation_clip=False,
        )  # fmt: skip

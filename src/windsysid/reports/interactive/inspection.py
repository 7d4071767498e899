"""Plots of an inspection: the record with its faults and sections, its spectra, and its spectra over time."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from windsysid._types import Array
from windsysid.inspection.bodies import body_of
from windsysid.inspection.fault import Fault
from windsysid.inspection.spectra import ExpectedLine, Spectrogram, Spectrum, seen_from
from windsysid.output.table import titled
from windsysid.reports.interactive.plot import Axis, Cells, Mark, Plot, PlotCurve, ShadedRange, shortened, thinned
from windsysid.units import RPM, unit_text

if TYPE_CHECKING:
    from windsysid.inspection.inspection import Inspection

__all__ = ["broken", "drawn_lines", "gaps_of", "highest_drawn", "overview_plots", "some", "spectra_plots",
    "spectrogram_plots", "unit_drawn"]  # fmt: skip

MAX_PLOTS, MAX_MARKS, MAX_POINTS, MAX_CELLS = 12, 200, 2000, 120
"""Setting: channels that are drawn, faults that are marked in each, frequencies of a spectrum (of neighbours the
largest value is shown), and cells of a spectrum over time, each way."""

MAX_UNIT_CHARACTERS = 16
"""Setting: largest length of a unit; units of unknown quantities are texts from files."""

NAMES, COLOURS = ("rotor harmonics", "expected modes"), ("reference", "error")

_DRAWN = {"rad/s": ("rpm", RPM), "N*m": ("kN·m", 1e-3), "N": ("kN", 1e-3), "W": ("kW", 1e-3)}


def overview_plots(i: "Inspection") -> list[Plot]:
    """Channels over time, with their faults, the proposed sections and the stops of the rotor."""
    sections = [
        ShadedRange(p.start, p.end, "other sections" if rank else "best section", "other" if rank else "estimate")
        for rank, p in enumerate(p for p in i.proposals if p.good)
    ]
    stops = [Mark(edge, "", "reference", "stops of the rotor") for stop in i.stops for edge in (stop.start, stop.end)]
    plots = []
    for channel in i.shown(MAX_PLOTS):
        unit, factor = unit_drawn(channel, i.record.unit(channel))
        values = factor * i.record[channel]
        time, low, high = broken(*thinned(i.record.time, values), gaps_of(i))
        curve = PlotCurve("readings", 0.5 * (low + high), low, high, "area", "measured")
        kinds, faults, dots = _faults(i, channel, time, values)
        curves = [curve] if dots is None else [curve, dots]
        name = shortened(titled(channel))
        spans = [*sections, *faults]
        plots.append(
            Plot(name, time, curves, Axis("time [s]"), Axis(f"[{unit}]"), stops, spans, caption=kinds, link="time")
        )
    return plots


def _faults(
    i: "Inspection", channel: str, drawn: Array, values: Array
) -> tuple[str, list[ShadedRange], PlotCurve | None]:
    """Kinds of the faults of a channel in words; long ones as ranges, short ones as dots at the times drawn."""
    time, spans, dots = i.record.time, [], np.full(len(drawn), np.nan)
    faults = [fault for fault in (*i.of(channel), *gaps_of(i)) if fault.severity != "note"]
    for fault in faults:
        places = some(fault.spans)
        long = places[:, 1] - places[:, 0] > (time[-1] - time[0]) / 1000.0
        spans += [ShadedRange(start, end, "faults", "error") for start, end in places[long]]
        index = np.searchsorted(time, places[~long, 0] if fault.channel else [])
        dots[np.searchsorted(drawn, time[index], side="right") - 1] = values[index]
    marked = PlotCurve("short faults", dots, look="dots", colour="error") if np.isfinite(dots).any() else None
    return ", ".join(dict.fromkeys(fault.kind for fault in faults if fault.channel)), spans, marked


def spectra_plots(i: "Inspection") -> list[Plot]:
    """Spectra with the rotor's harmonics, the expected modes and the listed peaks, up to the highest of these."""
    plots = []
    for spectrum in channels_drawn(i):
        top = highest_drawn(spectrum, i.blades)
        f, density = spectrum.frequency[1:], spectrum.density[1:]
        size = max(1, -(-len(f) // MAX_POINTS))
        if not (density > 0.0).any():
            continue
        starts = range(0, len(f), size)
        curve = PlotCurve("measured", np.maximum.reduceat(density, starts))
        marks = [
            Mark(line.frequency, line.name, "error" if line.mode else "reference", NAMES[line.mode])
            for line in drawn_lines(spectrum.lines, i.blades, float(f[-1]))
        ]
        marks += [Mark(peak.frequency, "", "measured", "listed peaks") for peak in spectrum.peaks]
        axes = Axis("frequency [Hz]", limits=(0.0, top)), Axis(f"PSD [{density_unit(spectrum.unit)}]", log=True)
        title = titled(spectrum.channel)
        plots.append(Plot(title, f[::size], [curve], *axes, marks=marks, link="frequency"))
    return plots


def spectrogram_plots(i: "Inspection") -> list[Plot]:
    """Spectra over rotor speed where that varies, over time where it does not, with modes and rotor harmonics."""
    return [plot for plot in (_spectrogram_plot(i, picture) for picture in i.spectrograms) if plot is not None]


def _spectrogram_plot(i: "Inspection", picture: Spectrogram) -> Plot | None:
    over_speed = picture.against == "rotor speed"
    lines, top = _lines_and_top(i, picture)
    inside = (picture.frequency > 0.0) & (picture.frequency <= 1.02 * top + picture.frequency[1])
    x, y = picture.position * (RPM if over_speed else 1.0), picture.frequency[inside]
    with np.errstate(divide="ignore"):
        level = np.log10(_averaged(_averaged(picture.density[inside], 0), 1)).T
    x, y = _averaged(x[None], 1)[0], _averaged(y[None], 1)[0]
    level[~np.isfinite(level)] = np.nan
    if len(x) < 2 or not np.isfinite(level).any():
        return None
    once = i.rotor.mean / (2.0 * np.pi) if i.rotor is not None else 0.0
    vibrating = level[:, y > 0.5 * once]
    low, high = _level_limits(level, vibrating if np.isfinite(vibrating).any() else level)
    cells = Cells(x, y, level, float(np.median(np.diff(x))), low, high, density_unit(picture.unit))
    curves = [
        PlotCurve(line.name, _curve(i, picture, line, x), colour=COLOURS[line.mode], dashed=True)
        for line in drawn_lines(lines, i.blades, top * 1.0001)
    ]
    half, name = 0.5 * cells.width, shortened(titled(picture.channel))
    x_axis = Axis("rotor speed [rpm]" if over_speed else "time [s]", limits=(float(x[0] - half), float(x[-1] + half)))
    shades = f"strongest shade: {10.0**high:.2g} {cells.label}, weakest: {10.0 * (high - low):.0f} dB less"
    return Plot(name, x, curves, x_axis, Axis("frequency [Hz]", limits=(0.0, top)), caption=shades, cells=cells)


def _averaged(values: Array, axis: int) -> Array:
    """Means of neighbours along an axis, at most `MAX_CELLS`."""
    size = -(-values.shape[axis] // MAX_CELLS)
    starts = np.arange(0, values.shape[axis], size)
    counts = np.diff(starts, append=values.shape[axis])
    return np.asarray(np.add.reduceat(values, starts, axis) / np.moveaxis(np.atleast_2d(counts), -1, axis))


def _curve(i: "Inspection", picture: Spectrogram, line: ExpectedLine, x: Array) -> Array:
    """Frequency of a line over x: a harmonic rises with the rotor speed [rpm], a mode stays or splits."""
    if picture.against != "rotor speed":
        return np.full(len(x), line.frequency)
    return np.interp(x, *_over_speed(i, picture, line)) if line.mode else line.number * x / 60.0


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


def _lines_and_top(inspection: "Inspection", picture: Spectrogram) -> tuple[Sequence[ExpectedLine], float]:
    """Expected lines of the channel, and the upper end of its frequency axis [Hz]."""
    top = float(picture.frequency[-1])
    for spectrum in inspection.spectra:
        if spectrum.channel == picture.channel:
            return spectrum.lines, min(highest_drawn(spectrum, inspection.blades, peaks=False), top)
    return (), top


def _level_limits(level: Array, vibrating: Array) -> tuple[float, float]:
    """Lowest and highest level [log10] that has a shade of its own; slow changes of the load would take them all."""
    high = float(np.percentile(vibrating[np.isfinite(vibrating)], 99.9))
    return max(float(np.percentile(level[np.isfinite(level)], 5.0)), high - 6.0), high


def channels_drawn(inspection: "Inspection") -> list[Spectrum]:
    """The most informative spectra, not more than fit on a page; simulated ones without gravity come last."""
    return sorted(inspection.spectra, key=lambda spectrum: "kinematic" in spectrum.channel)[:MAX_PLOTS]


def highest_drawn(spectrum: Spectrum, blades: int, *, peaks: bool = True) -> float:
    """Upper end of the frequency axis [Hz]: above 2N P, the modes and, if `peaks`, the highest listed peak."""
    marked = [line.frequency for line in spectrum.lines if line.mode or line.number in (1, blades, 2 * blades)]
    listed = [1.1 * peak.frequency for peak in spectrum.peaks] if peaks else []
    top = max(1.35 * max(marked, default=0.0), *listed, 0.0)
    return min(float(spectrum.frequency[-1]), top) if marked else float(spectrum.frequency[-1])


def drawn_lines(lines: Sequence[ExpectedLine], blades: int, top: float) -> list[ExpectedLine]:
    """Modes, and 1P, N P and 2N P, below a frequency [Hz]."""
    return [line for line in lines if (line.mode or line.number in (1, blades, 2 * blades)) and line.frequency < top]


def density_unit(unit: str) -> str:
    """Unit of the spectral density of a channel."""
    if unit.startswith("as written"):
        return "unit²/Hz"
    return {"1": "1/Hz", "m": "m²/Hz", "rad": "rad²/Hz", "N": "N²/Hz", "W": "W²/Hz"}.get(
        unit, f"({unit_text(unit)})²/Hz"
    )


def gaps_of(i: "Inspection") -> list[Fault]:
    """Gaps of the record's time."""
    return [fault for fault in i.of("") if fault.kind == "gaps"]


def broken(time: Array, low: Array, high: Array, gaps: Sequence[Fault]) -> tuple[Array, Array, Array]:
    """Curve that is not drawn across gaps of the time."""
    if not gaps or time.size < 2:
        return time, low, high
    at = np.unique(np.searchsorted(time, np.concatenate([gap.spans for gap in gaps]).mean(axis=1)))
    at = at[(at > 0) & (at < time.size)]
    return np.insert(time, at, time[at]), np.insert(low, at, np.nan), np.insert(high, at, np.nan)


def unit_drawn(channel: str, unit: str) -> tuple[str, float]:
    """Unit in which a channel is drawn, and the factor from SI."""
    if unit == "rad/s" and not ("rotor" in channel and "speed" in channel):
        return "rad/s", 1.0
    if unit == "rad" and ("direction" in channel or "pitch" in channel or "yaw" in channel):
        return "°", 180.0 / np.pi
    if unit == "1" and "strain" in channel:
        return "10⁻⁶", 1e6
    return _DRAWN.get(unit, (shortened(unit_text(unit), MAX_UNIT_CHARACTERS), 1.0))


def some(spans: Array) -> Array:
    """At most `MAX_MARKS` of some spans (n, 2)."""
    return spans[:: -(-len(spans) // MAX_MARKS) or 1].reshape(-1, 2)

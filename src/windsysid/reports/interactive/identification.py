"""Interactive plots of an identification: spectra with the model, standardised innovations, loads and the record."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.identification.estimate.fitted.spectra import dense_places
from windsysid.inspection.spectra import seen_from
from windsysid.output.table import titled
from windsysid.records.record import Record
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve, ShadedRange, thinned
from windsysid.results.estimate import FittedSpectrum
from windsysid.results.identification import Estimate, Identification
from windsysid.results.posterior import SIGMAS
from windsysid.signals.textbook import short_spectra
from windsysid.units import engineering_unit, unit_text

__all__ = [
    "caption", "coefficient_plots", "compact_spectra", "history_plots", "innovation_plots", "load_plots",
    "record_plots", "spectra_plots", "whiteness_plots",
]  # fmt: skip

MAX_PLOTS = 12
"""Setting: channels of which a page has spectra."""

MAX_POINTS = 700
"""Setting: frequencies of a measured spectrum."""

BINS_PER_WIDTH = 2.0
"""Setting: bins of a measured spectrum within the half-power width of the narrowest mode, if the record is long
enough."""

MIN_AVERAGES = 4
"""Setting: smallest number of averaged periodograms, in disjoint segments."""

MAX_KEPT_BINS = 200
"""Setting: bins of a spectrum that a store keeps."""

MIN_AVERAGED_BINS, MAX_AVERAGED_POINTS = 5, 250
"""Setting: bins over which a periodogram in frequency ranges is averaged, and points that remain."""

WIDER = 1.6
"""So many times the widest band of what the file knows is shown; what is wider is cut off."""

HISTORY_POINTS = 700
"""Setting: largest number of points of a history."""

TIME, SIGMA, DENSITY = "time [s]", "[σ]", "PSD"


def spectra_plots(found: Identification, record: Record | None) -> list[Plot]:
    """Measured spectra with those of the fit and their 95 % intervals, one plot a channel; those in ranges or of
    several blades together where the fit is one of those."""
    fitted = {one.channel: one for one in found.spectra}
    recorded = {} if record is None else {name: record for name in found.sensors if name in record}
    plots = [_of_channel(found, of, name, fitted.get(name)) for name, of in recorded.items()]
    plots += [_of_combination(found, one) for name, one in fitted.items() if name not in recorded]
    return [plot for plot in plots if plot is not None][:MAX_PLOTS]


def compact_spectra(found: Identification, record: Record) -> list[Plot]:
    """Plots of `spectra_plots` averaged over at most `MAX_KEPT_BINS` bins, narrow where the model is steep."""
    return [_compact(plot) for plot in spectra_plots(found, record)]


def _compact(plot: Plot) -> Plot:
    x, model = np.asarray(plot.x), np.asarray(plot.curves[-1].values)
    known = np.isfinite(model)
    places = dense_places(x, np.interp(x, x[known], model[known])[:, None], MAX_KEPT_BINS)
    places[0] = 0
    counts = np.diff(places, append=len(x))

    def averaged(values: ArrayLike) -> Array:
        return np.asarray(np.add.reduceat(np.asarray(values, dtype=np.float64), places) / counts)

    curves = [
        replace(
            one, values=averaged(one.values), low=None if one.low is None else averaged(one.low),
            high=None if one.high is None else averaged(one.high),
        )
        for one in plot.curves
    ]  # fmt: skip
    return replace(plot, x=averaged(x), curves=curves)


def _of_channel(found: Identification, record: Record, name: str, fitted: FittedSpectrum | None) -> Plot | None:
    """Welch's spectrum of a channel, and the fit's."""
    measured = _welch(found, record, name)
    if measured is None:
        return None
    f, density = measured
    x, curves = f, []
    if fitted is not None:
        x = np.union1d(f[f <= 1.05 * fitted.frequency[-1]], fitted.frequency)
        x = np.union1d(x, f)
        curves.append(_model_curve(x, fitted))
    curves.insert(0, PlotCurve("measured", np.exp(np.interp(x, f, np.log(density))), colour="measured"))
    turning = bool(fitted and fitted.turning) or name.startswith("blade")
    unit = unit_text(record.unit(name))
    return _plot(found, name, x, curves, f"{DENSITY} [({unit})²/Hz]", fitted, turning=turning)


def _of_combination(found: Identification, fitted: FittedSpectrum) -> Plot | None:
    """The periodogram that the fit used, averaged, and the fit's spectrum."""
    if fitted.measured is None:
        return None
    size = max(MIN_AVERAGED_BINS, -(-len(fitted.frequency) // MAX_AVERAGED_POINTS))
    starts = np.arange(0, len(fitted.frequency), size)
    counts = np.diff(starts, append=len(fitted.frequency))
    middle, measured = (np.add.reduceat(v, starts) / counts for v in (fitted.frequency, fitted.measured))
    x = np.union1d(middle, fitted.frequency[:: max(1, len(fitted.frequency) // MAX_POINTS)])
    outside = np.isnan(_log_interpolated(x, fitted.frequency, fitted.density))
    values = np.where(outside, np.nan, np.exp(np.interp(x, middle, np.log(np.maximum(measured, 1e-300)))))
    curves = [PlotCurve("measured", values, colour="measured"), _model_curve(x, fitted)]
    return _plot(found, fitted.channel, x, curves, f"{DENSITY} [unit²/Hz]", fitted, turning=fitted.turning)


def _model_curve(x: Array, fitted: FittedSpectrum) -> PlotCurve:
    level = _log_interpolated(x, fitted.frequency, fitted.density)
    std = np.interp(x, fitted.frequency, np.where(np.isfinite(fitted.log_std), fitted.log_std, 0.0))
    low, high = (np.exp(level + sign * SIGMAS * std) for sign in (-1.0, 1.0))
    return PlotCurve("model", np.exp(level), low, high)


def _log_interpolated(x: Array, frequency: Array, density: Array) -> Array:
    """Logarithm of a spectrum at x, NaN outside of its ranges."""
    found = np.interp(x, frequency, np.log(density), left=np.nan, right=np.nan)
    for start, end in _gaps(frequency):
        found[(x > start) & (x < end)] = np.nan
    return found


def _gaps(frequency: Array) -> list[tuple[float, float]]:
    """Ranges in which a spectrum is not given: steps that are much longer than those on both sides."""
    steps = np.diff(frequency)
    if len(steps) < 3:
        return []
    around = np.minimum(np.r_[steps[0], steps[:-1]], np.r_[steps[1:], steps[-1]])
    wide = np.flatnonzero(steps > np.maximum(8.0 * around, 0.01 * frequency[-1]))
    return [(float(frequency[i]), float(frequency[i + 1])) for i in wide]


def _welch(found: Identification, record: Record, name: str) -> tuple[Array, Array] | None:
    """Welch's one-sided density of a channel at up to `MAX_POINTS` frequencies [Hz], whose resolution suits the
    narrowest mode; None where the channel has too few samples."""
    values = record[name] - np.nanmean(record[name]) if np.isfinite(record[name]).any() else record[name]
    values = np.nan_to_num(values)
    width = min((2.0 * m.damping_ratio.estimate * m.frequency.estimate for m in found.modes), default=math.inf)
    wanted = BINS_PER_WIDTH * record.rate / max(width, 1e-9)
    size = int(min(max(wanted, len(values) / 64.0), len(values) / MIN_AVERAGES))
    if size < 16:
        return None
    f, _, short = short_spectra(values, record.rate, size, size // 2)
    f, density = f[1:], short[1:].mean(axis=1)
    places = np.unique(np.geomspace(1, len(f), MAX_POINTS).astype(int)) - 1
    counts = np.diff(places, append=len(f))
    f, density = (np.add.reduceat(v, places) / counts for v in (f, density))
    return (f, density) if (density > 0.0).all() else None


def _plot(
    found: Identification, name: str, x: Array, curves: list[PlotCurve], label: str, fitted: FittedSpectrum | None, *,
    turning: bool,
) -> Plot:  # fmt: skip
    """One spectrum with marks and shaded ranges, from the lowest frequency to beyond the modes and harmonics."""
    marks, top = _marks(found, turning=turning), float(x[-1])
    reached = max((mark.at for mark in marks), default=top)
    limits = (float(x[0]), min(top, 1.4 * reached)) if reached > x[0] else None
    spans = []
    if fitted is not None and fitted.measured is not None:
        edges = [(0.0, float(fitted.frequency[0])), *_gaps(fitted.frequency), (float(fitted.frequency[-1]), top)]
        spans = [ShadedRange(start, end, "not used by the fit") for start, end in edges if end > start]
    frame = "rotating frame" if turning else "fixed frame"
    caption = frame if _turns(found) else ""
    return Plot(
        titled(name), x, curves, Axis("frequency [Hz]", limits=limits), Axis(label, log=True),
        marks=marks, spans=spans, caption=caption, link="frequency rotating" if turning else "frequency",
    )  # fmt: skip


def _turns(found: Identification) -> bool:
    return found.machine is not None and found.machine.rotor_speed > 0.0


def _marks(found: Identification, *, turning: bool) -> list[Mark]:
    """Modes with the grades of their frequencies, as they are seen from a frame, harmonics of the rotor and lines."""
    once = found.machine.rotor_speed / (2.0 * math.pi) if found.machine is not None else 0.0
    marks = [
        Mark(f, f"{name} ({m.frequency.grade})", "estimate", "modes")
        for m in found.modes for f, name in seen_from(m.name, m.frequency.estimate, once, turning)
    ]  # fmt: skip
    lines = [one for one in found.findings if "frequency" in one.data and "line" in one.code]
    marks += [Mark(float(one.data["frequency"]), "", "error", "lines left out") for one in lines]
    return marks + _harmonics(found, once, turning=turning)


def _harmonics(found: Identification, once: float, *, turning: bool) -> list[Mark]:
    """1P, 2P and 3P for blades; 1P and multiples of the blades for the support."""
    if found.machine is None or once <= 0.0:
        return []
    blades = found.machine.model.blades
    orders = (1, 2, 3) if turning else tuple(dict.fromkeys((1, blades, 2 * blades)))
    return [Mark(n * once, f"{n}P", "reference", "rotor harmonics") for n in orders if n]


def innovation_plots(found: Identification) -> list[Plot]:
    """Standardised innovations over time, one plot a reading."""
    if len(found.innovation_time) < 2:
        return []
    plots = []
    for row, name in enumerate(found.readings[:MAX_PLOTS]):
        time, low, high = thinned(found.innovation_time, found.whitened[:, row])
        curve = PlotCurve("prediction errors", 0.5 * (low + high), low, high, look="area", colour="measured")
        marks = [Mark(at, "", "reference", "95 %", across=True) for at in (-SIGMAS, SIGMAS)]
        plots.append(Plot(titled(name), time, [curve], Axis(TIME), Axis(SIGMA), marks, link="time"))
    return plots


def whiteness_plots(found: Identification) -> list[Plot]:
    """Spectra of standardised innovations, 1 for white noise, with the level above which a peak matters."""
    from windsysid.checks.limits import MAX_PEAK_LEVEL

    w, (low, high) = found.diagnosis.whiteness, found.diagnosis.reach
    if w is None or not len(w.frequency):
        return []
    bound, plots = max(MAX_PEAK_LEVEL, w.spectrum_bound), []
    marks = [Mark(1.0, "", "reference", "white noise", across=True), Mark(bound, "", "error", "limit", across=True)]
    spans = (
        [ShadedRange(low, min(high, float(w.frequency[-1])), "range of the modes", "estimate")] if high > low else []
    )
    for row, check in enumerate(w.channels[:MAX_PLOTS]):
        if not np.isfinite(w.spectrum[:, row]).any():
            continue
        f, _, level = thinned(w.frequency, w.spectrum[:, row], MAX_POINTS)
        plots.append(
            Plot(
                titled(check.name), f, [PlotCurve("prediction errors", level)],
                Axis("frequency [Hz]", log=bool(f[0] > 0.0)), Axis("spectrum [1]", log=True),
                [*marks, *_marks(found, turning=check.name.startswith("blade"))], spans, link="whitened",
            )
        )  # fmt: skip
    return plots


def record_plots(record: Record, channels: Sequence[str]) -> list[Plot]:
    """Time histories: the smallest and largest reading of each segment."""
    plots = []
    for name in channels[:MAX_PLOTS]:
        time, low, high = thinned(record.time, record[name])
        curve = PlotCurve("measured", 0.5 * (low + high), low, high, look="area", colour="measured")
        label = f"[{unit_text(record.unit(name))}]"
        plots.append(Plot(titled(name), time, [curve], Axis(TIME), Axis(label), link="time"))
    return plots


def load_plots(found: Identification) -> list[Plot]:
    """Loads as the filter estimated them, with ±2σ."""
    loads, plots = found.loads, []
    for name, mean, std in () if loads is None else zip(loads.names, loads.mean.T, loads.std.T, strict=True):
        step = max(1, -(-len(mean) // 1500))
        x, value, half = (v[::step] for v in (found.innovation_time, mean, SIGMAS * std))
        unit = "" if found.machine is None else found.machine.model.freedom(name).load_unit
        size, text = engineering_unit(unit, float(np.nanmax(np.abs(value))))
        curve = PlotCurve("load", value / size, (value - half) / size, (value + half) / size)
        plots.append(Plot(f"load on {titled(name)}", x, [curve], Axis(TIME), Axis(f"[{text}]"), link="time"))
    return plots


def caption(found: Identification) -> str:
    """Captions of the figures of the coefficients."""
    text = "95 % intervals of the result (blue) and of the prior (grey), as differences from the turbine file."
    if all(e.reference for e in found.estimates):
        return text
    return f"{text} *: the file has no value; the interval is drawn about the result."


def _prior_limits(found: Identification) -> dict[str, list[float]]:
    """Limits (±2σ) of the prior of each coefficient [SI]."""
    return {
        q.name: [float(q.physical(q.prior[0] + k * q.prior[1])) for k in (-SIGMAS, SIGMAS)] for q in found.parameters
    }


def _relative_values(e: Estimate, prior: Sequence[float]) -> list[float]:
    """Estimate, its limits and those of the prior, as differences from the turbine file [%], from the result where the
    file has no value."""
    base = e.reference or e.estimate or 1.0
    return [100.0 * (x / base - 1.0) for x in (e.estimate, e.low, e.high, *prior)]


def coefficient_plots(found: Identification, caption: str) -> list[Plot]:
    """Coefficients with their intervals and those of the prior, as differences from the turbine file [%]; stiffness and
    damping apart, as damping is known far less."""
    groups = [[e for e in found.estimates if e.kind == kind] for kind in ("stiffness", "damping", "parameter")]
    return [_coefficient_plot(group, _prior_limits(found), caption) for group in groups if group]


def _coefficient_plot(group: Sequence[Estimate], priors: dict[str, list[float]], caption: str) -> Plot:
    """Coefficients of one kind."""
    value, low, high, before, after = np.array([_relative_values(e, priors[e.name]) for e in group]).T
    known = np.array([bool(e.reference) for e in group])
    some = bool(known.any())
    half = WIDER * float(max(np.abs([low, high])[:, known if some else ~known].max(), 1e-3))
    curves = [
        PlotCurve("prior", 0.5 * (before + after), before, after, "bars", "measured"),
        PlotCurve("result", value, low, high, "dots"),
    ]
    names = [f"{e.name} *" if some and not e.reference else e.name for e in group]
    y_axis = Axis(f"difference from the {'turbine file' if some else 'result'} [%]", limits=(-half, half))
    at, across = np.arange(len(group)), [Mark(0.0, across=True)]
    return Plot(group[0].kind, at, curves, Axis("", names=names), y_axis, marks=across, caption=caption)


def history_plots(found: Identification) -> list[Plot]:
    """Estimates after each sample with ±2σ, the result of the whole record at the end, and the value of the file."""
    plots, every = [], slice(None, None, -(-len(found.time) // HISTORY_POINTS))
    time = np.append(found.time[every], found.time[-1])
    for e in found.estimates:
        size, unit = engineering_unit(e.unit, e.estimate)
        middle, low, high = (np.append(values[every], np.nan) / size for values in found.history(e.name))
        ends = [value / size for value in (e.estimate, e.low, e.high)]
        result, below, above = (np.where(np.isnan(middle), value, np.nan) for value in ends)
        late, known = slice(len(time) // 8, None), [] if e.reference is None else [e.reference / size]
        shown = [*low[late], *high[late], *ends, *known]
        least, most = np.nanmin(shown), np.nanmax(shown)
        limits = least - 0.2 * (most - least), most + 0.2 * (most - least)
        curves = [
            PlotCurve("on-line estimate", middle, low, high),
            PlotCurve("result", result, below, above, "dots", "reference"),
        ]
        marks = [Mark(value, "turbine file", across=True) for value in known]
        label = f"[{unit}]" if e.unit else ""
        plots.append(Plot(e.name, time, curves, Axis(TIME), Axis(label, limits=limits), marks, link="time"))
    return plots

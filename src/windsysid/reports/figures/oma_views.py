"""Plots of modes as users of operational modal analysis know them: singular values, poles, segments, shapes."""

from collections.abc import Sequence

import numpy as np

from windsysid.modal.shapes import along_axis, assurance
from windsysid.output.table import Table, titled
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve, ShadedRange, shortened
from windsysid.spectral.oma.mode import OperationalMode
from windsysid.spectral.oma.result import DecayHistory, OperationalModes, RecordModes

__all__ = ["assurance_table", "band_plots", "decay_plot", "poles_plots", "segment_plots", "setup_table", "shape_plots",
    "shape_table", "singular_value_plot"]  # fmt: skip

MAX_MODES, MAX_SHAPES = 12, 24
"""Setting: modes of the plots over segments, and of those of shapes."""

STABLE_FREQUENCY, STABLE_DAMPING = 0.01, 0.2
"""Setting: relative change from one model order to the next up to which a pole counts as stable: usual values in
stabilisation diagrams."""

MAX_BAND_PLOTS = 24
"""Setting: bands of which a page has spectra."""


def singular_value_plot(found: OperationalModes) -> Plot:
    """Singular values over frequency, with the modes, their bands and the lines that were removed."""
    top = 1.3 * max((mode.band[1] for mode in found.modes), default=float(found.frequency[-1]))
    shown = (found.frequency > 0.0) & (found.frequency <= top)
    shown[int(np.argmax(shown))] = True
    power = 10.0 * np.log10(np.maximum(found.singular_values[shown], 1e-30))
    names = ("first", "second", "third", "fourth", "fifth", "sixth")
    curves = [
        PlotCurve(f"{name} singular value", values, colour="estimate" if i == 0 else "measured")
        for i, (name, values) in enumerate(zip(names, power.T, strict=False))
    ]
    modes = _marks(found.modes)
    lines = [Mark(f, name, "other", "removed lines") for name, f in found.lines if f <= top]
    return Plot(
        "Singular values of the spectral matrix", found.frequency[shown], curves, Axis("frequency [Hz]"),
        Axis("singular value [dB]"), [*modes, *lines],
        [ShadedRange(*mode.band, group="ranges of the fit") for mode in found.modes],
        "channels scaled to the same median; modes are marked (grade C in another colour); shaded: ranges of the fit",
        "frequency",
    )  # fmt: skip


def band_plots(found: OperationalModes) -> list[Plot]:
    """Spectra of the readings and of the model in the bands of the modes."""
    plots = []
    for band in found.bands[:MAX_BAND_PLOTS]:
        inside = [mode for mode in found.modes if band.frequency[0] <= mode.frequency.estimate <= band.frequency[-1]]
        marks = _marks(inside)
        curves = [
            PlotCurve("measured", band.measured, look="dots", colour="measured"),
            PlotCurve("model", band.fitted),
        ]
        title = ", ".join(mode.name for mode in inside)[:60] or "band"
        axes = Axis("frequency [Hz]"), Axis("PSD, sum of scaled channels", log=True)
        plots.append(Plot(title, band.frequency, curves, *axes, marks))
    return plots


def poles_plots(found: OperationalModes) -> list[Plot]:
    """Modes of fits with 1, 2, … modes in each band, as a stabilisation diagram, and their damping ratios."""
    poles = []
    for band in found.bands:
        before: list[tuple[float, float]] = []
        for order, (f, z) in enumerate(band.poles, 1):
            now = list(zip(f.tolist(), z.tolist(), strict=True))
            poles += [(g, order, 100.0 * y, _is_stable((g, y), before)) for g, y in now]
            before = now
    if not poles:
        return []
    frequency, order, damping, stable = np.array(sorted(poles)).T
    fitted = "each frequency range fitted with one mode, two and so on"
    shown = (
        ("Modes over the model order", order, Axis("modes in the range", limits=(0.5, order.max() + 1.0)),
        f"{fitted}; the evidence chooses how many are kept"),
        ("Damping ratio over frequency", damping, Axis("damping ratio [%]"), f"{fitted}: a mode is a cluster"),
    )  # fmt: skip
    return [
        Plot(
            title, frequency,
            [PlotCurve("stable: 1 % in f, 20 % in ζ", np.where(stable > 0, of, np.nan), look="dots"),
            PlotCurve("new or changed", np.where(stable > 0, np.nan, of), look="dots", colour="measured")],
            Axis("frequency [Hz]", limits=(0.0, 1.08 * float(frequency[-1]))), y_axis, _marks(found.modes),
            caption=caption, link="frequency",
        )
        for title, of, y_axis, caption in shown
    ]  # fmt: skip


def _is_stable(pole: tuple[float, float], before: list[tuple[float, float]]) -> bool:
    f, z = pole
    return any(abs(g / f - 1.0) < STABLE_FREQUENCY and abs(y / z - 1.0) < STABLE_DAMPING for g, y in before)


def segment_plots(found: OperationalModes) -> list[Plot]:
    """Frequency and damping ratio of each mode in segments of the record, relative to those of the whole."""
    modes = [mode for mode in found.modes if mode.segments is not None][:MAX_MODES]
    if not modes:
        return []
    times = np.unique(np.concatenate([mode.segments[:, 0] for mode in modes if mode.segments is not None]))
    colours = ("estimate", "error", "reference", "other", "measured")
    plots = []
    for title, column, unit in (("Frequency", 1, "%"), ("Damping ratio", 2, "%")):
        curves = [
            PlotCurve(mode.name, _relative(mode, times, column), look="dots", colour=colours[i % len(colours)])
            for i, mode in enumerate(modes)
        ]
        plots.append(
            Plot(
                f"{title} in segments of the record", times, curves, Axis("time [s]"), Axis(f"difference [{unit}]"),
                [Mark(0.0, across=True)], caption="from the whole record, by one Newton step for each segment",
                link="segments",
            )
        )  # fmt: skip
    return plots


def _marks(modes: Sequence[OperationalMode]) -> list[Mark]:
    """Vertical lines at the frequencies of some modes."""
    return [Mark(m.frequency.estimate, m.name, "estimate" if m.trusted else "error", "modes") for m in modes]


def _relative(mode: OperationalMode, times: np.ndarray, column: int) -> np.ndarray:
    values = np.full(len(times), np.nan)
    if mode.segments is not None:
        whole = (mode.frequency.estimate, mode.damping_ratio.estimate)[column - 1]
        values[np.searchsorted(times, mode.segments[:, 0])] = 100.0 * (mode.segments[:, column] / whole - 1.0)
    return values


def decay_plot(one: DecayHistory) -> Plot:
    """Readings of a free decay with the fit and the residual."""
    curves = [
        PlotCurve("readings", one.measured, colour="measured"),
        PlotCurve("fit", one.fitted, colour="estimate"),
        PlotCurve("residual", one.measured - one.fitted, colour="error"),
    ]
    caption = "from where the motion is taken as free; the channel that decays most clearly"
    title = f"{shortened(titled(one.channel))}, {shortened(one.record)}"
    return Plot(title, one.time, curves, Axis("time [s]"), Axis("[unit of the channel]"), caption=caption)


def shape_table(found: OperationalModes) -> Table:
    """Measures of each shape: MPC, MPD, complexity, and its standard deviation."""
    rows = [
        (
            mode.name, f"{mode.frequency.estimate:.4g}", "–" if np.isnan(mode.mpc) else f"{mode.mpc:.3f}",
            f"{np.degrees(mode.mpd):.1f}", f"{100.0 * mode.complexity:.1f}",
            f"{float(np.sqrt(np.mean(mode.shape_std**2))):.2g}",
        )
        for mode in found.modes
    ]  # fmt: skip
    return Table(
        ("mode", "f [Hz]", "MPC", "MPD [°]", "out of phase [%]", "σ of the shape"), rows, "measures of the shapes", (0,)
    )


def assurance_table(found: OperationalModes) -> Table:
    """Modal assurance criterion of each pair of modes."""
    rows = [
        (mode.name, *("–" if np.isnan(value) else f"{value:.2f}" for value in row))
        for mode, row in zip(found.modes, found.mac(), strict=True)
    ]
    return Table(("MAC", *(mode.name for mode in found.modes)), rows, "modal assurance criterion", (0,))


def setup_table(found: OperationalModes) -> Table:
    """Channels of each record, those in common with others, and the agreement of each mode's shape there (MAC)."""
    rows = []
    for part in found.parts:
        others = {name for other in found.parts if other is not part for name in other.channels}
        common = sum(name in others for name in part.channels)
        cells = [_agreement(found, part, i) for i in range(len(found.modes))]
        rows.append((part.record, f"{len(part.channels)}, {common} in common", *cells))
    return Table(("record", "channels", *(f"{m.name}, MAC" for m in found.modes)), rows, "", (0, 1))


def _agreement(found: OperationalModes, part: RecordModes, i: int) -> str:
    """MAC of mode i in one record with the merged shape."""
    own = part.modes[i]
    if own is None:
        return "not seen"
    shape = dict(zip(part.channels, own.shape, strict=True))
    value = assurance(np.array([shape.get(name, np.nan) for name in found.channels]), found.modes[i].shape)
    return "–" if np.isnan(value) else f"{value:.3f}"


def shape_plots(found: OperationalModes) -> list[Plot]:
    """Shape of each mode, by channel: parts in phase and out of phase with 95 % intervals."""
    at, plots = np.arange(len(found.channels)), []
    axes = Axis("", names=[shortened(name) for name in found.channels]), Axis("shape", limits=(-1.3, 1.3))
    for mode in found.modes[:MAX_SHAPES]:
        turned, reach = along_axis(mode.shape), 2.0 * mode.shape_std
        curves = [
            PlotCurve(name, part, part - reach, part + reach, "dots", colour)
            for name, part, colour in (
                ("in phase", turned.real, "estimate"), ("out of phase", turned.imag, "measured"),
            )
        ]  # fmt: skip
        title = f"{mode.name}, {mode.frequency.estimate:.4g} Hz"
        plots.append(Plot(title, at, curves, *axes, [Mark(0.0, across=True)], link="shapes"))
    return plots

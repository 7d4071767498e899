"""The inspection as one page."""

from typing import TYPE_CHECKING

import numpy as np

from windsysid.reports.figures.drawing import drawn
from windsysid.reports.figures.inspection_figures import (
    channels_drawn,
    density_unit,
    drawn_lines,
    highest_drawn,
    history_plots,
    spectrogram_figure,
)
from windsysid.reports.html import Section, png, report_page
from windsysid.reports.interactive.plot import Axis, Mark, Plot, PlotCurve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from windsysid.inspection.inspection import Inspection

__all__ = ["figure", "files"]

MAX_POINTS = 2000
"""Setting: frequencies of a spectrum on the page; of neighbours the largest value is shown."""

NAMES = ("rotor harmonics", "expected modes")

LEGEND = (
    "Orange: faults; blue: the proposed sections; dashed: the rotor stops and starts. Every spike is drawn: each pixel"
    " shows the least and the greatest value in it."
)


def figure(inspection: "Inspection", place: "Axes | None" = None) -> "Figure":
    """Draw the channels over time with faults, proposed sections and stops of the rotor."""
    return drawn(history_plots(inspection), place)


def files(inspection: "Inspection") -> dict[str, bytes]:
    """``report.html``, ``inspection.json``, and the figures that exist (overview, spectra, spectrogram), by name."""
    i, plots = inspection, _spectra_plots(inspection)
    figures = {
        "overview": figure(i),
        "spectra": drawn(plots) if plots else None,
        "spectrogram": spectrogram_figure(i),
    }
    pictures = {name: png(one) for name, one in figures.items() if one is not None}
    sections = [
        Section("What was found", text=[f"{i.verdict[0].upper()}{i.verdict[1:]}.", *_findings(i), *i.notes]),
        Section(
            "Which part to use",
            text=[*_proposals(i), _overview_caption(i)],
            tables=[i.stops_table()] if i.stops else [],
            plots=history_plots(i),
        ),
        *_vibration(i, pictures),
    ]
    return {
        "report.html": report_page("Inspection of a record", i.heading(), sections),
        "inspection.json": i.to_json().encode(),
        **{f"{name}.png": picture for name, picture in pictures.items()},
    }


def _proposals(i: "Inspection") -> list[str]:
    """The proposed sections, one paragraph each."""
    listed = [
        f"{n}. {p.start:g}–{p.end:g} s, {'good' if p.good else 'poor'}: {p}." for n, p in enumerate(i.proposals, 1)
    ]
    return listed if any(p.good for p in i.proposals) else ["WARNING: no section of this record is good.", *listed]


def _vibration(i: "Inspection", pictures: dict[str, bytes]) -> list[Section]:
    """Channels that vibrate, if there are spectra."""
    if not i.spectra:
        return []
    peaks = i.peaks_table(most_channels=12)
    text = [*([_mode_text(i)] if i.modes else []), _spectra_caption(i)]
    sections = [Section("What vibrates", text=text, tables=[peaks] if peaks.rows else [], plots=_spectra_plots(i))]
    pictured = _with(pictures.get("spectrogram"), _spectrogram_caption(i))
    return [*sections, Section("Spectra over the record", figures=pictured)] if pictured else sections


def _spectra_plots(i: "Inspection") -> list[Plot]:
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
        title = spectrum.channel.replace("_", " ")
        plots.append(Plot(title, f[::size], [curve], *axes, marks=marks, link="frequency"))
    return plots


def _findings(i: "Inspection") -> list[str]:
    """One paragraph each; those that need action are set off by the page's style."""
    return [
        (f"WARNING, {severity}: " if severity == "unusable" else "WARNING: " if severity == "warning" else "Note: ")
        + f"{channels}: {text}."
        for channels, severity, text in i.finding_rows()
    ]


def _with(picture: bytes | None, caption: str) -> list[tuple[bytes, str]]:
    return [] if picture is None else [(picture, caption)]


def _overview_caption(i: "Inspection") -> str:
    shown = len(i.shown())
    more = len(i.record.channels) - shown
    return LEGEND + (f" {more} more channels are not drawn." if more > 0 else "")


def _spectra_caption(i: "Inspection") -> str:
    n = i.blades
    turns = any(not line.mode for spectrum in i.spectra for line in spectrum.lines)
    harmonics = f" Dotted: 1P, {n}P and {2 * n}P of the rotor." if turns else ""
    more = len(i.spectra) - 12
    return (
        f"Power spectral densities (Welch), resolution {i.spectra[0].resolution:.2g} Hz.{harmonics}"
        + (f" {more} more channels are in inspection.json only." if more > 0 else "")
    )  # fmt: skip


def _spectrogram_caption(i: "Inspection") -> str:
    if i.spectrograms and i.spectrograms[0].against == "rotor speed":
        return (
            "Frequency over rotor speed: a harmonic of the rotor rises with the speed, a mode of the structure stays or"
            " splits. Grey: the rotor never turned at that speed."
        )
    return "Frequency over time: the rotor speed does not vary, or is not known."


def _mode_text(i: "Inspection") -> str:
    listed = ", ".join(f"{name} {frequency:.4g} Hz" for name, frequency, _ in i.modes)
    return (
        f"Modes that the values of {i.turbine} give, in the fixed frame: {listed}. They are references: a peak near one"
        " may be it. An instrument that turns with the rotor sees them shifted by 1P."
    )

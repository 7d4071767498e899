"""The inspection as one page."""

from typing import TYPE_CHECKING

from windsysid.reports.html import Section, report_page
from windsysid.reports.interactive.inspection import overview_plots, spectra_plots, spectrogram_plots

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from windsysid.inspection.inspection import Inspection

__all__ = ["figure", "files"]

LEGEND = (
    "Faults are orange, the best section is blue, other good ones are green; dashed lines are where the rotor stops and"
    " starts. Every spike is drawn: the smallest and the largest reading of each segment of time."
)


def figure(inspection: "Inspection", place: "Axes | None" = None) -> "Figure":
    """Draw the channels over time with faults, proposed sections and stops of the rotor."""
    from windsysid.reports.figures.drawing import drawn

    return drawn(overview_plots(inspection), place)


def files(inspection: "Inspection") -> dict[str, bytes]:
    """``report.html`` and ``inspection.json``, by name."""
    i = inspection
    sections = [
        Section("What was found", text=[f"{i.verdict[0].upper()}{i.verdict[1:]}.", *_findings(i), *i.notes]),
        Section(
            "Which part to use",
            text=[*_proposals(i), _overview_caption(i)],
            tables=[i.stops_table()] if i.stops else [],
            plots=overview_plots(i),
        ),
        *_vibration(i),
    ]
    page = report_page("Inspection of a record", i.heading(), sections)
    return {"report.html": page, "inspection.json": i.to_json().encode()}


def _proposals(i: "Inspection") -> list[str]:
    """The proposed sections, one paragraph each."""
    listed = [
        f"{n}. {p.start:g}–{p.end:g} s, {'good' if p.good else 'poor'}: {p}." for n, p in enumerate(i.proposals, 1)
    ]
    return listed if any(p.good for p in i.proposals) else ["WARNING: no section of this record is good.", *listed]


def _vibration(i: "Inspection") -> list[Section]:
    """Channels that vibrate, if there are spectra."""
    if not i.spectra:
        return []
    peaks = i.peaks_table(most_channels=12)
    text = [*([_mode_text(i)] if i.modes else []), _spectra_caption(i)]
    sections = [Section("What vibrates", text=text, tables=[peaks] if peaks.rows else [], plots=spectra_plots(i))]
    plots = spectrogram_plots(i)
    over = Section("Spectra over the record", text=[_spectrogram_caption(i)], plots=plots)
    return [*sections, over] if plots else sections


def _findings(i: "Inspection") -> list[str]:
    """One paragraph each; those that need action are set off by the page's style."""
    return [
        (f"WARNING, {severity}: " if severity == "unusable" else "WARNING: " if severity == "warning" else "Note: ")
        + f"{channels}: {text}."
        for channels, severity, text in i.finding_rows()
    ]


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
            " splits. Blank: little vibration, or the rotor never turned at that speed."
        )
    return "Frequency over time: the rotor speed does not vary, or is not known."


def _mode_text(i: "Inspection") -> str:
    listed = ", ".join(f"{name} {frequency:.4g} Hz" for name, frequency, _ in i.modes)
    return (
        f"Modes that the values of {i.turbine} give, in the fixed frame: {listed}. They are references: a peak near one"
        " may be it. An instrument that turns with the rotor sees them shifted by 1P."
    )

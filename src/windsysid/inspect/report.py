"""The inspection as one page."""

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from windsysid.inspect.inspection import STOPS_TITLE
from windsysid.report import Section, Table, write_report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from windsysid.inspect.inspection import Inspection

__all__ = ["write_inspection"]

LEGEND = (
    "Faults are orange; blue are the proposed sections, numbered, the best one darker; dashed lines are where the rotor stops and starts. Every spike is drawn: each pixel "
    "shows the least and the greatest value in it."
)


def write_inspection(inspection: "Inspection", folder: Path) -> None:
    """Write ``report.html`` and ``overview.png``, ``spectra.png``, ``spectrogram.png``."""
    i = inspection
    figures = {"overview": i.overview(), "spectra": i.plot_spectra(), "spectrogram": i.plot_spectrograms()}
    pictures = {name: None if figure is None else _Picture(figure) for name, figure in figures.items()}
    good = sum(p.good for p in i.proposals)
    sections = [
        Section("What was found", text=[f"{i.verdict[0].upper()}{i.verdict[1:]}.", *_findings(i), *i.notes]),
        Section(
            "Which part to use",
            text=[
                *([] if good else ["WARNING: no section of this record is good."]),
                *(
                    f"{n}. {p.start:g}–{p.end:g} s, {'good' if p.good else 'poor'}: {p}."
                    for n, p in enumerate(i.proposals, 1)
                ),
            ],
            tables=[Table(("section [s]", "why"), i.stop_rows(), STOPS_TITLE, (0, 1))] if i.stops else [],
            figures=_with(pictures["overview"], _overview_caption(i)),
        ),
    ]
    if i.spectra:
        peaks = i.peak_rows(most_channels=12)
        sections.append(
            Section(
                "What vibrates",
                text=[_mode_text(i)] if i.modes else [],
                tables=[Table(("channel", "frequency [Hz]", "rms", "what it may be"), peaks, "Spectral peaks", (0, 3))] if peaks else [],
                figures=[*_with(pictures["spectra"], _spectra_caption(i)), *_with(pictures["spectrogram"], _spectrogram_caption(i))],
            )
        )  # fmt: skip
    write_report(folder / "report.html", "Inspection of a record", i.heading(), sections)
    for name, picture in pictures.items():
        if picture is not None:
            (folder / f"{name}.png").write_bytes(picture.png)


class _Picture:
    """A figure that is drawn once, for the page and for its own file: drawing is what takes the time."""

    def __init__(self, figure: "Figure"):
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", dpi=110)
        self.png = buffer.getvalue()

    def savefig(self, target: io.BytesIO, **_: Any) -> None:
        target.write(self.png)


def _findings(i: "Inspection") -> list[str]:
    """One paragraph each; what needs a hand is set off by the page's style."""
    return [
        (f"WARNING, {severity}: " if severity == "unusable" else "WARNING: " if severity == "warning" else "Note: ")
        + f"{channels}: {text}."
        for channels, severity, text in i.finding_rows()
    ]


def _with(picture: _Picture | None, caption: str) -> "list[tuple[Figure, str]]":
    return [] if picture is None else [(cast("Figure", picture), caption)]


def _overview_caption(i: "Inspection") -> str:
    shown = len(i.shown())
    more = len(i.record.channels) - shown
    return LEGEND + (f" {more} more channels are not drawn." if more > 0 else "")


def _spectra_caption(i: "Inspection") -> str:
    n = i.blades
    harmonics = f" Dotted: 1P, {n}P and {2 * n}P of the rotor." if i.rotor is not None and i.rotor.turns else ""
    more = len(i.spectra) - 12
    return (
        f"Power spectral densities (Welch), resolution {i.spectra[0].resolution:.2g} Hz.{harmonics}"
        + (f" {more} more channels are in inspection.json only." if more > 0 else "")
    )  # fmt: skip


def _spectrogram_caption(i: "Inspection") -> str:
    if i.spectrograms and i.spectrograms[0].against == "rotor speed":
        return "Frequency over rotor speed: a harmonic of the rotor rises with the speed, a mode of the structure stays or splits. Grey: the rotor never turned at that speed."
    return "Frequency over time: the rotor speed does not vary, or is not known."


def _mode_text(i: "Inspection") -> str:
    listed = ", ".join(f"{name} {frequency:.4g} Hz" for name, frequency, _ in i.modes)
    return (
        f"Modes that the values of {i.turbine} give, in the fixed frame: {listed}. They are references: a peak near one may be it. "
        "An instrument that turns with the rotor sees them shifted by 1P."
    )

"""Result of an inspection: faults, vibration, section to use; as text, figures and files."""

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from windsysid.inspection.channels import kinds, most_telling
from windsysid.inspection.fault import SEVERITIES, Fault
from windsysid.inspection.rotor import Rotor
from windsysid.inspection.sections import Proposal
from windsysid.inspection.spectra import Spectrogram, Spectrum
from windsysid.inspection.stops import Stop
from windsysid.output.answers import SummarisedAnswer
from windsysid.output.table import Table, axes_of
from windsysid.records.record import Record
from windsysid.units import RPM, unit_text

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["STOPS_TITLE", "Inspection"]

STOPS_TITLE = "Stops of the rotor: sections for structural damping"


@dataclass(frozen=True, eq=False, repr=False)
class Inspection(SummarisedAnswer):
    """Result of `windsysid.inspect`: faults, spectra and proposed sections of a record.

    Attributes
    ----------
    record
        The record itself.
    turbine
        Name of the turbine whose modes are marked; None without one.
    findings
        Faults, the worst first.
    rotor
        Rotor speed over time; None where it is not in the record.
    blades
        Number of blades N, for NP and 2NP.
    modes
        Expected modes at the record's mean rotor speed: name, frequency [Hz], damping ratio; fixed frame.
    modes_over_speed
        Expected modes at rotor speeds [rad/s] over the record's range; empty where the speed does not vary.
    spectra
        One per vibration channel.
    spectrograms
        Spectrograms of the one or two most informative channels.
    proposals
        Sections, best first.
    stops
        Stops of the rotor, after which vibration decays without the aerodynamic damping of a turning rotor.
    notes
        Parts of the inspection that were not possible, and why.
    first
        Channels to show before others.
    """

    record: Record
    turbine: str | None
    findings: tuple[Fault, ...]
    rotor: Rotor | None
    blades: int
    modes: tuple[tuple[str, float, float], ...]
    modes_over_speed: tuple[tuple[float, tuple[tuple[str, float, float], ...]], ...]
    spectra: tuple[Spectrum, ...]
    spectrograms: tuple[Spectrogram, ...]
    proposals: tuple[Proposal, ...]
    stops: tuple[Stop, ...]
    notes: tuple[str, ...]
    first: tuple[str, ...] = ()

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each finding, the worst first: ``channel``, ``kind``, ``severity``, ``text``, and ``count``, the
        samples or gaps concerned."""
        import pandas as pd

        rows = [(f.channel, f.kind, f.severity, f.text, f.count) for f in self.findings]
        return pd.DataFrame(rows, columns=["channel", "kind", "severity", "text", "count"])

    @property
    def verdict(self) -> str:
        """Usability of this record, and the section to use, in one line."""
        good = [p for p in self.proposals if p.good]
        units = any(f.kind == "unit" and f.severity == "warning" for f in self.findings)
        use = "correct units first, then use" if units else "use"
        if good and good[0].end - good[0].start >= self.record.duration:
            return f"{self._counts}; {use} all of it"
        if good:
            return f"{self._counts}; {use} {good[0].start:g}–{good[0].end:g} s"
        against = ": " + "; ".join(self.proposals[0].against) if self.proposals else ""
        return f"{self._counts}; no section is good{against}"

    @property
    def _counts(self) -> str:
        """Number of findings of each severity."""
        counts = Counter(f.severity for f in self.findings)
        words = {severity: severity + "s" * (counts[severity] != 1) for severity in SEVERITIES} | {
            "unusable": "unusable"
        }
        listed = [f"{counts[severity]} {words[severity]}" for severity in SEVERITIES if counts[severity]]
        return ", ".join(listed) or "no faults found"

    def of(self, channel: str) -> tuple[Fault, ...]:
        """The findings on one channel; ``""`` for those on the whole record."""
        return tuple(finding for finding in self.findings if finding.channel == channel)

    def summary(self) -> dict[str, Any]:
        """Inspection as plain values: the content of ``inspection.json``."""
        r = self.record
        speed = None
        if self.rotor is not None:
            speed = {
                "source": self.rotor.source,
                "mean_rad_s": self.rotor.mean,
                "relative_standard_deviation": self.rotor.variation,
            }
        return {
            "record": r.name,
            "turbine": self.turbine,
            "verdict": self.verdict,
            "start_s": float(r.time[0]),
            "duration_s": r.duration,
            "rate_hz": r.rate,
            "samples": r.samples,
            "channels": dict(zip(r.channels, r.units, strict=True)),
            "rotor_speed": speed,
            "blades": self.blades,
            "findings": [finding.summary() for finding in self.findings],
            "expected_modes": [
                {"name": name, "frequency_hz": frequency, "damping_ratio": damping}
                for name, frequency, damping in self.modes
            ],
            "spectra": [spectrum.summary() for spectrum in self.spectra],
            "sections": [proposal.summary() for proposal in self.proposals],
            "stops": [stop.summary() for stop in self.stops],
            "notes": list(self.notes),
        }

    def table(self) -> Table:
        """The findings."""
        return Table(("channel", "severity", "finding"), self.finding_rows(), "What is wrong", words=(0, 1, 2))

    def sections_table(self) -> Table:
        """The proposed sections."""
        headings = ("section [s]", "verdict", "why")
        return Table(headings, self.section_rows(), self.sections_title, words=(0, 1, 2))

    def stops_table(self) -> Table:
        """Stops of the rotor."""
        return Table(("section [s]", "why"), self.stop_rows(), STOPS_TITLE, words=(0, 1))

    def peaks_table(self, most_channels: int = 6) -> Table:
        """Spectral peaks of the most telling channels, `most_channels` at most."""
        headings = ("channel", "frequency [Hz]", "rms", "what it may be")
        shown = [spectrum.channel for spectrum in self.spectra[:most_channels]]
        return Table(headings, self.peak_rows(most_channels), f"Spectral peaks{axes_of(shown)}", words=(0, 3))

    @property
    def sections_title(self) -> str:
        """Heading over the proposals."""
        if any(p.good for p in self.proposals):
            return "Sections to use, best first"
        return "No section is good; the best of them" if self.proposals else "No section can be proposed"

    def shown(self, most: int = 12) -> list[str]:
        """Channels that a figure shows: rotor and wind, those with warnings, then the most telling."""
        known = kinds(self.record)
        driving = ("rotor speed", "wind speed", "direction", "power")
        operating = sorted(
            (name for name in self.record.channels if known[name] in driving),
            key=lambda name: driving.index(known[name]),
        )
        faulty, broken = (
            [f.channel for f in self.findings if f.channel and f.severity == severity]
            for severity in ("warning", "unusable")
        )
        telling = [name for name in most_telling(self.record, self.first) if name not in broken]
        return list(dict.fromkeys([*operating[:4], *faulty, *telling, *broken, *self.record.channels]))[:most]

    def finding_rows(self) -> list[tuple[str, str, str]]:
        """Channel, severity, text; channels of which the same is said share a row."""
        groups: dict[tuple[str, str], list[str]] = {}
        for finding in self.findings:
            groups.setdefault((finding.severity, finding.text), []).append(finding.channel or "whole record")
        return [(", ".join(names), severity, text) for (severity, text), names in groups.items()]

    def section_rows(self) -> list[tuple[str, str, str]]:
        """Section, verdict, reasons."""
        return [(f"{p.start:g}–{p.end:g}", "good" if p.good else "poor", str(p)) for p in self.proposals]

    def stop_rows(self) -> list[tuple[str, str]]:
        """Section after each stop, and how the rotor stopped."""
        return [(f"{stop.start:g}–{stop.end:g}", str(stop)) for stop in self.stops]

    def peak_rows(self, most_channels: int = 1000) -> list[tuple[str, str, str, str]]:
        """Channel, frequency, rms, and likely cause of every peak of the first `most_channels` channels."""
        return [
            (
                spectrum.channel if i == 0 else "",
                f"{peak.frequency:.4g}",
                f"{peak.rms:.3g} {unit_text(spectrum.unit)}".removesuffix(" 1"),
                " or ".join(peak.matches[:3]) or "–",
            )
            for spectrum in self.spectra[:most_channels]
            for i, peak in enumerate(spectrum.peaks)
        ]

    def heading(self) -> str:
        """One line on the record."""
        r = self.record
        speed = "no rotor speed"
        if self.rotor is not None:
            rpm = self.rotor.mean * RPM
            varies = f" ± {100.0 * self.rotor.variation:.2g} %" if self.rotor.variation > 1e-6 else ""
            speed = f"rotor at {rpm:.4g} rpm{varies}"
        return (
            f"{r.name}: {r.samples} samples at {r.rate:.6g} Hz, {r.duration:.6g} s, {len(r.channels)} channels, {speed}"
        )

    def contents(self) -> list[Table | str]:
        """Verdict, faults, sections to use, vibration, notes."""
        parts: list[Table | str] = [self.heading(), f"Verdict: {self.verdict}", ""]
        if self.findings:
            parts += [self.table(), ""]
        if self.proposals:
            parts += [self.sections_table(), ""]
        if self.stops:
            parts += [self.stops_table(), ""]
        if any(spectrum.peaks for spectrum in self.spectra):
            parts.append(self.peaks_table())
        if self.modes:
            listed = ", ".join(f"{name} {frequency:.4g} Hz" for name, frequency, _ in self.modes)
            parts.append(f"Expected modes of {self.turbine} at this speed, fixed frame: {listed}")
        return [*parts, *self.notes]

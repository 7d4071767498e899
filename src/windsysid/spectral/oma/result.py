"""Result of operational modal analysis: modes with their intervals, shapes and reasons for doubt."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.modal.matching.result import odds_text
from windsysid.modal.shapes import assurance_matrix
from windsysid.output.answers import SummarisedAnswer
from windsysid.output.table import Table
from windsysid.results.finding import Finding
from windsysid.results.posterior import section_name
from windsysid.spectral.oma.mode import OperationalMode
from windsysid.spectral.oma.sensors import ModalSensor, Node
from windsysid.units import unit_text

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ANALYSIS", "BandSpectrum", "DecayHistory", "OperationalModes", "RecordModes"]

ANALYSIS = "operational modes"
"""Kind of analysis in ``summary.json``."""


@dataclass(frozen=True)
class RecordModes:
    """Modes of one of several records that were analysed jointly.

    Attributes
    ----------
    record, start, section, rate, samples
        As in `OperationalModes`.
    modes
        Each joint mode as this record alone gives it; None if this record does not show it.
    notes
        Remarks on this record.
    channels
        Its channels.
    """

    record: str
    start: str | None
    section: tuple[float, float]
    rate: float
    samples: int
    modes: tuple[OperationalMode | None, ...]
    notes: tuple[str, ...]
    channels: tuple[str, ...] = ()

    def summary(self) -> dict[str, Any]:
        """Plain values for JSON."""
        alone = [None if mode is None else mode.summary() for mode in self.modes]
        own = {"record": self.record, "start": self.start, "section": list(self.section)}
        return {**own, "rate_hz": self.rate, "samples": self.samples, "modes": alone, "notes": list(self.notes)}


@dataclass(frozen=True)
class BandSpectrum:
    """Spectra of a band for the figure.

    Attributes
    ----------
    frequency, measured, fitted
        Frequencies (K,) [Hz], and the scaled sum of the channels' spectra as measured and as fitted (K,).
    poles
        Frequencies [Hz] and damping ratios of the modes of fits with 1, 2, … modes.
    """

    frequency: Array
    measured: Array
    fitted: Array
    poles: tuple[tuple[Array, Array], ...] = ()


class DecayHistory(NamedTuple):
    """History of the channel of a record that decays most clearly: times (T,) [s], readings and fit (T,)."""

    record: str
    channel: str
    time: Array
    measured: Array
    fitted: Array


@dataclass(frozen=True)
class OperationalModes(SummarisedAnswer):
    """Result of `windsysid.oma` or `windsysid.free_decay`: modes, spectra and remarks.

    Attributes
    ----------
    record, section, rate, samples
        Record of the modes; start and end [s], samples per second [Hz].
    channels, units, sensors
        Of the shapes: channels of the record, or multi-blade coordinates, which have no sensor.
    modes
        By rising frequency.
    lines
        Names and frequencies [Hz] of sinusoids that were removed.
    empty
        Given bands without a mode [Hz].
    frequency, singular_values, bands
        Frequencies [Hz] (F,), the largest singular values of the spectral matrix there (F, k), of channels scaled to
        the same median, and each band.
    rotor_hz
        Rotor frequency [Hz]; 0 where none turns.
    doubts
        Reasons why the whole result is doubtful.
    notes
        Remarks on the record and the analysis.
    elapsed
        Processor time of the analysis [s].
    start
        Date of the record's time 0.
    parts
        The records, if several were analysed jointly; the rest is then of all of them, `frequency`,
        `singular_values` and `bands` of the first.
    record_hash
        Of the whole record, as `windsysid.results.provenance.record_hash` gives it; None of several.
    decays
        Free decays (`windsysid.free_decay`), a history of each record; empty for ambient vibration.
    findings
        Remarks on vibration and modes of a turbine file that no mode of the result explains.
    nodes, lines_drawn
        Nodes of the structure and the pairs of their names that a line joins, for drawings of shapes.
    """

    record: str
    section: tuple[float, float]
    rate: float
    samples: int
    channels: tuple[str, ...]
    units: tuple[str, ...]
    sensors: tuple[ModalSensor | None, ...]
    modes: tuple[OperationalMode, ...]
    lines: tuple[tuple[str, float], ...]
    empty: tuple[tuple[float, float], ...]
    frequency: Array
    singular_values: Array
    bands: tuple[BandSpectrum, ...]
    rotor_hz: float
    doubts: tuple[str, ...]
    notes: tuple[str, ...]
    elapsed: float
    start: str | None = None
    parts: tuple[RecordModes, ...] = ()
    record_hash: str | None = None
    decays: tuple[DecayHistory, ...] = ()
    findings: tuple[Finding, ...] = ()
    nodes: tuple[Node, ...] = ()
    lines_drawn: tuple[tuple[str, str], ...] = ()

    @property
    def method(self) -> str:
        """``ambient vibration`` or ``free decays``."""
        return "free decays" if self.decays else "ambient vibration"

    @property
    def trusted(self) -> bool:
        """True if every mode is trusted."""
        return not self.reasons

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons for doubt about the record, its bands and its modes."""
        of_modes = (
            f"{mode.name}, {mode.frequency.estimate:.4g} Hz: {doubt.text}"
            for mode in self.modes
            for doubt in mode.grounds
            if doubt.kind != "record"
        )
        return (*self.reasons_of_record, *of_modes)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What no mode explains, and causes of wider intervals of modes that are to be used."""
        of_modes = (
            f"{mode.name}, {mode.frequency.estimate:.4g} Hz: {remark.text}"
            for mode in self.modes
            for remark in mode.remarks
            if mode.trusted
        )
        return (*map(str, self.findings), *of_modes)

    @property
    def reasons_of_record(self) -> tuple[str, ...]:
        """Reasons for doubt about the record or a band, without those about one mode."""
        empty = [f"no mode stands out between {low:.4g} and {high:.4g} Hz" for low, high in self.empty]
        return (*self.doubts, *empty, *(() if self.modes else ("no mode was found",)))

    def summary(self) -> dict[str, Any]:
        """Contents of ``summary.json``."""
        return {
            "analysis": ANALYSIS,
            "method": self.method,
            "record": self.record,
            "record_hash": self.record_hash,
            "start": self.start,
            "section": list(self.section),
            "rate_hz": self.rate,
            "samples": self.samples,
            "elapsed_s": self.elapsed,
            "rotor_speed_rad_s": 2.0 * np.pi * self.rotor_hz,
            "sensors": [None if s is None else s.model_dump(exclude_none=True) for s in self.sensors],
            "modes": [mode.full_summary(self.channels, self.units) for mode in self.modes],
            "mac": self.mac().tolist(),
            "lines": [{"name": name, "frequency_hz": f} for name, f in self.lines],
            "trusted": self.trusted,
            "doubts": list(self.doubts),
            "reasons": list(self.reasons),
            "findings": [one.summary() for one in self.findings],
            "notes": list(self.notes),
            **({"parts": [part.summary() for part in self.parts]} if self.parts else {}),
        }

    def mac(self, other: "OperationalModes | None" = None) -> Array:
        """Modal assurance criterion of each mode with each of another result, or of this one.

        Parameters
        ----------
        other
            Modes of a record with at least two channels in common; by default these modes.

        Returns
        -------
        Array
            (r, s) [1]: 1 for equal shapes; NaN where fewer than two channels are in common.
        """
        other = self if other is None else other
        common = [name for name in self.channels if name in other.channels]
        ours, theirs = (
            np.array([[one.shape[of.channels.index(name)] for one in of.modes] for name in common], dtype=np.complex128)
            .reshape(len(common), len(of.modes)) for of in (self, other)
        )  # fmt: skip
        return assurance_matrix(ours, theirs)

    def to_dataframe(self) -> "pd.DataFrame":
        """Frequency and damping ratio of each mode, a row each: ``name``, ``quantity``, ``unit``, ``estimate``,
        ``low``, ``high`` (±2σ), ``grade``, and ``in_file``, the value of the turbine file or NaN."""
        import pandas as pd

        rows = [row for mode in self.modes for row in mode.dataframe_rows()]
        columns = ["name", "quantity", "unit", "estimate", "low", "high", "grade", "in_file"]
        return pd.DataFrame(rows, columns=columns).astype({"in_file": float})

    @property
    def _numbered(self) -> bool:
        """True if names of modes do not describe their motion."""
        return any(mode.name.startswith("mode ") for mode in self.modes)

    @property
    def headings(self) -> tuple[str, ...]:
        """Headings of `rows`."""
        known = ("reference [Hz]", "which mode, odds") if any(mode.candidates for mode in self.modes) else ()
        return ("mode", "f ± 95 % [Hz]", "grade", "ζ ± 95 % [%]", "grade", *known, *(("moves most",) * self._numbered))

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """The modes as a table under `headings`."""
        rows = []
        for mode in self.modes:
            best = mode.candidates[:1]
            which = tuple(f"{one.name}, {odds_text(one.probability)}" for one in best)
            known = (mode.reference_cell(), *which) if best else ()
            largest = (self.channels[int(np.argmax(np.abs(mode.shape)))],) * self._numbered
            rows.append((*mode.cells(), *known, *largest))
        return rows

    def __repr__(self) -> str:
        trusted = "trusted" if self.trusted else "not trusted"
        return f"<OperationalModes of {self.record}: {len(self.modes)} modes, {trusted}; print it for the table>"

    def contents(self) -> list[Table | str]:
        """The modes, the verdict with its reasons, the table record by record if there are several, the notes."""
        verdict = "trust: yes, every mode has grade A or B" if self.trusted else "trust: NO, because"
        return [
            self.table(), verdict, *(f"  {reason}" for reason in self.reasons),
            *([self.agreement_table()] if self.parts else []), *self.remarks, *self.notes,
        ]  # fmt: skip

    def table(self, caption: str | None = None) -> Table:
        """`rows`, under `caption`."""
        of = self.record if self.parts else section_name(self.record, *self.section)
        words = [0, *(i for i, name in enumerate(self.headings) if name in ("which mode, odds", "moves most"))]
        return Table(self.headings, self.rows, f"modes of {of}" if caption is None else caption, words)

    def agreement_table(self, caption: str = "record by record") -> Table:
        """Frequency and damping ratio of each mode, record by record, under `caption`."""
        rows = []
        for i, mode in enumerate(self.modes):
            alone = [part.modes[i] for part in self.parts]
            cells = (
                "not seen" if one is None else f"{one.frequency.estimate:.4f}, {100 * one.damping_ratio.estimate:.2f}"
                for one in alone
            )
            rows.append((mode.name, *cells))
        headings = ("f [Hz], ζ [%]", *(part.record for part in self.parts))
        return Table(headings, rows, caption, tuple(range(len(headings))))

    def unit(self, channel: str) -> str:
        """The unit of a channel, as text."""
        return unit_text(self.units[self.channels.index(channel)])

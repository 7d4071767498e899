"""Reports: one self-contained HTML file, figures inside, readable without a network."""

from collections.abc import Mapping

from windsysid.output.table import READING, Table
from windsysid.records.moments import in_words, shift_moment
from windsysid.records.record import Record
from windsysid.reports.html import Section, reasons_against, report_page
from windsysid.results.identification import Identification
from windsysid.results.provenance import Provenance

__all__ = ["identification_report", "provenance_section"]


_HISTORIES = {
    "joint": (
        "Online estimates after each sample, statistics of loads and noise learned with the coefficients; the dot"
        " is the result of the whole record."
    ),
    "force-balance": "Filter estimates after each sample; the dot is the last one.",
}


def identification_report(identification: Identification, record: Record | None = None) -> bytes:
    """The report of one identification on the section of the record that it used; without its channels where the record
    is not given."""
    from windsysid.reports.interactive.identification import (
        caption,
        coefficient_plots,
        history_plots,
        record_plots,
        spectra_plots,
    )

    i = identification
    sections = [
        Section(
            "Result",
            text=[*reasons_against(i.diagnosis.reasons, [str(i.diagnosis)]), *i.usable(), f"{READING} {COLUMNS}"],
            tables=[*([i.modes_table()] if i.modes else []), i.table()],
            plots=coefficient_plots(i, caption(i)),
        ),
        Section("Spectra of the record and of the model", text=[SPECTRA], plots=spectra_plots(i, record)),
        Section("Inputs", text=i.notes, tables=_tables_of_rest(i)),
    ]
    if i.formulation in _HISTORIES and len(i.mean) > 1:
        sections.append(Section("Online estimates", text=[_HISTORIES[i.formulation]], plots=history_plots(i)))
    sections.append(_explains_section(i))
    if i.loads is not None and i.loads.names:
        sections.append(_load_section(i))
    if record is not None:
        used = record_plots(record, [channel for channel in i.sensors if channel in record])
        sections.append(Section("The record", text=[RECORD], plots=used))
    if i.provenance is not None:
        sections.append(provenance_section(i, i.provenance))
    subtitle = (
        f"{i.turbine} · {i.record}, {i.section[0]:g}–{i.section[1]:g} s at {i.rate:g} Hz · {i.formulation} formulation,"
        f" {i.method}, {i.samples} samples in {i.elapsed:.2f} s"
    )
    return report_page("Stiffness and damping", subtitle, sections)


def _tables_of_rest(i: Identification) -> list[Table]:
    statistics = [i.statistics_table()] if i.statistics else []
    return [*statistics, *([i.budget.table(), i.tolerances_table()] if i.tolerances else [])]


def _explains_section(identification: Identification) -> Section:
    """Check of the model against the record: by its innovations, or in words if there are none."""
    from windsysid.reports.interactive.identification import innovation_plots, whiteness_plots

    i, title = identification, "Does the model explain the record?"
    if i.formulation == "spectral":
        text = "Each channel was compared with its spectrum in the model, by frequency and by half of the record."
        return Section(title, text=[text, *i.diagnosis.remarks], tables=diagnosis_tables(i))
    return Section(
        title,
        text=[
            "A prediction error (innovation) is a reading minus its prediction from earlier readings, in standard "
            "deviations σ. Prediction errors should be within the dashed lines 95 % of the time and look like noise. "
            "Where they do not, the intervals above are too narrow.",
            WHITENESS,
            *i.diagnosis.remarks,
        ],
        tables=diagnosis_tables(i),
        plots=[*whiteness_plots(i), *innovation_plots(i)],
    )


def _load_section(identification: Identification) -> Section:
    """The loads as the filter knew them."""
    from windsysid.reports.interactive.identification import load_plots

    text = "The loads on the structure, as the filter estimated them at the result, with 95 % intervals."
    return Section("The loads", text=[text], plots=load_plots(identification))


def provenance_section(identification: Identification, provenance: Provenance) -> Section:
    """Provenance of the result: what is needed to find the record again and to repeat the identification."""
    import tomli_w

    from windsysid.turbine.tables import as_tables

    start, (begin, end) = provenance.start, identification.section
    used = f"{begin:g} … {end:g} s"
    if start is not None:
        used += f", {shift_moment(start, begin)} … {shift_moment(start, end)}"
    rows = [
        ("record", identification.record),
        ("start of the record", in_words(start)),
        ("section used", used),
        ("record, hash of all values", provenance.record_hash),
        ("turbine, hash of its file", provenance.turbine_hash),
        ("windsysid", provenance.windsysid),
        ("identified", provenance.identified),
        *((f"option {name}", _plain(value)) for name, value in provenance.options.items()),
        *((f"sensor {i}", _plain(sensor)) for i, sensor in enumerate(provenance.sensors, 1)),
    ]
    machine = identification.machine
    file = "" if machine is None else tomli_w.dumps(as_tables(machine))
    text = (
        "What is needed to find the record again and to repeat the identification. Below: the turbine as it was"
        " identified."
    )
    return Section(
        "Provenance", text=[text], tables=[Table(("item", "value"), rows, words=(0, 1))], file=file, folded=True
    )


def _plain(value: object) -> str:
    """An option in words."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {_plain(item)}" for key, item in value.items() if item is not None)
    return "default" if value is None else str(value)


SPECTRA = (
    "Grey: power spectral density of the readings, averaged over segments (Welch). Blue: the fitted model with the 95 %"
    " interval of its posterior. Modes have the grade of their frequency. The fit does not use shaded frequencies."
)

COLUMNS = (
    "f: natural frequency; ζ: damping ratio; from nP: distance from the nearest rotor harmonic; file: value in the"
    " turbine file, from which the estimate differs; by data: share of the information that is from the record."
)

RECORD = "The channels that were used: the smallest and the largest reading of each segment of time."

WHITENESS = (
    "The spectrum of the prediction errors is 1 for white noise. A peak above the orange line condemns the result where"
    " it lies in the shaded range of the modes; elsewhere it does little harm."
)


def diagnosis_tables(identification: Identification) -> list[Table]:
    """The innovations of each channel against white noise, the estimates against their priors."""
    diagnosis = identification.diagnosis
    tables = []
    if diagnosis.whiteness is not None:
        headings = (
            *("channel", "missing, gated", "square (95 %)", "highest peak", "level near a mode"),
            *("colour", "kurtosis", "beyond 5σ"),
        )
        rows = [
            (
                c.name,
                f"{100.0 * c.missing:.2g} %, {100.0 * c.gated:.2g} %",
                f"{c.nis:.3f} ({c.nis_low:.3f} … {c.nis_high:.3f})",
                f"{c.peak:.2g} at {c.peak_hz:.3g} Hz",
                f"{c.near:.2g} at {c.near_hz:.3g} Hz",
                f"{c.colour:.3f}",
                f"{c.kurtosis:+.2f}",
                str(c.outliers),
            )
            for c in diagnosis.whiteness.channels
        ]
        tables.append(
            Table(
                headings,
                rows,
                "Prediction errors [σ]: 1 is expected of the square, the peak and the level, 0 of colour and kurtosis",
            )
        )
    against = [(c.name, f"{100.0 * c.informed_by_data:.1f} %", f"{c.shift:+.2f}") for c in diagnosis.coefficients]
    titles = ("coefficient", "informed by data", "estimate − prior [σ expected]")
    return [*tables, Table(titles, against, "Prior against data (beyond ±4: a contradiction)")]

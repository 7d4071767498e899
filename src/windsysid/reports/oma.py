"""Operational modes as a figure and as one page."""

from typing import TYPE_CHECKING

from windsysid.output.table import Table, axes_of
from windsysid.reports.figures.oma_views import (
    assurance_table,
    band_plots,
    decay_plot,
    poles_plots,
    segment_plots,
    setup_table,
    shape_plots,
    shape_table,
    singular_value_plot,
)  # fmt: skip
from windsysid.reports.html import Section, reasons_against, report_page
from windsysid.reports.interactive.oma import complex_planes, marks_form, moving_shapes, page_script
from windsysid.spectral.oma.result import OperationalModes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["figure", "files"]

MAX_DECAYS, MAX_BANDS = 6, 12
"""Setting: decays on the page, and bands of the figure."""


def figure(found: OperationalModes, place: "Axes | None" = None) -> "Figure":
    """The singular values of the spectral matrix with the modes, and in each band the model on the readings."""
    from windsysid.reports.figures.drawing import drawn

    return drawn([singular_value_plot(found), *band_plots(found)[:MAX_BANDS]], place)


def _causes(found: OperationalModes) -> Table:
    """Why modes are of grade B or C."""
    rows = [
        (mode.name, f"{mode.frequency.estimate:.4g}", ". ".join(mode.doubts or (one.text for one in mode.remarks)))
        for mode in found.modes
        if mode.doubts or mode.remarks
    ]
    return Table(("mode", "f [Hz]", "why"), rows, words=(0, 2))


def _stability(found: OperationalModes) -> list[Section]:
    """Modes over model orders and segments of the record."""
    stay = [*poles_plots(found), *segment_plots(found)]
    text = "A structural mode keeps its frequency for all model orders and segments of the record."
    return [Section("Stability of the modes", text=[text], plots=stay)] if stay else []


def _record_by_record(found: OperationalModes) -> list[Section]:
    """Modes of each record, and the common part of their channels."""
    if not found.parts:
        return []
    text = "Each record by itself. Where they scatter more than their intervals say, the mode is of grade C."
    setups = "Where sensors moved between records, shapes are put together on the channels in common."
    return [
        Section("Record by record", text=[text], tables=[found.agreement_table("")]),
        Section("Setups", text=[setups], tables=[setup_table(found)]),
    ]


def _shape_sections(found: OperationalModes) -> list[Section]:
    """Shapes, moving and still, in the complex plane, and their measures."""
    if not found.modes:
        return []
    text = "Shapes as accelerations, 1 where most moves, with their 95 % intervals."
    measures = "MPC: phase collinearity, 1 for a real shape. MPD: mean phase deviation. MAC: 1 for equal shapes."
    tables = [shape_table(found), assurance_table(found)]
    return [
        Section("Shapes", text=[text], plots=shape_plots(found), markup=moving_shapes(found)),
        Section("Measures of the shapes", text=[measures], tables=tables, markup=complex_planes(found)),
    ]


def files(found: OperationalModes) -> dict[str, bytes]:
    """``report.html`` and ``summary.json``, by name."""
    usable = sum(mode.trusted for mode in found.modes)
    verdict = f"{usable} of {len(found.modes)} modes may be used with their intervals: grades A and B."
    against = [verdict, *reasons_against(found.reasons_of_record), *map(str, found.findings)]
    caption = "Grey: sum of the spectra of all channels, each scaled; blue: the fitted model."
    sections = [
        Section(
            "Modes",
            text=[*against, f"±: 95 % interval{axes_of(found.channels)}."],
            tables=[found.table("")],
        ),
        Section("Spectra", plots=[singular_value_plot(found)]),
        *([Section("Fit around each mode", text=[caption], plots=band_plots(found))] if found.bands else []),
    ]
    if found.decays:
        sections.insert(1, Section("Free decays", plots=[decay_plot(one) for one in found.decays[:MAX_DECAYS]]))
    sections += [*_stability(found), *_record_by_record(found), *_shape_sections(found)]
    if found.modes:
        text = "To add or remove modes, mark them here, and give the file with --modes."
        sections.append(Section("Modes by hand", text=[text], markup=marks_form(found) + page_script()))
    causes = _causes(found)
    if causes.rows:
        sections.append(Section("Why grades are B or C", tables=[causes]))
    if found.notes:
        sections.append(Section("How this was computed", text=list(found.notes)))
    section = "" if found.parts else f" · {found.section[0]:.6g}–{found.section[1]:.6g} s"
    subtitle = f"{found.record}{section} · {len(found.channels)} channels · {found.rate:.4g} Hz"
    return {
        "report.html": report_page(f"Modes from {found.method}", subtitle, sections),
        "summary.json": found.to_json().encode(),
    }

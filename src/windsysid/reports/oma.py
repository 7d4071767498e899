"""Operational modes as a figure and as one page."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.modal.shapes import along_axis
from windsysid.output.table import Table
from windsysid.reports.figures.canvas import MAX_TICK_CHARACTERS, label
from windsysid.reports.figures.drawing import drawn
from windsysid.reports.figures.oma_views import (
    assurance_table,
    band_plots,
    complexity_figure,
    decay_plot,
    poles_plots,
    segment_plots,
    setup_table,
    shape_table,
    singular_value_plot,
)  # fmt: skip
from windsysid.reports.figures.plots import ESTIMATE, MEASURED, REFERENCE, tidy
from windsysid.reports.html import Section, png, report_page
from windsysid.reports.interactive.oma import marks_form, moving_shapes, page_script
from windsysid.spectral.oma.mode import OperationalMode
from windsysid.spectral.oma.result import OperationalModes

__all__ = ["figure", "files"]

MOST_SHAPES = 24
"""Modes whose shapes are drawn."""

COLUMNS, MOST_DECAYS = 4, 6


def figure(found: OperationalModes, place: Axes | None = None) -> Figure:
    """The singular values of the spectral matrix with the modes, and in each band the model on the readings."""
    return drawn([singular_value_plot(found), *band_plots(found)[:MOST_SHAPES]], place)


def _shapes(found: OperationalModes) -> Figure | None:
    """Mode shapes: arrows at the sensors' places where these are known, otherwise bars with ±2σ."""
    modes = found.modes[:MOST_SHAPES]
    if not modes:
        return None
    placed = all(s is not None and s.position is not None and s.direction is not None for s in found.sensors)
    columns = min(COLUMNS, len(modes))
    rows = -(-len(modes) // columns)
    height = 3.0 if placed else 0.9 + 0.22 * len(found.channels)
    drawn = Figure(figsize=(2.75 * columns, height * rows + 0.3), layout="constrained")
    for i, mode in enumerate(modes):
        ax = drawn.add_subplot(rows, columns, i + 1, projection="3d" if placed else None)
        (_arrows if placed else _bars)(ax, found, mode, i % columns == 0)
        ax.set_title(f"{mode.name}, {mode.frequency.estimate:.4g} Hz", fontsize=8.5, loc="left", color=REFERENCE)
    return drawn


def _bars(ax: Axes, found: OperationalModes, mode: OperationalMode, named: bool) -> None:
    at = np.arange(len(found.channels))
    turned = along_axis(mode.shape)
    for part, offset, colour in ((turned.real, -0.17, ESTIMATE), (turned.imag, 0.17, MEASURED)):
        ax.barh(at + offset, part, 0.32, color=colour)
        ax.errorbar(part, at + offset, xerr=2.0 * mode.shape_std, fmt="none", ecolor=REFERENCE, elinewidth=0.7)
    names = [label(name, MAX_TICK_CHARACTERS) for name in found.channels]
    ax.set_yticks(at, names if named else [""] * len(at), fontsize=7)
    ax.invert_yaxis()
    ax.set_xlim(-1.3, 1.3)
    ax.axvline(0.0, color=REFERENCE, lw=0.6)
    tidy(ax)


def _arrows(ax: Axes, found: OperationalModes, mode: OperationalMode, named: bool) -> None:
    sensors = [s for s in found.sensors if s is not None]
    place = np.array([s.position for s in sensors], dtype=np.float64)
    way = np.array([s.direction for s in sensors], dtype=np.float64)
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    span = float(np.ptp(place, axis=0).max()) or 1.0
    turned = along_axis(mode.shape).real
    moved = place + 0.25 * span * way * turned[:, None]
    ax.plot(*place.T, "o", ms=2.5, color=MEASURED)
    for start, end in zip(place, moved, strict=True):
        ax.plot(*np.transpose([start, end]), color=ESTIMATE, lw=1.4)
    ax.plot(*moved.T, "o", ms=3.5, color=ESTIMATE)
    ax.tick_params(labelsize=6, colors=REFERENCE)
    for name in ("xaxis", "yaxis", "zaxis"):
        getattr(ax, name).set_pane_color((0.0, 0.0, 0.0, 0.0))


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


def _shape_section(found: OperationalModes) -> list[Section]:
    """Shapes, moving and still, in the complex plane, and their measures."""
    shapes, complexity = _shapes(found), complexity_figure(found)
    if shapes is None or complexity is None:
        return []
    text = "Shapes as accelerations, 1 where most moves. Bars: blue in phase, grey out of phase, lines 95 % intervals."
    circle = "Components of each shape in the complex plane: on one line where all channels move in phase."
    measures = "MPC: phase collinearity, 1 for a real shape. MPD: mean phase deviation. MAC: 1 for equal shapes."
    tables = [shape_table(found), assurance_table(found)]
    figures = [(shapes, text), (complexity, circle)]
    return [Section("Shapes", text=[measures], figures=figures, tables=tables, markup=moving_shapes(found))]


def files(found: OperationalModes) -> dict[str, bytes]:
    """``report.html``, ``modes.png`` and ``summary.json``, by name."""
    usable = sum(mode.trusted for mode in found.modes)
    verdict = f"{usable} of {len(found.modes)} modes may be used with their intervals: grades A and B."
    caption = (
        "Grey: the readings, all channels of a band added after scaling; blue: modes and what else is in the band."
    )
    sections = [
        Section(
            "Modes",
            text=[verdict, "± is the 95 % interval.", *found.reasons_of_record],
            tables=[found.table("")],
        ),
        Section("Spectra", plots=[singular_value_plot(found)]),
        *([Section("Modes in their bands", text=[caption], plots=band_plots(found))] if found.bands else []),
    ]
    if found.decays:
        sections.insert(1, Section("Free decays", plots=[decay_plot(one) for one in found.decays[:MOST_DECAYS]]))
    sections += [*_stability(found), *_record_by_record(found), *_shape_section(found)]
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
        "modes.png": png(figure(found)),
        "summary.json": found.to_json().encode(),
    }

"""Measured modes and the modes of a model that they may be, as a figure and as one page."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid.modal.matching.result import ModeMatch
from windsysid.reports.figures.participations import shares_of_modes
from windsysid.reports.html import Section, png, report_page

__all__ = ["ModeMatch", "figure", "files"]


def figure(found: ModeMatch, place: Axes | None = None) -> Figure:
    """Probability of each candidate of each measured mode."""
    chances = [{one.name: 100.0 * one.probability for one in mode.candidates} for mode in found.modes]
    names = list(dict.fromkeys(one.name for mode in found.modes for one in mode.candidates))
    percent = np.array([[chance.get(name, 0.0) for name in names] for chance in chances])
    return shares_of_modes(percent, found.modes, names, "probability [%]", place)


def files(found: ModeMatch) -> dict[str, bytes]:
    """``report.html``, ``match.png``, ``matches.csv`` and ``summary.json``, by name."""
    drawn = figure(found)
    caption = "Probability that a measured mode is this mode of the model, a load, a rotor harmonic, or unknown."
    sections = [
        Section("Which mode is which", text=["± is the 95 % interval.", *found.notes], tables=[found.table()]),
        Section("Candidates", figures=[(drawn, caption)]),
    ]
    return {
        "report.html": report_page("Measured modes and model", f"{found.record} · {found.model}", sections),
        "match.png": png(drawn),
        "matches.csv": found.to_dataframe().to_csv(index=False).encode(),
        "summary.json": found.to_json().encode(),
    }

"""Measured modes and the modes of a model that they may be, as a figure and as one page."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from windsysid._types import Array
from windsysid.modal.matching.result import ModeMatch
from windsysid.output.table import Table
from windsysid.reports.figures.participations import shares_of_modes
from windsysid.reports.html import Section, report_page

__all__ = ["ModeMatch", "figure", "files"]


def figure(found: ModeMatch, place: Axes | None = None) -> Figure:
    """Probability of each candidate of each measured mode."""
    return shares_of_modes(*_chances(found), "probability [%]", place)


def _chances(found: ModeMatch) -> tuple[Array, Sequence[Any], list[str]]:
    """Probabilities (modes, candidates) [%], the measured modes, and the candidates."""
    chances = [{one.name: 100.0 * one.probability for one in mode.candidates} for mode in found.modes]
    names = list(dict.fromkeys(one.name for mode in found.modes for one in mode.candidates))
    return np.array([[chance.get(name, 0.0) for name in names] for chance in chances]), found.modes, names


def files(found: ModeMatch) -> dict[str, bytes]:
    """``report.html``, ``matches.csv`` and ``summary.json``, by name."""
    rows = [
        (mode.name, *(f"{value:.0f} %" if value >= 0.5 else "" for value in row))
        for row, mode in zip(*_chances(found)[:2], strict=True)
    ]
    caption = "Probability that a measured mode is this mode of the model, a load, a rotor harmonic, or unknown"
    sections = [
        Section("Which mode is which", text=["± is the 95 % interval.", *found.notes], tables=[found.table()]),
        Section("Candidates", tables=[Table(("mode", *_chances(found)[2]), rows, caption)]),
    ]
    return {
        "report.html": report_page("Measured modes and model", f"{found.record} · {found.model}", sections),
        "matches.csv": found.to_dataframe().to_csv(index=False).encode(),
        "summary.json": found.to_json().encode(),
    }

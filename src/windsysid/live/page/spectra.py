"""Conversion of stored spectra into the models of the API: those of one window, and a waterfall of a channel."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from windsysid.live.page import models
from windsysid.live.page.results import ms_of
from windsysid.output.table import titled

__all__ = ["spectra_of", "waterfall_of"]

WindowSpectra = tuple[int, list[dict[str, Any]]]
"""Start of a window and plots of its spectra, as a store returns them."""


def spectra_of(found: Sequence[WindowSpectra]) -> models.Spectra:
    """Spectra of the last window."""
    if not found:
        return models.Spectra(window=None, plots=[])
    return models.Spectra(
        window=ms_of(found[-1][0]), plots=[plot | {"title": titled(plot["title"])} for plot in found[-1][1]]
    )


def waterfall_of(found: Sequence[WindowSpectra], channel: str | None) -> models.Waterfall:
    """Measured spectra of a channel, by default the first, at the frequencies of the newest one."""
    channels = list(dict.fromkeys(titled(plot["title"]) for _, plots in reversed(found) for plot in plots))
    channel = titled(channel or next(iter(channels), ""))
    all_plots = ((window, plot) for window, plots in found for plot in plots)
    chosen = {ms_of(window): plot for window, plot in all_plots if titled(plot["title"]) == channel and plot["x"]}
    plots = list(chosen.values())
    newest: Mapping[str, Any] = plots[-1] if plots else {"x": [], "y_axis": {"label": ""}}
    return models.Waterfall(
        channel=channel, channels=channels, unit=newest["y_axis"]["label"], windows=list(chosen),
        frequencies=newest["x"], modes=_modes(plots), density=[_log_density(plot, newest["x"]) for plot in plots],
    )  # fmt: skip


def _modes(plots: Sequence[Mapping[str, Any]]) -> dict[str, list[float | None]]:
    """Frequencies of the modes that the plots mark by name and grade, ``tower x (A)``; None with grade C."""
    found: dict[str, list[float | None]] = {}
    for i, plot in enumerate(plots):
        for mark in plot["marks"]:
            name, _, grade = mark["name"].rpartition(" ")
            if mark["group"] == "modes" and grade != "(C)":
                found.setdefault(name, [None] * len(plots))[i] = mark["at"]
    return found


def _log_density(plot: Mapping[str, Any], frequencies: Sequence[float]) -> list[float | None]:
    """Decimal logarithm of a measured spectrum at frequencies [Hz]; None outside of its range."""
    measured = np.array(next(one["values"] for one in plot["curves"] if one["name"] == "measured"), dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        levels = np.interp(frequencies, plot["x"], np.log10(measured), left=math.nan, right=math.nan)
    return [round(level, 2) if math.isfinite(level) else None for level in levels.tolist()]

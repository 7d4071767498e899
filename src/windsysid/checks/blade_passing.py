"""Blades that pass at a steady speed where a mode is.

Filters take the line NP for a load whose amplitude wanders. A steady one stays, whatever the filter's memory, and comes
to stand for a part of the resonance: damping comes out too small. Turned back by N ψ it is a constant, which stands out
of the transform's neighbours as lines do (`windsysid.checks.lines`). A resonance that is hardly broader than a line
cannot be told from one, so that no answer is given there.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.lines import (
    LINE_CHANCE,
    LINE_REACH,
    NARROWEST,
    PARABOLA_LOSS,
    SURROUNDINGS,
    line_bound,
    stand_out_of_a_bend,
)
from windsysid.results.finding import Finding

__all__ = ["Passing", "find_passing"]

BEYOND = 2.0
"""Frequencies 1/T of a record beyond a mode's half-width ζf within which the line is in it."""

SMOOTHED = 20.0
"""Seconds over which the rotor's speed is told: an azimuth has noise of its own."""


class Passing(NamedTuple):
    """A blade-passing frequency that cannot be separated from a mode.

    Attributes
    ----------
    frequency, natural
        Blade-passing frequency and frequency of the mode [Hz].
    half_width
        Half-power half-width ζf of the mode [Hz].
    resolution
        Frequency resolution of the record [Hz].
    """

    frequency: float
    natural: float
    half_width: float
    resolution: float

    def finding(self, blades: int) -> Finding:
        """A reason: the line may be the mode, part of it, or too near to it."""
        data: dict[str, Any] = {"frequency": self.frequency, "blades": blades, "mode": self.natural}
        off = abs(self.frequency - self.natural)
        if off <= (LINE_REACH - 1.0) * self.natural:
            return Finding("blade_passing_on_mode", "reason", data)
        if off <= self.half_width:
            return Finding("blade_passing_in_mode", "reason", data | {"damping": self.half_width / self.natural})
        return Finding("blade_passing_unresolved", "reason", data | {"resolution": self.resolution})


def find_passing(
    values: Array, azimuth: Array, *, rate: float, modes: Sequence[tuple[float, float]], blades: int
) -> Passing | None:
    """Whether a steady line of the passing blades is in a mode.

    Parameters
    ----------
    values, azimuth
        Readings (T, m) without gaps, and ψ (T,) [rad], unwrapped.
    modes
        Frequency [Hz] and damping ratio of each.
    """
    step, cycle = rate / len(values), 0.5 * blades / np.pi
    passing = cycle * abs(float(azimuth[-1] - azimuth[0])) / ((len(azimuth) - 1) / rate)
    hop = max(1, min(round(SMOOTHED * rate), len(azimuth) // 2))
    scatter = cycle * float(np.std(azimuth[hop:] - azimuth[:-hop])) * rate / hop
    for natural, damping in modes:
        width = damping * natural
        if abs(passing - natural) > width + BEYOND * step or scatter > width:
            continue
        if width < NARROWEST * step or _stands_out(values, blades * azimuth):
            return Passing(passing, natural, width, BEYOND * step)
    return None


def _stands_out(values: Array, phase: Array) -> bool:
    """Whether a constant stands out of readings that are turned back by a phase (T,)."""
    window = np.hanning(len(values))
    power = np.abs(np.fft.fft((window * np.exp(-1j * phase))[:, None] * (values - values.mean(axis=0)), axis=0)) ** 2
    around = np.concatenate([power[-SURROUNDINGS:], power[: SURROUNDINGS + 1]])
    ratio = stand_out_of_a_bend(around, np.array([SURROUNDINGS]), SURROUNDINGS)
    return bool(ratio.max() > line_bound(values.shape[1], SURROUNDINGS, LINE_CHANCE, PARABOLA_LOSS))

"""Blade-passing frequency near a mode: the load of the blades looks like a resonance there.

Spectra of a structure on which nothing turns have no model of that load: no mode may be near. Filters take the line NP
for a load whose amplitude varies. A steady one stays, whatever the filter's memory, and comes to stand for a part of
the resonance: damping comes out too small. Turned back by N ψ it is a constant, which stands out of the transform's
neighbours as lines do (`windsysid.checks.lines`). A resonance that is hardly broader than a line cannot be
distinguished from one, so that no answer is given there.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import (
    FALSE_ALARM_PROBABILITY,
    HARMONIC_HALF_WIDTH_BINS,
    LINE_NEAR_MODE_FACTOR,
    MIN_RESONANCE_WIDTH_BINS,
)
from windsysid.checks.lines import PARABOLA_LOSS, SURROUNDING_BINS, line_bound, stand_out_of_a_bend
from windsysid.results.finding import Finding

__all__ = ["Passing", "find_passing"]

SPEED_AVERAGE_SECONDS = 20.0
"""Setting: time over which the rotor speed is averaged [s], since an azimuth has noise of its own."""


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
    unmodelled
        The degree of freedom of the mode where the load is not modelled.
    """

    frequency: float
    natural: float
    half_width: float
    resolution: float
    unmodelled: str = ""

    def finding(self, blades: int) -> Finding:
        """A reason: the line may be the mode, part of it, or too near to it."""
        data: dict[str, Any] = {"frequency": self.frequency, "blades": blades, "mode": self.natural}
        if self.unmodelled:
            return Finding("blade_passing_near_mode", "reason", data | {"coordinate": self.unmodelled})
        off = abs(self.frequency - self.natural)
        if off <= (LINE_NEAR_MODE_FACTOR - 1.0) * self.natural:
            return Finding("blade_passing_on_mode", "reason", data)
        if off <= self.half_width:
            return Finding("blade_passing_in_mode", "reason", data | {"damping": self.half_width / self.natural})
        return Finding("blade_passing_unresolved", "reason", data | {"resolution": self.resolution})


def find_passing(
    modes: Sequence[tuple[str, float, float]], blades: int, rotor_hz: float = 0.0,
    readings: tuple[Array, Array, float] | None = None,
) -> Passing | None:  # fmt: skip
    """Find a mode that the load of the passing blades cannot be separated from.

    Parameters
    ----------
    modes
        Name, frequency [Hz] and damping ratio of each.
    rotor_hz
        Mean rotor speed [Hz], where the load is not modelled.
    readings
        Of a formulation that models the load but for a steady line: readings (T, m) without gaps, ψ (T,) [rad],
        unwrapped, and their rate [Hz].
    """
    if readings is not None:
        return _find_steady(modes, blades, *readings)
    passing = blades * rotor_hz
    for name, natural, damping in modes:
        if passing and natural / LINE_NEAR_MODE_FACTOR < passing < natural * LINE_NEAR_MODE_FACTOR:
            return Passing(passing, natural, damping * natural, 0.0, name)
    return None


def _find_steady(
    modes: Sequence[tuple[str, float, float]], blades: int, values: Array, azimuth: Array, rate: float
) -> Passing | None:
    """The first mode with a steady line of the passing blades."""
    step, cycle = rate / len(values), 0.5 * blades / np.pi
    passing = cycle * abs(float(azimuth[-1] - azimuth[0])) / ((len(azimuth) - 1) / rate)
    hop = max(1, min(round(SPEED_AVERAGE_SECONDS * rate), len(azimuth) // 2))
    scatter = cycle * float(np.std(azimuth[hop:] - azimuth[:-hop])) * rate / hop
    for _, natural, damping in modes:
        width = damping * natural
        if abs(passing - natural) > width + HARMONIC_HALF_WIDTH_BINS * step or scatter > width:
            continue
        if width < MIN_RESONANCE_WIDTH_BINS * step or _stands_out(values, blades * azimuth):
            return Passing(passing, natural, width, HARMONIC_HALF_WIDTH_BINS * step)
    return None


def _stands_out(values: Array, phase: Array) -> bool:
    """Test whether readings that are rotated back by a phase (T,) have a significant mean."""
    window = np.hanning(len(values))
    power = np.abs(np.fft.fft((window * np.exp(-1j * phase))[:, None] * (values - values.mean(axis=0)), axis=0)) ** 2
    around = np.concatenate([power[-SURROUNDING_BINS:], power[: SURROUNDING_BINS + 1]])
    ratio = stand_out_of_a_bend(around, np.array([SURROUNDING_BINS]), SURROUNDING_BINS)
    return bool(ratio.max() > line_bound(values.shape[1], SURROUNDING_BINS, FALSE_ALARM_PROBABILITY, PARABOLA_LOSS))

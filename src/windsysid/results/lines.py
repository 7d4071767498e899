"""Lines: one frequency of a whole record's periodogram that stands out of its surroundings.

A machine, a neighbour or waves put a line beside a mode. In the readings it stands out however the result explains it;
in the innovations it may not, as a resonance that the fit has moved and narrowed takes it in. A resonance is broad
where its half-power width ζf is more than a few frequencies 1/T of the periodogram; records too short for that are not
looked at. What turns with the rotor at nP is no line of this kind.

One point of white noise's periodogram over the mean of n others is x or more with probability (1 + x/n)^−n.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array

__all__ = ["Line", "find_line", "line_bound", "stand_out"]

LINE_REACH = 1.15
"""Factor about a natural frequency within which a line bends what is found of the mode."""

WIDTH = 2
"""Frequencies of a periodogram to either side of a line that its own power reaches by Hann's window."""

HANN_VARIANCE = 1.94
"""Variance of the mean of neighbouring frequencies under Hann's window over that of independent ones."""

SURROUNDINGS = 15
"""Frequencies to either side of one that tell the level around it in readings, where resonances bend it."""

NARROWEST = 5.0
"""Half-power width of a resonance in frequencies of the periodogram, below which its peak and its flanks may look like
lines."""

TURNING_SHARE = 0.02
"""Share of a frequency nP to either side within which what turns with the rotor stands out."""

MOST_MISSING = 0.05
"""Share of a channel beyond which it is not looked at."""


class Line(NamedTuple):
    """What stands out most.

    Attributes
    ----------
    channel
        In which channel.
    frequency
        [Hz].
    ratio, bound
        Power over that of its surroundings, and what chance exceeds in one record of 1000.
    """

    channel: str
    frequency: float
    ratio: float
    bound: float


def stand_out(power: Array, at: NDArray[np.int64], surroundings: int) -> Array:
    """Power (F, m) at some frequencies (K,) over the mean of so many to either side (K, m)."""
    sums = np.vstack([np.zeros(power.shape[1]), np.cumsum(power, axis=0)])

    def around(width: int) -> Array:
        return np.asarray(sums[at + width + 1] - sums[at - width])

    level = (around(surroundings) - around(WIDTH)) / (2 * (surroundings - WIDTH))
    return np.asarray(power[at] / np.maximum(level, 1e-300))


def line_bound(tested: int, surroundings: int, chance: float) -> float:
    """What the greatest of so many ratios of `stand_out` stays below but for that chance."""
    n = 2 * (surroundings - WIDTH) / HANN_VARIANCE
    return float(n * ((chance / max(tested, 1)) ** (-1.0 / n) - 1.0))


def find_line(
    values: Array, channels: Sequence[str], *, rate: float, modes: Sequence[tuple[float, float]], rotor_hz: float,
    chance: float,
) -> Line | None:  # fmt: skip
    """The line that stands out most of readings (T, m), beside modes of frequencies f [Hz] and damping ratios ζ.

    None where a mode is too narrow for the record's length.
    """
    frequency = np.arange(len(values) // 2 + 1) * (rate / len(values))
    step = rate / len(values)
    if any(damping * natural < NARROWEST * step for natural, damping in modes):
        return None
    near = np.zeros(len(frequency), dtype=np.bool_)
    for natural, _ in modes:
        near |= (frequency > natural / LINE_REACH) & (frequency < natural * LINE_REACH)
    if rotor_hz:
        order = np.maximum(np.round(frequency / rotor_hz), 1.0)
        near &= np.abs(frequency - order * rotor_hz) > np.maximum(TURNING_SHARE * frequency, 3.0 * step)
    near[: SURROUNDINGS + 1] = near[-SURROUNDINGS - 1 :] = False
    whole = np.mean(~np.isfinite(values), axis=0) <= MOST_MISSING
    if not near.any() or not whole.any():
        return None
    z = np.column_stack([_filled(column) for column in values[:, whole].T])
    power = np.abs(np.fft.rfft(np.hanning(len(z))[:, None] * z, axis=0)) ** 2
    at = np.flatnonzero(near)
    ratio = stand_out(power, at, SURROUNDINGS)
    row, column = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    bound = line_bound(ratio.size, SURROUNDINGS, chance)
    named = [channel for channel, kept in zip(channels, whole, strict=True) if kept][int(column)]
    return Line(named, float(frequency[at[row]]), float(ratio[row, column]), bound)


def _filled(column: Array) -> Array:
    """Readings (T,) about their mean, what is missing between its neighbours."""
    known = np.flatnonzero(np.isfinite(column))
    filled = np.interp(np.arange(len(column)), known, column[known])
    return np.asarray(filled - math.fsum(filled) / len(filled))

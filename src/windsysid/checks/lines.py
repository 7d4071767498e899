"""Lines: one frequency of a whole record's periodogram that stands out of its surroundings.

A machine, a neighbour or waves put a line near a mode. In the readings it stands out however the result explains it;
in the innovations it may not, as a resonance that the fit has moved and narrowed takes it in. A resonance is
broad where its half-power width ζf is more than a few frequencies 1/T of the periodogram; a line close to the peak of
one that is not cannot be distinguished from it. Rotor harmonics nP are excluded.

Innovations are white near a line, and the mean of their surroundings estimates the level S. Readings are not: near a
resonance 1/S is a parabola in frequency, S = A/(w² + (f − f₀)²). The one that surroundings I_j are likeliest to come
from minimises Σ I_j/S_j + log S_j (Whittle 1953), which is convex in the parabola's three coefficients.

One point of white noise's periodogram over the mean of n others is x or more with probability (1 + x/n)^−n; over a
parabola through them it is as if n were smaller (`PARABOLA_LOSS`).

Source: Whittle, J. R. Statist. Soc. B 15, 1953, https://doi.org/10.1111/j.2517-6161.1953.tb00131.x.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.checks.limits import (
    FALSE_ALARM_PROBABILITY,
    HARMONIC_HALF_WIDTH_BINS,
    HARMONIC_HALF_WIDTH_SHARE,
    LINE_SEARCH_FACTOR,
    MAX_MISSING_SHARE,
    MIN_RESONANCE_WIDTH_BINS,
)

__all__ = ["Line", "find_line", "line_bound", "may_be_no_line", "stand_out", "stand_out_of_a_bend"]

LINE_HALF_WIDTH_BINS = 2
"""Setting: frequency bins to either side of a line that its own power reaches with Hann's window."""

HANN_VARIANCE = 1.94
"""Numerical: variance of the mean of neighbouring bins with Hann's window over that of independent ones."""

SURROUNDING_BINS = 30
"""Setting: frequency bins to either side of one that give the level around it in readings, where resonances bend it."""

PARABOLA_LOSS = 1.9
"""Numerical: factor by which fewer bins seem to give the level if a parabola is fitted to them: for white noise from
1.7 at one point in 1000 to 2.0 at one in 100 000 (``tests/results/test_steadiness.py``)."""

MIN_FITTED_RATIO = 4.0
"""Setting: ratio of a bin to the mean of its surroundings from which on a parabola is fitted: no bound is below 8, and
no resonance of `MIN_RESONANCE_WIDTH_BINS` falls to half that mean next to its peak."""

NEWTON_STEPS = 12
"""Numerical: number of iterations of Newton's method for the parabola; it converges in half as many."""


class Line(NamedTuple):
    """Most significant line.

    Attributes
    ----------
    channel
        In which channel.
    frequency
        [Hz].
    ratio, bound
        Power over that of its surroundings, and what chance exceeds in a share `FALSE_ALARM_PROBABILITY` of records.
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

    level = (around(surroundings) - around(LINE_HALF_WIDTH_BINS)) / (2 * (surroundings - LINE_HALF_WIDTH_BINS))
    return np.asarray(power[at] / np.maximum(level, 1e-300))


def stand_out_of_a_bend(
    power: Array, at: NDArray[np.int64], surroundings: int, width: int = LINE_HALF_WIDTH_BINS
) -> Array:
    """Power (F, m) at some frequencies (K,) over the level that a parabola in 1/S has there (K, m), estimated from so
    many to either side but for those within a width."""
    away = np.arange(width + 1, surroundings + 1)
    off = np.concatenate([-away[::-1], away])
    x = np.vander(off / surroundings, 3, increasing=True)
    around = np.moveaxis(power[at[:, None] + off], 2, 1)
    mean = np.maximum(around.mean(axis=2), 1e-300)
    around = around / mean[:, :, None]
    bend = np.zeros((*mean.shape, 3))
    bend[..., 0] = 1.0
    for _ in range(NEWTON_STEPS):
        level = bend @ x.T  # 1/S in units of the mean
        slope = (around - 1.0 / level) @ x
        curvature = np.einsum("kmn,ni,nj->kmij", level**-2.0, x, x, optimize=True)
        step = np.linalg.solve(curvature, slope[..., None])[..., 0]
        length = np.sqrt(np.maximum((step * slope).sum(axis=2), 0.0))
        bend -= step / np.where(length < 0.25, 1.0, 1.0 + length)[..., None]  # stays where 1/S > 0: self-concordant
    return np.asarray(power[at] / mean * bend[..., 0])


def line_bound(tested: int, surroundings: int, chance: float, loss: float = 1.0) -> float:
    """Upper bound of the greatest of so many ratios of `stand_out` under the null hypothesis, or of
    `stand_out_of_a_bend` with `PARABOLA_LOSS`."""
    n = 2 * (surroundings - LINE_HALF_WIDTH_BINS) / HANN_VARIANCE / loss
    return float(n * ((chance / max(tested, 1)) ** (-1.0 / n) - 1.0))


def find_line(
    values: Array, channels: Sequence[str], *, rate: float, modes: Sequence[tuple[float, float]], rotor_hz: float,
    reach: float = LINE_SEARCH_FACTOR, known: Sequence[tuple[float, float]] = (),
) -> Line | None:  # fmt: skip
    """The line that stands out most of readings (T, m), near modes of frequencies f [Hz] and damping ratios ζ, within
    a factor `reach`, but for ranges [Hz] in which something is known.

    None where there is nothing to be looked at.
    """
    step = rate / len(values)
    frequency = np.arange(len(values) // 2 + 1, dtype=np.float64) * step
    near = _near_modes(frequency, [natural for natural, _ in modes], reach)
    near &= ~may_be_no_line(frequency, modes, rotor_hz, step)
    for low, high in known:
        near &= (frequency < low) | (frequency > high)
    near[: SURROUNDING_BINS + 1] = near[-SURROUNDING_BINS - 1 :] = False
    whole = np.flatnonzero(np.mean(~np.isfinite(values), axis=0) <= MAX_MISSING_SHARE)
    if not near.any() or not whole.size:
        return None
    at = np.flatnonzero(near)
    ratio = _ratios(np.column_stack([_filled(column) for column in values[:, whole].T]), at)
    row, column = np.unravel_index(int(np.argmax(ratio)), ratio.shape)
    bound = line_bound(ratio.size, SURROUNDING_BINS, FALSE_ALARM_PROBABILITY, PARABOLA_LOSS)
    return Line(channels[int(whole[column])], float(frequency[at[row]]), float(ratio[row, column]), bound)


def _near_modes(frequency: Array, naturals: Sequence[float], reach: float) -> NDArray[np.bool_]:
    """Mask of the frequencies (F,) within a factor of a natural one (F,)."""
    near = np.zeros(len(frequency), dtype=np.bool_)
    for natural in naturals:
        near |= (frequency > natural / reach) & (frequency < natural * reach)
    return near


def may_be_no_line(
    frequency: Array, modes: Sequence[tuple[float, float]], rotor_hz: float, step: float
) -> NDArray[np.bool_]:
    """Mask of the frequencies (F,) of a periodogram with this step that may be rotor harmonics, or the peak of one of
    `modes` (`find_line`) that is as narrow as a line, as sensors on the rotor and on the support show it."""
    narrow = [natural for natural, damping in modes if damping * natural < MIN_RESONANCE_WIDTH_BINS * step]
    seen = np.abs([natural + turn for natural in narrow for turn in (-rotor_hz, 0.0, rotor_hz)])
    found = (np.abs(frequency - seen[:, None]) <= MIN_RESONANCE_WIDTH_BINS * step).any(axis=0)
    if rotor_hz:
        order = np.maximum(np.round(frequency / rotor_hz), 1.0)
        width = np.maximum(HARMONIC_HALF_WIDTH_SHARE * frequency, HARMONIC_HALF_WIDTH_BINS * step)
        found |= np.abs(frequency - order * rotor_hz) <= width
    return np.asarray(found)


def _ratios(values: Array, at: NDArray[np.int64]) -> Array:
    """Power of values (T, m) at points of their periodogram (K,) over the level around them (K, m), a parabola where
    they are far above its mean."""
    power = np.abs(np.fft.rfft(np.hanning(len(values))[:, None] * values, axis=0)) ** 2
    ratio = stand_out(power, at, SURROUNDING_BINS)
    high = ratio.max(axis=1) > MIN_FITTED_RATIO
    ratio[high] = stand_out_of_a_bend(power, at[high], SURROUNDING_BINS)
    return ratio


def _filled(column: Array) -> Array:
    """Readings (T,) about their mean, missing ones interpolated from their neighbours."""
    known = np.isfinite(column)
    if not known.all():
        column = np.interp(np.arange(len(column)), np.flatnonzero(known), column[known])
    return np.asarray(column - math.fsum(column.tolist()) / len(column))

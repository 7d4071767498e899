"""Dead channels: constant ones, and those that are noise, white or of any power law, where the structure's modes are.

A sensor without power or with a broken cable reads noise. A model explains it with a loud noise and little load, leaves
white innovations, and takes the missing resonances for information: coefficients go where a resonance would not show.

Divided by its power law, noise's periodogram is level: the mean of n neighbouring frequencies over the mean of the m
others has Fisher's distribution of 2n and 2m degrees of freedom, fewer under Hann's window, whose neighbours are alike.
Something vibrates where windows of one width or another stand higher than chance lets any of them. What turns with the
rotor is left out: gravity shows in a sensor that hears no vibration.
"""

from collections.abc import Sequence

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import (
    HARMONIC_HALF_WIDTH_BINS,
    HARMONIC_HALF_WIDTH_SHARE,
    MAX_MISSING_SHARE,
    MIN_LONG_RECORD_BINS,
    MIN_VIBRATION_BINS,
    NOISE_VIBRATION_PROBABILITY,
    SHORT_NOISE_VIBRATION_PROBABILITY,
)

__all__ = ["find_still", "is_constant"]

MAX_CONSTANT_SPREAD = 1e-12
"""Numerical: range of a constant channel over its largest value, from rounding in the conversion of its unit."""

FREQUENCY_RANGE_FACTOR = 2.0
"""Setting: factor below the lowest and above the highest natural frequency to which vibration is searched."""

WIDEST_WINDOW_DIVISOR = 2
"""Setting: number of frequency bins over that of the widest window."""


def is_constant(values: Array) -> bool:
    """Whether finite readings (T,) have one value."""
    return float(np.ptp(values)) <= MAX_CONSTANT_SPREAD * float(np.abs(values).max())


def find_still(
    readings: Array, channels: Sequence[str], *, rate: float, frequencies: Sequence[float], rotor_hz: float
) -> tuple[str, ...]:
    """The channels of readings (T, m), sampled at `rate` [Hz], that are nothing but noise around the natural
    `frequencies` [Hz] of a machine whose rotor turns at `rotor_hz`."""
    if not frequencies:
        return ()
    missing = ~np.isfinite(readings)
    mean = np.where(missing, 0.0, readings).sum(axis=0) / np.maximum((~missing).sum(axis=0), 1)
    window = np.hanning(len(readings))[:, None]
    power = np.abs(np.fft.rfft(np.where(missing, 0.0, readings - mean) * window, axis=0)) ** 2
    f = np.asarray(np.fft.rfftfreq(len(readings), 1.0 / rate), dtype=np.float64)
    highest = min(FREQUENCY_RANGE_FACTOR * max(frequencies), 0.45 * rate)
    there = (f > min(frequencies) / FREQUENCY_RANGE_FACTOR) & (f < highest)
    if rotor_hz > 0.0:
        away = np.abs(f - rotor_hz * np.maximum(np.round(f / rotor_hz), 1.0))
        there &= away > np.maximum(HARMONIC_HALF_WIDTH_SHARE * f, HARMONIC_HALF_WIDTH_BINS * rate / len(readings))
    if there.sum() < MIN_VIBRATION_BINS:
        return ()
    clear = there.sum() >= MIN_LONG_RECORD_BINS and highest == FREQUENCY_RANGE_FACTOR * max(frequencies)
    chance = NOISE_VIBRATION_PROBABILITY if clear else SHORT_NOISE_VIBRATION_PROBABILITY
    judged = (missing.mean(axis=0) <= MAX_MISSING_SHARE) & (power[there].max(axis=0) > 0.0)
    return tuple(
        channel for channel, one, look in zip(channels, power[there].T, judged, strict=True)
        if look and not _stands_out(_levelled(f[there], one), chance)
    )  # fmt: skip


def _levelled(f: Array, power: Array) -> Array:
    """Power (n,) at f (n,) [Hz] over the power law that it follows."""
    slope = np.polyfit(np.log(f), np.log(np.maximum(power, 1e-30 * power.max())), 1)[0]
    return np.asarray(power / f**slope)


def _stands_out(power: Array, chance: float) -> bool:
    """Whether a window of neighbouring frequencies (n,) is higher than chance lets one of level noise be."""
    from scipy.special import fdtrc

    n, total = len(power), float(power.sum())
    sums = np.concatenate([[0.0], np.cumsum(power)])
    width, tried, least = 1, 0, 1.0
    while width <= n // WIDEST_WINDOW_DIVISOR:
        inside = sums[width:] - sums[:-width]
        ratio = float(inside.max()) / width / ((total - float(inside.max())) / (n - width))
        least = min(least, float(fdtrc(2.0 * _shape(width), 2.0 * _shape(n - width), ratio)))
        tried += len(inside)
        width *= 2
    return least * tried < chance


def _shape(width: int) -> float:
    """As how many independent frequencies so many neighbours count under Hann's window."""
    return width / (1.0 + (8.0 / 9.0) * (width - 1) / width + max(width - 2, 0) / (18.0 * width))

"""Dead channels: constant ones, and those that are noise, white or of any power law, where the structure's modes are.

A sensor without power or with a broken cable reads noise. A model explains it with a loud noise and little load, leaves
white innovations, and takes the missing resonances for information: coefficients go where a resonance would not show.

Divided by its power law, noise's periodogram is level: the mean of n neighbouring frequencies over the mean of the m
others has Fisher's distribution of 2n and 2m degrees of freedom, fewer under Hann's window, whose neighbours are alike.
Something vibrates where windows of one width or another stand higher than chance lets any of them. What turns with the
rotor is left out: gravity shows in a sensor without vibration.

A mode with heavy aerodynamic damping, or load peaks next to it, may stand no higher than that. But noise of a dead
channel is independent of the other channels, and loads on a structure are not. So a channel that is coherent with one
that vibrates is alive: if not, phase differences φ are uniform, and with R² = |Σ exp iφ|²/w² of each window of w
frequencies, which count as n independent ones, −(n − 1) Σ ln (1 − R²) has a gamma distribution with the number of
windows as shape. In a decay or a gust, neighbouring frequencies have phases that are bound to each other, and n is
smaller. Phases alone are used, so that one common line, such as hum, is no coherence.

Crosstalk puts a copy of another channel into noise, at a constant gain. Where no motion is common to both, the copy is
subtracted, and what is left is tested. That finds one copy of a channel of the same unit, weaker than the channel
itself; several copies, and those of other units or of a channel with long gaps, pass for vibration.

A short record has too few frequencies for that. There the fit itself is tested: its innovations against the residuals
of a first-order autoregression, by their likelihoods. Of noise the two are alike, and a ratio above 1/p has at most
the probability p (Markov's inequality); where something vibrates, the structure predicts its readings far better.
"""

from collections.abc import Sequence

import numpy as np

from windsysid._types import Array, Complex
from windsysid.checks.limits import (
    FALSE_ALARM_PROBABILITY,
    MAX_MISSING_SHARE,
    MIN_LONG_RECORD_BINS,
    MIN_VIBRATION_BINS,
    SHORT_NOISE_VIBRATION_PROBABILITY,
)
from windsysid.checks.lines import may_be_no_line

__all__ = ["find_still", "is_constant"]

MAX_CONSTANT_SPREAD = 1e-12
"""Numerical: range of a constant channel over its largest value, from rounding in the conversion of its unit."""

FREQUENCY_RANGE_FACTOR = 2.0
"""Setting: factor below the lowest and above the highest natural frequency to which vibration is searched."""

WIDEST_WINDOW_DIVISOR = 2
"""Setting: number of frequency bins over that of the widest window."""

COHERENCE_BINS = 8
"""Setting: number of neighbouring frequency bins over which phase differences are averaged: four independent ones."""


def is_constant(values: Array) -> bool:
    """Test whether all finite readings (T,) are equal."""
    return float(np.ptp(values)) <= MAX_CONSTANT_SPREAD * float(np.abs(values).max())


def find_still(
    readings: Array, channels: Sequence[str], *, rate: float, frequencies: Sequence[float], rotor_hz: float,
    innovations: Array | None = None, apart: Array | None = None,
) -> tuple[str, ...]:  # fmt: skip
    """The channels of readings (T, m), sampled at `rate` [Hz], that are nothing but noise around the natural
    `frequencies` [Hz] of a machine whose rotor turns at `rotor_hz`; in a short record those whose `innovations` (T, m)
    are no smaller than of noise. Channels `apart` (m, m) have no motion in common, and one may be a copy in the other
    by crosstalk only."""
    if not frequencies:
        return ()
    missing = ~np.isfinite(readings)
    mean = np.where(missing, 0.0, readings).sum(axis=0) / np.maximum((~missing).sum(axis=0), 1)
    window = np.hanning(len(readings))[:, None]
    values = np.fft.rfft(np.where(missing, 0.0, readings - mean) * window, axis=0)
    f = np.asarray(np.fft.rfftfreq(len(readings), 1.0 / rate), dtype=np.float64)
    highest = min(FREQUENCY_RANGE_FACTOR * max(frequencies), 0.45 * rate)
    there = (f > min(frequencies) / FREQUENCY_RANGE_FACTOR) & (f < highest)
    there &= ~may_be_no_line(f, (), rotor_hz, rate / len(readings))
    own = values
    if apart is not None:  # from samples that all channels have, since a copy has the gaps of its source
        read = missing.mean(axis=0) <= MAX_MISSING_SHARE
        gone = missing[:, read].any(axis=1, keepdims=True)
        centred = np.where(gone | ~read, 0.0, readings - mean)
        common = np.fft.rfft(centred * window, axis=0)
        gains = _crosstalk(common[there], np.logical_and(apart, read))
        readings = np.where(gone, np.nan, readings - centred @ gains.real.T)
        own = np.where(read, common - common @ gains.T, values)
    power = np.abs(own) ** 2
    if there.sum() < MIN_VIBRATION_BINS:
        pairs = [] if innovations is None else list(zip(channels, readings.T, innovations.T, strict=True))
        return tuple(channel for channel, x, e in pairs if _likelihood_ratio(x, e) < 1.0 / FALSE_ALARM_PROBABILITY)
    clear = there.sum() >= MIN_LONG_RECORD_BINS and highest == FREQUENCY_RANGE_FACTOR * max(frequencies)
    chance = FALSE_ALARM_PROBABILITY if clear else SHORT_NOISE_VIBRATION_PROBABILITY
    asked = np.flatnonzero((missing.mean(axis=0) <= MAX_MISSING_SHARE) & (power[there].max(axis=0) > 0.0)).tolist()
    alive = [i for i in asked if _stands_out(_levelled(f[there], power[there, i]), chance)]
    phases, others = (x[there] / np.maximum(np.abs(x[there]), 1e-300) for x in (own, values[:, alive]))
    return tuple(channels[i] for i in asked if i not in alive and not _is_coherent(phases[:, i], others))


def _crosstalk(values: Complex, apart: Array) -> Complex:
    """Gains (m, m) at which channels have a copy of the one `apart` from them that explains most of their Fourier
    coefficients (n, m): of a delay, too, near one frequency."""
    products = values.T @ values.conj()
    power = np.maximum(np.diag(products).real, 1e-300)
    gains = np.where(np.logical_and(apart, np.abs(products) < power), products / power, 0.0)
    explained = np.abs(gains) ** 2 * power
    return np.asarray(np.where(explained == explained.max(axis=1, keepdims=True), gains, 0.0))


def _likelihood_ratio(readings: Array, innovations: Array) -> float:
    """Likelihood of a fit's innovations (T,) over that of the residuals of a first-order autoregression, up to e¹⁰⁰."""
    x = readings - np.nanmean(readings)
    known = np.isfinite(x[1:]) & np.isfinite(x[:-1]) & np.isfinite(innovations[1:])
    before, x, e = x[:-1][known], x[1:][known], innovations[1:][known]
    if not (before @ before > 0.0 and e @ e > 0.0):
        return np.inf
    left = x - before * (before @ x) / (before @ before)
    return float(np.exp(min(0.5 * len(x) * np.log((left @ left) / (e @ e)), 100.0)))


def _levelled(f: Array, power: Array) -> Array:
    """Power (n,) at f (n,) [Hz] over the power law that it follows."""
    slope = np.polyfit(np.log(f), np.log(np.maximum(power, 1e-30 * power.max())), 1)[0]
    return np.asarray(power / f**slope)


def _stands_out(power: Array, chance: float) -> bool:
    """Test whether a window of neighbouring frequencies (n,) exceeds the level of noise by more than chance."""
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


def _is_coherent(phases: Complex, others: Complex) -> bool:
    """Test whether phases exp iφ (n,) are bound to those of one of the other channels (n, m) more than by chance;
    neighbouring phase differences are correlated as the product of both channels' correlations."""
    from scipy.special import gammaincc

    windows, lags = len(phases) // COHERENCE_BINS, np.arange(1, COHERENCE_BINS)
    across = (phases[:, None] * others.conj())[: windows * COHERENCE_BINS].reshape(windows, COHERENCE_BINS, -1)
    one, other = ([(x[i:] * x[:-i].conj()).mean(axis=0) for i in lags] for x in (phases[:, None], others))
    alike = 1.0 + 2.0 * (1.0 - lags / COHERENCE_BINS) @ np.real(np.multiply(one, np.conj(other)))
    independent = COHERENCE_BINS / np.maximum(alike, COHERENCE_BINS / _shape(COHERENCE_BINS))
    statistic = (1.0 - independent) * np.log(np.maximum(1.0 - np.abs(across.mean(axis=1)) ** 2, 1e-12)).sum(axis=0)
    return bool((gammaincc(windows, statistic) * others.shape[1] < FALSE_ALARM_PROBABILITY).any())


def _shape(width: int) -> float:
    """Number of independent frequencies among so many neighbours under Hann's window."""
    return width / (1.0 + (8.0 / 9.0) * (width - 1) / width + max(width - 2, 0) / (18.0 * width))

"""Rotor harmonics and other sinusoids: detection and removal.

A rotor's harmonics are taken out of the readings by least squares on its azimuth. Other lines are found by Thomson's F
test (Proc. IEEE 1982, https://doi.org/10.1109/PROC.1982.12433): the same frequency and phase under several orthogonal
tapers, which vibration under a random load does not have.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY
from windsysid.signals.textbook import minimum

__all__ = ["find_lines", "steadiness", "without_harmonics", "without_line"]

MAX_HARMONIC = 30
"""Setting: highest rotor harmonic that is fitted and removed."""

TAPER_COUNT, TAPER_BINS = 7, 4.0
"""Setting: number and half-width [bins] of the tapers of the F test."""

MAX_STATISTIC_LOSS = 3.0
"""Numerical: largest loss in F of a sinusoid between two frequencies of a transform."""

MAX_REFINED = 5
"""Setting: number of candidate sinusoids of a channel that are refined."""


def without_harmonics(values: Array, azimuth: Array) -> Array:
    """Values (T, n) without their mean and components cos kψ, sin kψ of the azimuth ψ (T,) [rad]."""
    samples = len(values)
    step = np.max(np.abs(np.diff(np.unwrap(azimuth))))
    orders = int(min(MAX_HARMONIC, 0.8 * np.pi / max(step, 1e-6), samples // 20))
    left = values - values.mean(axis=0)
    if orders < 1:
        return np.asarray(left)
    phase = np.exp(1j * np.outer(azimuth, np.arange(1, orders + 1)))
    design = np.column_stack([np.ones(samples), phase.real, phase.imag])
    return np.asarray(left - design @ np.linalg.solve(design.T @ design, design.T @ left), dtype=np.float64)


def find_lines(values: Array, rate: float, low: float, high: float) -> list[float]:
    """Frequencies [Hz] between two others at which values (T, n) have a steady sine."""
    from scipy.fft import next_fast_len, rfft
    from scipy.ndimage import maximum_filter1d

    samples, channels = values.shape
    tapers, sums = _tapers(samples)
    size = next_fast_len(2 * samples, real=True)
    frequency = np.arange(size // 2 + 1) * rate / size
    inside = (frequency > low) & (frequency < high)
    found: list[tuple[float, float]] = []
    chance = FALSE_ALARM_PROBABILITY / max(1, samples // 2 * channels)
    limit = (TAPER_COUNT - 1) * (chance ** (-1.0 / (TAPER_COUNT - 1)) - 1.0)  # of F with 2 and 2 (TAPERS − 1) degrees
    for column in values.T:
        ratio = _ratio(np.array([rfft(taper * column, size)[inside] for taper in tapers]), sums)
        peaks = np.flatnonzero((ratio > limit / MAX_STATISTIC_LOSS) & (ratio == maximum_filter1d(ratio, 5)))
        for i in peaks[np.argsort(ratio[peaks])[::-1][:MAX_REFINED]]:
            near = frequency[inside][i] + rate / size * np.linspace(-0.5, 0.5, 9)  # a line between bins is seen less
            fine = np.array([steadiness(column, rate, f) for f in near])
            if fine.max() > limit:
                found.append((float(fine.max()), float(near[np.argmax(fine)])))
    lines: list[float] = []
    for _, f in sorted(found, reverse=True):
        if all(abs(f - other) > 2.0 * rate / samples for other in lines):
            lines.append(f)
    return sorted(lines)


def without_line(values: Array, rate: float, frequency: float) -> Array:
    """Values (T, n) without a sine near a frequency [Hz], its own frequency by least squares."""
    samples = len(values)
    time = np.arange(samples) / rate

    def fitted(f: float) -> Array:
        wave = np.exp(2j * np.pi * f * time)
        design = np.column_stack([wave.real, wave.imag])
        return np.asarray(design @ np.linalg.solve(design.T @ design, design.T @ values))

    scale = 1.0 / np.maximum(values.std(axis=0), 1e-300)
    step = rate / samples
    found = minimum(
        lambda f: -float(np.sum((fitted(f) * scale) ** 2)), frequency - 0.5 * step, frequency + 0.5 * step, 1e-3 * step
    )
    return np.asarray(values - fitted(found))


def steadiness(values: Array, rate: float, frequency: float) -> float:
    """Thomson's F of a steady sine at a frequency [Hz] of values (T,): some 1 without one, of white noise beyond 40 at
    one frequency in 200 000."""
    tapers, sums = _tapers(len(values))
    shifted = values * np.exp(-2j * np.pi * frequency * np.arange(len(values)) / rate)
    return float(_ratio((tapers @ shifted.real + 1j * (tapers @ shifted.imag))[:, None], sums)[0])


def _ratio(spectra: Complex, sums: Array) -> Array:
    """The F statistic (F,) of tapered transforms (TAPERS, F)."""
    mean = sums @ spectra / (sums @ sums)
    left = sum(np.abs(one - total * mean) ** 2 for one, total in zip(spectra, sums, strict=True))
    return np.asarray((TAPER_COUNT - 1) * np.abs(mean) ** 2 * (sums @ sums) / np.maximum(left, 1e-300))


@lru_cache(maxsize=4)
def _tapers(samples: int) -> tuple[NDArray[np.float64], Array]:
    """Slepian tapers (TAPERS, T), long ones interpolated, and their sums."""
    from scipy.linalg import eigh_tridiagonal

    most = 8192
    size = min(samples, most)
    index = np.arange(size)
    centre = (0.5 * (size - 1) - index) ** 2 * np.cos(2.0 * np.pi * TAPER_BINS / size)
    beside = 0.5 * index[1:] * (size - index[1:])
    _, columns = eigh_tridiagonal(centre, beside, select="i", select_range=(size - TAPER_COUNT, size - 1))
    short = columns.T[::-1]
    if samples > most:
        at = np.linspace(0.0, most - 1.0, samples)
        short = np.array([np.interp(at, np.arange(most), taper) for taper in short])
    tapers = short / np.linalg.norm(short, axis=1, keepdims=True)
    return tapers, tapers.sum(axis=1)

"""Start of the search in free decays: the instant of release, and candidate modes.

Candidates come from the eigensystem realization algorithm (Juang & Pappa, J. Guidance 8(5), 1985,
https://doi.org/10.2514/3.20031) and from the peak of the residual's spectrum.
"""

from collections.abc import Sequence

import numpy as np

from windsysid._types import Array
from windsysid.modal.decays.likelihood import Decay, DecayFit
from windsysid.modal.decays.limits import (
    ENERGY_WINDOWS,
    MAX_DAMPING,
    MAX_MODES,
    MIN_CYCLES,
    MIN_NOISE,
    MIN_RATE_FACTOR,
    MIN_SAMPLES,
    MIN_WINDOW,
    PEAK_PROBABILITY,
)
from windsysid.spectral.oma.limits import MAX_FREQUENCY_SHARE

__all__ = ["AVERAGED_BINS", "highest_peak", "realized_modes", "reduced", "release", "residual_modes"]

MAX_ROWS, MAX_COLUMNS = 240, 800
"""Numerical: largest size of the block Hankel matrix."""

AVERAGED_BINS, MEDIAN_BLOCKS = 9, 101
"""Setting: bins of a periodogram that are averaged, and averages around each whose median is its background."""

FILTER_LENGTHS = 20
"""Numerical: length of the filter of a slower rate, in samples of that rate; flat up to 0.4 of it."""

START_DAMPING = (0.003, 0.01, 0.04)
"""Setting: damping ratios from which a mode at a peak is sought."""


def release(values: Array) -> int:
    """Index of the sample from which readings (T, n) may be a free decay: after the window with most energy.

    The energy is that of differences, so that a static pull before the release does not count.

    Examples
    --------
    >>> t = np.arange(4000) / 50.0
    >>> pulled = np.where(t < 20.0, 1.0, np.exp(-0.1 * (t - 20.0)) * np.cos(9.0 * (t - 20.0)))
    >>> 990 < release(pulled[:, None]) < 1040
    True
    """
    moved = np.diff(values, axis=0)
    moved /= np.maximum(np.sqrt(np.mean(moved**2, axis=0)), 1e-300)
    size = max(MIN_WINDOW, len(values) // ENERGY_WINDOWS)
    energy = np.convolve(np.sum(moved**2, axis=1), np.ones(size), mode="valid")
    return int(np.argmax(energy)) + size // 2


def highest_peak(decay: Decay) -> float:
    """Highest frequency [Hz] at which vibration stands out of the noise; 0 where none does.

    The background is the median of averaged periodograms around; noise below the smallest believed one hides peaks.

    Examples
    --------
    >>> t = np.arange(3000) / 50.0
    >>> swing = np.exp(-0.1 * t) * np.cos(9.0 * t) + 0.01 * np.random.default_rng(0).normal(size=3000)
    >>> 1.4 < highest_peak(Decay(swing[:, None], 50.0)) < 10.0
    True
    """
    from scipy.ndimage import median_filter
    from scipy.special import gdtrix

    samples = len(decay.values)
    values = decay.values - decay.values.mean(axis=0)
    power = np.abs(np.fft.rfft(values, axis=0)[1:]) ** 2 + MIN_NOISE**2 * samples * np.var(values, axis=0) + 1e-300
    blocks = len(power) // AVERAGED_BINS
    mean = power[: blocks * AVERAGED_BINS].reshape(blocks, AVERAGED_BINS, -1).mean(axis=1)
    over = mean / median_filter(mean, size=(MEDIAN_BLOCKS, 1), mode="nearest")
    bound = gdtrix(AVERAGED_BINS, AVERAGED_BINS, 1.0 - PEAK_PROBABILITY / max(over.size, 1))
    found = np.flatnonzero((over > bound).any(axis=1))
    return float((found[-1] + 1) * AVERAGED_BINS * decay.rate / samples) if len(found) else 0.0


def reduced(decay: Decay, highest: float) -> tuple[Decay, float]:
    """Decay at the lowest rate at which a frequency [Hz] is well sampled, and the time [s] by which it begins later.

    A low-pass filter of constant delay multiplies a damped sinusoid by a constant; frequency and damping ratio stay.
    """
    from scipy.signal import firwin, oaconvolve

    every = int(decay.rate / (MIN_RATE_FACTOR * highest)) if highest > 0.0 else 1
    length = FILTER_LENGTHS * every + 1
    if every < 2 or len(decay.values) < length + every * MIN_SAMPLES:
        return decay, 0.0
    kept = oaconvolve(decay.values, firwin(length, 1.0 / every)[:, None], mode="valid", axes=0)[::every]
    return Decay(kept, decay.rate / every), (length // 2) / decay.rate


def realized_modes(decay: Decay, highest: float) -> list[tuple[float, float]]:
    """Frequencies [Hz] and damping ratios of modes up to a frequency [Hz], by the eigensystem realization algorithm."""
    stride = max(1, int(decay.rate / (2.5 * highest)))
    values = decay.values - decay.values.mean(axis=0)
    values = values / np.maximum(np.sqrt(np.mean(values**2, axis=0)), 1e-300)
    samples, n = values.shape
    rows = max(2, min(MAX_ROWS // n, samples // (2 * stride)))
    columns = min(MAX_COLUMNS, samples - (rows + 1) * stride)
    if columns < 8:
        return []
    first = np.round(np.linspace(0, samples - (rows + 1) * stride - 1, columns)).astype(int)
    index = stride * np.arange(rows)[:, None] + first
    before, after = (values[index + shift].transpose(0, 2, 1).reshape(rows * n, columns) for shift in (0, stride))
    u, s, vt = np.linalg.svd(before, full_matrices=False)
    order = min(2 * MAX_MODES, int(np.sum(s > 1e-10 * s[0])))
    root = 1.0 / np.sqrt(s[:order])
    turned = np.linalg.eigvals(root[:, None] * (u[:, :order].T @ after @ vt[:order].T) * root)
    pole = np.log(turned[np.abs(turned) > 1e-12].astype(np.complex128)) * decay.rate / stride
    pole = pole[pole.imag > 0.0]
    found = [(float(np.abs(p) / (2.0 * np.pi)), float(-p.real / np.abs(p))) for p in pole]
    return [(f, z) for f, z in found if 0.0 < z < MAX_DAMPING]


def residual_modes(fit: DecayFit, decays: Sequence[Decay]) -> list[tuple[float, float]]:
    """Frequency [Hz] of the highest peak of the residuals' spectra, with some damping ratios."""
    found: list[tuple[float, float]] = []
    for one, decay in zip(fit.records, decays, strict=True):
        samples = len(one.residual)
        power = np.sum(np.abs(np.fft.rfft(one.residual, 2 * samples, axis=0)) ** 2 / one.noise, axis=1)
        frequency = np.arange(len(power)) * decay.rate / (2 * samples)
        inside = (frequency > MIN_CYCLES * decay.rate / samples) & (frequency < MAX_FREQUENCY_SHARE * decay.rate)
        if inside.any():
            peak = float(frequency[int(np.argmax(np.where(inside, power, 0.0)))])
            found += [(peak, z) for z in START_DAMPING]
    return found

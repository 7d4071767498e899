"""Search for the peaks of a turning rotor's modes within a few standard deviations of the prior.

A mode at F multiplies the spectrum around it by a resonance. For every F the gain in likelihood of one resonance over
what is there without is

    L(F) = max_a Σ [P/S₀ − P/S₁ − ln (S₁/S₀)] N / c_h,      S₁ = S₀ (1 + a / ((1 − r²)² + (2ζr)²)),      r = f/F,

with P the mean power of N blocks of the row, S₀ its running median, and the humps that the wind has at harmonics of the
rotor. One factor on the stiffness of the blades moves all their modes as the model says: the factor that explains the
peaks of all rows is searched together with its prior, then those of the roll and of the support.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import STRONG_LOG_ODDS
from windsysid.errors import RecordError
from windsysid.spectral.rotor_bands.channels import LINE_BINS, bins_between
from windsysid.spectral.rotor_bands.limits import MIN_RIVAL_DISTANCE
from windsysid.spectral.transforms.lifted import Complex
from windsysid.spectral.transforms.rotating_frame import TurnedSpectra

__all__ = ["Trace", "best_of", "trace"]

TRIAL_DAMPING = (0.004, 0.012)
"""Setting: damping ratios of the resonances that are tried."""

FREQUENCY_STEP = 0.0025
"""Setting: relative step between the frequencies that are tried."""

MEDIAN_SHARE, MEDIAN_BINS = 0.15, 8
"""Setting: half-width of the running median: relative, and the smallest number of bins."""

MIN_SAMPLED_PEAK_BINS = 3.0
"""Setting: smallest half-width in bins of a rotationally sampled peak."""

SAMPLED_PEAK_HZ = 0.008
"""Setting: half-width of a rotationally sampled peak [Hz]."""

AMPLITUDE_STEPS = 12
"""Numerical: steps that find an amplitude."""


class Trace(NamedTuple):
    """Gain of a resonance, L [nats] at base frequencies (F,) [Hz]."""

    frequency: Array
    gain: Array

    def at(self, frequency: Array) -> Array:
        """L there; 0 outside."""
        return np.asarray(np.interp(frequency, self.frequency, self.gain, left=0.0, right=0.0))

    def widened(self, reach: float) -> "Trace":
        """The greatest L within a relative reach of each frequency."""
        steps = round(reach / FREQUENCY_STEP)
        padded = np.concatenate([np.zeros(steps), self.gain, np.zeros(steps)])
        return Trace(self.frequency, np.lib.stride_tricks.sliding_window_view(padded, 2 * steps + 1).max(axis=1))

    def peak(self, near: float, reach: float) -> float:
        """The frequency of the greatest gain within a relative reach of one [Hz]."""
        inside = np.flatnonzero(np.abs(np.log(self.frequency / near)) <= reach)
        if not inside.size or self.gain[inside].max() <= 0.0:
            return near
        return float(self.frequency[inside[np.argmax(self.gain[inside])]])


def trace(spectra: TurnedSpectra, rows: Sequence[Complex], humps: int, blades: int, low: float, high: float) -> Trace:
    """L(F) between two frequencies [Hz] of rows (B, g), bins 0, 1 … of the record, which are independent of each other.

    The wind has humps at harmonics n ≡ `humps` (mod N).

    Raises
    ------
    RecordError
        If fewer than `MEDIAN_BINS` bins lie there.
    """
    grid = np.exp(np.arange(math.log(low), math.log(high) + FREQUENCY_STEP, FREQUENCY_STEP))
    margin = 1.0 + 2.0 * MEDIAN_SHARE
    bins = bins_between(spectra, low / margin, high * margin)
    if len(bins) < MEDIAN_BINS:
        wide = high * margin - low / margin
        needed = (MEDIAN_BINS + 2.0 * LINE_BINS * wide / spectra.rotor_hz) / wide
        raise RecordError(
            f"modes between {low:.3g} and {high:.3g} Hz: expected {needed:.3g} s or more to tell them from the rotor's "
            f"harmonics, got {spectra.duration:.3g} s: choose a longer record"
        )
    f = bins / spectra.duration
    gain = np.zeros(len(grid))
    for row in rows:
        power = np.sum(np.abs(row[bins]) ** 2, axis=1) / spectra.blocks
        ratio = power / _median(f, power, spectra)
        ratio /= _humps(f, ratio, spectra, humps, blades)
        gain += np.max([_gains(f, ratio, grid, ratio_of, spectra) for ratio_of in TRIAL_DAMPING], axis=0)
    return Trace(grid, gain)


def best_of(score: Array, at: Array, log_frequency: Array) -> tuple[float, list[float]]:
    """Maximum of the score (S,), and its rivals: other maxima nearly as high, at other places in frequency (S,)."""
    best = int(np.argmax(score))
    summits = [
        i
        for i in range(len(score))
        if score[i] == score[max(i - 2, 0) : i + 3].max()
        and score[i] > score[best] - STRONG_LOG_ODDS
        and abs(log_frequency[i] - log_frequency[best]) > MIN_RIVAL_DISTANCE
    ]
    return float(at[best]), [float(np.exp(log_frequency[i])) for i in summits]


def _median(f: Array, power: Array, spectra: TurnedSpectra) -> Array:
    """The running median as a mean: that of an exponential is ln 2 of it, and that of a mean of N one of a gamma
    distribution."""
    from scipy.special import gammaincinv

    share = float(gammaincinv(spectra.blocks, 0.5)) / spectra.blocks
    out = np.empty(len(f))
    for i, here in enumerate(f):
        reach = max(MEDIAN_SHARE * here, MEDIAN_BINS / spectra.duration)
        a, b = np.searchsorted(f, (here - reach, here + reach))
        out[i] = np.median(power[a:b]) / share
    return out


def _humps(f: Array, ratio: Array, spectra: TurnedSpectra, humps: int, blades: int) -> Array:
    """1 + Σ a_n g_n (F,): the part that rotationally sampled peaks explain."""
    width = max(SAMPLED_PEAK_HZ, MIN_SAMPLED_PEAK_BINS / spectra.duration)
    first, last = math.floor(f[0] / spectra.rotor_hz), math.ceil(f[-1] / spectra.rotor_hz)
    orders = [n for n in range(first, last + 1) if (n - humps) % blades == 0]
    if not orders:
        return np.ones(len(f))
    shapes = (1.0 + np.abs(f - np.array(orders)[:, None] * spectra.rotor_hz) / width) ** (-5.0 / 3.0)
    amplitude = np.ones(len(orders))
    for _ in range(4 * AMPLITUDE_STEPS):  # multiplicative steps, which keep amplitudes positive
        S = 1.0 + amplitude @ shapes
        amplitude *= (shapes @ (ratio / S**2)) / (shapes @ (1.0 / S))
    return np.asarray(1.0 + amplitude @ shapes)


def _gains(f: Array, ratio: Array, grid: Array, damping: float, spectra: TurnedSpectra) -> Array:
    """L on a grid of frequencies, for one damping ratio."""
    wide = np.maximum(damping, 0.6 / (grid * spectra.duration))
    r = f / grid[:, None]
    shape = 4.0 * wide[:, None] ** 2 / ((1.0 - r**2) ** 2 + (2.0 * wide[:, None] * r) ** 2)
    near = np.abs(np.log(r)) < MEDIAN_SHARE
    shape = np.where(near, shape, 0.0)
    amplitude = np.ones(len(grid))
    for _ in range(AMPLITUDE_STEPS):
        S = 1.0 + amplitude[:, None] * shape
        amplitude *= np.sum(shape * ratio / S**2, axis=1) / np.maximum(np.sum(shape / S, axis=1), 1e-300)
    S = 1.0 + amplitude[:, None] * shape
    return np.asarray(np.maximum(np.sum(ratio - ratio / S - np.log(S), axis=1) * spectra.blocks / spectra.overlap, 0.0))

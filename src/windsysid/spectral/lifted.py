"""The lifted spectrum of a record: what belongs together at f, f ± Ω, f ± 2Ω … as one vector.

A linear rotor that turns steadily has coefficients of period 2π in azimuth. A motion at the frequency f therefore comes
with motions at f + kΩ, k = ±1, ±2 …, and with no others. The vector of the readings' Fourier coefficients at those
frequencies,

    Y_k(b) = √(Δt / Σ h²) Σ_t h(t) y(t) exp(−2πi b t / T − i k ψ(t)),      k = −K … K,

holds everything once for base frequencies b/T in (0, Ω/2), and is independent from one base bin b to the next: a
complex Gaussian vector of mean 0 whose covariance is the two-sided spectral density [unit²/Hz] (Wereley, PhD thesis,
MIT 1991, for harmonic transfer functions). The taper h keeps what is loud at one frequency away from others; it makes
neighbouring bins alike, so that N of them count as N / c_h, c_h = T Σ h⁴ / (Σ h²)².

What repeats in every turn (weight, tower shadow, mean wind) is no random load: the harmonics of the azimuth are fitted
by least squares and subtracted. Where nothing turns, or no coefficient depends on the azimuth, K = 0 and the base
frequencies reach to half the sampling rate.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.spectral.dft import taper, taper_factor

__all__ = ["Complex", "Lifted", "lift", "turn_lines"]

Complex = NDArray[np.complex128]

FIRST_BIN = 2
"""Lowest base bin in use: nearer to the lines nP their fit has taken out what is random too."""

MOST_LINES = 30
"""Highest harmonic of the rotor that is fitted."""

NYQUIST_SHARE = 0.8
"""Of half the sampling rate: no frequency above it is used, and no line."""


class Lifted(NamedTuple):
    """The lifted spectrum of a record.

    Attributes
    ----------
    data
        Y (B, 2K + 1, m): base bins, harmonics −K … K, readings [unit / √Hz].
    base
        Base frequencies b/T (B,) [Hz].
    harmonics
        −K … K (2K + 1,).
    rotor_hz
        Ω / 2π [Hz].
    overlap
        c_h ≥ 1: how many bins count as one.
    taper
        h (T,), for the spectral window.
    duration
        T [s].
    rate
        [Hz].
    """

    data: Complex
    base: Array
    harmonics: NDArray[np.intp]
    rotor_hz: float
    overlap: float
    taper: Array
    duration: float
    rate: float

    @property
    def frequency(self) -> Array:
        """Signed frequency of every entry (B, 2K + 1) [Hz]."""
        return np.asarray(self.base[:, None] + self.rotor_hz * self.harmonics)


def turn_lines(rotor_hz: float, rate: float) -> int:
    """How many harmonics of the rotor are fitted."""
    return 0 if rotor_hz <= 0.0 else min(MOST_LINES, int(0.5 * NYQUIST_SHARE * rate / rotor_hz))


def lift(readings: Array, azimuth: Array, rate: float, harmonics: int) -> Lifted:
    """The lifted spectrum of readings (T, m) without gaps, sampled at `rate` [Hz] while the rotor was at `azimuth` (T,)
    [rad, unwrapped].

    `harmonics` is K; with K = 0 the base frequencies reach to half the rate. A turning rotor is taken over a whole
    number of turns.
    """
    turned = float(azimuth[-1] - azimuth[0]) / (2.0 * math.pi) * len(azimuth) / (len(azimuth) - 1)
    turns = math.floor(turned + 1e-6)
    if harmonics:
        samples = min(len(azimuth), round(len(azimuth) * turns / turned))
        readings, azimuth = readings[:samples], azimuth[:samples]
    samples = len(azimuth)
    duration = samples / rate
    rotor_hz = turns / duration if harmonics else abs(turned) / duration
    h = taper(samples)
    quiet = _without_lines(readings, azimuth, h, turn_lines(rotor_hz, rate)) * h[:, None]
    last = (turns - 1) // 2 if harmonics else int(0.5 * NYQUIST_SHARE * samples)
    bins = np.arange(FIRST_BIN, last + 1)
    orders = np.arange(-harmonics, harmonics + 1)
    data = np.empty((len(bins), len(orders), readings.shape[1]), dtype=np.complex128)
    slip = np.exp(-1j * (azimuth - azimuth[0] - 2.0 * math.pi * rotor_hz * np.arange(samples) / rate))
    start = np.exp(-1j * azimuth[0])
    scale = math.sqrt(1.0 / rate / float(h @ h))
    for j, k in enumerate(orders):
        # exp(−ikψ) = exp(−ikψ₀) · slip^k · exp(−ik Ω t), and the last factor moves the transform by k turns' bins
        whole = np.fft.fft(quiet * (slip**k)[:, None] if k else quiet, axis=0)
        data[:, j] = scale * start**k * whole[(bins + k * turns if harmonics else bins) % samples]
    return Lifted(data, bins / duration, orders, rotor_hz, taper_factor(samples), h, duration, rate)


def _without_lines(readings: Array, azimuth: Array, taper: Array, lines: int) -> Array:
    """The readings without their mean and what repeats in every turn, fitted under the taper."""
    columns = [np.ones_like(azimuth)]
    for k in range(1, lines + 1):
        columns += [np.cos(k * azimuth), np.sin(k * azimuth)]
    basis = np.column_stack(columns)
    weighted = basis * taper[:, None]
    fitted = np.linalg.solve(weighted.T @ weighted, weighted.T @ (readings * taper[:, None]))
    return np.asarray(readings - basis @ fitted)

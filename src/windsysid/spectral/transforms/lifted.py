"""Lifted spectrum of a record: the components at f, f ± Ω, f ± 2Ω … as one vector.

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
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.kernels.jit import compiled
from windsysid.spectral.transforms.dft import taper, taper_factor
from windsysid.spectral.transforms.harmonics import MAX_HARMONIC

__all__ = ["FIRST_BIN", "MIN_LINE_TURNS", "Complex", "Lifted", "count_harmonics", "lift", "without_rotor_harmonics"]

Complex = NDArray[np.complex128]

FIRST_BIN = 2
"""Setting: lowest base bin in use: the fit of harmonics nP removes random power below."""

NYQUIST_SHARE = 0.8
"""Setting: highest frequency in use, harmonics included, over half the sampling rate."""

LANES = 64
"""Numerical: samples that are processed in parallel."""

MIN_LINE_TURNS = 10.0
"""Setting: turns in a record below which rotor harmonics are kept: between those of an idling rotor no bin is left."""


class Lifted(NamedTuple):
    """The lifted spectrum of a record.

    Attributes
    ----------
    data
        Y (B, 2K + 1, m): base bins, harmonics −K … K, readings [unit / √Hz].
    base, harmonics
        Base frequencies b/T (B,) [Hz], and −K … K (2K + 1,).
    rotor_hz, rate, duration
        Ω / 2π [Hz], rate [Hz] and T [s].
    overlap, taper
        c_h ≥ 1: how many bins count as one; h (T,), for the spectral window.
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

    @property
    def vectors(self) -> Complex:
        """Y of all harmonics and readings in one row (B, (2K + 1) m)."""
        return self.data.reshape(len(self.data), -1)

    @property
    def energies(self) -> Array:
        """Mean square of every reading (m,) [unit²/Hz]."""
        return np.asarray(np.mean(np.abs(self.data) ** 2, axis=(0, 1)))

    @property
    def independent(self) -> Array:
        """The number of base bins, for every reading (m,)."""
        return np.full(self.data.shape[2], float(len(self.data)))

    def averaged(self, before: "Lifted", share: float) -> "Lifted":
        """The spectrum at mean frequencies: those of earlier blocks, moved by a share towards its own."""
        return self._replace(
            base=before.base + share * (self.base - before.base),
            rotor_hz=before.rotor_hz + share * (self.rotor_hz - before.rotor_hz),
        )


def count_harmonics(rotor_hz: float, rate: float) -> int:
    """The number of harmonics of the rotor that are fitted."""
    return 0 if rotor_hz <= 0.0 else min(MAX_HARMONIC, int(0.5 * NYQUIST_SHARE * rate / rotor_hz))


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
    lines = count_harmonics(rotor_hz, rate) if harmonics or abs(turned) >= MIN_LINE_TURNS else 0
    quiet = without_rotor_harmonics(readings, azimuth, h, lines) * h[:, None]
    last = (turns - 1) // 2 if harmonics else int(0.5 * NYQUIST_SHARE * samples)
    bins = np.arange(FIRST_BIN, last + 1)
    orders = np.arange(-harmonics, harmonics + 1)
    data = np.empty((len(bins), len(orders), readings.shape[1]), dtype=np.complex128)
    if harmonics:
        slip = np.exp(-1j * (azimuth - azimuth[0] - 2.0 * math.pi * rotor_hz * np.arange(samples) / rate))
    start = np.exp(-1j * azimuth[0])
    scale = math.sqrt(1.0 / rate / float(h @ h))
    for j, k in enumerate(orders[harmonics:], harmonics):
        # exp(−ikψ) = exp(−ikψ₀) · slip^k · exp(−ik Ω t), and the last factor moves the transform by k turns' bins
        whole = np.fft.fft(quiet * (slip**k)[:, None], axis=0) if k else np.fft.rfft(quiet, axis=0)
        data[:, j] = scale * start**k * whole[(bins + k * turns if harmonics else bins) % samples]
        if k:  # readings are real: that of −k is the complex conjugate at −f
            data[:, harmonics - k] = (scale * start**k * whole[(k * turns - bins) % samples]).conj()
    return Lifted(data, bins / duration, orders, rotor_hz, taper_factor(samples), h, duration, rate)


def without_rotor_harmonics(readings: Array, azimuth: Array, taper: Array, lines: int) -> Array:
    """Subtract the mean and the harmonics of the rotor from readings (T, m), fitted under the taper (T,).

    Σ_k c_k e^{ikψ} is fitted: the normal equations hold the sums of h² e^{−ijψ} only, j = 0 … 2 `lines`.
    """
    readings, weights = np.ascontiguousarray(readings, dtype=np.float64), taper**2
    across, along = np.zeros((2 * lines + 1, 2, LANES)), np.zeros((lines + 1, readings.shape[1], 2, LANES))
    add_up, take_out = _kernels()
    azimuth = np.ascontiguousarray(azimuth, dtype=np.float64)
    add_up(readings, azimuth, weights, across, along)
    sums, seen = (real + 1j * imag for real, imag in (np.moveaxis(a.sum(axis=-1), -1, 0) for a in (across, along)))
    order = np.arange(-lines, lines + 1)
    apart = order[:, None] - order
    gram = np.where(apart >= 0, sums[np.abs(apart)], sums[np.abs(apart)].conj())
    fitted = np.linalg.solve(gram, np.concatenate([seen[:0:-1].conj(), seen]))
    coefficients = np.ascontiguousarray(fitted[lines:])
    coefficients[1:] *= 2.0  # k and −k together are twice the real part
    out = np.empty_like(readings)
    take_out(readings, azimuth, coefficients, out)
    return out


@lru_cache(maxsize=1)
def _kernels() -> tuple[Any, Any]:
    """The compiled loops of `without_rotor_harmonics`."""
    vector, matrix, complex_matrix = types.float64[::1], types.float64[:, ::1], types.complex128[:, ::1]
    sums, products = types.float64[:, :, ::1], types.float64[:, :, :, ::1]
    return (
        compiled(_add_up, types.void(matrix, vector, vector, sums, products)),
        compiled(_take_out, types.void(matrix, vector, complex_matrix, matrix)),
    )


def _add_up(readings: Any, azimuth: Any, weights: Any, across: Any, along: Any) -> None:
    """Σ h² e^{−ijψ} (2 lines + 1, 2, LANES) and Σ h² y e^{−ikψ} (lines + 1, m, 2, LANES), real and imaginary parts, of
    every `LANES`-th sample."""
    lines, m = along.shape[0] - 1, readings.shape[1]
    c, s, a, b = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    y = np.zeros((m, LANES))
    for first in range(0, len(azimuth), LANES):
        a[:], b[:] = 0.0, 0.0
        for lane in range(min(LANES, len(azimuth) - first)):
            c[lane], s[lane] = math.cos(azimuth[first + lane]), -math.sin(azimuth[first + lane])
            a[lane] = weights[first + lane]
            for i in range(m):
                y[i, lane] = readings[first + lane, i]
        for j in range(2 * lines + 1):
            if j <= lines:
                for i in range(m):
                    for lane in range(LANES):
                        along[j, i, 0, lane] += a[lane] * y[i, lane]
                        along[j, i, 1, lane] += b[lane] * y[i, lane]
            for lane in range(LANES):
                across[j, 0, lane] += a[lane]
                across[j, 1, lane] += b[lane]
                next_a = a[lane] * c[lane] - b[lane] * s[lane]
                b[lane] = a[lane] * s[lane] + b[lane] * c[lane]
                a[lane] = next_a


def _take_out(readings: Any, azimuth: Any, coefficients: Any, out: Any) -> None:
    """Readings less Re Σ c_k e^{ikψ}, k = 0 … lines, by Horner's rule, `LANES` samples side by side."""
    highest, m = coefficients.shape[0] - 1, readings.shape[1]
    c, s, a, b = np.zeros(LANES), np.zeros(LANES), np.zeros(LANES), np.zeros(LANES)
    for first in range(0, len(azimuth), LANES):
        many = min(LANES, len(azimuth) - first)
        for lane in range(many):
            c[lane], s[lane] = math.cos(azimuth[first + lane]), math.sin(azimuth[first + lane])
        for i in range(m):
            a[:], b[:] = coefficients[highest, i].real, coefficients[highest, i].imag
            for k in range(highest - 1, -1, -1):
                real, imag = coefficients[k, i].real, coefficients[k, i].imag
                for lane in range(LANES):
                    next_a = a[lane] * c[lane] - b[lane] * s[lane] + real
                    b[lane] = a[lane] * s[lane] + b[lane] * c[lane] + imag
                    a[lane] = next_a
            for lane in range(many):
                out[first + lane, i] = readings[first + lane, i] - a[lane]

"""Tapered Fourier transforms of readings, and what a taper does to a spectrum.

A stationary record y (T, n) of rate 1/Δ has at the frequencies k/(TΔ) the transform

    Y_k = √(2Δ / Σ h²) Σ_t h_t y_t exp(−2πi k t / T),        h: a cosine taper (Tukey, one tenth).

Y_k is complex Gaussian with the covariance S̄(f_k), the one-sided spectrum S [unit²/Hz] convolved with the taper's
window |Σ h exp|². A lightly damped mode of a short record is as narrow as that window: comparing |Y|² with S̄ instead
of S removes the bias (the debiased Whittle likelihood: Sykulski et al., Biometrika 2019,
https://doi.org/10.1093/biomet/asy071). Neighbouring Y_k are slightly correlated; the likelihood of all of them is too
sharp by the factor c_h = T Σh⁴/(Σh²)².
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex

__all__ = ["TAPERED", "Band", "band_data", "taper", "taper_factor", "transform", "window_matrix"]

TAPERED = 0.1
"""Share of the record over which the taper rises and falls."""

WINDOW_REACH = 24
"""Bins to either side over which the taper's window is summed: what lies beyond is less than a hundredth of it."""

MAX_ROWS = 160
"""Rows of a band's data: neighbouring bins are averaged where there would be more."""


class Band(NamedTuple):
    """The data of one band.

    Attributes
    ----------
    frequency
        (K,) [Hz]: the middle of each row.
    counts
        (K,): bins averaged in each row.
    power
        (K, m, m): mean of Y Yᴴ over the bins of each row.
    fine
        (F,) [Hz]: where the model's spectrum is evaluated.
    window
        (K, F): weights that turn the spectrum at `fine` into its expectation in each row; None where bins are so many
        that it is that spectrum.
    factor
        c_h: the likelihood's exponent is divided by it.
    """

    frequency: Array
    counts: Array
    power: Complex
    fine: Array
    window: Array | None
    factor: float


def taper(samples: int) -> Array:
    """The cosine taper (T,)."""
    from scipy.signal.windows import tukey

    return np.asarray(tukey(samples, TAPERED), dtype=np.float64)


def taper_factor(samples: int) -> float:
    """c_h of the taper."""
    h = taper(samples)
    return float(samples * np.sum(h**4) / np.sum(h**2) ** 2)


def transform(values: NDArray[np.float64] | Complex, rate: float) -> tuple[Array, Complex]:
    """Frequencies (F,) [Hz] and one-sided transforms (F, n) of values (T, n); of complex values the part that turns
    forward."""
    from scipy.fft import fft, rfft

    samples = len(values)
    h = taper(samples)
    tapered = h[:, None] * values
    scale = np.sqrt(2.0 / (rate * np.sum(h**2)))
    found: Any = fft(tapered, axis=0)[: samples // 2 + 1] if np.iscomplexobj(values) else rfft(tapered, axis=0)  # type: ignore[arg-type]
    return np.arange(len(found)) * rate / samples, np.asarray(scale * found, dtype=np.complex128)


def window_matrix(samples: int, rate: float, bins: NDArray[np.int64]) -> tuple[Array, Array]:
    """Frequencies (F,) [Hz] at half bins around `bins` (K,), and the taper's window (K, F) over them, rows summing to
    1."""
    first, last = 2 * (int(bins[0]) - WINDOW_REACH), 2 * (int(bins[-1]) + WINDOW_REACH)
    steps = np.arange(first, last + 1)
    kernel = _window(samples)
    offset = steps[None, :] - 2 * bins[:, None]
    inside = np.abs(offset) <= 2 * WINDOW_REACH
    weight = np.where(inside, kernel[np.abs(np.where(inside, offset, 0))], 0.0)
    frequency = 0.5 * steps * rate / samples
    weight[:, frequency <= 0.0] = 0.0
    weight /= weight.sum(axis=1, keepdims=True)
    used = frequency > 0.0
    return frequency[used], weight[:, used]


def band_data(values: Complex, bins: NDArray[np.int64], samples: int, rate: float) -> Band:
    """The data of transforms (K, m) at the bins (K,), neighbours averaged where there are many.

    Parameters
    ----------
    values
        Transforms at `bins` only.
    bins
        Numbers k of the frequencies k rate / T, rising; lines that were left out are missing.
    samples
        T of the record.
    """
    size = -(-len(bins) // MAX_ROWS)
    starts = np.arange(0, len(bins), size)
    count = np.diff(np.append(starts, len(bins))).astype(np.float64)
    products = values[:, :, None] * values[:, None, :].conj()
    power = np.asarray(np.add.reduceat(products, starts, axis=0) / count[:, None, None], dtype=np.complex128)
    frequency = np.add.reduceat(bins * rate / samples, starts) / count
    fine, window = window_matrix(samples, rate, bins) if size == 1 else (frequency, None)
    return Band(frequency, count, power, fine, window, taper_factor(samples))


def _window(samples: int) -> Array:
    """The taper's window at whole half bins from 0 to twice `WINDOW_REACH`; the same for every length but the
    shortest."""
    h = taper(min(samples, 4096))
    return np.asarray(np.abs(np.fft.fft(h, 2 * len(h))[: 2 * WINDOW_REACH + 1]) ** 2, dtype=np.float64)

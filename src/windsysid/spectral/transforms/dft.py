"""Tapered Fourier transforms of readings, and the effect of a taper on a spectrum.

A stationary record y (T, n) of rate 1/Δ has at the frequencies k/(TΔ) the transform

    Y_k = √(2Δ / Σ h²) Σ_t h_t y_t exp(−2πi k t / T),        h: a cosine taper (Tukey, one tenth).

Y_k is complex Gaussian with the covariance S̄(f_k), the one-sided spectrum S [unit²/Hz] convolved with the taper's
window |Σ h exp|². A lightly damped mode of a short record is as narrow as that window: comparing |Y|² with S̄ instead
of S removes the bias (the debiased Whittle likelihood: Sykulski et al., Biometrika 2019,
https://doi.org/10.1093/biomet/asy071). Neighbouring Y_k are slightly correlated; the likelihood of all of them is too
sharp by the factor c_h = T Σh⁴/(Σh²)².
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.signals.textbook import tukey

__all__ = [
    "TAPERED_SHARE", "WINDOW_BINS", "Band", "band_data", "plain_band", "taper", "taper_factor", "transform",
    "window_weights",
]  # fmt: skip

TAPERED_SHARE = 0.1
"""Setting: share of the record over which the taper rises and falls."""

WINDOW_BINS = 24
"""Numerical: bins on either side over which the taper's window is summed: less than a hundredth of it lies beyond."""

MAX_ROWS = 160
"""Setting: largest number of rows of a band's data; neighbouring bins are averaged if there are more."""


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
    first, window
        (K,), (K, W): the weights that turn the spectrum at `fine` into its expectation in each row, the first of them
        for the frequency `first`; one each where bins are so many that it is that spectrum.
    factor
        c_h: the likelihood's exponent is divided by it.
    """

    frequency: Array
    counts: Array
    power: Complex
    fine: Array
    first: NDArray[np.int64]
    window: Array
    factor: float

    def expected(self, values: Complex) -> Complex:
        """Expectation in the rows (K, …) of a term at `fine` (F, …)."""
        near = values[self.first[:, None] + np.arange(self.window.shape[1])]
        return np.asarray(np.einsum("kw,kw...->k...", self.window, near))


def plain_band(frequency: Array, counts: Array, power: Complex, factor: float) -> Band:
    """A band whose spectrum is compared as it is, without a window."""
    rows = len(counts)
    return Band(frequency, counts, power, frequency, np.arange(rows), np.ones((rows, 1)), factor)


def taper(samples: int) -> Array:
    """The cosine taper (T,), one period of a function that repeats, as the transform takes it."""
    return tukey(samples + 1, TAPERED_SHARE)[:-1]


@lru_cache(maxsize=64)
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


def window_weights(samples: int, rate: float, bins: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64], Array]:
    """Frequencies (F,) [Hz] at half bins around `bins` (K,), and for each bin the taper's window over the (W,) from its
    `first` (K,) on, rows summing to 1."""
    steps = np.arange(2 * (int(bins[0]) - WINDOW_BINS), 2 * (int(bins[-1]) + WINDOW_BINS) + 1)
    first = np.asarray(2 * (bins - bins[0]), dtype=np.int64)
    reach = np.arange(4 * WINDOW_BINS + 1)
    weight = _window(samples)[np.abs(reach - 2 * WINDOW_BINS)] * (steps[first[:, None] + reach] > 0)
    weight /= weight.sum(axis=1, keepdims=True)
    return 0.5 * np.maximum(steps, 1) * rate / samples, first, weight


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
    factor = taper_factor(samples)
    if size > 1:
        return plain_band(frequency, count, power, factor)
    return Band(frequency, count, power, *window_weights(samples, rate, bins), factor)


def _window(samples: int) -> Array:
    """The taper's window at whole half bins from 0 to twice `WINDOW_BINS`; the same for every length but the
    shortest."""
    h = taper(min(samples, 4096))
    return np.asarray(np.abs(np.fft.fft(h, 2 * len(h))[: 2 * WINDOW_BINS + 1]) ** 2, dtype=np.float64)

"""Short textbook forms of some functions of `scipy.signal`, `scipy.optimize` and `scipy.interpolate`.

Importing those takes half a second of processor time, longer than most of the analyses that need these functions.
"""

import math
from collections.abc import Callable

import numpy as np

from windsysid._types import Array

__all__ = ["cubic_spline", "local_parabolas", "minimum", "parabola_weights", "short_spectra", "tukey"]


def short_spectra(values: Array, rate: float, size: int, overlap: int) -> tuple[Array, Array, Array]:
    """Frequencies (F,) [Hz], middles (S,) [s] and one-sided densities (F, S) of overlapping segments of values (T,),
    each without its mean and under a Hann window. Welch's spectrum is their mean (IEEE Trans. AU 15, 1967).

    Examples
    --------
    >>> f, _, density = short_spectra(np.random.default_rng(1).normal(size=50_000), 10.0, 500, 250)
    >>> round(float(np.mean(density.mean(axis=1)[1:-1])), 2)  # white noise of variance 1 over 5 Hz
    0.2
    """
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(size) / size)
    segments = np.lib.stride_tricks.sliding_window_view(values, size)[:: size - overlap]
    tapered = window * (segments - segments.mean(axis=1, keepdims=True))
    power = np.asarray(np.abs(np.fft.rfft(tapered, axis=1)).T ** 2, dtype=np.float64)
    density = power / (rate * np.sum(window**2))
    density[1 : (size + 1) // 2] *= 2.0
    middle = (np.arange(len(segments)) * (size - overlap) + 0.5 * size) / rate
    return np.arange(len(density)) * rate / size, middle, density


def tukey(samples: int, share: float) -> Array:
    """Window (T,) of which half a `share` rises like a cosine and half of it falls (Harris, Proc. IEEE 66, 1978)."""
    index = np.arange(samples)
    edge = np.minimum(index, index[::-1]) / (0.5 * share * (samples - 1))
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.minimum(edge, 1.0)))


def parabola_weights(window: int) -> Array:
    """Weights (3, w) that give the coefficients of a least-squares parabola of w values at −1 … 1 (odd w)."""
    powers = np.vander(np.linspace(-1.0, 1.0, window), 3, increasing=True)
    return np.asarray(np.linalg.pinv(powers), dtype=np.float64)


def local_parabolas(values: Array, window: int, derivative: int = 0, rate: float = 1.0) -> Array:
    """A derivative of values (T,) by least-squares parabolas through the values around each, and through the first and
    last `window` values at the ends (Savitzky & Golay, Anal. Chem. 36, 1964)."""
    from scipy.ndimage import correlate1d

    half, weights = window // 2, parabola_weights(window)
    scale = (rate / half) ** derivative
    smooth = np.asarray(correlate1d(values, math.factorial(derivative) * scale * weights[derivative]))
    at = np.linspace(-1.0, 1.0, window)
    for part, ends in ((slice(window), slice(half)), (slice(-window, None), slice(-half, None))):
        fit = np.polynomial.polynomial.polyder(weights @ values[part], derivative)
        smooth[ends] = scale * np.polynomial.polynomial.polyval(at[ends], fit)
    return smooth


def minimum(function: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Argument of the one minimum of a function between two others, by golden sections (Kiefer, Proc. AMS 4, 1953).

    Examples
    --------
    >>> round(minimum(lambda x: (x - 0.3) ** 2, -1.0, 4.0, 1e-6), 5)
    0.3
    """
    golden = 0.5 * (math.sqrt(5.0) - 1.0)
    left, right = high - golden * (high - low), low + golden * (high - low)
    at_left, at_right = function(left), function(right)
    while high - low > tolerance:
        if at_left < at_right:
            high, right, at_right, left = right, left, at_left, right - golden * (right - low)
            at_left = function(left)
        else:
            low, left, at_left, right = left, right, at_right, left + golden * (high - left)
            at_right = function(right)
    return 0.5 * (low + high)


def cubic_spline(t: Array, y: Array, at: Array) -> Array:
    """Values of the cubic spline through y (T,) at rising t (T,), four or more, whose third derivative has no step at
    the second and the last but one of them (de Boor, A Practical Guide to Splines, ch. IV)."""
    from scipy.linalg import solve_banded

    h, n = np.diff(t), len(t)
    slope, first, last = np.diff(y) / h, t[2] - t[0], t[-1] - t[-3]
    bands = np.zeros((3, n))
    bands[:, 1:-1] = [np.append(first, h[:-2]), 2.0 * (h[:-1] + h[1:]), np.append(h[2:], last)]
    bands[0, -1], bands[1, [0, -1]], bands[2, 0] = h[-2], (h[1], h[-2]), h[1]
    known = np.empty(n)
    known[1:-1] = 3.0 * (h[1:] * slope[:-1] + h[:-1] * slope[1:])
    known[0] = ((h[0] + 2.0 * first) * h[1] * slope[0] + h[0] ** 2 * slope[1]) / first
    known[-1] = (h[-1] ** 2 * slope[-2] + (2.0 * last + h[-1]) * h[-2] * slope[-1]) / last
    d = solve_banded((1, 1), bands, known)
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, n - 2)
    x, bend = at - t[i], (d[:-1] + d[1:] - 2.0 * slope) / h
    return np.asarray(y[i] + x * (d[i] + x * (((slope - d[:-1]) / h - bend)[i] + x * (bend / h)[i])))

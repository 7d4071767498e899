"""Short textbook forms of functions of `scipy.signal`, `optimize` and `interpolate`, which take 0.5 s to import."""

import math
from collections.abc import Callable

import numpy as np

from windsysid._types import Array

__all__ = ["cubic_spline", "local_parabolas", "minimum", "short_spectra", "tukey"]


def short_spectra(values: Array, rate: float, size: int, overlap: int) -> tuple[Array, Array, Array]:
    """Frequencies (F,) [Hz], middles (S,) [s] and one-sided densities (F, S) of overlapping segments of values (T,),
    each without its mean and under a Hann window. Welch's spectrum is their mean (IEEE Trans. AU 15, 1967)."""
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(size) / size)
    segments = np.lib.stride_tricks.sliding_window_view(values, size)[:: size - overlap]
    transforms = np.fft.rfft(window * (segments - segments.mean(axis=1, keepdims=True)), axis=1)
    density = np.asarray(np.abs(transforms.T) ** 2 / (rate * np.sum(window**2)), dtype=np.float64)
    density[1 : (size + 1) // 2] *= 2.0
    middle = np.arange(len(segments)) * ((size - overlap) / rate) + 0.5 * size / rate
    return np.arange(len(density)) * rate / size, np.asarray(middle, dtype=np.float64), density


def tukey(samples: int, share: float) -> Array:
    """Window (T,) of which half a `share` rises like a cosine and half of it falls (Harris, Proc. IEEE 66, 1978)."""
    index = np.arange(samples)
    edge = np.minimum(index, index[::-1]) / (0.5 * share * (samples - 1))
    window, rising = np.ones(samples), edge < 1.0
    window[rising] = 0.5 - 0.5 * np.cos(np.pi * edge[rising])
    return window


def local_parabolas(values: Array, window: int, derivative: int = 0, rate: float = 1.0) -> Array:
    """A derivative of values (T,) by least-squares parabolas through the values around each, and through the first and
    last `window` values at the ends (Savitzky & Golay, Anal. Chem. 36, 1964)."""
    from scipy.ndimage import correlate1d

    at, half = np.linspace(-1.0, 1.0, window), window // 2
    weights = np.linalg.pinv(np.vander(at, 3, increasing=True)) * (rate / half) ** derivative
    smooth = np.asarray(correlate1d(values, math.factorial(derivative) * weights[derivative]), dtype=np.float64)
    for part, ends in ((slice(window), slice(half)), (slice(-window, None), slice(-half, None))):
        fit = np.polynomial.Polynomial(weights @ values[part]).deriv(derivative)
        smooth[ends] = fit(at[ends])
    return smooth


def minimum(function: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Argument of the one minimum of a function between two others, by golden sections (Kiefer, Proc. AMS 4, 1953)."""
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

    h, first, last = np.diff(t), t[2] - t[0], t[-1] - t[-3]
    slope = np.diff(y) / h
    bands = np.zeros((3, len(t)))
    bands[:, 1:-1] = [np.append(first, h[:-2]), 2.0 * (h[:-1] + h[1:]), np.append(h[2:], last)]
    bands[0, -1], bands[1, [0, -1]], bands[2, 0] = h[-2], (h[1], h[-2]), h[1]
    begin = ((h[0] + 2.0 * first) * h[1] * slope[0] + h[0] ** 2 * slope[1]) / first
    end = (h[-1] ** 2 * slope[-2] + (2.0 * last + h[-1]) * h[-2] * slope[-1]) / last
    d = solve_banded((1, 1), bands, np.r_[begin, 3.0 * (h[1:] * slope[:-1] + h[:-1] * slope[1:]), end])
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(h) - 1)
    x, bend = at - t[i], (d[:-1] + d[1:] - 2.0 * slope) / h
    return np.asarray(y[i] + x * (d[i] + x * (((slope - d[:-1]) / h - bend)[i] + x * (bend / h)[i])))

"""Stationarity, tails and correlation of innovations: sums in fixed memory, and their tests.

Loads that swell and fade leave innovations whose mean square s_w over windows of some periods varies more than that of
n normal values, (2 + κ)/n. Tails are the excess kurtosis κ within such windows: of n values scaled by their own mean
square the mean fourth power is 3n/(n+2) (exact for normal ones), however much the level varies between windows. What
two channels share is the correlation of their innovations at lags of a few samples: of N white pairs it scatters by
1/√N. Loads that act on two degrees of freedom at once make it, and so does an accelerometer off its axis. Blades turn:
what a late logger on them leaves is correlated with the innovations of the tower along the blade's tangent,
−z_x sin ψ_i + z_y cos ψ_i, one sample off and more. At lag 0 steps of finite length leave a trace there, which is left
out. Where a clock is an unknown, readings have been moved by what it is late as far as the structure answers; only that
band is asked then.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array

__all__ = ["MAX_LAG", "Late", "Level", "Shared", "how_late", "levels", "most_shared", "shared_products", "steadiness"]

MAX_LAG = 3
"""Setting: largest lag of one channel behind another that is tested, to either side [samples]."""


class Level(NamedTuple):
    """Stationarity of the innovations of one channel.

    Attributes
    ----------
    unsteady, unsteady_sigmas
        By how much their mean square varies over the record beyond chance, as a standard deviation over the mean; and
        how far that is from chance, in standard deviations.
    tails, tails_sigmas
        Excess kurtosis within windows, and the same of it.
    """

    unsteady: float
    unsteady_sigmas: float
    tails: float
    tails_sigmas: float


class Shared(NamedTuple):
    """Strongest correlation between two channels.

    Attributes
    ----------
    first, second
        Their columns; `first` is later by `lag` samples.
    lag, correlation, sigmas
        Where the correlation is greatest, and in standard deviations of chance.
    """

    first: int
    second: int
    lag: int
    correlation: float
    sigmas: float


class Late(NamedTuple):
    """By how many samples the blades seem to be later than the tower, and in standard deviations of chance."""

    lag: int
    sigmas: float


def levels(z: Array, used: NDArray[np.bool_], window: int) -> tuple[Array, Array, Array, Array]:
    """Sums over the windows of z (T, m): how many, of their mean squares, of those squared, and of mean fourth powers
    over them squared (m,)."""
    count = len(z) // window
    shape = (count, window, z.shape[1])
    seen = used[: count * window].reshape(shape)
    square = np.square(np.where(seen, z[: count * window].reshape(shape), 0.0))
    number = seen.sum(axis=1)
    kept = number >= 0.9 * window
    level = square.sum(axis=1) / np.maximum(number, 1)
    fourth = np.square(square).sum(axis=1) / np.maximum(number, 1) / np.maximum(level**2, 1e-300)
    return tuple(np.where(kept, value, 0.0).sum(axis=0) for value in (kept, level, level**2, fourth))


def shared_products(z: Array, used: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Sums of z_i(t + lag) z_j(t) over z (T, m) with variance 1 at lags −L … L, and how many (2L + 1, m, m)."""
    m = z.shape[1]
    products, pairs = np.zeros((2 * MAX_LAG + 1, m, m)), np.zeros((2 * MAX_LAG + 1, m, m))
    seen = used.astype(np.float64)
    for lag in range(min(MAX_LAG, len(z) - 1) + 1):
        later, now = slice(lag, None), slice(None, len(z) - lag)
        products[MAX_LAG + lag], pairs[MAX_LAG + lag] = z[later].T @ z[now], seen[later].T @ seen[now]
        products[MAX_LAG - lag], pairs[MAX_LAG - lag] = products[MAX_LAG + lag].T, pairs[MAX_LAG + lag].T
    return products, pairs


def steadiness(windows: float, level: float, second: float, fourth: float, *, window: int) -> Level:
    """Stationarity of one channel from the sums of `levels`."""
    if windows < 3.0:
        return Level(0.0, 0.0, 0.0, 0.0)
    mean = level / windows
    tails = fourth / windows - 3.0 * window / (window + 2.0)
    by_chance = (2.0 + max(tails, 0.0)) / window
    freedom = windows - 1.0
    variance = max(second / windows - mean**2, 0.0) / max(mean**2, 1e-300) * windows / freedom
    root = (variance / by_chance) ** (1.0 / 3.0)  # Wilson & Hilferty's: nearly normal
    sigmas = (root - 1.0 + 2.0 / (9.0 * freedom)) * math.sqrt(4.5 * freedom)
    unsteady = math.sqrt(max(variance - by_chance, 0.0))
    return Level(unsteady, sigmas, tails, tails * math.sqrt(windows * window / 24.0))


def most_shared(products: Array, pairs: Array) -> Shared | None:
    """Strongest correlation from the sums of `shared_products`; None with one channel."""
    m = products.shape[1]
    later, now = np.triu_indices(m, 1)
    if not len(later):
        return None
    number = np.maximum(pairs[:, later, now], 1.0)
    sigmas = products[:, later, now] / np.sqrt(number)
    lag, pair = np.unravel_index(int(np.argmax(np.abs(sigmas))), sigmas.shape)
    correlation = float(sigmas[lag, pair] / math.sqrt(number[lag, pair]))
    return Shared(int(later[pair]), int(now[pair]), int(lag) - MAX_LAG, correlation, float(abs(sigmas[lag, pair])))


def how_late(
    z: Array, azimuth: Array, tower: tuple[int, int], blades: Mapping[int, float], *, below: float = 0.5
) -> Late:
    """Of innovations z (T, m), NaN where missing, with variance 1: how late blades are.

    Parameters
    ----------
    azimuth
        ψ [rad] (T,).
    tower
        Columns of the tower along x and y.
    blades
        Columns of the blades, and the angle [rad] of each at ψ = 0.
    below
        Frequency in cycles per sample up to which is looked.
    """
    kept = np.fft.rfftfreq(len(z)) <= below
    lags = [lag for lag in range(-MAX_LAG, MAX_LAG + 1) if lag]
    z = np.nan_to_num(z)
    total, scatter = np.zeros(len(lags)), np.zeros(len(lags))
    for column, angle in blades.items():
        tangential = -np.sin(azimuth + angle) * z[:, tower[0]] + np.cos(azimuth + angle) * z[:, tower[1]]
        tangential = np.fft.irfft(np.where(kept, np.fft.rfft(tangential), 0.0), len(z))
        for k, lag in enumerate(lags):
            first, second = slice(max(-lag, 0), len(z) - max(lag, 0)), slice(max(lag, 0), len(z) - max(-lag, 0))
            shared = tangential[first] * z[second, column]
            total[k] += float(shared.sum())
            scatter[k] += float(shared @ shared)  # of loads that swell, too
    sigmas = np.abs(total) / np.sqrt(np.maximum(scatter, 1e-300))
    k = int(np.argmax(sigmas))
    return Late(lags[k], float(sigmas[k]))

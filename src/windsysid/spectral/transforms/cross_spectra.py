"""Cross-spectra of readings, block by block: all that a stationary record says, in a memory that does not grow.

A block of L samples has the tapered transforms Y_k (`windsysid.spectral.transforms.dft`), complex Gaussian with the
covariance S̄(f_k). What the likelihood of many blocks depends on is Σ Y_k Y_kᴴ at every frequency and their number, so
that blocks add, and so do records of one structure in one state.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.spectral.transforms.dft import taper_factor, transform

__all__ = ["CrossSpectra", "Rows", "cross_spectra", "pool"]

FIRST_BIN = 2
"""Lowest bin in use: nearer to 0 the mean has been taken out."""


class CrossSpectra(NamedTuple):
    """Sums over blocks.

    Attributes
    ----------
    power
        Σ Y Yᴴ at the bins k = first … (F, m, m), one-sided [unit²/Hz].
    first
        The first bin.
    blocks
        How many.
    samples, rate
        Of a block L, and per second [Hz].
    """

    power: Complex
    first: int
    blocks: float
    samples: int
    rate: float

    @property
    def bins(self) -> NDArray[np.int64]:
        """k (F,)."""
        return np.arange(self.first, self.first + len(self.power))

    @property
    def frequency(self) -> Array:
        """[Hz] (F,)."""
        return np.asarray(self.bins * self.rate / self.samples)

    @property
    def factor(self) -> float:
        """c_h: how many bins count as one."""
        return taper_factor(self.samples)

    def __add__(self, other: "CrossSpectra") -> "CrossSpectra":  # type: ignore[override]
        return self._replace(power=self.power + other.power, blocks=self.blocks + other.blocks)


class Rows(NamedTuple):
    """Pools of neighbouring bins that share one spectrum.

    Attributes
    ----------
    first
        Place of the first bin of each in `CrossSpectra.power` (K + 1,), the end last.
    frequency
        Their middles (K,) [Hz].
    counts
        Bins times blocks (K,).
    power
        Mean of Y Yᴴ (K, m, m).
    """

    first: NDArray[np.int64]
    frequency: Array
    counts: Array
    power: Complex


def cross_spectra(readings: Array, rate: float, limits: tuple[float, float]) -> CrossSpectra:
    """Of one block of readings (L, m) without gaps, between two frequencies [Hz]."""
    frequency, found = transform(_level(readings), rate)
    low, high = (int(k) for k in np.searchsorted(frequency, limits, side="right"))
    first = max(low, FIRST_BIN)
    used = found[first:high]
    return CrossSpectra(used[:, :, None] * used[:, None, :].conj(), first, 1.0, len(readings), rate)


def _level(readings: Array) -> Array:
    """Readings (T, m) without their mean and trend."""
    along = np.arange(len(readings)) - 0.5 * (len(readings) - 1)
    trend = along @ readings / max(float(along @ along), 1.0)
    return np.asarray(readings - readings.mean(axis=0) - along[:, None] * trend)


def pool(spectra: CrossSpectra, width: Array) -> Rows:
    """Bins pooled as far as `width` (F,) [bins] allows around each of them."""
    place = np.cumsum(1.0 / np.maximum(width, 1.0))
    first = np.flatnonzero(np.diff(np.floor(place - 1e-9), prepend=-1.0))
    ends = np.append(first, len(place))
    number = np.diff(ends).astype(np.float64)
    power = np.add.reduceat(spectra.power, first, axis=0) / (number * spectra.blocks)[:, None, None]
    middle = np.add.reduceat(spectra.frequency, first) / number
    return Rows(ends, middle, number * spectra.blocks, np.asarray(power, dtype=np.complex128))

"""Cross-spectra of readings over blocks: the sufficient statistic of a stationary record.

A block of L samples has the tapered transforms Y_k (`windsysid.spectral.transforms.dft`), complex Gaussian with the
covariance S̄(f_k). The likelihood of many blocks depends on Σ Y_k Y_kᴴ at every frequency and on their number
(`windsysid.spectral.transforms.block_sums`).
"""

from collections.abc import Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.spectral.transforms.dft import taper_factor, transform

__all__ = ["CrossSpectra", "FixedBlock", "PooledBins", "pool", "transform_block"]

FIRST_BIN = 2
"""Setting: lowest bin in use: the removal of the mean affects those below."""


class FixedBlock(NamedTuple):
    """The transforms of one block of readings that do not turn: Y at the bins k = first … (F, m), one-sided [unit/√Hz],
    of L samples at a rate [Hz]; mean squares in `ranges` of frequency [Hz] are compared between blocks."""

    data: Complex
    first: int
    samples: int
    rate: float
    ranges: tuple[tuple[float, float], ...] = ()

    @property
    def bins(self) -> NDArray[np.int64]:
        """k (F,)."""
        return np.arange(self.first, self.first + len(self.data))

    @property
    def frequency(self) -> Array:
        """[Hz] (F,)."""
        return np.asarray(self.bins * self.rate / self.samples)

    @property
    def overlap(self) -> float:
        """c_h: how many bins count as one."""
        return taper_factor(self.samples)

    @property
    def vectors(self) -> Complex:
        """Y (F, m)."""
        return self.data

    @property
    def energies(self) -> Array:
        """Mean square per bin in each range (R, m); NaN where there is no bin."""
        power = (self.data * self.data.conj()).real
        inside = [(self.frequency >= low) & (self.frequency < high) for low, high in self.ranges]
        nothing = np.full(power.shape[1], np.nan)
        found = [power[one].mean(axis=0) if one.any() else nothing for one in inside]
        return np.array(found).reshape(len(found), power.shape[1])

    @property
    def independent(self) -> Array:
        """The number of bins in each range (R, m)."""
        ends = np.array(self.ranges).reshape(-1, 2)
        counts = np.diff(np.searchsorted(self.frequency, ends), axis=1)
        return np.asarray(np.repeat(counts, self.data.shape[1], axis=1), dtype=np.float64)

    def averaged(self, before: "FixedBlock", share: float) -> "FixedBlock":
        """The block itself: its frequencies are those of all blocks."""
        return self


CrossSpectra: TypeAlias = BlockSums[FixedBlock]
"""Sums over blocks whose frequencies are fixed: `power` is Σ Y Yᴴ (F, m, m), one-sided [unit²/Hz]."""


class PooledBins(NamedTuple):
    """Pools of neighbouring bins that share one spectrum.

    Attributes
    ----------
    first
        Place of the first bin of each in the sums (K + 1,), the end last.
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


def transform_block(
    readings: Array, rate: float, limits: tuple[float, float], ranges: Sequence[tuple[float, float]] = ()
) -> FixedBlock:
    """The transforms of one block of readings (L, m) without gaps, between two frequencies [Hz]."""
    frequency, found = transform(_level(readings), rate)
    low, high = (int(k) for k in np.searchsorted(frequency, limits, side="right"))
    first = max(low, FIRST_BIN)
    return FixedBlock(found[first:high], first, len(readings), rate, tuple(ranges))


def _level(readings: Array) -> Array:
    """Readings (T, m) without their mean and trend."""
    along = np.arange(len(readings)) - 0.5 * (len(readings) - 1)
    trend = along @ readings / max(float(along @ along), 1.0)
    return np.asarray(readings - readings.mean(axis=0) - along[:, None] * trend)


def pool(spectra: CrossSpectra, width: Array) -> PooledBins:
    """Bins pooled as far as `width` (F,) [bins] allows around each of them."""
    place = np.cumsum(1.0 / np.maximum(width, 1.0))
    first = np.flatnonzero(np.diff(np.floor(place - 1e-9), prepend=-1.0))
    ends = np.append(first, len(place))
    number = np.diff(ends).astype(np.float64)
    power = np.add.reduceat(spectra.power, first, axis=0) / (number * spectra.blocks)[:, None, None]
    middle = np.add.reduceat(spectra.last.frequency, first) / number
    return PooledBins(ends, middle, number * spectra.blocks, np.asarray(power, dtype=np.complex128))

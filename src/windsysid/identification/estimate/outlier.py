"""Readings that are left out: single spikes, and readings beyond the gate of a filter."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.checks.limits import MAX_MISSING_SHARE, NEGLIGIBLE_SHARE
from windsysid.identification.condition.samples import Block, Samples
from windsysid.identification.limits import MAX_NEIGHBOUR_SHARE
from windsysid.inspection.limits import MIN_SPIKE_SIGMAS

__all__ = ["Outliers", "find_spikes"]


@dataclass(frozen=True)
class Outliers:
    """Readings that are left out: for each block the places in its readings (T, m), counted row by row."""

    places: tuple[NDArray[np.int64], ...] = ()

    def mask(self, block: int, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Mask of the outliers in readings (T, m) of a block."""
        found = np.zeros(shape, dtype=np.bool_)
        if block < len(self.places):
            found.reshape(-1)[self.places[block]] = True
        return found

    def counts(self, channels: int) -> NDArray[np.int64]:
        """Number of outliers of each channel (m,)."""
        columns = [places % channels for places in self.places]
        return np.bincount(np.concatenate([[], *columns]).astype(np.int64), minlength=channels)

    def that_matter(self, power: Array, read: NDArray[np.int64], samples: int) -> "Outliers":
        """Outliers of channels that are sensitive to them, except where they are common.

        Parameters
        ----------
        power
            What they add to the squares of each channel's normalised innovations (m,).
        read, samples
            How many readings of each channel there were (m,), and how many samples.
        """
        m = len(read)
        channels = (power > NEGLIGIBLE_SHARE**2 * read) & (self.counts(m) <= MAX_MISSING_SHARE * samples)
        kept = tuple(places[channels[places % m]] for places in self.places)
        return Outliers(kept) if any(len(places) for places in kept) else Outliers()

    def same_as(self, other: "Outliers") -> bool:
        """True if the same readings are left out."""
        return len(self.places) == len(other.places) and all(map(np.array_equal, self.places, other.places))

    def left_out_of(self, samples: Samples) -> Samples:
        """The samples without them."""
        return SamplesWithout(samples, self) if self.places else samples


@dataclass(frozen=True)
class SamplesWithout:
    """Samples whose outliers are missing readings."""

    samples: Samples
    outliers: Outliers

    def __iter__(self) -> Iterator[Block]:
        for block, (inputs, readings) in enumerate(self.samples):
            yield inputs, np.where(self.outliers.mask(block, readings.shape), np.nan, readings)


def find_spikes(samples: Samples) -> Outliers:
    """Readings that stand alone, far from both of their neighbours: what a first search leaves out. A search that took
    them in would end far away, and the next would begin there."""
    found = []
    for _, readings in samples:
        channels = readings.shape[1]
        alone = [channels * _alone(column) + i for i, column in enumerate(readings.T)]
        found.append(np.sort(np.concatenate(alone)))
    return Outliers(tuple(found)) if any(len(at) for at in found) else Outliers()


def _alone(readings: Array) -> NDArray[np.int64]:
    """Mask of the spikes in readings of a channel (T,)."""
    read = np.flatnonzero(np.isfinite(readings))
    values = readings[read]
    off = np.zeros(len(values))
    off[1:-1] = np.abs(values[1:-1] - 0.5 * (values[:-2] + values[2:]))
    beside = np.maximum(np.roll(off, 1), np.roll(off, -1))
    if not len(off):
        return read
    spikes = (off > MIN_SPIKE_SIGMAS * np.median(off) / 0.6745) & (beside < MAX_NEIGHBOUR_SHARE * off)
    return read[spikes] if np.count_nonzero(spikes) <= MAX_MISSING_SHARE * len(values) else read[:0]

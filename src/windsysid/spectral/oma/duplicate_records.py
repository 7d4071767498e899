"""Records that hold the same motion: a file that was written twice, or windows that overlap.

Together they would count what happened once several times, and bands would be too narrow by the root of that. The
correlation of two readings whose transforms have been made equally large at all frequencies has one sharp peak where
they hold the same, whatever gain, noise or delay lies between (Knapp & Carter, IEEE Trans. ASSP 24(4), 1976,
https://doi.org/10.1109/TASSP.1976.1162830); of others it is noise of the standard deviation 1/√N.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from windsysid._types import Array
from windsysid.spectral.oma.assemble import Single
from windsysid.spectral.transforms.dft import taper

__all__ = ["find_repeated"]

SHARP = 8.0
"""Standard deviations of what chance gives, beyond which a peak of the correlation is none of it."""

FARTHEST = 3
"""Records that follow each other, of which windows overlap; files that are the same are found wherever they are."""


def find_repeated(singles: Sequence[Single]) -> list[str]:
    """A sentence for each pair of records that hold the same motion."""
    found = []
    for (i, one), (j, other) in combinations(enumerate(singles), 2):
        same = np.array_equal(one.readings.fixed, other.readings.fixed)
        if same or (j - i <= FARTHEST and _hold_the_same(one, other)):
            found.append(
                f"{one.record.name} and {other.record.name} hold the same motion: what happened once counts twice"
            )
    return found


def _hold_the_same(one: Single, other: Single) -> bool:
    shared = [name for name in _fixed(one) if name in _fixed(other)]
    if not shared or abs(one.readings.rate / other.readings.rate - 1.0) > 1e-6:
        return False
    first, second = (single.readings.fixed[:, _fixed(single).index(shared[0])] for single in (one, other))
    length = len(first) + len(second)
    together = _even(first, length) * _even(second, length).conj()
    correlation = np.fft.irfft(together, length)
    return bool(np.abs(correlation).max() > SHARP / np.sqrt(length))


def _even(values: Array, length: int) -> Array:
    """The transform of readings with the same size at all frequencies; tapered, or the ends would be alike."""
    transform = np.fft.rfft(taper(len(values)) * (values - values.mean()), length)
    return np.asarray(transform / np.maximum(np.abs(transform), 1e-300))


def _fixed(single: Single) -> tuple[str, ...]:
    """Channels that stand, of which values are real."""
    return single.readings.names[: single.readings.fixed.shape[1]]

"""Detection of records with the same motion: a file that was written twice, or windows that overlap.

Such records count the same samples several times, and intervals become too narrow by the root of that number. The
correlation of two readings with transforms of equal size at all frequencies has one sharp peak if they have the same
motion, for any gain, noise or delay between them (Knapp & Carter, IEEE Trans. ASSP 24(4), 1976,
https://doi.org/10.1109/TASSP.1976.1162830); for other records it is noise of the standard deviation 1/√N.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from windsysid._types import Array
from windsysid.spectral.oma.assemble import RecordAnalysis
from windsysid.spectral.oma.limits import MAX_RECORD_DISTANCE, MIN_PEAK_SIGMAS
from windsysid.spectral.transforms.dft import taper

__all__ = ["find_duplicates"]


def find_duplicates(singles: Sequence[RecordAnalysis]) -> list[str]:
    """Return a doubt about each pair of records with the same motion."""
    found = []
    for (i, one), (j, other) in combinations(enumerate(singles), 2):
        same = np.array_equal(one.readings.fixed, other.readings.fixed)
        if same or (j - i <= MAX_RECORD_DISTANCE and _have_same_motion(one, other)):
            found.append(f"{one.record.name} and {other.record.name} contain the same motion, which counts twice")
    return found


def _have_same_motion(one: RecordAnalysis, other: RecordAnalysis) -> bool:
    shared = [name for name in _fixed(one) if name in _fixed(other)]
    if not shared or abs(one.readings.rate / other.readings.rate - 1.0) > 1e-6:
        return False
    first, second = (single.readings.fixed[:, _fixed(single).index(shared[0])] for single in (one, other))
    length = len(first) + len(second)
    together = _whitened(first, length) * _whitened(second, length).conj()
    correlation = np.fft.irfft(together, length)
    return bool(np.abs(correlation).max() > MIN_PEAK_SIGMAS / np.sqrt(length))


def _whitened(values: Array, length: int) -> Array:
    """Transform of tapered readings with the same size at all frequencies; without a taper the ends correlate."""
    transform = np.fft.rfft(taper(len(values)) * (values - values.mean()), length)
    return np.asarray(transform / np.maximum(np.abs(transform), 1e-300))


def _fixed(single: RecordAnalysis) -> tuple[str, ...]:
    """Names of the channels in the fixed frame, whose values are real."""
    return single.readings.names[: single.readings.fixed.shape[1]]

"""Spectral peaks of readings, and the bands around them.

Readings are scaled by the level around each frequency, and peaks are sought in the singular values of their spectral
matrices, averaged over widths that grow with frequency, a narrow and a wide one. The search may find too much: whether
there is a mode in a band, and how many, the evidence decides.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.checks.limits import CONFLICT_SIGMAS, MAX_CHANCE_SIGMAS

__all__ = ["Peak", "find_peaks", "group_peaks", "merge_peaks", "widened"]

AVERAGING_WIDTHS = ((10, 0.004), (40, 0.03))
"""Setting: smallest number of bins, and share of the frequency, of averages for narrow and for wide peaks."""

BACKGROUND_HALF_WIDTH = 0.25
"""Setting: relative half-width of the background of a frequency."""

BACKGROUND_STEP = 4
"""Setting: step between frequencies at which the background is computed; linear interpolation between."""

SINGULAR_VALUES = 3
"""Setting: number of singular values in which peaks are sought."""

MIN_DENSITY_SHARE = 1e-7
"""Numerical: spectral density over a channel's largest; below it in all channels there is rounding, no vibration."""

BAND_HALF_WIDTHS = 10.0
"""Setting: half-width of a mode's band over ζ f."""

MIN_HALF_BAND_BINS = 30
"""Setting: smallest half-width of a band in bins: with fewer, damping and background are hard to separate."""

MAX_SHARED_BINS = 12
"""Setting: distance of peaks in bins below which they share a band."""

CORE_HALF_WIDTHS = 3.0
"""Setting: half-width over ζ f of a mode's core, which is in no other band."""

MAX_BAND_PEAKS = 4
"""Setting: largest number of peaks in one band."""


class Peak(NamedTuple):
    """A peak: its frequency and half its width at half its height [Hz], how far it stands out, in standard deviations,
    and whether it must have a band of its own."""

    frequency: float
    half_width: float
    rise: float
    alone: bool = False


def find_peaks(frequency: Array, values: Complex, low: float, high: float) -> list[Peak]:
    """Peaks between two frequencies of transforms (F, n) at even frequencies (F,) from 0, by rising frequency."""
    found: list[Peak] = []
    for bins, share in AVERAGING_WIDTHS:
        own: list[Peak] = []
        centre, counts, power = _averages(frequency, values, low, high, bins, share)
        if len(centre) < 5:
            continue
        levels = np.linalg.eigvalsh(power)[:, ::-1][:, :SINGULAR_VALUES]
        scatter = 1.0 / np.sqrt(counts)
        around = _surroundings(centre, bins * frequency[1])
        for level in np.log(np.maximum(levels.T, 1e-300)):
            heights = level.tolist()
            for i in _maxima(level):
                depth = CONFLICT_SIGMAS * float(scatter[i])
                if not (_falls(heights, i, -1, depth) and _falls(heights, i, 1, depth)):
                    continue
                rise = (level[i] - np.median(level[slice(*around[i])])) / scatter[i]
                if rise >= MAX_CHANCE_SIGMAS:
                    own.append(Peak(float(centre[i]), _half_width(centre, level, i), float(rise)))
        found += merge_peaks(own, found)
    return sorted(found)


def merge_peaks(peaks: list[Peak], kept: list[Peak]) -> list[Peak]:
    """Those of the peaks that are neither at one that is kept nor at a higher one of themselves."""
    merged: list[Peak] = []
    for peak in sorted(peaks, key=lambda p: -p.rise):
        if all(
            abs(peak.frequency - other.frequency) > max(other.half_width, peak.half_width) for other in (*kept, *merged)
        ):
            merged.append(peak)
    return merged


def group_peaks(peaks: list[Peak], step: float, low: float, high: float) -> list[tuple[float, float, int]]:
    """Bands (lowest, highest frequency, number of peaks) around peaks; `step` is the distance of bins [Hz].

    Peaks whose skirts overlap share a band. Bands do not overlap: between two groups the border is in the middle, by
    their widths.
    """
    groups: list[list[Peak]] = []
    for peak in peaks:
        if groups and _overlap(groups[-1], peak, step):
            groups[-1].append(peak)
        else:
            groups.append([peak])
    bands = []
    for i, group in enumerate(groups):
        first, last = group[0], group[-1]
        reach = [max(BAND_HALF_WIDTHS * p.half_width, MIN_HALF_BAND_BINS * step) for p in (first, last)]
        start, end = max(first.frequency - reach[0], low), min(last.frequency + reach[1], high)
        if i > 0:
            start = max(start, _border(groups[i - 1][-1], first))
        if i + 1 < len(groups):
            end = min(end, _border(last, groups[i + 1][0]))
        bands.append((start, end, len(group)))
    return bands


def _overlap(group: list[Peak], peak: Peak, step: float) -> bool:
    """True if the skirts of the next peak and of a group's last overlap, and the group is not full."""
    last = group[-1]
    if len(group) >= MAX_BAND_PEAKS or peak.alone or last.alone:
        return False
    near = 3.0 * (last.half_width + peak.half_width)
    return peak.frequency - last.frequency < max(near, MAX_SHARED_BINS * step)


def widened(inside: list[Peak], others: list[Peak], low: float, high: float, step: float) -> tuple[float, float]:
    """A band around peaks of the required width, as far as it leaves out the cores of the others."""
    reach = [max(BAND_HALF_WIDTHS * peak.half_width, MIN_HALF_BAND_BINS * step) for peak in inside]
    first = min(peak.frequency - wide for peak, wide in zip(inside, reach, strict=True))
    last = max(peak.frequency + wide for peak, wide in zip(inside, reach, strict=True))
    below = [peak.frequency + CORE_HALF_WIDTHS * peak.half_width for peak in others if peak.frequency < low]
    above = [peak.frequency - CORE_HALF_WIDTHS * peak.half_width for peak in others if peak.frequency > high]
    return min(low, max([first, *below])), max(high, min([last, *above]))


def _border(below: Peak, above: Peak) -> float:
    if below.alone != above.alone:  # a mode needs its skirts, a rotationally sampled peak does not
        share = 0.25 if below.alone else 0.75
    else:
        share = below.half_width / (below.half_width + above.half_width)
    return below.frequency + min(max(share, 0.25), 0.75) * (above.frequency - below.frequency)


def _averages(
    frequency: Array, values: Complex, low: float, high: float, bins: int, share: float
) -> tuple[Array, Array, Complex]:
    """Middle frequencies (G,), bins (G,) and mean spectral matrices (G, n, n), channels scaled by what is around;
    groups overlap by half."""
    step = frequency[1]
    edges = [max(low, step)]
    while edges[-1] < high:
        edges.append(edges[-1] + 0.5 * max(bins * step, share * edges[-1]))
    marks = np.unique(np.searchsorted(frequency, edges))
    marks = marks[marks < len(frequency)]
    if len(marks) < 4:
        return np.empty(0), np.empty(0), np.empty((0, 0, 0), dtype=np.complex128)
    products = [np.einsum("ki,kj->ij", values[a:b], values[a:b].conj()) for a, b in itertools.pairwise(marks)]
    halves = np.array(products)
    counts = np.diff(marks).astype(np.float64)
    total = counts[:-1] + counts[1:]
    power = (halves[:-1] + halves[1:]) / total[:, None, None]
    centre = 0.5 * (frequency[marks[:-2]] + frequency[marks[2:] - 1])
    powers = np.einsum("gii->gi", power).real
    few = np.arange(0, len(centre), BACKGROUND_STEP)
    across = np.ascontiguousarray(powers.T)
    levels = [_medians(across[:, first:last]) for first, last in _surroundings(centre, bins * step)[few].tolist()]
    scale = np.column_stack([np.interp(centre, centre[few], column) for column in np.transpose(levels)])
    root = 1.0 / np.sqrt(np.maximum(scale, 1e-300))
    faint = np.all(powers < MIN_DENSITY_SHARE * powers.max(axis=0), axis=1)
    scaled = power * root[:, :, None] * root[:, None, :]
    scaled[faint] = np.eye(scaled.shape[1])  # no peaks there
    return centre, total, scaled


def _surroundings(centre: Array, width: float) -> NDArray[np.int64]:
    """First and end (G, 2) of the background of each rising frequency (G,) that averages over a width [Hz]."""
    place, reach = np.log(centre), np.maximum(BACKGROUND_HALF_WIDTH, 4.0 * width / centre)
    return np.column_stack([np.searchsorted(place, place - reach, "right"), np.searchsorted(place, place + reach)])


def _medians(values: Array) -> Array:
    """Medians of rows (n, k), with a third of the cost of `numpy.median` where they are short."""
    middle = (values.shape[1] - 1) // 2, values.shape[1] // 2
    parted = np.partition(values, middle)
    return np.asarray(0.5 * (parted[:, middle[0]] + parted[:, middle[1]]))


def _maxima(level: Array) -> list[int]:
    """Local maxima, the ends left out."""
    inner = level[1:-1]
    return (1 + np.flatnonzero((inner >= level[:-2]) & (inner > level[2:]))).tolist()


def _falls(level: Sequence[float], i: int, way: int, depth: float) -> bool:
    """True if the level falls on one side by more than a depth below that at i before anything is higher."""
    k = i + way
    while 0 <= k < len(level) and level[k] <= level[i]:
        if level[i] - level[k] > depth:
            return True
        k += way
    return False


def _half_width(centre: Array, level: Array, i: int) -> float:
    """Half the width at half the height [Hz]."""
    half = level[i] - np.log(2.0)
    widths = []
    for way in (-1, 1):
        k = i
        while 0 <= k + way < len(level) and level[k] > half:
            k += way
        widths.append(abs(centre[k] - centre[i]))
    return float(max(min(widths), 0.25 * (centre[min(i + 1, len(centre) - 1)] - centre[i - 1])))

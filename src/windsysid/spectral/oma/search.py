"""The search for modes in a record's spectra: bands, the modes of each, and bands placed anew around them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.errors import ConfigurationError
from windsysid.output.progress import Progress
from windsysid.spectral.modal_bands.check import is_flank
from windsysid.spectral.modal_bands.model_order import BandFit, fit_band
from windsysid.spectral.modal_bands.peak_bands import Peak, find_peaks, group_peaks, widened
from windsysid.spectral.oma.condition import Readings, transforms

__all__ = [
    "MIN_BINS",
    "Found",
    "band_bins",
    "covered_note",
    "fit_between",
    "is_hump",
    "modes_inside",
    "modes_of",
    "search_again",
    "search_modes",
]

MOST_MODES = 5
"""In one band."""

MOST_BANDS = 24
"""Bands that are analysed where no limits are given."""

AGAIN = 2
"""Times that bands are placed anew."""

MOVED = 0.15
"""Of a band's width: a band whose borders should have been farther away than that is fitted again."""

HUMP = 0.01
"""A peak this near to a harmonic of the rotor, relative, or nearer than one and a half of its half-widths, is of the
wind that blades sample."""

CLEAR = 8.0
"""Rise of a peak, in standard deviations, that calls for a mode."""

WIDER = 3.0
"""Times the half-width that a clear peak without a mode is given: few bins tell half its height badly."""

EXPLAINED = 5.0
"""Half-widths of a mode from which on it does not account for a peak."""

LEAST_EVIDENCE = 10.0
"""2 ln of the evidence for a mode against none."""

MIN_BINS = 8
"""Smallest number of frequency bins of a band without those of lines: with fewer, the halves of a record cannot be
compared."""


class Found(NamedTuple):
    """What was found in a record.

    Attributes
    ----------
    frequency, values
        Transforms (F, n) and their frequencies (F,) [Hz].
    bands
        The modes of each band.
    empty
        Bands that were asked for and hold no mode.
    reached
        Up to where modes were sought [Hz], where peaks go on beyond; else None.
    covered
        Bands [Hz] that were not analysed, because rotor harmonics and other lines leave too few bins.
    """

    frequency: Array
    values: Complex
    bands: tuple[BandFit, ...]
    empty: tuple[tuple[float, float], ...]
    reached: float | None = None
    covered: tuple[tuple[float, float], ...] = ()


def search_modes(
    readings: Readings,
    bands: Sequence[tuple[float, float]] | None,
    limits: tuple[float, float] | None,
    progress: Progress,
) -> Found:
    """The modes in bands that are given, or in those that spectra show between limits [Hz]; without any, in the lowest
    `MOST_BANDS`."""
    frequency, values = transforms(readings)
    step, reached = float(frequency[1]), None
    if limits is not None:
        if not 0.0 <= limits[0] < min(limits[1], readings.high):
            raise ConfigurationError(
                f"limits {limits[0]:g} {limits[1]:g} Hz: expected two rising frequencies between 0 and "
                f"{readings.high:.4g} Hz"
            )
        readings = readings._replace(low=max(readings.low, limits[0]), high=min(readings.high, limits[1]))
    if bands is None:
        progress("spectral peaks", None)
        seen = [
            peak._replace(alone=is_hump(peak, readings))
            for peak in find_peaks(frequency, values, readings.low, readings.high)
        ]
        wanted = group_peaks(seen, step, readings.low, readings.high)
        if limits is None and len(wanted) > MOST_BANDS:
            reached = 0.5 * (wanted[MOST_BANDS - 1][1] + wanted[MOST_BANDS][0])
            readings, wanted = readings._replace(high=reached), wanted[:MOST_BANDS]
            seen = [peak for peak in seen if peak.frequency < reached]
    else:
        seen = []
        wanted = [_checked_band(band, readings, step) for band in bands]
    fits: list[BandFit | None] = []
    for i, (low, high, count) in enumerate(wanted):
        progress(f"modes from {low:.4g} to {high:.4g} Hz", i / len(wanted))
        most = count if bands is None else MOST_MODES
        fits.append(fit_between(frequency, values, readings, low, high, count, most))
    covered = tuple((low, high) for (low, high, _), one in zip(wanted, fits, strict=True) if one is None)
    found = [one for one in fits if one is not None]
    for again in range(AGAIN if bands is None else 0):
        progress("bands around what was found", None)
        found = search_again(found, frequency, values, readings, [] if again else seen, keep=again > 0)
    left = [
        peak._replace(half_width=WIDER * peak.half_width) for peak in seen if not _explained(peak, found, 1.0 / step)
    ]
    if left:
        progress("peaks without a mode, in wider bands", None)
        found = search_again(found, frequency, values, readings, left, keep=True)
        found = search_again(found, frequency, values, readings, [], keep=True)
    empty = [
        (low, high)
        for (low, high, _), one in zip(wanted, fits, strict=True)
        if bands is not None and (one is None or not modes_inside(one, 1.0 / step))
    ]
    return Found(frequency, values, tuple(found), tuple(empty), reached, covered)


def _checked_band(band: tuple[float, float], readings: Readings, step: float) -> tuple[float, float, int]:
    low, high = band
    if not (0.0 < low < high < 0.5 * readings.rate):
        raise ConfigurationError(
            f"band {low:g} {high:g} Hz: expected two rising frequencies between 0 and {0.5 * readings.rate:.4g} Hz, "
            f"half the sampling rate"
        )
    if high - low < 16.0 * step:
        raise ConfigurationError(
            f"band {low:g} {high:g} Hz: expected {16 * step:.3g} Hz of width at least in a record of {1 / step:.4g} "
            f"s; widen it"
        )
    return low, high, 1


def fit_between(
    frequency: Array,
    values: Complex,
    readings: Readings,
    low: float,
    high: float,
    count: int,
    most: int,
    known: Sequence[tuple[float, float]] = (),
) -> BandFit | None:
    """Fit the modes of one band without the bins of lines; None if fewer than `MIN_BINS` bins remain.

    `known` are start values of modes, as in `fit_band`.
    """
    bins = band_bins(frequency, readings, low, high)
    if len(bins) < MIN_BINS:
        return None
    return fit_band(values[bins], bins, readings.samples, readings.rate, count, most, known)


def band_bins(frequency: Array, readings: Readings, low: float, high: float) -> NDArray[np.int64]:
    """The bins of a band, those of lines left out."""
    inside = (frequency >= low) & (frequency <= high)
    for line in readings.lines:
        inside &= np.abs(frequency - line.frequency) > line.half_width
    return np.flatnonzero(inside)


def covered_note(band: tuple[float, float]) -> str:
    """Note on a band that was not analysed, because lines leave too few bins."""
    return (
        f"{band[0]:.4g} to {band[1]:.4g} Hz was left out: rotor harmonics or other lines cover it;"
        " choose a steadier section or a wider band"
    )


def modes_of(found: BandFit) -> int:
    """How many modes a band has, flanks among them."""
    return len(found.fit.modes.frequency) if found.against_none > LEAST_EVIDENCE else 0


def modes_inside(found: BandFit, length: float) -> int:
    """How many modes of a band are inside it."""
    return sum(not is_flank(found, j, length) for j in range(modes_of(found)))


def search_again(
    found: Sequence[BandFit],
    frequency: Array,
    values: Complex,
    readings: Readings,
    peaked: Sequence[Peak],
    *,
    keep: bool,
) -> list[BandFit]:
    """Bands around the modes that were found, and around `peaked` frequencies where none was; bands that are where they
    should be stay where `keep` says so.

    A band with one peak of its own may hold the flank of a louder mode: the first search then finds that one.
    """
    step = float(frequency[1])
    peaks = [peak for one in found if modes_of(one) for peak in _peaks_of(one, readings, step)]
    modes = {peak.frequency for peak in peaks}
    peaks += [
        peak
        for peak in peaked
        if all(abs(peak.frequency - p.frequency) > 2.0 * max(peak.half_width, p.half_width) for p in peaks)
    ]
    single: list[Peak] = []
    for peak in sorted(peaks):
        if single and peak.frequency - single[-1].frequency < 0.3 * min(peak.half_width, single[-1].half_width):
            single[-1] = max(peak, single[-1], key=lambda p: p.rise)
        else:
            single.append(peak)
    again = []
    for low, high, count in group_peaks(single, step, readings.low, readings.high):
        same = keep and [one for one in found if _is_same(one, low, high, count, 1.0 / step)]
        known = [
            (peak.frequency, peak.half_width / peak.frequency)
            for peak in single
            if peak.frequency in modes and low < peak.frequency < high
        ]
        fit: BandFit | None = same[0] if same else None
        if fit is None:
            fit = fit_between(frequency, values, readings, low, high, count, MOST_MODES, known)
        if known and (fit is None or not modes_inside(fit, 1.0 / step)):  # too narrow: neighbours' flanks are let in
            inside = [peak for peak in single if low < peak.frequency < high]
            low, high = widened(inside, [peak for peak in single if peak not in inside], low, high, step)
            low, high = max(low, readings.low), min(high, readings.high)
            fit = fit_between(frequency, values, readings, low, high, count, MOST_MODES, known)
        if fit is not None:
            again.append(fit)
    return again


def _peaks_of(found: BandFit, readings: Readings, step: float) -> list[Peak]:
    """Peaks of the modes of a band, without flanks; `step` is the distance of frequency bins [Hz]."""
    modes = zip(found.fit.modes.frequency, found.fit.modes.damping, strict=True)
    peaks = [
        Peak(float(f), float(max(z * f, 0.5 * step)), found.against_none)
        for j, (f, z) in enumerate(modes)
        if not is_flank(found, j, 1.0 / step)
    ]
    return [peak._replace(alone=is_hump(peak, readings)) for peak in peaks]


def _explained(peak: Peak, found: Sequence[BandFit], length: float) -> bool:
    """Whether a peak asks for no mode, or has one within its half-widths or the mode's."""
    return (
        peak.alone
        or peak.rise < CLEAR
        or any(
            abs(f - peak.frequency) < max(EXPLAINED * f * z, WIDER * peak.half_width)
            for one in found
            for j, (f, z) in enumerate(
                zip(one.fit.modes.frequency[: modes_of(one)], one.fit.modes.damping, strict=False)
            )
            if not is_flank(one, j, length)
        )
    )


def is_hump(peak: Peak, readings: Readings) -> bool:
    """Whether a peak stands on a harmonic of the rotor: the wind that blades sample, which shares no band with a
    mode."""
    n = round(peak.frequency / readings.rotor_hz) if readings.rotor_hz else 0
    return n > 0 and abs(peak.frequency - n * readings.rotor_hz) < max(HUMP * peak.frequency, 1.5 * peak.half_width)


def _is_same(found: BandFit, low: float, high: float, count: int, length: float) -> bool:
    first, last = found.band.frequency[[0, -1]]
    return modes_inside(found, length) == count and max(abs(first - low), abs(last - high)) < MOVED * (high - low)

"""Search for modes in the spectra of a record: bands around peaks, the modes of each, and bands placed anew."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.errors import ConfigurationError
from windsysid.inspection.limits import MAX_RATE_MISMATCH
from windsysid.output.progress import Progress
from windsysid.spectral.modal_bands.check import is_spurious
from windsysid.spectral.modal_bands.model_order import BandFit, fit_band
from windsysid.spectral.modal_bands.peak_bands import Peak, find_peaks, group_peaks, widened
from windsysid.spectral.oma import limits
from windsysid.spectral.oma.condition import Readings, transforms
from windsysid.spectral.transforms.limits import MIN_BAND_BINS

__all__ = [
    "RecordSpectrum", "SearchedBands", "band_bins", "covered_note", "fit_between", "is_rotational_peak", "modes_inside",
    "modes_of", "search_again", "search_modes", "with_added",
]  # fmt: skip


class RecordSpectrum(NamedTuple):
    """Readings of a record, the frequencies of their transforms (F,) [Hz], and the transforms (F, n)."""

    readings: Readings
    frequency: Array
    values: Complex

    @property
    def step(self) -> float:
        """Distance of frequency bins [Hz]."""
        return float(self.frequency[1])


class SearchedBands(NamedTuple):
    """Modes of a record, band by band.

    Attributes
    ----------
    spectrum
        The transforms.
    bands
        The modes of each band.
    empty
        Given bands without a mode [Hz].
    reached
        Upper end of the search [Hz], if there are peaks beyond; else None.
    covered
        Bands [Hz] that were not analysed, because rotor harmonics and other sinusoids leave too few bins.
    """

    spectrum: RecordSpectrum
    bands: tuple[BandFit, ...]
    empty: tuple[tuple[float, float], ...]
    reached: float | None = None
    covered: tuple[tuple[float, float], ...] = ()


def search_modes(
    readings: Readings,
    bands: Sequence[tuple[float, float]] | None,
    between: tuple[float, float] | None,
    progress: Progress,
) -> SearchedBands:
    """Find the modes in given bands, or in those of spectral peaks between two frequencies [Hz]; by default in the
    lowest `MAX_BANDS`."""
    if between is not None:
        low, high = between
        if not 0.0 <= low < high <= readings.high:
            end = "two rising frequencies from 0 on"
            if 0.0 <= low < high:
                share = f"{limits.MAX_FREQUENCY_SHARE:g} times the sampling rate"
                end = f"an upper end of at most {readings.high:.4g} Hz, {share}, or less after a low-pass"
            raise ConfigurationError(f"--range {low:g} {high:g} Hz (limits): expected {end}")
        readings = readings._replace(low=max(readings.low, low), high=high)
    spectrum = RecordSpectrum(readings, *transforms(readings))
    if bands is not None:
        return _search_given(spectrum, bands, progress)
    return _search_peaks(spectrum, limits.MAX_BANDS if between is None else None, progress)


def with_added(found: SearchedBands, bands: Sequence[tuple[float, float]], progress: Progress) -> SearchedBands:
    """Fit the modes of further bands; they replace bands whose modes are all inside one of them."""
    if not bands:
        return found
    given = _search_given(found.spectrum, bands, progress)
    kept = [
        one
        for one in found.bands
        if not any(all(low <= f <= high for f, _ in _modes_in(one)) for low, high in bands if modes_of(one))
    ]
    both = sorted([*kept, *given.bands], key=lambda one: float(one.band.frequency[0]))
    empty, covered = (*found.empty, *given.empty), (*found.covered, *given.covered)
    return found._replace(bands=tuple(both), empty=empty, covered=covered)


def _search_given(spectrum: RecordSpectrum, bands: Sequence[tuple[float, float]], progress: Progress) -> SearchedBands:
    """Fit the modes of given bands."""
    for band in bands:
        _check_band(band, spectrum)
    fits = _fit_each(spectrum, [(low, high, 1, limits.MAX_BAND_MODES) for low, high in bands], progress)
    pairs = list(zip(bands, fits, strict=True))
    return SearchedBands(
        spectrum,
        bands=tuple(fit for fit in fits if fit is not None),
        empty=tuple(band for band, fit in pairs if fit is None or not modes_inside(fit, 1.0 / spectrum.step)),
        covered=tuple(band for band, fit in pairs if fit is None),
    )


def _search_peaks(spectrum: RecordSpectrum, most: int | None, progress: Progress) -> SearchedBands:
    """Fit the modes around spectral peaks, in the lowest `most` bands, and place the bands anew around them."""
    progress("spectral peaks", None)
    low, high = spectrum.readings.low, spectrum.readings.high
    peaks = _marked(find_peaks(spectrum.frequency, spectrum.values, low, high), spectrum.readings)
    wanted, reached = group_peaks(peaks, spectrum.step, low, high), None
    if most is not None and len(wanted) > most:
        reached = 0.5 * (wanted[most - 1][1] + wanted[most][0])
        spectrum, wanted = spectrum._replace(readings=spectrum.readings._replace(high=reached)), wanted[:most]
        peaks = [peak for peak in peaks if peak.frequency < reached]
    fits = _fit_each(spectrum, [(low, high, count, count) for low, high, count in wanted], progress)
    found = [fit for fit in fits if fit is not None]
    covered = tuple((low, high) for (low, high, _), fit in zip(wanted, fits, strict=True) if fit is None)
    return SearchedBands(spectrum, tuple(_refined(spectrum, found, peaks, progress)), (), reached, covered)


def _refined(
    spectrum: RecordSpectrum, found: list[BandFit], peaks: Sequence[Peak], progress: Progress
) -> list[BandFit]:
    """Place bands anew around the modes that were found, and around clear peaks without a mode."""
    for again in range(limits.BAND_SEARCHES):
        progress("bands around what was found", None)
        found = search_again(spectrum, found, [] if again else peaks, keep=again > 0)
    left = [
        peak._replace(half_width=limits.PEAK_WIDTH_FACTOR * peak.half_width)
        for peak in peaks
        if not _is_explained(peak, found, 1.0 / spectrum.step)
    ]
    if left:
        progress("peaks without a mode, in wider bands", None)
        found = search_again(spectrum, found, left, keep=True)
        found = search_again(spectrum, found, [], keep=True)
    return found


def _check_band(band: tuple[float, float], spectrum: RecordSpectrum) -> None:
    (low, high), half_rate, step = band, 0.5 * spectrum.readings.rate, spectrum.step
    if not (0.0 < low < high < half_rate):
        raise ConfigurationError(
            f"band {low:g} {high:g} Hz: expected two rising frequencies between 0 and {half_rate:.4g} Hz, "
            f"half the sampling rate"
        )
    if high - low < 16.0 * step:
        raise ConfigurationError(
            f"band {low:g} {high:g} Hz: expected {16 * step:.3g} Hz of width at least in a record of {1 / step:.4g} "
            f"s; widen it"
        )


def _fit_each(
    spectrum: RecordSpectrum, wanted: Sequence[tuple[float, float, int, int]], progress: Progress
) -> list[BandFit | None]:
    """Fit bands of (lowest, highest) frequency with a number of peaks and a largest number of modes."""
    fits = []
    for i, (low, high, count, most) in enumerate(wanted):
        progress(f"modes from {low:.4g} to {high:.4g} Hz", i / len(wanted))
        fits.append(fit_between(spectrum, (low, high), count, most))
    return fits


def fit_between(
    spectrum: RecordSpectrum,
    band: tuple[float, float],
    count: int,
    most: int,
    known: Sequence[tuple[float, float]] = (),
) -> BandFit | None:
    """Fit the modes of one band without the bins of sinusoids; None if fewer than `MIN_BAND_BINS` bins remain.

    `known` are start values of modes, as in `fit_band`.
    """
    bins = band_bins(spectrum, band)
    if len(bins) < MIN_BAND_BINS:
        return None
    readings = spectrum.readings
    return fit_band(spectrum.values[bins], bins, readings.samples, readings.rate, count, most, known)


def band_bins(spectrum: RecordSpectrum, band: tuple[float, float]) -> NDArray[np.int64]:
    """Indices of the frequencies of a band, without those of rotor harmonics and other sinusoids."""
    frequency = spectrum.frequency
    inside = (frequency >= band[0]) & (frequency <= band[1])
    for line in spectrum.readings.lines:
        inside &= np.abs(frequency - line.frequency) > line.half_width
    return np.flatnonzero(inside)


def covered_note(band: tuple[float, float]) -> str:
    """Note on a band that was not analysed, because sinusoids leave too few bins."""
    return (
        f"{band[0]:.4g} to {band[1]:.4g} Hz was left out: rotor harmonics or other lines cover it;"
        " choose a steadier section or a wider band"
    )


def modes_of(found: BandFit) -> int:
    """Number of modes of a band, skirts of modes outside it among them; 0 if the evidence is too weak."""
    return len(found.fit.modes.frequency) if found.against_none > 2.0 * limits.MIN_LOG_ODDS else 0


def modes_inside(found: BandFit, length: float) -> int:
    """Count the modes of a band that are not spurious, for a record of this length [s]."""
    return sum(not is_spurious(found, j, length) for j in range(modes_of(found)))


def search_again(
    spectrum: RecordSpectrum, found: Sequence[BandFit], peaked: Sequence[Peak], *, keep: bool
) -> list[BandFit]:
    """Fit bands around the modes that were found, and around `peaked` frequencies without one.

    If `keep`, bands whose borders hardly move stay as they are. A band with one peak may hold the skirt of a mode of
    larger amplitude: the first search then finds that one.
    """
    of_modes = _marked(_peaks_of_modes(found, spectrum.step), spectrum.readings)
    others = [
        peak
        for peak in peaked
        if all(abs(peak.frequency - o.frequency) > 2.0 * max(peak.half_width, o.half_width) for o in of_modes)
    ]
    peaks = _merged([*of_modes, *others])
    modes = {peak.frequency for peak in of_modes}
    readings, kept = spectrum.readings, found if keep else ()
    bands = group_peaks(peaks, spectrum.step, readings.low, readings.high)
    fits = [_fit_anew(spectrum, band, peaks, modes, kept) for band in bands]
    return [fit for fit in fits if fit is not None]


def _merged(peaks: Sequence[Peak]) -> list[Peak]:
    """Peaks by rising frequency, of neighbours within 0.3 half-widths the higher one alone."""
    merged: list[Peak] = []
    for peak in sorted(peaks):
        if merged and peak.frequency - merged[-1].frequency < 0.3 * min(peak.half_width, merged[-1].half_width):
            merged[-1] = max(peak, merged[-1], key=lambda p: p.rise)
        else:
            merged.append(peak)
    return merged


def _fit_anew(
    spectrum: RecordSpectrum,
    band: tuple[float, float, int],
    peaks: list[Peak],
    modes: Collection[float],
    kept: Sequence[BandFit],
) -> BandFit | None:
    """Fit a band with a number of peaks, or take it from those that are kept; widen it if it loses all its modes."""
    low, high, count = band
    length = 1.0 / spectrum.step
    inside = [peak for peak in peaks if low < peak.frequency < high]
    known = [(peak.frequency, peak.half_width / peak.frequency) for peak in inside if peak.frequency in modes]
    fit = _same_band(kept, band, length) or fit_between(spectrum, (low, high), count, limits.MAX_BAND_MODES, known)
    if known and (fit is None or not modes_inside(fit, length)):  # too narrow: neighbours' skirts are let in
        low, high = widened(inside, peaks, low, high, spectrum.step)
        low, high = max(low, spectrum.readings.low), min(high, spectrum.readings.high)
        fit = fit_between(spectrum, (low, high), count, limits.MAX_BAND_MODES, known)
    return fit


def _peaks_of_modes(found: Sequence[BandFit], step: float) -> list[Peak]:
    """Peaks of the modes of bands, without skirts of modes outside them, for a distance of bins [Hz]."""
    return [
        Peak(float(f), float(max(z * f, 0.5 * step)), one.against_none)
        for one in found
        for j, (f, z) in enumerate(_modes_in(one))
        if not is_spurious(one, j, 1.0 / step)
    ]


def _modes_in(found: BandFit) -> list[tuple[float, float]]:
    """Frequency [Hz] and damping ratio of each mode of a band, skirts among them."""
    modes = found.fit.modes
    return list(zip(modes.frequency, modes.damping, strict=True))[: modes_of(found)]


def _marked(peaks: Sequence[Peak], readings: Readings) -> list[Peak]:
    """Mark peaks of rotationally sampled wind, which need a band of their own."""
    return [peak._replace(alone=is_rotational_peak(peak, readings)) for peak in peaks]


def _is_explained(peak: Peak, found: Sequence[BandFit], length: float) -> bool:
    """True if a peak requires no mode, or has one within its half-widths or the mode's."""
    if peak.alone or peak.rise < limits.MIN_PEAK_SIGMAS:
        return True
    return any(
        abs(f - peak.frequency) < limits.PEAK_WIDTH_FACTOR * max(f * z, peak.half_width)
        and not is_spurious(one, j, length)
        for one in found
        for j, (f, z) in enumerate(_modes_in(one))
    )


def is_rotational_peak(peak: Peak, readings: Readings) -> bool:
    """True if a peak is at a rotor harmonic: rotationally sampled wind, which shares no band with a mode."""
    n = round(peak.frequency / readings.rotor_hz) if readings.rotor_hz else 0
    near = max(MAX_RATE_MISMATCH * peak.frequency, limits.MAX_HARMONIC_HALF_WIDTHS * peak.half_width)
    return n > 0 and abs(peak.frequency - n * readings.rotor_hz) < near


def _same_band(found: Sequence[BandFit], band: tuple[float, float, int], length: float) -> BandFit | None:
    """First of some bands with the number of modes, and nearly the borders, of another; None if there is none."""
    low, high, count = band
    for one in found:
        first, last = one.band.frequency[[0, -1]]
        shift = max(abs(first - low), abs(last - high))
        if modes_inside(one, length) == count and shift < limits.MAX_BORDER_SHIFT * (high - low):
            return one
    return None

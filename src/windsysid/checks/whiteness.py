"""Whiteness of innovations: size, spectrum and peaks, channel by channel."""

import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.checks.colour import Colour, smooth_colour
from windsysid.checks.innovation_sums import (
    SURROUNDING_BINS,
    Stretch,
    Sums,
    band_of_interest,
    measure_stretch,
    spectral_window,
)
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY
from windsysid.checks.lines import line_bound
from windsysid.checks.stationarity import Shared, most_shared, steadiness

__all__ = ["ChannelCheck", "Whiteness", "chance_limit", "examine", "judge_stretches"]


NEAR_MODE_FACTOR = 1.3
"""Setting: factor on a natural frequency within which the spectrum is averaged."""


class ChannelCheck(NamedTuple):
    """Statistics of the innovations of one channel.

    Attributes
    ----------
    name, used
        The channel, and its readings that the filter took in.
    nis, nis_low, nis_high
        Mean square of the whitened innovations and the interval in which chance holds it (95.45 %); 1 is expected.
    offset, kurtosis
        Their mean, in standard deviations of one innovation, and their excess kurtosis; 0 is expected.
    colour
        Sum of their squared autocorrelations, less what chance gives: half the mean square departure of the spectrum
        from 1 (Parseval).
    outliers, outlying
        How many innovations are more than five of their own standard deviations off, and their share of the squares.
    missing, gated
        Shares of the samples without a reading, and with one that the filter left out as an outlier.
    peak_hz, peak, far_hz, far
        Frequency [Hz] and level of the highest peak of the spectrum (1: their variance spread evenly) within reach of
        the natural frequencies, and out of reach; NaN for too short a record.
    near_hz, near
        The natural frequency [Hz] around which the spectrum is highest on average, and that average.
    line_hz, line
        Frequency [Hz] near a natural one that stands out most of its surroundings in the periodogram of the whole
        record, and how far, as a ratio of powers.
    unsteady, unsteady_sigmas, tails, tails_sigmas
        `windsysid.checks.stationarity.Level`.
    """

    name: str
    used: int
    nis: float
    nis_low: float
    nis_high: float
    offset: float
    colour: float
    kurtosis: float
    outliers: int
    outlying: float
    missing: float
    gated: float
    peak_hz: float
    peak: float
    far_hz: float
    far: float
    near_hz: float
    near: float
    line_hz: float
    line: float
    unsteady: float
    unsteady_sigmas: float
    tails: float
    tails_sigmas: float


class Whiteness(NamedTuple):
    """Innovations against white noise.

    Attributes
    ----------
    used, nis, nis_low, nis_high
        Readings of all channels together, their normalised innovation squared, and the interval in which chance holds
        it (95.45 %).
    channels
        One `ChannelCheck` each.
    lags, autocorrelation, autocorrelation_bound
        (L,) [s], (L, m), and what 95.45 % of white noise stays inside.
    frequency, spectrum, spectrum_bound
        (F,) [Hz], (F, m), white noise being 1, and what all frequencies and channels of white noise stay below, but for
        one record in 1000.
    colour_bound
        What the colour of white noise stays below, but for one record in 1000.
    line_bound
        The same for the ratio of a line, but for a share `FALSE_ALARM_PROBABILITY` of records.
    shared
        What two channels share most (`windsysid.checks.stationarity`); None of one channel alone.
    smooth
        How the level departs from 1 over half-octaves (`windsysid.checks.colour`); None of too short a record.
    """

    used: int
    nis: float
    nis_low: float
    nis_high: float
    channels: tuple[ChannelCheck, ...]
    lags: Array
    autocorrelation: Array
    autocorrelation_bound: float
    frequency: Array
    spectrum: Array
    spectrum_bound: float
    colour_bound: float
    line_bound: float
    shared: Shared | None
    smooth: Colour | None = None


def examine(
    whitened: Array,
    *,
    names: Sequence[str],
    rate: float,
    frequencies: Sequence[float],
    gated: NDArray[np.bool_] | None = None,
) -> Whiteness:
    """Hold whitened innovations (T, m), NaN where missing or gated, against white noise of variance 1.

    Parameters
    ----------
    names
        Of the m readings.
    rate
        [Hz].
    frequencies
        Natural frequencies [Hz], near which the spectrum matters.
    gated
        Where a reading was left out as an outlier (T, m).
    """
    return judge_stretches(
        measure_stretch(whitened, rate=rate, frequencies=frequencies, gated=gated), names=names, frequencies=frequencies
    )


def judge_stretches(stretch: Stretch, *, names: Sequence[str], frequencies: Sequence[float]) -> Whiteness:
    """Test the sums of `measure_stretch` against white noise of variance 1; parameters as for `examine`."""
    parts = {
        columns: _judge_alike(sums, [names[c] for c in columns], frequencies) for columns, sums in stretch.parts.items()
    }
    return _together(parts, len(stretch.grids))


def _together(parts: dict[tuple[int, ...], Whiteness], m: int) -> Whiteness:
    """The innovations of all channels, from those of channels read at the same times, by their columns."""
    if len(parts) == 1:
        return next(iter(parts.values()))
    alike = parts.values()
    lags, correlation = _joined_correlation(parts, m)
    frequency, spectrum = _joined_spectrum(parts, m)
    total = sum(w.used for w in alike)
    low, high = _chi_square_interval(total)
    colours = filter(None, (w.smooth for w in alike))
    return Whiteness(
        used=total, nis=sum(w.nis * w.used for w in alike) / max(total, 1), nis_low=low, nis_high=high,
        channels=_channels_of(parts), lags=lags, autocorrelation=correlation,
        autocorrelation_bound=max(w.autocorrelation_bound for w in alike), frequency=frequency, spectrum=spectrum,
        spectrum_bound=max(w.spectrum_bound for w in alike), colour_bound=max(w.colour_bound for w in alike),
        line_bound=max(w.line_bound for w in alike), shared=_most_shared_of(parts),
        smooth=max(colours, key=lambda smooth: smooth.statistic / smooth.bound, default=None),
    )  # fmt: skip


def _channels_of(parts: dict[tuple[int, ...], Whiteness]) -> tuple[ChannelCheck, ...]:
    """The channels of all parts by their columns."""
    found = [(column, one) for columns, w in parts.items() for column, one in zip(columns, w.channels, strict=True)]
    return tuple(one for _, one in sorted(found, key=operator.itemgetter(0)))


def _joined_correlation(parts: dict[tuple[int, ...], Whiteness], m: int) -> tuple[Array, Array]:
    """Lags of all parts (L,) and autocorrelations of all m channels (L, m), NaN at lags that one does not have."""
    lags = np.unique(np.concatenate([w.lags for w in parts.values()]).round(9))
    correlation = np.full((len(lags), m), np.nan)
    for columns, w in parts.items():
        correlation[np.ix_(np.searchsorted(lags, w.lags.round(9)), np.array(columns))] = w.autocorrelation
    return lags, correlation


def _joined_spectrum(parts: dict[tuple[int, ...], Whiteness], m: int) -> tuple[Array, Array]:
    """Frequencies of the finest part (F,) and spectra of all m channels there (F, m), NaN above the highest of each."""
    frequency = max((w.frequency for w in parts.values()), key=len)
    spectrum = np.full((len(frequency), m), np.nan)
    for columns, w in parts.items():
        inside = frequency <= w.frequency[-1:].max(initial=0.0) * (1.0 + 1e-9)
        for own, column in enumerate(columns if len(w.frequency) else ()):
            spectrum[inside, column] = np.interp(frequency[inside], w.frequency, w.spectrum[:, own])
    return frequency, spectrum


def _most_shared_of(parts: dict[tuple[int, ...], Whiteness]) -> Shared | None:
    """Of channels that are read at the same times, the two that share most, by their columns in the whole."""
    found = [
        w.shared._replace(first=columns[w.shared.first], second=columns[w.shared.second])
        for columns, w in parts.items()
        if w.shared is not None
    ]
    return max(found, key=lambda shared: shared.sigmas, default=None)


def _judge_alike(sums: Sums, names: Sequence[str], frequencies: Sequence[float]) -> Whiteness:
    """`judge_stretches` for channels that are read at the same times."""
    m = len(names)
    reach = band_of_interest(frequencies)
    number, rate, lags = sums.number, sums.rate, len(sums.pairs)
    correlation = sums.products / np.maximum(sums.pairs, 1)
    colour = np.square(correlation).sum(axis=0) - lags / np.maximum(number, 1)
    frequency, spectrum, freedom = _spectrum(sums)
    reached = (frequency >= reach[0]) & (frequency <= reach[1])
    sums_of_level = (sums.windows, sums.level, sums.level_second, sums.level_fourth)
    checks = []
    for c, name in enumerate(names):
        low, high = _chi_square_interval(int(number[c]))
        own = frequency <= sums.highest[c]
        count = max(number[c], 1)
        checks.append(
            ChannelCheck(
                name=name,
                used=int(number[c]),
                nis=float(sums.second[c] / count),
                nis_low=low,
                nis_high=high,
                offset=float(sums.first[c] / count),
                colour=float(colour[c]),
                kurtosis=float(sums.fourth[c] / count - 3.0),
                outliers=int(sums.beyond[c]),
                outlying=float(sums.beyond_second[c] / count),
                missing=float(1.0 - sums.seen[c] / sums.samples),
                gated=float(sums.gated[c] / sums.samples),
                **dict(zip(("peak_hz", "peak"), _peak(frequency, spectrum[:, c], reached & own), strict=True)),
                **dict(zip(("far_hz", "far"), _peak(frequency, spectrum[:, c], ~reached & own), strict=True)),
                **dict(zip(("near_hz", "near"), _near(frequency[own], spectrum[own, c], frequencies), strict=True)),
                line_hz=float(sums.line_hz[c]),
                line=float(sums.line[c]),
                **steadiness(*(float(v[c]) for v in sums_of_level), window=sums.window)._asdict(),
            )
        )
    swell = float(np.median([check.unsteady for check in checks]))
    freedom /= 1.0 + swell**2  # of loads whose level varies, strong segments count most
    total = int(number.sum())
    low, high = _chi_square_interval(total)
    fewest = max(int(number.min(initial=total)), 1)
    return Whiteness(
        used=total,
        nis=float(sums.second.sum() / max(total, 1)),
        nis_low=low,
        nis_high=high,
        channels=tuple(checks),
        lags=np.arange(1, lags + 1) / rate,
        autocorrelation=correlation,
        autocorrelation_bound=2.0 / math.sqrt(fewest),
        frequency=frequency,
        spectrum=spectrum,
        spectrum_bound=chance_limit(FALSE_ALARM_PROBABILITY / max(spectrum.size, 1), freedom) / freedom,
        colour_bound=(chance_limit(FALSE_ALARM_PROBABILITY / m, lags) - lags) / fewest,
        line_bound=line_bound(sums.tested, SURROUNDING_BINS, FALSE_ALARM_PROBABILITY),
        shared=most_shared(sums.shared, sums.shared_pairs),
        smooth=smooth_colour(
            frequency,
            np.where(frequency[:, None] <= sums.highest, spectrum, np.nan),
            freedom,
            reach=reach,
            chance=FALSE_ALARM_PROBABILITY,
        ),
    )


def _spectrum(sums: Sums) -> tuple[Array, Array, float]:
    """Frequencies (F,), spectra (F, m), 1 for white noise of variance 1, and their degrees of freedom.

    The spectrum is divided by the share of the samples that are not missing. The lowest two and the last frequency are
    left out: there the window mixes in the mean and the mirror image.
    """
    length, segments = sums.length, sums.segments
    if not segments:
        return np.empty(0), np.empty((0, len(sums.number))), 1.0
    window = spectral_window(length)
    share = np.maximum(sums.number / sums.samples, 1e-12)
    spectrum = sums.power / (segments * np.square(window).sum() * share)
    overlap = (window[: length - length // 2] @ window[length // 2 :] / np.square(window).sum()) ** 2
    freedom = 2.0 * segments / (1.0 + 2.0 * overlap * (1.0 - 1.0 / segments))
    kept = slice(2, len(spectrum) - 1)
    frequency = np.asarray(np.arange(length // 2 + 1)[kept] * (sums.rate / length), dtype=np.float64)
    return frequency, np.asarray(spectrum[kept]), float(freedom)


def _peak(frequency: Array, spectrum: Array, among: NDArray[np.bool_]) -> tuple[float, float]:
    """The frequency and height of the highest point of a spectrum (F,) among some frequencies.

    If it is a peak, a parabola through its neighbours refines it.
    """
    if not among.any():
        return math.nan, math.nan
    i = int(np.argmax(np.where(among, spectrum, -math.inf)))
    at = float(frequency[i])
    if 0 < i < len(spectrum) - 1 and spectrum[i] >= max(spectrum[i - 1], spectrum[i + 1]):
        left, top, right = np.log(np.maximum(spectrum[i - 1 : i + 2], 1e-300))
        bend = left - 2.0 * top + right
        if bend < 0.0:
            at += 0.5 * float((left - right) / bend) * float(frequency[i + 1] - frequency[i])
    return at, float(spectrum[i])


def _near(frequency: Array, spectrum: Array, natural: Sequence[float]) -> tuple[float, float]:
    """The natural frequency [Hz] around which a spectrum (F,) is highest on average, and that average."""
    inside = [(f, (frequency > f / NEAR_MODE_FACTOR) & (frequency < f * NEAR_MODE_FACTOR)) for f in natural]
    levels = [(float(spectrum[band].mean()), f) for f, band in inside if band.any()]
    level, at = max(levels, default=(math.nan, math.nan))
    return at, level


def _chi_square_interval(n: int) -> tuple[float, float]:
    """Two-sided 95.45 % quantiles of χ²_n / n."""
    if n < 1:
        return 0.0, math.inf
    return chance_limit(0.97725, n) / n, chance_limit(0.02275, n) / n


def chance_limit(probability: float, freedom: float) -> float:
    """The value that χ² exceeds with that probability."""
    from scipy.special import gammainccinv

    return 2.0 * float(gammainccinv(0.5 * freedom, probability))

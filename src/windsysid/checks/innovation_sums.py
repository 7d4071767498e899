"""Sums over whitened innovations that add up over stretches of a record: its size, autocorrelation and spectrum in
fixed memory."""

import math
import operator
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.checks.limits import INTEREST_FACTORS, LINE_NEAR_MODE_FACTOR, OUTLIER_SIGMAS
from windsysid.checks.lines import stand_out
from windsysid.checks.stationarity import levels, shared_products

__all__ = ["Stretch", "Sums", "band_of_interest", "measure_stretch", "spectral_window"]


SEGMENTS_PER_RECORD = 16
"""Setting: segment lengths per record for its spectrum; overlapping by half, one less than twice as many segments."""

MIN_SEGMENT_SAMPLES = 16
"""Setting: smallest number of samples of such a segment, below which there is no spectrum."""

MAX_LAGS = 200
"""Setting: largest number of lags of the autocorrelation."""

SURROUNDING_BINS = 40
"""Setting: frequency bins to either side of a line that give the level around it in innovations."""

LEVEL_PERIODS = 5.0
"""Setting: periods of the lowest natural frequency in a window in which the level of innovations is estimated."""


class Sums(NamedTuple):
    """Sums over innovations of m channels that are read at the same times, which add up over stretches of a record.

    Attributes
    ----------
    rate
        [Hz].
    samples
        In all stretches.
    number, first, second, fourth
        Readings used, and the sums of their whitened innovations, of the squares, and of the fourth powers scaled to
        variance 1 (m,).
    beyond, beyond_second
        How many of those scaled are outliers, and the sum of their squares (m,).
    seen, gated
        Samples with a reading, and with one that the filter left out (m,).
    highest
        Half the rate at which a channel is mostly read [Hz] (m,).
    pairs, products
        Pairs of readings at each lag, and the sums of their products (L, m).
    length, segments, power
        Samples of a segment of the spectrum, how many segments, and the sums of their squared amplitudes (F, m).
    line, line_hz, tested
        How far one frequency of a stretch's periodogram stands out of its surroundings at most, near a natural
        frequency, where [Hz] (m,), and how many frequencies were looked at.
    """

    rate: float
    samples: int
    number: Array
    first: Array
    second: Array
    fourth: Array
    beyond: Array
    beyond_second: Array
    seen: Array
    gated: Array
    highest: Array
    pairs: NDArray[np.int64]
    products: Array
    length: int
    segments: int
    power: Array
    line: Array
    line_hz: Array
    tested: int
    window: int
    windows: Array
    level: Array
    level_second: Array
    level_fourth: Array
    shared: Array
    shared_pairs: Array


class Stretch(NamedTuple):
    """Sums over one or several segments of a record.

    Attributes
    ----------
    grids
        First sample and step at which each channel is read, samples counted from the beginning of the first stretch.
    samples
        In all stretches.
    parts
        Sums over channels that are read at the same times, by their columns.
    """

    grids: tuple[tuple[int, int], ...]
    samples: int
    parts: dict[tuple[int, ...], Sums]


def measure_stretch(
    whitened: Array,
    *,
    rate: float,
    frequencies: Sequence[float],
    gated: NDArray[np.bool_] | None = None,
    before: Stretch | None = None,
) -> Stretch:
    """The sums over a stretch of whitened innovations (T, m); parameters as for `windsysid.checks.whiteness.examine`.

    A record that is judged in one stretch is judged as it is. Of several, each is centred and scaled by itself, and
    spectra have the resolution of the first: `before` is what the stretches before this one add up to, this one is
    added to it.
    """
    gated = np.zeros(whitened.shape, dtype=np.bool_) if gated is None else gated
    if before is None:
        before = Stretch(tuple(_own_samples(seen) for seen in (np.isfinite(whitened) | gated).T), 0, {})
    parts = {}
    for own in dict.fromkeys(before.grids):
        columns = tuple(c for c, other in enumerate(before.grids) if other == own)
        first, step = own
        rows = slice((first - before.samples) % step, None, step)
        like = before.parts.get(columns)
        found = _add_up(whitened[rows, columns], gated[rows, columns], rate / step, frequencies, like)
        parts[columns] = found if like is None else _join(like, found)
    return Stretch(before.grids, before.samples + len(whitened), parts)


def band_of_interest(frequencies: Sequence[float]) -> tuple[float, float]:
    """Lowest and highest frequency [Hz] within reach of the natural ones."""
    return INTEREST_FACTORS[0] * min(frequencies, default=0.0), INTEREST_FACTORS[1] * max(frequencies, default=math.inf)


def _own_samples(seen: NDArray[np.bool_]) -> tuple[int, int]:
    """First and step of the coarsest grid that holds all samples seen of a channel (T,)."""
    at = np.flatnonzero(seen)
    step = max(int(np.gcd.reduce(np.diff(at))), 1) if len(at) > 1 else 1
    return (int(at[0]) % step if len(at) else 0), step


def _add_up(
    whitened: Array, gated: NDArray[np.bool_], rate: float, frequencies: Sequence[float], like: Sums | None
) -> Sums:
    """The sums for channels that are read at the same times, with lags and segments `like` those of the stretches
    before."""
    samples = len(whitened)
    used = np.isfinite(whitened)
    number = used.sum(axis=0)
    z = np.where(used, whitened, 0.0)
    offset = z.sum(axis=0) / np.maximum(number, 1)
    centred = np.where(used, z - offset, 0.0)
    variance = np.maximum(np.square(centred).sum(axis=0) / np.maximum(number, 1), 1e-300)
    scaled = centred / np.sqrt(variance)  # size is one question, colour and spikes are others
    beyond = np.abs(scaled) > OUTLIER_SIGMAS
    lowest = band_of_interest(frequencies)[0]
    most = int(np.clip(rate / max(lowest, 1e-12), 10, max(10, min(MAX_LAGS, samples // 10))))
    pairs, products = _lagged(scaled, used, most if like is None else len(like.pairs))
    length = samples // SEGMENTS_PER_RECORD if like is None else like.length
    segments, power = _power(scaled, length)
    line, line_hz, tested = _strongest_line(scaled, rate, frequencies)
    window = _level_window(samples, rate, frequencies) if like is None else like.window
    windows, level, level_second, level_fourth = levels(z, used, window)
    shared, shared_pairs = shared_products(scaled, used)
    return Sums(
        rate=rate, samples=samples, number=number, first=z.sum(axis=0), second=np.square(z).sum(axis=0),
        fourth=(scaled**4).sum(axis=0), beyond=beyond.sum(axis=0),
        beyond_second=np.square(np.where(beyond, scaled, 0.0)).sum(axis=0), seen=(used | gated).sum(axis=0),
        gated=gated.sum(axis=0), highest=np.array([_highest(own, rate) for own in (used | gated).T]), pairs=pairs,
        products=products, length=length, segments=segments, power=power, line=line, line_hz=line_hz, tested=tested,
        window=window, windows=windows, level=level, level_second=level_second, level_fourth=level_fourth,
        shared=shared, shared_pairs=shared_pairs,
    )  # fmt: skip


def _level_window(samples: int, rate: float, frequencies: Sequence[float]) -> int:
    """Samples over which the level is taken: some periods of the slowest motion, a fortieth where none is known."""
    wanted = LEVEL_PERIODS * rate / min(frequencies) if frequencies else samples / 40.0
    return max(math.ceil(wanted), MIN_SEGMENT_SAMPLES)


def _join(before: Sums, more: Sums) -> Sums:
    """The sums of two stretches."""
    added = Sums(*map(operator.add, before, more))
    highest = np.minimum(before.highest, more.highest)
    line, line_hz = np.where(more.line > before.line, [more.line, more.line_hz], [before.line, before.line_hz])
    return added._replace(
        rate=before.rate, length=before.length, highest=highest, line=line, line_hz=line_hz, window=before.window
    )


def _highest(seen: NDArray[np.bool_], rate: float) -> float:
    """Half of the usual sampling rate of a channel (T,) [Hz]: its spectrum above is an image."""
    gaps = np.diff(np.flatnonzero(seen))
    return 0.5 * rate / float(np.median(gaps)) if len(gaps) else 0.5 * rate


def _lagged(z: Array, used: NDArray[np.bool_], lags: int) -> tuple[NDArray[np.int64], Array]:
    """Numbers of pairs of z (T, m) with variance 1 at lags 1 … L, and the sums of their products (L, m)."""
    pairs, products = np.zeros((lags, z.shape[1]), dtype=np.int64), np.zeros((lags, z.shape[1]))
    for k in range(1, min(lags, len(z) - 1) + 1):
        pairs[k - 1] = (used[k:] & used[:-k]).sum(axis=0)
        products[k - 1] = (z[k:] * z[:-k]).sum(axis=0)
    return pairs, products


def _power(z: Array, length: int) -> tuple[int, Array]:
    """Number of segments of that length in z (T, m), and the sums of their squared amplitudes by Welch's method (F, m).

    Samples that are missing are zero.
    """
    total = np.zeros((length // 2 + 1, z.shape[1]))
    if length < MIN_SEGMENT_SAMPLES:
        return 0, total
    window = spectral_window(length)
    starts = np.arange(0, len(z) - length + 1, length // 2)
    for start in starts:
        total += np.abs(np.fft.rfft(window[:, None] * z[start : start + length], axis=0)) ** 2
    return len(starts), total


def _strongest_line(z: Array, rate: float, frequencies: Sequence[float]) -> tuple[Array, Array, int]:
    """Of the periodogram of z (T, m) near the natural frequencies, how far its highest point stands out of the mean of
    its surroundings and where [Hz] (m,), and how many points there are.

    Every frequency is near where none is known to be natural.
    """
    samples, m = z.shape
    power = np.abs(np.fft.rfft(np.hanning(samples)[:, None] * z, axis=0)) ** 2
    frequency = np.arange(len(power)) * (rate / samples)
    near = np.zeros(len(power), dtype=np.bool_)
    for natural in frequencies or [0.0]:
        highest = natural * LINE_NEAR_MODE_FACTOR or math.inf
        near |= (frequency > natural / LINE_NEAR_MODE_FACTOR) & (frequency < highest)
    near[: SURROUNDING_BINS + 1] = near[-SURROUNDING_BINS - 1 :] = False
    if not near.any():
        return np.zeros(m), np.full(m, math.nan), 0
    at = np.flatnonzero(near)
    ratio = stand_out(power, at, SURROUNDING_BINS)
    highest = np.argmax(ratio, axis=0)
    return ratio[highest, range(m)], frequency[at[highest]], m * len(at)


def spectral_window(length: int) -> Array:
    """Hann's window of a segment (length,)."""
    return np.asarray(np.hanning(length + 1)[:-1])

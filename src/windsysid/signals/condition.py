"""Conditioning: irregular time onto a grid, spikes out, bias, gravity and tilt out.

Nothing is invented: what falls into a gap of more than a few samples is missing afterwards, spikes become missing,
and every function says what it took away.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.records.checks import refuse_gaps
from windsysid.records.record import LOW_PASS, Record
from windsysid.signals.integration import GRAVITY
from windsysid.signals.textbook import cubic_spline

__all__ = ["Despiked", "LevelledPair", "Unbiased", "despike", "remove_bias", "remove_gravity_and_tilt", "resample"]


_TURN = 2.0 * math.pi
_MAX_ROWS = 50_000_000


class Despiked(NamedTuple):
    """Channel without its spikes.

    Attributes
    ----------
    values
        (T,), in the channel's unit, NaN where there was a spike.
    spikes
        (T,), True where there was one.
    """

    values: Array
    spikes: NDArray[np.bool_]

    @property
    def found(self) -> int:
        """Number of samples that were removed."""
        return int(self.spikes.sum())


class Unbiased(NamedTuple):
    """Channel without its mean.

    Attributes
    ----------
    values
        (T,), in the channel's unit.
    bias
        The mean that was removed, in the channel's unit.
    """

    values: Array
    bias: float


class LevelledPair(NamedTuple):
    """Pair of horizontal and vertical acceleration, with tilt and gravity removed.

    Attributes
    ----------
    lateral, upward
        (T,) each [m/s²].
    tilt
        Tilt of the instrument [rad].
    gravity
        Mean acceleration of the instrument [m/s²].
    """

    lateral: Array
    upward: Array
    tilt: float
    gravity: float


_MAX_VALUE = 1e100
"""Beyond this the slopes of a curve through the values overflow; no instrument reads it."""


def resample(
    record: Record, rate: float, *, start: float | None = None, end: float | None = None, max_gap: int = 3
) -> Record:
    """Resample a record to a uniform time grid of `rate` [Hz], without aliasing; irregular time is allowed.

    Each channel is interpolated by cubic splines to a grid at least as fine as it was recorded; where `rate` is lower,
    that grid is a multiple of it and goes through a zero-phase low-pass at half of `rate` (flat to 0.4, zero from 0.6)
    before it is decimated. Splines follow motion of up to a quarter of the original rate to better than a percent.
    Angles that wrap (azimuth, yaw, direction) are resampled unwrapped and wrapped again.

    Parameters
    ----------
    record : Record
        Time regular or not.
    rate : float
        Sampling rate of the new grid [Hz].
    start, end : float, optional
        First and last time of the grid [s]; the record's own by default. Samples outside the record are missing.
    max_gap : int, default 3
        Gaps of up to this many missing samples are interpolated; longer ones are missing in the result.

    Returns
    -------
    Record
        With an attribute that holds the rate before.

    Raises
    ------
    RecordError
        If the rate is not positive or the grid absurdly long.

    Examples
    --------
    >>> import windsysid as ws
    >>> record = ws.simulate("tower", duration=60.0, rate=20.0)
    >>> ws.signals.resample(record, 5.0).rate
    5.0
    """
    first = float(record.time[0]) if start is None else float(start)
    last = float(record.time[-1]) if end is None else float(end)
    grid = _grid(record, rate, first, last, (max_gap + 1.5) / record.rate)
    columns = [_on_grid(record, name, grid) for name in record.channels]
    passed = {LOW_PASS: f"{0.5 * rate:.6g}"} if grid.factor > 1 else {}
    return Record(
        first + np.arange(grid.rows) / rate,
        np.column_stack(columns) if columns else np.empty((grid.rows, 0)),
        record.channels,
        record.units,
        name=record.name,
        attributes={**record.attributes, "resampled": f"from {record.rate:g} to {rate:g} Hz", **passed},
        start=record.start,
    )


class _Grid(NamedTuple):
    """A grid of `rows` times, `factor` times finer [s] with `margin` more times at both ends, which the low-pass needs.

    Gaps longer than `limit` [s] stay missing.
    """

    rows: int
    factor: int
    margin: int
    fine: Array
    limit: float


def _grid(record: Record, rate: float, first: float, last: float, limit: float) -> _Grid:
    """The grid of `rate` [Hz] from the first to the last time [s]; RecordError where there is none."""
    if not (np.isfinite(rate) and rate > 0.0):
        raise RecordError(f"resampling: expected a positive rate, got {rate:g} Hz")
    if not (last - first) * rate >= 1.0:
        raise RecordError(
            f"resampling: {first:g} to {last:g} s holds no step at {rate:g} Hz; expected a longer time or a higher rate"
        )
    rows = math.floor((last - first) * rate * (1.0 + 1e-12) + 1e-6) + 1
    factor = math.ceil(record.rate / rate * (1.0 - 1e-6)) if record.rate > rate * (1.0 + 1e-6) else 1
    if rows * factor > _MAX_ROWS:
        if record.duration * record.rate > 10 * record.samples:
            refuse_gaps(record.name, record.time, rows * factor)
        raise RecordError(
            f"resampling: {rows} rows at {rate:g} Hz are too many; choose a lower rate or a shorter section"
        )
    margin = 40 * factor if factor > 1 else 0
    fine = first + (np.arange(rows * factor + 2 * margin) - margin) / (rate * factor)
    return _Grid(rows, factor, margin, fine, limit)


def _on_grid(record: Record, name: str, grid: _Grid) -> Array:
    """The values of a channel (rows,) on a grid."""
    values = record[name]
    known = np.isfinite(values)
    time, values = record.time[known], values[known]
    if not len(values):
        return np.full(grid.rows, np.nan)
    if np.abs(values).max() > _MAX_VALUE:
        raise RecordError(
            f"channel '{name}' reaches {np.abs(values).max():.3g}, too large to be resampled; correct its values,"
            " or leave the column out"
        )
    wraps = record.unit(name) == "rad" and bool({"azimuth", "yaw", "direction"} & set(name.split("_")))
    column = _interpolated(time, _unwrapped(values, time, grid.limit) if wraps else values, grid.fine, grid.limit)
    if grid.factor > 1:
        column = _decimated(column, grid.factor, grid.margin)
    if wraps:
        low = -math.pi if float(values.min()) < 0.0 else 0.0
        column = np.mod(column - low, _TURN) + low
    return column[: grid.rows]


def _blocks(time: Array, limit: float) -> Sequence[slice]:
    """Stretches of samples without a gap longer than `limit` [s]."""
    edges = [0, *(np.flatnonzero(np.diff(time) > limit) + 1).tolist(), len(time)]
    return [slice(a, b) for a, b in pairwise(edges) if b > a]


def _unwrapped(values: Array, time: Array, limit: float) -> Array:
    """Each stretch unwrapped by itself: how far it turned in a gap is not known, and does not matter."""
    return np.concatenate([np.unwrap(values[block]) for block in _blocks(time, limit)])


def _interpolated(time: Array, values: Array, grid: Array, limit: float) -> Array:
    result = np.full(len(grid), np.nan)
    for block in _blocks(time, limit):
        t, y = time[block], values[block]
        slack = 1e-6 * limit
        inside = slice(*np.searchsorted(grid, (t[0] - slack, t[-1] + slack)))
        at = np.clip(grid[inside], t[0], t[-1])
        if len(t) >= 4:
            result[inside] = cubic_spline(t, y, at)
        elif len(t) >= 2:
            result[inside] = np.interp(at, t, y)
        else:
            result[inside] = y[0]
    return result


def _decimated(fine: Array, factor: int, margin: int) -> Array:
    """Every `factor`-th value behind a zero-phase low-pass; a gap is filled from its edges for the filter and stays a
    gap.
    """
    known = np.isfinite(fine)
    if not known.any():
        return fine[margin::factor]
    from scipy.fft import irfft, next_fast_len, rfft

    taps = _low_pass(factor, margin)
    index = np.arange(len(fine))
    whole = np.interp(index, index[known], fine[known])
    # An unwrapped azimuth runs away: its edges are continued by odd reflection, a constant would bend them.
    first, last = index[known][[0, -1]]
    n = min(margin, int(last - first))
    if n > 0:
        head = slice(max(first - n, 0), first)
        tail = slice(last + 1, min(last + 1 + n, len(fine)))
        whole[head] = 2.0 * whole[first] - whole[2 * first - index[head]]
        whole[tail] = 2.0 * whole[last] - whole[2 * last - index[tail]]
        whole[: head.start] = whole[head.start]
        whole[tail.stop :] = whole[tail.stop - 1]
    size = next_fast_len(len(whole) + len(taps) - 1, real=True)
    passed = np.asarray(irfft(rfft(whole, size) * rfft(taps, size), size), dtype=np.float64)
    passed = passed[margin : margin + len(whole)]
    passed[~known] = np.nan
    return passed[margin::factor]


def _low_pass(factor: int, margin: int) -> Array:
    """Taps of a root raised cosine: gain 1 up to 0.4 and 0 from 0.6 of the lower rate, and between them such that
    |H(f)|² + |H(rate − f)|² = 1.

    White noise stays white when every `factor`-th sample is taken, and a random load keeps the spectrum of its samples.
    A filter that removes all below half the rate leaves a hole there that no model of the samples has, and a mode's
    damping pays for it. Source: Proakis, Digital Communications, ch. 9.2.
    """
    across = np.linspace(0.4, 0.6, 41)
    gain = np.cos(0.25 * np.pi * (across - 0.4) / 0.1)
    f = np.linspace(0.0, 1.0, 1 + 2 ** math.ceil(math.log2(2 * margin + 1)))  # of half the rate
    wanted = np.interp(f, [0.0, *(2.0 * across / factor), 1.0], [1.0, *gain, 0.0])
    taps = np.fft.irfft(wanted * np.exp(-1j * np.pi * margin * f))[: 2 * margin + 1] * np.kaiser(2 * margin + 1, 4.0)
    return np.asarray(taps / taps.sum())  # of an azimuth that has run for hours a millionth would be an angle


def despike(values: ArrayLike, rate: float, *, threshold: float = 6.0, window: int = 11) -> Despiked:
    """Remove spikes: single samples, and short bursts, far from their neighbours.

    A sample is a spike where its distance from the median of `window` samples exceeds `threshold` robust standard
    deviations (1.4826 MAD) twice over: of its own window (Hampel's filter, which keeps slopes and crests) and of the
    ten seconds around (which keeps noise).

    Parameters
    ----------
    values : array_like
        (T,), any unit; NaN = missing.
    rate : float
        Sampling rate [Hz].
    threshold : float, default 6
        In robust standard deviations [1].
    window : int, default 11
        Odd number of samples; bursts of less than half of it are found.

    Returns
    -------
    Despiked
        The channel with NaN at its spikes, and where they were.

    Raises
    ------
    RecordError
        If the channel is not (T,), holds no numbers, or an option is out of range.

    References
    ----------
    Davies & Gather, J. Am. Stat. Assoc. 88, 1993, doi:10.1080/01621459.1993.10476339.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> values = np.sin(0.1 * np.arange(400))
    >>> values[100] += 5.0
    >>> found = ws.signals.despike(values, rate=20.0)
    >>> np.flatnonzero(found.spikes).tolist(), float(found.values[100])
    ([100], nan)
    """
    y = np.array(values, dtype=np.float64)
    known = np.isfinite(y)
    if y.ndim != 1 or not known.any():
        raise RecordError("despiking: expected a channel (T,) with numbers, got none; leave the channel out")
    if window < 3 or window % 2 == 0 or not threshold > 0.0 or not rate > 0.0:
        raise RecordError(
            f"despiking: expected an odd window of 3 or more and a positive threshold, got {window}, {threshold:g}"
        )
    x = y[known]
    half = window // 2
    spikes = np.zeros(len(y), dtype=bool)
    if len(x) > window:
        around = np.lib.stride_tricks.sliding_window_view(np.pad(x, half, mode="reflect"), window)
        median = np.median(around, axis=1)
        near = 1.4826 * np.median(np.abs(around - median[:, None]), axis=1)
        distance = np.abs(x - median)
        size = min(len(x), max(10 * window, round(10.0 * rate)))
        middles = np.arange(len(x) // size) * size + size / 2.0
        far = [1.4826 * float(np.median(distance[int(m - size / 2) : int(m + size / 2)])) for m in middles]
        far_off = np.interp(np.arange(len(x)), middles, far)
        # Rounding leaves an exact line at 1e-16 of its size: that is no scatter.
        rounding = 1e-12 * float(np.abs(x).max())
        spikes[known] = distance > threshold * np.maximum(np.maximum(near, far_off), rounding)
    y[spikes] = np.nan
    return Despiked(y, spikes)


def remove_bias(values: ArrayLike) -> Unbiased:
    """Remove the mean of a channel.

    Parameters
    ----------
    values : array_like
        (T,), any unit; NaN = missing, ignored.

    Returns
    -------
    Unbiased
        The channel with zero mean, and the mean.

    Raises
    ------
    RecordError
        If the channel holds no numbers.

    Examples
    --------
    >>> import windsysid as ws
    >>> ws.signals.remove_bias([1.0, 2.0, float("nan"), 3.0])
    Unbiased(values=array([-1.,  0., nan,  1.]), bias=2.0)
    """
    y = np.asarray(values, dtype=np.float64)
    if not np.isfinite(y).any():
        raise RecordError("bias: expected a channel with numbers, got none; leave the channel out")
    bias = float(np.nanmean(y))
    return Unbiased(y - bias, bias)


def remove_gravity_and_tilt(lateral: ArrayLike, upward: ArrayLike, *, gravity: float = GRAVITY) -> LevelledPair:
    """Remove gravity and tilt from a pair of accelerometer axes, by the direction of gravity in their means.

    An instrument tilted by θ, counter-clockwise, reads (a + g ŷ) e^{−iθ} along its axes; with zero mean acceleration
    the mean is i g e^{−iθ}, hence θ, and the pair times e^{iθ} less i g is a. A bias of b tilts the result by b / g.

    Parameters
    ----------
    lateral, upward : array_like
        (T,) [m/s²], the second a quarter turn counter-clockwise from the first; NaN = missing, in both results.
    gravity : float, default 9.80665
        Expected magnitude in the plane of the pair [m/s²].

    Returns
    -------
    LevelledPair
        The level pair, and the tilt and gravity that were found.

    Raises
    ------
    RecordError
        If shapes differ, no sample has both axes, or the mean is not within 10 % of gravity (an instrument that does
        not measure constant acceleration, or another unit).

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> motion = 0.1 * np.sin(np.arange(0.0, 60.0, 0.05))
    >>> reading = (motion + 9.80665j) * np.exp(-0.02j)  # tilted by 0.02 rad
    >>> found = ws.signals.remove_gravity_and_tilt(reading.real, reading.imag)
    >>> round(found.tilt, 3), round(found.gravity, 3)
    (0.02, 9.807)
    """
    first, second = (np.asarray(values, dtype=np.float64) for values in (lateral, upward))
    if first.shape != second.shape or first.ndim != 1:
        raise RecordError(f"tilt: expected two axes of one shape (T,), got {first.shape} and {second.shape}")
    reading = first + 1j * second
    known = np.isfinite(first) & np.isfinite(second)
    if not known.any():
        raise RecordError("tilt: expected samples with both axes, got none; choose another section")
    mean = complex(reading[known].mean())
    if not abs(abs(mean) - gravity) < 0.1 * gravity:
        raise RecordError(
            f"tilt: expected a mean of {gravity:.4g} m/s² over the two axes, got {abs(mean):.4g}: the instrument does"
            " not measure gravity, or its unit or the choice of axes is wrong"
        )
    tilt = float(np.angle(1j / mean))
    level = reading * np.exp(1j * tilt) - 1j * abs(mean)
    level[~known] = np.nan
    return LevelledPair(level.real.copy(), level.imag.copy(), tilt, abs(mean))

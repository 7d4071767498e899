"""Several loggers on one clock: offset and drift from a channel that two of them recorded, then one record.

The offset is where the cross-correlation of the common channel peaks, between samples by a parabola; the record is
then cut into pieces, and a line through their offsets gives drift (clocks that run at different speeds) and, by its
scatter, the uncertainty. An azimuth is compared as e^{iψ}: at constant speed it repeats every turn, and the result
says so.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.records.record import Record
from windsysid.signals.condition import resample

__all__ = ["Aligned", "ClockOffset", "align", "clock_offset"]


_PIECE_SECONDS = 20.0  # s, at least, for one offset
_PIECES = 20


class ClockOffset(NamedTuple):
    """Offset and drift of a logger's clock from the first logger's: t_first = t + offset + drift (t − middle).

    Attributes
    ----------
    offset, offset_std
        Offset at `middle` and its standard deviation [s].
    drift, drift_std
        Drift and its standard deviation [s/s]; NaN where the record is too short for a drift, which is then 0.
    middle
        Time on the logger's own clock to which `offset` belongs [s].
    channel
        The channel that was compared.
    correlation
        Correlation coefficient at the peak [1]: 1 is a perfect match.
    note
        A remark if another offset fits as well.
    """

    offset: float
    offset_std: float
    drift: float
    drift_std: float
    middle: float
    channel: str
    correlation: float
    note: str

    def corrected(self, time: Array) -> Array:
        """Times on the first logger's clock (T,) [s] of `time` on the logger's own (T,) [s]."""
        return time + self.offset + self.drift * (time - self.middle)


class Aligned(NamedTuple):
    """Record of several loggers on the clock of the first.

    Attributes
    ----------
    record
        The channels of all loggers on one time grid.
    offsets
        Clock offset of every logger but the first.
    """

    record: Record
    offsets: tuple[ClockOffset, ...]


def align(
    records: Sequence[Record], *, channel: str | None = None, rate: float | None = None, search: float = 60.0
) -> Aligned:
    """Align the records of several loggers to the clock of the first, over the time that all of them cover.

    Parameters
    ----------
    records : sequence of Record
        Two or more. Of channels that occur more than once, the earliest record's is kept.
    channel : str, optional
        Channel to compare; by default ``rotor_speed`` or ``rotor_azimuth`` where both have it, else any common one.
    rate : float, optional
        Sampling rate of the result [Hz]; the highest of the records by default.
    search : float, default 60
        Largest offset considered [s].

    Returns
    -------
    Aligned
        The record, and each logger's offset and drift.

    Raises
    ------
    RecordError
        If no channel is shared, the records do not overlap, or no channel correlates.

    See Also
    --------
    clock_offset : Offset of two loggers, without resampling.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> time = np.arange(0.0, 60.0, 0.05)
    >>> speed = ws.signals.band_pass(np.random.default_rng(0).standard_normal(time.size), 20.0, (0.05, 1.0))[:, None]
    >>> tower = ws.Record(time, np.hstack([speed, speed]), ("rotor_speed", "tower_x_acceleration"), ("rad/s", "m/s^2"))
    >>> blade = ws.Record(time - 2.0, np.hstack([speed, speed]), ("rotor_speed", "blade_1_strain"), ("rad/s", "1"))
    >>> found = ws.signals.align([tower, blade])  # the clock of the second is 2 s slow
    >>> found.record.channels, round(found.offsets[0].offset, 2)
    (('rotor_speed', 'tower_x_acceleration', 'blade_1_strain'), 2.0)
    """
    if len(records) < 2:
        raise RecordError(f"alignment: expected two or more records, got {len(records)}")
    first = records[0]
    rate = max(record.rate for record in records) if rate is None else rate
    offsets, moved = [], [first]
    for other in records[1:]:
        found = clock_offset(first, other, channel=channel, search=search)
        offsets.append(found)
        moved.append(Record(found.corrected(other.time), other.values, other.channels, other.units, other.name))
    start = max(float(record.time[0]) for record in moved)
    end = min(float(record.time[-1]) for record in moved)
    start = float(first.time[0]) + math.ceil((start - float(first.time[0])) * rate - 1e-6) / rate
    if not (end - start) * rate >= 1.0:
        raise RecordError(
            "alignment: the records do not overlap once their clocks agree; check that they belong together"
        )
    columns: dict[str, tuple[Array, str]] = {}
    for record in moved:
        part = resample(record, rate, start=start, end=end)
        for name in part.channels:
            columns.setdefault(name, (part[name], part.unit(name)))
    attributes = dict(first.attributes)
    for other, found in zip(records[1:], offsets, strict=True):
        attributes[f"clock of {other.name}"] = found.note
    grid = part.time
    whole = Record(
        grid,
        np.column_stack([values for values, _ in columns.values()]),
        tuple(columns),
        tuple(unit for _, unit in columns.values()),
        name=first.name,
        attributes=attributes,
        start=first.start,
    )
    return Aligned(whole, tuple(offsets))


def clock_offset(first: Record, other: Record, *, channel: str | None = None, search: float = 60.0) -> ClockOffset:
    """Estimate offset and drift of one logger's clock from another's, by a channel that both recorded.

    Parameters
    ----------
    first, other : Record
        Two records with a channel in common.
    channel, search
        As in `align`.

    Returns
    -------
    ClockOffset
        Offset that, added to the time of `other`, gives the time of `first`.

    Raises
    ------
    RecordError
        If the channel is not in both, is constant, or does not correlate (less than 0.5 at the peak).

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> time = np.arange(0.0, 60.0, 0.05)
    >>> speed = ws.signals.band_pass(np.random.default_rng(0).standard_normal(time.size), 20.0, (0.05, 1.0))[:, None]
    >>> first = ws.Record(time, speed, ("rotor_speed",), ("rad/s",))
    >>> other = ws.Record(time - 2.0, speed, ("rotor_speed",), ("rad/s",))  # its clock is 2 s slow
    >>> found = ws.signals.clock_offset(first, other)
    >>> round(found.offset, 2), round(found.correlation, 2)
    (2.0, 1.0)
    """
    name = _common(first, other) if channel is None else channel
    if not search > 0.0:
        raise RecordError(f"alignment: expected a positive search range, got {search:g} s")
    # Both at the lower of their rates, in which everything compared is known to both; sub-sample is up to the parabola.
    rate = min(first.rate, other.rate)
    a, start_a = _prepared(first, name, rate)
    b, start_b = _prepared(other, name, rate)
    lags, height = _correlation(a, b, rate, start_a - start_b, search)
    best = int(np.argmax(height))
    peak = float(height[best])
    if not peak > 0.5:
        raise RecordError(
            f"alignment by '{name}': the records correlate by {peak:.2f} at best within ±{search:g} s, expected more"
            " than 0.5; choose another channel or a wider search"
        )
    offset = _refined(lags, height, best)
    rival = _rival(height, best)
    # Pieces around that offset, for drift and uncertainty.
    middle = 0.5 * (float(other.time[0]) + float(other.time[-1]))
    low = max(0, round((start_a - offset - start_b) * rate))
    high = min(len(b), round((start_a + len(a) / rate - offset - start_b) * rate))
    count = min(_PIECES, int((high - low) / (rate * _PIECE_SECONDS)))
    centres, pieces = [], []
    for piece in range(count):
        i, j = (low + round(n * (high - low) / count) for n in (piece, piece + 1))
        shift = round((start_b + i / rate + offset - start_a) * rate)
        slack = max(3, round(2.0 * rate))
        k = max(0, shift - slack)
        local_lags, local = _correlation(
            a[k : shift + j - i + slack], b[i:j], rate, start_a + k / rate - start_b - i / rate, math.inf, near=offset
        )
        if local.size and float(local.max()) > 0.5:
            at = int(np.argmax(local))
            if 0 < at < len(local) - 1:
                centres.append(start_b + 0.5 * (i + j) / rate - middle)
                pieces.append(_refined(local_lags, local, at))
    drift, drift_std, offset_std = 0.0, math.nan, 0.5 / rate
    if len(pieces) >= 4:
        x, y = np.array(centres), np.array(pieces)
        keep = np.abs(y - np.median(y)) < 5.0 * 1.4826 * np.median(np.abs(y - np.median(y))) + 2.0 / rate
        x, y = x[keep], y[keep]
        design = np.column_stack([np.ones_like(x), x])
        (offset, drift), *_ = np.linalg.lstsq(design, y, rcond=None)
        scatter = float(np.sqrt(np.sum((y - design @ (offset, drift)) ** 2) / max(1, len(y) - 2)))
        cov = scatter**2 * np.linalg.inv(design.T @ design)
        offset_std, drift_std = float(np.sqrt(cov[0, 0])), float(np.sqrt(cov[1, 1]))
    note = f"'{name}': add {offset:.4g} ± {2 * offset_std:.2g} s"
    note += (
        "; too short to see drift"
        if math.isnan(drift_std)
        else f", drift {drift * 1e6:.3g} ± {2e6 * drift_std:.2g} ppm"
    )
    if rival > 0.98 * peak:
        note += (
            "; other offsets fit as well: the channel repeats itself, as an azimuth at constant speed does every turn"
        )
    return ClockOffset(float(offset), offset_std, float(drift), drift_std, middle, name, peak, note)


def _common(first: Record, other: Record) -> str:
    shared = [name for name in first.channels if name in other]
    for name in ("rotor_speed", "rotor_azimuth"):
        if name in shared and (name == "rotor_azimuth" or (_changes(first[name]) and _changes(other[name]))):
            return name
    usable = [name for name in shared if _changes(first[name]) and _changes(other[name])]
    if not usable:
        raise RecordError(
            f"alignment: records '{first.name}' and '{other.name}' share no channel that changes; give both the rotor"
            " signal"
        )
    return usable[0]


def _changes(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return len(known) > 1 and float(np.ptp(known)) > 1e-6 * float(np.abs(known).max())


def _prepared(record: Record, name: str, rate: float) -> tuple[NDArray[np.complex128], float]:
    """The channel at `rate` as a complex series with zero mean, 0 where missing; and the time of its first sample."""
    values = record[name]
    if not np.isfinite(values).any():
        raise RecordError(f"alignment: channel '{name}' of record '{record.name}' holds no numbers; choose another one")
    part = resample(record.select([name]), rate)
    y = np.exp(1j * part[name]) if name.endswith("azimuth") else part[name].astype(np.complex128)
    known = np.isfinite(y)
    y = np.where(known, y - y[known].mean(), 0.0)
    return y, float(part.time[0])


def _correlation(
    a: NDArray[np.complex128], b: NDArray[np.complex128], rate: float, between: float, search: float, near: float = 0.0
) -> tuple[Array, Array]:
    """Offsets to add to the time of b, and the correlation of the overlap; `between` is b's start less a's."""
    from scipy.signal import fftconvolve

    if not len(a) or not len(b):
        return np.empty(0), np.empty(0)
    raw = np.real(fftconvolve(a, np.conj(b[::-1])))
    energy_a = np.real(fftconvolve(np.abs(a) ** 2, np.ones(len(b))))
    energy_b = np.real(fftconvolve(np.ones(len(a)), np.abs(b[::-1]) ** 2))
    overlap = np.real(fftconvolve(np.ones(len(a)), np.ones(len(b))))
    lags = (np.arange(len(raw)) - (len(b) - 1)) / rate + between
    scale = np.sqrt(np.maximum(energy_a, 0.0) * np.maximum(energy_b, 0.0))
    floor = 1e-9 * math.sqrt(float(np.sum(np.abs(a) ** 2)) * float(np.sum(np.abs(b) ** 2))) + 1e-300
    height = np.where(scale > floor, raw / np.maximum(scale, floor), 0.0)
    enough = (overlap >= 0.5 * min(len(a), len(b))) & (np.abs(lags - near) <= search)
    return lags[enough], height[enough]


def _refined(lags: Array, height: Array, best: int) -> float:
    """The peak between samples, by a parabola through three of them."""
    if not 0 < best < len(height) - 1:
        return float(lags[best])
    before, at, after = height[best - 1 : best + 2]
    bend = before - 2.0 * at + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return float(lags[best] + shift * (lags[1] - lags[0]))


def _rival(height: Array, best: int) -> float:
    """The highest correlation outside the peak's own hill."""
    low = high = best
    while low > 0 and height[low - 1] < height[low]:
        low -= 1
    while high < len(height) - 1 and height[high + 1] < height[high]:
        high += 1
    rest = np.concatenate([height[:low], height[high + 1 :]])
    return float(rest.max()) if len(rest) else 0.0

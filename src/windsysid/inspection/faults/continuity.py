"""Breaks of continuity in a table of readings: pasted passages, samples lost while the time continued, overflows of
converters, and copied channels.

Each of them leaves every single value plausible. A passage that occurs twice makes intervals too narrow, lost samples
make damping too large, and a converter that runs over makes a spectrum of jumps.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY
from windsysid.inspection.fault import Fault
from windsysid.inspection.faults.runs import spans_of
from windsysid.inspection.limits import (
    MAX_OVERRUN_STEP_STD,
    MAX_UNWRAPPED_RATIO,
    MIN_COPIED_ROWS,
    MIN_OVERRUN_JUMPS,
    MIN_PREDICTED_ROWS,
)
from windsysid.inspection.rotor import turns_per_second
from windsysid.records.kept import kept_with_record
from windsysid.records.record import Record

__all__ = [
    "copied_channels", "copied_passages", "copies_among", "lost_samples", "normalised_errors", "overrun",
    "prediction_errors",
]  # fmt: skip

MAX_COPY_RESIDUAL = 1e-6
"""Tolerance: share of the power of a channel's steps that another channel does not explain, by rounding, if one is a
copy."""

PREDICTOR_READINGS = 24
"""Setting: number of readings from which the next one is predicted."""

MAX_FITTED_ROWS = 20_000
"""Setting: largest number of rows that a prediction is fitted to."""

_BLOCK_ROWS = 400
"""Setting: number of rows over which the size of prediction errors is estimated."""
_FACTOR, _MODULUS = 0x9E3779B97F4A7C15, 2**64
"""Numerical: multiplier and modulus of the hash of a passage."""


def copied_passages(record: Record, channels: Sequence[str]) -> list[Fault]:
    """Passages that repeat an earlier one to the last digit, in all these channels."""
    values = _columns(record, channels)
    if len(values) < 2 * MIN_COPIED_ROWS or not channels:
        return []
    moving = np.ones(len(values), dtype=np.bool_)
    moving[1:] = np.any(values[1:] != values[:-1], axis=1)
    usable = moving & np.isfinite(values).all(axis=1)
    key = np.zeros(len(values), dtype=np.uint64)
    for column in (values + 0.0).T:  # no negative zeros
        key = (key ^ np.ascontiguousarray(column).view(np.uint64)) * np.uint64(_FACTOR)
        key ^= key >> np.uint64(29)
    count, factor = 1, _FACTOR
    while count < MIN_COPIED_ROWS:  # what stands for a passage, from what stands for its halves
        key = key[:-count] * np.uint64(factor) + key[count:]
        usable = usable[:-count] & usable[count:]
        count, factor = 2 * count, factor * factor % _MODULUS
    at = np.flatnonzero(usable)
    _, first, which = np.unique(key[at], return_index=True, return_inverse=True)
    source = at[first[which]]
    again = at[source < at]
    if not again.size:
        return []
    mask = np.zeros(len(values) + 1, dtype=np.int64)
    np.add.at(mask, again, 1)
    np.add.at(mask, again + MIN_COPIED_ROWS, -1)
    copied = np.cumsum(mask)[:-1] > 0
    spans = spans_of(record.time, copied)
    data = {"share": float(copied.mean()), "origin": float(record.time[source[np.searchsorted(at, again[0])]])}
    return [Fault("", "copied passage", "warning", int(copied.sum()), spans, data)]


def copies_among(values: Array) -> list[tuple[int, int]]:
    """Pairs (kept, copy) of the columns of values (T, n) that are the same reading, whatever their scale and offset."""
    steps = np.diff(values, axis=0)  # slow drifts that channels share are no copy
    steps = steps[np.isfinite(steps).all(axis=1)]
    if len(steps) < 2 * MIN_COPIED_ROWS:
        return []
    steps /= np.maximum(np.sqrt(np.mean(steps**2, axis=0)), 1e-300)
    alike = steps.T @ steps / len(steps)
    found: list[tuple[int, int]] = []
    gone: set[int] = set()
    for i in range(len(alike)):
        for j in range(i + 1, len(alike)):
            if i not in gone and j not in gone and 1.0 - alike[i, j] ** 2 < MAX_COPY_RESIDUAL:
                found.append((i, j))
                gone.add(j)
    return found


@kept_with_record
def copied_channels(record: Record, channels: tuple[str, ...]) -> list[Fault]:
    """Channels that are others, whatever their scale and offset."""
    return [
        Fault(channels[j], "copy", "warning", record.samples, data={"of": channels[i]})
        for i, j in copies_among(_columns(record, channels))
    ]


def overrun(record: Record, channel: str) -> list[Fault]:
    """Jumps from one end of a channel's range to the other that go on as if they had not been: a converter that counted
    on where it should have stopped."""
    x = record[channel]
    known = np.flatnonzero(np.isfinite(x))
    if known.size < 2 * MIN_COPIED_ROWS or np.ptp(x[known]) == 0.0:
        return []
    place = (x[known] - x[known].min()) / np.ptp(x[known])
    step = np.diff(place)
    far = 1 + np.flatnonzero(np.abs(step[1:-1]) > 0.75)
    around = 0.5 * (step[far - 1] + step[far + 1])
    ends = (np.minimum(place[far], place[far + 1]) < 0.2) & (np.maximum(place[far], place[far + 1]) > 0.8)
    between = np.mean((place > 0.25) & (place < 0.75))
    if ends.sum() < MIN_OVERRUN_JUMPS or between < 0.2 or np.std(step[np.abs(step) <= 0.75]) > MAX_OVERRUN_STEP_STD:
        return []  # with few readings a period, crests follow troughs
    unwrapped = step[far] - np.sign(step[far])
    if np.median((unwrapped - around) ** 2 / (step[far] - around) ** 2) > MAX_UNWRAPPED_RATIO:
        return []
    time = record.time[known[far + 1][ends]]
    spans = np.column_stack([time, time])
    return [Fault(channel, "overrun", "warning", len(time), spans)]


def lost_samples(record: Record, channels: Sequence[str]) -> list[Fault]:
    """Places at regular distances where readings do not go on from those before, though the time does: buffers were
    lost between others that came through. A blow looks the same, but blows do not keep to multiples of some rows, apart
    from those of blades that pass the tower."""
    from scipy.special import gammainccinv

    values = _columns(record, channels)
    values = values[:, np.isfinite(values).all(axis=0)]
    if len(values) < MIN_PREDICTED_ROWS or not values.shape[1]:
        return []
    errors = np.array([normalised_errors(prediction_errors(column)) for column in values.T])
    usual = np.clip(errors, -4.0, 4.0)
    own, into = np.linalg.eigh(usual @ usual.T / len(values))
    apart = own > 1e-6 * own[-1]
    together = np.sum((into.T @ errors)[apart] ** 2 / own[apart, None], axis=0)
    middle = np.partition(errors**2, (len(errors) - 1) // 2, axis=0)[(len(errors) - 1) // 2]
    bound = 2.0 * float(gammainccinv(0.5 * apart.sum(), FALSE_ALARM_PROBABILITY / len(values)))  # of chi-squared
    rows = np.flatnonzero((together > bound) & (middle > 3.0))
    seams = rows[np.diff(rows, prepend=-PREDICTOR_READINGS - 1) > PREDICTOR_READINGS]
    buffer, turns = _common_divisor(seams, len(values)), turns_per_second(record)
    if not buffer or (turns and _in_step_with_rotor(seams, record.rate / turns, len(values))):
        return []
    spans = np.column_stack([record.time[seams], record.time[seams]])
    return [Fault("", "lost samples", "warning", int(seams.size), spans, {"distance": buffer / record.rate})]


def _common_divisor(rows: NDArray[np.int64], samples: int) -> int:
    """The number of rows by multiples of which more of these `rows` are apart than by chance; 0 if there is none."""
    steps = np.concatenate([np.diff(rows), rows[2:] - rows[:-2]])
    candidates = np.unique(np.concatenate([steps // part + off for part in (1, 2, 3) for off in (-1, 0, 1)]))
    found = [(_in_step_by_chance(rows, each), int(each)) for each in candidates[candidates > PREDICTOR_READINGS]]
    return min([(FALSE_ALARM_PROBABILITY / samples, 0), *found])[1]


def _in_step_with_rotor(rows: NDArray[np.int64], turn: float, samples: int) -> bool:
    """Test whether these `rows` keep to a turn of the rotor (in rows), or to a part of it: then it explains them."""
    parts = range(1, int(turn / PREDICTOR_READINGS) + 1)
    return any(_in_step_by_chance(rows, turn / each) < FALSE_ALARM_PROBABILITY / samples for each in parts)


def _in_step_by_chance(rows: NDArray[np.int64], apart: float) -> float:
    """Probability that of n rows at random as many are multiples of `apart` from one another, give or take one row.

    The number within one row of a multiple from a given row on is binomial with 3/`apart`. Each row to count from is a
    test.
    """
    from scipy.special import bdtrc

    phase = np.sort(np.concatenate([rows % apart, rows % apart + apart]))
    in_step = int((np.searchsorted(phase, phase[: rows.size] + 2.0, side="right") - np.arange(rows.size)).max())
    return apart * float(bdtrc(in_step - 1, rows.size, 3.0 / apart))


def prediction_errors(x: Array) -> Array:
    """Errors (T,) of the best linear prediction from the previous readings."""
    x = x - x.mean()
    rows = np.arange(PREDICTOR_READINGS, len(x))
    if rows.size > MAX_FITTED_ROWS:
        starts = np.linspace(PREDICTOR_READINGS, len(x) - 1000, MAX_FITTED_ROWS // 1000).astype(np.int64)
        rows = (starts[:, None] + np.arange(1000)).ravel()
    past = np.column_stack([x[rows - lag] for lag in range(PREDICTOR_READINGS + 1)])
    used = past
    for _ in range(2):
        moment = used.T @ used
        # a channel that is sampled very often predicts itself
        moment[1:, 1:] += np.eye(PREDICTOR_READINGS) * 1e-12 * moment[0, 0]
        weights = np.linalg.lstsq(moment[1:, 1:], moment[1:, 0], rcond=None)[0]
        error = np.abs(past @ np.concatenate([[1.0], -weights]))
        used = past[error <= 4.0 * np.median(error) / 0.6745]
    errors: Array = np.convolve(x, np.concatenate([[1.0], -weights]))[: len(x)]
    errors[:PREDICTOR_READINGS] = 0.0
    return errors


def normalised_errors(errors: Array) -> Array:
    """Normalise prediction errors (T,) by their local size."""
    return errors / np.maximum(_size_around(np.abs(errors)), 1e-300)


def _size_around(size: Array) -> Array:
    """Standard deviation around each row, of the largest of three blocks: vibration swells and fades."""
    whole = len(size) // _BLOCK_ROWS
    blocks = np.median(size[: whole * _BLOCK_ROWS].reshape(whole, _BLOCK_ROWS), axis=1) / 0.6745
    around = np.pad(blocks, 1, mode="edge")
    blocks = np.maximum.reduce([around[:-2], around[1:-1], around[2:]])
    return np.concatenate([np.repeat(blocks, _BLOCK_ROWS), np.full(len(size) - whole * _BLOCK_ROWS, blocks[-1])])


def _columns(record: Record, channels: Sequence[str]) -> Array:
    return np.column_stack([record[name] for name in channels]) if channels else np.empty((record.samples, 0))

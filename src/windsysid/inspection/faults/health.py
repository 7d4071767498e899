"""Faults of single channels that a look at the curves would show, with times and counts.

Every test requires more than one sign, because healthy records have each of them alone: a sinusoid dwells at its
extremes (clipping is more than that), a coarse converter repeats values (a frozen channel repeats them far longer than
it is used to), an impact jumps (a spike jumps back at once).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Mask
from windsysid.checks.dead_channel import is_constant
from windsysid.inspection.channels import VIBRATION, Kind, is_torque
from windsysid.inspection.fault import Fault, Severity
from windsysid.inspection.faults.runs import runs_of, spans_of
from windsysid.inspection.limits import (
    MAX_SPIKE_SAMPLES,
    MAX_STRAIGHT_BEND_RATIO,
    MIN_CODE_RMS,
    MIN_SPIKE_SIGMAS,
)
from windsysid.records.record import AS_WRITTEN, Record

__all__ = ["channel_faults", "sampled_every"]

_TURN = math.tau


def channel_faults(record: Record, channel: str, kind: Kind, standing: bool = False) -> list[Fault]:
    """Faults of one channel.

    Parameters
    ----------
    kind
        What it measures (`windsysid.inspection.channels`): a pitch angle may rest, an accelerometer may not.
    standing
        The rotor stands still for part of the record, so that a constant azimuth is no fault.
    """
    values = record[channel]
    known = np.isfinite(values)
    found = _missing(record, channel, known)
    if known.sum() < 3 or any(fault.severity == "unusable" for fault in found):
        return found
    x, unit = values[known], record.unit(channel)
    if unit.startswith(AS_WRITTEN):
        found.append(Fault(channel, "unknown unit", "note", x.size, data={"unit": unit.removeprefix(AS_WRITTEN)}))
    if is_constant(x):
        return [*found, _constant(channel, kind, x, unit, standing)]
    time = record.time[known]
    readings = _Readings(channel, kind, unit, x, time, float(np.median(np.diff(time))), _converter_step(x))
    return found + _faults_of(readings, standing)


class _Readings(NamedTuple):
    """Known readings (T,) of a channel that is not constant, their times (T,) [s], usual time step [s] and step of the
    converter, 0 if there is none."""

    channel: str
    kind: Kind
    unit: str
    x: Array
    time: Array
    step: float
    lsb: float


def _faults_of(r: _Readings, standing: bool) -> list[Fault]:
    """Spikes, clipping, frozen readings and coarse steps."""
    found = list[Fault]()
    spike = _spikes(r)
    if spike.any():
        found.append(_spikes_found(r, spike))
    vibrates = r.kind in VIBRATION
    clipped = _clipped(r.x, r.lsb, ~spike) if vibrates else np.zeros(r.x.size, dtype=np.bool_)
    if clipped.any():
        found.append(_clipping_found(r, clipped))
    if r.kind not in ("pitch", "yaw", "direction", "power", "other"):
        found += _frozen(r, clipped, standing)
    if vibrates and r.lsb > 0.0:
        found += _quantised(r.channel, r.x[~spike], r.lsb, r.unit)
    return found


def sampled_every(x: Array) -> tuple[int, str]:
    """Number of samples per true reading of a channel (T,) without gaps, and the values between: ``held``,
    ``interpolated`` on straight lines, or an empty text."""
    if x.size < 40:
        return 1, ""
    bends = np.abs(np.diff(x, 2))
    changes = {
        "held": np.flatnonzero(np.diff(x) != 0.0),
        "interpolated": np.flatnonzero(bends > MAX_STRAIGHT_BEND_RATIO * np.sqrt(np.mean(bends**2))),
    }
    for name, least in (("held", 3), ("interpolated", 2)):
        lengths = np.diff(changes[name])
        middle = float(np.median(lengths)) if lengths.size >= 20 else 0.0
        if middle >= least and np.mean(np.abs(lengths - middle) <= (name == "held")) > 0.8:
            return int(middle), name
    return 1, ""


def _missing(record: Record, channel: str, known: Mask) -> list[Fault]:
    missing = ~known
    count = int(missing.sum())
    if not count:
        return []
    share = count / known.size
    if count == known.size:
        return [Fault(channel, "missing", "unusable", count, data={"share": 1.0})]
    index = np.flatnonzero(known)
    stride = np.diff(index)
    if stride.size > 10 and np.median(stride) > 1 and np.mean(stride == np.median(stride)) > 0.95:
        every = int(np.median(stride))
        return [Fault(channel, "slower rate", "note", count, data={"every": every, "rate": record.rate / every})]
    spans = spans_of(record.time, missing)
    longest = float((spans[:, 1] - spans[:, 0]).max()) + 1.0 / record.rate
    severity: Severity = "unusable" if share > 0.5 else "warning" if share > 0.01 or longest > 1.0 else "note"
    return [Fault(channel, "missing", severity, count, spans, {"share": share, "longest": longest})]


def _constant(channel: str, kind: Kind, x: Array, unit: str, standing: bool) -> Fault:
    data = {"value": float(x[0]), "unit": unit, "standing": standing and kind in ("azimuth", "rotor speed")}
    dead = not data["standing"] and (kind in VIBRATION or kind in ("azimuth", "wind speed"))
    if dead:
        return Fault(channel, "constant", "unusable", x.size, data=data | {"evidence": "motionless"})
    return Fault(channel, "constant", "note", x.size, data=data)


def _spikes(r: _Readings) -> Mask:
    """Excursions of a few samples that jump out and straight back, larger than anything the steps around them do."""
    spike = np.zeros(r.x.size, dtype=np.bool_)
    adjacent = np.rint(np.diff(r.time) / r.step) <= 1
    turn = _turn_of(r)
    d = np.diff(r.x)
    if turn:
        d = np.mod(d + 0.5 * turn, turn) - 0.5 * turn
    d = d - np.median(d[adjacent]) if r.kind == "azimuth" else d
    out = np.flatnonzero((np.abs(d) > _least_jump(r, d, adjacent, turn)) & adjacent)
    width = _widths(d, out, adjacent)
    end = -1
    for k, w in zip(out[width > 0], width[width > 0], strict=True):
        if k > end:  # the jump back from one spike is no way into the next
            spike[k + 1 : k + w + 1] = True
            end = k + w
    if r.kind in VIBRATION and out.size:  # a jump between the first two or the last two is a spike at the end
        spike[0] |= out[0] == 0 and width[0] == 0
        spike[-1] |= out[-1] == d.size - 1 and end < d.size - 1
    return spike


def _turn_of(r: _Readings) -> float:
    """Size of a turn of an azimuth, in radians or degrees, by the range of its readings; 0 for other channels."""
    spread = float(np.ptp(r.x))
    if r.kind != "azimuth" or spread >= 1.1 * 360.0:
        return 0.0
    if spread < 1.1 * _TURN:
        return _TURN
    return 360.0 if spread > 2.2 * _TURN else 0.0


def _least_jump(r: _Readings, d: Array, adjacent: Mask, turn: float) -> Array:
    """Size (T - 1,) from which on steps `d` (T - 1,) may be those of a spike."""
    scale = _local_scale(np.where(adjacent, np.abs(d), 0.0), r.step)
    floor = 0.03 * turn if turn else 0.5 * _usual_size(r.x)
    jump = MIN_SPIKE_SIGMAS
    if r.kind in ("wind speed", "direction"):  # gusts are short too
        jump, floor = 2.0 * MIN_SPIKE_SIGMAS, 6.0 * floor
    return np.maximum(jump * scale, max(floor, 4.0 * r.lsb))


def _widths(d: Array, out: NDArray[np.int64], adjacent: Mask) -> NDArray[np.int64]:
    """Number of samples after which the readings are back from each of the steps `out` of `d` (T - 1,); else 0."""
    level = np.concatenate([[0.0], np.cumsum(d)])
    width = np.zeros(out.size, dtype=np.int64)
    away = np.ones(out.size, dtype=np.bool_)
    height = np.abs(d[out])
    for w in range(1, MAX_SPIKE_SAMPLES + 1):
        inside = out + w < d.size
        at = np.minimum(out + w, d.size - 1)
        away &= (np.abs(level[at] - level[out]) > 0.5 * height) & adjacent[at]
        back = np.abs(level[at + 1] - level[out]) < 0.4 * height
        width[inside & away & back & (width == 0)] = w
    return width


def _usual_size(x: Array) -> float:
    """Standard deviation of readings (T,) by their quartiles."""
    quartile = np.percentile(x, (25.0, 75.0))
    return 0.7413 * float(quartile[1] - quartile[0])


def _local_scale(steps: Array, step: float) -> Array:
    """Standard deviation of the steps around each of them, by a quantile that leaves room for spikes; (T - 1,)."""
    moving = steps > 0.0
    if not moving.any():
        return np.zeros_like(steps)
    overall = float(np.percentile(steps[moving], 90.0)) / 1.645
    block = int(max(200, min(5.0 / step, 20_000)))
    whole = steps.size // block
    if whole < 2:
        return np.full_like(steps, overall)
    cut = np.sort(steps[: whole * block].reshape(whole, block), axis=1)
    zeros = np.sum(cut == 0.0, axis=1)
    rank = np.minimum((zeros + 0.9 * (block - zeros)).astype(np.int64), block - 1)
    scale = cut[np.arange(whole), rank] / 1.645
    # What is under way in the neighbouring blocks is not out of the ordinary here: a gust may start at a block's end.
    around = np.pad(scale, 1, mode="edge")
    scale = np.maximum.reduce([around[:-2], around[1:-1], around[2:], np.full(whole, 0.25 * overall)])
    return np.concatenate([np.repeat(scale, block), np.full(steps.size - whole * block, scale[-1])])


def _spikes_found(r: _Readings, spike: Mask) -> Fault:
    usual = _usual_size(r.x)
    largest = float(np.max(np.abs(r.x[spike] - np.median(r.x))))
    severity: Severity = "unusable" if float(spike.mean()) > 0.1 else "warning"
    if r.kind == "other":  # counters, states and solver outputs may jump
        severity = "note"
    data = {"largest": largest, "relative": largest / usual if usual > 0.0 else None, "unit": r.unit}
    return Fault(r.channel, "spikes", severity, int(spike.sum()), spans_of(r.time, spike), data)


def _clipped(x: Array, lsb: float, healthy: Mask) -> Mask:
    """Samples that pile up at the largest or least value, more than the levels next to it could explain."""
    clipped = np.zeros(x.size, dtype=np.bool_)
    low, high = float(x[healthy].min()), float(x[healthy].max())
    level = lsb or (high - low) / 2000.0
    for sign, end in ((1.0, high), (-1.0, low)):
        depth = sign * (end - x)
        at_end = healthy & (np.abs(depth) <= (0.5 * lsb if lsb else 1e-9 * (high - low)))
        count, runs = int(at_end.sum()), len(runs_of(at_end))
        # A sinusoid leaves 2.4 times as many samples in its last level as in the one before, a normal one fewer.
        beside = max(int(np.sum((depth > (i - 0.5) * level) & (depth <= (i + 0.5) * level))) for i in (1, 2, 3))
        if count >= 10 and runs >= 3 and count > 5 * beside:
            clipped |= at_end
    return clipped


def _clipping_found(r: _Readings, clipped: Mask) -> Fault:
    ends = sorted({float(f"{r.x[clipped].min():.4g}"), float(f"{r.x[clipped].max():.4g}")})
    spans, count = spans_of(r.time, clipped), int(clipped.sum())
    share = float(clipped.mean())
    data = {"share": share, "ends": ends, "unit": r.unit}
    if _has_limits(r, clipped):
        return Fault(r.channel, "limit", "note", count, spans, data)
    return Fault(r.channel, "clipping", "unusable" if share > 0.05 else "warning", count, spans, data)


def _has_limits(r: _Readings, clipped: Mask) -> bool:
    """Test whether the quantity itself has limits: an angle, a controlled torque, or a quantity that cannot be
    negative and rests at zero, such as the tension of a line."""
    if is_torque(r.channel) or (r.kind == "displacement" and r.unit == "rad"):
        return True
    at_zero = not r.x[clipped].any() and not (r.x.min() < 0.0 < r.x.max())
    return at_zero and r.kind in ("load", "displacement")


def _frozen(r: _Readings, clipped: Mask, standing: bool) -> list[Fault]:
    """Segments in which a value repeats far longer than is usual in this channel."""
    every, filled = sampled_every(r.x)
    if every > 1:
        return [Fault(r.channel, filled, "note", r.x.size, data={"every": every, "rate": 1.0 / (every * r.step)})]
    starts = np.flatnonzero(np.concatenate([[True], np.diff(r.x) != 0.0]))
    lengths = np.diff(np.concatenate([starts, [r.x.size]]))
    long = (_far_too_long(r, starts, lengths) & ~clipped[starts]) | _coded(r, starts, lengths)
    if not long.any() or (standing and r.kind in ("azimuth", "rotor speed")):
        return []
    begin, last = starts[long], starts[long] + lengths[long] - 1
    spans = np.column_stack([r.time[begin], r.time[last]])
    count = int(lengths[long].sum())
    data = {"longest": float((spans[:, 1] - spans[:, 0]).max()) + r.step, "share": count / r.x.size}
    severity: Severity = "unusable" if count > 0.5 * r.x.size else "warning"
    return [Fault(r.channel, "frozen", severity, count, spans, data)]


def _far_too_long(r: _Readings, starts: NDArray[np.int64], lengths: NDArray[np.int64]) -> Mask:
    """Mask of repetitions of a value (n,), from these samples on, that are far longer than usual."""
    shortest = 0.5 if r.kind in VIBRATION or r.kind == "azimuth" else 5.0
    # A slow signal dwells on a level of its converter, comes from the next one and leaves to the next one.
    edge = np.pad(np.abs(np.diff(r.x[starts])), 1, constant_values=0.0)
    level = max(r.lsb, 1.2e-7 * float(np.abs(r.x).max()))  # a file in single precision has its own
    smooth = np.maximum(edge[:-1], edge[1:]) <= 2.5 * level
    enough = np.maximum(10.0, np.where(smooth, 10.0, 1.0) * shortest / r.step)
    return np.asarray(lengths >= np.maximum(enough, 5.0 * float(np.percentile(lengths, 95.0))))


def _coded(r: _Readings, starts: NDArray[np.int64], lengths: NDArray[np.int64]) -> Mask:
    """Mask of repetitions (n,) that are a code for "no reading": a value that no vibration reaches."""
    low, middle, high = np.percentile(r.x, (25.0, 50.0, 75.0))
    if r.kind not in VIBRATION or np.percentile(lengths, 95.0) >= 2.0 or high <= low:
        return np.zeros(len(starts), dtype=np.bool_)
    far = np.abs(r.x[starts] - middle) > MIN_CODE_RMS * 0.7413 * (high - low)
    return np.asarray((lengths > MAX_SPIKE_SAMPLES) & far)


def _quantised(channel: str, x: Array, lsb: float, unit: str) -> list[Fault]:
    levels = float(np.std(x)) / lsb
    if levels > 10.0:
        return []
    data = {"step": lsb, "unit": unit, "levels": levels}
    return [Fault(channel, "coarse steps", "warning" if levels < 2.0 else "note", x.size, data=data)]


def _converter_step(x: Array) -> float:
    """Step of which all values are multiples, 0 if there is none."""
    levels = np.unique(x)
    if levels.size < 2:
        return 0.0
    d = np.diff(levels)
    d = d[d > 1e-9 * (levels[-1] - levels[0])]  # conversion of units moves equal values an ulp apart
    step = float(np.percentile(d, 0.1))
    multiple = d / step
    near = multiple < 10.5
    if d.size < 3 or near.mean() < 0.5:
        return 0.0
    step = float(np.median(d[multiple < 1.5]))
    multiple = d[near] / step
    off = np.abs(multiple - np.rint(multiple))
    return step if np.percentile(off, 98.0) < 0.1 else 0.0

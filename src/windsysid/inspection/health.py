"""Faults of single channels and of the clock: what a look at the curves would find, with times and counts.

Every test asks for more than one sign, because healthy records have each of them alone: a sinusoid dwells at its
extremes (clipping is more than that), a coarse converter repeats values (a frozen channel repeats them far longer than
it is used to), an impact jumps (a spike jumps back at once).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Mask
from windsysid.inspection.channels import VIBRATION, Kind, is_torque, kinds
from windsysid.records.record import AS_WRITTEN, RATE_DOUBT, STAMPS, Record
from windsysid.units import unit_text

__all__ = [
    "SEVERITIES", "Finding", "Severity", "channel_faults", "clock_faults", "runs_of", "sampled_every",
    "spans_of", "when",
]  # fmt: skip


Severity = Literal["note", "warning", "unusable"]
SEVERITIES: tuple[Severity, ...] = ("unusable", "warning", "note")
"""The worst first. A note is good to know; a warning needs a hand; what is unusable has to be left out."""

SPIKE_MIN_SIGMAS = 8.0
"""A spike's jump, in standard deviations of the steps around it."""
CODE_MIN_RMS = 30.0
"""How far a value is from the median, in the channel's rms, that repeats itself and is no reading."""
MAX_SPIKE_SAMPLES = 5
"""Samples; what lasts longer is not called a spike."""
STRAIGHT = 0.02
"""Of the root mean square of a channel's bends: less is none."""
GAP_MIN_STEPS = 1.5
"""A step longer than this many usual ones is a gap."""

MAX_SHORT_GAP_SAMPLES = 10
"""Largest number of lost samples in a short gap, which `windsysid.spectral.oma.samples` fills by interpolation."""
MAX_SEPARATE_GAPS = 20
"""Largest number of short gaps between which a section can be chosen."""
MAX_OFF_GRID_STEPS = 0.25
"""Largest 90th percentile of the distance of steps from whole multiples of the usual step, in usual steps, for a
regular clock that lost samples; for uniformly distributed steps it is 0.45."""

_TURN = 2.0 * np.pi


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that is wrong, or worth knowing.

    Attributes
    ----------
    channel
        Name; empty where the whole record is meant.
    kind
        ``spikes``, ``frozen``, ``clipping`` …: the same words for the same fault, for programs.
    severity
        ``note``, ``warning`` or ``unusable``.
    text
        What it is, how much of it, and what to do.
    count
        Samples (or gaps) concerned.
    spans
        (n, 2) [s]: first and last time of each place; empty where it is everywhere.
    """

    channel: str
    kind: str
    severity: Severity
    text: str
    count: int
    spans: Array

    def summary(self, most: int = 50) -> dict[str, Any]:
        """As plain values; at most `most` places."""
        return {
            "channel": self.channel,
            "kind": self.kind,
            "severity": self.severity,
            "text": self.text,
            "count": self.count,
            "spans_s": [[float(a), float(b)] for a, b in self.spans[:most]],
        }


def clock_faults(record: Record) -> list[Finding]:
    """Gaps and irregular steps of the time stamps, and rows that were written twice."""
    steps = np.diff(record.time)
    usual = 1.0 / record.rate
    found = []
    scatter = _scatter_of_steps(steps / usual)
    gap = steps > max(GAP_MIN_STEPS, 1.0 + 5.0 * scatter) * usual  # a clock that scatters loses no sample by it
    short = gap & (steps <= (MAX_SHORT_GAP_SAMPLES + 1.5) * usual)
    if np.count_nonzero(short) > MAX_SEPARATE_GAPS:
        lost = int(np.sum(np.rint(steps[short] / usual) - 1))
        found.append(
            Finding(
                "", "short gaps", "warning",
                f"{count_of(lost, 'sample')} lost ({_percent(lost / (lost + record.samples))}) in"
                f" {np.count_nonzero(short)} short gaps, the longest {steps[short].max():.3g} s: use the whole record;"
                " identify takes them as missing, oma fills them",
                lost, np.empty((0, 2)),
            )
        )  # fmt: skip
    long = gap & ~short if found else gap
    if long.any():
        spans = np.column_stack([record.time[:-1][long], record.time[1:][long]])
        lost = int(np.sum(np.rint(steps[long] / usual) - 1))
        share = lost / (lost + record.samples)
        found.append(
            Finding(
                "", "gaps", "unusable" if share > 0.5 else "warning",
                f"{count_of(len(spans), 'gap')} in the time, the longest {steps[long].max():.3g} s, "
                f"{count_of(lost, 'sample')} lost ({_percent(share)}), {when(spans)}: choose a section between them",
                lost, spans,
            )
        )  # fmt: skip
    inside = steps[~gap] / usual - 1.0
    if inside.size and np.max(np.abs(inside)) > 0.01:
        worst, spread = float(np.max(np.abs(inside))), float(np.std(inside))
        off = (np.abs(steps / usual - 1.0) > 0.1) & ~gap
        on_grid = off.any() and record.has_grid
        found.append(
            Finding(
                "", "irregular sampling", "warning" if worst > 0.1 else "note",
                f"steps of {usual:.4g} s vary by {_percent(spread)} rms, {_percent(worst)} at most"
                + (f", {count_of(int(off.sum()), 'step')} more than 10 % off: " if off.any() else "")
                + ("readings are smoother on a regular grid, and are taken so" if on_grid else "")
                + ("resample to a uniform rate first" if off.any() and not on_grid else ""),
                int(off.sum()), spans_of(record.time[1:], off),
            )
        )  # fmt: skip
    if STAMPS in record.attributes:
        found.append(Finding("", "shared time stamps", "note", record.attributes[STAMPS], 0, np.empty((0, 2))))
    if RATE_DOUBT in record.attributes:
        found.append(_everywhere("", "sampling rate", "warning", record.attributes[RATE_DOUBT], 0))
    return found + _repeated_rows(record)


def _scatter_of_steps(steps: Array) -> float:
    """Standard deviation of the steps of a clock [usual steps]; about whole multiples for a regular clock that lost
    samples."""
    apart = float(np.percentile(np.abs(steps - np.maximum(np.rint(steps), 1.0)), 90.0))
    if apart > MAX_OFF_GRID_STEPS:
        apart = float(np.percentile(np.abs(steps - 1.0), 90.0))
    return apart / 1.645


def channel_faults(record: Record, channel: str, kind: Kind, standing: bool = False) -> list[Finding]:
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
    if known.sum() < 3 or any(finding.severity == "unusable" for finding in found):
        return found
    x, time = values[known], record.time[known]
    unit = record.unit(channel)
    if unit.startswith(AS_WRITTEN):
        found.append(
            _everywhere(
                channel, "unknown unit", "note",
                f"the unit '{unit.removeprefix(AS_WRITTEN)}' is not known: values are as the file has them", x.size,
            )
        )  # fmt: skip
    spread = float(np.ptp(x))
    if spread <= 1e-12 * float(np.abs(x).max()):
        return [*found, _constant(channel, kind, x, unit, standing)]
    step = float(np.median(np.diff(time)))
    adjacent = np.diff(time) < GAP_MIN_STEPS * step
    lsb = _converter_step(x)
    turning = kind == "azimuth" and spread < 1.1 * max(_TURN, 360.0 if spread > 2.2 * _TURN else 0.0)
    turn = 0.0 if not turning else (360.0 if spread > 1.1 * _TURN else _TURN)
    spike = _spikes(x, adjacent, lsb, step, turn, kind)
    if spike.any():
        found.append(_spikes_found(channel, kind, x, time, spike, unit))
    clipped = np.zeros(x.size, dtype=np.bool_)
    if kind in VIBRATION:
        clipped = _clipped(x, lsb, ~spike)
        if clipped.any():
            found.append(_clipping_found(channel, kind, x, time, clipped, unit))
    if kind not in ("pitch", "yaw", "direction", "power", "other"):
        found += _frozen(channel, kind, x, time, step, lsb, clipped, standing)
    if kind in VIBRATION and lsb > 0.0:
        found += _quantised(channel, x[~spike], lsb, unit)
    return found


def sampled_every(x: Array) -> tuple[int, str]:
    """Every how many samples a channel (T,) without gaps was really read, and what is between: ``held`` values,
    ``interpolated`` ones, on straight lines, or nothing, an empty text."""
    if x.size < 40:
        return 1, ""
    bends = np.abs(np.diff(x, 2))
    changes = {
        "held": np.flatnonzero(np.diff(x) != 0.0),
        "interpolated": np.flatnonzero(bends > STRAIGHT * np.sqrt(np.mean(bends**2))),
    }
    for name, least in (("held", 3), ("interpolated", 2)):
        lengths = np.diff(changes[name])
        middle = float(np.median(lengths)) if lengths.size >= 20 else 0.0
        if middle >= least and np.mean(np.abs(lengths - middle) <= (name == "held")) > 0.8:
            return int(middle), name
    return 1, ""


def when(spans: Array, most: int = 4) -> str:
    """Where it is, in words: ``at 12.3, 45 and 60 s (and 3 more places)``."""
    if not len(spans):
        return "everywhere"
    listed = [f"{a:.6g}" if b - a < 0.05 else f"{a:.6g}–{b:.6g}" for a, b in spans[:most]]
    text = listed[0] if len(listed) == 1 else ", ".join(listed[:-1]) + " and " + listed[-1]
    more = len(spans) - most
    return f"at {text} s" + (f" and {count_of(more, 'more place')}" if more > 0 else "")


def _missing(record: Record, channel: str, known: Mask) -> list[Finding]:
    missing = ~known
    count = int(missing.sum())
    if not count:
        return []
    share = count / known.size
    if count == known.size:
        return [_everywhere(channel, "missing", "unusable", "holds no number at all: leave it out", count)]
    index = np.flatnonzero(known)
    stride = np.diff(index)
    if stride.size > 10 and np.median(stride) > 1 and np.mean(stride == np.median(stride)) > 0.95:
        every = int(np.median(stride))
        text = f"has a value in every {every}th row only ({record.rate / every:.4g} Hz): a slower logger"
        return [_everywhere(channel, "slower rate", "note", text, count)]
    spans = spans_of(record.time, missing)
    longest = float((spans[:, 1] - spans[:, 0]).max()) + 1.0 / record.rate
    severity: Severity = "unusable" if share > 0.5 else "warning" if share > 0.01 or longest > 1.0 else "note"
    advice = (
        "mostly missing: leave it out"
        if severity == "unusable"
        else ("choose a section without them" if severity == "warning" else "short enough to be bridged")
    )
    text = (
        f"{count_of(count, 'sample')} missing ({_percent(share)}) in {count_of(len(spans), 'place')}, the longest"
        f" {longest:.3g} s, {when(spans)}: {advice}"
    )
    return [Finding(channel, "missing", severity, text, count, spans)]


def _constant(channel: str, kind: Kind, x: Array, unit: str, standing: bool) -> Finding:
    value = _amount(f"{x[0]:.5g}", unit)
    if standing and kind in ("azimuth", "rotor speed"):
        return _everywhere(channel, "constant", "note", f"is {value} throughout: the rotor stands still", x.size)
    if kind in VIBRATION or kind in ("azimuth", "wind speed"):
        text = (
            f"is {value} from the first sample to the last: disconnected, or a motion that a simulator holds; leave"
            " it out"
        )
        return _everywhere(channel, "constant", "unusable", text, x.size)
    return _everywhere(
        channel, "constant", "note", f"is {value} throughout: a set value rather than a measured one", x.size
    )


def _spikes(x: Array, adjacent: Mask, lsb: float, step: float, turn: float, kind: Kind) -> Mask:
    """Excursions of a few samples that jump out and straight back, larger than anything the steps around them do."""
    spike = np.zeros(x.size, dtype=np.bool_)
    d = np.diff(x)
    if turn:
        d = np.mod(d + 0.5 * turn, turn) - 0.5 * turn
    d = d - np.median(d[adjacent]) if kind == "azimuth" else d
    scale = _local_scale(np.where(adjacent, np.abs(d), 0.0), step)
    quartile = np.percentile(x, (25.0, 75.0))
    floor = 0.03 * turn if turn else 0.5 * 0.7413 * float(quartile[1] - quartile[0])
    jump = SPIKE_MIN_SIGMAS
    if kind in ("wind speed", "direction"):  # gusts are short too
        jump, floor = 2.0 * SPIKE_MIN_SIGMAS, 6.0 * floor
    threshold = np.maximum(jump * scale, max(floor, 4.0 * lsb))
    out = np.flatnonzero((np.abs(d) > threshold) & adjacent)
    level = np.concatenate([[0.0], np.cumsum(d)])
    width = np.zeros(out.size, dtype=np.int64)
    away = np.ones(out.size, dtype=np.bool_)
    for w in range(1, MAX_SPIKE_SAMPLES + 1):
        inside = out + w + 1 < x.size
        at = np.minimum(out + w, x.size - 2)
        height = np.abs(d[out])
        away &= (np.abs(level[at] - level[out]) > 0.5 * height) & adjacent[at]
        back = np.abs(level[at + 1] - level[out]) < 0.4 * height
        width[inside & away & back & (width == 0)] = w
    end = -1
    for k, w in zip(out[width > 0], width[width > 0], strict=True):
        if k > end:  # the jump back from one spike is no way into the next
            spike[k + 1 : k + w + 1] = True
            end = k + w
    if kind in VIBRATION:  # a jump between the first two or the last two is a spike at the end: it has one side
        spike[0] |= bool(out.size and out[0] == 0 and width[0] == 0)
        spike[-1] |= bool(out.size and out[-1] == d.size - 1 and end < d.size - 1)
    return spike


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


def _spikes_found(channel: str, kind: Kind, x: Array, time: Array, spike: Mask, unit: str) -> Finding:
    spans = spans_of(time, spike)
    quartile = np.percentile(x, (25.0, 75.0))
    usual = 0.7413 * float(quartile[1] - quartile[0])
    largest = float(np.max(np.abs(x[spike] - np.median(x))))
    share = float(spike.mean())
    relative = f", {largest / usual:.2g} × the usual rms" if usual > 0.0 else ""
    text = (
        f"{count_of(len(spans), 'spike')} ({count_of(int(spike.sum()), 'sample')}) up to"
        f" {_amount(f'{largest:.3g}', unit)} off the median{relative}, {when(spans)}: "
    )
    if kind == "other":  # counters, states and solver outputs may jump
        text += "if a sensor reads it, remove them (despike)"
        return Finding(channel, "spikes", "note", text, int(spike.sum()), spans)
    text += "remove them (despike) before anything else"
    return Finding(channel, "spikes", "unusable" if share > 0.1 else "warning", text, int(spike.sum()), spans)


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


def _clipping_found(channel: str, kind: Kind, x: Array, time: Array, clipped: Mask, unit: str) -> Finding:
    ends = sorted({float(f"{x[clipped].min():.4g}"), float(f"{x[clipped].max():.4g}")})
    spans = spans_of(time, clipped)
    share = float(clipped.mean())
    text = (
        f"{count_of(int(clipped.sum()), 'sample')} ({_percent(share)}) sit at"
        f" {_amount(' and '.join(f'{end:g}' for end in ends), unit)}, {when(spans)}: "
    )
    if _has_limits(channel, kind, x, clipped, unit):
        text += "an end stop, a controller's limit, or the end of the sensor's range"
        return Finding(channel, "limit", "note", text, int(clipped.sum()), spans)
    text += (
        "the range of the sensor or its amplifier ends there; what is larger is lost, so amplitudes and damping come"
        " out wrong"
    )
    return Finding(channel, "clipping", "unusable" if share > 0.05 else "warning", text, int(clipped.sum()), spans)


def _has_limits(channel: str, kind: Kind, x: Array, clipped: Mask, unit: str) -> bool:
    """Whether the quantity itself has limits: an angle, a controlled torque, or a quantity that cannot be negative and
    rests at zero, such as the tension of a line."""
    if is_torque(channel) or (kind == "displacement" and unit == "rad"):
        return True
    at_zero = not x[clipped].any() and not (x.min() < 0.0 < x.max())
    return at_zero and kind in ("load", "displacement")


def _frozen(
    channel: str, kind: Kind, x: Array, time: Array, step: float, lsb: float, clipped: Mask, standing: bool
) -> list[Finding]:
    """Stretches in which a value repeats far longer than this channel is used to."""
    every, filled = sampled_every(x)
    if every > 1:
        text = (
            f"changes only every {every} samples ({1.0 / (every * step):.3g} Hz): sampled slowly and held"
            if filled == "held"
            else f"lies on straight lines between every {every} samples ({1.0 / (every * step):.3g} Hz): filled in"
        )
        return [_everywhere(channel, filled, "note", text, x.size)]
    starts = np.flatnonzero(np.concatenate([[True], np.diff(x) != 0.0]))
    lengths = np.diff(np.concatenate([starts, [x.size]]))
    usual = float(np.percentile(lengths, 95.0))
    shortest = 0.5 if kind in VIBRATION or kind == "azimuth" else 5.0
    # A slow signal dwells on a level of its converter, comes from the next one and leaves to the next one.
    edge = np.pad(np.abs(np.diff(x[starts])), 1, constant_values=0.0)
    level = max(lsb, 1.2e-7 * float(np.abs(x).max()))  # a file in single precision has its own
    smooth = np.maximum(edge[:-1], edge[1:]) <= 2.5 * level
    enough = np.maximum(10.0, np.where(smooth, 10.0, 1.0) * shortest / step)
    long = (lengths >= np.maximum(enough, 5.0 * usual)) & ~clipped[starts]
    low, middle, high = np.percentile(x, (25.0, 50.0, 75.0))
    if kind in VIBRATION and usual < 2.0 and high > low:  # what no vibration reaches is a code for "no reading"
        far = np.abs(x[starts] - middle) > CODE_MIN_RMS * 0.7413 * (high - low)
        long |= (lengths > MAX_SPIKE_SAMPLES) & far
    if not long.any() or (standing and kind in ("azimuth", "rotor speed")):
        return []
    begin, last = starts[long], starts[long] + lengths[long] - 1
    spans = np.column_stack([time[begin], time[last]])
    count = int(lengths[long].sum())
    text = (
        f"frozen: repeats one value for up to {float((spans[:, 1] - spans[:, 0]).max()) + step:.3g} s,"
        f" {count_of(count, 'sample')} ({_percent(count / x.size)}), {when(spans)}: treat them as missing"
    )
    return [Finding(channel, "frozen", "unusable" if count > 0.5 * x.size else "warning", text, count, spans)]


def _quantised(channel: str, x: Array, lsb: float, unit: str) -> list[Finding]:
    levels = float(np.std(x)) / lsb
    if levels > 10.0:
        return []
    text = f"comes in steps of {lsb:.3g} {unit_text(unit)}, its rms is {levels:.2g} of them: " + (
        "the converter sees hardly any motion; raise the gain"
        if levels < 2.0
        else f"adds {_percent(0.2887 / levels)} of noise"
    )
    return [_everywhere(channel, "coarse steps", "warning" if levels < 2.0 else "note", text, x.size)]


def _converter_step(x: Array) -> float:
    """The step that all values are multiples of, 0 where there is none to be seen."""
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


def _repeated_rows(record: Record) -> list[Finding]:
    """Rows equal to the row before in every channel that never rests: a logger that wrote a sample twice."""
    same = record.values[1:] == record.values[:-1]
    lively = same.mean(axis=0) < 0.05
    vibration = [kind in VIBRATION or kind == "azimuth" for kind in kinds(record).values()]
    chosen = lively & np.array(vibration, dtype=np.bool_)
    if chosen.sum() < 2:
        return []
    repeated = np.concatenate([[False], same[:, chosen].all(axis=1)])
    if not repeated.any():
        return []
    spans = spans_of(record.time, repeated)
    text = (
        f"{count_of(int(repeated.sum()), 'row')} repeat the row before in all {int(chosen.sum())} channels that"
        f" vibrate, {when(spans)}: the logger stalled or wrote twice; treat them as missing"
    )
    return [Finding("", "repeated rows", "warning", text, int(repeated.sum()), spans)]


def _everywhere(channel: str, kind: str, severity: Severity, text: str, count: int) -> Finding:
    return Finding(channel, kind, severity, text, count, np.empty((0, 2)))


def runs_of(mask: Mask) -> NDArray[np.int64]:
    """First and one-past-last index of each run of True, (n, 2)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return edges.reshape(-1, 2).astype(np.int64)


def spans_of(time: Array, mask: Mask) -> Array:
    """First and last time of each run of True, (n, 2) [s]."""
    runs = runs_of(mask)
    return np.column_stack([time[runs[:, 0]], time[runs[:, 1] - 1]])


def count_of(count: int, what: str) -> str:
    return f"{count} {what}" + ("" if count == 1 else "s")


def _amount(number: str, unit: str) -> str:
    """Join a number and its unit; pure numbers have none."""
    return f"{number} {unit_text(unit)}".removesuffix(" 1")


def _percent(share: float) -> str:
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def joined(parts: Sequence[str]) -> str:
    """``a, b and c``."""
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " and " + parts[-1]

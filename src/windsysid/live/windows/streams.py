"""Faults of the sensors of a stream, detected within seconds from the blocks, and drift from windows.

The tests are those of `windsysid.inspection.faults.health` with a memory of fixed size instead of the whole record: a
channel is compared with its usual behaviour. A fault is reported at once; it ends when the channel has been good for a
while.

``dead``      no number for 10 s, and for 20 of its usual intervals
``missing``   a fifth more samples missing than usual, over about a minute
``stuck``     one value for 10 s (what measures vibration) or 5 min (speeds), and ten times as long as it ever was
``clipping``  samples pile up at the largest or the least value of a minute
``spikes``    three excursions within about a minute that jump out and straight back
``drift``     the mean of three windows in a row lies far outside of where it was in a day or more
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.fleet.rows import Row
from windsysid.inspection.channels import VIBRATION, Kind, kind_of
from windsysid.inspection.limits import MAX_SPIKE_SAMPLES
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.limits import MAX_TABLE_CHANNELS
from windsysid.live.store.contents import Alarm, SensorHealth
from windsysid.live.windows.timeline import SECOND
from windsysid.units import unit_text

__all__ = ["Drift", "StreamHealth", "Verdict", "drifts", "sensor_alarm"]

BATCH_SECONDS = 5.0
"""Seconds of samples that are looked at together."""

MEMORY_SECONDS = 60.0
"""Time constant of forgetting, and time over which clipping is counted [s]."""

MIN_DEAD_SECONDS, MIN_DEAD_INTERVALS = 10.0, 20.0
MIN_STUCK_SECONDS: dict[Kind, float] = {**dict.fromkeys(VIBRATION, 10.0), "wind speed": 300.0, "rotor speed": 300.0}
MIN_STUCK_FACTOR = 10.0
MIN_CONSTANT_SECONDS = 60.0
"""Seconds after which a vibration channel that never changed is stuck."""
MAX_MISSING_INCREASE = 0.2
MIN_SPIKE_SIGMAS, MAX_SPIKES = 10.0, 3.0
RECOVERY_SECONDS = 120.0
"""Seconds without the fault after which a channel is good again."""

DRIFT_LEARNING_WINDOWS, MIN_DRIFT_WINDOWS, MAX_DRIFT_WINDOWS = 144, 3, 1008
"""Windows to learn from, windows in a row that lie outside, and windows after which that is the new usual."""
MIN_DRIFT_SIGMAS, MIN_DRIFT_RANGES, MIN_DRIFT_SHARE = 8.0, 3.0, 0.5
"""Of the spread of the means, of their largest deviation yet, and of the channel's own standard deviation."""
MAX_RANGE_GROWTH = 1.01
"""By which the largest deviation may grow in a window once it is learned: seasons widen it, a drift must not."""

_MIN_CHANGES = 100
"""Changes of value after which it is known how long a channel may repeat one."""

_ADVICE = {
    "dead": "gives no samples: check sensor, cable and logger",
    "missing": "lacks more samples than usual: check cable and logger",
    "stuck": "repeats one value: check sensor and cable; its samples are useless",
    "clipping": "is cut off at its largest values: lower the gain, or take a sensor of a wider range",
    "spikes": "has spikes: check plugs, cable and shield",
    "drift": "has drifted away from its usual mean: check mounting and supply of the sensor",
}


class Verdict(NamedTuple):
    """Change of a channel's state.

    Attributes
    ----------
    state
        ``good`` or a fault, as the module lists them.
    since
        Stream time [ns since 1970].
    at
        When it was found.
    text
        What it is and what to do.
    """

    channel: str
    state: str
    since: int
    at: int
    text: str

    def health(self, turbine: str) -> SensorHealth:
        """As the store keeps it."""
        return SensorHealth(turbine, self.channel, self.state, self.since, self.text)


def sensor_alarm(turbine: str, verdict: Verdict) -> Alarm:
    """The alarm of a fault."""
    return Alarm(
        key=f"{turbine}:sensor:{verdict.channel}:{verdict.state}:{verdict.at}", turbine=turbine, kind="sensor",
        severity="notice" if verdict.state == "missing" else "warning", about=verdict.channel, opened=verdict.at,
        earliest=verdict.since, latest=verdict.at, ended=None, text=verdict.text,
    )  # fmt: skip


class StreamHealth:
    """The channels of one logger; its size does not grow with time."""

    def __init__(self) -> None:
        self._channels: dict[str, _Channel] = {}
        self._held: list[Block] = []
        self._seconds = 0.0

    def take(self, block: Block) -> list[Verdict]:
        """Process a block; returns the changes."""
        changed: list[Verdict] = []
        if self._held and (block.rate != self._held[0].rate or block.channels != self._held[0].channels):
            changed = self._examine()
        self._held.append(block)
        self._seconds += len(block.values) / block.rate
        return changed + self._examine() if self._seconds >= BATCH_SECONDS else changed

    def _examine(self) -> list[Verdict]:
        blocks, self._held, self._seconds = self._held, [], 0.0
        first = blocks[0]
        values = np.concatenate([block.values for block in blocks]) if len(blocks) > 1 else first.values
        names = {name: i for i, name in enumerate(first.channels)}
        for name, unit in zip(first.channels, first.units, strict=True):
            if name not in self._channels:
                self._channels[name] = _Channel(name, unit, kind_of(name, unit))
        changed = []
        for name, channel in self._channels.items():
            at = names.get(name)
            x = np.asarray(values[:, at], dtype=np.float64) if at is not None else np.full(len(values), np.nan)
            verdict = channel.take(x, 1.0 / first.rate, first.start)
            if verdict is not None:
                changed.append(verdict)
        self._forget_silent()
        return changed

    def _forget_silent(self) -> None:
        """Of more than `MAX_TABLE_CHANNELS` channels, forget those that gave no samples for longest."""
        if len(self._channels) > MAX_TABLE_CHANNELS:
            newest = sorted(self._channels.values(), key=lambda channel: channel.lost)[:MAX_TABLE_CHANNELS]
            self._channels = {channel.name: channel for channel in newest}


@dataclass
class _Side:
    """Largest values of a minute: count of the largest, and of those just below."""

    top: float = -math.inf
    at: int = 0
    runs: int = 0
    beside: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def is_clipped(self) -> bool:
        """Check for clipping: far more samples at the largest value than just below, in several runs."""
        return self.at >= 10 and self.runs >= 3 and self.at > 5 * float(self.beside.max())

    def count(self, y: Array, ordered: Array, near: float, level: float) -> None:
        """Count samples `y` (n,), which are also given `ordered`.

        Parameters
        ----------
        near, level
            Distances from the largest value [its unit] up to which a sample is at it, and of the bands just below.
        """
        top = float(ordered[-1])
        if top > self.top + near:
            self.top, self.at, self.runs, self.beside = top, 0, 0, np.zeros(3)
        elif top < self.top - 4.0 * level:
            return
        edges = self.top - np.array([near, 0.5 * level, 1.5 * level, 2.5 * level, 3.5 * level])
        above = len(y) - np.searchsorted(ordered, edges)
        count = int(above[0])
        self.at += count
        if count == 1:
            self.runs += 1
        elif count:
            self.runs += 1 + int(np.sum(np.diff(np.flatnonzero(y >= edges[0])) > 1))
        self.beside += np.diff(above[1:])


@dataclass
class _Channel:
    """Usual behaviour of one channel, and its state."""

    name: str
    unit: str
    kind: Kind
    state: str = "good"
    good: float = 0.0
    seen: float = 0.0
    samples: int = 0
    lost: float = 0.0
    missing: float = 0.0
    usual_missing: float = 0.0
    last: float = math.nan
    run: float = 0.0
    longest: float = 0.0
    changes: int = 0
    scale: float = 0.0
    spread: float = 0.0
    spikes: float = 0.0
    sides: tuple[_Side, _Side] = field(default_factory=lambda: (_Side(), _Side()))
    counted: float = 0.0
    clipped: bool = False

    def take(self, x: Array, step: float, start: int) -> Verdict | None:
        """Take in samples `x` (n,) that are `step` [s] apart; the verdict where it changed."""
        seconds = len(x) * step
        end = start + round(seconds * SECOND)
        known = np.isfinite(x)
        y = x if known.all() else x[known]
        self._count_missing(len(y) / len(x), seconds)
        self.samples += len(y)
        if len(y):
            self.lost = 0.0
            d = y[1:] - y[:-1]
            self._count_changes(y, d, seconds)
            if self.kind in VIBRATION and len(y) > 2 * MAX_SPIKE_SAMPLES:
                self._look_at_steps(y, d, seconds)
            self.last = float(y[-1])
        else:
            self.lost += seconds
        fault, since = self._fault(end)
        if fault is None:
            self.good += seconds
            if self.state == "good" or self.good < RECOVERY_SECONDS:
                return None
            fault, since = "good", end - round(self.good * SECOND)
        else:
            self.good = 0.0
            if fault == self.state:
                return None
        self.state = fault
        return Verdict(self.name, fault, since, end, "" if fault == "good" else self._told(fault))

    def _told(self, fault: str) -> str:
        value = f" {self.last:.4g} {unit_text(self.unit)}".removesuffix(" 1") if fault == "stuck" else ""
        advice = _ADVICE[fault].replace("repeats one value", f"repeats{value}") if value else _ADVICE[fault]
        return f"{self.name} {advice}"

    def _fault(self, end: int) -> tuple[str | None, int]:
        """The worst fault that is there now, and since when."""
        interval = self.seen / self.samples if self.samples else 0.0
        if self.lost >= max(MIN_DEAD_SECONDS, MIN_DEAD_INTERVALS * interval):
            return "dead", end - round(self.lost * SECOND)
        if self._is_stuck():
            return "stuck", end - round(self.run * SECOND)
        recent = end - round(MEMORY_SECONDS * SECOND)
        if self.seen > MEMORY_SECONDS and self.missing > self.usual_missing + MAX_MISSING_INCREASE:
            return "missing", recent
        if self.clipped:
            return "clipping", recent
        if self.spikes >= (MAX_SPIKES if self.state != "spikes" else 0.5):
            return "spikes", recent
        return None, end

    def _is_stuck(self) -> bool:
        limit = MIN_STUCK_SECONDS.get(self.kind)
        vibrates = self.kind in VIBRATION
        if limit is None or not (vibrates or self.last != 0.0):
            return False
        if self.changes >= _MIN_CHANGES:
            return self.run >= max(limit, MIN_STUCK_FACTOR * self.longest)
        return vibrates and self.changes == 0 and self.run >= MIN_CONSTANT_SECONDS

    def _count_missing(self, there: float, seconds: float) -> None:
        self.seen += seconds
        if there == 0.0 and self.state == "dead":  # which is another fault
            self.missing = self.usual_missing
            return
        weight = 1.0 - math.exp(-seconds / MEMORY_SECONDS)
        if self.seen <= 2.0 * MEMORY_SECONDS:  # what it does at first is what it is used to
            self.usual_missing += (1.0 - there - self.usual_missing) * min(1.0, seconds / self.seen)
            self.missing = self.usual_missing
        else:
            self.missing += (1.0 - there - self.missing) * weight

    def _count_changes(self, y: Array, d: Array, seconds: float) -> None:
        """Duration of the newest run of equal values, and of the longest run."""
        step = seconds / len(y)
        moved = y[0] != self.last  # NaN at first: a change
        if moved and np.count_nonzero(d) == len(d):  # the usual case
            ended, last, count = max(self.run, step), len(y) - 1, len(y)
        else:
            changes = np.flatnonzero(d) + 1
            if moved:
                changes = np.concatenate([[0], changes])
            if not len(changes):
                self.run += seconds
                return
            ended = max(self.run + changes[0] * step, float(np.diff(changes).max(initial=0)) * step)
            last, count = int(changes[-1]), len(changes)
        fault = self.state == "stuck"
        self.longest = max(self.longest * math.exp(-seconds / 86400.0), 0.0 if fault else ended)
        self.changes += count - (1 if math.isnan(self.last) else 0)
        self.run = (len(y) - last) * step

    def _look_at_steps(self, y: Array, d: Array, seconds: float) -> None:
        """Spikes and clipping."""
        a = np.abs(d)
        steps = np.sort(a)
        still = int(np.searchsorted(steps, 0.0, side="right"))
        self.spikes *= math.exp(-seconds / MEMORY_SECONDS)
        if len(steps) - still < 10:
            return
        now = float(steps[still + int(0.9 * (len(steps) - still))]) / 1.645
        ordered = np.sort(y)
        quarter = len(y) // 4
        spread = 0.7413 * float(ordered[3 * quarter] - ordered[quarter])
        weight = 1.0 - math.exp(-seconds / MEMORY_SECONDS)
        first = self.scale == 0.0
        self.scale = now if first else self.scale + (now - self.scale) * weight
        self.spread = spread if first else self.spread + (spread - self.spread) * weight
        lsb = float(steps[still])
        least = max(MIN_SPIKE_SIGMAS * max(self.scale, now), 0.5 * max(self.spread, spread), 4.0 * lsb)
        if steps[-1] > least:
            self.spikes += sum(1 for _ in _spikes(y, d, np.flatnonzero(a > least)[:100]))
        self._count_ends(y, ordered, lsb, seconds)

    def _count_ends(self, y: Array, ordered: Array, lsb: float, seconds: float) -> None:
        """Samples at the ends of the range, as `windsysid.inspection.faults.health` counts them, over a minute."""
        span = float(ordered[-1] - ordered[0])
        level = max(lsb, span / 2000.0)
        near = 0.5 * lsb if lsb > 1e-3 * span else 1e-9 * span
        for side, sign in zip(self.sides, (1.0, -1.0), strict=True):
            side.count(sign * y, ordered if sign > 0.0 else -ordered[::-1], near, level)
        self.counted += seconds
        if self.counted >= MEMORY_SECONDS:
            self.clipped = any(side.is_clipped for side in self.sides)
            self.sides, self.counted = (_Side(), _Side()), 0.0


def _spikes(y: Array, d: Array, jumps: Any) -> Iterator[int]:
    """Places at which `y` jumps out and straight back, among all its jumps."""
    end = -1
    for k in jumps:
        if k <= end:
            continue  # the way back is no way out
        height = abs(float(d[k]))
        for w in range(1, MAX_SPIKE_SAMPLES + 1):
            if k + w + 1 >= len(y) or abs(float(y[k + w] - y[k])) <= 0.5 * height:
                break
            if abs(float(y[k + w + 1] - y[k])) < 0.4 * height:
                end = k + w
                yield int(k)
                break


Drift = dict[str, list[float]]
"""Of each channel: windows learned, mean and variance of their means, largest deviation, windows outside in a row."""


def drifts(known: Mapping[str, list[float]], row: Row, window: int, until: int) -> tuple[Drift, list[Verdict]]:
    """State of the channels' means after one more window, and channels that began or ceased to drift.

    A function of values: the engine keeps what is known in its checkpoints.
    """
    after: Drift = dict(known)
    changed = []
    for channel in row["channels"]:
        name, mean, own = channel["name"], channel["mean"], channel["std"]
        if mean is None or not own or kind_of(name, channel["unit"]) not in VIBRATION:
            continue
        before = known.get(name, [0.0, 0.0, 0.0, 0.0, 0.0])
        now, state = _follow_mean(before, mean, own)
        if state == "drift":
            text = f"{name} {_ADVICE['drift']}: {mean:.4g} {unit_text(channel['unit'])} instead of {before[1]:.4g}"
            since = window - (MIN_DRIFT_WINDOWS - 1) * (until - window)
            changed.append(Verdict(name, "drift", since, until, text))
        elif state == "good":
            changed.append(Verdict(name, "good", until, until, ""))
        if not now[-1]:
            after.pop(name, None)  # the newest come last
        after[name] = now
    while len(after) > MAX_TABLE_CHANNELS:
        del after[next(iter(after))]
    return after, changed


def _follow_mean(known: Sequence[float], mean: float, own: float) -> tuple[list[float], str]:
    """State of a channel's mean after one more window, and ``drift`` or ``good`` if a drift began or ended.

    Parameters
    ----------
    known
        As of `Drift`.
    mean, own
        Of the window, and its standard deviation, in the channel's unit.
    """
    n, centre, variance, largest, outside = known
    off = mean - centre
    limit = max(MIN_DRIFT_SIGMAS * math.sqrt(variance), MIN_DRIFT_RANGES * largest, MIN_DRIFT_SHARE * own)
    if n >= DRIFT_LEARNING_WINDOWS and abs(off) > limit:
        outside += 1.0
        if outside < MAX_DRIFT_WINDOWS:
            return [n, centre, variance, largest, outside], "drift" if outside == MIN_DRIFT_WINDOWS else ""
        n = centre = variance = largest = 0.0
        off = mean
    n += 1.0
    weight = 1.0 / min(n, 1000.0)
    if n > DRIFT_LEARNING_WINDOWS // 2:  # by then the centre is known
        largest = max(largest, abs(off) if n <= DRIFT_LEARNING_WINDOWS else min(abs(off), MAX_RANGE_GROWTH * largest))
    if n > DRIFT_LEARNING_WINDOWS:  # what lies outside must not widen what is usual
        off = math.copysign(min(abs(off), 3.0 * math.sqrt(variance)), off)
    now = [n, centre + weight * off, (1.0 - weight) * (variance + weight * off * off), largest, 0.0]
    return now, "good" if outside >= MIN_DRIFT_WINDOWS else ""

"""Proposal of sections: steady rotor and wind, no faults, and enough vibration for an identification.

The published study picked 500–600 s of a 600 s record by eye, "since the proposed mathematical model is the assumptions
constant direction and speed of the wind". Here every window of that length is given penalties, each 1 where it begins
to hurt, and the windows are ranked by their sum:

    rotor speed    standard deviation / 5 % of the mean, and drift / 5 %
    wind speed     standard deviation / 20 % of the mean, and drift / 20 %
    direction      circular standard deviation / 0.2 rad
    faults         share of samples with a fault or missing / 2 %
    excitation     how many times the vibration is below the record's median (log2; a little credit above it), and how
                   much it grows or fades, both beyond chance (`windsysid.inspection.stationarity`)
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.checks.limits import SCREENING_PROBABILITY
from windsysid.inspection.channels import VIBRATION, Kind, most_telling
from windsysid.inspection.fault import Fault
from windsysid.inspection.limits import (
    MAX_FAULT_SHARE,
    MAX_LENGTH_PENALTY,
    MAX_SPEED_VARIATION,
    MAX_WIND_VARIATION,
    MIN_DEGREES_OF_FREEDOM,
    MIN_MODE_CYCLES,
    MIN_ROTOR_SPEED,
    MIN_VIBRATION_FACTOR,
)
from windsysid.inspection.rotor import Rotor
from windsysid.inspection.sentences import joined, percent
from windsysid.inspection.stationarity import Vibration, changes, transients, vibration_of
from windsysid.records.record import Record
from windsysid.units import RPM

__all__ = ["Proposal", "propose", "propose_longest"]

MIN_SECTION_SECONDS = 100.0
"""Setting: length of a section [s] if none is given; that of the published study."""

MAX_PROPOSALS = 5
"""Setting: largest number of sections that are proposed."""
BLOCKS_PER_SECTION = 40
"""Setting: number of blocks in a section: windows start at each block."""

FALSIFYING = frozenset(("lost samples", "copied passage"))
"""Setting: faults that make results wrong wherever they are, however few samples they touch."""
CHANGE_PENALTY = 0.2
"""Setting: penalty of a change of vibration at the limit of what chance explains; a larger change is an objection."""


@dataclass(frozen=True)
class Proposal:
    """Section of the record: start and end [s], penalty (0 is best), reasons for it and against."""

    start: float
    end: float
    penalty: float
    reasons: tuple[str, ...]
    against: tuple[str, ...]

    @property
    def good(self) -> bool:
        """True if there is no objection."""
        return not self.against

    def summary(self) -> dict[str, Any]:
        """As plain values."""
        return {
            "start_s": self.start,
            "end_s": self.end,
            "good": self.good,
            "penalty": self.penalty,
            "reasons": list(self.reasons),
            "against": list(self.against),
        }

    def __str__(self) -> str:
        words = joined(self.reasons) if self.reasons else "no criterion applies"
        return words + (f"; but {joined(self.against)}" if self.against else "")


def propose(
    record: Record, known: dict[str, Kind], rotor: Rotor | None, findings: Sequence[Fault], length: float
) -> tuple[Proposal, ...]:
    """At most five windows that do not overlap, those without objections first, then by penalty.

    Parameters
    ----------
    known
        The usable channels with their kinds.
    length
        Length of a section [s]; the whole record where it is shorter.
    """
    judged = _judged(record, known, rotor, findings, length, _vibrations(record, known))
    return () if judged is None else judged.best()


def propose_longest(
    record: Record, known: dict[str, Kind], rotor: Rotor | None, findings: Sequence[Fault]
) -> tuple[Proposal, ...]:
    """Propose the whole record if its penalty is close to the median of 100 s, else 7/8, 3/4, half, a quarter … of it.

    Twice the duration makes intervals 1.4 times narrower. Parts that are too short for identification are not proposed.

    Parameters
    ----------
    known
        The usable channels with their kinds.
    """
    vibrations = _vibrations(record, known)
    whole = record.duration + 1.0 / record.rate
    least = max(MIN_SECTION_SECONDS, whole * min(1.0, _least_share(record, known, vibrations)))
    short = _judged(record, known, rotor, findings, min(least, whole), vibrations)
    if short is None:
        return ()
    usual = float(np.median(short.penalty))
    shares = (1.0, 0.875, 0.75, *(0.5**k for k in range(1, 64)))
    for length in itertools.takewhile(lambda length: length > least, (whole * share for share in shares)):
        found = _judged(record, known, rotor, findings, length, vibrations)
        if found is not None and (best := found.best())[0].good and best[0].penalty <= usual + MAX_LENGTH_PENALTY:
            return best
    return short.best()


def _vibrations(record: Record, known: dict[str, Kind]) -> dict[str, Vibration]:
    """Compute the power over time of vibration channels."""
    chosen = _few([name for name, kind in known.items() if kind in VIBRATION])
    return {name: found for name in chosen if (found := vibration_of(record, name)) is not None}


def _least_share(record: Record, known: dict[str, Kind], vibrations: dict[str, Vibration]) -> float:
    """Share of the record that a section needs for `MIN_MODE_CYCLES` and `MIN_DEGREES_OF_FREEDOM`: median over the
    channels of the best kind of vibration."""
    telling = [name for name in most_telling(record) if name in vibrations]
    shares = [
        max(MIN_MODE_CYCLES / max(one.cycles, 1e-9), MIN_DEGREES_OF_FREEDOM / float(one.degrees[0]))
        for one in (vibrations[name] for name in telling if known[name] == known[telling[0]])
    ]
    return float(np.median(shares)) if shares else 0.0


class _Judged(NamedTuple):
    """Windows of one length: start [s], length [s], blocks per window, penalties, reasons and objections."""

    starts: Array
    length: float
    blocks: int
    penalty: Array
    reasons: list[list[str]]
    against: list[list[str]]

    def best(self) -> tuple[Proposal, ...]:
        """Select at most `MAX_PROPOSALS` windows without overlap, by absence of objections, then by penalty."""
        order = sorted(range(len(self.starts)), key=lambda w: (len(self.against[w]) > 0, self.penalty[w]))
        chosen: list[int] = []
        for w in order:
            if all(abs(w - other) >= self.blocks for other in chosen):
                chosen.append(w)
            if len(chosen) == MAX_PROPOSALS:
                break
        return tuple(
            Proposal(
                round(float(self.starts[w]), 3), round(float(self.starts[w]) + self.length, 3),
                round(float(self.penalty[w]), 3), tuple(self.reasons[w]), tuple(self.against[w]),
            )
            for w in chosen
        )  # fmt: skip


def _judged(
    record: Record, known: dict[str, Kind], rotor: Rotor | None, findings: Sequence[Fault], length: float,
    vibrations: dict[str, Vibration],
) -> _Judged | None:  # fmt: skip
    """Judge every window of a length [s]; None if the record is too short."""
    step = 1.0 / record.rate
    whole = record.duration + step
    length = min(length, whole)
    blocks = BLOCKS_PER_SECTION
    size = length / blocks
    count = int(whole / size * (1.0 + 1e-12))
    if count > blocks * record.samples:  # most blocks would be empty, because of a long gap
        return None
    edges = np.searchsorted(record.time, record.time[0] - 0.5 * step + size * np.arange(count + 1))
    if count < blocks or np.any(edges[blocks:] - edges[:-blocks] < blocks):
        blocks = min(blocks, count)
        if blocks < 2:
            return None
    windows = count - blocks + 1
    starts = record.time[0] + size * np.arange(windows)
    cut = _Blocks(edges, blocks)

    penalty = np.zeros(windows)
    reasons: list[list[str]] = [[] for _ in range(windows)]
    against: list[list[str]] = [[] for _ in range(windows)]

    def judge(scores: Array, words: Sequence[str], complaint: Sequence[str], limit: float | Array = 1.0) -> None:
        penalty[:] += scores
        bad = scores > limit
        for w in range(windows):
            (against if bad[w] else reasons)[w].append(complaint[w] if bad[w] else words[w])

    if rotor is not None and rotor.turns:
        _judge_rotor(record, rotor, cut, judge)
    _judge_wind(record, known, cut, judge)
    _judge_faults(record, known, findings, cut, judge)
    _judge_excitation(vibrations, cut, judge)
    return _Judged(starts, blocks * size, blocks, penalty, reasons, against)


def _judge_rotor(record: Record, rotor: Rotor, cut: "_Blocks", judge: Any) -> None:
    """Judge variation and drift of the rotor speed."""
    mean, std, drift = cut.moments(rotor.speed, record.time)
    parked = np.abs(mean) < MIN_ROTOR_SPEED
    turning = np.where(parked, np.inf, np.abs(mean))
    spread, drift = std / turning, np.abs(drift) / turning
    rpm = np.abs(mean) * RPM
    steady = [
        (
            "rotor parked"
            if p
            else (
                f"rotor speed constant at {v:.3g} rpm"
                if s < 1e-6
                else f"rotor speed {v:.3g} rpm, steady within {percent(s)}"
            )
        )
        for v, s, p in zip(rpm, spread, parked, strict=True)
    ]
    unsteady = [
        f"the rotor speed ({v:.3g} rpm) varies by {percent(s)} and drifts by {percent(d)}"
        for v, s, d in zip(rpm, spread, drift, strict=True)
    ]
    judge(spread / MAX_SPEED_VARIATION + 0.5 * drift / MAX_SPEED_VARIATION, steady, unsteady, 1.5)


def _judge_wind(record: Record, known: dict[str, Kind], cut: "_Blocks", judge: Any) -> None:
    """Judge variation and drift of the wind, in the first channels of its speed and of its direction."""
    first = {kind: name for name, kind in reversed(known.items())}
    if "wind speed" in first:
        mean, std, drift = cut.moments(record[first["wind speed"]], record.time)
        slow = np.maximum(np.abs(mean), 0.5)
        words = [f"wind {m:.3g} ± {s:.2g} m/s" for m, s in zip(mean, std, strict=True)]
        complaint = [f"{text}, drifting by {d:+.2g} m/s" for text, d in zip(words, drift, strict=True)]
        judge(std / slow / MAX_WIND_VARIATION + 0.5 * np.abs(drift) / slow / MAX_WIND_VARIATION, words, complaint, 2.0)
    if "direction" in first:
        spread = cut.circular_spread(record[first["direction"]])
        words = [f"direction within ± {np.degrees(s):.2g}°" for s in spread]
        judge(spread / MAX_WIND_VARIATION, words, [f"the wind direction changes ({text})" for text in words], 1.5)


class _Blocks:
    """Sums over blocks of samples, and from them over every window of some blocks."""

    def __init__(self, edges: NDArray[np.int64], per_window: int):
        self.edges, self.per_window = edges, per_window

    def sums(self, values: Array) -> Array:
        """Sum over each block; empty blocks give 0."""
        total = np.concatenate([[0.0], np.cumsum(values)])
        return np.asarray(np.diff(total[self.edges]), dtype=np.float64)

    def windows(self, block_sums: Array) -> Array:
        """Sums over each window."""
        total = np.concatenate([[0.0], np.cumsum(block_sums)])
        return np.asarray(total[self.per_window :] - total[: -self.per_window], dtype=np.float64)

    def moments(self, values: Array, time: Array) -> tuple[Array, Array, Array]:
        """Mean, standard deviation, and drift from start to end by least squares, of each window."""
        ok = np.isfinite(values)
        centre = float(np.mean(values[ok]))
        x = np.where(ok, values - centre, 0.0)
        t = np.where(ok, time - time.mean(), 0.0)
        n, sx, sxx, st, stt, stx = (
            self.windows(self.sums(q)) for q in (ok.astype(np.float64), x, x * x, t, t * t, t * x)
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = sx / n
            variance = np.maximum(sxx / n - mean**2, 0.0)
            variance = np.where(variance < 1e-13 * (centre + mean) ** 2, 0.0, variance)
            slope = (stx - st * sx / n) / (stt - st * st / n)
        duration = self.per_window * float(np.median(np.diff(time[np.minimum(self.edges, time.size - 1)])))
        return mean + centre, np.sqrt(variance), np.where(variance > 0.0, slope, 0.0) * duration

    def circular_spread(self, angle: Array) -> Array:
        """Circular standard deviation [rad] of each window."""
        ok = np.isfinite(angle)
        n, c, s = (
            self.windows(self.sums(np.where(ok, q, 0.0))) for q in (np.ones_like(angle), np.cos(angle), np.sin(angle))
        )
        length = np.clip(np.hypot(c, s) / np.maximum(n, 1.0), 1e-9, 1.0)
        return np.asarray(np.sqrt(-2.0 * np.log(length)), dtype=np.float64)


def _judge_faults(record: Record, known: dict[str, Kind], findings: Sequence[Fault], cut: _Blocks, judge: Any) -> None:
    """Share of samples that a fault touches; gaps count with the samples they lost."""
    lost, faulty = _faulty_samples(record, known, findings)
    touched = np.max([np.zeros(record.samples), *(marked for kind, marked in faulty.items() if kind != "gaps")], axis=0)
    share = cut.windows(cut.sums(touched + lost)) / np.maximum(cut.windows(cut.sums(1.0 + lost)), 1.0)
    present = {kind: cut.windows(cut.sums(marked)) > 0.0 for kind, marked in faulty.items()}
    words = []
    for w in range(share.size):
        here = [kind for kind, where in present.items() if where[w]]
        words.append(f"{joined(here)} in {percent(share[w])} of the samples" if here else "no gaps or faults")
    for kind in FALSIFYING & present.keys():
        share[present[kind]] += MAX_FAULT_SHARE * (1.0 + 1e-9)
    judge(share / MAX_FAULT_SHARE, words, words)


def _faulty_samples(
    record: Record, known: dict[str, Kind], findings: Sequence[Fault]
) -> tuple[Array, dict[str, Array]]:
    """Number of samples lost before each sample (T,), and, by kinds of faults, 1 for samples that they touch (T,)."""
    lost = np.zeros(record.samples)
    faulty: dict[str, Array] = {}
    for finding in findings:
        matters = not finding.channel or known.get(finding.channel) in (*VIBRATION, "azimuth", "rotor speed")
        if not len(finding.spans) or not matters:
            continue
        marked = faulty.setdefault(finding.kind, np.zeros(record.samples))
        low = np.searchsorted(record.time, finding.spans[:, 0], side="left")
        high = np.searchsorted(record.time, finding.spans[:, 1], side="right")
        if finding.kind == "gaps":
            after = np.minimum(high - 1, record.samples - 1)
            lost[after] += np.rint((finding.spans[:, 1] - finding.spans[:, 0]) * record.rate) - 1
            marked[after] = 1.0
        else:
            np.maximum(marked, _inside(low, high, record.samples), out=marked)
    return lost, faulty


def _inside(low: NDArray[np.int64], high: NDArray[np.int64], samples: int) -> Array:
    """1 for the samples (T,) from one of `low` to before its `high`, else 0."""
    marks = np.zeros(samples + 1)
    np.add.at(marks, low, 1.0)
    np.add.at(marks, high, -1.0)
    return (np.cumsum(marks)[:-1] > 0.0).astype(np.float64)


_NAMES = {2: "halves", 4: "quarters"}


def _judge_excitation(vibrations: dict[str, Vibration], cut: _Blocks, judge: Any) -> None:
    """Judge the level of vibration relative to the record's and its change within a window, both beyond chance."""
    first, last = cut.edges[: -cut.per_window], cut.edges[cut.per_window :]
    if not vibrations:
        nothing = ["no channel measures vibration"] * len(first)
        judge(np.full(len(nothing), 2.0), nothing, nothing)
        return
    level, chance = _levels(list(vibrations.values()), np.stack([first, last], axis=-1))
    weak = -np.log2(level)
    judge(
        np.where(weak > 0.0, weak, np.maximum(0.25 * weak, -0.5)),
        [f"vibration {v:.2g} × that of the record" for v in level],
        [f"RMS only {v:.2g} × the record's median" for v in level],
        np.maximum(-np.log2(MIN_VIBRATION_FACTOR), np.log2(chance)),
    )
    found = changes(list(vibrations.values()), first, last)
    transient = transients(list(vibrations.values()), first, last)
    verb = ["grows" if f > 1.0 else "fades" for f in found.factor]
    size = np.exp(np.abs(np.log(found.factor)))
    complaint = [
        text
        or f"the vibration {v} by {f:.2g} × between its {_NAMES[n]}; chance explains {most:.2g} × at"
        " most (unless a decay is intended)"
        for text, f, v, n, most in zip(transient, size, verb, found.segments, found.allowed, strict=True)
    ]
    words = [
        f"stationary (tested at {percent(SCREENING_PROBABILITY)})"
        if c
        else f"it {v} by {f:.2g} × between its {_NAMES[n]}"
        for f, v, n, c in zip(size, verb, found.segments, found.by_chance, strict=True)
    ]
    excess = np.maximum(found.excess, 2.0 * (np.array(transient) != ""))
    judge(CHANGE_PENALTY * excess, words, complaint, CHANGE_PENALTY)


def _levels(vibrations: Sequence[Vibration], windows: NDArray[np.int64]) -> tuple[Array, Array]:
    """Rms of windows (w, 2) relative to the median window, mean over channels, and its largest ratio by chance."""
    from scipy.special import chdtri

    power, freedom = (
        np.array([part[0] for part in parts])
        for parts in zip(*(vibration.power(windows) for vibration in vibrations), strict=True)
    )
    level = np.sqrt(power / np.median(power, axis=1, keepdims=True))
    least = np.median(freedom, axis=0)
    rare = chdtri(least, 1.0 - SCREENING_PROBABILITY) / least, chdtri(least, SCREENING_PROBABILITY) / least
    chance = np.sqrt(np.maximum(1.0 / np.maximum(rare[0], 1e-9), rare[1]))
    return np.exp(np.mean(np.log(np.maximum(level, 1e-9)), axis=0)), chance


def _few(channels: Sequence[str], most: int = 12) -> list[str]:
    """At most so many, spread over all."""
    return (
        list(channels)
        if len(channels) <= most
        else [channels[i] for i in np.linspace(0, len(channels) - 1, most).astype(int)]
    )

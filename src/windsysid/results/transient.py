"""Transients: records whose vibration falls over time, as it does in a free decay.

Tests of residuals suppose stationary loads. In a free decay they fail without any of the causes that they are made for:
its level falls, its only frequency stands out as a line does, and its beginning has most of the squared residuals. So
where the vibration falls, a result that is in doubt names this instead.

From the loudest sixteenth of a record on, the mean square of each quarter of the rest is compared with that of the one
before. Of 1500 stationary records of a mode that counts as 3 to 16 independent values, at most one in 160 falls
`MIN_FALL` times, and one in 20 `MIN_COMMON_FALL` times: that counts where all channels do, as they do in a decay.
"""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.results.diagnosis import Diagnosis

__all__ = ["Transient", "explain_by_transient", "find_transient", "without_cause"]

MIN_FALL, MIN_COMMON_FALL = 3.0, 1.5
"""Ratio of rms values from which a vibration falls more than a stationary one does by chance: of one channel, and of
two or more together."""

SEGMENTS, QUARTERS = 16, 4
"""Segments in which the loudest is looked for, and parts of what follows."""

MAX_RISE, MAX_BEFORE = 1.1, 0.3
"""Ratios of mean squares: of a quarter to the one before, and of any segment before the loudest to that, but for the
one in which the decay may begin."""


class Transient(NamedTuple):
    """Channels whose vibration falls, and by how much the first of them does (ratio of rms values)."""

    channels: tuple[str, ...]
    fall: float

    @property
    def reason(self) -> str:
        """Why a result is in doubt."""
        return (
            f"{self.channels[0]} falls {self.fall:.2g}-fold over the record (a transient, such as a free decay), and "
            "checks that suppose stationary loads fail: compare other records"
        )


def find_transient(values: Array, channels: Sequence[str]) -> Transient | None:
    """The channels of readings (T, m) whose vibration falls; None where it does in none."""
    falls = {name: _fall(column) for name, column in zip(channels, values.T, strict=True)}
    least = MIN_COMMON_FALL if len(falls) > 1 and min(falls.values()) >= MIN_COMMON_FALL else MIN_FALL
    falling = sorted((name for name in falls if falls[name] >= least), key=lambda name: -falls[name])
    return Transient(tuple(falling), falls[falling[0]]) if falling else None


def explain_by_transient(diagnosis: Diagnosis, found: Transient, readings: Sequence[str]) -> Diagnosis:
    """The diagnosis with the transient as the reason in place of the causes that tests of stationary loads name.

    A reason that names one of the `readings` that do not fall stays as it is.
    """
    steady = [name for name in readings if name not in found.channels]
    kept = [one for one in diagnosis.reasons if without_cause(one) == one or any(_names(one, name) for name in steady)]
    reasons = diagnosis.reasons if len(kept) == len(diagnosis.reasons) else (found.reason, *kept)
    return replace(diagnosis, reasons=reasons, remarks=tuple(map(without_cause, diagnosis.remarks)))


def without_cause(sentence: str) -> str:
    """A sentence up to where it names a likely cause and what to do about it; in brackets, up to their end."""
    return re.sub(r"[:;] ?(likely |take the spikes out).*?(?=\)$|$)", "", sentence, flags=re.DOTALL)


def _names(sentence: str, channel: str) -> bool:
    return re.search(rf"(?<!\w){re.escape(channel)}(?!\w)", sentence) is not None


def _fall(readings: Array) -> float:
    """By how much the rms of readings (T,) about a straight line falls after their loudest segment; 0 where they do
    not fall all the time."""
    known = readings[np.isfinite(readings)]
    if len(known) < 2 * SEGMENTS:
        return 0.0
    time = np.linspace(-1.0, 1.0, len(known))
    known = known - known.mean()
    known = known - time * (time @ known) / (time @ time)
    power = _mean_squares(known, SEGMENTS)
    loudest = int(np.argmax(power))
    if loudest > SEGMENTS // 2 or not power[: max(loudest - 1, 0)].max(initial=0.0) <= MAX_BEFORE * power[loudest]:
        return 0.0
    rest = _mean_squares(known[len(known) * loudest // SEGMENTS :], QUARTERS)
    rises = rest[1:] > MAX_RISE * rest[:-1]
    if (rises & (rest[1:] > rest[0] / MIN_FALL**2)).any():  # below that is noise
        return 0.0
    return float(np.sqrt(rest[0] / max(rest[-1], 1e-300)))


def _mean_squares(values: Array, parts: int) -> Array:
    return np.array([np.mean(np.square(part)) for part in np.array_split(values, parts)])

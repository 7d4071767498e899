"""Stops of the rotor in a record: vibration after one decays without the aerodynamic damping of a turning rotor, and so
determines structural damping.

A stop is a fall of the rotor speed from half of the highest to 10 % of the usual one within a minute. Its section
begins there and ends when the rotor turns again.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import NEGLIGIBLE_SHARE
from windsysid.inspection.channels import VIBRATION, Kind
from windsysid.inspection.limits import (
    MAX_FALL_SECONDS,
    MAX_VIBRATION_CHANGE,
    MIN_ROTOR_SPEED,
)
from windsysid.inspection.rotor import Rotor
from windsysid.records.record import Record
from windsysid.units import RPM

__all__ = ["Stop", "find_stops"]


MAX_STOP_SECONDS = 1200.0
"""Setting: length to which a section after a stop is cut [s]."""

EARLY_SECONDS = 10.0
"""Setting: time after a stop over which the first vibration is taken [s]."""


@dataclass(frozen=True)
class Stop:
    """A stop of the rotor and the section after it.

    Attributes
    ----------
    start, end
        Of the section after it [s].
    rotor_speed
        Before it [rad/s].
    fall
        From half of the highest to 10 % of the usual rotor speed [s].
    decay
        How many times vibration falls from right after the stop to the section's second half, in the channel where it
        falls most.
    channel
        That channel; empty where none vibrates.
    """

    start: float
    end: float
    rotor_speed: float
    fall: float
    decay: float
    channel: str

    @property
    def decays(self) -> bool:
        """True if the stop was followed by a free decay."""
        return self.decay >= MAX_VIBRATION_CHANGE

    def summary(self) -> dict[str, Any]:
        """As plain values."""
        return {
            "start_s": self.start, "end_s": self.end, "rotor_speed_before_rad_s": self.rotor_speed, "fall_s": self.fall,
            "decay": self.decay, "channel": self.channel,
        }  # fmt: skip

    def __str__(self) -> str:
        fell = f"from {self.rotor_speed * RPM:.3g} rpm in {self.fall:.2g} s"
        if not self.channel:
            return fell
        dies = f"{self.channel} dies away {self.decay:.2g} ×"
        return f"{fell}; {dies if self.decays else 'no vibration that dies away, the parked rotor all the same'}"


def find_stops(record: Record, rotor: Rotor | None, known: dict[str, Kind]) -> tuple[Stop, ...]:
    """Stops of the rotor, in order of time.

    Parameters
    ----------
    rotor
        How the rotor turned; without it no stop is found.
    known
        The usable channels with their kinds.
    """
    if rotor is None:
        return ()
    speed, time = np.abs(rotor.speed), record.time
    turning = speed > max(0.5 * np.percentile(speed, 99.0), MIN_ROTOR_SPEED)
    if not turning.any():
        return ()
    stands = NEGLIGIBLE_SHARE * float(np.median(speed[turning]))
    stopped = speed < stands
    entries = np.flatnonzero(stopped[1:] & ~stopped[:-1]) + 1
    runs, turns = np.flatnonzero(turning), np.flatnonzero(speed > stands)
    found: list[Stop] = []
    for entry in entries:
        before = np.searchsorted(runs, entry) - 1
        if (
            before < 0
            or time[entry] - time[runs[before]] > MAX_FALL_SECONDS
            or (found and found[-1].start > time[runs[before]])
        ):
            continue
        again = np.searchsorted(turns, entry)
        end = float(time[turns[again]] if again < len(turns) else time[-1])
        start, end = float(time[entry]), min(end, float(time[entry]) + MAX_STOP_SECONDS)
        if end - start >= 2.0 * EARLY_SECONDS:  # else its second half is not later
            channel, decay = _decay(record.section(start, end), known)
            lasted = runs[: before + 1]
            earlier = speed[lasted[time[lasted] > time[lasted[-1]] - MAX_FALL_SECONDS]]
            fall = float(time[entry] - time[lasted[-1]])
            found.append(Stop(round(start, 3), round(end, 3), float(np.median(earlier)), fall, decay, channel))
    return tuple(found)


def _decay(section: Record, known: dict[str, Kind]) -> tuple[str, float]:
    """The channel whose vibration falls most, and by how much."""
    early = section.time < section.time[0] + EARLY_SECONDS
    late = section.time > section.time[0] + 0.5 * section.duration
    best = ("", 0.0)
    for channel in (name for name, kind in known.items() if kind in VIBRATION):
        first, last = (_rms(section[channel][part]) for part in (early, late))
        if last > 0.0 and first / last > best[1]:
            best = (channel, first / last)
    return best


def _rms(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.std(known)) if len(known) > 1 else 0.0

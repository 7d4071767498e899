"""Rotor of a record: its speed from the channels that tell it, and contradictions between speed and azimuth."""

import math
from collections.abc import Container
from typing import TYPE_CHECKING, Any

import numpy as np

from windsysid._types import Array
from windsysid.inspection.fault import Fault, Severity, unit_fault
from windsysid.inspection.limits import MAX_ROTOR_SPEED, MIN_ROTOR_SPEED
from windsysid.inspection.tags import meaning_of
from windsysid.records.record import Record
from windsysid.signals.azimuth import MAX_SCATTER_RADIANS, steadied

if TYPE_CHECKING:
    from windsysid.turbine.turbine import Turbine

__all__ = ["Rotor", "once_per_turn", "rotor_faults", "rotor_of", "turns_per_second"]


_TURN = math.tau
_RATIOS = (
    (60.0 / _TURN, "rpm marked as rad/s"),
    (360.0 / _TURN, "degrees marked as radians"),
    (1.0 / _TURN, "turns (Hz) marked as radians"),
    (6.0, "rpm and deg/s mixed up"),
)
"""Setting: ratio of a written value to the right one, and the mistake that makes it."""


class Rotor:
    """Rotation of the rotor.

    Attributes
    ----------
    speed
        (T,) [rad/s], bridged where it was missing.
    source
        The channel it comes from.
    """

    def __init__(self, speed: Array, source: str):
        self.speed, self.source = speed, source
        self.mean = float(np.mean(speed))
        self.variation = float(np.std(speed) / abs(self.mean)) if self.mean else 0.0
        self.turns = abs(self.mean) > MIN_ROTOR_SPEED


def turns_per_second(record: Record) -> float:
    """Mean rotor speed of a record [Hz]; 0 where the rotor stands or its speed is unknown."""
    rotor = rotor_of(record)
    return abs(rotor.mean) / math.tau if rotor is not None and rotor.turns else 0.0


def _speed_channels(record: Record) -> list[str]:
    """Channels with the rotor speed [rad/s], by their names: ``rotor_speed``, or those of other loggers.

    The speed of a generator counts where it is one that rotors have: there is no gear.
    """
    if "rotor_speed" in record:
        return ["rotor_speed"]
    names = [name for name in record.channels if record.unit(name) == "rad/s" and np.isfinite(record[name]).any()]
    ours = {name: getattr(meaning_of(name), "name", None) for name in names}
    turning = [name for wanted in ("rotor_speed", "generator_speed") for name in names if ours[name] == wanted]
    return [name for name in turning if abs(float(np.nanmean(record[name]))) < MAX_ROTOR_SPEED]


def rotor_of(record: Record, usable: "set[str] | None" = None) -> Rotor | None:
    """Rotor speed from its channel, or from the azimuth; None where neither is usable."""
    for channel in (*_speed_channels(record), "rotor_azimuth"):
        if channel not in record or (usable is not None and channel not in usable):
            continue
        values = record[channel]
        known = np.isfinite(values)
        if known.sum() < 10:
            continue
        if channel != "rotor_azimuth":
            return Rotor(np.interp(record.time, record.time[known], values[known]), channel)
        psi = np.interp(record.time, record.time[known], np.unwrap(values[known]))
        window = max(1, round(record.rate))  # one second: an encoder's steps average out
        ahead, behind = (
            np.minimum(np.arange(psi.size) + window, psi.size - 1),
            np.maximum(np.arange(psi.size) - window, 0),
        )
        return Rotor((psi[ahead] - psi[behind]) / (record.time[ahead] - record.time[behind]), channel)
    return None


def once_per_turn(record: Record, values: Array, rotor: Rotor) -> float:
    """Amplitude of a channel at 1P, from the angle that the rotor turned."""
    ok = np.isfinite(values)
    psi = np.concatenate([[0.0], np.cumsum(0.5 * (rotor.speed[1:] + rotor.speed[:-1]) * np.diff(record.time))])
    return float(2.0 * np.abs(np.mean((values[ok] - values[ok].mean()) * np.exp(-1j * psi[ok]))))


def rotor_faults(record: Record, known: Container[str], turbine: "Turbine | None") -> list[Fault]:
    """Faults of rotor speed and azimuth: wrong units, and contradictions between them (`known`: usable channels)."""
    found = _rotor_speed(record, turbine) if "rotor_speed" in known else []
    if "rotor_azimuth" in known:
        found += _azimuth_against_speed(record, "rotor_speed" in known)
    return found


def _rotor_speed(record: Record, turbine: "Turbine | None") -> list[Fault]:
    usual = float(np.nanmedian(record["rotor_speed"]))
    if "rotor_azimuth" in record and _azimuth_speed(record) is not None:
        return []  # the azimuth tells more, see below
    if turbine is not None and turbine.rotor_speed > 0.0 and usual != 0.0:
        return _against_usual_speed(usual, turbine)
    rpm = usual * 60.0 / _TURN
    if abs(usual) > 30.0:
        return [unit_fault("rotor_speed", "fast rotor", speed=usual, rpm=rpm)]
    if abs(usual) > MAX_ROTOR_SPEED:
        return [unit_fault("rotor_speed", "small rotor", "note", speed=usual, rpm=rpm)]
    return []


def _against_usual_speed(speed: float, turbine: "Turbine") -> list[Fault]:
    """A wrong unit of a rotor speed, by that of the turbine file: a machine may run away, but hardly this far."""
    ratio = abs(speed) / turbine.rotor_speed
    for factor, mistake in _RATIOS[:3]:
        if abs(np.log(ratio / factor)) < 0.35 and abs(np.log(ratio)) > 1.0:
            severity: Severity = "warning" if factor > 1.0 else "note"  # an idling rotor is slow too
            speeds = {"speed": speed, "usual": turbine.rotor_speed, "turbine": turbine.name}
            return [unit_fault("rotor_speed", "another usual speed", severity, **speeds, mistake=mistake)]
    return []


def _azimuth_speed(record: Record) -> float | None:
    """Mean speed of the azimuth [rad/s]; None where it does not turn or its own unit is in doubt."""
    values = record["rotor_azimuth"]
    ok = np.isfinite(values)
    if ok.sum() < 10:
        return None
    time, psi = record.time[ok], values[ok]
    steps = np.mod(np.diff(psi) + np.pi, _TURN) - np.pi
    near = np.diff(time) < 1.5 / record.rate
    return float(np.median(steps[near] / np.diff(time)[near])) if near.any() else None


def _azimuth_against_speed(record: Record, with_speed: bool) -> list[Fault]:
    psi = record["rotor_azimuth"]
    psi = psi[np.isfinite(psi)]
    span = float(np.ptp(psi))
    wraps = int(np.count_nonzero(np.abs(np.diff(psi)) > 0.5 * span))
    if wraps >= 3 and not 0.95 * _TURN < span < 1.05 * _TURN and span < 400.0:
        return []  # the unit is wrong: said already
    own = _azimuth_speed(record)
    if own is None:
        return []
    if own < -0.02:
        return [_contradiction(evidence="backwards", azimuth=own)]
    found = _azimuth_scatter(record)
    if not with_speed:
        return found
    return _against_speed(record, own) or [*found, *_azimuth_jumps(record)]


def _against_speed(record: Record, own: float) -> list[Fault]:
    """A mean speed of the azimuth [rad/s] that contradicts the rotor speed."""
    mean = float(np.median(_speed_at_azimuth(record)))
    if abs(mean) <= 0.05 or abs(own / mean - 1.0) <= 0.02:
        return []
    ratio = mean / own if own else np.inf
    mistake = next((text for factor, text in _RATIOS if abs(abs(ratio) / factor - 1.0) < 0.02), "")
    return [_contradiction(azimuth=own, speed=mean, ratio=ratio, mistake=mistake)]


def _azimuth_jumps(record: Record) -> list[Fault]:
    """Places where the azimuth jumps by more than the rotor turned."""
    ok = np.isfinite(record["rotor_azimuth"])
    time, speed = record.time[ok], _speed_at_azimuth(record)
    expected = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time)
    slip = np.mod(np.diff(record["rotor_azimuth"][ok]) - expected + np.pi, _TURN) - np.pi
    # two glitches that cancel are a spike, reported as such; a slip stays
    lasting = np.flatnonzero((np.abs(slip) > 0.3) & (np.abs(_around(slip)) > 0.3) & (np.diff(time) < 1.5 / record.rate))
    if not lasting.size:
        return []
    spans = np.column_stack([time[lasting], time[lasting + 1]])
    data = {"largest": float(np.max(np.abs(slip[lasting])))}
    return [Fault("rotor_azimuth", "azimuth jumps", "warning", int(lasting.size), spans, data)]


def _speed_at_azimuth(record: Record) -> Array:
    """Rotor speed at the times of known azimuths, bridged where it is missing."""
    ok = np.isfinite(record["rotor_azimuth"])
    time, speed = record.time[ok], record["rotor_speed"][ok]
    known = np.isfinite(speed)
    return np.interp(time, time[known], speed[known])


def _azimuth_scatter(record: Record) -> list[Fault]:
    """That azimuths scatter about a smooth rotation, more than gravity on the blades lets pass."""
    record = record.on_own_times()
    smooth = steadied(record)
    if smooth is record:
        return []
    off = np.mod(record["rotor_azimuth"] - smooth["rotor_azimuth"] + np.pi, _TURN) - np.pi
    off = off[np.isfinite(off)]
    off = off[np.abs(off) <= 10.0 * np.median(np.abs(off))]  # others are spikes
    if not np.std(off) > MAX_SCATTER_RADIANS:
        return []
    data = {"degrees": float(np.degrees(np.std(off)))}
    return [Fault("rotor_azimuth", "azimuth scatter", "warning", int(off.size), data=data)]


def _around(values: Array, reach: int = 6) -> Array:
    """Sum of each value with its neighbours."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    index = np.arange(values.size)
    return np.asarray(
        total[np.minimum(index + reach + 1, values.size)] - total[np.maximum(index - reach, 0)], dtype=np.float64
    )


def _contradiction(**data: Any) -> Fault:
    return Fault("rotor_azimuth", "contradiction", "warning", 0, data=data)

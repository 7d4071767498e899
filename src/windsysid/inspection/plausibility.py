"""Units that cannot be right, and channels that contradict each other."""

import itertools
import math
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from windsysid._types import Array
from windsysid.inspection.bodies import body_of
from windsysid.inspection.channels import Kind, is_position
from windsysid.inspection.fault import Fault, Severity
from windsysid.inspection.limits import (
    MAX_ACCELERATION_RATE,
    MAX_DOUBTFUL_ACCELERATION_RATE,
    MAX_ROTOR_SPEED,
    MAX_SWING,
    MIN_ACCELERATION_RATE,
    MIN_ROTOR_SPEED,
)
from windsysid.inspection.tags import meaning_of
from windsysid.records.record import Record
from windsysid.signals.azimuth import MAX_SCATTER, steadied

if TYPE_CHECKING:
    from windsysid.turbine.turbine import Turbine

__all__ = ["GRAVITY", "TIME", "Rotor", "implausible", "once_per_turn", "rotor_of", "turns_per_second"]


GRAVITY = 9.80665
"""Setting: standard acceleration of gravity [m/s²]."""
TIME = "time"
"""Subject of findings on the time's unit."""
_TURN = math.tau
_RATIOS = (
    (60.0 / _TURN, "rpm marked as rad/s"),
    (360.0 / _TURN, "degrees marked as radians"),
    (1.0 / _TURN, "turns (Hz) marked as radians"),
    (6.0, "rpm and deg/s mixed up"),
)
"""Setting: ratio of a written value to the right one, and the mistake that makes it."""


_GRAVITIES = (
    (1.0 / GRAVITY, "g marked as m/s²"),
    (1e3 / GRAVITY, "mg marked as m/s²"),
    (1e3, "mm/s² marked as m/s²"),
    (GRAVITY, "m/s² marked as g"),
)
"""Setting: gravity in a wrong unit over 9.81 m/s², and the mistake that makes it."""


_AXIS = re.compile(r"(.+)_([xyz])_((?:acceleration|velocity|displacement)(?:_kinematic)?)")

HALF_QUARTER_TURN = 45.0
"""Setting: angle [deg] from which on an axis is nearer to the other one."""

MAX_GRAVITY_DIFFERENCE = 0.01
"""Setting: relative difference from gravity of the means of two axes that share it; calibrations are as good."""

MIN_SWING_FREQUENCY = 0.1
"""Setting: frequency [Hz] above which the motion is computed that an acceleration means."""

MAX_SWING_SIGMAS = 20.0
"""Setting: distance from the median, in robust standard deviations, beyond which readings are codes or spikes and no
motion."""

MIN_TILT_DEGREES = 1.0
"""Setting: smallest tilt of an axis that is reported; rotors are tilted by 4 to 8°, towers lean by less."""

MIN_YAW_DEGREES = 10.0
"""Setting: smallest yaw that is reported where sensors do not yaw: each axis shows 17 % of the other's motion."""


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


def implausible(record: Record, known: dict[str, Kind], rotor: Rotor | None, turbine: "Turbine | None") -> list[Fault]:
    """Faults of units and contradictions over all channels (`known`: those that are usable, with their kinds)."""
    found = _pace(record) if "acceleration" in known.values() else []
    for channel, kind in known.items():
        found += _wrong_unit(record, channel, kind, rotor)
    found += [*_tilts(record, known), *_yawed_axes(record, known)]
    if not any(one.data.get("evidence") == "gravity in another unit" for one in found):
        found += _tilted(record, [channel for channel, kind in known.items() if kind == "acceleration"])
    if "rotor_speed" in known:
        found += _rotor_speed(record, turbine)
    if "rotor_azimuth" in known:
        found += _azimuth_against_speed(record, "rotor_speed" in known)
    return found


def _wrong_unit(record: Record, channel: str, kind: Kind, rotor: Rotor | None) -> list[Fault]:
    """A unit that the values of a channel contradict."""
    values, unit = record[channel], record.unit(channel)
    x = values[np.isfinite(values)]
    if kind == "acceleration" and unit == "m/s^2":
        return _acceleration(record, channel, x, rotor)
    if kind == "displacement" and unit == "m":
        large = np.std(x) > 10.0 and not is_position(channel)
        return [_unit(channel, "no deflection so large", rms=float(np.std(x)))] if large else []
    if unit == "rad":
        return _angle(channel, kind, x)
    if kind == "wind speed" and np.mean(x) > 40.0:
        return [_unit(channel, "no wind so strong", mean=float(np.mean(x)))]
    return []


def _pace(record: Record) -> list[Fault]:
    """Test whether accelerations come so seldom that the time was in milliseconds, or so often that it was in days."""
    step = 1.0 / record.rate
    if record.rate < MIN_ACCELERATION_RATE:
        return [_unit(TIME, "no structure so slow", step=step)]
    slow = record.rate <= MAX_DOUBTFUL_ACCELERATION_RATE and np.array_equal(record.time, np.round(record.time))
    if not slow and record.rate <= MAX_ACCELERATION_RATE:
        return []
    return [Fault(TIME, "pace", "warning", 0, data={"step": step, "slow": slow})]


def _tilted(record: Record, channels: Sequence[str]) -> list[Fault]:
    """A wrong unit of accelerometers along three axes that stand at any angle, by the size of their mean."""
    found = []
    for place, three in _by_place([name for name in channels if record.unit(name) == "m/s^2"]).items():
        means = [float(np.nanmean(record[channel])) for channel in three]
        rms = max(float(np.nanstd(record[channel])) for channel in three)
        size = math.hypot(*means)
        for factor, mistake in _GRAVITIES if len(three) == 3 else ():
            if abs(size / (GRAVITY * factor) - 1.0) < 0.03 and rms < 0.1 * size:
                found.append(_unit(place, "gravity of three axes", mean=size, mistake=mistake))
    return found


def _by_place(channels: Sequence[str]) -> dict[str, list[str]]:
    """Channels whose names differ in the axis x, y or z only."""
    places: dict[str, list[str]] = {}
    for channel in channels:
        axis = re.search(r"(?:^|_|\b|(?<=[a-z]))[xyzXYZ](?=$|_|\b)", channel)
        if axis is not None:
            places.setdefault(channel[: axis.end() - 1] + "*" + channel[axis.end() :], []).append(channel)
    return places


def _swing(record: Record, channel: str) -> float:
    """Motion [m] that an acceleration means above `MIN_SWING_FREQUENCY`, root mean square."""
    values = record[channel]
    known = np.isfinite(values)
    distance = np.abs(values - np.median(values[known]))
    scale = 1.4826 * float(np.median(distance[known]))
    known &= (distance <= MAX_SWING_SIGMAS * scale) | (scale == 0.0)
    filled = np.interp(record.time, record.time[known], values[known])
    power = np.abs(np.fft.rfft((filled - filled.mean()) * np.hanning(len(filled)))) ** 2
    frequency = np.arange(len(power)) * record.rate / len(filled)
    above = frequency > max(MIN_SWING_FREQUENCY, 3.0 * record.rate / len(filled))
    total = np.sum(power[above] / (_TURN * frequency[above]) ** 4)
    return float(np.sqrt(2.0 * total / (0.375 * len(filled) ** 2)))


def _acceleration(record: Record, channel: str, x: Array, rotor: Rotor | None) -> list[Fault]:
    mean, rms = float(np.mean(x)), float(np.std(x))
    for factor, mistake in _GRAVITIES:
        if abs(abs(mean) / (GRAVITY * factor) - 1.0) < 0.03 and rms < 0.5 * GRAVITY * factor:
            return [_unit(channel, "gravity in another unit", mean=mean, mistake=mistake)]
    if abs(abs(mean) - GRAVITY) < 0.3:
        return [Fault(channel, "gravity", "note", x.size, data={"mean": mean})]
    if body_of(channel) == "structure" and (shaken := _shaken(record, channel, rms)):
        return shaken
    on_blade = channel.startswith("blade") and "kinematic" not in channel
    return _gravity_once_per_turn(record, channel, rms, rotor) if on_blade and rotor is not None else []


def _shaken(record: Record, channel: str, rms: float) -> list[Fault]:
    """A wrong unit of an accelerometer on a structure, by its size."""
    if rms > 10.0 * GRAVITY and channel.startswith(("tower", "nacelle", "hub", "foundation")):
        return [_unit(channel, "no support so shaken", rms=rms, gravities=rms / GRAVITY)]
    swing = _swing(record, channel)
    return [_unit(channel, "no structure swings so far", rms=rms, swing=swing)] if swing > MAX_SWING else []


def _tilts(record: Record, known: Iterable[str]) -> list[Fault]:
    """Axes next to one that reads gravity whose mean is a part of it: by that they are tilted."""
    mean = {name: float(np.nanmean(record[name])) for name in known if _axis_of(name)[2].startswith("acceleration")}
    found = []
    for one, other in itertools.permutations(mean, 2):
        same_point = _axis_of(one)[::2] == _axis_of(other)[::2]
        tilt = math.degrees(math.atan2(abs(mean[one]), abs(mean[other])))
        whole = abs(math.hypot(mean[one], mean[other]) / GRAVITY - 1.0) < MAX_GRAVITY_DIFFERENCE
        if same_point and whole and MIN_TILT_DEGREES < tilt < HALF_QUARTER_TURN:
            data = {"mean": mean[one], "degrees": tilt, "upright": other}
            found.append(Fault(one, "tilt", "note", record.samples, data=data))
    return found


def _yawed_axes(record: Record, known: Iterable[str]) -> list[Fault]:
    """Sensors below the yaw bearing, which keep the axes of the tower while the nacelle is yawed; OpenFAST's are known
    to."""
    axes = [name for name in known if _axis_of(name)[:2] in (("tower", "x"), ("tower", "z"))]
    if record.attributes.get("source") != "OpenFAST" or "nacelle_yaw" not in record or not axes:
        return []
    across, along = (float(np.nanmean(np.abs(part(record["nacelle_yaw"])))) for part in (np.sin, np.cos))
    angle = math.degrees(math.atan2(across, along))
    if not angle > MIN_YAW_DEGREES:
        return []
    severity: Severity = "warning" if angle > HALF_QUARTER_TURN else "note"
    data = {"degrees": angle, "channels": ", ".join(axes[:4])}
    return [Fault("nacelle_yaw", "yawed axes", severity, record.samples, data=data)]


def _axis_of(channel: str) -> tuple[str, str, str]:
    """Point, axis and quantity of a channel, such as ``tower_x_acceleration``; empty for others."""
    match = _AXIS.fullmatch(channel)
    return (match[1], match[2], match[3]) if match else ("", "", "")


def _gravity_once_per_turn(record: Record, channel: str, rms: float, rotor: Rotor) -> list[Fault]:
    """A wrong unit of an accelerometer on a blade, by its amplitude at 1P."""
    if not rotor.turns:
        return []
    amplitude = once_per_turn(record, record[channel], rotor)
    for factor, mistake in _GRAVITIES:
        if abs(amplitude / (GRAVITY * factor) - 1.0) < 0.05 and amplitude > 1.2 * rms:
            return [_unit(channel, "gravity once per turn", amplitude=amplitude, mistake=mistake)]
    return []


def once_per_turn(record: Record, values: Array, rotor: Rotor) -> float:
    """Amplitude of a channel at 1P, from the angle that the rotor turned."""
    ok = np.isfinite(values)
    psi = np.concatenate([[0.0], np.cumsum(0.5 * (rotor.speed[1:] + rotor.speed[:-1]) * np.diff(record.time))])
    return float(2.0 * np.abs(np.mean((values[ok] - values[ok].mean()) * np.exp(-1j * psi[ok]))))


def _angle(channel: str, kind: Kind, x: Array) -> list[Fault]:
    span, largest = float(np.ptp(x)), float(np.abs(x).max())
    drops = np.abs(np.diff(x))
    wraps = drops[drops > 0.5 * span] if span > 0.0 else drops[:0]
    size = float(np.median(wraps)) if wraps.size else 0.0
    if _is_in_degrees(kind, size, span, largest):
        if not size:
            return [_unit(channel, "angle too large", largest=largest)]
        return [_unit(channel, "wraps elsewhere", at=360, mistake="degrees marked as rad")]
    if kind == "azimuth" and wraps.size >= 3 and 0.8 < size < 1.05 and span < 1.05:
        return [_unit(channel, "wraps elsewhere", at=1, mistake="turns marked as rad")]
    return []


def _is_in_degrees(kind: Kind, wrap: float, span: float, largest: float) -> bool:
    """Test whether an angle is in degrees, by the median size of its wraps, its span and its largest value."""
    if 300.0 < wrap < 361.0 and span < 361.0:
        return True
    if kind in ("direction", "yaw"):
        return 2.0 * _TURN < largest <= 361.0
    return kind == "pitch" and largest > _TURN


def _rotor_speed(record: Record, turbine: "Turbine | None") -> list[Fault]:
    usual = float(np.nanmedian(record["rotor_speed"]))
    if "rotor_azimuth" in record and _azimuth_speed(record) is not None:
        return []  # the azimuth tells more, see below
    if turbine is not None and turbine.rotor_speed > 0.0 and usual != 0.0:
        return _against_usual_speed(usual, turbine)
    rpm = usual * 60.0 / _TURN
    if abs(usual) > 30.0:
        return [_unit("rotor_speed", "fast rotor", speed=usual, rpm=rpm)]
    if abs(usual) > MAX_ROTOR_SPEED:
        return [_unit("rotor_speed", "small rotor", "note", speed=usual, rpm=rpm)]
    return []


def _against_usual_speed(speed: float, turbine: "Turbine") -> list[Fault]:
    """A wrong unit of a rotor speed, by that of the turbine file: a machine may run away, but hardly this far."""
    ratio = abs(speed) / turbine.rotor_speed
    for factor, mistake in _RATIOS[:3]:
        if abs(np.log(ratio / factor)) < 0.35 and abs(np.log(ratio)) > 1.0:
            severity: Severity = "warning" if factor > 1.0 else "note"  # an idling rotor is slow too
            speeds = {"speed": speed, "usual": turbine.rotor_speed, "turbine": turbine.name}
            return [_unit("rotor_speed", "another usual speed", severity, **speeds, mistake=mistake)]
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
    if not np.std(off) > MAX_SCATTER:
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


def _unit(channel: str, evidence: str, severity: Severity = "warning", **data: Any) -> Fault:
    return Fault(channel, "unit", severity, 0, data={"evidence": evidence, **data})


def _contradiction(**data: Any) -> Fault:
    return Fault("rotor_azimuth", "contradiction", "warning", 0, data=data)

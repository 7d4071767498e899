"""Units that cannot be right, and axes that are tilted or turned."""

import itertools
import math
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.inspection.bodies import body_of
from windsysid.inspection.channels import Kind, is_position
from windsysid.inspection.fault import Fault, Severity, unit_fault
from windsysid.inspection.limits import (
    MAX_ACCELERATION_RATE,
    MAX_FAULT_SHARE,
    MAX_MOTION_RMS,
    MIN_ACCELERATION_RATE,
)
from windsysid.inspection.rotor import Rotor, once_per_turn, rotor_faults
from windsysid.records.record import Record

if TYPE_CHECKING:
    from windsysid.turbine.turbine import Turbine

__all__ = ["GRAVITY", "TIME", "implausible"]


GRAVITY = 9.80665
"""Setting: standard acceleration of gravity [m/s²]."""
TIME = "time"
"""Subject of findings on the time's unit."""
_TURN = math.tau


_GRAVITIES = (
    (1.0 / GRAVITY, "g marked as m/s²"),
    (1e3 / GRAVITY, "mg marked as m/s²"),
    (1e3, "mm/s² marked as m/s²"),
    (GRAVITY, "m/s² marked as g"),
)
"""Setting: gravity in a wrong unit over 9.81 m/s², and the mistake that makes it."""


_AXIS = re.compile(r"(.+)_([xyz])_((?:acceleration|velocity|displacement)(?:_kinematic)?)")

MIN_EXCHANGE_DEGREES = 45.0
"""Setting: angle [deg] from which on an axis is nearer to the other one."""

MAX_GRAVITY_DIFFERENCE = 0.01
"""Setting: relative difference from gravity of the means of two axes that share it; calibrations are as good."""

MIN_MOTION_HZ = 0.1
"""Setting: frequency [Hz] above which the motion is computed that an acceleration means."""

MAX_MOTION_SIGMAS = 20.0
"""Setting: distance from the median, in robust standard deviations, beyond which readings are codes or spikes and no
motion."""

MIN_TILT_DEGREES = 1.0
"""Setting: smallest tilt of an axis that is reported; rotors are tilted by 4 to 8°, towers lean by less."""

MIN_YAW_DEGREES = 10.0
"""Setting: smallest yaw that is reported where sensors do not yaw: each axis shows 17 % of the other's motion."""


def implausible(record: Record, known: dict[str, Kind], rotor: Rotor | None, turbine: "Turbine | None") -> list[Fault]:
    """Faults of units and contradictions over all channels (`known`: those that are usable, with their kinds)."""
    found = _pace(record) if "acceleration" in known.values() else []
    for channel, kind in known.items():
        found += _wrong_unit(record, channel, kind, rotor)
    found += [*_tilts(record, known), *_yawed_axes(record, known)]
    if not any(one.data.get("evidence") == "gravity in another unit" for one in found):
        found += _tilted(record, [channel for channel, kind in known.items() if kind == "acceleration"])
    return [*found, *rotor_faults(record, known, turbine)]


def _wrong_unit(record: Record, channel: str, kind: Kind, rotor: Rotor | None) -> list[Fault]:
    """A unit that the values of a channel contradict."""
    values, unit = record[channel], record.unit(channel)
    if kind == "acceleration" and unit == "m/s^2":
        return _acceleration(record, channel, _without_codes(values), rotor)
    x = values[np.isfinite(values)]
    if kind == "displacement" and unit == "m":
        large = np.std(x) > 10.0 and not is_position(channel)
        return [unit_fault(channel, "no deflection so large", rms=float(np.std(x)))] if large else []
    if unit == "rad":
        return _angle(channel, kind, x)
    if kind == "wind speed" and np.mean(x) > 40.0:
        return [unit_fault(channel, "no wind so strong", mean=float(np.mean(x)))]
    return []


def _pace(record: Record) -> list[Fault]:
    """Test whether accelerations come so seldom that the time was in milliseconds, or so often that it was in days."""
    step = 1.0 / record.rate
    if record.rate < MIN_ACCELERATION_RATE:
        return [unit_fault(TIME, "no structure so slow", step=step)]
    slow = np.array_equal(record.time, np.round(record.time))  # milliseconds that are taken for seconds
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
                found.append(unit_fault(place, "gravity of three axes", mean=size, mistake=mistake))
    return found


def _by_place(channels: Sequence[str]) -> dict[str, list[str]]:
    """Channels whose names differ in the axis x, y or z only."""
    places: dict[str, list[str]] = {}
    for channel in channels:
        axis = re.search(r"(?:^|_|\b|(?<=[a-z]))[xyzXYZ](?=$|_|\b)", channel)
        if axis is not None:
            places.setdefault(channel[: axis.end() - 1] + "*" + channel[axis.end() :], []).append(channel)
    return places


def _is_usual(values: Array) -> NDArray[np.bool_]:
    """Mask of the `values` (T,) that are neither missing nor spikes or codes far from all others."""
    distance = np.abs(values - np.nanmedian(values))
    scale = 1.4826 * float(np.nanmedian(distance))
    return np.isfinite(values) & ((distance <= MAX_MOTION_SIGMAS * scale) | (scale == 0.0))


def _without_codes(values: Array) -> Array:
    """`values` (T,), NaN where they are spikes or codes; as they are where so many are far away that this is motion."""
    far = np.isfinite(values) & ~_is_usual(values)
    return values if np.mean(far) > MAX_FAULT_SHARE else np.where(far, np.nan, values)


def _swing(record: Record, channel: str) -> float:
    """Motion [m] that an acceleration means above `MIN_MOTION_HZ`, root mean square."""
    usual = _is_usual(record[channel])
    filled = np.interp(record.time, record.time[usual], record[channel][usual])
    power = np.abs(np.fft.rfft((filled - filled.mean()) * np.hanning(len(filled)))) ** 2
    frequency = np.arange(len(power)) * record.rate / len(filled)
    above = frequency > max(MIN_MOTION_HZ, 3.0 * record.rate / len(filled))
    total = np.sum(power[above] / (_TURN * frequency[above]) ** 4)
    return float(np.sqrt(2.0 * total / (0.375 * len(filled) ** 2)))


def _acceleration(record: Record, channel: str, values: Array, rotor: Rotor | None) -> list[Fault]:
    mean, rms = float(np.nanmean(values)), float(np.nanstd(values))
    for factor, mistake in _GRAVITIES:
        if abs(abs(mean) / (GRAVITY * factor) - 1.0) < 0.03 and rms < 0.5 * GRAVITY * factor:
            return [unit_fault(channel, "gravity in another unit", mean=mean, mistake=mistake)]
    if abs(abs(mean) - GRAVITY) < 0.3:
        return [Fault(channel, "gravity", "note", int(np.isfinite(values).sum()), data={"mean": mean})]
    if body_of(channel) == "structure" and (shaken := _shaken(record, channel, rms)):
        return shaken
    on_blade = channel.startswith("blade") and "kinematic" not in channel
    return _gravity_once_per_turn(record, channel, values, rotor) if on_blade and rotor is not None else []


def _shaken(record: Record, channel: str, rms: float) -> list[Fault]:
    """A wrong unit of an accelerometer on a structure, by its size."""
    if rms > 10.0 * GRAVITY and channel.startswith(("tower", "nacelle", "hub", "foundation")):
        return [unit_fault(channel, "no support so shaken", rms=rms, gravities=rms / GRAVITY)]
    swing = _swing(record, channel)
    return [unit_fault(channel, "no structure swings so far", rms=rms, swing=swing)] if swing > MAX_MOTION_RMS else []


def _tilts(record: Record, known: Iterable[str]) -> list[Fault]:
    """Axes next to one that reads gravity whose mean is a part of it: by that they are tilted."""
    mean = {name: float(np.nanmean(record[name])) for name in known if _axis_of(name)[2].startswith("acceleration")}
    found = []
    for one, other in itertools.permutations(mean, 2):
        same_point = _axis_of(one)[::2] == _axis_of(other)[::2]
        tilt = math.degrees(math.atan2(abs(mean[one]), abs(mean[other])))
        whole = abs(math.hypot(mean[one], mean[other]) / GRAVITY - 1.0) < MAX_GRAVITY_DIFFERENCE
        if same_point and whole and MIN_TILT_DEGREES < tilt < MIN_EXCHANGE_DEGREES:
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
    severity: Severity = "warning" if angle > MIN_EXCHANGE_DEGREES else "note"
    data = {"degrees": angle, "channels": ", ".join(axes[:4])}
    return [Fault("nacelle_yaw", "yawed axes", severity, record.samples, data=data)]


def _axis_of(channel: str) -> tuple[str, str, str]:
    """Point, axis and quantity of a channel, such as ``tower_x_acceleration``; empty for others."""
    match = _AXIS.fullmatch(channel)
    return (match[1], match[2], match[3]) if match else ("", "", "")


def _gravity_once_per_turn(record: Record, channel: str, values: Array, rotor: Rotor) -> list[Fault]:
    """A wrong unit of an accelerometer on a blade, by its amplitude at 1P."""
    if not rotor.turns:
        return []
    amplitude, rms = once_per_turn(record, values, rotor), float(np.nanstd(values))
    for factor, mistake in _GRAVITIES:
        if abs(amplitude / (GRAVITY * factor) - 1.0) < 0.05 and amplitude > 1.2 * rms:
            return [unit_fault(channel, "gravity once per turn", amplitude=amplitude, mistake=mistake)]
    return []


def _angle(channel: str, kind: Kind, x: Array) -> list[Fault]:
    span, largest = float(np.ptp(x)), float(np.abs(x).max())
    drops = np.abs(np.diff(x))
    wraps = drops[drops > 0.5 * span] if span > 0.0 else drops[:0]
    size = float(np.median(wraps)) if wraps.size else 0.0
    if _is_in_degrees(kind, size, span, largest):
        if not size:
            return [unit_fault(channel, "angle too large", largest=largest)]
        return [unit_fault(channel, "wraps elsewhere", at=360, mistake="degrees marked as rad")]
    if kind == "azimuth" and wraps.size >= 3 and 0.8 < size < 1.05 and span < 1.05:
        return [unit_fault(channel, "wraps elsewhere", at=1, mistake="turns marked as rad")]
    return []


def _is_in_degrees(kind: Kind, wrap: float, span: float, largest: float) -> bool:
    """Test whether an angle is in degrees, by the median size of its wraps, its span and its largest value."""
    if 300.0 < wrap < 361.0 and span < 361.0:
        return True
    if kind in ("direction", "yaw"):
        return 2.0 * _TURN < largest <= 361.0
    return kind == "pitch" and largest > _TURN

"""Conditioned readings of a record: without rotor harmonics and sinusoids, blades in multi-blade coordinates."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.checks.limits import HARMONIC_HALF_WIDTH_SHARE
from windsysid.errors import RecordError
from windsysid.inspection.faults.health import sampled_every
from windsysid.inspection.limits import MIN_ROTOR_SPEED
from windsysid.inspection.rotor import rotor_of
from windsysid.inspection.stationarity import energy_share, transient_text
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import LOW_PASS, Record
from windsysid.spectral.oma import limits
from windsysid.spectral.oma.samples import Samples, choose_samples
from windsysid.spectral.oma.sensors import ModalSensor, derivative_order
from windsysid.spectral.transforms.dft import transform
from windsysid.spectral.transforms.harmonics import find_lines, without_harmonics, without_line
from windsysid.spectral.transforms.multiblade import BladeSet, blade_sets, multiblade

__all__ = ["Readings", "RemovedLine", "prepare_readings", "transforms"]


class RemovedLine(NamedTuple):
    """A rotor harmonic or another sinusoid that was removed: its name, frequency and half-width [Hz], and the order of
    a harmonic, 0 for others."""

    name: str
    frequency: float
    half_width: float
    order: int = 0


class Readings(NamedTuple):
    """Readings that are analysed.

    Attributes
    ----------
    names, units, sensors
        Of the channels (n,): those of the record, then multi-blade coordinates; a sensor each, None for coordinates.
    orders
        Order of the time derivative that each reads (n,): 2 for accelerations.
    fixed, turning
        Values (T, n_f) real and (T, n_t) complex, z of each set of blades: its forward and backward parts are the last
        2 n_t channels.
    rate
        [Hz].
    low, high
        Frequency range of the modes [Hz].
    lines
        Rotor harmonics and other sinusoids that were removed.
    rotor_hz
        Turns per second; 0 where there is no rotor or it stands.
    notes, doubts
        Changes that a reader must know; reasons why the whole record is doubtful.
    used
        The record, or the section of it, that the readings come from.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    sensors: tuple[ModalSensor | None, ...]
    orders: tuple[int, ...]
    fixed: Array
    turning: Complex
    rate: float
    low: float
    high: float
    lines: tuple[RemovedLine, ...]
    rotor_hz: float
    notes: tuple[str, ...]
    doubts: tuple[str, ...]
    used: Record

    @property
    def samples(self) -> int:
        """T."""
        return len(self.fixed)


class _Rotation(NamedTuple):
    """Motion of the rotor: unwrapped azimuth (T,) [rad], turns per second, harmonics, and doubts about its speed."""

    azimuth: Array | None = None
    frequency: float = 0.0
    harmonics: tuple[RemovedLine, ...] = ()
    doubts: tuple[str, ...] = ()


class _Frames(NamedTuple):
    """Columns of channels in the fixed frame, sets of rotating blades, and notes on channels that are left out."""

    fixed: list[int]
    sets: list[BladeSet]
    notes: list[str]


def prepare_readings(record: Record, sensors: Sequence[Sensor | ModalSensor | str] | None) -> Readings:
    """Choose channels, check them, bridge gaps, remove sinusoids, and transform blades into the fixed frame.

    Raises
    ------
    ConfigurationError, RecordError
        If channels are missing, dead or copies of each other, or the record is too short.
    """
    samples = choose_samples(record, sensors)
    used, low = samples.record, limits.MIN_CYCLES / samples.record.duration
    high, high_notes = _highest_frequency(samples)
    rotation = _rotation_of(used, high)
    values = samples.values - samples.values.mean(axis=0)
    values = _without_rotor_harmonics(values, used.rate, rotation)
    values, sinusoids = _without_sinusoids(values, used.rate, rotation, (low, high))
    frames = _frames_of([sensor.channel for sensor in samples.sensors], rotation)
    if not frames.fixed and not frames.sets:
        raise RecordError(
            f"{used.name}: no channel is left: record rotor_azimuth and a sensor on every blade, or one on the tower"
        )
    fixed, turning = _in_fixed_frame(values, rotation.azimuth, frames)
    channels = _channels_of(samples.sensors, frames)
    coordinates = [None] * (len(channels) - len(frames.fixed))
    return Readings(
        names=tuple(name for name, _ in channels),
        units=tuple(used.unit(sensor.channel) for _, sensor in channels),
        sensors=(*(samples.sensors[i] for i in frames.fixed), *coordinates),
        orders=tuple(derivative_order(sensor, used) for _, sensor in channels),
        fixed=fixed,
        turning=turning,
        rate=used.rate,
        low=low,
        high=high,
        lines=(*rotation.harmonics, *sinusoids),
        rotor_hz=rotation.frequency,
        notes=(*samples.notes, *high_notes, *_sinusoid_notes(sinusoids), *frames.notes),
        doubts=(*samples.doubts, *rotation.doubts, *_transient_doubts(values)),
        used=used,
    )


def transforms(readings: Readings, part: slice = slice(None)) -> tuple[Array, Complex]:
    """Frequencies (F,) [Hz] and transforms (F, n) of a part of the record, all as accelerations."""
    frequency, fixed = transform(readings.fixed[part], readings.rate)
    both = []
    for column in range(readings.turning.shape[1]):
        z = readings.turning[part, column]
        both.append(transform(np.column_stack([z, z.conj()]), readings.rate)[1])
    n = min(len(fixed), *(len(each) for each in both)) if both else len(fixed)
    found = np.hstack([fixed[:n], *(each[:n] for each in both)])
    derived: NDArray[np.int64] = 2 - np.array(readings.orders)
    return frequency[:n], found * (2j * np.pi * frequency[:n, None]) ** derived[None]


def _highest_frequency(samples: Samples) -> tuple[float, list[str]]:
    """Highest frequency of modes [Hz], by the sampling rate, the record's low-pass and the slowest channel; notes."""
    record = samples.record
    high = limits.MAX_FREQUENCY_SHARE * record.rate
    if LOW_PASS in record.attributes:
        high = min(high, 2.0 * limits.MAX_FREQUENCY_SHARE * float(record.attributes[LOW_PASS]))
    channels = zip(samples.values.T, samples.sensors, strict=True)
    every, slowest = max((sampled_every(column)[0], sensor.channel) for column, sensor in channels)
    slow_high = limits.MAX_FREQUENCY_SHARE * record.rate / every
    if every <= 1 or slow_high >= high:
        return high, []
    read = f"{record.rate / every:.4g} times a second and filled in between"
    return slow_high, [f"{slowest} was read {read}: modes are searched below {slow_high:.4g} Hz"]


def _rotation_of(record: Record, high: float) -> _Rotation:
    """Motion of the rotor, with its harmonics up to a frequency [Hz]."""
    rotor = rotor_of(record)
    if rotor is None or abs(rotor.mean) <= MIN_ROTOR_SPEED:
        return _Rotation()
    once = abs(rotor.mean) / (2.0 * np.pi)
    width = 1.5 / record.duration
    harmonics = (
        RemovedLine(f"{n}P", n * once, width + n * once * min(rotor.variation, 0.2 / n), n)
        for n in range(1, int(min(high / once, 60)) + 1)
    )
    doubts = (
        f"the rotor speed varies by {100 * rotor.variation:.1f} %: harmonics and whirls are smeared; choose a "
        f"steadier section",
    )
    smeared = rotor.variation > HARMONIC_HALF_WIDTH_SHARE
    return _Rotation(_unwrapped_azimuth(record, rotor.mean), once, tuple(harmonics), doubts if smeared else ())


def _unwrapped_azimuth(record: Record, speed: float) -> Array | None:
    """Azimuth (T,) [rad] of a rotor with a mean speed [rad/s]; None without its channel, RecordError if it jumps."""
    if "rotor_azimuth" not in record:
        return None
    psi = record["rotor_azimuth"]
    known = np.isfinite(psi)
    if not known.all():
        psi = np.interp(np.arange(len(psi)), np.flatnonzero(known), np.unwrap(psi[known]))
    azimuth = np.unwrap(psi)
    turns = np.diff(azimuth) * np.sign(speed)
    if np.any(turns < -0.05) or np.any(np.abs(turns - np.median(turns)) > 0.5 + np.median(turns)):
        raise RecordError(
            f"{record.name}: rotor_azimuth jumps: choose a section where it turns steadily, or leave the channel out"
        )
    return azimuth


def _without_rotor_harmonics(values: Array, rate: float, rotation: _Rotation) -> Array:
    """Remove rotor harmonics from values (T, n), by the azimuth if it is known."""
    if rotation.azimuth is not None:
        return without_harmonics(values, rotation.azimuth)
    for line in rotation.harmonics:
        values = without_line(values, rate, line.frequency)
    return values


def _without_sinusoids(
    values: Array, rate: float, rotation: _Rotation, between: tuple[float, float]
) -> tuple[Array, list[RemovedLine]]:
    """Remove sinusoids between two frequencies [Hz] that are no rotor harmonics from values (T, n)."""
    sinusoids = [
        RemovedLine("line", f, 2.0 * rate / len(values))
        for f in find_lines(values, rate, *between)
        if all(abs(f - line.frequency) > 2.0 * line.half_width for line in rotation.harmonics)
    ]
    for line in sinusoids:
        values = without_line(values, rate, line.frequency)
    return values, sinusoids


def _sinusoid_notes(sinusoids: Sequence[RemovedLine]) -> list[str]:
    if not sinusoids:
        return []
    listed = ", ".join(f"{line.frequency:.4g}" for line in sinusoids[:8]) + (" …" if len(sinusoids) > 8 else "")
    return [f"sinusoids were removed at {listed} Hz: random loads do not cause them"]


def _frames_of(names: list[str], rotation: _Rotation) -> _Frames:
    """Divide channels between the fixed frame and sets of rotating blades."""
    if rotation.frequency <= 0.0:
        return _Frames(list(range(len(names))), [], [])
    sets, incomplete = blade_sets(names)
    turning = {*incomplete, *(column for one in sets for column in one.columns)}
    fixed = [i for i in range(len(names)) if i not in turning]
    if turning and rotation.azimuth is None:
        note = "rotor_azimuth is missing: the blades' channels are left out, since their frequencies are shifted"
        return _Frames(fixed, [], [f"{note} by the rotation"])
    listed = ", ".join(names[i] for i in incomplete)
    note = f"left out: {listed}: multi-blade coordinates need every blade's sensor"
    return _Frames(fixed, sets, [note] if incomplete else [])


def _in_fixed_frame(values: Array, azimuth: Array | None, frames: _Frames) -> tuple[Array, Complex]:
    """Values (T, n_f) of the fixed channels and the blades' means, and z (T, n_t) of each set of blades."""
    fixed, turning = [values[:, i] for i in frames.fixed], [np.empty((len(values), 0), dtype=np.complex128)]
    for one in frames.sets:
        assert azimuth is not None
        mean, z = multiblade(values[:, list(one.columns)], azimuth)
        fixed.append(mean)
        turning.append(z)
    return np.column_stack(fixed), np.column_stack(turning)


def _channels_of(sensors: Sequence[ModalSensor], frames: _Frames) -> list[tuple[str, ModalSensor]]:
    """Name of each channel of `Readings`, and a sensor that has its unit."""
    channels = [(sensors[i].channel, sensors[i]) for i in frames.fixed]
    blades = [(f"blades_{one.what}", sensors[one.columns[0]]) for one in frames.sets]
    channels += [(f"{name} collective", sensor) for name, sensor in blades]
    return channels + [(f"{name} {way}", sensor) for name, sensor in blades for way in ("forward", "backward")]


def _transient_doubts(values: Array) -> list[str]:
    """Doubt a record with most of the vibration of half the channels in one eighth of it."""
    parts = np.array_split(np.diff(values, axis=0), 8)
    text = transient_text(float(energy_share(np.array([np.sum(part**2, axis=0) for part in parts]))))
    return [f"the record is a transient: {text}; choose a section without it, or --decay for a free decay"] * bool(text)

"""From a record to what the filters read: sensors, rate, added noise."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError, RecordError
from windsysid.filters import Info
from windsysid.identification.limits import MAX_RADIANS_PER_READING
from windsysid.identification.model.fit import PART_OF, Outcome
from windsysid.inspection.channels import VIBRATION, kinds
from windsysid.inspection.fault import Fault
from windsysid.inspection.limits import MIN_SAMPLES
from windsysid.inspection.screening import read_besides, screen
from windsysid.mechanics.sensors import Sensor
from windsysid.records.kept import kept_with_record
from windsysid.records.record import Record
from windsysid.results.estimate import Loads
from windsysid.results.finding import Finding
from windsysid.signals import resample
from windsysid.signals.azimuth import steadied
from windsysid.turbine.turbine import Turbine

__all__ = [
    "add_noise", "check_length", "check_readings", "choose_rate", "note_rate", "note_steps", "refine",
    "resample_for_model", "screened", "slow_down", "steps_per_reading", "thin_to_readings", "usable_sensors",
    "with_noise", "without_faulty",
]  # fmt: skip

MAX_RADIANS_PER_UNREFINED_STEP = 0.6
"""Tolerance: of the integration where the equations cannot take shorter steps than readings: the longest time between
them [rad], at which the Runge–Kutta method adds 0.1 % of damping."""

TAKEN_AS_MISSING = frozenset({"clipping", "frozen", "silent", "spikes"})
"""Kinds of faults whose readings are left out."""

MAX_STEP_RADIANS = 0.31
"""Numerical: longest step of the equations, times the highest natural frequency [rad].

The Runge–Kutta method is fast by a share (ωh)⁴/60 of a mode's stiffness: 0.015 %, a tenth of the standard deviation
that ten minutes leave of a mode with 1 % damping at some hertz.
"""


MIN_RESAMPLED_SAMPLES = 8_000
"""Setting: least number of samples after resampling to the rate that the equations need, which is done if it at least
halves their number: for a rotor with 23 states one evaluation of their likelihood takes 0.8 s (two cores, 2026)."""


def add_noise(record: Record, channels: Sequence[str], percent: float, seed: int) -> tuple[Record, dict[str, float]]:
    """White noise of `percent` of each channel's standard deviation added to it; returns the noise rms per channel too.

    Parameters
    ----------
    record
        Left as it is.
    channels
        To which noise is added.
    percent
        Of each channel's standard deviation [%].
    seed
        The same seed gives the same noise.

    Returns
    -------
    Record, dict
        The noisy record, and the standard deviation of the noise of each channel, in the channel's unit.

    Raises
    ------
    ConfigurationError
        If `percent` is negative or not finite.
    """
    if not (math.isfinite(percent) and 0.0 <= percent <= 1000.0):
        raise ConfigurationError(f"added noise: expected a percentage between 0 and 1000, got {percent:g}")
    rng = np.random.default_rng(seed)
    added: dict[str, float] = {}
    changed: dict[str, tuple[Array, str]] = {}
    for channel in channels:
        values = record[channel]
        added[channel] = percent / 100.0 * float(np.nanstd(values))
        noisy = values + added[channel] * rng.standard_normal(len(values))
        changed[channel] = (noisy, record.units[record.channels.index(channel)])
    return record.with_channels(changed), added


def with_noise(sensors: Sequence[Sensor], added: Mapping[str, float]) -> tuple[Sensor, ...]:
    """Sensors with the added noise included in their own."""
    return tuple(
        sensor.model_copy(update={"noise": math.hypot(sensor.noise, added.get(sensor.channel, 0.0))})
        for sensor in sensors
    )


def usable_sensors(record: Record, turbine: Turbine, sensors: Sequence[Sensor] | None) -> tuple[Sensor, ...]:
    """The sensors given, all of which the record must hold, or those of the turbine's usual ones that it does hold."""
    if sensors is not None and not sensors:
        raise ConfigurationError(
            "the sensor list is empty: expected at least one sensor; leave it out for the usual ones"
        )
    found = _recorded_sensors(record, turbine) if sensors is None else tuple(sensors)
    for sensor in found:
        _check_channel(record, sensor)
    for name in turbine.model.loads:
        expected = turbine.model.freedom(name).load_unit
        for channel in (name, PART_OF + name):
            if channel in record and record.unit(channel) != expected:
                raise RecordError(
                    f"channel '{channel}': expected {expected}, got {record.unit(channel)}: correct its unit"
                )
    return found


def _recorded_sensors(record: Record, turbine: Turbine) -> tuple[Sensor, ...]:
    """The turbine's usual sensors that a record holds; RecordError where it holds none."""
    found = tuple(sensor for sensor in turbine.sensors if sensor.channel in record)
    if not found:
        wanted = ", ".join(sensor.channel for sensor in turbine.sensors)
        raise RecordError(
            f"{record.name}: expected one of the channels {wanted}; got {', '.join(record.channels)}; "
            "rename them with mapping= (by windsysid start), or list your own with sensors="
        )
    return found


def _check_channel(record: Record, sensor: Sensor) -> None:
    """RecordError where the channel of a sensor has another unit or no numbers."""
    values = record[sensor.channel]
    unit = record.units[record.channels.index(sensor.channel)]
    if not sensor.accepts(unit):
        raise RecordError(
            f"channel '{sensor.channel}': expected {sensor.unit} for {sensor.quantity}, got {unit}: correct the "
            f"unit or the sensor"
        )
    if not np.isfinite(values).any():
        raise RecordError(
            f"channel '{sensor.channel}' holds no numbers in this section: leave it out of the sensor list, "
            "or choose another section"
        )


def screened(record: Record, turbine: Turbine, sensors: Sequence[Sensor], *, refuse: bool = True) -> list[Fault]:
    """Faults of the channels that the joint formulation reads (`windsysid.inspection.screening`); RecordError
    where it makes estimates wrong."""
    return screen(
        record, turbine, [sensor.channel for sensor in sensors],
        others=read_besides(record, turbine),
        offsets={sensor.channel: sensor.bias for sensor in sensors},
        refuse=refuse,
    )  # fmt: skip


def without_faulty(record: Record, faults: Sequence[Fault]) -> tuple[Record, list[Fault]]:
    """The record with readings missing where a channel is clipped, repeats one value, falls silent or has a spike, and
    its faults, of which those are marked as treated."""
    told, held, half = [], dict[str, tuple[Array, str]](), 0.5 / record.rate
    for fault in faults:
        if (
            fault.kind in TAKEN_AS_MISSING
            and fault.severity != "note"
            and kinds(record).get(fault.channel) in VIBRATION
        ):
            wrong = np.zeros(record.samples, dtype=np.bool_)
            for first, last in fault.spans:  # time stamps may scatter about the record's times
                wrong |= (record.time > first - half) & (record.time < last + half)
            readings = held[fault.channel][0] if fault.channel in held else record[fault.channel]
            held[fault.channel] = np.where(wrong, np.nan, readings), record.unit(fault.channel)
            told.append(replace(fault, treated_as_missing=True))
        else:
            told.append(fault)
    return (record.with_channels(held) if held else record), told


def resample_for_model(
    record: Record, turbine: Turbine, rate: float | None, sensors: Sequence[Sensor]
) -> tuple[Record, int, tuple[Finding, ...]]:
    """The record at a lower rate, where one is requested or the turbine's model has no faster modes;
    samples per reading, and a note.

    Where the equations need shorter steps than a reading takes, sensors are missing between their readings and all else
    is as the fine grid has it.
    """
    read = tuple(sensor.channel for sensor in sensors)
    slow = choose_rate(record.rate, record.duration, turbine, rate)
    needed = MIN_SAMPLES / (slow or record.rate)
    if record.duration < needed - 1.0 / record.rate:
        raise RecordError(
            f"{record.name}: {record.samples} samples in {record.duration:.3g} s are too few: expected at least"
            f" {math.ceil(needed * record.rate)} at {record.rate:.4g} Hz ({needed:.3g} s); give a longer record"
        )
    steps = steps_per_reading(turbine, slow or record.rate) if slow or record.is_uniform else 1
    if slow is None:
        check_readings(record.name, record.rate, turbine)
        return (record, 1, ()) if steps == 1 else (refine(record, read, steps), steps, (note_steps(steps),))
    return slow_down(record, read, slow, steps), steps, note_rate(record.rate, slow, steps, turbine)


def choose_rate(recorded: float, duration: float, turbine: Turbine, rate: float | None) -> float | None:
    """Readings per second [Hz] for a record of `duration` seconds at the rate `recorded`; None to take it as it is.

    Raises
    ------
    ConfigurationError
        If the rate that is requested takes every mode out of the record, or leaves next to no readings.
    """
    asked = rate is not None
    if rate is None:
        rate = _usual_rate(recorded, duration, turbine)
    elif not 0.0 < rate <= 1.001 * recorded:
        raise ConfigurationError(f"rate: expected more than 0 and at most the record's {recorded:.4g} Hz, got {rate:g}")
    if rate is None or rate > 0.95 * recorded:
        return None
    if asked:  # of a record too short for a rate that was not requested, its length is what is wrong
        _check_rate(duration, turbine, rate)
    return rate


def _usual_rate(recorded: float, duration: float, turbine: Turbine) -> float | None:
    """Readings per second [Hz] if none is given; None for the sampling rate of the record."""
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates)
    if turbine.model.samples_per_period is not None:
        return min(turbine.model.samples_per_period * fastest / (2.0 * math.pi), recorded)
    least = max(fastest / MAX_STEP_RADIANS, MIN_RESAMPLED_SAMPLES / duration)
    return least if math.isfinite(duration) and least < 0.5 * recorded else None


def steps_per_reading(turbine: Turbine, rate: float) -> int:
    """Number of steps of the equations for each reading at that rate [Hz]."""
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates)
    return max(math.ceil(fastest / MAX_STEP_RADIANS / rate * (1.0 - 1e-9)), 1)


def note_rate(recorded: float, rate: float, steps: int, turbine: Turbine) -> tuple[Finding, ...]:
    """Note on the effect of resampling from the rate `recorded` to `rate` [Hz]."""
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates)
    lost = fastest / (2.0 * math.pi) if steps > 1 and fastest > 0.8 * math.pi * rate else None
    return (Finding("resampled", "note", {"recorded": recorded, "rate": rate, "lost_mode": lost, "steps": steps}),)


def note_steps(steps: int) -> Finding:
    """Step of the equations."""
    return Finding("steps_of_equations", "note", {"steps": steps})


@kept_with_record
def slow_down(record: Record, read: tuple[str, ...], rate: float, steps: int, *, start: float | None = None) -> Record:
    """The record with the channels `read` at `rate` [Hz] from `start` [s] on, its own by default, and all others
    `steps` times as often."""
    slow = resample(record, rate, start=start)
    return slow if steps <= 1 else _between_readings(slow, record, read, rate, steps)


@kept_with_record
def refine(record: Record, read: tuple[str, ...], steps: int) -> Record:
    """The record as it is in the channels `read`, and all others `steps` times as often."""
    return _between_readings(record, record, read, record.rate, steps)


def _between_readings(readings: Record, record: Record, read: Sequence[str], rate: float, steps: int) -> Record:
    """Readings at `rate` [Hz] that are missing between them, and all other channels of `record` on the fine grid."""
    others = [name for name in record.channels if name not in read]
    time = readings.time[0] + np.arange(steps * (readings.samples - 1) + 1) / (steps * rate)
    values = np.full((len(time), len(record.channels)), np.nan)
    values[::steps] = readings.values
    if others:
        fine = resample(steadied(record).select(others), steps * rate, start=float(time[0]), end=float(time[-1]))
        values[:, [record.channels.index(name) for name in others]] = fine.values
    return replace(readings, time=time, values=values)


def _check_rate(duration: float, turbine: Turbine, rate: float) -> None:
    """Refuse a rate whose low-pass, flat to 0.4 of it, takes every mode out of the record, or that leaves next to no
    readings."""
    slowest = turbine.slowest_frequency / (2.0 * math.pi)
    least = max(math.tau / MAX_RADIANS_PER_READING * slowest, MIN_SAMPLES / duration)
    if rate < least:
        periods = duration * slowest
        left = (
            "few samples"
            if math.isinf(duration)
            else f"{math.floor(duration * rate) + 1} samples of {periods:.3g} periods"
        )
        raise ConfigurationError(
            f"rate: {rate:g} Hz would leave {left} of the slowest mode ({slowest:.3g} Hz): expected at least "
            f"{1.001 * least:.3g} Hz"
        )


def thin_to_readings(outcome: Outcome, steps: int) -> Outcome:
    """Expand the result of a formulation at every reading to a record that has `steps` samples for each."""
    loads = outcome.loads
    return outcome._replace(
        history_mean=outcome.history_mean[::steps],
        history_std=outcome.history_std[::steps],
        final=Info._make(array[::steps] for array in outcome.final),
        loads=None if loads is None else Loads(loads.names, loads.mean[::steps], loads.std[::steps]),
    )


def check_length(
    name: str, duration: float, rate: float, turbine: Turbine, longest: float = MAX_RADIANS_PER_UNREFINED_STEP
) -> None:
    """Refuse a record that is too short [s], or read too slowly [Hz], for the turbine's modes; `longest` as for
    `check_readings`."""
    for coordinate in turbine.model.coordinates:
        if turbine.natural_frequency(coordinate) == 0.0:
            raise ConfigurationError(
                f"turbine '{turbine.name}': expected a positive "
                f"{'/'.join(turbine.model.coefficients_of(coordinate, 'stiffness'))}, got 0: correct the turbine file, "
                f"or lock {coordinate}"
            )
    least, why = turbine.least_duration
    if duration < least:
        raise RecordError(f"{name}: expected at least {why}, got {duration:.3g} s: choose a longer record or section")
    period = 2.0 * math.pi / turbine.slowest_frequency
    if duration < period:
        raise RecordError(
            f"{name}: expected at least one period of the turbine's slowest mode ({period:.3g} s), got "
            f"{duration:.3g} s: choose a longer record, or correct its stiffness"
        )
    check_readings(name, rate, turbine, longest)


def check_readings(name: str, rate: float, turbine: Turbine, longest: float = MAX_RADIANS_PER_READING) -> None:
    """Refuse a record that is read too slowly [Hz] for the fastest mode, `longest` [rad] of it from reading to
    reading."""
    fastest = max(turbine.natural_frequency(coordinate) for coordinate in turbine.model.coordinates)
    if fastest / rate > longest:
        raise RecordError(
            f"{name}: expected at least {fastest / longest:.3g} samples per second for a mode at "
            f"{fastest / (2.0 * math.pi):.3g} Hz, got {rate:.3g}"
        )

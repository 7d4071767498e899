"""From a record to what the filters read: sensors, rate, added noise."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError, RecordError
from windsysid.filters import Info
from windsysid.identification.outcome import Outcome
from windsysid.inspection.health import Finding
from windsysid.inspection.screening import screen
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.load_history import Loads
from windsysid.signals import resample
from windsysid.signals.inputs import TURNING
from windsysid.turbine.turbine import Turbine

__all__ = [
    "add_noise",
    "check_length",
    "choose_rate",
    "describe_rate",
    "resample_for_model",
    "screened",
    "slow_down",
    "steps_per_reading",
    "thin_to_readings",
    "usable_sensors",
    "with_noise",
]


FEWEST_PER_PERIOD, FEWEST = 2.5, 20
"""Samples per period of the slowest mode below which nothing of it is left in a resampled record, and fewest samples of
such a record."""

MAX_STEP = 0.6
"""Longest step of the equations, times the highest natural frequency [rad]."""


def add_noise(record: Record, channels: Sequence[str], percent: float, seed: int) -> tuple[Record, dict[str, float]]:
    """White noise of `percent` of each channel's standard deviation added to it; returns the noise rms per channel too.

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
    """The same sensors, as noisy as they and the added noise are together."""
    return tuple(
        sensor.model_copy(update={"noise": math.hypot(sensor.noise, added.get(sensor.channel, 0.0))})
        for sensor in sensors
    )


def usable_sensors(record: Record, turbine: Turbine, sensors: Sequence[Sensor] | None) -> tuple[Sensor, ...]:
    """The sensors given, all of which the record must hold, or those of the turbine's usual ones that it does hold."""
    if sensors is None:
        found = tuple(sensor for sensor in turbine.sensors if sensor.channel in record)
        if not found:
            wanted = ", ".join(sensor.channel for sensor in turbine.sensors)
            raise RecordError(
                f"{record.name}: expected at least one of the channels {wanted}; got {', '.join(record.channels)}; "
                "list the record's own channels with --sensors FILE"
            )
    else:
        found = tuple(sensors)
        if not found:
            raise ConfigurationError(
                "the sensor list is empty: expected at least one sensor; leave it out for the usual ones"
            )
    for sensor in found:
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
    for name in turbine.model.loads:
        expected = turbine.model.freedom(name).load_unit
        if name in record and record.unit(name) != expected:
            raise RecordError(f"channel '{name}': expected {expected}, got {record.unit(name)}: correct its unit")
    return found


def screened(record: Record, turbine: Turbine, sensors: Sequence[Sensor], *, refuse: bool = True) -> list[Finding]:
    """What is wrong with the channels that the joint formulation reads (`windsysid.inspection.screening`); RecordError
    where it makes estimates wrong."""
    return screen(
        record, turbine, [sensor.channel for sensor in sensors],
        others=(*TURNING, "wind_speed", *turbine.model.loads),
        offsets={sensor.channel: sensor.bias for sensor in sensors},
        refuse=refuse,
    )  # fmt: skip


def resample_for_model(
    record: Record, turbine: Turbine, rate: float | None, sensors: Sequence[Sensor]
) -> tuple[Record, int, tuple[str, ...]]:
    """The record at a lower rate, where one is asked for or the turbine's model has nothing to say of what is faster;
    samples per reading, and a note.

    Where the equations need shorter steps than a reading takes, sensors are missing between their readings and all else
    is as the fine grid has it.
    """
    slow = choose_rate(record.rate, record.duration, turbine, rate)
    if slow is None:
        return record, 1, ()
    steps = steps_per_reading(turbine, slow)
    slowed = slow_down(record, [sensor.channel for sensor in sensors], slow, steps)
    return slowed, steps, describe_rate(record.rate, slow, steps, turbine)


def choose_rate(recorded: float, duration: float, turbine: Turbine, rate: float | None) -> float | None:
    """Readings per second [Hz] for a record of `duration` seconds at the rate `recorded`; None to take it as it is.

    Raises
    ------
    ConfigurationError
        If the rate that is asked for takes every mode out of the record, or leaves next to no readings.
    """
    if rate is None and turbine.model.samples_per_period is not None:
        fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates)
        rate = min(turbine.model.samples_per_period * fastest / (2.0 * math.pi), recorded)
    elif rate is not None and not 0.0 < rate <= 1.001 * recorded:
        raise ConfigurationError(f"rate: expected more than 0 and at most the record's {recorded:.4g} Hz, got {rate:g}")
    if rate is None or rate > 0.95 * recorded:
        return None
    _check_rate(duration, turbine, rate)
    return rate


def steps_per_reading(turbine: Turbine, rate: float) -> int:
    """How many steps the equations need for each reading at that rate [Hz]."""
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates)
    return max(math.ceil(fastest / MAX_STEP / rate * (1.0 - 1e-9)), 1)


def describe_rate(recorded: float, rate: float, steps: int, turbine: Turbine) -> tuple[str, ...]:
    """What resampling from the rate `recorded` to `rate` [Hz] does."""
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates)
    note = f"resampled from {recorded:.4g} to {rate:.3g} Hz"
    if steps <= 1:
        return (note,)
    if fastest > 0.8 * math.pi * rate:
        note += (
            f", which takes the mode near {fastest / (2.0 * math.pi):.3g} Hz out of the record and not out of "
            f"the model: do not rely on what is said of it"
        )
    return (f"{note}, {steps} steps of the equations for each reading",)


def slow_down(record: Record, read: Sequence[str], rate: float, steps: int, *, start: float | None = None) -> Record:
    """The record with the channels `read` at `rate` [Hz] from `start` [s] on, its own by default, and all others
    `steps` times as often."""
    slow = resample(record, rate, start=start)
    if steps <= 1:
        return slow
    others = [name for name in record.channels if name not in read]
    length = steps * (slow.samples - 1) + 1
    values = np.full((length, len(record.channels)), np.nan)
    values[::steps] = slow.values
    if others:
        fine = resample(record.select(others), steps * rate, start=start)
        values[:, [record.channels.index(name) for name in others]] = fine.values[:length]
    time = slow.time[0] + np.arange(length) / (steps * rate)
    return replace(slow, time=time, values=values)


def _check_rate(duration: float, turbine: Turbine, rate: float) -> None:
    """Refuse a rate whose low-pass, flat to 0.4 of it, takes every mode out of the record, or that leaves next to no
    readings."""
    slowest = turbine.slowest_frequency / (2.0 * math.pi)
    least = max(FEWEST_PER_PERIOD * slowest, FEWEST / duration)
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
    """What a formulation found at every reading, on a record that has `steps` samples for each."""
    loads = outcome.loads
    return outcome._replace(
        history_mean=outcome.history_mean[::steps],
        history_std=outcome.history_std[::steps],
        final=Info._make(array[::steps] for array in outcome.final),
        loads=None if loads is None else Loads(loads.names, loads.mean[::steps], loads.std[::steps]),
    )


def check_length(name: str, duration: float, rate: float, turbine: Turbine) -> None:
    """Refuse a record that is too short [s], or read too slowly [Hz], for the turbine's modes."""
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
    fastest = max(turbine.natural_frequency(coordinate) for coordinate in turbine.model.coordinates)
    if fastest / rate > MAX_STEP:
        raise RecordError(
            f"{name}: expected at least {fastest / MAX_STEP:.3g} samples per second for a mode at "
            f"{fastest / (2.0 * math.pi):.3g} Hz, got {rate:.3g}"
        )

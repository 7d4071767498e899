"""Deterministic sinusoids: detection and removal, for a steady frequency, amplitude and phase.

A machine nearby, or an imbalance of the rotor, pushes with a sine. A narrow-band load is none, and more than half of it
would stay where a sine is taken away. Thomson's F tells them apart: of a sine it grows as its power over its
surroundings, of a narrow-band load it does not. A sine that turns with the rotor at nP is looked for in the innovations
of filters instead, which know what gravity and a given imbalance do.

A sinusoidal force on a linear structure without rotating parts gives a sinusoid in each channel, which least squares
remove: one frequency of the record is lost, of the many that determine a mode. On rotating blades, a sinusoid at f of
the fixed frame is at f ± Ω/2π, and vice versa. Removing it from the readings is enough for a first estimate; a filter
is sensitive to the lost correlation of channels. So sinusoids become forces
(`windsysid.identification.effects.sinusoidal_force`).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array, Complex
from windsysid.checks.limits import (
    HARMONIC_HALF_WIDTH_BINS,
    MAX_DISAGREEMENT_SIGMAS,
    MODEL_CHANGE_PROBABILITY,
    SCREENING_PROBABILITY,
)
from windsysid.checks.lines import SURROUNDING_BINS, stand_out_of_a_bend
from windsysid.errors import RecordError
from windsysid.identification.limits import MAX_SINUSOID_SHIFT_BINS, MIN_F_OVER_POWER, MIN_LINE_POWER
from windsysid.identification.model.prior_odds import f_bound
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.signals.band import bridged
from windsysid.signals.rotor import rotor_inputs
from windsysid.signals.textbook import minimum
from windsysid.spectral.transforms.harmonics import steadiness
from windsysid.turbine.turbine import Turbine

__all__ = ["Sine", "find_sine", "find_turning", "one_turn", "phase_of", "turned", "ways_of", "without_sines"]

SEGMENT_COUNT = 4
"""Setting: segments of a record, which overlap by half, in which a sinusoid has to have one amplitude and phase."""

FREQUENCY_STD_BINS = 0.49
"""Numerical: standard deviation of a sinusoid's frequency with Hann's window, in frequencies of the periodogram, times
the root of its power over its surroundings; 0.39 without a window (Rife & Boorstyn, IEEE Trans. Inf. Theory 20, 1974).
"""

MAX_HARMONIC = 6
"""Setting: harmonics nP of the rotor that are looked for."""


class Sine(NamedTuple):
    """A steady sine: its frequency [Hz], whether it was found on the blades, and the order n if it turns with the rotor
    at nP; 0 if it does not."""

    frequency: float
    on_blades: bool
    order: int = 0

    def same_as(self, other: "Sine", apart: float) -> bool:
        """Test whether two are within so many hertz of each other, in the fixed or in the rotating frame."""
        return abs(self.frequency - other.frequency) < apart and self.on_blades == other.on_blades

    @property
    def doubt(self) -> Finding:
        """That it is left in innovations."""
        code = "rotor_harmonic_left" if self.order else "tone_left"
        return Finding(code, "reason", {"frequency": self.frequency, "order": self.order})

    @property
    def note(self) -> Finding:
        """That it was left out of the readings."""
        return Finding("tone_removed", "note", {"frequency": self.frequency})


def find_sine(
    record: Record, turbine: Turbine, sensors: Sequence[Sensor], channel: str, frequency: float
) -> Sine | None:
    """The sine that a line is, in a channel and at a frequency [Hz] that is right to one of the periodogram; None where
    it is not steady, or at 1P, where gravity is."""
    if not record.is_uniform:
        return None
    step, rotor_hz = 1.0 / record.duration, _turns(record, turned(record, turbine, sensors))
    blades = {sensor.channel: bool(sensor.blade) for sensor in sensors}
    on_blades = blades.get(channel, False)
    seen = _SeenLine.of(record, channel, frequency)
    if seen is None or abs(seen.frequency - rotor_hz) < HARMONIC_HALF_WIDTH_BINS * step:
        return None
    if seen.steadiness < max(f_bound(MODEL_CHANGE_PROBABILITY, "sinusoid", turbine), MIN_F_OVER_POWER * seen.over):
        return None
    others = [name for name, turns in blades.items() if turns is on_blades and name != channel]
    return Sine(seen.frequency, on_blades) if _is_steady(seen, record, others, step) else None


def _is_steady(seen: "_SeenLine", record: Record, channels: Sequence[str], step: float) -> bool:
    """Test whether a line is a steady sinusoid, in its own channel and in those of the others in which it is strong."""
    elsewhere = (_SeenLine.of(record, channel, seen.frequency) for channel in channels)
    loud = [one for one in elsewhere if one is not None and one.over >= MIN_LINE_POWER]
    return all(one.is_steady_at(seen.frequency, step) for one in (seen, *loud))


class _SeenLine(NamedTuple):
    """A line in a channel: its frequency [Hz], Thomson's F, its power over its surroundings, and the squared scatter of
    its amplitude and phase in parts of the record over what chance does."""

    frequency: float
    steadiness: float
    over: float
    scatter: float

    def is_steady_at(self, frequency: float, step: float) -> bool:
        """Test whether the peak is one of a steady sinusoid at a frequency [Hz], in a periodogram with this step."""
        from scipy.special import gammaincc

        by_chance = MAX_DISAGREEMENT_SIGMAS * FREQUENCY_STD_BINS / math.sqrt(self.over)
        apart = step * max(MAX_SINUSOID_SHIFT_BINS, by_chance)
        chance = gammaincc(SEGMENT_COUNT - 1, self.scatter)  # half a χ² of two degrees of freedom for each but the mean
        return bool(chance >= SCREENING_PROBABILITY and abs(self.frequency - frequency) <= apart)

    @classmethod
    def of(cls, record: Record, channel: str, frequency: float) -> "_SeenLine | None":
        """Statistic of a peak near a frequency [Hz]; None if there are no neighbours."""
        if not np.isfinite(record[channel]).any():
            return None
        values, samples, rate = bridged(record[channel], channel), record.samples, record.rate
        values, time, window = values - values.mean(), record.time - record.time[0], np.hanning(samples)
        frequency = _refined(window * values, time, frequency, rate / samples)
        power, at = np.abs(np.fft.rfft(window * values)) ** 2, round(frequency * samples / rate)
        if not SURROUNDING_BINS < at < len(power) - SURROUNDING_BINS:
            return None
        over = float(stand_out_of_a_bend(power[:, None], np.array([at]), SURROUNDING_BINS)[0, 0])
        level = power[at] / over / np.sum(window**2)
        scatter = _scatter(values * np.exp(-2j * math.pi * frequency * time), level)
        return cls(frequency, steadiness(values, rate, frequency), over, scatter)


def _scatter(wave: Complex, level: float) -> float:
    """Squared scatter of the means of parts of a wave (T,), relative to that of white noise of a level per sample."""
    samples = len(wave)
    length = 2 * samples // (SEGMENT_COUNT + 1)
    windows = np.zeros((SEGMENT_COUNT, samples))
    for window, first in zip(windows, np.linspace(0, samples - length, SEGMENT_COUNT).astype(int), strict=True):
        window[first : first + length] = np.hanning(length) / np.hanning(length).sum()
    means, weight = windows @ wave, np.linalg.inv(level * windows @ windows.T)
    off = means - np.sum(weight @ means) / np.sum(weight)
    return float((off.conj() @ weight @ off).real)


def one_turn(record: Record, turbine: Turbine, sensors: Sequence[Sensor]) -> Sine | None:
    """The sine at 1P on the support; None where no blades turn that are read."""
    hz = _turns(record, turned(record, turbine, sensors))
    return Sine(hz, on_blades=False, order=1) if hz > HARMONIC_HALF_WIDTH_BINS / record.duration else None


def find_turning(
    whitened: Array, record: Record, turbine: Turbine, sensors: Sequence[Sensor], known: Sequence[Sine] = ()
) -> list[Sine]:
    """Sines at nP on the support, and those known, that are left in innovations (T, m) of a record that a filter has
    read; none where no blades turn."""
    psi = turned(record, turbine, sensors)
    if psi is None or not record.is_uniform or len(whitened) != record.samples:
        return []
    rotor_hz, apart = _turns(record, psi), HARMONIC_HALF_WIDTH_BINS / record.duration
    turning = [Sine(order * rotor_hz, on_blades=False, order=order) for order in range(1, MAX_HARMONIC + 1)]
    turning = [one for one in turning if apart < one.frequency < 0.4 * record.rate]
    turning = [one for one in turning if not any(one.same_as(other, apart) for other in known)]
    tests = max(1, len(turning) * sum(not sensor.blade for sensor in sensors))
    least = f_bound(SCREENING_PROBABILITY / tests, "rotor_harmonic", turbine)
    z, on_blades = np.nan_to_num(whitened).T, [bool(sensor.blade) for sensor in sensors]

    def is_left(sine: Sine) -> bool:
        channels = [one for one, turns in zip(z, on_blades, strict=True) if turns is sine.on_blades]
        return max(steadiness(one, record.rate, sine.frequency) for one in channels) > least

    return [sine for sine in (*known, *turning) if is_left(sine)]


def without_sines(record: Record, turbine: Turbine, sensors: Sequence[Sensor], sines: Sequence[Sine]) -> Record:
    """The record without sines in any channel of the sensors, but at 1P, where the model has forces of its own."""
    psi = turned(record, turbine, sensors)
    rotor_hz, step = _turns(record, psi), 1.0 / record.duration
    window, left = np.hanning(record.samples), {}
    for sensor in sensors:
        phases = []
        for sine in sines:
            phase = phase_of(sine, record, psi)
            seen = [(sine.frequency, phase)]
            if bool(sensor.blade) != sine.on_blades and psi is not None:
                seen = [(abs(sine.frequency + turn * rotor_hz), phase + turn * psi) for turn in (-1.0, 1.0)]
            phases += [one for hz, one in seen if min(hz, abs(hz - rotor_hz)) > HARMONIC_HALF_WIDTH_BINS * step]
        values = record[sensor.channel]
        left[sensor.channel] = values - _waves(values, window, phases), record.unit(sensor.channel)
    return record.with_channels(left)


def ways_of(sine: Sine, record: Record, psi: Array | None) -> list[Sine]:
    """Candidates for a sinusoid: itself, and the image of a sinusoid on the other side of the hub, whose rotor has the
    azimuth ψ (T,)."""
    if psi is None or sine.order:
        return [sine]
    rotor_hz, least = _turns(record, psi), HARMONIC_HALF_WIDTH_BINS / record.duration
    others = [Sine(abs(sine.frequency + turn * rotor_hz), not sine.on_blades) for turn in (-1.0, 1.0)]
    return [sine, *(one for one in others if min(one.frequency, abs(one.frequency - rotor_hz)) > least)]


def phase_of(sine: Sine, record: Record, psi: Array | None) -> Array:
    """The phase of a sine (T,) [rad] over a record whose rotor has the azimuth ψ (T,)."""
    if sine.order and psi is not None:
        return sine.order * psi
    return np.asarray(2.0 * math.pi * sine.frequency * (record.time - record.time[0]))


def turned(record: Record, turbine: Turbine, sensors: Sequence[Sensor]) -> Array | None:
    """The rotor's azimuth (T,) [rad], on and on, where some sensors turn with it and others do not; otherwise None."""
    if len({bool(sensor.blade) for sensor in sensors}) < 2 or "rotor_azimuth" not in record:
        return None
    try:
        return np.asarray(rotor_inputs(record, abs(turbine.rotor_speed))[:, 0])
    except RecordError:
        return None


def _turns(record: Record, psi: Array | None) -> float:
    """1P [Hz] of a rotor at the azimuth ψ (T,); 0 without one."""
    return 0.0 if psi is None else abs(float(psi[-1] - psi[0])) / (2.0 * math.pi * record.duration)


def _refined(windowed: Array, time: Array, frequency: float, step: float) -> float:
    """The frequency [Hz] near another at which windowed values (T,) have most."""
    return minimum(
        lambda f: -abs(windowed @ np.exp(-2j * math.pi * f * time)), frequency - step, frequency + step, 1e-3 * step
    )


def _waves(values: Array, window: Array, phases: Sequence[Array]) -> Array:
    """Part of values (T,) that is sinusoids of these phases (T,), by least squares under a window, so that neither a
    strong line at another frequency nor the slope of a resonance bends it."""
    known = np.isfinite(values)
    columns = [wave for phase in phases for wave in (np.cos(phase), np.sin(phase))]
    design = np.column_stack([np.ones(len(values)), *columns])
    weighted = np.where(known, window, 0.0)[:, None] * design
    found = np.linalg.lstsq(weighted.T @ design, weighted.T @ np.nan_to_num(values), rcond=None)[0]
    return np.asarray(design[:, 1:] @ found[1:])

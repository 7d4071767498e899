"""Loggers whose clock runs faster or slower than that of the tower's.

Two crystals differ by tens of parts in a million: 30 ms in ten minutes, a tenth of a period of a blade. A clock that is
late has an unknown (`windsysid.identification.effects.clock_lag`); its drift is seen before anything is identified, as
sensors of turning blades feel gravity. In the reading y = Re a e^{iψ} of a logger that is late by κ, with the azimuth ψ
of the tower's logger, the phase of a falls by Ωκ. It is taken window by window; where a straight line through the κ of
all windows is beyond chance, readings are put back to when they were taken, as if the clocks had agreed at the first
sample: how late a logger was then is the unknown's.

Gravity tells a drift in minutes. What vibrates tells it sooner, from where spectra have ended: the halves of the record
have a clock each, and the second is later than the first by half of what drifts. A record that drifts bends what
spectra find, and with it that difference, so that they are asked again until nothing is left.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.mechanics.sensors import TOWER_LOGGER, Sensor
from windsysid.records.record import Record
from windsysid.signals.rotor import STANDING_MAX_SPEED, rotor_inputs
from windsysid.spectral.rotor.model import LiftedModel
from windsysid.turbine.turbine import Turbine

__all__ = ["Drift", "drift_of_halves", "find_drift", "left_over", "persists", "together", "without_drift"]

TURNS, FEWEST, MOST = 5.0, 6, 40
"""Turns of a window at least; windows of a record at least and at most."""

CLEAR = 4.0
"""Standard deviations from which on a drift is one."""

STEADY = 10.0
"""How many times the amplitude that repeats in every turn must be as large as it scatters from window to window."""

FINER = 8
"""Values between which a shifted one is interpolated, to each that was read."""

LEAST, GREATEST = 0.07, 3e-4
"""Angle [rad] of the fastest motion of a degree of freedom by which a drift over the record matters, and [s/s] that a
clock can have."""

STEPS, SMALL = 3, 1.0
"""Most steps of scoring to the clock of a half; one of so many standard deviations or fewer is the last."""


class Drift(NamedTuple):
    """A clock that drifts.

    Attributes
    ----------
    logger
        Whose it is.
    rate, std
        By how much more it is late in every second [s/s], and the standard deviation of that.
    by
        What shows it.
    """

    logger: str
    rate: float
    std: float
    by: str = "gravity in its readings"

    def __str__(self) -> str:
        ppm, std, pace = 1e6 * abs(self.rate), 1e6 * self.std, "slowly" if self.rate < 0.0 else "fast"
        return (
            f"the clock of the logger {self.logger} runs {ppm:.3g} ± {std:.2g} ppm too {pace}, by {self.by}: its "
            "readings were put back"
        )

    def matters(self, turbine: Turbine, duration: float) -> bool:
        """Whether it is beyond chance, no faster than clocks drift, and moves what vibrates in such a record [s]."""
        fastest = max((turbine.natural_frequency(name) for name in turbine.model.coordinates), default=0.0)
        least = LEAST / (fastest * duration) if fastest > 0.0 else math.inf
        return max(CLEAR * self.std, least) < abs(self.rate) < GREATEST


def without_drift(
    record: Record, turbine: Turbine, sensors: Sequence[Sensor], known: Sequence[Drift] = ()
) -> tuple[Record, tuple[Drift, ...]]:
    """The record with the readings of drifting loggers on the tower's clock, and those drifts: the known ones, or what
    gravity shows where none are."""
    if not record.is_uniform:
        return record, ()
    drifts = tuple(known) or _by_gravity(record, turbine, sensors)
    for drift in drifts:
        of_logger = [sensor.channel for sensor in sensors if sensor.sampled_by == drift.logger]
        late = drift.rate * (record.time - record.time[0])
        record = record.with_channels(
            {one: (_moved(record.time, record[one], late), record.unit(one)) for one in of_logger}
        )
    return record, drifts


def left_over(drifts: Sequence[Drift], known: Sequence[Drift], turbine: Turbine, duration: float) -> tuple[Drift, ...]:
    """Drifts that matter in a record of so many seconds, and of loggers that were put back what is beyond its standard
    deviation."""
    before = {one.logger for one in known}
    return tuple(
        one for one in drifts if (abs(one.rate) > one.std if one.logger in before else one.matters(turbine, duration))
    )


def persists(left: Sequence[Drift], before: Sequence[Drift]) -> bool:
    """Whether more than half of a drift is left, beyond chance, where it was put back: something else looked like
    one."""
    was = {one.logger: abs(one.rate) for one in before}
    return any(abs(one.rate) > max(CLEAR * one.std, 0.5 * was.get(one.logger, math.inf)) for one in left)


def together(drifts: Sequence[Drift], more: Sequence[Drift]) -> tuple[Drift, ...]:
    """What is left to be put back, added to what was."""
    before = {one.logger: one for one in drifts}
    for one in more:
        if one.logger in before:
            one = one._replace(rate=before[one.logger].rate + one.rate)
        before[one.logger] = one
    return tuple(before.values())


def drift_of_halves(
    halves: Sequence[LiftedModel], unknowns: Array, loggers: Sequence[str], apart: float
) -> list[Drift]:
    """The drifts of loggers whose clocks are unknowns of spectra, from the halves of a record whose middles are so many
    seconds apart, at the unknowns that the whole record has."""
    if not loggers:
        return []
    (early, early_std), (late, late_std) = (_clocks(half, unknowns, len(loggers)) for half in halves)
    rates, stds = (late - early) / apart, np.hypot(early_std, late_std) / apart
    told = zip(loggers, rates.tolist(), stds.tolist(), strict=True)
    return [Drift(logger, rate, std, "vibration in the record's halves") for logger, rate, std in told]


def _clocks(half: LiftedModel, unknowns: Array, count: int) -> tuple[Array, Array]:
    """By how much the clocks are late (count,) [s], and the standard deviations of
    that with all others known; of a clock that nothing shows, infinite ones."""
    at, unknowns = half.unknowns.of("clocks"), unknowns.copy()
    for _ in range(STEPS):
        said = half.likelihood(unknowns)
        information = np.diag(said.information)[at]
        shown = information > 0.0
        step = np.divide(said.gradient[at], information, out=np.zeros(count), where=shown)
        unknowns[at] -= step
        if (step**2 * information <= SMALL**2).all():
            break
    spread = np.abs(half.inexact.late[-count:]).max(axis=1)
    std = np.divide(spread, np.sqrt(np.abs(information)), out=np.full(count, math.inf), where=shown)
    return spread * unknowns[at], std


def _by_gravity(record: Record, turbine: Turbine, sensors: Sequence[Sensor]) -> tuple[Drift, ...]:
    """The drifts that gravity shows."""
    if "rotor_azimuth" not in record:
        return ()
    drifts = []
    for logger in dict.fromkeys(sensor.sampled_by for sensor in sensors if sensor.blade):
        channels = [sensor.channel for sensor in sensors if sensor.sampled_by == logger and sensor.blade]
        found = None if logger == TOWER_LOGGER else find_drift(record, channels, abs(turbine.rotor_speed))
        if found is not None:
            drifts.append(Drift(logger, *found))
    return tuple(one for one in drifts if one.matters(turbine, record.duration))


def find_drift(record: Record, channels: Sequence[str], usual_speed: float) -> tuple[float, float] | None:
    """The drift of the clock of channels on turning blades against the azimuth [s/s], and its standard deviation; None
    where gravity hardly shows in them, or the record is too short."""
    try:
        psi, speed, _ = rotor_inputs(record, usual_speed).T
    except RecordError:
        return None
    mean = abs(float(speed.mean()))
    if mean <= STANDING_MAX_SPEED:
        return None
    count = min(MOST, int(record.duration * mean / (2.0 * math.pi * TURNS)))
    if count < FEWEST:
        return None
    bounds = np.linspace(0, record.samples, count + 1).astype(int)
    wave = np.exp(-1j * psi)
    centres, late, weights = [], [], []
    for channel in channels:
        amplitudes = np.array([_amplitude(record[channel][a:b], wave[a:b]) for a, b in pairwise(bounds)])
        usual = np.nanmean(amplitudes) if np.isfinite(amplitudes).any() else 0.0
        scatter = float(np.nanstd(np.abs(amplitudes))) if np.isfinite(amplitudes).any() else math.inf
        if not abs(usual) > STEADY * scatter:
            continue
        off = -np.angle(amplitudes / usual) / mean
        known = np.isfinite(off)
        centres.append(0.5 * (record.time[bounds[:-1]] + record.time[bounds[1:] - 1])[known])
        late.append(off[known])
        weights.append(np.full(known.sum(), (abs(usual) / max(scatter, 1e-12 * abs(usual))) ** 2))
    if not centres or sum(map(len, centres)) < FEWEST:
        return None
    return _line(np.concatenate(centres), np.concatenate(late), np.concatenate(weights))


def _amplitude(values: Array, wave: Array) -> complex:
    """The complex amplitude of what repeats in every turn, by least squares with a mean; NaN of a window with gaps."""
    if not np.isfinite(values).all():
        return complex(math.nan, math.nan)
    design = np.column_stack([np.ones(len(values)), wave.real, wave.imag])
    _, cosine, sine = np.linalg.lstsq(design, values, rcond=None)[0]
    return complex(cosine, sine)


def _line(time: Array, late: Array, weights: Array) -> tuple[float, float]:
    """The slope of a straight line through all, and what its scatter says of it."""
    root = np.sqrt(weights / weights.mean())
    design = np.column_stack([np.ones(len(time)), time - time.mean()]) * root[:, None]
    fit = np.linalg.lstsq(design, late * root, rcond=None)[0]
    left = late * root - design @ fit
    variance = float(left @ left) / max(1, len(time) - 2) * float(np.linalg.inv(design.T @ design)[1, 1])
    return float(fit[1]), math.sqrt(variance)


def _moved(time: Array, values: Array, late: Array) -> Array:
    """Values (T,) that came so many seconds late, as they were at their times; NaN stay where they are.

    They are taken between samples from `FINER` times as many, by Fourier's series: white noise stays white, which a
    spline through the samples themselves would not leave it.
    """
    from scipy.interpolate import make_interp_spline
    from scipy.signal import resample

    known = np.isfinite(values)
    if known.sum() < FEWEST:
        return values
    whole = np.interp(time, time[known], values[known])
    line = np.polynomial.Polynomial.fit(time, whole, 1)
    samples, step = len(time), time[1] - time[0]
    fine = time[0] + np.arange(FINER * samples) * step / FINER
    curve = make_interp_spline(fine, resample(whole - line(time), FINER * samples), k=3)
    at = np.clip(time + late, time[0], time[-1])
    return np.where(known, curve(at) + line(at), np.nan)

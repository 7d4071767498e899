"""Loggers whose clock runs faster or slower than that of the tower's.

Two crystals differ by tens of parts in a million: 30 ms in ten minutes, a tenth of a period of a blade. A clock that is
late has an unknown (`windsysid.identification.estimate.clock_lag`); its drift is seen before anything is identified, as
sensors of turning blades measure gravity. In the reading y = Re a e^{iψ} of a logger that is late by κ, with the
azimuth ψ of the tower's logger, the phase of a falls by Ωκ. It is taken window by window; where a straight line through
the κ of all windows is beyond chance, readings are put back to when they were taken, as if the clocks had agreed at the
first sample: how late a logger was then is the unknown's.

Gravity tells a drift in minutes. What vibrates tells it sooner, from where spectra have ended: the halves of the record
have a clock each, and the second is later than the first by half of what drifts. A record that drifts bends what
spectra find, and with it that difference, so the fit is repeated until none remains.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import CONFLICT_SIGMAS
from windsysid.errors import RecordError
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.limits import MIN_DRIFT_WINDOWS
from windsysid.identification.model.drift import Drift
from windsysid.identification.model.effect import Detection, Effect
from windsysid.identification.model.fit import Outcome
from windsysid.mechanics.sensors import TOWER_LOGGER, Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.signals.rotor import MAX_STANDING_SPEED, rotor_inputs
from windsysid.turbine.turbine import Turbine

__all__ = ["ClockDrift", "ClockDrifts", "drifts_in", "find_drift", "left_over", "persists", "together"]

MIN_TURNS_PER_WINDOW, MAX_WINDOWS = 5.0, 40
"""Setting: turns of a window at least; windows of a record at most."""

INTERPOLATION_FACTOR = 8
"""Numerical: values between which a shifted one is interpolated, to each that was read."""


@dataclass(frozen=True)
class ClockDrifts:
    """Clocks that drift, whose readings are put back to when they were taken; of these drifts `last` was found last."""

    drifts: tuple[Drift, ...]
    last: tuple[Drift, ...] = ()
    code: str = "clock_drift"

    def correct(
        self, record: Record, turbine: Turbine, sensors: Sequence[Sensor], *, filtered: bool
    ) -> tuple[Record, tuple[Sensor, ...]]:
        """Put the readings of drifting loggers on the tower's clock."""
        for drift in self.drifts if record.is_uniform else ():
            of_logger = [sensor.channel for sensor in sensors if sensor.sampled_by == drift.logger]
            late = drift.rate * (record.time - record.time[0])
            record = record.with_channels(
                {one: (_moved(record.time, record[one], late), record.unit(one)) for one in of_logger}
            )
        return record, tuple(sensors)

    def notes(self, outcome: Outcome, *, filtered: bool) -> tuple[Finding, ...]:
        """Clocks that drift."""
        return tuple(one.note for one in self.drifts)


class ClockDrift(Effect):
    """Drifts of clocks, found by gravity in turning sensors, and by the clocks that both halves of a record have."""

    code = "clock_drift"

    def find(self, job: Job) -> ClockDrifts | None:
        """Find the drifts that gravity shows."""
        at = job.condition()
        drifts = _by_gravity(at.record, job.turbine, at.sensors) if at.record.is_uniform else ()
        return ClockDrifts(drifts) if drifts else None

    def detect(self, job: Job, fit: FittedJob) -> Detection:
        """Test whether the halves of the record have the same clocks, by spectra."""
        before = drifts_in(job)
        left = left_over(fit.outcome.drifts, before, job.turbine, fit.read.duration)
        if not left:
            return Detection(fit)
        sigmas = max(abs(one.rate) / one.std for one in left)
        return Detection(fit, ClockDrifts(together(before, left), left), sigmas**2 / (2.0 * math.log(10.0)))

    def confirm(self, job: Job, found: Detection, after: FittedJob) -> FittedJob | None:
        """Keep a drift that the correction removes; a remaining one has another cause."""
        put_back = found.inclusion
        if not isinstance(put_back, ClockDrifts):
            return after
        left = left_over(after.outcome.drifts, put_back.drifts, after.outcome.turbine, after.read.duration)
        return None if persists(left, put_back.last) else after


def drifts_in(job: Job) -> tuple[Drift, ...]:
    """The drifts that a job includes."""
    included = job.included(ClockDrift.code)
    return included.drifts if isinstance(included, ClockDrifts) else ()


def left_over(drifts: Sequence[Drift], known: Sequence[Drift], turbine: Turbine, duration: float) -> tuple[Drift, ...]:
    """Significant drifts in a record of so many seconds, with the corrected lag of each logger that exceeds its
    standard deviation."""
    before = {one.logger for one in known}
    return tuple(
        one for one in drifts if (abs(one.rate) > one.std if one.logger in before else one.matters(turbine, duration))
    )


def persists(left: Sequence[Drift], before: Sequence[Drift]) -> bool:
    """Test whether more than half of a drift remains, beyond chance, after alignment: another effect looked like
    one."""
    was = {one.logger: abs(one.rate) for one in before}
    return any(abs(one.rate) > max(CONFLICT_SIGMAS * one.std, 0.5 * was.get(one.logger, math.inf)) for one in left)


def together(drifts: Sequence[Drift], more: Sequence[Drift]) -> tuple[Drift, ...]:
    """Remaining lag, added to the one that was corrected."""
    before = {one.logger: one for one in drifts}
    for one in more:
        if one.logger in before:
            one = one._replace(rate=before[one.logger].rate + one.rate)
        before[one.logger] = one
    return tuple(before.values())


def _by_gravity(record: Record, turbine: Turbine, sensors: Sequence[Sensor]) -> tuple[Drift, ...]:
    """The drifts that gravity shows."""
    if "rotor_azimuth" not in record:
        return ()
    channels: dict[str, list[str]] = {}
    for sensor in sensors:
        if sensor.blade and sensor.sampled_by != TOWER_LOGGER:
            channels.setdefault(sensor.sampled_by, []).append(sensor.channel)
    found = {logger: find_drift(record, of, abs(turbine.rotor_speed)) for logger, of in channels.items()}
    drifts = [Drift(logger, *drift) for logger, drift in found.items() if drift is not None]
    return tuple(one for one in drifts if one.matters(turbine, record.duration))


def find_drift(record: Record, channels: Sequence[str], usual_speed: float) -> tuple[float, float] | None:
    """The drift of the clock of channels on turning blades against the azimuth [s/s], and its standard deviation; None
    where gravity hardly shows in them, or the record is too short."""
    try:
        psi, speed, _ = rotor_inputs(record, usual_speed).T
    except RecordError:
        return None
    mean = abs(float(speed.mean()))
    if mean <= MAX_STANDING_SPEED:
        return None
    count = min(MAX_WINDOWS, int(record.duration * mean / (2.0 * math.pi * MIN_TURNS_PER_WINDOW)))
    if count < MIN_DRIFT_WINDOWS:
        return None
    bounds = np.linspace(0, record.samples, count + 1).astype(int)
    wave = np.exp(-1j * psi)
    centres, late, weights = [], [], []
    for channel in channels:
        amplitudes = np.array([_amplitude(record[channel][a:b], wave[a:b]) for a, b in pairwise(bounds)])
        if not np.isfinite(amplitudes).any():
            continue
        usual, scatter = np.nanmean(amplitudes), float(np.nanstd(np.abs(amplitudes)))
        if not abs(usual) > CONFLICT_SIGMAS * scatter:
            continue
        off = -np.angle(amplitudes / usual) / mean
        known = np.isfinite(off)
        centres.append(0.5 * (record.time[bounds[:-1]] + record.time[bounds[1:] - 1])[known])
        late.append(off[known])
        weights.append(np.full(known.sum(), (abs(usual) / max(scatter, 1e-12 * abs(usual))) ** 2))
    if not centres or sum(map(len, centres)) < MIN_DRIFT_WINDOWS:
        return None
    return _line(np.concatenate(centres), np.concatenate(late), np.concatenate(weights))


def _amplitude(values: Array, wave: Array) -> complex:
    """Complex amplitude of the once-per-turn component, by least squares with a mean; NaN of a window with gaps."""
    if not np.isfinite(values).all():
        return complex(math.nan, math.nan)
    design = np.column_stack([np.ones(len(values)), wave.real, wave.imag])
    _, cosine, sine = np.linalg.lstsq(design, values, rcond=None)[0]
    return complex(cosine, sine)


def _line(time: Array, late: Array, weights: Array) -> tuple[float, float]:
    """Slope of a straight line through all, and its standard deviation from their scatter."""
    root = np.sqrt(weights / weights.mean())
    design = np.column_stack([np.ones(len(time)), time - time.mean()]) * root[:, None]
    fit = np.linalg.lstsq(design, late * root, rcond=None)[0]
    left = late * root - design @ fit
    variance = float(left @ left) / max(1, len(time) - 2) * float(np.linalg.inv(design.T @ design)[1, 1])
    return float(fit[1]), math.sqrt(variance)


def _moved(time: Array, values: Array, late: Array) -> Array:
    """Values (T,) with a lag of so many seconds, interpolated to their times; NaN stay where they are.

    They are taken between samples from `INTERPOLATION_FACTOR` times as many, by Fourier's series: white noise stays
    white, which a spline through the samples themselves would not leave it.
    """
    from scipy.interpolate import make_interp_spline
    from scipy.signal import resample

    known = np.isfinite(values)
    if known.sum() < MIN_DRIFT_WINDOWS:
        return values
    whole = np.interp(time, time[known], values[known])
    line = np.polynomial.Polynomial.fit(time, whole, 1)
    samples, step = len(time), time[1] - time[0]
    fine = time[0] + np.arange(INTERPOLATION_FACTOR * samples) * step / INTERPOLATION_FACTOR
    curve = make_interp_spline(fine, resample(whole - line(time), INTERPOLATION_FACTOR * samples), k=3)
    at = np.clip(time + late, time[0], time[-1])
    return np.where(known, curve(at) + line(at), np.nan)

"""Random-walk biases of accelerometers that the sensor list does not declare.

Below its slowest mode a structure hardly accelerates: loads of a flat spectrum give readings whose power grows with the
fourth power of frequency, loads with a long memory with the square. Power that grows towards low frequencies is the
instrument's: temperature, or flicker noise of its electronics. A filter without a drift takes it for loads, and biases
coefficients. So a random walk and flicker noise, in addition to these, are compared with the slow part of the readings.
If they are detected, variations over the whole record are removed, and the sensor gets a drift of the same power at the
slowest mode. Spectra use frequencies above it anyway.

A sensor that is sensitive to gravity has slow readings, too, as the structure leans. Its drift is tested only on
request, if filters and spectra disagree.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from windsysid._types import Array
from windsysid.identification.job import Job
from windsysid.identification.limits import MIN_DRIFT_LOG_ODDS, MIN_TREND_POWER
from windsysid.identification.model.effect import Effect
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.prior_odds import log_bound
from windsysid.mechanics.sensors import Accelerometer, Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.turbine.turbine import Turbine

__all__ = ["RandomWalkBias", "RandomWalkBiases", "find_random_walks"]

MAX_SLOW_SHARE = 0.5
"""Setting: share of the slowest mode's and the rotor's frequency below which readings are slow."""

MIN_DRIFT_PERIODS = 3
"""Setting: periods in a record of the slowest variation that shows a drift; slower ones are taken out with it."""

UPDATE_COUNT = 300
"""Numerical: multiplicative updates (Févotte, Bertin & Durrieu 2009, doi:10.1162/neco.2008.04-08-771)."""

INITIAL_OFFSET_SECONDS = 10.0
"""Setting: seconds of a drift that make the offset at the beginning."""


@dataclass(frozen=True)
class RandomWalkBiases:
    """Random-walk biases, or trends.

    Attributes
    ----------
    drifts
        For each channel the standard deviation of a random walk after one second, and its bias at the beginning.
    detrended
        Channels without what varies less than `MIN_DRIFT_PERIODS` times over the record.
    units
        Of the channels.
    """

    drifts: Mapping[str, tuple[float, float]]
    detrended: tuple[str, ...]
    units: Mapping[str, str]
    code: str = "random_walk_bias"

    def correct(
        self, record: Record, turbine: Turbine, sensors: Sequence[Sensor], *, filtered: bool
    ) -> tuple[Record, tuple[Sensor, ...]]:
        """Take slow variations out of the readings; filters estimate the random walks, which stay below the bands of
        spectra."""
        held = {name: (_without_trend(record[name]), record.unit(name)) for name in self.detrended}
        known = [
            sensor.model_copy(update=dict(zip(("drift", "bias"), self.drifts[sensor.channel], strict=True)))
            if filtered and sensor.channel in self.drifts
            else sensor
            for sensor in sensors
        ]
        return record.with_channels(held), tuple(known)

    @property
    def note(self) -> Finding:
        """Note that names the random-walk biases."""
        drifts = {channel: drift for channel, (drift, _) in self.drifts.items()}
        units = {channel: self.units[channel] for channel in drifts}
        return Finding(
            "wandering_offsets", "note", {"channels": list(self.detrended), "drifts": drifts, "units": units}
        )

    def notes(self, outcome: Outcome, *, filtered: bool) -> tuple[Finding, ...]:
        """The note for filters; spectra use frequencies above the slow variations."""
        return (self.note,) if filtered else ()


class RandomWalkBias(Effect):
    """Random walks and trends, detected in variations slower than the structure."""

    code = "random_walk_bias"

    def find(self, job: Job, *, leaning: bool = False) -> RandomWalkBiases | None:
        """Find wandering biases in the slow part of the readings; of sensors that are sensitive to gravity if
        `leaning`."""
        at = job.condition()
        return find_random_walks(at.record, job.turbine, at.sensors, leaning=leaning)


def find_random_walks(
    record: Record, turbine: Turbine, sensors: Sequence[Sensor], *, leaning: bool = False
) -> RandomWalkBiases | None:
    """Detect random-walk biases or trends of accelerometers; those that are sensitive to gravity only if `leaning`."""
    slowest = turbine.slowest_frequency / (2.0 * np.pi)
    once = abs(turbine.rotor_speed) / (2.0 * np.pi)
    below = MAX_SLOW_SHARE * (min(slowest, once) if once > 0.0 else slowest)
    if below * record.duration < 2 * MIN_DRIFT_PERIODS:  # what is slow is the motion
        return None
    drifts, detrended = dict[str, tuple[float, float]](), list[str]()
    for group in _alike(sensors, leaning):
        found = [_wandering(record[sensor.channel], record.rate, below, slowest) for sensor in group]
        if sum(clear for clear, _ in found) < log_bound(MIN_DRIFT_LOG_ODDS, RandomWalkBias.code, turbine):
            detrended += [sensor.channel for sensor in group if _trends(record[sensor.channel])]
            continue
        for sensor, (_, drift) in zip(group, found, strict=True):
            drifts[sensor.channel] = drift, max(sensor.bias, drift * math.sqrt(INITIAL_OFFSET_SECONDS))
            detrended.append(sensor.channel)
    return RandomWalkBiases(drifts, tuple(detrended), {s.channel: s.unit for s in sensors}) if detrended else None


def _alike(sensors: Sequence[Sensor], leaning: bool) -> list[list[Accelerometer]]:
    """Accelerometers of one unit without a random walk of their own; those that are sensitive to gravity only if
    `leaning`."""
    alike: dict[str, list[Accelerometer]] = {}
    for sensor in sensors:
        if isinstance(sensor, Accelerometer) and not sensor.drift and (leaning or not sensor.feels_gravity):
            alike.setdefault(sensor.unit, []).append(sensor)
    return [*alike.values()]


def _wandering(readings: Array, rate: float, below: float, at: float) -> tuple[float, float]:
    """By how much log likelihood a random walk or flicker explains readings (T,) better below a frequency [Hz], and the
    standard deviation after one second of the random walk that is as strong at another one."""
    n = len(readings)
    first, last = MIN_DRIFT_PERIODS, int(below * n / rate)
    known = np.isfinite(readings)
    weight = np.where(known, np.sin(np.pi * (np.arange(n) + 0.5) / n) ** 2, 0.0)
    mean = float(np.sum(weight[known] * readings[known]) / weight.sum())
    power = np.abs(np.fft.rfft(weight * np.where(known, readings - mean, 0.0))[first:last]) ** 2
    power *= 2.0 / (rate * float(weight @ weight))
    if not power.min() > 0.0:
        return 0.0, 0.0
    f = np.arange(first, last) * rate / n
    others = np.stack([np.ones_like(f), (f / below) ** 2, (f / below) ** 4])
    without, _ = _explained(power, others)
    within, share = min((_explained(power, np.vstack([others, (at / f) ** n])) for n in (1, 2)), key=lambda one: one[0])
    return without - within, 2.0 * math.pi * at * math.sqrt(0.5 * float(share[-1]))


def _explained(power: Array, shapes: Array) -> tuple[float, Array]:
    """Fit a sum of spectra (K, F) to a periodogram (F,); −log likelihood, and the amount of each (K,)."""
    share = np.mean(power) / (len(shapes) * shapes.mean(axis=1))
    for _ in range(UPDATE_COUNT):
        whole = share @ shapes
        share *= (shapes @ (power / whole**2)) / (shapes @ (1.0 / whole))
    whole = share @ shapes
    return float(np.sum(np.log(whole) + power / whole)), share


def _trends(readings: Array) -> bool:
    """Test for a trend: variations of fewer than `MIN_DRIFT_PERIODS` periods much stronger than slightly faster
    ones."""
    known = np.isfinite(readings)
    terms = _slow_terms(len(readings), 4 * MIN_DRIFT_PERIODS)[:, 1:]
    share = np.linalg.lstsq(terms[known], readings[known] - np.mean(readings[known]), rcond=None)[0]
    slow, faster = np.mean(share[: 2 * MIN_DRIFT_PERIODS] ** 2), np.mean(share[2 * MIN_DRIFT_PERIODS :] ** 2)
    return bool(slow > MIN_TREND_POWER * faster)


def _without_trend(readings: Array) -> Array:
    """Readings without components of fewer than `MIN_DRIFT_PERIODS` periods in the record; their mean stays."""
    known = np.isfinite(readings)
    terms = _slow_terms(len(readings), 2 * MIN_DRIFT_PERIODS)
    share = np.linalg.lstsq(terms[known], readings[known], rcond=None)[0]
    return np.asarray(readings - terms[:, 1:] @ share[1:])


def _slow_terms(samples: int, count: int) -> Array:
    """Legendre polynomials over the record, of mean square one (T, count + 1): each turns round once more often."""
    terms = np.polynomial.legendre.legvander((2.0 * np.arange(samples) + 1.0) / samples - 1.0, count)
    return np.asarray(terms * np.sqrt(2.0 * np.arange(count + 1) + 1.0))

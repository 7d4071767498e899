"""Offsets of accelerometers that their list does not know of.

An accelerometer is easily off by some thousandths of gravity, and a structure that vibrates has no mean acceleration. A
filter that knows of no offset takes it for a load that never changes, and damping and clocks pay for it. So the mean of
the readings, weighted so that a vibration does not count, is held against the reading of the machine at rest: where
they differ by more than chance, the sensor gets an offset to be found. Spectra leave constants out anyway.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import NEGLIGIBLE_SHARE, OUTLIER_SIGMAS
from windsysid.identification.effects.regression import RegressorEffect
from windsysid.identification.effects.score_test import RegressorCandidate
from windsysid.identification.estimate.fitted.linearisation import Linearisation, RegressorColumn
from windsysid.identification.job import Job
from windsysid.identification.model.effect import Effect
from windsysid.identification.model.fit import Outcome, known_inputs
from windsysid.identification.model.prior_odds import sigma_bound
from windsysid.identification.model.regressor import Constant, Term
from windsysid.identification.model.turbine_problem import seen_by
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.sensors import Accelerometer, Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.turbine.turbine import Turbine

__all__ = ["Biases", "SensorBias", "SmallBias", "find_biases"]

SLOW_PERIODS = (1, 23)
"""Setting: periods in a record, from and to, of the slow variations that tell what chance does to a mean."""

MAX_SLOW_SHARE = 0.5
"""Setting: share of the slowest mode's frequency below which variations are slow."""

MAX_SAMPLES_AT_REST = 2000
"""Setting: samples, at most, at which the machine at rest is read."""


@dataclass(frozen=True)
class Biases:
    """Constant biases that the sensor list lacks: for each channel the mean offset of its readings, whose size is the
    prior standard deviation of the bias."""

    sizes: Mapping[str, float]
    units: Mapping[str, str]
    code: str = "sensor_bias"

    def correct(
        self, record: Record, turbine: Turbine, sensors: Sequence[Sensor], *, filtered: bool
    ) -> tuple[Record, tuple[Sensor, ...]]:
        """Give these sensors a bias to be estimated."""
        sizes = self.sizes
        return record, tuple(
            one.model_copy(update={"bias": abs(sizes[one.channel])}) if one.channel in sizes else one for one in sensors
        )

    @property
    def note(self) -> Finding:
        """Offset of the readings."""
        units = {channel: self.units[channel] for channel in self.sizes}
        return Finding("sensor_offsets", "note", {"offsets": dict(self.sizes), "units": units})

    def notes(self, outcome: Outcome, *, filtered: bool) -> tuple[Finding, ...]:
        """That the readings have a bias; spectra leave constants out."""
        return (self.note,) if filtered else ()


class SensorBias(Effect):
    """Constant biases, found in the means of the readings."""

    code = "sensor_bias"

    def find(self, job: Job) -> Biases | None:
        """Find biases in the means of the readings."""
        at = job.condition()
        return find_biases(at.record, job.turbine, at.sensors)


class SmallBias(RegressorEffect):
    """A constant in one channel that its mean alone does not show."""

    code = "bias"

    def candidates(self, at: Linearisation) -> Sequence[RegressorCandidate]:
        """One candidate for each channel whose sensor has no bias."""
        return [
            RegressorCandidate(self.code, sensor.channel, (RegressorColumn(row, Constant()),))
            for row, sensor in enumerate(at.problem.sensors)
            if not (sensor.bias or sensor.drift)
        ]

    def describe(self, terms: Sequence[Term]) -> dict[str, Any]:
        """Size of the offset."""
        (one,) = terms
        return {"size": one.size, "std": one.std}


def find_biases(record: Record, turbine: Turbine, sensors: Sequence[Sensor]) -> Biases | None:
    """Find accelerometers whose mean differs from the reading of the machine at rest by more than chance."""
    asked = [(i, s) for i, s in enumerate(sensors) if isinstance(s, Accelerometer) and not s.bias]
    if not asked or record.samples < 3:
        return None
    turbine = seen_by(turbine, sensors, [])
    inputs, turning = known_inputs(record, turbine, sensors), "rotor_azimuth" in turbine.model.inputs
    psi = np.unwrap(inputs[:, turbine.model.inputs.index("rotor_azimuth")]) if turning else np.zeros(len(inputs))
    some = slice(None, None, max(1, record.samples // MAX_SAMPLES_AT_REST))
    at_rest = _at_rest(turbine, sensors, inputs[some])
    sizes, sigmas = {}, sigma_bound(OUTLIER_SIGMAS, SensorBias.code, turbine)
    for i, sensor in asked:
        off = _mean(record[sensor.channel], psi) - _mean(at_rest[:, i], psi[some])
        chance = _chance(record[sensor.channel], record.duration * turbine.slowest_frequency / (2.0 * np.pi))
        if abs(off) > max(sigmas * chance, NEGLIGIBLE_SHARE * sensor.noise):
            sizes[sensor.channel] = off
    return Biases(sizes, {s.channel: s.unit for s in sensors}) if sizes else None


def _at_rest(turbine: Turbine, sensors: Sequence[Sensor], inputs: Array) -> Array:
    """Readings of the sensors of a turning machine with unloaded springs (T, m)."""
    compiled = compile_model(turbine.model, tuple(sensors), instruments=True)
    p = np.array([turbine.values.get(name, 0.0) for name in compiled.parameters])
    n, nw = len(compiled.states), len(compiled.loads)
    rest, nothing, rate = np.zeros(n), np.zeros(nw), np.empty(n)
    A, B, G = np.zeros((n, n)), np.zeros((n, 0)), np.zeros((n, nw))
    read = np.empty((len(inputs), len(sensors)))
    for row, out in zip(np.ascontiguousarray(inputs), read, strict=True):
        compiled.rates_jacobian(rest, row, p, nothing, rate, A, B, G)
        held = -np.linalg.solve(G[n - nw :], rate[n - nw :])
        compiled.reading(rest, row, p, held, out)
    return read


def _mean(readings: Array, psi: Array) -> float:
    """Mean without the components at 1P and 2P."""
    known, weight = _weighed(readings)
    terms = [np.ones(len(readings))]
    if abs(psi[-1] - psi[0]) > 4.0 * np.pi:
        terms += [f(n * psi) for n in (1, 2) for f in (np.cos, np.sin)]
    design = np.column_stack(terms)
    normal = design.T @ (weight[:, None] * design)
    rows = np.linalg.pinv(normal)[0] @ (weight[:, None] * design).T  # few readings do not determine every term
    return float(rows @ known)


def _chance(readings: Array, periods: float) -> float:
    """Standard deviation of a mean, from how strong slow variations are, of a record of so many periods of the slowest
    mode."""
    known, weight = _weighed(readings)
    counts = np.arange(SLOW_PERIODS[0], max(min(SLOW_PERIODS[1], MAX_SLOW_SHARE * periods), SLOW_PERIODS[0] + 1))
    mean = float(weight @ known / weight.sum())
    off, turn = weight * (known - mean), 2j * np.pi * np.arange(len(readings)) / len(readings)
    return float(np.sqrt(np.mean([abs(np.exp(count * turn) @ off) ** 2 for count in counts])) / weight.sum())


def _weighed(readings: Array) -> tuple[Array, Array]:
    """Readings, zero where they are missing, and weights that fall to zero there and at the ends, so that a truncated
    vibration adds nothing to the mean."""
    known = np.isfinite(readings)
    weight = np.sin(np.pi * (np.arange(len(readings)) + 0.5) / len(readings)) ** 2
    return np.where(known, readings, 0.0), np.where(known, weight, 0.0)

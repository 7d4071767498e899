"""Sinusoids of the readings as forces: the amplitude of each, from the innovations of a filter.

To first order, innovations change with a force as a filter that knows it says. So of each sine on each load that it may
act on, cosine and sine, a filter goes over the record once more, and least squares of the innovations on the changes
give the amplitudes: generalised least squares, as innovations are white. The forces then act in the model as measured
ones do, in addition to the loads that are not measured.

A fit without a force at nP has a part of it in masses, gains and axes. So the amplitudes of forces at nP are estimated
together with its unknowns, by Newton's step, and again if an estimate depends on that, twice at most.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import CONFLICT_SIGMAS, HARMONIC_HALF_WIDTH_BINS
from windsysid.filters import EKF
from windsysid.identification.effects.score_test import newton_step
from windsysid.identification.effects.sinusoid import Sine, phase_of, turned, ways_of, without_sines
from windsysid.identification.estimate.fitted.linearisation import Linearisation, RegressorColumn
from windsysid.identification.model.fit import PART_OF, Outcome
from windsysid.identification.model.turbine_problem import TurbineProblem
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.statespace.compose import StateSpace
from windsysid.turbine.turbine import Turbine

__all__ = ["SineForce", "Sinusoids", "find_forces", "step_of", "with_forces"]


class SineForce(NamedTuple):
    """Amplitudes of a sinusoidal force on a load: of cosine and sine, and the standard deviation of either, in the
    load's unit."""

    sine: Sine
    load: str
    unit: str
    cosine: float
    quadrature: float
    std: float

    @property
    def amplitude(self) -> float:
        """In the load's unit."""
        return math.hypot(self.cosine, self.quadrature)

    @property
    def matters(self) -> bool:
        """True if it is significant."""
        return self.amplitude > CONFLICT_SIGMAS * self.std

    @property
    def note(self) -> Finding:
        """That it is taken into account."""
        data = {
            "frequency": self.sine.frequency, "order": self.sine.order, "load": self.load, "amplitude": self.amplitude,
            "std": self.std, "unit": self.unit,
        }  # fmt: skip
        return Finding("sinusoidal_force" if self.matters else "rotor_harmonic", "note", data)


def find_forces(problem: TurbineProblem, unknowns: Array, record: Record, sines: Sequence[Sine]) -> list[SineForce]:
    """Amplitudes of sinusoidal forces.

    A sine that was seen on the support may push the blades, and the other way round: what explains more is taken.
    `unknowns` (n,), all but the clocks, are where a search of the problem that the record poses has ended.
    """
    model, psi = problem.build(unknowns), turned(record, problem.turbine, problem.sensors)
    columns, rms = model.inputs, {one.load: one.rms for one in problem.turbine.loads if one.load not in record}

    def innovations(model: StateSpace, inputs: Array) -> Array:
        return np.nan_to_num(EKF.run(model, EKF.init(model), inputs, problem.readings)[1].whitened)

    def push(sine: Sine) -> _Pushing:
        freedoms = [one for one in problem.turbine.model.freedoms if bool(one.blade) is sine.on_blades]
        loads = [(one.load, one.load_unit) for one in freedoms if one.load in rms]
        changes = []
        for load, _ in loads:
            for wave in _waves(sine, record, psi):
                inputs = problem.inputs.copy()
                inputs[:, columns.index(load)] += rms[load] * wave
                changes.append((now - innovations(model, inputs)).ravel() / rms[load])
        return _Pushing(sine, loads, np.reshape(changes, (-1, now.size)).T)

    now, pushing = innovations(model, problem.inputs), list[_Pushing]()
    for sine in sorted(sines, key=lambda one: not one.order):  # what turns is seen on the other side of the hub, too
        best = max((push(way) for way in ways_of(sine, record, psi)), key=lambda one: one.explains(now.ravel()))
        if not any(best.sine.same_as(other.sine, HARMONIC_HALF_WIDTH_BINS / record.duration) for other in pushing):
            pushing.append(best)
    C = np.hstack([one.changes for one in pushing])
    cov = np.asarray(np.linalg.pinv(C.T @ C, hermitian=True), dtype=np.float64)
    sizes = (cov @ (C.T @ now.ravel())).reshape(-1, 2)
    return _sized([(one.sine, *load) for one in pushing for load in one.loads], sizes, cov)


def step_of(
    forces: Sequence[SineForce], at: Linearisation, record: Record, precision: Array
) -> tuple[tuple[SineForce, ...], Array, Array]:
    """Forces after Newton's step of their amplitudes and the unknowns of a fit with a prior precision (n, n), by how
    much these shift (n,) [standard deviations], and what the uncertainty of forces adds to their covariance (n, n)."""
    psi, loads = turned(record, at.problem.turbine, at.problem.sensors), at.problem.model.compiled.loads
    columns = [
        RegressorColumn(at.readings.shape[1] + loads.index(one.load), lambda _, wave=wave: wave)
        for one in forces
        for wave in _waves(one.sine, record, psi)
    ]
    size, cov, shift, widening = newton_step(at, columns, precision)
    sizes = size.reshape(-1, 2) + [(one.cosine, one.quadrature) for one in forces]
    return tuple(_sized([(one.sine, one.load, one.unit) for one in forces], sizes, cov)), shift, widening


def _sized(pushed: Sequence[tuple[Sine, str, str]], sizes: Array, cov: Array) -> list[SineForce]:
    """Forces on loads with their units, of cosine and quadrature (n, 2) and the covariance of these (2 n, 2 n)."""
    spread = np.sqrt(np.diag(cov)).reshape(-1, 2).max(axis=1)
    return [
        SineForce(*one, float(cosine), float(quadrature), float(std))
        for one, (cosine, quadrature), std in zip(pushed, sizes, spread, strict=True)
    ]


class _Pushing(NamedTuple):
    """A sine, the loads that it may act on with their units, and how innovations change with cosine and sine on each
    (T m, 2 n)."""

    sine: Sine
    loads: list[tuple[str, str]]
    changes: Array

    def explains(self, innovations: Array) -> float:
        """By how much squared innovations fall, beyond chance."""
        said = self.changes.T @ innovations
        inverse = np.linalg.pinv(self.changes.T @ self.changes)
        return float(said @ inverse @ said) - float(len(said))


def _waves(sine: Sine, record: Record, psi: Array | None) -> tuple[Array, Array]:
    phase = phase_of(sine, record, psi)
    return np.cos(phase), np.sin(phase)


@dataclass(frozen=True)
class Sinusoids:
    """Sinusoids that a record holds: as waves in its readings, or as forces where their strength is known.

    A filter of a rotor senses that channels have lost what belongs together where waves are subtracted from them one by
    one; forces act in its equations. Spectra, and structures that do not turn, lose one frequency. `widenings` are what
    uncertain forces add to the covariance of a fit's unknowns; `revisions` counts how often they were estimated again.
    """

    sines: tuple[Sine, ...]
    forces: tuple[SineForce, ...] = ()
    code: str = "sinusoid"
    widenings: Mapping[str, Array] = field(default_factory=dict, compare=False)
    revisions: int = 0

    def correct(
        self, record: Record, turbine: Turbine, sensors: Sequence[Sensor], *, filtered: bool
    ) -> tuple[Record, tuple[Sensor, ...]]:
        """Subtract the waves from the readings, or add the forces to the loads."""
        if filtered and self.forces:
            return with_forces(record, self.forces, turned(record, turbine, sensors)), tuple(sensors)
        return self.left(record, turbine, sensors), tuple(sensors)

    def left(self, record: Record, turbine: Turbine, sensors: Sequence[Sensor]) -> Record:
        """The record without the waves."""
        return without_sines(record, turbine, sensors, [one.sine for one in self.forces] or self.sines)

    def notes(self, outcome: Outcome, *, filtered: bool) -> tuple[Finding, ...]:
        """Detected forces."""
        if not (filtered and self.forces):
            return tuple(sine.note for sine in self.sines)
        sure = [force for force in self.forces if force.matters]
        known = {0, *(force.sine.order for force in sure)}
        first = {one.sine.order: one for one in reversed(self.forces) if one.sine.order not in known}
        return (*(force.note for force in sure), *(first[order].note for order in sorted(first)))


def with_forces(record: Record, forces: Sequence[SineForce], psi: Array | None) -> Record:
    """The record with forces added to its loads; its rotor has the azimuth ψ (T,)."""
    for one in forces:
        cosine, sine = _waves(one.sine, record, psi)
        part = PART_OF + one.load
        measured = np.nan_to_num(record[part]) if part in record else 0.0
        push = measured + one.cosine * cosine + one.quadrature * sine
        record = record.with_channels({part: (push, one.unit)})
    return record

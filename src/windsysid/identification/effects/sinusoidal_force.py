"""Sinusoids of the readings as forces: the amplitude of each, from the innovations of a filter.

To first order, innovations change with a force as a filter that knows it says. So of each sine on each load that it may
act on, cosine and sine, a filter goes over the record once more, and least squares of the innovations on the changes
tell the amplitudes: generalised least squares, as innovations are white. The forces then act in the model as measured
ones do, in addition to the loads that are not measured.

What turns with the rotor turns as gravity and imbalance do. A search without the force has taken a part of it for
masses, gains and axes that are off, within their tolerances, and would never give that back. So of sines at nP these
tolerances are additional unknowns besides the amplitudes, held by their priors, and coefficients move with them as the
search says; innovations count as far as they repeat in every turn.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import CONFLICT_SIGMAS, HARMONIC_HALF_WIDTH_BINS
from windsysid.filters import EKF
from windsysid.filters.bank import bank_of, run_bank
from windsysid.identification.effects.sinusoid import Sine, phase_of, turned, ways_of, without_sines
from windsysid.identification.estimate.scoring import BANK_THREADS
from windsysid.identification.estimate.time_domain import where_it_ended
from windsysid.identification.model.fit import PART_OF, Outcome
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import TurbineProblem, pose
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.statespace.compose import StateSpace
from windsysid.turbine.turbine import Turbine

__all__ = ["SineForce", "Sinusoids", "find_forces", "forces_of", "with_forces"]


STEP_SIGMAS = 0.5
"""Numerical: width of the slopes of innovations, in standard deviations of a tolerance."""

MAX_HARMONIC = 8
"""Setting: harmonics nP by which innovations that repeat in every turn are detected."""


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


def find_forces(
    problem: TurbineProblem, unknowns: Array, record: Record, sines: Sequence[Sine], *, along: Array, at: Array
) -> list[SineForce]:
    """Amplitudes of sinusoidal forces.

    A sine that was seen on the support may push the blades, and the other way round: what explains more is taken.

    Parameters
    ----------
    unknowns
        Where a search of the problem has ended, all but the clocks (n,).
    record
        The one that poses the problem.
    along, at
        How the unknowns move with each tolerance (n, t), and where the search has put these (t,), in standard
        deviations of their priors.
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
    free, turning = ([one for one in pushing if bool(one.sine.order) is turns] for turns in (False, True))
    found = _amplitudes(free, now.ravel(), np.empty((now.size, 0)), np.empty(0))
    if turning and psi is not None:
        slopes = [
            now - one for one in _innovations(problem, [unknowns + STEP_SIGMAS * direction for direction in along.T])
        ]
        repeats = _turns_again(psi)
        again = [one._replace(changes=_again(repeats, one.changes.T, now.shape)) for one in turning]
        found += _amplitudes(again, (repeats @ now).ravel(), _again(repeats, slopes, now.shape) / STEP_SIGMAS, at)
    return found


def forces_of(
    sines: Sequence[Sine], near: Outcome, record: Record, turbine: Turbine, sensors: Sequence[Sensor], prior: Prior,
    chosen: Sequence[str] | None = None,
) -> list[SineForce]:  # fmt: skip
    """Amplitudes of sinusoidal forces at the end of a search, on any record, with any priors."""
    problem = pose(record, turbine, sensors, prior, chosen, near.hypothesis)
    mean, known, of = where_it_ended(near, problem), near.unknowns, problem.unknowns.of
    at = mean[of("tolerances")]
    along = np.zeros((len(mean), len(at)))
    along[of("tolerances")] = np.eye(len(at))
    if near.joint_cov is not None and len(at):
        own = known.of("tolerances")
        along[of("parameters")] = near.joint_cov[known.of("parameters"), own] @ np.linalg.inv(near.joint_cov[own, own])
    return find_forces(problem, mean, record, sines, along=along, at=at)


def _innovations(problem: TurbineProblem, points: Sequence[Array]) -> list[Array]:
    """Of filters side by side at several unknowns (T, m), zero where a reading is missing."""
    if not points:
        return []
    with ThreadPoolExecutor(BANK_THREADS) as pool:
        scores = run_bank(bank_of([problem.build(one) for one in points]), problem.inputs, problem.readings, pool)[1]
    return [np.nan_to_num(one) for one in np.moveaxis(scores.whitened, -1, 0)]


def _turns_again(psi: Array) -> Array:
    """Part of values (T, m) that repeats in every turn, as coefficients of orthonormal waves (2K + 1, T)."""
    waves = [wave for order in range(1, MAX_HARMONIC + 1) for wave in (np.cos(order * psi), np.sin(order * psi))]
    return np.asarray(np.linalg.qr(np.column_stack([np.ones(len(psi)), *waves]))[0].T)


def _again(repeats: Array, changes: Sequence[Array] | Array, shape: tuple[int, ...]) -> Array:
    """Part of n changes of shape (T, m) that repeats in every turn (K, n)."""
    found = [(repeats @ np.reshape(change, shape)).ravel() for change in changes]
    return np.column_stack(found) if found else np.empty((len(repeats) * shape[1], 0))


def _amplitudes(pushing: "Sequence[_Pushing]", innovations: Array, slopes: Array, at: Array) -> list[SineForce]:
    """Amplitudes of forces, by least squares of innovations (K,) on their changes with the forces, and with
    tolerances (K, t) that are held by their priors, where a search has put them (t,)."""
    if not pushing:
        return []
    C = np.hstack([*(one.changes for one in pushing), slopes])
    first = C.shape[1] - len(at)
    known = np.diag(np.concatenate([np.zeros(first), np.ones(len(at))]))
    cov = np.linalg.pinv(C.T @ C + known, hermitian=True)
    size = cov @ (C.T @ innovations - known @ np.concatenate([np.zeros(first), at]))
    sizes, spread = size[:first].reshape(-1, 2), np.sqrt(np.diag(cov)[:first]).reshape(-1, 2).max(axis=1)
    pushed = [(one.sine, *load) for one in pushing for load in one.loads]
    return [
        SineForce(sine, load, unit, float(cosine), float(quadrature), float(e))
        for (sine, load, unit), (cosine, quadrature), e in zip(pushed, sizes, spread, strict=True)
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
    one; forces act in its equations. Spectra, and structures that do not turn, lose one frequency.
    """

    sines: tuple[Sine, ...]
    forces: tuple[SineForce, ...] = ()
    code: str = "sinusoid"

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

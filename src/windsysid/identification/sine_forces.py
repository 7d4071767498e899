"""Sines of the readings as forces: how strongly each pushes, from the innovations of a filter.

To first order, innovations change with a force as a filter that knows it says. So of each sine on each load that it may
act on, cosine and sine, a filter goes over the record once more, and least squares of the innovations on the changes
tell the amplitudes: generalised least squares, as innovations are white. The forces then act in the model as measured
ones do, beside the loads that nobody measured.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.filters import EKF
from windsysid.identification.outcome import PART_OF
from windsysid.identification.problem import TurbineProblem
from windsysid.identification.steady_lines import APART, Sine, phase_of, turned, ways_of
from windsysid.records.record import Record

__all__ = ["SineForce", "find_forces", "with_forces"]


SURE = 4.0
"""Standard deviations from which on a force is told: one in 3000 of chance is larger."""


class SineForce(NamedTuple):
    """How strongly a sine pushes on a load: what of cosine and of sine, and the standard deviation of either, in the
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
        """Whether it is surely there."""
        return self.amplitude > SURE * self.std

    def __str__(self) -> str:
        at, cause = f"{self.sine.frequency:.4g} Hz", "a machine"
        if self.sine.order:
            at = f"{self.sine.order}P"
            cause = "an imbalance of the rotor" if self.sine.order == 1 else "what turns with the rotor"
        return (
            f"{self.load} has a steady sine of {self.amplitude:.2g} ± {2.0 * self.std:.1g} {self.unit} at {at}: "
            f"likely {cause}; the estimates take it into account"
        )


def find_forces(problem: TurbineProblem, unknowns: Array, record: Record, sines: Sequence[Sine]) -> list[SineForce]:
    """How strongly sines push, at unknowns of a problem that a record poses.

    A sine that was seen on the support may push the blades, and the other way round: what explains more is taken.
    """
    model, psi = problem.build(unknowns), turned(record, problem.turbine, problem.sensors)
    columns, rms = model.inputs, {load.load: load.rms for load in problem.turbine.loads}

    def innovations(inputs: Array) -> Array:
        return np.nan_to_num(EKF.run(model, EKF.init(model), inputs, problem.readings)[1].whitened).ravel()

    def push(sine: Sine) -> _Pushing:
        freedoms = [one for one in problem.turbine.model.freedoms if bool(one.blade) is sine.on_blades]
        loads = [(one.load, one.load_unit) for one in freedoms if one.load in rms]
        changes = []
        for load, _ in loads:
            for wave in _waves(sine, record, psi):
                inputs = problem.inputs.copy()
                inputs[:, columns.index(load)] += rms[load] * wave
                changes.append((now - innovations(inputs)) / rms[load])
        return _Pushing(sine, loads, np.reshape(changes, (-1, len(now))).T)

    now, found = innovations(problem.inputs), list[_Pushing]()
    for sine in sines:
        best = max((push(way) for way in ways_of(sine, record, psi)), key=lambda one: one.explains(now))
        if not any(best.sine.same_as(other.sine, APART / record.duration) for other in found):
            found.append(best)
    C = np.hstack([one.changes for one in found])
    cov = np.linalg.pinv(C.T @ C)
    size, std = (cov @ (C.T @ now)).reshape(-1, 2), np.sqrt(np.diag(cov)).reshape(-1, 2).max(axis=1)
    pushed = [(one.sine, *load) for one in found for load in one.loads]
    return [
        SineForce(sine, load, unit, float(cosine), float(quadrature), float(e))
        for (sine, load, unit), (cosine, quadrature), e in zip(pushed, size, std, strict=True)
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


def with_forces(record: Record, forces: Sequence[SineForce], psi: Array | None) -> Record:
    """The record with forces as measured parts of its loads; its rotor has the azimuth ψ (T,)."""
    parts: dict[str, Array] = {}
    for one in forces:
        cosine, sine = _waves(one.sine, record, psi)
        push = one.cosine * cosine + one.quadrature * sine
        parts[one.load] = parts.get(one.load, np.zeros(record.samples)) + push
    units = {one.load: one.unit for one in forces}
    return record.with_channels({PART_OF + load: (push, units[load]) for load, push in parts.items()})

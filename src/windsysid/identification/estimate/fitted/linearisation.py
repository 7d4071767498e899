"""A fit as a linear model: its standardised innovations z, and how they change with its unknowns and with regressors.

With regressors D φ in the readings the innovations are, to first order,

    z(θ̂ + δ, φ) = z + J_θ δ − J φ,   J = ∂z/∂(D φ),

J_θ from filters at neighbouring unknowns, J from changes of the readings that one filter carries along
(`windsysid.filters.bank`). The sums that tests of φ need are added up over chunks of samples: memory is bounded.
"""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.filters.bank import LANES, bank_of, run_bank
from windsysid.identification.estimate.clock_lag import shifted
from windsysid.identification.estimate.scoring import BANK_THREADS, CHUNK_SAMPLES, DIFFERENCE_STEP_SIGMAS, neighbours
from windsysid.identification.estimate.time_domain import where_it_ended
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.limits import MIN_SHIFT_SIGMAS, NEGLIGIBLE_SHIFT_SIGMAS
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.regressor import Waveform, widening_of
from windsysid.identification.model.turbine_problem import TurbineProblem, pose

__all__ = ["Linearisation", "RegressorColumn", "RegressorSums", "linearise"]


class RegressorColumn(NamedTuple):
    """A waveform in one reading, by its index, or in a load, counted after the readings."""

    row: int
    wave: Waveform


class RegressorSums(NamedTuple):
    """Information of innovations on c columns.

    Attributes
    ----------
    gradient
        Jᵀ z (c,).
    information
        Jᵀ J (c, c).
    mixed
        J_θᵀ J (n, c).
    fisher
        Information on the unknowns at the same point (n, n): a fit has that of its last evaluation.
    energy
        Σ J² of each reading (m, c).
    """

    gradient: Array
    information: Array
    mixed: Array
    fisher: Array
    energy: Array


@dataclass(frozen=True)
class Linearisation:
    """A fit of filters as a linear model.

    Attributes
    ----------
    problem
        What was fitted.
    time
        Of the samples (T,) [s].
    readings, inputs
        As the filter reads them (T, m), (T, n_u + n_w); NaN where missing.
    unknowns, cov
        Of the fit, clocks left out (n,), (n, n).
    innovations
        Standardised (T, m); 0 where a reading is missing.
    steps
        Samples for each reading.
    """

    problem: TurbineProblem
    time: Array
    readings: Array
    inputs: Array
    unknowns: Array
    cov: Array
    innovations: Array
    steps: int = 1

    @property
    def channels(self) -> tuple[str, ...]:
        """Of the readings (m,)."""
        return tuple(sensor.channel for sensor in self.problem.sensors)

    @property
    def held(self) -> "Linearisation":
        """Sums with all unknowns fixed, at a fraction of the cost."""
        return replace(self, cov=np.zeros((0, 0)))

    def depends_on(self, shift: Array) -> bool:
        """Test whether a shift (n,) [standard deviations] changes an estimate, or the rest beyond the range of a
        first-order approximation."""
        off = np.abs(shift)
        return bool(off[: len(self.problem.parameters)].max() > MIN_SHIFT_SIGMAS or off.max() > NEGLIGIBLE_SHIFT_SIGMAS)

    def sums(self, columns: Sequence[RegressorColumn]) -> RegressorSums:
        """Add up the information of the innovations on columns."""
        n, m, c = len(self.cov), self.readings.shape[1], len(columns)
        widths = DIFFERENCE_STEP_SIGMAS * np.sqrt(np.diag(self.cov))
        beside = bank_of([self.problem.build(one) for one in neighbours(self.unknowns, widths)])
        along = bank_of([self.problem.build(self.unknowns)] * LANES, -(-c // LANES))
        waves = np.array([column.wave(self.time) for column in columns])
        total = RegressorSums(np.zeros(c), np.zeros((c, c)), np.zeros((n, c)), np.zeros((n, n)), np.zeros((m, c)))
        with ThreadPoolExecutor(BANK_THREADS) as pool:
            for first in range(0, len(self.time), CHUNK_SAMPLES):
                part = slice(first, first + CHUNK_SAMPLES)
                of = self.inputs[part], self.readings[part]
                beside, near = run_bank(beside, *of, pool)
                along, far = run_bank(along, *of, pool, self._changes(columns, waves[:, part]), respond=True)
                z = near.whitened[..., 0]
                J = far.responses.reshape(*z.shape, -1)[..., :c]
                slopes, of_log_std = ((one[..., 1:] - one[..., :1]) / widths for one in near[:2])
                moved = np.concatenate([slopes, math.sqrt(2.0) * of_log_std], axis=1)
                total = RegressorSums(
                    total.gradient + np.einsum("tmc,tm->c", J, z),
                    total.information + J.reshape(-1, c).T @ J.reshape(-1, c),
                    total.mixed + np.einsum("tmn,tmc->nc", slopes, J, optimize=True),
                    total.fisher + np.tensordot(moved, moved, axes=((0, 1), (0, 1))),
                    total.energy + np.einsum("tmc,tmc->mc", J, J),
                )
        return total

    def _changes(self, columns: Sequence[RegressorColumn], waves: Array) -> Array:
        """Changes of readings and loads with each column, in the lanes of a bank (T, m + n_w, ⌈c/LANES⌉, LANES)."""
        rows = self.readings.shape[1] + len(self.problem.model.compiled.loads)
        changes = np.zeros((waves.shape[1], rows, -(-len(columns) // LANES), LANES))
        for k, (column, wave) in enumerate(zip(columns, waves, strict=True)):
            known = column.row >= self.readings.shape[1]  # a filter that knows a load has less left, not more
            changes[:, column.row, k // LANES, k % LANES] = -wave if known else wave
        return changes


def linearise(job: Job, fit: FittedJob) -> Linearisation | None:
    """Linearise a fit of filters; None where its innovations do not belong to its samples."""
    outcome = fit.outcome
    if fit.formulation != "joint" or outcome.joint_cov is None or len(outcome.final.whitened) != fit.read.samples:
        return None
    at = job.resampled()
    problem = pose(at.record, job.turbine, at.sensors, job.prior or Prior(), job.parameters, outcome.hypothesis)
    unknowns = where_it_ended(outcome, problem)
    n = len(unknowns)
    clocks = [one.estimate / one.spread for one in outcome.tolerances][len(outcome.tolerances) - len(problem.clocks) :]
    ((inputs, readings),) = shifted(problem, [(problem.inputs, problem.readings)], np.array(clocks))
    readings = readings.copy()
    readings[:: at.steps][outcome.final.gated] = np.nan
    cov, innovations = outcome.joint_cov[:n, :n] - widening_of(job.effects, n), np.nan_to_num(outcome.final.whitened)
    return Linearisation(problem, at.record.time, readings, inputs, unknowns, cov, innovations, at.steps)

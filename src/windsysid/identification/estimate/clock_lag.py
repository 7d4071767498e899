"""Clock lags: readings shifted in time, and the information of the record on the shift.

A reading that came κ seconds late is moved by D(κ) = e^{κG}, G a derivative of the band in which the structure moves:
an antisymmetric convolution, so that D is orthogonal, white noise stays white and no Jacobian enters the likelihood. A
shift is no function of past readings alone. The squared slopes of the innovations, whose sum is the information on what
a model's numbers are (`windsysid.identification.estimate.scoring`), would therefore count noise for information: of
readings that are nothing but noise they find Σ (G y)². The curvature itself is taken instead,

    ∂² log L / ∂κ²  from the log-likelihood at −w, 0 and w,

and ∂² log L / ∂κ ∂θ from how far the filters of a look go with the change G y of the readings (`Lateness`).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.filters import EKF
from windsysid.identification.condition.samples import Block, Samples
from windsysid.identification.estimate.scoring import MAX_STEP_SIGMAS, Look, Score
from windsysid.identification.model.problem import Problem
from windsysid.records.record import Record
from windsysid.statespace.compose import StateSpace

__all__ = [
    "ClockInformation", "Lateness", "Shifted", "Widened", "add_clocks", "advance", "clock_information", "derivative",
    "put_on_time", "shifted",
]  # fmt: skip

STOP_EDGE_FACTOR, PASS_EDGE_FACTOR = 2.7, 2.0
"""Setting: edge of the band that is shifted, and up to where all of it passes, in highest natural frequencies."""

HALF_LENGTH_RADIANS = 24.0
"""Numerical: half-length of the convolution, in samples, times the edge in radians per sample."""

DIFFERENCE_STEP_SIGMAS = 0.2
"""Numerical: width of the differences, in standard deviations of a clock's tolerance."""


@dataclass(frozen=True)
class Shifted:
    """Samples whose late readings have been moved to when they were taken.

    Attributes
    ----------
    samples
        As they were recorded.
    late
        By how much each reading is late (m,) [s].
    steps
        The sampling intervals that occur (S,) [s].
    edge
        Of the band [rad/s] that is moved.
    """

    samples: Samples
    late: Array
    steps: Array
    edge: float

    def __iter__(self) -> Iterator[Block]:
        for inputs, readings in self.samples:
            if not self.late.any():
                yield inputs, readings
                continue
            time = self.time(inputs)
            moved = readings.copy()
            for column in np.flatnonzero(self.late):
                moved[:, column] = advance(time, readings[:, column], float(self.late[column]), self.edge)
            yield inputs, moved

    def time(self, inputs: Array) -> Array:
        """When the samples of a block with inputs (T, n_u + n_w) were taken (T,) [s], from any moment on."""
        step = self.steps[inputs[:, -1].astype(np.int64)] if self.steps.size > 1 else self.steps[0]
        return np.cumsum(np.broadcast_to(step, len(inputs)))

    def later(self, late: Array) -> "Shifted":
        """Sensors with readings that are so much later (m,) [s]."""
        return Shifted(self.samples, self.late + late, self.steps, self.edge)


@dataclass(frozen=True)
class Lateness:
    """Derivatives of the readings of samples to c clock lags.

    Attributes
    ----------
    samples
        Whose blocks come.
    clocks
        For each clock, by how much readings (m,) are late [s] at one standard deviation of its tolerance.
    """

    samples: Shifted
    clocks: Sequence[Array]

    @property
    def count(self) -> int:
        """The number of clocks."""
        return len(self.clocks)

    def of(self, inputs: Array, readings: Array, /) -> Array:
        """Derivative of so late readings (T, m) to their lags (T, m, c)."""
        time, late = self.samples.time(inputs), np.array(self.clocks)
        slopes = np.zeros(readings.shape)
        for column in np.flatnonzero(late.any(axis=0)):
            slopes[:, column] = derivative(time, readings[:, column], self.samples.edge)
        return slopes[:, :, None] * late.T


def shifted(problem: Problem, samples: Samples, clocks: Array) -> Shifted:
    """Samples with clock lags (c,) [standard deviations] corrected."""
    late = np.zeros(1)
    for value, one in zip(clocks, problem.clocks, strict=True):
        late = late + value * one
    middle = problem.prior[0]
    edge = STOP_EDGE_FACTOR * 2.0 * math.pi * max(problem.frequencies(middle), default=0.0)
    return Shifted(samples, late, problem.build(middle).blocks.step, edge)


def put_on_time(record: Record, late: Mapping[str, float], highest: float) -> Record:
    """Record with lagged channels corrected by so many seconds, as far as they are slower than modes up to the highest
    natural frequency [rad/s] need."""
    moved = {
        name: (advance(record.time, record[name], seconds, STOP_EDGE_FACTOR * highest), record.unit(name))
        for name, seconds in late.items()
        if seconds
    }
    return record.with_channels(moved) if moved else record


def advance(time: Array, values: Array, seconds: float, edge: float) -> Array:
    """Values (T,) with a lag of so many seconds, interpolated to the times (T,) [s]; NaN stay where they are."""
    found = np.asarray(values, dtype=np.float64).copy()
    term = values
    for order in range(1, 4):  # e^{κG} to third order: a shift is a small part of a period
        term = derivative(time, term, edge) * seconds / order
        found += term
    return found


def derivative(time: Array, values: Array, edge: float) -> Array:
    """The rate of change of values (T,) at times (T,) [s] as far as it is slower than `edge` [rad/s]; NaN where they
    are."""
    there = np.isfinite(values)
    found = np.full(len(values), np.nan)
    if there.sum() < 3:
        found[there] = 0.0
        return found
    t, y = time[there], values[there]
    step = float(np.median(np.diff(t)))
    grid = t[0] + step * np.arange(round((t[-1] - t[0]) / step) + 1)
    even = np.interp(grid, t, y)
    corner = min(edge * step, math.pi)
    half = min(math.ceil(HALF_LENGTH_RADIANS / corner), len(even) - 1)
    n = np.arange(1, half + 1)
    ideal = (corner * np.cos(corner * n) - np.sin(corner * n) / n) / (math.pi * n)
    taps = ideal * np.kaiser(2 * half + 1, 6.0)[half + 1 :]
    kernel = np.concatenate([taps[::-1], [0.0], -taps]) / step
    around = np.concatenate([2.0 * even[0] - even[half:0:-1], even, 2.0 * even[-1] - even[-2 : -half - 2 : -1]])
    found[there] = np.interp(t, grid, np.convolve(around, kernel[::-1], mode="valid"))
    return found


class Widened(NamedTuple):
    """The posterior with clocks.

    Attributes
    ----------
    mean, cov
        Of all unknowns.
    moved
        The squared length of the step of the other unknowns, in their standard deviations.
    """

    mean: Array
    cov: Array
    moved: float


def add_clocks(problem: Problem, samples: Shifted, seen: Look, at: Array) -> Widened:
    """The mode and the covariance of all unknowns, clocks included, one step from where a search has looked last.

    Parameters
    ----------
    samples
        With the shift that the search saw.
    seen
        Its last look at the other unknowns (n,), and at the `Lateness` of the samples.
    at
        The clocks (c,) in the shift that the search saw.
    """
    prior, clocks, known = problem.wide_prior, problem.clocks, problem.unknowns
    others, late = known.but("clocks"), known.of("clocks")
    said = clock_information(problem.build(seen.theta), samples, seen.found, clocks)
    information = np.linalg.inv(prior[1])
    pull = seen.found.gradient - information @ (seen.theta - prior[0])
    cov = _joint_covariance(seen.found.fisher + information, said.mixed, said.curvature + np.eye(len(clocks)))
    step = cov @ np.concatenate([pull, said.gradient - at])
    step *= min(1.0, MAX_STEP_SIGMAS / float(np.abs(step[late]).max()))
    moved = float(step[others] @ np.linalg.solve(cov[np.ix_(others, others)], step[others]))
    return Widened(np.concatenate([seen.theta, at]) + step, cov, moved)


class ClockInformation(NamedTuple):
    """Information of readings on c clock lags, in standard deviations of their tolerances.

    Attributes
    ----------
    gradient, curvature
        Of the log-likelihood (c,), and its negative second derivatives (c, c).
    mixed
        Those to the other unknowns and to clocks (n, c).
    """

    gradient: Array
    curvature: Array
    mixed: Array


def clock_information(here: StateSpace, samples: Shifted, found: Score, clocks: Sequence[Array]) -> ClockInformation:
    """Information on clock lags from an evaluation with the model `here`; clocks as for `add_clocks`."""

    def likelihood(late: Array) -> float:
        belief, total = EKF.init(here), 0.0
        for inputs, readings in samples.later(late):
            belief, info = EKF.run(here, belief, inputs, readings)
            total += float(info.log_likelihood.sum())
        return total

    middle = found.log_likelihood
    above, below = ([likelihood(sign * DIFFERENCE_STEP_SIGMAS * one) for one in clocks] for sign in (1.0, -1.0))
    gradient = np.array([up - down for up, down in zip(above, below, strict=True)]) / (2.0 * DIFFERENCE_STEP_SIGMAS)
    curvature = (
        np.diag([2.0 * middle - up - down for up, down in zip(above, below, strict=True)]) / DIFFERENCE_STEP_SIGMAS**2
    )
    for i in range(len(clocks)):
        for j in range(i):
            both = likelihood(DIFFERENCE_STEP_SIGMAS * (clocks[i] + clocks[j]))
            curvature[i, j] = curvature[j, i] = (above[i] + above[j] - middle - both) / DIFFERENCE_STEP_SIGMAS**2
    return ClockInformation(gradient, curvature, found.mixed)


def _joint_covariance(A: Array, mixed: Array, curvature: Array) -> Array:
    """The inverse of [[A, M], [Mᵀ, C]]; the Schur complement of A cannot be less than the prior's information."""
    by = np.linalg.solve(A, mixed)
    values, axes = np.linalg.eigh(curvature - mixed.T @ by)
    left = (axes / np.maximum(values, 1.0)) @ axes.T
    return np.asarray(np.block([[np.linalg.inv(A) + by @ left @ by.T, -by @ left], [-left @ by.T, left]]))

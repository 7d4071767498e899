"""Least-squares merging of mode shapes of several records, which need not have the same sensors.

Record s has the ratios ρ_s(c) = φ(c)/φ(l_s) of the shape φ in its sensors c to its largest l_s, with their covariance.
The most probable φ, 1 in one sensor, follows by least squares (Gauss and Newton); sensors that records have in common
scale one on the other.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex

__all__ = ["MergedShape", "Ratios", "merge_shapes"]

MAX_ITERATIONS, STEP_TOLERANCE = 20, 1e-9
"""Numerical tolerance: iterations of Gauss and Newton's method, and the step at which they have converged."""

MIN_RATIO_STD = 1e-6
"""Numerical tolerance: smallest standard deviation of a ratio."""


class Ratios(NamedTuple):
    """Shape of one record: sensors (n,) as indices among all, ratios (n,) with 1 in the largest, and the covariance
    (2 n, 2 n) of their real parts and then their imaginary ones."""

    place: NDArray[np.int64]
    ratio: Complex
    cov: Array


class MergedShape(NamedTuple):
    """Shape (N,), 1 in its largest sensor, its covariance (2 N, 2 N), and the misfit of the records: weighted sum of
    squares and its degrees of freedom."""

    shape: Complex
    cov: Array
    misfit: float
    freedom: int


def merge_shapes(records: Sequence[Ratios], sensors: int) -> MergedShape:
    """Merge the shapes of records into one in all N sensors, each of which must be in a record."""
    phi = _start(records, sensors)
    fixed = int(np.argmax(np.abs(phi)))
    phi = phi / phi[fixed]
    free = np.array([c for c in range(sensors) if c != fixed], dtype=np.int64)
    weights = [_weight(one) for one in records]
    for _ in range(MAX_ITERATIONS):
        normal, vector = np.zeros((2 * len(free), 2 * len(free))), np.zeros(2 * len(free))
        misfit, rows = 0.0, 0
        for one, weight in zip(records, weights, strict=True):
            slope, off = _linear(one, phi, free)
            normal += slope.T @ weight @ slope
            vector += slope.T @ weight @ off
            misfit += float(off @ weight @ off)
            rows += len(off)
        if not len(free):
            break
        step = np.linalg.solve(normal, vector)
        phi[free] += step[: len(free)] + 1j * step[len(free) :]
        if np.max(np.abs(step)) < STEP_TOLERANCE:
            break
    cov = np.zeros((2 * sensors, 2 * sensors))
    at = np.concatenate([free, free + sensors])
    cov[np.ix_(at, at)] = np.linalg.inv(normal)
    shape, cov = _scaled(phi, cov)
    return MergedShape(shape, cov, misfit, rows - 2 * len(free))


def _start(records: Sequence[Ratios], sensors: int) -> Complex:
    """Start value of the shape: scale one record after the other to those before it."""
    phi = np.full(sensors, np.nan, dtype=np.complex128)
    phi[records[0].place] = records[0].ratio
    waiting = list(records[1:])
    while waiting:
        shared = [np.isfinite(phi[one.place]) for one in waiting]
        k = int(np.argmax([float(np.sum(np.abs(one.ratio[s]) ** 2)) for one, s in zip(waiting, shared, strict=True)]))
        one, common = waiting.pop(k), shared[k]
        known, own = phi[one.place[common]], one.ratio[common]
        scale = np.vdot(own, known) / max(float(np.vdot(own, own).real), 1e-30)
        phi[one.place[~common]] = scale * one.ratio[~common]
    return phi


def _linear(one: Ratios, phi: Complex, free: NDArray[np.int64]) -> tuple[Array, Array]:
    """Derivatives (2 (n − 1), 2 N_f) of a record's ratios by the free elements of φ, and residuals."""
    largest = int(np.argmax(np.abs(one.ratio)))
    others = np.array([i for i in range(len(one.place)) if i != largest], dtype=np.int64)
    base = phi[one.place[largest]]
    expected = phi[one.place[others]] / base
    slope = np.zeros((len(others), len(phi)), dtype=np.complex128)
    slope[np.arange(len(others)), one.place[others]] = 1.0 / base
    slope[:, one.place[largest]] = -expected / base
    slope = slope[:, free]
    off = one.ratio[others] - expected
    return np.block([[slope.real, -slope.imag], [slope.imag, slope.real]]), np.concatenate([off.real, off.imag])


def _weight(one: Ratios) -> Array:
    """Inverse covariance of the ratios without the largest."""
    n, largest = len(one.place), int(np.argmax(np.abs(one.ratio)))
    kept = np.array([i for i in range(2 * n) if i % n != largest], dtype=np.int64)
    cov = one.cov[np.ix_(kept, kept)] + MIN_RATIO_STD**2 * np.eye(len(kept))
    return np.asarray(np.linalg.inv(cov))


def _scaled(phi: Complex, cov: Array) -> tuple[Complex, Array]:
    """Scale the shape to 1 in its largest sensor, with its covariance."""
    n, largest = len(phi), int(np.argmax(np.abs(phi)))
    shape = phi / phi[largest]
    slope = np.eye(n, dtype=np.complex128) / phi[largest]
    slope[:, largest] -= shape / phi[largest]
    both = np.block([[slope.real, -slope.imag], [slope.imag, slope.real]])
    return shape, both @ cov @ both.T

"""A cloud of weighted particles and what is read off it."""

import math
from typing import Any, NamedTuple

import numba.experimental.function_type  # noqa: F401  registers the type of an address; else only compiling does
import numpy as np
from numba import types
from numpy.typing import ArrayLike, NDArray

from windsysid._types import Array
from windsysid.filters.particles.kernels import (
    rows_kernel,
)
from windsysid.filters.particles.resampling import normalised
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.workspace import workspace

__all__ = ["Cloud", "address", "weighted_quantiles"]


class Cloud(NamedTuple):
    """State of a particle filter between two samples, from which it continues.

    Attributes
    ----------
    particles
        States (n, N).
    log_weights
        Logarithms of the weights (N,), not normalised.
    centre
        Reference point of the sums for moments (n,), near the particles.
    inputs
        Inputs at the cloud's own time (n_u + n_w,).
    samples
        Number of samples so far; 0 for the prior.
    """

    particles: Array
    log_weights: Array
    centre: Array
    inputs: Array
    samples: int

    @property
    def weights(self) -> Array:
        """Normalised weights (N,)."""
        return normalised(self.log_weights)

    @property
    def mean(self) -> Array:
        """Mean of the state (n,)."""
        return np.asarray(self.particles @ self.weights)

    @property
    def cov(self) -> Array:
        """Covariance of the state (n, n)."""
        away = self.particles - self.mean[:, None]
        return np.asarray((away * self.weights) @ away.T)

    @property
    def effective(self) -> float:
        """Effective sample size, 1 … N."""
        return float(1.0 / np.sum(self.weights**2))

    def quantiles(self, probabilities: ArrayLike) -> Array:
        """Weighted quantiles of every state (len(probabilities), n)."""
        return weighted_quantiles(self.particles, self.weights, probabilities)


def weighted_quantiles(values: Array, weights: Array, probabilities: ArrayLike) -> Array:
    """Quantiles (p, n) of weighted values (n, N) with weights (N,).

    A quantile is the least value whose cumulative weight reaches the probability.
    """
    p = np.atleast_1d(np.asarray(probabilities, dtype=np.float64))
    out = np.empty((p.size, len(values)))
    for j, row in enumerate(values):
        order = np.argsort(row, kind="stable")
        reached = np.cumsum(weights[order])
        at = np.searchsorted(reached, p * reached[-1] * (1.0 - 1e-12))
        out[:, j] = row[order[np.minimum(at, row.size - 1)]]
    return out


def semidefinite_root(cov: Array) -> Array:
    """L lower triangular with L Lᵀ = `cov`, which may be singular."""
    n = len(cov)
    scale = np.sqrt(np.diag(cov))
    L = np.zeros((n, n))
    for j in range(n):
        column = cov[j:, j] - L[j:, :j] @ L[j, :j]
        if column[0] > 1e-14 * scale[j] ** 2:
            L[j:, j] = column / math.sqrt(column[0])
    return L


def reflected(values: Array, low: float, high: float) -> Array:
    """Values that stepped over a bound, folded back inside."""
    values = np.where(values < low, 2.0 * low - values, values) if math.isfinite(low) else values
    values = np.where(values > high, 2.0 * high - values, values) if math.isfinite(high) else values
    return np.clip(values, low, high)


def linear_entries(model: StateSpace) -> NDArray[np.int64] | None:
    """Linear part of a model without motion: (reading, state) of its coefficients, ordered; None where it
    is not.

    It is tried at random points, where only linear functions pass.
    """
    if any(q.logarithmic for q in model.parameters):
        return None
    rng = np.random.default_rng(0)
    compiled, blocks = model.compiled, model.blocks
    inputs = rng.standard_normal((3, len(model.inputs)))
    inputs[:, len(compiled.inputs) + len(compiled.loads) :] = 0.0  # which interval
    for u in inputs:
        one, two = rng.standard_normal((2, len(model.parameters)))
        values = []
        for theta in (np.zeros_like(one), one, two, one + two, 2.0 * one - two):
            p, y = blocks.p.copy(), np.zeros(len(model.readings))
            p[blocks.chosen] = blocks.reference * theta
            compiled.reading(
                np.empty(0),
                u[: len(compiled.inputs)].copy(),
                p,
                u[len(compiled.inputs) :][: len(compiled.loads)].copy(),
                y,
            )
            values.append(y)
        zero, a, b, both, mixed = values
        size = np.abs(values).max(axis=0, initial=0.0) + 1e-300
        if np.any(np.abs(both - a - b + zero) > 1e-9 * size) or np.any(np.abs(mixed - 2.0 * a + b) > 1e-9 * size):
            return None
    rows = np.empty((3, len(model.readings), len(model.states) + 1))
    rows_kernel()(compiled.reading_jacobian, blocks, workspace(blocks), inputs, rows)
    return np.ascontiguousarray(np.argwhere((rows[:, :, :-1] != 0.0).any(axis=0)), dtype=np.int64)


class _Address(types.WrapperAddressProtocol):  # type: ignore[misc]
    """The address of a compiled function, to be passed as an argument.

    Numba looks up a dispatcher's address in every call, which takes longer than a short block.
    """

    def __init__(self, function: Any, kind: Any) -> None:
        compiled = function.get_compile_result(kind)
        self.address = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name)
        self.kind, self.function = kind, function

    def __wrapper_address__(self) -> int:
        return int(self.address)

    def signature(self) -> Any:
        return self.kind


def address(function: Any, kind: Any) -> Any:
    """A model's compiled function as a typed pointer, made once for each function."""
    found = _addresses.get(id(function))
    if found is None:
        found = _addresses[id(function)] = _Address(function, kind)
    return found


_addresses: dict[int, _Address] = {}  # kept with their functions, so that no identity is used twice

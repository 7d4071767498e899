"""What Gaussian filters share: the belief, the information that comes out of a step, the protocol, and the scalar update.

A measurement of m readings with independent noise is taken in one reading at a time, which needs no matrix to be
inverted and lets a missing reading (NaN) simply be left out. The covariance update is Joseph's form written out for a
scalar reading,

    P ← (I − K h) P (I − K h)ᵀ + K r Kᵀ = P − K vᵀ − v Kᵀ + s K Kᵀ,     v = P hᵀ,  s = h v + r,  K = v / s.

Source: Särkkä & Svensson, Bayesian Filtering and Smoothing (2nd ed.), ch. 6; Bucy & Joseph (1968).
"""

import math
import threading
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid.jit import pasted
from windsysid.rows import inner, multiply
from windsysid.simd import LANES, lanes_sum, load, splat, store
from windsysid.statespace import StateSpace

__all__ = [
    "ARGUMENTS",
    "Belief",
    "Filter",
    "Info",
    "assimilate",
    "assimilate_sample",
    "close_belief",
    "compare",
    "empty_info",
    "keep",
    "open_belief",
]

Array = NDArray[np.float64]


_scratch = threading.local()


class Belief(NamedTuple):
    """What a Gaussian filter knows between two samples: all that is needed to go on.

    Attributes
    ----------
    mean
        (n,).
    cov
        (n, n).
    inputs
        Inputs at the belief's own time (n_u + n_w,).
    samples
        How many sample times it has reached; 0 for the prior, which the first sample finds where it is.
    """

    mean: Array
    cov: Array
    inputs: Array
    samples: int


class Info(NamedTuple):
    """What came out of T samples.

    Attributes
    ----------
    mean, std
        Mean and standard deviation of the state after each sample (T, n).
    innovation, innovation_std
        Reading minus its expectation, and the standard deviation it should have (T, m), both before anything of the sample is
        taken in; NaN where the reading is missing.
    whitened
        Innovations decorrelated and scaled to unit variance (T, m); NaN where missing or gated.
    whitening_std
        What they were divided by (T, m): the standard deviation of a reading given the past and the readings before it
        in the same sample.
    log_likelihood
        Log density of the readings of each sample given the past (T,), those gated left out.
    gated
        Readings left out because the innovation was beyond the model's gate (T, m), as bool.
    """

    mean: Array
    std: Array
    innovation: Array
    innovation_std: Array
    whitened: Array
    whitening_std: Array
    log_likelihood: Array
    gated: NDArray[np.bool_]


def empty_info(samples: int, n: int, m: int) -> Info:
    """Room for what comes out of T samples of m readings and n states; nothing gated."""
    state, reading = (samples, n), (samples, m)
    return Info(
        np.empty(state), np.empty(state), np.empty(reading), np.empty(reading), np.empty(reading), np.empty(reading),
        np.empty(samples), np.zeros(reading, dtype=np.bool_),
    )  # fmt: skip


@dataclass(frozen=True)
class Filter:
    """The filter protocol: pure functions; a new belief and its `Info` come out, nothing is changed in place.

    `step` is `predict` and `update`, and `run` is `step` over T samples: batch, stream and restart agree bit for bit.

    Attributes
    ----------
    name
        In words.
    kernel
        For a model, the compiled filter: a function of `ARGUMENTS`.
    """

    name: str
    kernel: Callable[[StateSpace], Callable[..., None]]

    def init(self, model: StateSpace) -> Belief:
        """The prior of the model as a belief that no sample has reached yet."""
        return Belief(model.mean.copy(), model.cov.copy(), np.zeros(len(model.inputs)), 0)

    def predict(self, model: StateSpace, belief: Belief, inputs: Array) -> Belief:
        """The belief at the time of `inputs` (n_u + n_w,), one sample on; the first prediction stays at the prior."""
        nothing = np.full((1, len(model.readings)), np.nan)
        return self._filter(model, belief, np.atleast_2d(inputs), nothing)[0]

    def update(self, model: StateSpace, belief: Belief, readings: Array) -> tuple[Belief, Info]:
        """The belief after readings (m,) taken at its own time."""
        return self._filter(model, belief, belief.inputs[None], np.atleast_2d(readings), moves=False)[:2]

    def step(self, model: StateSpace, belief: Belief, inputs: Array, readings: Array) -> tuple[Belief, Info]:
        """Filter one sample: `run` over inputs (n_u + n_w,) and readings (m,)."""
        return self.run(model, belief, np.atleast_2d(inputs), np.atleast_2d(readings))

    def run(self, model: StateSpace, belief: Belief, inputs: Array, readings: Array) -> tuple[Belief, Info]:
        """Filter T samples.

        Parameters
        ----------
        belief
            Where to start: `init` of the model, or the belief an earlier run ended with.
        inputs
            Known inputs and known loads at each sample (T, n_u + n_w).
        readings
            (T, m); NaN = missing.

        Returns
        -------
        belief, info
            The belief after the last sample, and what came out of each.

        Raises
        ------
        ValueError
            If a shape does not fit the model.
        """
        return self._filter(model, belief, inputs, readings)[:2]

    def run_with_covariances(
        self, model: StateSpace, belief: Belief, inputs: Array, readings: Array
    ) -> tuple[Belief, Info, Array]:
        """As `run`, and the covariance after each sample (T, n, n)."""
        return self._filter(model, belief, inputs, readings, keep=True)

    def _kept(self, model: StateSpace) -> Callable[..., None]:
        """The kernel with its scratch, which each thread makes once for a model: a step costs less than its scratch."""
        kernels: dict[str, Callable[..., None]] = _scratch.__dict__
        key = f"{self.name} of {id(model)}"
        if key not in kernels:
            kernels[key] = self.kernel(model)
            weakref.finalize(model, kernels.pop, key, None).atexit = False
        return kernels[key]

    def _filter(
        self,
        model: StateSpace,
        belief: Belief,
        inputs: Array,
        readings: Array,
        *,
        moves: bool = True,
        keep: bool = False,
    ) -> tuple[Belief, Info, Array]:
        inputs = np.require(inputs, np.float64, ["C", "W"])
        readings = np.require(readings, np.float64, ["C", "W"])
        samples, n, m = len(inputs), len(model.states), len(model.readings)
        if inputs.shape != (samples, len(model.inputs)) or readings.shape != (samples, m):
            raise ValueError(
                f"expected inputs (T, {len(model.inputs)}) and readings (T, {m}), got {inputs.shape} and {readings.shape}"
            )
        mean, cov = belief.mean.copy(), belief.cov.copy()
        covs = np.empty((samples if keep else 0, n, n))
        info = empty_info(samples, n, m)
        self._kept(model)(mean, cov, belief.inputs, inputs, readings, belief.samples > 0, moves, covs, *info)
        last = inputs[-1].copy() if samples else belief.inputs
        return Belief(mean, cov, last, belief.samples + (samples if moves else 0)), info, covs


_vector, _matrix, _cube = types.float64[::1], types.float64[:, ::1], types.float64[:, :, ::1]
ARGUMENTS = (
    _vector, _matrix, _vector, _matrix, _matrix, types.boolean, types.boolean,
    _cube, _matrix, _matrix, _matrix, _matrix, _matrix, _matrix, _vector, types.boolean[:, ::1],
)  # fmt: skip
"""Numba's types of what every filter's kernel takes after the model.

Mean and covariance, which it moves in place; the inputs at their own time; inputs and readings of T samples; whether the
mean has been moved to a sample's time before, and whether it moves now; the covariances to be kept (T or 0, n, n); and the
fields of `Info`."""


@pasted
def open_belief(ws: Any, mean: Any, cov: Any) -> None:
    """Begin a run: `mean` (n,) and `cov` (n, n) into ``ws.mean`` and ``ws.cov``, whose rows are whole vectors."""
    for i in range(mean.size):
        ws.mean[i] = mean[i]
        for j in range(mean.size):
            ws.cov[i, j] = cov[i, j]


@pasted
def close_belief(ws: Any, mean: Any, cov: Any) -> None:
    """End a run: ``ws.mean`` and ``ws.cov`` into `mean` (n,) and `cov` (n, n)."""
    for i in range(mean.size):
        mean[i] = ws.mean[i]
        for j in range(mean.size):
            cov[i, j] = ws.cov[i, j]


@pasted
def compare(ws: Any, blocks: Any, readings: Any, innovation: Any, innovation_std: Any, gated: Any) -> None:
    """Innovations (m,) of a linearised reading, their standard deviations, and which of them are beyond the gate."""
    multiply(ws.nothing, ws.H, 0, readings.size, 0, ws.cov.shape[0], ws.cov, ws.spread)
    for c in range(readings.size):
        innovation[c] = readings[c] - ws.y[c]
        innovation_std[c] = np.nan
        if np.isnan(readings[c]):
            continue
        innovation_std[c] = math.sqrt(blocks.noise[c] + inner(ws.H, c, ws.spread, c))
        gated[c] = abs(innovation[c]) > blocks.gate[0] * innovation_std[c]


@pasted
def assimilate_sample(ws: Any, blocks: Any, readings: Any, gated: Any, whitened: Any, whitening_std: Any) -> float:
    """Take in a sample's readings, linearised at ``ws.about``, one after the other; the log density that they had."""
    vectors = ws.about.size // LANES
    total = 0.0
    for c in range(readings.size):
        whitened[c] = np.nan
        whitening_std[c] = np.nan
        if np.isnan(readings[c]) or gated[c]:
            continue
        moved = splat(0.0)
        for i in range(vectors):
            moved = moved + load(ws.H, c * vectors + i) * (load(ws.mean, i) - load(ws.about, i))
        z, std = assimilate(ws, c, readings[c] - ws.y[c] - lanes_sum(moved), blocks.noise[c])
        whitened[c] = z
        whitening_std[c] = std
        total -= 0.5 * (math.log(2.0 * math.pi) + z * z) + math.log(std)
    return total


@pasted
def keep(mean: Any, cov: Any, k: int, means: Any, stds: Any, covs: Any) -> None:
    """Make the covariance symmetric to the last digit and keep what sample `k` has ended with."""
    n = means.shape[1]
    for i in range(n):
        for j in range(i):
            cov[i, j] = cov[j, i]
        means[k, i] = mean[i]
        stds[k, i] = np.sqrt(cov[i, i])
    if covs.shape[0] > 0:
        for i in range(n):
            for j in range(n):
                covs[k, i, j] = cov[i, j]


@pasted
def assimilate(ws: Any, c: int, residual: float, variance: float) -> tuple[float, float]:
    """Take in reading `c`, row c of ``ws.H`` its derivative h, into ``ws.mean`` and ``ws.cov``.

    `residual` is its deviation from the expectation at the current mean. Returns the whitened innovation and the standard deviation it
    was divided by.
    """
    n, vectors = ws.cov.shape[0], ws.cov.shape[1] // LANES
    v, K, pulled, mean, cov = ws.spread, ws.K, ws.pulled, ws.mean, ws.cov
    multiply(ws.nothing, ws.H, c, c + 1, 0, n, cov, v)
    s = variance + inner(ws.H, c, v, c)
    scale, size, step = splat(1.0 / s), splat(s), splat(residual)
    for i in range(vectors):
        along = load(v, c * vectors + i)
        gain = along * scale
        store(K, i, gain)
        store(pulled, i, size * gain - along)
        store(mean, i, load(mean, i) + gain * step)
    # P − K vᵀ + (s K − v) Kᵀ
    for j in range(vectors):
        along, gain = load(v, c * vectors + j), load(K, j)
        for i in range(n):
            at = i * vectors + j
            store(cov, at, load(cov, at) + splat(pulled[0, i]) * gain - splat(K[0, i]) * along)
    root = math.sqrt(s)
    return residual / root, root

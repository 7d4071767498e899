"""The particle filter: sequential importance resampling, on anything that is composed.

The belief is N particles with log-weights, no Gaussian. For every sample

    resample  where the effective sample size N_eff = (Σw)² / Σw² has fallen below a share of N
    predict   x ← f(x, η) particle by particle, η drawn: motion by values alone, loads, biases and parameters that walk
    update    log w ← log w + log p(y | x),     log p(y_k | y_1 …) = log Σ w − log Σ w before.

Parameters do not move, so resampling alone leaves ever fewer values of them. They are therefore drawn anew from a kernel around their
ancestors, shrunk towards the mean so that mean and covariance V of the cloud stay what they are (Liu & West),

    θ ← a θ + (1 − a) θ̄ + h V^½ ε,     a = (3δ − 1) / 2δ,     h² = 1 − a²,

where a plain random walk would add variance without end. Where nothing moves but the parameters, a sample that says too much at once is taken in
by parts, p(y | x)^φ with Σφ = 1, resampling in between (tempering).

The random numbers are counted, not drawn in turn (`windsysid.filters.philox`): the result depends on the seed and on nothing else, however many
threads there are. Particles go through a block of samples in chunks, as if no resampling were due; where one was, the block is taken back and
run again to that sample, to the same digits.

Source: Chopin & Papaspiliopoulos, An Introduction to Sequential Monte Carlo (2020), ch. 10 and 17; Liu & West, in Sequential Monte Carlo
Methods in Practice (2001), ch. 10; Gordon, Salmond & Smith, IEE Proceedings F 140(2), 1993.
"""

import math
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from numba import types
from numpy.typing import ArrayLike, NDArray

from windsysid.errors import ConfigurationError
from windsysid.filters.particlekernels import (
    CHUNK,
    advance_kernel,
    combine_kernel,
    renew_kernel,
    rows_kernel,
    sums_kernel,
    temper_kernel,
)
from windsysid.filters.philox import Purpose, key_of, normals, uniforms
from windsysid.filters.resampling import Resampling, ancestors, check_resampling, normalised
from windsysid.jit import VALUE
from windsysid.statespace import StateSpace
from windsysid.transition import Workspace, workspace

__all__ = ["Cloud", "ParticleFilter", "ParticleInfo", "degeneracy", "liu_west", "weighted_quantiles"]

Array = NDArray[np.float64]

LONGEST = 512
"""Most samples that are taken through a chunk at once."""

MOST_SUMS = 1 << 14
"""Most rows of sums that a block leaves: samples times chunks."""

WORTH_A_THREAD = 100_000
"""Particles times samples below which one thread does it all."""

AHEAD = 4096
"""Samples whose rows of a linear model are computed together."""

MOST_PARTS = 200
"""Most parts that a sample is taken in by; then the rest at once."""

FEW = 10.0
"""Effective particles below which an estimate rests on next to nothing."""


_NO_ENTRIES = np.empty((0, 2), dtype=np.int64)


class Cloud(NamedTuple):
    """What a particle filter knows between two samples.

    Attributes
    ----------
    particles
        States (n, N).
    log_weights
        (N,), not normalised.
    centre
        About where the particles are (n,): what moments are summed about.
    inputs
        Inputs at the cloud's own time (n_u + n_w,).
    samples
        How many sample times it has reached; 0 for the prior.
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


class ParticleInfo(NamedTuple):
    """What came out of T samples: the fields of `windsysid.filters.Info`, then how the particles fared.

    Each innovation is whitened by its own standard deviation, mixture and noise together, and not decorrelated from the others of its sample;
    `whitening_std` is `innovation_std`, and nothing is ever gated.

    Attributes
    ----------
    effective
        Effective sample size after each sample (T,).
    resamplings
        How often the particles were resampled for each sample (T,).
    survivors
        The fewest particles that had descendants at one of them (T,); N where there was none.
    """

    mean: Array
    std: Array
    innovation: Array
    innovation_std: Array
    whitened: Array
    whitening_std: Array
    log_likelihood: Array
    gated: NDArray[np.bool_]
    effective: Array
    resamplings: NDArray[np.int64]
    survivors: NDArray[np.int64]


@dataclass(frozen=True)
class ParticleFilter:
    """Sequential importance resampling with the protocol of `windsysid.filters.Filter`: init, predict, update, step, run.

    Beliefs are `Cloud`s; `step` is `run` with one sample, bit for bit, and results do not depend on the number of threads.

    Attributes
    ----------
    particles
        N.
    seed
        0 … 2⁶⁴ − 1.
    resampling
        ``"systematic"``, ``"stratified"`` or ``"residual"``.
    threshold
        Share of N below which the effective sample size makes the filter resample.
    discount
        δ of Liu and West's kernel for biases and parameters, ⅓ < δ ≤ 1; 1 draws nothing anew. The default suits posteriors with one
        summit, as coefficients have; where there may be several, 0.99 keeps them apart, and takes more particles.
    tempering
        Whether, where only parameters are unknown, a sample may be taken in by parts.
    freedom
        Degrees of freedom of Student t sensors, for all or by channel; a sensor's noise is then the scale of its distribution. Gaussian by
        default.
    bounds
        Least and greatest value in SI of parameters that have any: the prior is truncated there, and nothing is drawn beyond.
    threads
        As many as there are processors, by default.

    Raises
    ------
    ConfigurationError
        If an option is out of range.
    """

    particles: int = 2000
    seed: int = 0
    resampling: Resampling = "systematic"
    threshold: float = 0.5
    discount: float = 0.6
    tempering: bool = True
    freedom: float | Mapping[str, float] = math.inf
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    threads: int | None = None
    name: str = "particle filter"

    def __post_init__(self) -> None:
        check_resampling(self.resampling)
        degrees = self.freedom.values() if isinstance(self.freedom, Mapping) else (self.freedom,)
        for what, expected, good, got in (
            ("particles", "2 or more", self.particles >= 2, self.particles),
            ("seed", "0 … 2⁶⁴ − 1", 0 <= self.seed < 2**64, self.seed),
            ("threshold", "a share of the particles, 0 … 1", 0.0 <= self.threshold <= 1.0, self.threshold),
            ("discount", "more than 1/3 and at most 1", 1.0 / 3.0 < self.discount <= 1.0, self.discount),
            ("degrees of freedom", "positive numbers", all(nu > 0.0 for nu in degrees), self.freedom),
            ("bounds", "each least < greatest", all(a < b for a, b in self.bounds.values()), dict(self.bounds)),
            ("threads", "1 or more", self.threads is None or self.threads >= 1, self.threads),
        ):
            if not good:
                raise ConfigurationError(f"particle filter: {what}: expected {expected}, got {got}")

    def init(self, model: StateSpace) -> Cloud:
        """Particles of the model's Gaussian prior, truncated to the bounds, that no sample has reached yet."""
        n = len(model.states)
        z = normals(self.seed, 0, Purpose.START, n, self.particles)
        std = np.sqrt(np.diag(model.cov))
        particles = model.mean[:, None] + semidefinite_root(model.cov) @ z
        for i, (low, high) in self.bounds_of(model).items():
            from scipy.special import ndtr, ndtri

            least, greatest = ndtr((np.array([low, high]) - model.mean[i]) / std[i])
            particles[i] = np.clip(model.mean[i] + std[i] * ndtri(least + ndtr(z[i]) * (greatest - least)), low, high)
        return self.cloud(model, particles)

    def cloud(self, model: StateSpace, particles: ArrayLike) -> Cloud:
        """Particles (n, N) drawn from any other prior as a belief that no sample has reached yet."""
        given = np.array(particles, dtype=np.float64, order="C")
        if given.shape != (len(model.states), self.particles) or not np.isfinite(given).all():
            raise ConfigurationError(
                f"particles: expected {len(model.states)} × {self.particles} finite numbers, got shape {given.shape}"
            )
        return Cloud(given, np.zeros(self.particles), given.mean(axis=1), np.zeros(len(model.inputs)), 0)

    def predict(self, model: StateSpace, belief: Cloud, inputs: Array) -> Cloud:
        """The cloud at the time of `inputs` (n_u + n_w,), one sample on; the first prediction stays at the prior."""
        return self._filter(model, belief, np.atleast_2d(inputs), np.full((1, len(model.readings)), np.nan))[0]

    def update(self, model: StateSpace, belief: Cloud, readings: Array) -> tuple[Cloud, ParticleInfo]:
        """The cloud after readings (m,) taken at its own time."""
        return self._filter(model, belief, belief.inputs[None], np.atleast_2d(readings), moves=False)

    def step(self, model: StateSpace, belief: Cloud, inputs: Array, readings: Array) -> tuple[Cloud, ParticleInfo]:
        """Filter one sample: `run` over inputs (n_u + n_w,) and readings (m,)."""
        return self.run(model, belief, np.atleast_2d(inputs), np.atleast_2d(readings))

    def run(self, model: StateSpace, belief: Cloud, inputs: Array, readings: Array) -> tuple[Cloud, ParticleInfo]:
        """Filter T samples: inputs (T, n_u + n_w) and readings (T, m), NaN = missing.

        Raises
        ------
        ValueError
            If a shape does not fit the model.
        ConfigurationError
            If the model has a gate, or an option names what the model has not.
        """
        return self._filter(model, belief, inputs, readings)

    def quantile_history(
        self, model: StateSpace, belief: Cloud, inputs: Array, readings: Array, *, every: int = 100,
        probabilities: ArrayLike = (0.02275, 0.5, 0.97725),
    ) -> tuple[Cloud, ParticleInfo, Array]:  # fmt: skip
        """As `run`, and the weighted quantiles of the state after each `every` samples (T // every, probabilities, n)."""
        parts, quantiles = [], []
        for first in range(0, max(len(inputs), 1), every):
            part = slice(first, first + every)
            belief, info = self.run(model, belief, inputs[part], readings[part])
            parts.append(info)
            if len(info.log_likelihood) == every:
                quantiles.append(belief.quantiles(probabilities))
        shape = (len(quantiles), np.size(probabilities), len(model.states))
        joined = ParticleInfo(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
        return belief, joined, np.reshape(quantiles, shape)

    def _filter(
        self, model: StateSpace, belief: Cloud, inputs: Array, readings: Array, *, moves: bool = True
    ) -> tuple[Cloud, ParticleInfo]:
        inputs = np.ascontiguousarray(inputs, dtype=np.float64)
        readings = np.ascontiguousarray(readings, dtype=np.float64)
        samples, n, m = len(inputs), len(model.states), len(model.readings)
        if inputs.shape != (samples, len(model.inputs)) or readings.shape != (samples, m):
            raise ValueError(
                f"expected inputs (T, {len(model.inputs)}) and readings (T, {m}), got {inputs.shape} and {readings.shape}"
            )
        if np.isfinite(model.blocks.gate[0]):
            raise ConfigurationError("gate: a particle filter has none: give `freedom`, for sensors with outliers")
        run = _Run(self, model, belief, moves)
        states, missing = (samples, n), np.full((samples, m), np.nan)
        info = ParticleInfo(
            np.empty(states), np.empty(states), missing, missing.copy(), missing.copy(), missing.copy(), np.empty(samples),
            np.zeros((samples, m), dtype=np.bool_), np.empty(samples), np.zeros(samples, dtype=np.int64), np.full(samples, self.particles),
        )  # fmt: skip
        run.through(inputs, readings, info)
        last = inputs[-1].copy() if samples else belief.inputs
        reached = belief.samples + (samples if moves else 0)
        return Cloud(run.particles, run.log_weights, run.centre, last, reached), info

    def bounds_of(self, model: StateSpace) -> dict[int, tuple[float, float]]:
        """Bounds in filter coordinates, by the number of the state."""
        found = {}
        first = model.parameter_block.start
        names = [q.name for q in model.parameters]
        for name, (low, high) in self.bounds.items():
            if name not in names:
                raise ConfigurationError(f"bounds: '{name}' is not identified: expected some of {', '.join(names)}")
            q = model.parameters[names.index(name)]
            least = -math.inf if q.logarithmic and low <= 0.0 else q.coordinate(low)
            found[first + names.index(name)] = (least, q.coordinate(high))
        return found

    def _freedom_of(self, model: StateSpace) -> Array:
        """Degrees of freedom of each reading (m,)."""
        if not isinstance(self.freedom, Mapping):
            return np.full(len(model.readings), float(self.freedom))
        unknown = set(self.freedom) - set(model.readings)
        if unknown:
            raise ConfigurationError(
                f"degrees of freedom: no reading '{min(unknown)}': expected some of {', '.join(model.readings)}"
            )
        return np.array([self.freedom.get(name, math.inf) for name in model.readings])


def weighted_quantiles(values: Array, weights: Array, probabilities: ArrayLike) -> Array:
    """Quantiles of weighted values (n, N) with weights (N,): the least value whose share of weight reaches the probability, (p, n)."""
    p = np.atleast_1d(np.asarray(probabilities, dtype=np.float64))
    out = np.empty((p.size, len(values)))
    for j, row in enumerate(values):
        order = np.argsort(row, kind="stable")
        reached = np.cumsum(weights[order])
        at = np.searchsorted(reached, p * reached[-1] * (1.0 - 1e-12))
        out[:, j] = row[order[np.minimum(at, row.size - 1)]]
    return out


def liu_west(values: Array, weights: Array, chosen: NDArray[np.int64], noise: Array, discount: float) -> Array:
    """Resampled values (n, N) drawn anew from kernels around their ancestors, mean and covariance kept.

    `weights` (N,) are those before resampling, normalised, `chosen` (N,) the ancestors, `noise` (n, N) standard normal.
    """
    out = np.empty_like(values)
    a = (3.0 * discount - 1.0) / (2.0 * discount)
    renew_kernel()(weights, a, chosen, np.ascontiguousarray(noise), np.ascontiguousarray(values), out)
    return out


class Options(Protocol):
    """What resampling asks of a filter's options."""

    @property
    def seed(self) -> int: ...
    @property
    def resampling(self) -> Resampling: ...
    @property
    def discount(self) -> float: ...


def resample(
    options: Options, values: Array, log_weights: Array, number: int, part: int = 0
) -> tuple[NDArray[np.int64], Array]:
    """The ancestors (N,) of the next particles, and their static values (n, N), drawn anew where a kernel is asked for."""
    weights = normalised(log_weights)
    points = uniforms(options.seed, number, Purpose.ANCESTORS, weights.size, part)
    chosen = ancestors(weights, points, options.resampling)
    if options.discount == 1.0 or not len(values):
        return chosen, values[:, chosen]
    noise = normals(options.seed, number, Purpose.KERNEL, len(values), weights.size, part)
    return chosen, liu_west(values, weights, chosen, noise, options.discount)


def survivors(chosen: NDArray[np.int64]) -> int:
    """How many particles had descendants: ancestors come in order."""
    return 1 + int(np.count_nonzero(np.diff(chosen)))


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


class Fared(Protocol):
    """What is known of how particles fared, (T,) each."""

    @property
    def effective(self) -> Array: ...
    @property
    def resamplings(self) -> NDArray[np.int64]: ...
    @property
    def survivors(self) -> NDArray[np.int64]: ...


def degeneracy(info: Fared) -> str:
    """How the particles fared, in a sentence or two that a reader can act on."""
    count = int(info.survivors.max(initial=0)) if not info.resamplings.all() else 0
    count = max(count, int(np.ceil(info.effective.max(initial=0.0))))
    times, samples = int(info.resamplings.sum()), len(info.effective)
    worst = int(np.argmin(info.effective)) if samples else 0
    thin = int(np.argmin(info.survivors)) if samples else 0
    text = (
        f"resampled {times} times in {samples} samples; effective sample size {np.median(info.effective):.0f} of {count} in the median, "
        f"{info.effective[worst]:.0f} at the least (sample {worst}); {info.survivors[thin]} particles had descendants at the worst resampling "
        f"(sample {thin})"
    )
    poor = float(np.mean(info.effective < FEW))
    if poor > 0.01:
        return (
            f"degenerate: {text}. {100.0 * poor:.0f} % of the estimates rest on fewer than {FEW:.0f} particles: the readings say more at a time "
            "than so many particles can resolve; take more, marginalise the states (RaoBlackwellised), or use a Kalman filter"
        )
    if info.effective[worst] < FEW or info.survivors[thin] < FEW:
        return f"thin: {text}. What was forgotten there does not come back: repeat with another seed and compare, take more particles or a narrower prior"
    return f"healthy: {text}"


class _Run:
    """One call of `run`: the particles as they go through the samples, in arrays of its own."""

    def __init__(self, options: ParticleFilter, model: StateSpace, belief: Cloud, moves: bool) -> None:
        self.options, self.model, self.moves = options, model, moves
        nx, nz, nb, nt, _, _ = (int(size) for size in model.blocks.sizes)
        self.particles, self.log_weights, self.centre = (array.copy() for array in belief[:3])
        self.inputs, self.reached = belief.inputs, belief.samples
        self.count = self.log_weights.size
        self.static = slice(nx + nz, nx + nz + nb + nt)
        self.renews = options.discount < 1.0 and nb + nt > 0
        self.tempers = options.tempering and self.renews and nx + nz == 0
        self.changes = nx + nz > 0 or bool((model.blocks.walk > 0.0).any())
        self.entries = linear_entries(model) if nx + nz == 0 else None
        self.functions = _address(model.compiled.rates, VALUE), _address(model.compiled.reading, VALUE)
        self.rows, self.rows_first = np.empty((0, len(model.readings), len(model.states) + 1)), 0
        self.bounds, self.freedom = options.bounds_of(model), options._freedom_of(model)
        inverse = np.where(self.freedom > 2.0, 1.0 / self.freedom, np.nan)
        self.noise = model.blocks.noise / (
            1.0 - 2.0 * inverse
        )  # a Student t distribution has more variance than its scale says
        self.peak = _log_peak(model.blocks.noise, self.freedom)
        self.least = options.threshold * self.count
        self.key = key_of(options.seed)
        chunks = -(-self.count // CHUNK)
        threads = min(options.threads or _processors(), chunks)
        self.shares = [(i * chunks // threads, (i + 1) * chunks // threads) for i in range(threads)]
        self.spaces = [workspace(model.blocks) for _ in self.shares]
        self.longest = max(4, min(LONGEST, MOST_SUMS // chunks))

    def through(self, inputs: Array, readings: Array, info: ParticleInfo) -> None:
        """Take all samples in, block by block, and fill `info`."""
        first, since, gap, samples = 0, 0, 0, len(inputs)
        resamples_first = self.moves and not self.tempers
        effective = self._summed()["effective"][0] if resamples_first else np.inf
        while first < samples:
            if resamples_first and self.reached > 0 and effective < self.least:
                info.survivors[first] = self._resample(self.reached, 0)
                info.resamplings[first] = 1
            # as far as before to the next resampling, then in small blocks: what lies beyond it is computed in vain
            least = 1 if self.changes else 8
            length = min(max(least, 3 * gap // 4 - since, gap // 8, since - 2 * gap), self.longest)
            block = slice(first, min(first + length, samples))
            kept = self.particles.copy() if self.changes else self.particles, self.log_weights.copy()
            found = self._advance(inputs, readings, block)
            poor = np.flatnonzero(found["effective"][1:] < self.least)
            whole = block.stop - first
            valid = whole if not poor.size else int(poor[0]) + (0 if self.tempers else 1)
            _write(info, found, first, min(valid + 1, whole), self)
            if valid < whole:
                self.particles, self.log_weights = kept
                if valid:
                    self._advance(inputs, readings, slice(first, first + valid))
            effective = found["effective"][valid]
            self._reach(inputs, first, valid)
            first, since = first + valid, since + valid
            if self.tempers and poor.size:
                self._take_in_by_parts(inputs, readings, info, first)
                self._reach(inputs, first, 1)
                first += 1
            if poor.size:
                since, gap = 0, since

    def _reach(self, inputs: Array, first: int, samples: int) -> None:
        if samples:
            self.inputs = inputs[first + samples - 1]
            self.reached += samples if self.moves else 0

    def _advance(self, inputs: Array, readings: Array, block: slice, *, moves: bool | None = None) -> dict[str, Array]:
        """Take particles and log-weights through a block without resampling; what is known before its first sample and after each."""
        samples, (n, m) = block.stop - block.start, (len(self.particles), len(self.noise))
        rows = self._rows(inputs, block)
        chunks = self.shares[-1][1]
        sums = np.empty((1 + samples, chunks, 3 + 2 * n + 2 * m))
        number = self.reached if self.moves else self.reached - 1
        entries = _NO_ENTRIES if self.entries is None else self.entries
        moving = self.moves if moves is None else moves

        def run(share: tuple[int, int], space: Workspace) -> None:
            advance_kernel()(
                *self.functions, self.model.blocks, space, self.key, number, *share, self.reached > 0, moving, self.particles, self.log_weights,
                self.centre, self.inputs, inputs[block], readings[block], self.freedom, rows, entries, sums,
            )  # fmt: skip

        if len(self.shares) > 1 and self.count * samples * (50 if self.changes else 1) > WORTH_A_THREAD:
            list(pool().map(run, self.shares, self.spaces))
        else:
            run((0, chunks), self.spaces[0])
        found = self._combined(sums, samples)
        found["off"][np.isnan(readings[block])] = np.nan
        return found

    def _rows(self, inputs: Array, block: slice) -> Array:
        """What a linear model reads at a block's samples; nothing for others."""
        if self.entries is None:
            return self.rows
        if not (self.rows_first <= block.start and block.stop <= self.rows_first + len(self.rows)):
            ahead = inputs[block.start : max(block.stop, block.start + AHEAD)]
            self.rows, self.rows_first = np.empty((len(ahead), *self.rows.shape[1:])), block.start
            rows_kernel()(self.model.compiled.reading_jacobian, self.model.blocks, self.spaces[0], ahead, self.rows)
        return self.rows[block.start - self.rows_first : block.stop - self.rows_first]

    def _summed(self) -> dict[str, Array]:
        """What is known of particles and log-weights as they are."""
        n, m = len(self.particles), len(self.noise)
        sums = np.empty((1, self.shares[-1][1], 3 + 2 * n + 2 * m))
        sums_kernel()(self.particles, self.log_weights, self.centre, sums)
        return self._combined(sums, 0)

    def _combined(self, sums: Array, samples: int) -> dict[str, Array]:
        n, m = len(self.particles), len(self.noise)
        found = {
            "log_total": np.empty(1 + samples), "effective": np.empty(1 + samples), "mean": np.empty((1 + samples, n)),
            "variance": np.empty((1 + samples, n)), "off": np.empty((samples, m)), "off_variance": np.empty((samples, m)),
        }  # fmt: skip
        combine_kernel()(sums, self.centre, *found.values())
        return found

    def _take_in_by_parts(self, inputs: Array, readings: Array, info: ParticleInfo, k: int) -> None:
        """Sample `k` in as many parts as keep the effective sample size up, resampled in between."""
        sample = slice(k, k + 1)
        if self.moves and self.changes:
            self._advance(inputs, np.full_like(readings, np.nan), sample)
        number = self.reached if self.moves else self.reached - 1
        self.inputs = inputs[k]
        left, total, part, found = 1.0, 0.0, 0, self._summed()
        while True:
            before, self.log_weights = self.log_weights, np.zeros(self.count)
            self._advance(inputs, readings, sample, moves=False)
            likelihoods, self.log_weights = self.log_weights, before
            share = left if part == MOST_PARTS else temper_kernel()(before, likelihoods, left, self.least)
            self.log_weights = before + share * likelihoods
            then, found = found, self._summed()
            total += found["log_total"][0] - then["log_total"][0]
            left -= share
            if left <= 0.0:
                break
            had_descendants = self._resample(number, part)
            part += 1
            found = self._summed()
            info.survivors[k] = min(info.survivors[k], had_descendants)
        info.resamplings[k] = part
        info.log_likelihood[k] = total + np.where(np.isnan(readings[k]), 0.0, self.peak).sum()
        info.effective[k] = found["effective"][0]
        info.mean[k], info.std[k] = found["mean"][0], np.sqrt(found["variance"][0])

    def _resample(self, number: int, part: int) -> int:
        """Resample, drawing static states anew; how many particles had descendants."""
        static = self.static
        chosen, renewed = resample(self.options, self.particles[static], self.log_weights, number, part)
        moved = self.changes or not self.renews
        self.particles = np.ascontiguousarray(self.particles[:, chosen]) if moved else self.particles.copy()
        self.particles[static] = renewed
        for i, bounds in self.bounds.items():
            self.particles[i] = reflected(self.particles[i], *bounds)
        self.log_weights, self.centre = np.zeros(self.count), self.particles.mean(axis=1)
        return survivors(chosen)


def _write(info: ParticleInfo, found: dict[str, Array], first: int, samples: int, run: _Run) -> None:
    """Put what is known after each of some samples into `info`."""
    now, then = slice(first, first + samples), slice(1, 1 + samples)
    info.mean[now], info.std[now] = found["mean"][then], np.sqrt(found["variance"][then])
    info.innovation[now] = off = found["off"][:samples]
    std = np.sqrt(found["off_variance"][:samples] + run.noise)
    std[np.isnan(off)] = np.nan
    info.innovation_std[now] = info.whitening_std[now] = std
    info.whitened[now] = off / std
    peak = np.where(np.isnan(off), 0.0, run.peak).sum(axis=1)
    info.log_likelihood[now] = found["log_total"][then] - found["log_total"][:samples] + peak
    info.effective[now] = found["effective"][then]


def _log_peak(noise: Array, freedom: Array) -> Array:
    """Logarithm of each sensor's density at its centre (m,), which the weights leave out."""
    nu = np.where(np.isinf(freedom), 1.0, freedom)
    student = [math.lgamma(0.5 * (v + 1.0)) - math.lgamma(0.5 * v) - 0.5 * math.log(v * math.pi) for v in nu]
    return np.asarray(np.where(np.isinf(freedom), -0.5 * math.log(2.0 * math.pi), student) - 0.5 * np.log(noise))


def reflected(values: Array, low: float, high: float) -> Array:
    """Values that stepped over a bound, folded back inside."""
    values = np.where(values < low, 2.0 * low - values, values) if math.isfinite(low) else values
    values = np.where(values > high, 2.0 * high - values, values) if math.isfinite(high) else values
    return np.clip(values, low, high)


def linear_entries(model: StateSpace) -> NDArray[np.int64] | None:
    """Where a model without motion is linear in its state: (reading, state) of its coefficients, ordered; None where it is not.

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
    """A compiled function as an argument. Of a dispatcher Numba looks the address up in every call, which takes longer than a short block."""

    def __init__(self, function: Any, kind: Any) -> None:
        compiled = function.get_compile_result(kind)
        self.address = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_cfunc_wrapper_name)
        self.kind, self.function = kind, function

    def __wrapper_address__(self) -> int:
        return int(self.address)

    def signature(self) -> Any:
        return self.kind


def _address(function: Any, kind: Any) -> Any:
    found = _addresses.get(id(function))
    if found is None:
        found = _addresses[id(function)] = _Address(function, kind)
    return found


_addresses: dict[int, _Address] = {}  # kept with their functions, so that no identity is used twice


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@lru_cache(maxsize=1)
def pool() -> ThreadPoolExecutor:
    """Threads for the chunks of particles."""
    return ThreadPoolExecutor(_processors(), thread_name_prefix="particles")

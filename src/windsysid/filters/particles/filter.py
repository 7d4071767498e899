"""The particle filter: sequential importance resampling, on anything that is composed.

The belief is N particles with log-weights, no Gaussian. For every sample

    resample  where the effective sample size N_eff = (Σw)² / Σw² has fallen below a share of N
    predict   x ← f(x, η) particle by particle, η drawn: motion by values alone, loads, biases and parameters that walk
    update    log w ← log w + log p(y | x),     log p(y_k | y_1 …) = log Σ w − log Σ w before.

Parameters do not move, so resampling alone leaves ever fewer values of them. They are therefore drawn anew from a
kernel around their ancestors, shrunk towards the mean so that mean and covariance V of the cloud stay what they are
(Liu & West),

    θ ← a θ + (1 − a) θ̄ + h V^½ ε,     a = (3δ − 1) / 2δ,     h² = 1 − a²,

where a plain random walk would add variance without end. Where nothing moves but the parameters, a sample that says too
much at once is taken in by parts, p(y | x)^φ with Σφ = 1, resampling in between (tempering).

The random numbers are counted, not drawn in turn (`windsysid.kernels.philox`): the result depends on the seed and on
nothing else, however many threads there are. Particles go through a block of samples in chunks, as if no resampling
were due; where one was, the block is taken back and run again to that sample, to the same digits.

Source: Chopin & Papaspiliopoulos, An Introduction to Sequential Monte Carlo (2020), ch. 10 and 17; Liu & West, in
Sequential Monte Carlo Methods in Practice (2001), ch. 10; Gordon, Salmond & Smith, IEE Proceedings F 140(2), 1993.
"""

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.filters.particles.cloud import Cloud, address, linear_entries, reflected, semidefinite_root
from windsysid.filters.particles.kernels import (
    CHUNK,
    advance_kernel,
    combine_kernel,
    rows_kernel,
    sums_kernel,
    temper_kernel,
)
from windsysid.filters.particles.resampling import Resampling, check_resampling
from windsysid.filters.particles.weights import ParticleInfo, resample, survivors
from windsysid.filters.protocol import checked_samples
from windsysid.kernels.jit import VALUE
from windsysid.kernels.philox import Purpose, key_of, normals
from windsysid.kernels.threads import usable_processors
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.workspace import Workspace, workspace

__all__ = ["ParticleFilter"]


MAX_BLOCK_SAMPLES = 512
"""Most samples that are taken through a chunk at once."""

MAX_SUM_ROWS = 1 << 14
"""Most rows of sums that a block leaves: samples times chunks."""

MIN_THREADED_WORK = 100_000
"""Particles times samples below which one thread does it all."""

LINEAR_ROWS_AHEAD = 4096
"""Samples whose rows of a linear model are computed together."""

MAX_TEMPERING_PARTS = 200
"""Most parts that a sample is taken in by; then the rest at once."""


_NO_ENTRIES = np.empty((0, 2), dtype=np.int64)


@dataclass(frozen=True)
class ParticleFilter:
    """Particle filter (sequential importance resampling) with the methods of `windsysid.filters.Filter`.

    Beliefs are `Cloud`s; `step` is `run` with one sample, bit for bit, and results do not depend on the number of
    threads.

    Attributes
    ----------
    particles
        Number of particles N.
    seed
        0 … 2⁶⁴ − 1.
    resampling
        ``"systematic"``, ``"stratified"`` or ``"residual"``.
    threshold
        Share of N below which the effective sample size triggers resampling.
    discount
        δ of the Liu–West kernel for biases and parameters [1], ⅓ < δ ≤ 1; 1 switches it off. The default suits
        posteriors with one mode, as of coefficients; for several modes 0.99 keeps them apart, and needs more particles.
    tempering
        Use the likelihood of a sample in several steps where needed, if only parameters are unknown.
    freedom
        Degrees of freedom of sensor noise with a Student t distribution [1], for all or by channel; the noise of a
        sensor is then the scale of its distribution. Gaussian by default.
    bounds
        Least and greatest value in SI of bounded parameters, at which the prior is truncated.
    threads
        Number of threads; one for each processor by default.
    name
        Name in results.

    Raises
    ------
    ConfigurationError
        If an option is out of range.

    References
    ----------
    - Gordon, Salmond & Smith, IEE Proc. F 140(2), 1993, doi:10.1049/ip-f-2.1993.0015.
    - Liu & West, in Sequential Monte Carlo Methods in Practice, Springer 2001, ch. 10.
    - Chopin & Papaspiliopoulos, An Introduction to Sequential Monte Carlo, Springer 2020, ch. 10 and 17.

    Examples
    --------
    >>> import numpy as np
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    >>> stiffness, sensor = ws.models.Parameter("k", 3.0, 0.5), ws.models.Reading("position", q, noise=0.01)
    >>> model = ws.models.compose(
    ...     spring, rate=20.0, values={}, parameters=[stiffness], cov=np.eye(2), sensors=[sensor]
    ... )
    >>> time = 0.05 * np.arange(100)
    >>> readings = (np.exp(-0.1 * time) * np.cos(2.0 * time))[:, None]  # released at q = 1 m with k = 4 N/m
    >>> particles = ws.filters.ParticleFilter(particles=1000)
    >>> cloud, info = particles.run(model, particles.init(model), np.zeros((100, 1)), readings)
    >>> round(float(stiffness.physical(info.mean[-1, -1])), 1), cloud.particles.shape
    (4.0, (3, 1000))
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
        """`particles` (n, N) of `model`, drawn from any other prior, as a belief that no sample has reached yet;
        ConfigurationError if they are not finite or not N."""
        given = np.array(particles, dtype=np.float64, order="C")
        if given.shape != (len(model.states), self.particles) or not np.isfinite(given).all():
            raise ConfigurationError(
                f"particles: expected {len(model.states)} × {self.particles} finite numbers, got shape {given.shape}"
            )
        return Cloud(given, np.zeros(self.particles), given.mean(axis=1), np.zeros(len(model.inputs)), 0)

    def predict(self, model: StateSpace, belief: Cloud, inputs: Array) -> Cloud:
        """The `belief` of `model` at the time of `inputs` (n_u + n_w,), one sample on; the first stays at the prior."""
        return self._filter(model, belief, np.atleast_2d(inputs), np.full((1, len(model.readings)), np.nan))[0]

    def update(self, model: StateSpace, belief: Cloud, readings: Array) -> tuple[Cloud, ParticleInfo]:
        """The cloud `belief` of `model` after `readings` (m,) taken at its own time."""
        return self._filter(model, belief, belief.inputs[None], np.atleast_2d(readings), moves=False)

    def step(self, model: StateSpace, belief: Cloud, inputs: Array, readings: Array) -> tuple[Cloud, ParticleInfo]:
        """Filter one sample from `belief` on: `run` of `model` over `inputs` (n_u + n_w,) and `readings` (m,)."""
        return self.run(model, belief, np.atleast_2d(inputs), np.atleast_2d(readings))

    def run(self, model: StateSpace, belief: Cloud, inputs: Array, readings: Array) -> tuple[Cloud, ParticleInfo]:
        """Filter T samples from `belief` on: inputs (T, n_u + n_w) and readings (T, m), NaN = missing.

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
        """As `run` of `model` from `belief` on over `inputs` and `readings`, and the state's quantiles at
        `probabilities` (P,) after each `every` samples (T // every, P, n)."""
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
        inputs, readings = checked_samples(model, inputs, readings)
        samples, n, m = len(inputs), len(model.states), len(model.readings)
        if np.isfinite(model.blocks.gate[0]):
            raise ConfigurationError("gate: a particle filter has none: give `freedom`, for sensors with outliers")
        run = _ParticleRun(self, model, belief, moves)
        states, missing = (samples, n), np.full((samples, m), np.nan)
        info = ParticleInfo(
            np.empty(states), np.empty(states), missing, missing.copy(), missing.copy(), missing.copy(),
            np.empty(samples),
            np.zeros((samples, m), dtype=np.bool_), np.empty(samples), np.zeros(samples, dtype=np.int64),
            np.full(samples, self.particles),
        )  # fmt: skip
        run.through(inputs, readings, info)
        last = inputs[-1].copy() if samples else belief.inputs
        reached = belief.samples + (samples if moves else 0)
        return Cloud(run.particles, run.log_weights, run.centre, last, reached), info

    def bounds_of(self, model: StateSpace) -> dict[int, tuple[float, float]]:
        """Bounds in filter coordinates, by state of `model`; ConfigurationError if one is not identified."""
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


class _ParticleRun:
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
        self.functions = address(model.compiled.rates, VALUE), address(model.compiled.reading, VALUE)
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
        threads = min(options.threads or len(usable_processors()), chunks)
        self.shares = [(i * chunks // threads, (i + 1) * chunks // threads) for i in range(threads)]
        self.spaces = [workspace(model.blocks) for _ in self.shares]
        self.longest = max(4, min(MAX_BLOCK_SAMPLES, MAX_SUM_ROWS // chunks))

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
        """Take particles and log-weights through a block without resampling.

        Returns what is known before its first sample and after each of its samples.
        """
        samples, (n, m) = block.stop - block.start, (len(self.particles), len(self.noise))
        rows = self._rows(inputs, block)
        chunks = self.shares[-1][1]
        sums = np.empty((1 + samples, chunks, 3 + 2 * n + 2 * m))
        number = self.reached if self.moves else self.reached - 1
        entries = _NO_ENTRIES if self.entries is None else self.entries
        moving = self.moves if moves is None else moves

        def run(share: tuple[int, int], space: Workspace) -> None:
            advance_kernel()(
                *self.functions, self.model.blocks, space, self.key, number, *share, self.reached > 0, moving,
                self.particles, self.log_weights,
                self.centre, self.inputs, inputs[block], readings[block], self.freedom, rows, entries, sums,
            )  # fmt: skip

        if len(self.shares) > 1 and self.count * samples * (50 if self.changes else 1) > MIN_THREADED_WORK:
            list(pool().map(run, self.shares, self.spaces))
        else:
            run((0, chunks), self.spaces[0])
        found = self._combined(sums, samples)
        found["off"][np.isnan(readings[block])] = np.nan
        return found

    def _rows(self, inputs: Array, block: slice) -> Array:
        """Readings of a linear model at a block's samples; empty for others."""
        if self.entries is None:
            return self.rows
        if not (self.rows_first <= block.start and block.stop <= self.rows_first + len(self.rows)):
            ahead = inputs[block.start : max(block.stop, block.start + LINEAR_ROWS_AHEAD)]
            self.rows, self.rows_first = np.empty((len(ahead), *self.rows.shape[1:])), block.start
            rows_kernel()(self.model.compiled.reading_jacobian, self.model.blocks, self.spaces[0], ahead, self.rows)
        return self.rows[block.start - self.rows_first : block.stop - self.rows_first]

    def _summed(self) -> dict[str, Array]:
        """Estimate from particles and log-weights without changes."""
        n, m = len(self.particles), len(self.noise)
        sums = np.empty((1, self.shares[-1][1], 3 + 2 * n + 2 * m))
        sums_kernel()(self.particles, self.log_weights, self.centre, sums)
        return self._combined(sums, 0)

    def _combined(self, sums: Array, samples: int) -> dict[str, Array]:
        n, m = len(self.particles), len(self.noise)
        found = {
            "log_total": np.empty(1 + samples), "effective": np.empty(1 + samples), "mean": np.empty((1 + samples, n)),
            "variance": np.empty((1 + samples, n)), "off": np.empty((samples, m)),
            "off_variance": np.empty((samples, m)),
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
            share = left if part == MAX_TEMPERING_PARTS else temper_kernel()(before, likelihoods, left, self.least)
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


def _write(info: ParticleInfo, found: dict[str, Array], first: int, samples: int, run: _ParticleRun) -> None:
    """Store the estimates after each of some samples in `info`."""
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


@lru_cache(maxsize=1)
def pool() -> ThreadPoolExecutor:
    """Threads for the chunks of particles."""
    return ThreadPoolExecutor(len(usable_processors()), thread_name_prefix="particles")

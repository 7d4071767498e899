"""The Rao–Blackwellised particle filter: particles on the parameters, and for each of them a Kalman filter on all the
rest.

Given the parameters θ, motion, loads and biases are nearly linear and Gaussian, and need no particles:

    p(x_k, θ | y) = Σ_n W_n δ(θ − θ_n) N(x_k; m_n, P_n),     W_n ∝ Π_k N(y_k; ŷ_n, S_n),

with the extended Kalman filter of every θ_n run side by side in a bank (`windsysid.filters.bank`). A particle is then a
whole filter, and some hundred of them do what no number of particles on the motion itself could: an accelerometer tells
more of a load at one sample than the load's own wandering hides. When particles are resampled, θ is drawn from Liu and
West's kernel and keeps its ancestor's m and P.

Sensors are Gaussian here. The scale of a Student t sensor would have to be drawn for each particle at each sample.

Source: Doucet, de Freitas, Murphy & Russell, UAI 2000; Särkkä & Svensson, Bayesian Filtering and Smoothing (2nd ed.),
ch. 11.
"""

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.filters.bank import LANES, Bank, BankScores, bank_of, run_bank
from windsysid.filters.particles.cloud import reflected
from windsysid.filters.particles.filter import ParticleFilter, pool
from windsysid.filters.particles.resampling import Resampling, normalised
from windsysid.filters.particles.weights import resample, survivors
from windsysid.filters.protocol import checked_samples
from windsysid.statespace.compose import StateSpace

__all__ = ["Mixture", "MixtureInfo", "RaoBlackwellised", "SplitModel"]


MAX_BLOCK_SAMPLES = 256
"""Most samples that the bank is run over at once."""


class SplitModel(NamedTuple):
    """Model with its parameters in the state, and the same model given its parameters.

    Attributes
    ----------
    joint
        With the parameters in the state: gives their prior.
    given
        Without, at any values of the parameters: the model of the Kalman filters.

    Examples
    --------
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    >>> sensors, stiffness = [ws.models.Reading("position", q, noise=0.01)], ws.models.Parameter("k", 3.0, 0.5)
    >>> joint = ws.models.compose(spring, rate=20.0, values={}, parameters=[stiffness], sensors=sensors)
    >>> given = ws.models.compose(spring, rate=20.0, values={"k": 3.0}, sensors=sensors)
    >>> model = ws.filters.SplitModel(joint, given)
    >>> model.joint.states, model.given.states
    (('q', 'v', 'k'), ('q', 'v'))
    """

    joint: StateSpace
    given: StateSpace


class Mixture(NamedTuple):
    """State of a Rao–Blackwellised particle filter between two samples, from which it continues.

    Attributes
    ----------
    theta
        Parameters in filter coordinates (n_θ, N).
    log_weights
        Logarithms of the weights (N,), not normalised.
    bank
        The Kalman filters of all particles.
    """

    theta: Array
    log_weights: Array
    bank: Bank

    @property
    def weights(self) -> Array:
        """Normalised weights (N,)."""
        return normalised(self.log_weights)

    @property
    def mean(self) -> Array:
        """Mean of states and parameters, in the joint model's order (n,)."""
        return np.concatenate([self.weights @ _filters(self.bank)[0], self.theta @ self.weights])

    @property
    def cov(self) -> Array:
        """Covariance of states and parameters, within the filters and between them (n, n)."""
        means, covs = _filters(self.bank)
        away = np.hstack([means, self.theta.T]) - self.mean
        cov = (away.T * self.weights) @ away
        n = means.shape[1]
        cov[:n, :n] += np.einsum("i,ijk->jk", self.weights, covs)
        return np.asarray(cov)


class MixtureInfo(NamedTuple):
    """Output of a Rao–Blackwellised particle filter for T samples of m readings.

    Attributes
    ----------
    mean, std
        Mean and standard deviation of the parameters after each sample (T, n_θ).
    whitened
        Innovations, transformed to unit normals by the distribution of the mixture, reading by reading (T, m); NaN
        where missing.
    log_likelihood
        Log density of the readings of each sample given the past (T,).
    effective, resamplings, survivors
        As in `windsysid.filters.ParticleInfo` (T,).
    """

    mean: Array
    std: Array
    whitened: Array
    log_likelihood: Array
    effective: Array
    resamplings: NDArray[np.int64]
    survivors: NDArray[np.int64]


@dataclass(frozen=True)
class RaoBlackwellised:
    """Rao–Blackwellised particle filter: particles of the parameters, each with a Kalman filter of the states.

    It has the methods of `windsysid.filters.Filter`, and takes a `SplitModel`.

    Attributes
    ----------
    particles, seed, resampling, threshold, discount, bounds, threads, name
        As those of `windsysid.filters.ParticleFilter`.

    Raises
    ------
    ConfigurationError
        If an option is out of range.

    References
    ----------
    - Doucet, de Freitas, Murphy & Russell, Proc. UAI 2000, arXiv:1301.3853.
    - Särkkä & Svensson, Bayesian Filtering and Smoothing, 2nd ed., Cambridge 2023, ch. 11.

    Examples
    --------
    >>> import numpy as np
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    >>> stiffness, sensor = ws.models.Parameter("k", 3.0, 0.5), ws.models.Reading("position", q, noise=0.01)
    >>> common = {"rate": 20.0, "cov": np.eye(2), "sensors": [sensor]}
    >>> joint = ws.models.compose(spring, values={}, parameters=[stiffness], **common)
    >>> model = ws.filters.SplitModel(joint, ws.models.compose(spring, values={"k": 3.0}, **common))
    >>> time = 0.05 * np.arange(100)
    >>> readings = (np.exp(-0.1 * time) * np.cos(2.0 * time))[:, None]  # released at q = 1 m with k = 4 N/m
    >>> particles = ws.filters.RaoBlackwellised(particles=200)
    >>> mixture, info = particles.run(model, particles.init(model), np.zeros((100, 1)), readings)
    >>> round(float(stiffness.physical(info.mean[-1, 0])), 1), mixture.theta.shape
    (4.0, (1, 200))
    """

    particles: int = 1024
    seed: int = 0
    resampling: Resampling = "systematic"
    threshold: float = 0.5
    discount: float = 0.9
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    threads: int | None = None
    name: str = "Rao-Blackwellised particle filter"

    def __post_init__(self) -> None:
        self._as_particle_filter()

    def init(self, model: SplitModel) -> Mixture:
        """Particles of the prior of the parameters of `model`, and the prior of all the rest for each."""
        block = model.joint.parameter_block
        theta = np.ascontiguousarray(self._as_particle_filter().init(model.joint).particles[block])
        return Mixture(theta, np.zeros(self.particles), _bank(model, theta))

    def predict(self, model: SplitModel, belief: Mixture, inputs: Array) -> Mixture:
        """The `belief` of `model` at the time of `inputs` (n_u + n_w,), one sample on; the first stays at the prior."""
        return self.step(model, belief, inputs, np.full(len(model.given.readings), np.nan))[0]

    def update(self, model: SplitModel, belief: Mixture, readings: Array) -> tuple[Mixture, MixtureInfo]:
        """The `belief` of `model` after `readings` (m,) taken at its own time."""
        at_rest = belief._replace(bank=belief.bank._replace(samples=0))  # which the first sample finds where it is
        end, info = self._filter(model, at_rest, belief.bank.inputs[None], np.atleast_2d(readings))
        return end._replace(bank=end.bank._replace(samples=belief.bank.samples)), info

    def step(self, model: SplitModel, belief: Mixture, inputs: Array, readings: Array) -> tuple[Mixture, MixtureInfo]:
        """Filter one sample from `belief` on: `run` of `model` over `inputs` (n_u + n_w,) and `readings` (m,)."""
        return self.run(model, belief, np.atleast_2d(inputs), np.atleast_2d(readings))

    def run(self, model: SplitModel, belief: Mixture, inputs: Array, readings: Array) -> tuple[Mixture, MixtureInfo]:
        """Filter T samples from `belief` on: inputs (T, n_u + n_w) and readings (T, m), NaN = missing.

        Raises
        ------
        ValueError
            If a shape does not fit the model.
        ConfigurationError
            If the two models of `model` are not one.
        """
        return self._filter(model, belief, inputs, readings)

    def _as_particle_filter(self) -> ParticleFilter:
        return ParticleFilter(
            self.particles, self.seed, self.resampling, self.threshold, self.discount, bounds=self.bounds,
            threads=self.threads
        )  # fmt: skip

    def _filter(
        self, model: SplitModel, belief: Mixture, inputs: Array, readings: Array
    ) -> tuple[Mixture, MixtureInfo]:
        inputs, readings = checked_samples(model.given, inputs, readings)
        samples, m, nt = len(inputs), len(model.given.readings), len(model.joint.parameters)
        _check(model)
        least = self.threshold * self.particles
        bounds = {
            i - model.joint.parameter_block.start: b
            for i, b in self._as_particle_filter().bounds_of(model.joint).items()
        }
        info = MixtureInfo(
            np.empty((samples, nt)), np.empty((samples, nt)), np.full((samples, m), np.nan), np.empty(samples),
            np.empty(samples),
            np.zeros(samples, dtype=np.int64), np.full(samples, self.particles),
        )  # fmt: skip
        theta, log_weights, bank = belief
        threads: ThreadPoolExecutor | None = None if self.threads == 1 else pool()
        first, length = 0, 16
        effective = 1.0 / np.sum(belief.weights**2)
        while first < samples:
            if bank.samples > 0 and effective < least:
                chosen, theta = resample(self, theta, log_weights, bank.samples)
                for i, (low, high) in bounds.items():
                    theta[i] = reflected(theta[i], low, high)
                bank, log_weights = _resample_bank(model, bank, theta, chosen), np.zeros(self.particles)
                info.resamplings[first], info.survivors[first] = 1, survivors(chosen)
            block = slice(first, min(first + length, samples))
            there, scores = run_bank(bank, inputs[block], readings[block], threads)
            after = _add_scores(log_weights, scores, readings[block])
            effective_after = _effective(after)
            poor = np.flatnonzero(effective_after < least)
            valid = int(poor[0]) + 1 if poor.size else len(after)
            if valid < len(after):
                there, _ = run_bank(bank, inputs[first : first + valid], readings[first : first + valid], threads)
            _write(info, first, theta, np.vstack([log_weights, after[:valid]]), scores, readings[first : first + valid])
            bank, log_weights, effective = there, after[valid - 1], effective_after[valid - 1]
            first += valid
            length = min(2 * length, MAX_BLOCK_SAMPLES) if not poor.size else max(8, valid)
        return Mixture(theta, log_weights, bank), info


def _check(model: SplitModel) -> None:
    joint, given = model
    n = len(joint.states) - len(joint.parameters)
    if given.parameters or given.states != joint.states[:n] or given.readings != joint.readings:
        raise ConfigurationError(
            "Rao–Blackwellised filter: expected a joint model and the same one without parameters in the state, got"
            f" the states {', '.join(joint.states)} and {', '.join(given.states)}"
        )
    if len(joint.parameters) and np.any(joint.blocks.walk[:, -len(joint.parameters) :] > 0.0):
        raise ConfigurationError("Rao–Blackwellised filter: expected parameters that stay, got some that walk")


def _models(model: SplitModel, theta: Array) -> list[StateSpace]:
    """The model without parameters in the state, at each particle's."""
    joint, given = model
    where = [given.compiled.parameters.index(q.name) for q in joint.parameters]
    physical = np.array([q.physical(values) for q, values in zip(joint.parameters, theta, strict=True)])
    models = []
    for values in physical.T:
        p = given.blocks.p.copy()
        p[where] = values
        models.append(replace(given, blocks=given.blocks._replace(p=p)))
    return models


def _bank(model: SplitModel, theta: Array) -> Bank:
    return bank_of(_models(model, theta))


def _resample_bank(model: SplitModel, bank: Bank, theta: Array, chosen: NDArray[np.int64]) -> Bank:
    """Filters at resampled parameters with the beliefs of their ancestors."""
    mean, cov = (np.ascontiguousarray(values[chosen]) for values in _filters(bank))
    filled = np.concatenate([np.arange(len(mean)), np.full(-len(mean) % LANES, len(mean) - 1)])
    return _bank(model, theta)._replace(
        mean=np.ascontiguousarray(np.moveaxis(mean[filled].reshape(-1, LANES, mean.shape[1]), 1, -1)),
        cov=np.ascontiguousarray(np.moveaxis(cov[filled].reshape(-1, LANES, *cov.shape[1:]), 1, -1)),
        inputs=bank.inputs,
        samples=bank.samples,
    )


def _filters(bank: Bank) -> tuple[Array, Array]:
    """Mean (N, n) and covariance (N, n, n) of every filter of a bank."""
    n = bank.mean.shape[1]
    mean = np.moveaxis(bank.mean, -1, 1).reshape(-1, n)[: bank.filters]
    return mean, np.moveaxis(bank.cov, -1, 1).reshape(-1, n, n)[: bank.filters]


def _add_scores(log_weights: Array, scores: BankScores, readings: Array) -> Array:
    """Log-weights after each sample (T, N)."""
    density = -0.5 * (scores.whitened**2 + math.log(2.0 * math.pi)) - scores.log_std
    density[np.isnan(readings)] = 0.0
    return np.asarray(np.cumsum(np.vstack([log_weights, density.sum(axis=1)]), axis=0)[1:])


def _effective(log_weights: Array) -> Array:
    w = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
    return np.asarray(w.sum(axis=1) ** 2 / np.sum(w**2, axis=1))


def _write(
    info: MixtureInfo, first: int, theta: Array, log_weights: Array, scores: BankScores, readings: Array
) -> None:
    """Fill `info` from samples whose log-weights before the first and after each are (1 + T, N)."""
    from scipy.special import ndtr, ndtri

    samples = len(readings)
    now = slice(first, first + samples)
    largest = log_weights.max(axis=1, keepdims=True)
    w = np.exp(log_weights - largest)
    total = w.sum(axis=1)
    log_total = largest[:, 0] + np.log(total)
    info.log_likelihood[now] = np.diff(log_total)
    w /= total[:, None]
    mean = w[1:] @ theta.T
    info.mean[now] = mean
    centred = theta - theta.mean(axis=1, keepdims=True)
    info.std[now] = np.sqrt(np.maximum(w[1:] @ (centred**2).T - (w[1:] @ centred.T) ** 2, 0.0))
    info.effective[now] = 1.0 / np.sum(w[1:] ** 2, axis=1)
    before = w[:-1]  # which each reading of a sample moves on
    for c in range(readings.shape[1]):
        seen = ~np.isnan(readings[:, c])
        z = scores.whitened[:samples, c]
        share = np.sum(before * ndtr(z), axis=1)
        info.whitened[now][seen, c] = ndtri(np.clip(share, 1e-300, 1.0 - 1e-16))[seen]
        log_density = np.where(seen[:, None], -0.5 * z**2 - scores.log_std[:samples, c], 0.0)
        before = before * np.exp(log_density - log_density.max(axis=1, keepdims=True))
        before /= before.sum(axis=1, keepdims=True)

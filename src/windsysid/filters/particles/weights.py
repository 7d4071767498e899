"""Weights of particles: resampling, Liu and West's kernel, the health of the cloud, the record of a run."""

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.filters.particles.kernels import (
    renew_kernel,
)
from windsysid.filters.particles.resampling import Resampling, ancestors, normalised
from windsysid.kernels.philox import Purpose, normals, uniforms

__all__ = ["ParticleInfo", "degeneracy", "liu_west"]

MIN_EFFECTIVE_PARTICLES = 10.0
"""Effective particles below which an estimate rests on next to nothing."""


class ParticleInfo(NamedTuple):
    """Output of a particle filter for T samples: the fields of `windsysid.filters.Info`, and health of the particles.

    Each innovation is standardised by its own standard deviation, of mixture and noise together, and not decorrelated
    from the others of its sample; `whitening_std` is `innovation_std`, and no reading is gated.

    Attributes
    ----------
    mean, std, innovation, innovation_std, whitened, whitening_std, log_likelihood, gated
        As of `windsysid.filters.Info`: shapes (T, n) of means and standard deviations, (T, m) of innovations.
    effective
        Effective sample size after each sample (T,).
    resamplings
        Number of resamplings in each sample (T,).
    survivors
        Smallest number of particles with descendants in one of them (T,); N where there was none.
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


def liu_west(values: Array, weights: Array, chosen: NDArray[np.int64], noise: Array, discount: float) -> Array:
    """Resampled values (n, N) drawn anew from kernels around their ancestors, mean and covariance kept.

    `weights` (N,) are those before resampling, normalised, `chosen` (N,) the ancestors, `noise` (n, N) standard normal.
    """
    out = np.empty_like(values)
    a = (3.0 * discount - 1.0) / (2.0 * discount)
    renew_kernel()(weights, a, chosen, np.ascontiguousarray(noise), np.ascontiguousarray(values), out)
    return out


class ResamplingOptions(Protocol):
    """Options of a filter that resampling uses."""

    @property
    def seed(self) -> int: ...
    @property
    def resampling(self) -> Resampling: ...
    @property
    def discount(self) -> float: ...


def resample(
    options: ResamplingOptions, values: Array, log_weights: Array, number: int, part: int = 0
) -> tuple[NDArray[np.int64], Array]:
    """Ancestors (N,) of the next particles and their static values (n, N), drawn anew if the filter has a kernel."""
    weights = normalised(log_weights)
    points = uniforms(options.seed, number, Purpose.ANCESTORS, weights.size, part)
    chosen = ancestors(weights, points, options.resampling)
    if options.discount == 1.0 or not len(values):
        return chosen, values[:, chosen]
    noise = normals(options.seed, number, Purpose.KERNEL, len(values), weights.size, part)
    return chosen, liu_west(values, weights, chosen, noise, options.discount)


def survivors(chosen: NDArray[np.int64]) -> int:
    """Number of particles with descendants; ancestors are in order."""
    return 1 + int(np.count_nonzero(np.diff(chosen)))


class Fared(Protocol):
    """Health of the particles, (T,) each."""

    @property
    def effective(self) -> Array: ...
    @property
    def resamplings(self) -> NDArray[np.int64]: ...
    @property
    def survivors(self) -> NDArray[np.int64]: ...


def degeneracy(info: Fared) -> str:
    """Describe the health of a particle cloud in one or two sentences.

    Parameters
    ----------
    info : ParticleInfo or MixtureInfo
        Output of `run` of a particle filter.

    Returns
    -------
    str
        Begins with ``healthy``, ``thin`` or ``degenerate``.

    Examples
    --------
    >>> import numpy as np
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    >>> sensor = ws.models.Reading("position", q, noise=0.1)
    >>> model = ws.models.compose(spring, rate=20.0, values={"k": 4.0}, cov=np.eye(2), sensors=[sensor])
    >>> particles = ws.filters.ParticleFilter(particles=500)
    >>> _, info = particles.run(model, particles.init(model), np.zeros((20, 1)), np.zeros((20, 1)))
    >>> ws.filters.degeneracy(info).partition(":")[0]
    'healthy'
    """
    count = int(info.survivors.max(initial=0)) if not info.resamplings.all() else 0
    count = max(count, int(np.ceil(info.effective.max(initial=0.0))))
    times, samples = int(info.resamplings.sum()), len(info.effective)
    worst = int(np.argmin(info.effective)) if samples else 0
    thin = int(np.argmin(info.survivors)) if samples else 0
    text = (
        f"{times} resamplings; of {count} particles {np.median(info.effective):.0f} count in the median,"
        f" {info.effective[worst]:.0f} at sample {worst}, {info.survivors[thin]} survived sample {thin}"
    )
    poor = float(np.mean(info.effective < MIN_EFFECTIVE_PARTICLES))
    if poor > 0.01:
        return (
            f"degenerate: {text}. {100.0 * poor:.0f} % of the estimates rest on fewer than"
            f" {MIN_EFFECTIVE_PARTICLES:.0f}: take more particles, RaoBlackwellised or a Kalman filter"
        )
    if info.effective[worst] < MIN_EFFECTIVE_PARTICLES or info.survivors[thin] < MIN_EFFECTIVE_PARTICLES:
        return (
            f"thin: {text}. Lost particles cannot be recovered: compare with another seed, take more particles or a"
            " narrower prior"
        )
    return f"healthy: {text}"

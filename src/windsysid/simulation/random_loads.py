"""Random loads: stationary realisations of any load model."""

from collections.abc import Sequence

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.within_step import within_step

__all__ = ["draw_loads", "draw_within_steps"]


def draw_loads(
    blocks: Sequence[LoadModel],
    names: Sequence[str],
    samples: int,
    rate: float,
    rng: np.random.Generator,
    azimuth: Array | None = None,
) -> Array:
    """Draw stationary loads, one column per name in `names` (T, n_w); zero where none is modelled.

    Parameters
    ----------
    blocks
        Load models, such as `windsysid.statespace.gauss_markov.GaussMarkov`, or what a hypothesis supposes.
    names
        Of the loads that are required.
    rate
        Samples per second [Hz].
    azimuth
        ψ (T,) [rad], which loads that turn with the rotor need.

    Raises
    ------
    ValueError
        If it is missing.
    ConfigurationError
        If a block drives a load that is not in `names`.
    """
    return _driven(blocks, [_states(block, samples, rate, rng) for block in blocks], names, samples, azimuth)


def draw_within_steps(
    blocks: Sequence[LoadModel], names: Sequence[str], samples: int, rate: float, rng: np.random.Generator,
    azimuth: Array | None = None,
) -> Array:  # fmt: skip
    """Draw what the same loads are in addition to a straight line over the step that leads to each sample (T, n_w);
    arguments as for `draw_loads`."""
    roots = [within_step(block, 1.0 / rate) for block in blocks]
    states = [rng.standard_normal((samples, root.shape[1])) @ root.T for root in roots]
    middle = None if azimuth is None else azimuth - 0.5 * np.diff(azimuth, prepend=azimuth[:1])
    return _driven(blocks, states, names, samples, middle)


def _driven(
    blocks: Sequence[LoadModel], states: Sequence[Array], names: Sequence[str], samples: int, azimuth: Array | None
) -> Array:
    """Loads of the states (T, n) of each block (T, n_w)."""
    drawn = np.zeros((samples, len(names)))
    for block, own in zip(blocks, states, strict=True):
        for name, rows in block.outputs.items():
            if name not in names:
                raise ConfigurationError(f"load '{name}': expected one of {', '.join(names) or 'no loads'}")
            drawn[:, list(names).index(name)] += _value(own, rows, azimuth, name)
    return drawn


def _states(block: LoadModel, samples: int, rate: float, rng: np.random.Generator) -> Array:
    """A stationary realisation of a block's states (T, n), exact at the samples."""
    from scipy.signal import lfilter

    transition, covariance = block.discretise(1.0 / rate)
    noise = rng.standard_normal((samples, len(block.states)))
    if all(np.array_equal(matrix, np.diag(np.diag(matrix))) for matrix in (transition, covariance, block.cov)):
        spread = np.sqrt(np.diag(covariance))
        noise *= spread
        noise[:1] *= np.sqrt(np.diag(block.cov)) / spread
        columns = [
            lfilter([1.0], [1.0, -factor], column) for factor, column in zip(np.diag(transition), noise.T, strict=True)
        ]
        return np.column_stack(columns)
    states = noise @ _root(covariance).T
    states[:1] = noise[:1] @ _root(block.cov).T
    for k in range(1, samples):
        states[k] += transition @ states[k - 1]
    return states


def _value(states: Array, rows: Array, azimuth: Array | None, name: str) -> Array:
    """w = (H₀ + Σ_k C_k cos kψ + S_k sin kψ) z (T,)."""
    total = np.zeros(len(states))
    for i, row in enumerate(rows):
        if not row.any():
            continue
        value = states @ row
        if i > 0:
            if azimuth is None:
                raise ValueError(f"load '{name}': a harmonic of the rotor needs the azimuth")
            k = (i + 1) // 2
            value *= np.cos(k * azimuth) if i % 2 else np.sin(k * azimuth)
        total += value
    return total


def _root(cov: Array) -> Array:
    """R with R Rᵀ = cov, which may be singular."""
    size, axes = np.linalg.eigh(cov)
    return np.asarray(axes * np.sqrt(np.maximum(size, 0.0)))

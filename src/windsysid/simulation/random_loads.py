"""Random loads with the statistics of a turbine file."""

from collections.abc import Sequence

import numpy as np

from windsysid._types import Array
from windsysid.statespace.gauss_markov import GaussMarkov

__all__ = ["gauss_markov_loads"]


def gauss_markov_loads(
    loads: Sequence[GaussMarkov],
    names: Sequence[str],
    samples: int,
    rate: float,
    rng: np.random.Generator,
    azimuth: Array | None = None,
) -> Array:
    """Draw stationary loads, one column per name in `names` (T, n_w); zero where none is modelled. Harmonics need ψ (T,)."""
    from scipy.signal import lfilter

    drawn = np.zeros((samples, len(names)))
    for load in loads:
        factor, variance = (matrix[0, 0] for matrix in load.discretise(1.0 / rate))
        noise = rng.standard_normal((samples, len(load.states))) * np.sqrt(variance)
        noise[:1] *= load.rms / np.sqrt(variance)
        process = lfilter([1.0], [1.0, -factor], noise, axis=0)
        if load.harmonic:
            if azimuth is None:
                raise ValueError(f"load '{load.load}': a harmonic of the rotor needs the azimuth")
            process = process * np.column_stack([np.cos(load.harmonic * azimuth), np.sin(load.harmonic * azimuth)])
        drawn[:, list(names).index(load.load)] += process.sum(axis=1)
    return drawn

"""Resampling: which particles have descendants, and how many.

Of N particles with weights W, particle n gets a random number of descendants with expectation N Wₙ. With the cumulative
weights C and one or N uniform numbers u,

    systematic   one u, the points (i + u) / N
    stratified   N of them, the points (i + uᵢ) / N
    residual     ⌊N Wₙ⌋ descendants for certain, the rest drawn independently in proportion to N Wₙ − ⌊N Wₙ⌋;

the ancestor of descendant i is the particle in whose part of C its point lies.

Source: Chopin & Papaspiliopoulos, An Introduction to Sequential Monte Carlo (2020), ch. 9; Douc, Cappé & Moulines, ISPA
2005, https://doi.org/10.1109/ISPA.2005.195385.
"""

from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.kernels.jit import compiled

__all__ = ["Resampling", "ancestors", "check_resampling", "normalised"]

Resampling = Literal["systematic", "stratified", "residual"]


def ancestors(weights: Array, uniforms: Array, resampling: Resampling = "systematic") -> NDArray[np.int64]:
    """The ancestors (N,) of the next N particles, in increasing order.

    Parameters
    ----------
    weights
        Normalised (N,).
    uniforms
        In [0, 1), (N,); systematic resampling uses the first.

    Raises
    ------
    ConfigurationError
        If the scheme is not one of those above.
    """
    check_resampling(resampling)
    out = np.empty(len(weights), dtype=np.int64)
    _kernel()(weights, uniforms, get_args(Resampling).index(resampling), out)
    return out


def check_resampling(resampling: str) -> None:
    """Refuse a scheme that does not exist."""
    if resampling not in get_args(Resampling):
        raise ConfigurationError(f"resampling: expected {', '.join(get_args(Resampling))}, got '{resampling}'")


@lru_cache(maxsize=1)
def _kernel() -> Any:
    vector = types.float64[::1]
    return compiled(_resample, types.void(vector, vector, types.int64, types.int64[::1]))


def _resample(weights: Any, uniforms: Any, scheme: int, out: Any) -> None:
    count = weights.size
    certain = 0
    spare = 0.0
    if scheme == 2:
        for n in range(count):
            whole = int(count * weights[n])
            spare += count * weights[n] - whole
            for _ in range(min(whole, count - certain)):
                out[certain] = n
                certain += 1
        if certain == count:
            return
    left = count - certain
    # residual: the order statistics of `left` uniform numbers, from the largest down, u_(j) = u_(j+1) v^(1/j)
    points = np.empty(left)
    if scheme == 2:
        above = 1.0
        for j in range(left, 0, -1):
            above *= (1.0 - uniforms[j - 1]) ** (1.0 / j)
            points[j - 1] = above
    else:
        for i in range(left):
            points[i] = (i + uniforms[i if scheme == 1 else 0]) / left
    n = 0
    reached = weights[0] if scheme < 2 else (count * weights[0] - int(count * weights[0])) / spare
    for i in range(left):
        while reached <= points[i] and n < count - 1:
            n += 1
            reached += weights[n] if scheme < 2 else (count * weights[n] - int(count * weights[n])) / spare
        out[certain + i] = n
    if scheme == 2:
        out.sort()


def normalised(log_weights: Array) -> Array:
    """Weights (N,) that add up to 1."""
    weights = np.exp(log_weights - log_weights.max())
    return np.asarray(weights / weights.sum())

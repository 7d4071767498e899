"""One-to-one assignment of measured modes to a model's: the most probable one, and probabilities of all.

An assignment gives each measured mode i one mode k of the model, each of these at most once, or none. Its probability
is proportional to the product of its weights: w_ik of pairs over 1 of none. Marginal probabilities are sums over all
assignments, here by the sum-product algorithm, which always converges on this graph and is exact without cycles
(Williams & Lau, IEEE Trans. Aerosp. Electron. Syst. 50(4), 2014, doi 10.1109/TAES.2014.120568).
"""

import numpy as np

from windsysid._types import Array

__all__ = ["MAX_ITERATIONS", "best_assignment", "pair_probabilities"]

MAX_ITERATIONS = 500
"""Setting: largest number of iterations; some tens suffice."""

TOLERANCE = 1e-9
"""Numerical: largest relative change of a message at which iterations end."""


def pair_probabilities(weights: Array) -> Array:
    """Compute the probability of each pair, over all one-to-one assignments.

    Parameters
    ----------
    weights
        w_ik (m, n) ≥ 0 of the measured mode i being the mode k of the model, relative to being none of them.

    Returns
    -------
    Array
        (m, n); rows add up to 1 less the probability of none.

    Examples
    --------
    Two peaks near one mode: at most one of them is it.

    >>> np.round(pair_probabilities(np.array([[8.0], [1.0]])), 3).tolist()
    [[0.8], [0.1]]
    """
    nu = np.ones_like(weights)
    for _ in range(MAX_ITERATIONS):
        offers = weights * nu
        mu = weights / (1.0 + offers.sum(axis=1, keepdims=True) - offers)
        new = 1.0 / (1.0 + mu.sum(axis=0, keepdims=True) - mu)
        done = np.allclose(new, nu, rtol=TOLERANCE, atol=0.0)
        nu = new
        if done:
            break
    offers = weights * nu
    return np.asarray(offers / (1.0 + offers.sum(axis=1, keepdims=True)))


def best_assignment(weights: Array) -> list[int | None]:
    """Find the most probable assignment: the model's mode of each measured one, or None.

    Examples
    --------
    >>> best_assignment(np.array([[8.0, 5.0], [9.0, 0.1], [0.2, 0.3]]))
    [1, 0, None]
    """
    from scipy.optimize import linear_sum_assignment

    m, n = weights.shape
    gains = np.log(np.maximum(weights, np.finfo(float).tiny))
    rows, columns = linear_sum_assignment(np.hstack([gains, np.zeros((m, m))]), maximize=True)
    found = dict(zip(rows.tolist(), columns.tolist(), strict=True))
    return [found[i] if found[i] < n else None for i in range(m)]

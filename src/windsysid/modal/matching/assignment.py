"""One-to-one assignment of measured modes to a model's: the most probable one, and probabilities of all.

An assignment gives each measured mode i one mode k of the model, each of these at most once, or none. Its probability
is proportional to the product of its weights: w_ik of pairs over 1 of none. Marginal probabilities are sums over all
assignments, by dynamic programming over the sets of modes that are taken. Among more modes than that can hold, they are
those of the sum-product algorithm, which always converges on this graph and is exact without cycles (Williams & Lau,
IEEE Trans. Aerosp. Electron. Syst. 50(4), 2014, doi 10.1109/TAES.2014.120568); of two modes that are as likely each
other's as their own, it is far too sure.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array

__all__ = ["MAX_ITERATIONS", "best_assignment", "pair_probabilities"]

NEGLIGIBLE_WEIGHT = 1e-4
"""Numerical: weight below which a pair is left out; its probability is smaller than its weight."""

MAX_MODES = 12
"""Setting: largest number of modes, measured or the model's, that depend on each other and are summed exactly: 2¹² sets
of them for each of the others take some hundredths of a second."""

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
    found = np.zeros_like(weights)
    for block in _components(weights):
        own = weights[block]
        if min(own.shape) > MAX_MODES:
            found[block] = _sum_product(own)
        else:
            found[block] = _sums(own) if len(own) <= own.shape[1] else _sums(own.T).T
    return found


def _components(weights: Array) -> Iterator[tuple[NDArray[np.int64], ...]]:
    """Indices of parts that have no pairs with each other."""
    from scipy.sparse.csgraph import connected_components

    m, n = weights.shape
    pairs = np.zeros((m + n, m + n))
    pairs[:m, m:] = weights > NEGLIGIBLE_WEIGHT
    count, labels = connected_components(pairs, directed=False)
    for part in range(count):
        rows, columns = np.flatnonzero(labels[:m] == part), np.flatnonzero(labels[m:] == part)
        if len(rows) and len(columns):
            yield np.ix_(rows, columns)


def _sums(weights: Array) -> Array:
    """Probabilities (m, n) by sums over all assignments, which take columns one by one; sets of rows are bits."""
    m, n = weights.shape
    none = 1.0 / (1.0 + weights.sum(axis=1))
    pairs = weights * none[:, None]
    sets = np.arange(1 << m)
    bits = [1 << i for i in range(m)]
    without = [sets[sets & bit == 0] for bit in bits]
    before, after = np.zeros((n + 1, len(sets))), np.ones((n + 1, len(sets)))
    before[0, 0] = 1.0
    for k in range(n):
        before[k + 1] = before[k]
        for i, free in enumerate(without):
            before[k + 1, free | bits[i]] += pairs[i, k] * before[k, free]
    for i, free in enumerate(without):
        after[n, free] *= none[i]
    for k in reversed(range(n)):
        after[k] = after[k + 1]
        for i, free in enumerate(without):
            after[k, free] += pairs[i, k] * after[k + 1, free | bits[i]]
    found = [
        [pairs[i, k] * (before[k, free] @ after[k + 1, free | bits[i]]) for k in range(n)]
        for i, free in enumerate(without)
    ]
    return np.asarray(np.array(found) / after[0, 0], dtype=np.float64)


def _sum_product(weights: Array) -> Array:
    """Probabilities (m, n) by messages between rows and columns."""
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

"""What Gaussian filters share: the belief, the information that comes out of a step, and the scalar update.

A measurement of m readings with independent noise is taken in one reading at a time, which needs no matrix to be
inverted and lets a missing reading (NaN) simply be left out. The covariance update is Joseph's form written out for a
scalar reading,

    P ← (I − K h) P (I − K h)ᵀ + K r Kᵀ = P − K vᵀ − v Kᵀ + s K Kᵀ,     v = P hᵀ,  s = h v + r,  K = v / s.

Source: Särkkä & Svensson, Bayesian Filtering and Smoothing (2nd ed.), ch. 6; Bucy & Joseph (1968).
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.jit import inlined
from windsysid.statespace import StateSpace

__all__ = ["Belief", "Filter", "Info", "assimilate", "first_belief"]

Array = NDArray[np.float64]


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
        Reading minus its expectation, and the standard deviation it should have (T, m); NaN where the reading is
        missing.
    whitened
        Innovations decorrelated and scaled to unit variance (T, m); NaN where missing.
    whitening_std
        What they were divided by (T, m): the standard deviation of a reading given the past and the readings before it
        in the same sample.
    log_likelihood
        Log density of the readings of each sample given the past (T,).
    """

    mean: Array
    std: Array
    innovation: Array
    innovation_std: Array
    whitened: Array
    whitening_std: Array
    log_likelihood: Array


class Filter(NamedTuple):
    """The filter protocol: pure functions; a new belief and its `Info` come out, nothing is changed in place.

    ``init(model) → belief``; ``predict(model, belief, inputs) → belief`` at the time of those inputs;
    ``update(model, belief, readings) → belief, info`` at that same time; ``step`` is both, and `run` is `step` over
    T samples.
    """

    name: str
    init: Callable[[StateSpace], Belief]
    predict: Callable[[StateSpace, Belief, Array], Belief]
    update: Callable[[StateSpace, Belief, Array], tuple[Belief, Info]]
    step: Callable[[StateSpace, Belief, Array, Array], tuple[Belief, Info]]
    run: Callable[[StateSpace, Belief, Array, Array], tuple[Belief, Info]]


def first_belief(model: StateSpace) -> Belief:
    """The prior of the model as a belief that no sample has reached yet."""
    return Belief(model.mean.copy(), model.cov.copy(), np.zeros(len(model.inputs)), 0)


@inlined
def assimilate(mean: Any, cov: Any, h: Any, residual: float, variance: float, v: Any, gain: Any) -> tuple[float, float]:
    """Take in one scalar reading, in place.

    `h` (n,) is the reading's derivative, `residual` its deviation from the expectation at the current mean, `v` and
    `gain` (n,) scratch. Returns the whitened innovation and the standard deviation it was divided by.
    """
    n = mean.size
    s = variance
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += cov[i, j] * h[j]
        v[i] = total
        s += h[i] * total
    scale = 1.0 / s
    for i in range(n):
        gain[i] = v[i] * scale
        mean[i] += gain[i] * residual
    for i in range(n):
        pushed, pulled = gain[i], s * gain[i] - v[i]
        for j in range(n):
            cov[i, j] += pulled * gain[j] - pushed * v[j]
    root = math.sqrt(s)
    return residual / root, root

"""The extended Kalman filter: moments through exact Jacobians of transition and reading.

    predict   m⁻ = f(m),               P⁻ = F P Fᵀ + Γ Q Γᵀ
    update    m  = m⁻ + K (y − h(m⁻)), P  = (I − K H) P⁻ (I − K H)ᵀ + K R Kᵀ

The paper's Eqs (21)–(23), in the standard order (its P_{k+1} is used before it exists). Source: Särkkä & Svensson,
ch. 7.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numba import types

from windsysid.filters.gaussian import ARGUMENTS, Filter, assimilate_sample, compare, keep
from windsysid.jit import JACOBIAN, compiled
from windsysid.statespace import StateSpace
from windsysid.transition import BLOCKS, linearise_reading, predict_moments, workspace

__all__ = ["EKF"]


def _kernel(model: StateSpace) -> Callable[..., None]:
    return partial(_compiled(), model.compiled.rates_jacobian, model.compiled.reading_jacobian, model.blocks)


EKF = Filter("extended Kalman filter", _kernel)


@lru_cache(maxsize=1)
def _compiled() -> Any:
    """The compiled filter, one for all models."""
    jacobian = types.FunctionType(JACOBIAN)
    return compiled(_run, types.void(jacobian, jacobian, BLOCKS, *ARGUMENTS))


def _run(
    rates_jacobian: Any, reading_jacobian: Any, blocks: Any, mean: Any, cov: Any, previous: Any,
    inputs: Any, readings: Any, started: bool, moves: bool, covs: Any, means: Any, stds: Any,
    innovation: Any, innovation_std: Any, whitened: Any, whitening_std: Any, log_likelihood: Any, gated: Any,
) -> None:  # fmt: skip
    ws = workspace(blocks)
    n = mean.size
    v, gain, about = np.empty(n), np.empty(n), np.empty(n)
    before = previous
    for k in range(inputs.shape[0]):
        after = inputs[k]
        if started and moves:
            predict_moments(rates_jacobian, blocks, ws, mean, cov, before, after)
        started = True
        before = after
        linearise_reading(reading_jacobian, blocks, ws, mean, after)
        compare(ws, cov, blocks, readings[k], innovation[k], innovation_std[k], gated[k])
        for i in range(n):
            about[i] = mean[i]
        log_likelihood[k] = assimilate_sample(
            ws, mean, cov, about, blocks, readings[k], gated[k], whitened[k], whitening_std[k], v, gain
        )
        keep(mean, cov, k, means, stds, covs)

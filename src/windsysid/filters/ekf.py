"""The extended Kalman filter: moments through exact Jacobians of transition and reading.

    predict   m⁻ = f(m),               P⁻ = F P Fᵀ + Γ Q Γᵀ
    update    m  = m⁻ + K (y − h(m⁻)), P  = (I − K H) P⁻ (I − K H)ᵀ + K R Kᵀ

The paper's Eqs (21)–(23), in the standard order (its P_{k+1} is used before it exists). Source: Särkkä & Svensson,
ch. 7.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

from numba import types

from windsysid.filters.gaussian import ARGUMENTS, assimilate_sample, close_belief, keep, open_belief
from windsysid.filters.protocol import Filter, compare, expect_sample
from windsysid.kernels.jit import JACOBIAN, compiled
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.workspace import BLOCKS, WORKSPACE, workspace

__all__ = ["EKF", "run_kernel"]


def _kernel(model: StateSpace) -> Callable[..., None]:
    compiled_model, blocks = model.compiled, model.blocks
    return partial(
        run_kernel(), compiled_model.rates_jacobian, compiled_model.reading_jacobian, blocks, workspace(blocks)
    )


EKF = Filter("extended Kalman filter", _kernel)


@lru_cache(maxsize=1)
def run_kernel() -> Any:
    """The compiled filter, one for all models."""
    jacobian = types.FunctionType(JACOBIAN)
    return compiled(_run, types.void(jacobian, jacobian, BLOCKS, WORKSPACE, *ARGUMENTS), borrows=True)


def _run(
    rates_jacobian: Any, reading_jacobian: Any, blocks: Any, ws: Any, mean: Any, cov: Any, previous: Any,
    inputs: Any, readings: Any, started: bool, moves: bool, covs: Any, means: Any, stds: Any,
    innovation: Any, innovation_std: Any, whitened: Any, whitening_std: Any, log_likelihood: Any, gated: Any,
) -> None:  # fmt: skip
    open_belief(ws, mean, cov)
    before = previous
    for k in range(inputs.shape[0]):
        after = inputs[k]
        moves_now = moves and (started or k > 0)
        expect_sample(rates_jacobian, reading_jacobian, blocks, ws, before, after, moves_now)
        before = after
        compare(ws, blocks, readings[k], innovation[k], innovation_std[k], gated[k])
        for i in range(ws.mean.size):
            ws.about[i] = ws.mean[i]
        log_likelihood[k] = assimilate_sample(ws, blocks, readings[k], gated[k], whitened[k], whitening_std[k])
        keep(ws.mean, ws.cov, k, means, stds, covs)
    close_belief(ws, mean, cov)

"""The extended Kalman filter: moments through exact Jacobians of transition and reading.

    predict   m⁻ = f(m),               P⁻ = F P Fᵀ + Γ Q Γᵀ
    update    m  = m⁻ + K (y − h(m⁻)), P  = (I − K H) P⁻ (I − K H)ᵀ + K R Kᵀ

The paper's Eqs (21)–(23), in the standard order (its P_{k+1} is used before it exists). Source: Särkkä & Svensson,
ch. 7.
"""

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from windsysid.filters.gaussian import Belief, Filter, Info, assimilate, first_belief
from windsysid.jit import JACOBIAN, compiled
from windsysid.statespace import StateSpace
from windsysid.transition import BLOCKS, expected_reading, predict_moments, workspace

__all__ = ["EKF", "init", "predict", "run", "step", "update"]

Array = NDArray[np.float64]

init = first_belief


def run(model: StateSpace, belief: Belief, inputs: Array, readings: Array) -> tuple[Belief, Info]:
    """Filter T samples.

    Parameters
    ----------
    belief
        Where to start: `init` of the model, or the belief an earlier run ended with.
    inputs
        Known inputs and known loads at each sample (T, n_u + n_w).
    readings
        (T, m); NaN = missing.

    Returns
    -------
    belief, info
        The belief after the last sample, and what came out of each.

    Raises
    ------
    ValueError
        If a shape does not fit the model.
    """
    return _filter(model, belief, inputs, readings, moves=True)


def step(model: StateSpace, belief: Belief, inputs: Array, readings: Array) -> tuple[Belief, Info]:
    """Filter one sample: `run` over inputs (n_u + n_w,) and readings (m,)."""
    return run(model, belief, np.atleast_2d(inputs), np.atleast_2d(readings))


def predict(model: StateSpace, belief: Belief, inputs: Array) -> Belief:
    """The belief at the time of `inputs` (n_u + n_w,), one sample on; the first prediction stays at the prior."""
    nothing = np.full((1, len(model.readings)), np.nan)
    return _filter(model, belief, np.atleast_2d(inputs), nothing, moves=True)[0]


def update(model: StateSpace, belief: Belief, readings: Array) -> tuple[Belief, Info]:
    """The belief after readings (m,) taken at its own time."""
    return _filter(model, belief, belief.inputs[None], np.atleast_2d(readings), moves=False)


EKF = Filter("extended Kalman filter", init, predict, update, step, run)


def _filter(model: StateSpace, belief: Belief, inputs: Array, readings: Array, *, moves: bool) -> tuple[Belief, Info]:
    inputs = np.ascontiguousarray(inputs, dtype=np.float64)
    readings = np.ascontiguousarray(readings, dtype=np.float64)
    samples, n, m = len(inputs), len(model.states), len(model.readings)
    if inputs.shape != (samples, len(model.inputs)) or readings.shape != (samples, m):
        raise ValueError(
            f"expected inputs (T, {len(model.inputs)}) and readings (T, {m}), got {inputs.shape} and {readings.shape}"
        )
    mean, cov = belief.mean.copy(), belief.cov.copy()
    shapes = [(samples, n), (samples, n), (samples, m), (samples, m), (samples, m), (samples, m), (samples,)]
    info = Info._make(np.empty(shape) for shape in shapes)
    _kernel()(
        model.compiled.rates_jacobian, model.compiled.reading_jacobian, model.blocks,
        mean, cov, belief.inputs, inputs, readings, belief.samples > 0, moves, *info,
    )  # fmt: skip
    last = inputs[-1].copy() if samples else belief.inputs
    return Belief(mean, cov, last, belief.samples + (samples if moves else 0)), info


@lru_cache(maxsize=1)
def _kernel() -> Any:
    """The compiled filter, one for all models."""
    model = types.FunctionType(JACOBIAN)
    vector, matrix = types.float64[::1], types.float64[:, ::1]
    signature = types.void(
        model, model, BLOCKS, vector, matrix, vector, matrix, matrix, types.boolean, types.boolean,
        matrix, matrix, matrix, matrix, matrix, matrix, vector,
    )  # fmt: skip
    return compiled(_run, signature)


def _run(
    rates_jacobian: Any, reading_jacobian: Any, blocks: Any, mean: Any, cov: Any, previous: Any,
    inputs: Any, readings: Any, started: bool, moves: bool,
    means: Any, stds: Any, innovation: Any, innovation_std: Any, whitened: Any, whitening_std: Any, log_likelihood: Any,
) -> None:  # fmt: skip
    ws = workspace(blocks)
    n, m = mean.size, blocks.noise.size
    scratch, gain, shift = np.empty(n), np.empty(n), np.empty(n)
    before = previous
    for k in range(inputs.shape[0]):
        after = inputs[k]
        if started and moves:
            predict_moments(rates_jacobian, blocks, ws, mean, cov, before, after)
        started = True
        before = after
        expected_reading(reading_jacobian, blocks, ws, mean, after)
        for i in range(n):
            shift[i] = mean[i]
        total = 0.0
        for c in range(m):
            value = readings[k, c]
            if np.isnan(value):
                innovation[k, c] = np.nan
                innovation_std[k, c] = np.nan
                continue
            h = ws.H[c]
            spread = blocks.noise[c]
            for i in range(n):
                inner = 0.0
                for j in range(n):
                    inner += cov[i, j] * h[j]
                spread += h[i] * inner
            innovation[k, c] = value - ws.y[c]
            innovation_std[k, c] = np.sqrt(spread)
        for c in range(m):
            if np.isnan(readings[k, c]):
                whitened[k, c] = np.nan
                whitening_std[k, c] = np.nan
                continue
            h = ws.H[c]
            residual = innovation[k, c]
            for i in range(n):
                residual -= h[i] * (mean[i] - shift[i])
            z, std = assimilate(mean, cov, h, residual, blocks.noise[c], scratch, gain)
            whitened[k, c] = z
            whitening_std[k, c] = std
            total -= 0.5 * (math.log(2.0 * math.pi) + z * z) + math.log(std)
        log_likelihood[k] = total
        for i in range(n):
            for j in range(i):  # rounding has made the two halves differ in the last digit
                cov[i, j] = cov[j, i]
            means[k, i] = mean[i]
            stds[k, i] = np.sqrt(cov[i, i])

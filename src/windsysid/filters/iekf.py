"""The iterated extended Kalman filter: where readings bend, the update finds the most probable state and linearises there.

A sample's readings y = h(x) + noise and the prediction m⁻, P⁻ ask for the minimum of

    J(x) = ½ (x − m⁻)ᵀ P⁻⁻¹ (x − m⁻) + ½ Σ_c (y_c − h_c(x))² / r_c.

Its Gauss–Newton step from x_i, with H at x_i, is the extended filter's update linearised at x_i,

    m⁻ + P⁻ Hᵀ λ,     (H P⁻ Hᵀ + R) λ = y − h(x_i) − H (m⁻ − x_i),

and is halved until J does not grow: without that an iterated filter can run away where the readings bend within the prediction's
uncertainty. The whole state is iterated, since an acceleration bends in products of motion and parameters. As every x is m⁻ + P⁻ v, the
prior's part of J is ½ vᵀ (x − m⁻), and P⁻ may be singular.

Only samples are iterated whose readings differ, at the first step's end, from their linearisation by more than a fifth of their own
noise; the others are the extended filter's, and so are all linear readings. A slope taken at x depends on the noise of the very reading it
weighs, the extended filter's does not. Where iterating gains nothing, that correlation is a small bias in every sample, and a record has ten
thousand: iterated throughout, the filter loses the coefficients (docs/filters.md has the figures).

The covariance is linearised where the steps end; so are the whitened innovations, whose density is then Laplace's approximation of
the likelihood. Innovations and the gate belong to the prediction.

Source: Bell & Cathey, IEEE TAC 38(2), 1993, https://doi.org/10.1109/9.250476; Skoglund, Hendeby & Axehill, FUSION 2015 (the step's
length); Särkkä & Svensson, ch. 7.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numba import types

from windsysid.filters.gaussian import ARGUMENTS, Filter, assimilate_sample, compare, keep
from windsysid.filters.roots import factorise
from windsysid.jit import JACOBIAN, compiled, inlined
from windsysid.statespace import StateSpace
from windsysid.transition import BLOCKS, linearise_reading, predict_moments, workspace

__all__ = ["IEKF"]

BENT = 0.2
"""Standard deviations of its noise that a reading is off its linearisation, above which the sample is iterated."""

ITERATIONS = 10
"""Most Gauss–Newton steps per sample."""

SETTLED = 0.01
"""Length of a step, in standard deviations of the state after the update, below which it is the last."""

HALVINGS = 5
"""How often a step that makes J grow is halved before the state stays where it is."""


def _kernel(model: StateSpace) -> Callable[..., None]:
    return partial(_compiled(), model.compiled.rates_jacobian, model.compiled.reading_jacobian, model.blocks)


IEKF = Filter("iterated extended Kalman filter", _kernel)


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
    ws, steps = workspace(blocks), _steps(mean.size, blocks.noise.size)
    n, at = mean.size, steps.at
    v, gain = np.empty(n), np.empty(n)
    before = previous
    for k in range(inputs.shape[0]):
        after = inputs[k]
        if started and moves:
            predict_moments(rates_jacobian, blocks, ws, mean, cov, before, after)
        started = True
        before = after
        linearise_reading(reading_jacobian, blocks, ws, mean, after)
        compare(ws, cov, blocks, readings[k], innovation[k], innovation_std[k], gated[k])
        settled = _iterate(reading_jacobian, blocks, ws, steps, mean, cov, after, readings[k], gated[k])
        log_likelihood[k] = assimilate_sample(
            ws, mean, cov, at, blocks, readings[k], gated[k], whitened[k], whitening_std[k], v, gain
        )
        if not settled:
            for i in range(n):
                mean[i] = at[i]
        keep(mean, cov, k, means, stds, covs)


class Steps(NamedTuple):
    """Scratch of the iteration: x = m⁻ + P⁻ v in `at` and `push`, a step of both, P⁻ Hᵀ, H P⁻ Hᵀ + R with its root, λ."""

    at: Any
    push: Any
    towards: Any
    pushes: Any
    spread: Any
    S: Any
    root: Any
    weight: Any


@inlined
def _steps(n: int, m: int) -> Any:
    return Steps(
        np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((m, n)), np.zeros((m, m)), np.zeros((m, m)), np.zeros(m)
    )  # fmt: skip


@inlined
def _iterate(
    reading_jacobian: Any, blocks: Any, ws: Any, steps: Any, mean: Any, cov: Any, inputs: Any, readings: Any, gated: Any
) -> bool:
    """Move ``steps.at`` from the prediction to the mode, the reading linearised there; whether the last step was small."""
    n, at, push, towards, pushes = mean.size, steps.at, steps.push, steps.towards, steps.pushes
    for i in range(n):
        at[i] = mean[i]
        push[i] = 0.0
    if not _bends(reading_jacobian, blocks, ws, steps, mean, cov, inputs, readings, gated):
        return True
    cost = _cost(ws, steps, mean, blocks, readings, gated)
    for _ in range(ITERATIONS):
        _gauss_newton(ws, steps, mean, cov, blocks, readings, gated)
        if not _length(ws, steps, blocks, readings, gated) > SETTLED:
            return True
        shorter = 0
        while shorter <= HALVINGS:
            for i in range(n):
                at[i] += towards[i]
                push[i] += pushes[i]
            linearise_reading(reading_jacobian, blocks, ws, at, inputs)
            reached = _cost(ws, steps, mean, blocks, readings, gated)
            if reached <= cost:
                cost = reached
                break
            for i in range(n):
                at[i] -= towards[i]
                push[i] -= pushes[i]
                towards[i] *= 0.5
                pushes[i] *= 0.5
            shorter += 1
        if shorter > HALVINGS:
            linearise_reading(reading_jacobian, blocks, ws, at, inputs)
            return False
    return False


@inlined
def _bends(
    reading_jacobian: Any, blocks: Any, ws: Any, steps: Any, mean: Any, cov: Any, inputs: Any, readings: Any, gated: Any
) -> bool:
    """Whether a reading is off its linearisation at the prediction, where the first step ends."""
    n, at, line = mean.size, steps.at, steps.weight
    _gauss_newton(ws, steps, mean, cov, blocks, readings, gated)
    for c in range(readings.size):
        line[c] = ws.y[c]
        for i in range(n):
            line[c] += ws.H[c, i] * steps.towards[i]
    for i in range(n):
        at[i] = mean[i] + steps.towards[i]
    linearise_reading(reading_jacobian, blocks, ws, at, inputs)
    bent = False
    for c in range(readings.size):
        if not (np.isnan(readings[c]) or gated[c]):
            bent = bent or abs(ws.y[c] - line[c]) > BENT * np.sqrt(blocks.noise[c])
    for i in range(n):
        at[i] = mean[i]
    linearise_reading(reading_jacobian, blocks, ws, at, inputs)
    return bent


@inlined
def _length(ws: Any, steps: Any, blocks: Any, readings: Any, gated: Any) -> float:
    """√(dᵀ (P⁻⁻¹ + Hᵀ R⁻¹ H) d) of the step d in ``steps.towards``."""
    n = steps.at.size
    total = 0.0
    for i in range(n):
        total += steps.pushes[i] * steps.towards[i]
    for c in range(readings.size):
        if not (np.isnan(readings[c]) or gated[c]):
            along = 0.0
            for i in range(n):
                along += ws.H[c, i] * steps.towards[i]
            total += along * along / blocks.noise[c]
    return float(np.sqrt(total))


@inlined
def _cost(ws: Any, steps: Any, mean: Any, blocks: Any, readings: Any, gated: Any) -> float:
    """J where the reading is linearised."""
    total = 0.0
    for i in range(mean.size):
        total += steps.push[i] * (steps.at[i] - mean[i])
    for c in range(readings.size):
        if not (np.isnan(readings[c]) or gated[c]):
            off = readings[c] - ws.y[c]
            total += off * off / blocks.noise[c]
    return 0.5 * total


@inlined
def _gauss_newton(ws: Any, steps: Any, mean: Any, cov: Any, blocks: Any, readings: Any, gated: Any) -> None:
    """The full step from ``steps.at``, into ``steps.towards`` and ``steps.pushes``; readings left out have λ = 0."""
    n, m = mean.size, readings.size
    S, root, weight, spread = steps.S, steps.root, steps.weight, steps.spread
    for c in range(m):
        h = ws.H[c]
        known = not (np.isnan(readings[c]) or gated[c])
        weight[c] = readings[c] - ws.y[c] if known else 0.0
        for i in range(n):
            inner = 0.0
            if known:
                for j in range(n):
                    inner += cov[i, j] * h[j]
                weight[c] += h[i] * (steps.at[i] - mean[i])
            spread[c, i] = inner
        for d in range(c):
            value = 0.0
            for i in range(n):
                value += spread[d, i] * h[i]
            S[d, c] = value if known else 0.0
        S[c, c] = blocks.noise[c]
        for i in range(n):
            S[c, c] += spread[c, i] * h[i]
    factorise(S, root)
    for c in range(m):
        for d in range(c):
            weight[c] -= root[d, c] * weight[d]
        weight[c] = weight[c] / root[c, c] if root[c, c] > 0.0 else 0.0
    for c in range(m - 1, -1, -1):
        for d in range(c + 1, m):
            weight[c] -= root[c, d] * weight[d]
        weight[c] = weight[c] / root[c, c] if root[c, c] > 0.0 else 0.0
    for i in range(n):
        steps.towards[i] = mean[i] - steps.at[i]
        steps.pushes[i] = -steps.push[i]
    for c in range(m):
        for i in range(n):
            steps.towards[i] += spread[c, i] * weight[c]
            steps.pushes[i] += ws.H[c, i] * weight[c]

"""The iterated extended Kalman filter: where readings bend, the update finds the most probable state and linearises
there.

A sample's readings y = h(x) + noise and the prediction m⁻, P⁻ define the minimum of

    J(x) = ½ (x − m⁻)ᵀ P⁻⁻¹ (x − m⁻) + ½ Σ_c (y_c − h_c(x))² / r_c.

Its Gauss–Newton step from x_i, with H at x_i, is the extended filter's update linearised at x_i,

    m⁻ + P⁻ Hᵀ λ,     (H P⁻ Hᵀ + R) λ = y − h(x_i) − H (m⁻ − x_i),

and is halved until J does not grow: without that an iterated filter can run away where the readings bend within the
prediction's uncertainty. The whole state is iterated, since an acceleration bends in products of motion and parameters.
As every x is m⁻ + P⁻ v, the prior's part of J is ½ vᵀ (x − m⁻), and P⁻ may be singular.

Only samples are iterated whose readings differ, at the first step's end, from their linearisation by more than a fifth
of their own noise; the others are the extended filter's, and so are all linear readings. A slope taken at x depends on
the noise of the very reading it weighs, the extended filter's does not. Where iterating gains nothing, that correlation
is a small bias in every sample, and a record has ten thousand: iterated throughout, the filter loses the coefficients
(docs/filters.md has the figures).

The covariance is linearised where the steps end; so are the whitened innovations, whose density is then Laplace's
approximation of the likelihood. Innovations and the gate belong to the prediction.

Source: Bell & Cathey, IEEE TAC 38(2), 1993, https://doi.org/10.1109/9.250476; Skoglund, Hendeby & Axehill, FUSION 2015
(the step's length); Särkkä & Svensson, ch. 7.
"""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numba import types

from windsysid.filters.gaussian import ARGUMENTS, assimilate_sample, close_belief, keep, open_belief
from windsysid.filters.protocol import Filter, compare, expect_sample
from windsysid.filters.roots import factorise
from windsysid.kernels.jit import JACOBIAN, compiled, pasted, uncounted
from windsysid.kernels.parts import lanes_sum
from windsysid.kernels.rows import inner, multiply, padded
from windsysid.kernels.simd import LANES, load, splat, store
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.step import linearise_reading, set_parameters
from windsysid.statespace.workspace import BLOCKS, WORKSPACE, Matrix, Vector, scratch_type, workspace

__all__ = ["IEKF"]

MIN_NONLINEARITY_SIGMAS = 0.2
"""Standard deviations of its noise that a reading is off its linearisation, above which the sample is iterated."""

MAX_ITERATIONS = 10
"""Most Gauss–Newton steps per sample."""

STEP_TOLERANCE_SIGMAS = 0.01
"""Length of a step, in standard deviations of the state after the update, below which it is the last."""

MAX_HALVINGS = 5
"""Greatest number of times that a step which increases J is halved before the state is kept."""


def _kernel(model: StateSpace) -> Callable[..., None]:
    compiled_model, blocks = model.compiled, model.blocks
    steps = _steps(len(model.states), len(model.readings))
    return partial(
        _compiled(), compiled_model.rates_jacobian, compiled_model.reading_jacobian, blocks, workspace(blocks), steps
    )


IEKF = Filter("iterated extended Kalman filter", _kernel)


class Steps(NamedTuple):
    """Scratch of the iteration, which is at x = m⁻ + P⁻ v: v in `push`, a step of x and of v, H P⁻ Hᵀ + R with its
    root, λ.

    `H` and `y` keep the linearisation at the prediction.
    """

    push: Matrix
    towards: Matrix
    pushes: Matrix
    S: Matrix
    root: Matrix
    weight: Vector
    H: Matrix
    y: Vector


STEPS = scratch_type(Steps)


def _steps(n: int, m: int) -> Steps:
    return Steps(
        padded(1, n), padded(1, n), padded(1, n), padded(m, m), padded(m, m), np.zeros(m), padded(m, n), np.zeros(m)
    )


@lru_cache(maxsize=1)
def _compiled() -> Any:
    """The compiled filter, one for all models."""
    jacobian = types.FunctionType(JACOBIAN)
    return compiled(_run, types.void(jacobian, jacobian, BLOCKS, WORKSPACE, STEPS, *ARGUMENTS), borrows=True)


def _run(
    rates_jacobian: Any, reading_jacobian: Any, blocks: Any, ws: Any, steps: Any, mean: Any, cov: Any, previous: Any,
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
        settled = _iterate(reading_jacobian, blocks, ws, steps, after, readings[k], gated[k])
        multiply(ws.nothing, ws.H, 0, ws.y.size, 0, ws.cov.shape[0], ws.cov, ws.spread)
        log_likelihood[k] = assimilate_sample(ws, blocks, readings[k], gated[k], whitened[k], whitening_std[k])
        if not settled:
            _copy(ws.about, ws.mean)
        keep(ws.mean, ws.cov, k, means, stds, covs)
    close_belief(ws, mean, cov)


@pasted
def _copy(source: Any, to: Any) -> None:
    for c in range(to.size // LANES):
        store(to, c, load(source, c))


@uncounted
def _iterate(reading_jacobian: Any, blocks: Any, ws: Any, steps: Any, inputs: Any, readings: Any, gated: Any) -> bool:
    """Move ``ws.about`` from the prediction to the mode and linearise the reading there.

    Returns whether the last step was small.
    """
    at, push, towards, pushes = ws.about, steps.push, steps.towards, steps.pushes
    vectors = at.size // LANES
    _copy(ws.mean, at)
    for c in range(vectors):
        store(push, c, splat(0.0))
    if not _bends(reading_jacobian, blocks, ws, steps, inputs, readings, gated):
        return True
    cost = _cost(ws, steps, blocks, readings, gated)
    for _ in range(MAX_ITERATIONS):
        _gauss_newton(ws, steps, blocks, readings, gated)
        if not _length(ws, steps, blocks, readings, gated) > STEP_TOLERANCE_SIGMAS:
            return True
        for halved in range(MAX_HALVINGS + 2):
            length = splat(1.0 if halved <= MAX_HALVINGS else 0.0)
            for c in range(vectors):
                store(at, c, load(at, c) + length * load(towards, c))
                store(push, c, load(push, c) + length * load(pushes, c))
            _linearise(reading_jacobian, blocks, ws, inputs)
            if halved > MAX_HALVINGS:
                return False
            reached = _cost(ws, steps, blocks, readings, gated)
            if reached <= cost:
                cost = reached
                break
            half = splat(0.5)
            for c in range(vectors):
                store(at, c, load(at, c) - load(towards, c))
                store(push, c, load(push, c) - load(pushes, c))
                store(towards, c, half * load(towards, c))
                store(pushes, c, half * load(pushes, c))
    return False


@uncounted
def _linearise(reading_jacobian: Any, blocks: Any, ws: Any, inputs: Any) -> None:
    """The readings' expectations and derivatives at ``ws.about``."""
    set_parameters(blocks, ws, ws.about)
    linearise_reading(reading_jacobian, blocks, ws, ws.about, inputs)


@uncounted
def _bends(reading_jacobian: Any, blocks: Any, ws: Any, steps: Any, inputs: Any, readings: Any, gated: Any) -> bool:
    """Test whether a reading differs from its linearisation at the prediction, where the first step ends."""
    at, line, rows = ws.about, steps.weight, steps.H.size // LANES
    _gauss_newton(ws, steps, blocks, readings, gated)
    for c in range(readings.size):
        steps.y[c] = ws.y[c]
        line[c] = ws.y[c] + inner(ws.H, c, steps.towards, 0)
    for c in range(rows):
        store(steps.H, c, load(ws.H, c))
    for c in range(at.size // LANES):
        store(at, c, load(ws.mean, c) + load(steps.towards, c))
    _linearise(reading_jacobian, blocks, ws, inputs)
    bent = False
    for c in range(readings.size):
        if not (np.isnan(readings[c]) or gated[c]):
            bent = bent or abs(ws.y[c] - line[c]) > MIN_NONLINEARITY_SIGMAS * np.sqrt(blocks.noise[c])
        ws.y[c] = steps.y[c]
    for c in range(rows):
        store(ws.H, c, load(steps.H, c))
    _copy(ws.mean, at)
    return bent


@pasted
def _length(ws: Any, steps: Any, blocks: Any, readings: Any, gated: Any) -> float:
    """√(dᵀ (P⁻⁻¹ + Hᵀ R⁻¹ H) d) of the step d in ``steps.towards``."""
    total = inner(steps.pushes, 0, steps.towards, 0)
    for c in range(readings.size):
        if not (np.isnan(readings[c]) or gated[c]):
            along = inner(ws.H, c, steps.towards, 0)
            total += along * along / blocks.noise[c]
    return float(np.sqrt(total))


@pasted
def _cost(ws: Any, steps: Any, blocks: Any, readings: Any, gated: Any) -> float:
    """J where the reading is linearised."""
    off_prior = splat(0.0)
    for c in range(ws.mean.size // LANES):
        off_prior = off_prior + load(steps.push, c) * (load(ws.about, c) - load(ws.mean, c))
    total = lanes_sum(off_prior)
    for c in range(readings.size):
        if not (np.isnan(readings[c]) or gated[c]):
            off = readings[c] - ws.y[c]
            total += off * off / blocks.noise[c]
    return float(0.5 * total)


@uncounted
def _gauss_newton(ws: Any, steps: Any, blocks: Any, readings: Any, gated: Any) -> None:
    """The full step from ``ws.about``, into ``steps.towards`` and ``steps.pushes``; readings left out have λ = 0."""
    m, vectors = readings.size, ws.mean.size // LANES
    S, root, weight, spread, towards, pushes = steps.S, steps.root, steps.weight, ws.spread, steps.towards, steps.pushes
    for c in range(vectors):
        store(towards, c, load(ws.mean, c) - load(ws.about, c))
        store(pushes, c, splat(0.0) - load(steps.push, c))
    multiply(ws.nothing, ws.H, 0, m, 0, ws.cov.shape[0], ws.cov, spread)
    for c in range(m):
        known = not (np.isnan(readings[c]) or gated[c])
        weight[c] = readings[c] - ws.y[c] - inner(ws.H, c, towards, 0) if known else 0.0
        for d in range(c):
            S[d, c] = inner(spread, d, ws.H, c) if known and not (np.isnan(readings[d]) or gated[d]) else 0.0
        S[c, c] = blocks.noise[c] + (inner(spread, c, ws.H, c) if known else 0.0)
    factorise(S, root)
    for c in range(m):
        for d in range(c):
            weight[c] -= root[d, c] * weight[d]
        weight[c] = weight[c] / root[c, c] if root[c, c] > 0.0 else 0.0
    for c in range(m - 1, -1, -1):
        for d in range(c + 1, m):
            weight[c] -= root[c, d] * weight[d]
        weight[c] = weight[c] / root[c, c] if root[c, c] > 0.0 else 0.0
    for c in range(m):
        size = splat(weight[c])
        for i in range(vectors):
            store(towards, i, load(towards, i) + size * load(spread, c * vectors + i))
            store(pushes, i, load(pushes, i) + size * load(ws.H, c * vectors + i))

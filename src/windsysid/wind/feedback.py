"""Simulation with the aerodynamic damping in the loop: ẋ = f(x, u, p, w₀ − C q̇).

The loads at rest w₀ and the damping C of `windsysid.wind.wind_loads` run linearly between samples, the velocities are those of
the Runge–Kutta stage: one pass, no iteration, of the same order as `windsysid.simulate.integrate`, which this repeats for C = 0.
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import ArrayLike, NDArray

from windsysid.errors import ConfigurationError
from windsysid.jit import VALUE, compiled
from windsysid.mechanics.compile import CompiledModel
from windsysid.simulate import Response

__all__ = ["AeroelasticResponse", "integrate_with_feedback"]

Array = NDArray[np.float64]


class AeroelasticResponse(NamedTuple):
    """The response, and the loads (T, n) [N, N·m] that really acted: w₀ − C q̇."""

    response: Response
    loads: Array


def integrate_with_feedback(
    model: CompiledModel,
    p: ArrayLike,
    inputs: ArrayLike,
    damping: ArrayLike,
    *,
    rate: float,
    start: ArrayLike,
    substeps: int = 2,
) -> AeroelasticResponse:
    """Integrate a rotor model whose loads fall with its own velocities.

    Parameters
    ----------
    p
        All parameters (n_p,), SI.
    inputs
        Inputs and loads at rest at each sample (T, n_u + n).
    damping
        C (T, n, n), in the order of the degrees of freedom.
    rate
        Samples per second [Hz].
    start
        State at the first sample (2 n,).
    substeps
        Integration steps between two samples.

    Raises
    ------
    ConfigurationError
        If the response grows beyond all bounds: the damping is negative on balance, or the step too long.
    ValueError
        If a shape does not fit the model.
    """
    p, inputs, damping, start = (np.ascontiguousarray(a, dtype=np.float64) for a in (p, inputs, damping, start))
    n, nu = len(model.loads), len(model.inputs)
    expected = ((len(model.parameters),), (len(inputs), nu + n), (len(inputs), n, n), (2 * n,))
    got = (p.shape, inputs.shape, damping.shape, start.shape)
    if got != expected or len(model.states) != 2 * n:
        raise ValueError(f"expected p, inputs, damping, start of shapes {expected}; got {got}")
    response = Response(*(np.empty((len(inputs), size)) for size in (2 * n, 2 * n, model.readings)))
    loads = np.empty((len(inputs), n))
    _kernel()(
        model.rates, model.reading, p, inputs, damping, nu, start, 1.0 / rate, substeps, *response, loads
    )  # fmt: skip
    if not np.isfinite(response.states).all():
        when = int(np.argmin(np.isfinite(response.states).all(axis=1))) / rate
        raise ConfigurationError(
            f"the motion under wind grows without bound after {when:.3g} s: "
            "check stiffness, damping and blade aerodynamics, or sample faster"
        )
    return AeroelasticResponse(response, loads)


@lru_cache(maxsize=1)
def _kernel() -> Any:
    model, vector, matrix = types.FunctionType(VALUE), types.float64[::1], types.float64[:, ::1]
    integer, real = types.int64, types.float64
    return compiled(
        _integrate,
        types.void(
            model, model, vector, matrix, types.float64[:, :, ::1], integer, vector, real, integer,
            matrix, matrix, matrix, matrix,
        ),
    )  # fmt: skip


def _integrate(
    rates: Any, reading: Any, p: Any, inputs: Any, damping: Any, nu: int, start: Any, step: float, substeps: int,
    states: Any, state_rates: Any, readings: Any, loads: Any,
) -> None:  # fmt: skip
    n, columns = start.size, inputs.shape[1]
    half = n // 2
    x, at, total, slope = start.copy(), np.empty(n), np.empty(n), np.empty(n)
    now = np.empty(columns)
    h = step / substeps
    for k in range(inputs.shape[0]):
        if k > 0:
            for part in range(substeps):
                for i in range(n):
                    at[i] = x[i]
                    total[i] = 0.0
                for stage in range(4):
                    inside = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                    fraction = (part + inside) / substeps
                    for i in range(columns):
                        now[i] = inputs[k - 1, i] + fraction * (inputs[k, i] - inputs[k - 1, i])
                    for i in range(half):
                        for j in range(half):
                            before, after = damping[k - 1, i, j], damping[k, i, j]
                            now[nu + i] -= (before + fraction * (after - before)) * at[half + j]
                    rates(at, now[:nu], p, now[nu:], slope)
                    weight = h / 6.0 if stage == 0 or stage == 3 else h / 3.0
                    ahead = h if stage == 2 else 0.5 * h
                    for i in range(n):
                        total[i] += weight * slope[i]
                        at[i] = x[i] + ahead * slope[i]
                for i in range(n):
                    x[i] += total[i]
        for i in range(columns):
            now[i] = inputs[k, i]
        for i in range(half):
            for j in range(half):
                now[nu + i] -= damping[k, i, j] * x[half + j]
            loads[k, i] = now[nu + i]
        rates(x, now[:nu], p, now[nu:], state_rates[k])
        reading(x, now[:nu], p, now[nu:], readings[k])
        for i in range(n):
            states[k, i] = x[i]

"""The response of a compiled model to loads, by Runge–Kutta's fourth-order method between samples."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.kernels.jit import VALUE, compiled
from windsysid.mechanics.compile import CompiledModel

__all__ = ["Response", "check_bounded", "constant_speed_inputs", "integrate", "integrator"]


class Response(NamedTuple):
    """A simulated response of T samples: states (T, n_x), their rates (T, n_x), noise-free readings (T, m)."""

    states: Array
    rates: Array
    readings: Array


def integrate(
    model: CompiledModel, p: ArrayLike, inputs: ArrayLike, *, rate: float, start: ArrayLike, substeps: int = 2,
    within: ArrayLike | None = None,
) -> Response:  # fmt: skip
    """Integrate ẋ = f(x, u, p, w) from `start` along sampled inputs with the classical fourth-order Runge–Kutta method.

    Parameters
    ----------
    p
        All parameters (n_p,), SI.
    inputs
        Inputs and loads at each sample (T, n_u + n_w).
    rate
        Samples per second [Hz].
    start
        State at the first sample (n_x,).
    substeps
        Integration steps between two samples.
    within
        What loads are in addition to a straight line over the step to each sample (T, n_w); nothing by default.

    Raises
    ------
    ConfigurationError
        If the response grows beyond all bounds: the structure is unstable, or the step too long.
    ValueError
        If a shape does not fit the model.
    """
    p, inputs, start = (np.ascontiguousarray(array, dtype=np.float64) for array in (p, inputs, start))
    n, columns = len(model.states), len(model.inputs) + len(model.loads)
    if p.shape != (len(model.parameters),) or inputs.ndim != 2 or inputs.shape[1] != columns or start.shape != (n,):
        raise ValueError(
            f"expected p ({len(model.parameters)},), inputs (T, {columns}), start ({n},); "
            f"got {p.shape}, {inputs.shape}, {start.shape}"
        )
    beside = np.empty((0, 0)) if within is None else np.ascontiguousarray(within, dtype=np.float64)
    if within is not None and beside.shape != (len(inputs), len(model.loads)):
        raise ValueError(f"expected within ({len(inputs)}, {len(model.loads)}); got {beside.shape}")
    response = Response(*(np.empty((len(inputs), size)) for size in (n, n, model.readings)))
    no_damping, no_loads = np.empty((0, 0, 0)), np.empty((0, 0))
    integrator()(
        model.rates, model.reading, p, inputs, beside, no_damping, len(model.inputs), start, 1.0 / rate, substeps,
        *response, no_loads
    )  # fmt: skip
    check_bounded(response, rate, "the simulated motion", "stiffness and damping")
    return response


def check_bounded(response: Response, rate: float, motion: str, causes: str) -> None:
    """Refuse a response that grows without bound, with the time and advice."""
    finite = np.isfinite(response.states).all(axis=1)
    if not finite.all():
        when = int(np.argmin(finite)) / rate
        raise ConfigurationError(f"{motion} grows without bound after {when:.3g} s: check {causes}, or sample faster")


def constant_speed_inputs(rotor_speed: float, duration: float, rate: float) -> Array:
    """Inputs of a rotor at constant speed: ψ from 0, Ω, dΩ/dt = 0; (T, 3) with T = duration · rate."""
    time = np.arange(round(duration * rate)) / rate
    return np.column_stack([rotor_speed * time, np.full_like(time, rotor_speed), np.zeros_like(time)])


@lru_cache(maxsize=1)
def integrator() -> Any:
    """The compiled loop, one for all models: with damping C (T, n, n), loads fall by C times the velocities and are
    written; without, C is empty, as is what loads are in addition to a straight line (T, n_w) without any."""
    model, vector, matrix = types.FunctionType(VALUE), types.float64[::1], types.float64[:, ::1]
    integer, real = types.int64, types.float64
    return compiled(
        _integrate,
        types.void(
            model, model, vector, matrix, matrix, types.float64[:, :, ::1], integer, vector, real, integer,
            matrix, matrix, matrix, matrix,
        ),
    )  # fmt: skip


def _integrate(
    rates: Any, reading: Any, p: Any, inputs: Any, within: Any, damping: Any, nu: int, start: Any, step: float,
    substeps: int, states: Any, state_rates: Any, readings: Any, loads: Any,
) -> None:  # fmt: skip
    n, columns, rough, damped = start.size, inputs.shape[1], within.shape[1], damping.shape[1]
    x, at, total, slope = start.copy(), np.empty(n), np.empty(n), np.empty(n)
    now = np.empty(columns)
    h = step / substeps
    for k in range(inputs.shape[0]):
        if k > 0 and n > 0:
            for part in range(substeps):
                for i in range(n):
                    at[i] = x[i]
                    total[i] = 0.0
                for stage in range(4):
                    inside = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                    fraction = (part + inside) / substeps
                    for i in range(columns):
                        now[i] = inputs[k - 1, i] + fraction * (inputs[k, i] - inputs[k - 1, i])
                    for i in range(rough):
                        now[nu + i] += within[k, i]
                    for i in range(damped):
                        for j in range(damped):
                            before, after = damping[k - 1, i, j], damping[k, i, j]
                            now[nu + i] -= (before + fraction * (after - before)) * at[damped + j]
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
        for i in range(damped):
            for j in range(damped):
                now[nu + i] -= damping[k, i, j] * x[damped + j]
            loads[k, i] = now[nu + i]
        rates(x, now[:nu], p, now[nu:], state_rates[k])
        reading(x, now[:nu], p, now[nu:], readings[k])
        for i in range(n):
            states[k, i] = x[i]

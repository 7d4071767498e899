"""Simulation with the aerodynamic damping in the loop: ẋ = f(x, u, p, w₀ − C q̇).

The loads at rest w₀ and the damping C of `windsysid.simulation.wind.wind_loads` run linearly between samples, the
velocities are those of the Runge–Kutta stage: one pass, no iteration, in the loop of `windsysid.simulation.integrate`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.mechanics.compile import CompiledModel
from windsysid.simulation.integrate import Response, check_bounded, integrator

__all__ = ["AeroelasticResponse", "integrate_with_feedback"]


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
    integrator()(
        model.rates, model.reading, p, inputs, np.empty((0, 0)), damping, nu, start, 1.0 / rate, substeps, *response,
        loads
    )  # fmt: skip
    check_bounded(response, rate, "the motion under wind", "stiffness, damping and blade aerodynamics")
    return AeroelasticResponse(response, loads)

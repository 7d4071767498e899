"""Simulation: the reference response of a model and what its sensors read, by RK4 between samples.

The simulator calls the kernels that the filters call (`windsysid.mechanics.compile`). Inputs and loads run linearly
between samples.
"""

import os
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numba import types
from numpy.typing import ArrayLike, NDArray

from windsysid.coercion import TurbineLike, as_turbine
from windsysid.errors import ConfigurationError
from windsysid.jit import VALUE, compiled
from windsysid.loads import GaussMarkov
from windsysid.mechanics.compile import CompiledModel, compile_model
from windsysid.mechanics.tower import TowerModel
from windsysid.record import Record

__all__ = ["Response", "constant_speed_inputs", "gauss_markov_loads", "integrate", "simulate_record"]

Array = NDArray[np.float64]

LoadSource = Literal["random", "wind", "wind-feedback"]
"""What drives a simulated turbine."""

SHARE = 0.7
"""Of the memory of a machine: what a simulation may take."""

LEAD_IN = 60.0
"""Seconds simulated before a record starts, so that it starts in stationary vibration."""


class Response(NamedTuple):
    """A simulated response of T samples: states (T, n_x), their rates (T, n_x), noise-free readings (T, m)."""

    states: Array
    rates: Array
    readings: Array


def integrate(
    model: CompiledModel, p: ArrayLike, inputs: ArrayLike, *, rate: float, start: ArrayLike, substeps: int = 2
) -> Response:
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
    response = Response(*(np.empty((len(inputs), size)) for size in (n, n, model.readings)))
    _kernel()(model.rates, model.reading, p, inputs, len(model.inputs), start, 1.0 / rate, substeps, *response)
    if not np.isfinite(response.states).all():
        when = int(np.argmin(np.isfinite(response.states).all(axis=1))) / rate
        raise ConfigurationError(
            f"the simulated motion grows without bound after {when:.3g} s: check stiffness and damping, or sample faster"
        )
    return response


def simulate_record(
    turbine: TurbineLike, *, duration: float, rate: float, seed: int = 0, loads: LoadSource = "random"
) -> Record:
    """What the turbine's sensors record at its usual rotor speed; SI, reproducible for a seed.

    Parameters
    ----------
    duration
        [s].
    rate
        Samples per second [Hz].
    loads
        ``"random"``: the turbine file's Gauss–Markov loads. ``"wind"``: turbulent wind on the packaged blades
        (docs/wind.md), as if tower and blades stood still. ``"wind-feedback"``: with their motion, aerodynamic damping included.

    Raises
    ------
    ConfigurationError
        If duration or rate are out of range, the turbine has no packaged wind, or the motion grows without bound.
    """
    turbine = as_turbine(turbine)
    fastest = max(turbine.natural_frequency(name) for name in turbine.model.coordinates) / (2.0 * np.pi)
    if not (np.isfinite(rate) and 4.0 * fastest <= rate <= 1e5):
        raise ConfigurationError(
            f"rate: expected {4.0 * fastest:.3g} to 100000 Hz (four samples per period of the fastest spring), got {rate:g}"
        )
    if not (np.isfinite(duration) and duration > 0.0):
        raise ConfigurationError(f"duration: expected a positive time in seconds, got {duration:g}")
    columns = 4 * len(turbine.model.states) + 3 * (3 + len(turbine.loads) + len(turbine.sensors))
    needed, there = 8e-9 * columns * rate * (LEAD_IN + duration), memory()
    if needed > SHARE * there:
        raise ConfigurationError(
            f"{duration:g} s at {rate:g} Hz need about {needed:.3g} GB of memory, and this machine has {there:.3g} GB: "
            f"simulate {SHARE * there / needed * duration:.2g} s at most, or at a lower rate"
        )
    rng = np.random.default_rng(seed)
    model = compile_model(turbine.model, turbine.sensors)
    lead = round(LEAD_IN * rate)
    rotor = constant_speed_inputs(turbine.rotor_speed, LEAD_IN + duration, rate)
    turning, yaw = rotor[:, :2], isinstance(turbine.model, TowerModel)
    if yaw:  # the nacelle stays where it is
        rotor = np.hstack([turning, np.zeros((len(turning), 3))])
    p = np.array([turbine.values[name] for name in model.parameters])
    start, substeps = np.zeros(len(model.states)), max(1, int(np.ceil(20.0 * fastest / rate)))
    if loads == "random":
        drawn = gauss_markov_loads(turbine.loads, model.loads, len(rotor), rate, rng, rotor[:, 0])
        response = integrate(model, p, np.hstack([rotor, drawn]), rate=rate, start=start, substeps=substeps)
    else:
        from windsysid.wind import packaged_wind, wind_loads
        from windsysid.wind.feedback import integrate_with_feedback

        wind = wind_loads(turbine, *packaged_wind(turbine.name), rotor, rate=rate, seed=seed)
        damping = wind.damping if loads == "wind-feedback" else np.zeros_like(wind.damping)
        response, _ = integrate_with_feedback(
            model, p, np.hstack([rotor, wind.loads]), damping, rate=rate, start=start, substeps=substeps
        )
    noise = rng.standard_normal(response.readings.shape) * [sensor.noise for sensor in turbine.sensors]
    bias = rng.standard_normal(len(turbine.sensors)) * [sensor.bias for sensor in turbine.sensors]
    scada = [np.mod(rotor[lead:, :1], 2.0 * np.pi), rotor[lead:, 1:2], *([rotor[lead:, 2:3]] if yaw else [])]
    values = np.hstack([*scada, (response.readings + noise + bias)[lead:]])
    known = (("rotor_azimuth", "rad"), ("rotor_speed", "rad/s"), *([("nacelle_yaw", "rad")] if yaw else []))
    return Record(
        time=np.arange(len(values)) / rate,
        values=values,
        channels=(*(name for name, _ in known), *(sensor.channel for sensor in turbine.sensors)),
        units=(*(unit for _, unit in known), *(sensor.unit for sensor in turbine.sensors)),
        name=f"simulated record, seed {seed}",
        attributes={"source": f"windsysid simulate, turbine {turbine.name}, loads {loads}, seed {seed}"},
    )


def memory() -> float:
    """Memory of this machine [GB]; 16 where it does not tell."""
    try:
        return 1e-9 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):
        return 16.0


def constant_speed_inputs(rotor_speed: float, duration: float, rate: float) -> Array:
    """Inputs of a rotor at constant speed: ψ from 0, Ω, dΩ/dt = 0; (T, 3) with T = duration · rate."""
    time = np.arange(round(duration * rate)) / rate
    return np.column_stack([rotor_speed * time, np.full_like(time, rotor_speed), np.zeros_like(time)])


def gauss_markov_loads(
    loads: Sequence[GaussMarkov],
    names: Sequence[str],
    samples: int,
    rate: float,
    rng: np.random.Generator,
    azimuth: Array | None = None,
) -> Array:
    """Draw stationary loads, one column per name in `names` (T, n_w); zero where none is modelled. Harmonics need ψ (T,)."""
    from scipy.signal import lfilter

    drawn = np.zeros((samples, len(names)))
    for load in loads:
        factor, variance = (matrix[0, 0] for matrix in load.discretise(1.0 / rate))
        noise = rng.standard_normal((samples, len(load.states))) * np.sqrt(variance)
        noise[:1] *= load.rms / np.sqrt(variance)
        process = lfilter([1.0], [1.0, -factor], noise, axis=0)
        if load.harmonic:
            if azimuth is None:
                raise ValueError(f"load '{load.load}': a harmonic of the rotor needs the azimuth")
            process = process * np.column_stack([np.cos(load.harmonic * azimuth), np.sin(load.harmonic * azimuth)])
        drawn[:, list(names).index(load.load)] += process.sum(axis=1)
    return drawn


@lru_cache(maxsize=1)
def _kernel() -> Any:
    model, vector, matrix = types.FunctionType(VALUE), types.float64[::1], types.float64[:, ::1]
    integer, real = types.int64, types.float64
    return compiled(
        _integrate,
        types.void(model, model, vector, matrix, integer, vector, real, integer, matrix, matrix, matrix),
    )


def _integrate(
    rates: Any, reading: Any, p: Any, inputs: Any, nu: int, start: Any, step: float, substeps: int,
    states: Any, state_rates: Any, readings: Any,
) -> None:  # fmt: skip
    n, columns = start.size, inputs.shape[1]
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
        rates(x, now[:nu], p, now[nu:], state_rates[k])
        reading(x, now[:nu], p, now[nu:], readings[k])
        for i in range(n):
            states[k, i] = x[i]

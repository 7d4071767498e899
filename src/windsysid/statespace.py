"""Composition: mechanics + loads + biases + parameters + sensors → one state-space model.

The state is [x | z | b | θ] (mechanical states, load states, sensor biases, parameters); any block may be empty.
`compose` builds it and nothing else does; the filters see only the `StateSpace` it returns.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windsysid.errors import ConfigurationError
from windsysid.mechanics.compile import CompiledModel, Model, compile_model
from windsysid.transition import Blocks

__all__ = ["GaussMarkov", "Parameter", "StateSpace", "compose"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Parameter:
    """A physical parameter to identify, with its prior in filter coordinates.

    Stiffness and mass are log-scaled, p = scale · exp(θ), and stay positive. Damping is linear, p = scale · θ, and
    may be negative: a stalled blade is exactly what must be seen.

    Attributes
    ----------
    name
        Name of the model's parameter.
    centre
        Prior mean (linear) or median (logarithmic) of the parameter, in SI.
    spread
        Prior standard deviation: relative for a logarithmic parameter, in SI for a linear one.
    logarithmic
        Whether θ = ln(p / centre).
    scale
        Scale of a linear parameter [SI], 2√(km) for a damper; ignored for a logarithmic one.
    """

    name: str
    centre: float
    spread: float
    logarithmic: bool = True
    scale: float = 1.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.centre) and np.isfinite(self.spread) and self.spread > 0.0):
            raise ConfigurationError(
                f"prior of '{self.name}': expected a finite centre and a positive spread, got {self.centre} ± {self.spread}"
            )
        if (self.logarithmic and self.centre <= 0.0) or not self.scale > 0.0:
            raise ConfigurationError(f"prior of '{self.name}': expected a positive value, got {self.centre}")

    @property
    def reference(self) -> float:
        """Physical value at θ = 0 (logarithmic) or θ = 1 (linear)."""
        return self.centre if self.logarithmic else self.scale

    @property
    def prior(self) -> tuple[float, float]:
        """Mean and standard deviation of θ."""
        return (0.0, self.spread) if self.logarithmic else (self.centre / self.scale, self.spread / self.scale)

    def physical(self, theta: ArrayLike) -> Array:
        """The parameter in SI for values of θ."""
        theta = np.asarray(theta, dtype=np.float64)
        return self.reference * (np.exp(theta) if self.logarithmic else theta)


@dataclass(frozen=True)
class GaussMarkov:
    """A first-order Gauss–Markov load on one degree of freedom: mean zero, correlation exp(−|t| / time_constant).

    Attributes
    ----------
    load
        Name of the model's load.
    rms
        Stationary standard deviation [N or N·m].
    time_constant
        [s].
    """

    load: str
    rms: float
    time_constant: float

    def __post_init__(self) -> None:
        if not (self.rms > 0.0 and self.time_constant > 0.0 and np.isfinite(self.rms * self.time_constant)):
            raise ConfigurationError(
                f"load '{self.load}': expected a positive rms and time constant, got {self.rms} and {self.time_constant}"
            )

    def discretise(self, step: float) -> tuple[float, float]:
        """Transition factor and noise variance over `step` seconds, exact."""
        factor = float(np.exp(-step / self.time_constant))
        return factor, self.rms**2 * -float(np.expm1(-2.0 * step / self.time_constant))


@dataclass(frozen=True)
class StateSpace:
    """A composed model: what every filter runs.

    Attributes
    ----------
    compiled
        Kernels of rates and readings.
    blocks
        The composition as arrays (`windsysid.transition.Blocks`).
    states
        Names of all n states, in order: mechanical, loads, biases, parameters.
    parameters
        The identified parameters.
    readings
        Channel names of the m readings.
    mean, cov
        Prior (n,), (n, n) at the first sample.
    """

    compiled: CompiledModel
    blocks: Blocks
    states: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    readings: tuple[str, ...]
    mean: Array
    cov: Array

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the columns of the input array: known inputs, then known loads."""
        return (*self.compiled.inputs, *self.compiled.loads)

    @property
    def rate(self) -> float:
        """Samples per second [Hz]."""
        return 1.0 / float(self.blocks.step[0])

    @cached_property
    def parameter_block(self) -> slice:
        """Where θ sits in the state."""
        return slice(len(self.states) - len(self.parameters), len(self.states))


def compose(
    model: Model,
    *,
    rate: float,
    values: Mapping[str, float],
    parameters: Sequence[Parameter] = (),
    loads: Sequence[GaussMarkov] = (),
    sensors: Sequence[Any] = (),
    mean: ArrayLike | None = None,
    cov: ArrayLike | None = None,
    walk: Mapping[str, float] | None = None,
) -> StateSpace:
    """Build the state-space model of `model` seen through `sensors`.

    Parameters
    ----------
    model
        A `RotorModel` or any `Equations`.
    rate
        Samples per second [Hz].
    values
        Value of every parameter of the model that is not identified, SI.
    parameters
        The parameters to identify; their derivatives are compiled.
    loads
        Loads that are states. Loads without one are zero or known inputs.
    sensors
        Sensors of the readings, with ``channel``, ``noise`` and ``bias``.
    mean, cov
        Prior of the mechanical states (n_x,), (n_x, n_x); zero and the identity by default.
    walk
        Standard deviation per √s of a parameter that drifts, in filter coordinates.

    Raises
    ------
    ConfigurationError
        If a value is missing or not finite, a load is unknown or modelled twice, the rate or a noise is not positive, a channel
        is read twice, or the prior does not fit the states.
    """
    compiled = compile_model(model, sensors, [parameter.name for parameter in parameters])
    if not (np.isfinite(rate) and rate > 0.0):
        raise ConfigurationError(f"sampling rate: expected a positive number of Hz, got {rate}")
    step = 1.0 / rate
    p = np.empty(len(compiled.parameters))
    known = dict(values) | {parameter.name: parameter.centre for parameter in parameters}
    for i, name in enumerate(compiled.parameters):
        if name not in known or not np.isfinite(known[name]):
            raise ConfigurationError(f"parameter '{name}': expected a finite value, got {known.get(name, 'none')}")
        p[i] = known[name]

    driven = [load.load for load in loads]
    for name in driven:
        if name not in compiled.loads or driven.count(name) > 1:
            raise ConfigurationError(
                f"load '{name}': expected each of {', '.join(compiled.loads) or 'no loads'} at most once"
            )
    _check_sensors(sensors)
    drift = dict(walk or {})
    _check_walk(drift, [parameter.name for parameter in parameters])
    discrete = [load.discretise(step) for load in loads]
    output = np.zeros((len(compiled.loads), len(loads)))
    for column, name in enumerate(driven):
        output[compiled.loads.index(name), column] = 1.0

    biased = [sensor for sensor in sensors if sensor.bias > 0.0]
    bias_of = np.array([biased.index(s) if s in biased else -1 for s in sensors], dtype=np.int64)
    nx, nz, nb, nt = len(compiled.states), len(loads), len(biased), len(parameters)
    blocks = Blocks(
        sizes=np.array([nx, nz, nb, nt, len(compiled.inputs), len(compiled.loads)], dtype=np.int64),
        step=np.array([step]),
        p=p,
        chosen=np.array([compiled.parameters.index(q.name) for q in parameters], dtype=np.int64),
        reference=np.array([q.reference for q in parameters], dtype=np.float64),
        logarithmic=np.array([q.logarithmic for q in parameters], dtype=np.int64),
        load_transition=np.diag([factor for factor, _ in discrete]).reshape(nz, nz),
        load_output=output,
        load_noise=np.diag([variance for _, variance in discrete]).reshape(nz, nz),
        walk=np.array([0.0] * nb + [drift.get(q.name, 0.0) ** 2 * step for q in parameters], dtype=np.float64),
        bias_of=bias_of,
        noise=np.array([sensor.noise**2 for sensor in sensors], dtype=np.float64),
    )
    prior = [q.prior for q in parameters]
    full_cov = np.zeros((nx + nz + nb + nt,) * 2)
    full_cov[:nx, :nx] = _prior("covariance", np.eye(nx) if cov is None else cov, (nx, nx))
    spread = [load.rms for load in loads] + [sensor.bias for sensor in biased] + [std for _, std in prior]
    full_cov[range(nx, nx + nz + nb + nt), range(nx, nx + nz + nb + nt)] = np.square(spread)
    full_mean = np.zeros(nx + nz + nb + nt)
    full_mean[:nx] = _prior("mean", np.zeros(nx) if mean is None else mean, (nx,))
    full_mean[nx + nz + nb :] = [centre for centre, _ in prior]
    return StateSpace(
        compiled=compiled,
        blocks=blocks,
        states=(
            *compiled.states,
            *driven,
            *(f"bias_{sensor.channel}" for sensor in biased),
            *(parameter.name for parameter in parameters),
        ),
        parameters=tuple(parameters),
        readings=tuple(sensor.channel for sensor in sensors),
        mean=full_mean,
        cov=full_cov,
    )


def _prior(what: str, given: ArrayLike, shape: tuple[int, ...]) -> Array:
    """The prior of the mechanical states as an array of the shape they need."""
    array = np.asarray(given, dtype=np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise ConfigurationError(
            f"prior {what}: expected {' × '.join(map(str, shape))} finite numbers, one per mechanical state, "
            f"got shape {array.shape}"
        )
    return array


def _check_sensors(sensors: Sequence[Any]) -> None:
    channels = [sensor.channel for sensor in sensors]
    for sensor in sensors:
        if channels.count(sensor.channel) > 1:
            raise ConfigurationError(f"channel '{sensor.channel}' is read twice: list each channel once")
        if not (np.isfinite(sensor.noise) and sensor.noise > 0.0):
            raise ConfigurationError(f"sensor '{sensor.channel}': expected a positive noise, got {sensor.noise}")


def _check_walk(walk: Mapping[str, float], identified: Sequence[str]) -> None:
    for name, deviation in walk.items():
        if name not in identified:
            raise ConfigurationError(
                f"walk: '{name}' is not identified: expected one of {', '.join(identified) or 'no parameters'}"
            )
        if not (np.isfinite(deviation) and deviation >= 0.0):
            raise ConfigurationError(f"walk of '{name}': expected a finite number, 0 or more, got {deviation}")

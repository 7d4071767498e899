"""Composition: mechanics + loads + biases + parameters + sensors → one state-space model.

The state is [x | z | b | θ] (mechanical states, load states, sensor biases, parameters); any block may be empty.
`compose` builds it and nothing else does; the filters see only the `StateSpace` it returns.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.mechanics.compile import CompiledModel, compile_model
from windsysid.mechanics.model import Model
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.within_step import within_step
from windsysid.statespace.workspace import Blocks

__all__ = ["LoadBlocks", "StateSpace", "compose", "discretise_loads", "parameters_given"]


@dataclass(frozen=True)
class StateSpace:
    """Composed state-space model, as every filter runs it.

    Attributes
    ----------
    compiled
        Kernels of rates and readings.
    blocks
        The composition as arrays (`windsysid.statespace.workspace.Blocks`).
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
        """Names of the input array's columns: known inputs, known loads, and the interval where there are several."""
        which = ("interval",) if self.blocks.step.size > 1 else ()
        return (*self.compiled.inputs, *self.compiled.loads, *which)

    @cached_property
    def parameter_block(self) -> slice:
        """Indices of θ in the state."""
        return slice(len(self.states) - len(self.parameters), len(self.states))


def compose(
    model: Model,
    *,
    rate: float | None = None,
    intervals: ArrayLike | None = None,
    values: Mapping[str, float],
    parameters: Sequence[Parameter] = (),
    loads: Sequence[LoadModel] = (),
    continuous: bool = False,
    sensors: Sequence[Any] = (),
    mean: ArrayLike | None = None,
    cov: ArrayLike | None = None,
    walk: Mapping[str, float] | None = None,
    gate: float | None = None,
) -> StateSpace:
    """Compose the state-space model of `model` with `sensors`, loads and priors.

    Parameters
    ----------
    model : Equations or MechanicalModel
        Equations of motion.
    rate : float, optional
        Sampling rate [Hz].
    intervals : array_like, optional
        For unequal sampling, instead of `rate`: the sampling intervals that occur [s], (S,).
    values : mapping of str to float
        Value of every parameter of the model that is not identified, in SI.
    parameters : sequence of Parameter, optional
        The parameters to identify; their derivatives are compiled.
    loads : sequence of GaussMarkov or LoadBlock, optional
        Models of the loads that are states; those on one degree of freedom add up. Loads without one are zero or known
        inputs.
    continuous : bool, default False
        True if such loads vary between samples as their processes do, as on a real machine; by default they vary
        linearly, as known loads and those of a simulation.
    sensors : sequence of Reading or Sensor, optional
        Sensors of the readings, with ``channel``, ``noise``, ``bias`` and ``drift`` where there is a bias.
    mean, cov : array_like, optional
        Prior of the mechanical states (n_x,), (n_x, n_x), in their units; zero and the identity by default.
    walk : mapping of str to float, optional
        Standard deviation per √s of a parameter that drifts, in filter coordinates.
    gate : float, optional
        Standard deviations of its own innovation [1] beyond which a reading is left out as if it were missing, and
        reported (`windsysid.filters.Info`, ``gated``). By default none is left out.

    Returns
    -------
    StateSpace
        The model that every filter runs, of n states and m readings.

    Raises
    ------
    ConfigurationError
        If a value is missing or not finite, a load is unknown or two blocks share a state's name, the rate, a noise or
        the gate is not positive, a channel is read twice, or the prior does not fit the states.

    References
    ----------
    Van Loan, IEEE Trans. Automatic Control 23(3), 1978, doi:10.1109/TAC.1978.1101743 (discretisation of loads).

    Examples
    --------
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, w - 0.2 * v - k * q))
    >>> load = ws.models.GaussMarkov("w", rms=1.0, time_constant=0.5)
    >>> sensor = ws.models.Reading("position", q, noise=0.01)
    >>> stiffness = ws.models.Parameter("k", 4.0, 0.5)
    >>> model = ws.models.compose(spring, rate=20.0, values={}, parameters=[stiffness], loads=[load], sensors=[sensor])
    >>> model.states, model.cov.shape
    (('q', 'v', 'w', 'k'), (4, 4))
    """
    names = [parameter.name for parameter in parameters]
    compiled = compile_model(model, sensors, names)
    steps = _intervals(rate, intervals)
    _check_sensors(sensors)
    if gate is not None and not gate > 0.0:
        raise ConfigurationError(f"gate: expected a positive number of standard deviations, got {gate}")
    biased, bias_of, noise = _sensor_arrays(sensors)
    walking = _walking(walk or {}, biased, names)
    load_states, load_cov, load_output = _join_loads(loads, compiled)
    transition, load_noise, within = _discretise(loads, steps, len(load_states), continuous=continuous)
    sizes = [compiled.states, load_states, biased, parameters, compiled.inputs, compiled.loads]
    blocks = Blocks(
        sizes=np.array(list(map(len, sizes)), dtype=np.int64),
        step=steps,
        azimuth=np.array([compiled.inputs.index("rotor_azimuth") if len(load_output) > 1 else -1], dtype=np.int64),
        **_parameter_arrays(compiled, values, parameters),
        load_transition=transition,
        load_noise=load_noise,
        load_output=load_output,
        load_within=within,
        walk=np.outer(steps, np.square(walking)),
        bias_of=bias_of,
        noise=noise,
        gate=np.array([np.inf if gate is None else gate], dtype=np.float64),
    )
    full_mean, full_cov = _joint_prior(_prior(len(compiled.states), mean, cov), load_cov, biased, parameters)
    return StateSpace(
        compiled=compiled,
        blocks=blocks,
        states=(*compiled.states, *load_states, *(f"bias_{sensor.channel}" for sensor in biased), *names),
        parameters=tuple(parameters),
        readings=tuple(sensor.channel for sensor in sensors),
        mean=full_mean,
        cov=full_cov,
    )


def _sensor_arrays(sensors: Sequence[Any]) -> tuple[list[Any], NDArray[np.int64], Array]:
    """Sensors with a bias, the number of each sensor's among them or −1 (m,), and the variance of its noise (m,)."""
    biased = [sensor for sensor in sensors if sensor.bias > 0.0]
    bias_of = np.array([biased.index(s) if s in biased else -1 for s in sensors], dtype=np.int64)
    return biased, bias_of, np.array([sensor.noise**2 for sensor in sensors], dtype=np.float64)


def _parameter_arrays(
    compiled: CompiledModel, values: Mapping[str, float], parameters: Sequence[Parameter]
) -> dict[str, Array]:
    """Parameters in `Blocks`."""
    p = np.empty(len(compiled.parameters))
    known = dict(values) | {parameter.name: parameter.centre for parameter in parameters}
    for i, name in enumerate(compiled.parameters):
        if name not in known or not np.isfinite(known[name]):
            raise ConfigurationError(f"parameter '{name}': expected a finite value, got {known.get(name, 'none')}")
        p[i] = known[name]
    return {
        "p": p,
        "chosen": np.array([compiled.parameters.index(q.name) for q in parameters], dtype=np.int64),
        "reference": np.array([q.reference for q in parameters], dtype=np.float64),
        "logarithmic": np.array([q.logarithmic for q in parameters], dtype=np.int64),
    }


def _joint_prior(
    mechanical: tuple[Array, Array], load_cov: Array, biased: Sequence[Any], parameters: Sequence[Parameter]
) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of the whole state, from those of the mechanical states (n_x,), (n_x, n_x)."""
    prior = [q.prior for q in parameters]
    spread = [sensor.bias for sensor in biased] + [std for _, std in prior]
    nx, nz, rest = len(mechanical[0]), len(load_cov), len(spread)
    cov = np.zeros((nx + nz + rest,) * 2)
    cov[:nx, :nx] = mechanical[1]
    cov[nx : nx + nz, nx : nx + nz] = load_cov
    cov[nx + nz :, nx + nz :] = np.diag(np.square(spread))
    return np.concatenate([mechanical[0], np.zeros(nz + len(biased)), [centre for centre, _ in prior]]), cov


class LoadBlocks(NamedTuple):
    """Load models together, over each of S sampling intervals.

    Attributes
    ----------
    cov
        Stationary covariance of their states (n_z, n_z).
    output
        H₀, C₁, S₁ … (1 + 2K, n_w, n_z).
    transition, noise
        Φ and Q (S, n_z, n_z).
    within
        R (S, n_z, r).
    """

    cov: Array
    output: Array
    transition: Array
    noise: Array
    within: Array


def discretise_loads(
    loads: Sequence[LoadModel], compiled: CompiledModel, steps: Array, *, continuous: bool = False
) -> LoadBlocks:
    """Put load models together for a model, over sampling intervals (S,) [s]; `continuous` as for `compose`."""
    names, cov, output = _join_loads(loads, compiled)
    return LoadBlocks(cov, output, *_discretise(loads, steps, len(names), continuous=continuous))


def _discretise(loads: Sequence[LoadModel], steps: Array, size: int, *, continuous: bool) -> tuple[Array, Array, Array]:
    """Φ, Q (S, n_z, n_z) and R (S, n_z, r) of all loads together."""
    each = [[load.discretise(float(step)) for load in loads] for step in steps]
    within = [[within_step(load, float(step)) for load in loads] for step in steps] if continuous else [[]] * len(steps)
    return (
        _diagonal([[transition for transition, _ in parts] for parts in each], size),
        _diagonal([[noise for _, noise in parts] for parts in each], size),
        _diagonal(within, size),
    )


def parameters_given(
    model: StateSpace, compiled: CompiledModel, theta: Array, loads: LoadBlocks, noise: ArrayLike
) -> StateSpace:
    """The model with its parameters known to be θ (n_θ,) instead of in the state, and with other loads and noise of the
    same structure.

    What `compose` would build without parameters, at a fraction of its time: a likelihood is computed at thousands of
    θ.

    Parameters
    ----------
    compiled
        The kernels without derivatives to parameters.
    loads
        Load models with the states of those that `model` has (`discretise_loads`).
    noise
        Standard deviation of each reading's noise (m,).
    """
    blocks = model.blocks
    nx, nz, nb, _, nu, nw = blocks.sizes
    n = nx + nz + nb
    p = np.zeros(len(compiled.parameters))  # those of instruments come after the model's
    p[: len(blocks.p)] = blocks.p
    p[blocks.chosen] = blocks.reference * np.where(blocks.logarithmic == 1, np.exp(theta), theta)
    cov = model.cov[:n, :n].copy()
    cov[nx : nx + nz, nx : nx + nz] = loads.cov
    return StateSpace(
        compiled=compiled,
        blocks=blocks._replace(
            sizes=np.array([nx, nz, nb, 0, nu, nw], dtype=np.int64),
            p=p,
            chosen=blocks.chosen[:0],
            reference=blocks.reference[:0],
            logarithmic=blocks.logarithmic[:0],
            load_transition=loads.transition,
            load_noise=loads.noise,
            load_output=loads.output,
            load_within=loads.within,
            walk=np.ascontiguousarray(blocks.walk[:, :nb]),
            noise=np.square(np.asarray(noise, dtype=np.float64)),
        ),
        states=model.states[:n],
        parameters=(),
        readings=model.readings,
        mean=model.mean[:n].copy(),
        cov=cov,
    )


def _intervals(rate: float | None, intervals: ArrayLike | None) -> Array:
    """The sampling intervals (S,) [s]."""
    if (rate is None) == (intervals is None):
        raise ConfigurationError("sampling: expected either a rate or the intervals that occur, got both or neither")
    if rate is not None:
        if not (np.isfinite(rate) and rate > 0.0):
            raise ConfigurationError(f"sampling rate: expected a positive number of Hz, got {rate}")
        return np.array([1.0 / rate])
    steps = np.asarray(intervals, dtype=np.float64)
    if steps.ndim != 1 or not steps.size or not (np.isfinite(steps).all() and (steps > 0.0).all()):
        raise ConfigurationError(f"sampling intervals: expected one or more positive numbers of seconds, got {steps}")
    return steps.copy()


def _join_loads(loads: Sequence[LoadModel], compiled: CompiledModel) -> tuple[list[str], Array, Array]:
    """Names of all load states, their covariance (n_z, n_z) and H₀, C₁, S₁ … (1 + 2K, n_w, n_z)."""
    names = [name for load in loads for name in load.states]
    _check_loads(loads, names, compiled.loads)
    rows = max((len(matrix) for load in loads for matrix in load.outputs.values()), default=1)
    if rows > 1 and "rotor_azimuth" not in compiled.inputs:
        raise ConfigurationError("a load that turns with the rotor needs a model with the input 'rotor_azimuth'")
    return names, *_summed(loads, compiled, rows, len(names))


def _check_loads(loads: Sequence[LoadModel], states: Sequence[str], known: Sequence[str]) -> None:
    """Refuse two states of one name, and a load that the model does not have."""
    for name in states:
        if states.count(name) > 1:
            raise ConfigurationError(f"load '{name}': two load models have a state of this name: expected each once")
    for name in (name for load in loads for name in load.outputs):
        if name not in known:
            raise ConfigurationError(f"load '{name}': expected one of {', '.join(known) or 'no loads'}")


def _summed(loads: Sequence[LoadModel], compiled: CompiledModel, rows: int, size: int) -> tuple[Array, Array]:
    """Covariance (n_z, n_z) of all load states and H₀, C₁, S₁ … (rows, n_w, n_z) of all loads."""
    output = np.zeros((rows, len(compiled.loads), size))
    first = 0
    for load in loads:
        for name, matrix in load.outputs.items():
            output[: len(matrix), compiled.loads.index(name), first : first + len(load.states)] += matrix
        first += len(load.states)
    return _diagonal([[load.cov for load in loads]], size)[0], output


def _diagonal(blocks: Sequence[Sequence[Array]], size: int) -> Array:
    """Block-diagonal matrices (S, size, columns), one for each list of blocks."""
    whole = np.zeros((len(blocks), size, max(sum(part.shape[1] for part in parts) for parts in blocks)))
    for matrix, parts in zip(whole, blocks, strict=True):
        row = column = 0
        for part in parts:
            matrix[row : row + len(part), column : column + part.shape[1]] = part
            row, column = row + len(part), column + part.shape[1]
    return whole


def _prior(size: int, mean: ArrayLike | None, cov: ArrayLike | None) -> tuple[Array, Array]:
    """Prior mean (n_x,) and covariance (n_x, n_x) of the mechanical states: those given, or zero and the identity."""
    centre = np.asarray(np.zeros(size) if mean is None else mean, dtype=np.float64)
    spread = np.asarray(np.eye(size) if cov is None else cov, dtype=np.float64)
    for what, array, shape in (("mean", centre, (size,)), ("covariance", spread, (size, size))):
        if array.shape != shape or not np.isfinite(array).all():
            raise ConfigurationError(
                f"prior {what}: expected {' × '.join(map(str, shape))} finite numbers, one per mechanical state, "
                f"got shape {array.shape}"
            )
    return centre, spread


def _check_sensors(sensors: Sequence[Any]) -> None:
    channels = [sensor.channel for sensor in sensors]
    for sensor in sensors:
        if channels.count(sensor.channel) > 1:
            raise ConfigurationError(f"channel '{sensor.channel}' is read twice: list each channel once")
        if not (np.isfinite(sensor.noise) and sensor.noise > 0.0):
            raise ConfigurationError(f"sensor '{sensor.channel}': expected a positive noise, got {sensor.noise}")


def _walking(walk: Mapping[str, float], biased: Sequence[Any], identified: Sequence[str]) -> list[float]:
    """Standard deviations per √s of all biases and parameters."""
    for name, deviation in walk.items():
        if name not in identified:
            raise ConfigurationError(
                f"walk: '{name}' is not identified: expected one of {', '.join(identified) or 'no parameters'}"
            )
        if not (np.isfinite(deviation) and deviation >= 0.0):
            raise ConfigurationError(f"walk of '{name}': expected a finite number, 0 or more, got {deviation}")
    return [*(getattr(sensor, "drift", 0.0) for sensor in biased), *(walk.get(name, 0.0) for name in identified)]

"""The problem that a record poses to one's own equations: inputs, readings, prior, model at given unknowns."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.errors import ConfigurationError, RecordError
from windsysid.filters import EKF
from windsysid.identification.condition.samples import Samples
from windsysid.identification.model.problem import FIRST_LOG_STD
from windsysid.mechanics.compile import CompiledModel
from windsysid.mechanics.model import Model
from windsysid.records.record import LOW_PASS, Record
from windsysid.results.finding import Finding
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.unknowns import Unknowns

__all__ = [
    "EquationsJob", "OwnProblem", "constant_loads", "known_columns", "loads_behind_low_pass", "read_columns",
    "state_only_model",
]  # fmt: skip


LOG_LEVEL_STD = 1.5
"""Setting: prior standard deviation of the logarithm of a level: noise and loads may be 4 to 5 times off."""

NOISE_FACTORS = (1.0, 10.0, 100.0)
"""Setting: factors on all noise with which the joint filter looks for a start."""


class EquationsJob(NamedTuple):
    """User equations to be identified; attributes as of `windsysid.models.fit`."""

    model: Model
    parameters: tuple[Parameter, ...]
    sensors: tuple[Any, ...]
    mean: ArrayLike | None
    cov: ArrayLike | None
    values: Mapping[str, float]
    loads: tuple[LoadModel, ...]
    channels: Mapping[str, str]
    learn_levels: bool

    @property
    def readings(self) -> tuple[str, ...]:
        """The channels of the sensors."""
        return tuple(sensor.channel for sensor in self.sensors)

    @property
    def levels(self) -> Array:
        """Prior standard deviations of η (n_η,): of the noise of each reading, then of each load; none where they are
        not learned."""
        return np.full((len(self.sensors) + len(self.loads)) * self.learn_levels, LOG_LEVEL_STD)

    @property
    def centres(self) -> dict[str, float]:
        """Values of all parameters, those that are identified at the centres of their priors."""
        return {**self.values, **{q.name: q.centre for q in self.parameters}}


class OwnProblem(NamedTuple):
    """Unknowns of a record: θ and η, logarithms of factors on the noise of each reading and then on each load.

    Attributes
    ----------
    model
        The joint model, θ in the state.
    plain
        The state-only model at the centres of the priors.
    loads
        Models of the loads that are states.
    levels
        Prior standard deviations of η (n_η,); none where levels are not learned.
    """

    model: StateSpace
    plain: StateSpace
    loads: tuple[LoadModel, ...]
    levels: Array

    @property
    def unknowns(self) -> Unknowns:
        """Names of the unknowns."""
        levels = (*self.model.readings, *(load.states[0] for load in self.loads)) if len(self.levels) else ()
        return Unknowns(tuple(q.name for q in self.model.parameters), (), levels)

    def build(self, unknowns: Array) -> StateSpace:
        """The state-only model at the unknowns (n,)."""
        theta, eta = (unknowns[self.unknowns.of(block)] for block in ("parameters", "statistics"))
        return state_only_model(self.plain, self.model.parameters, self.loads, theta, eta)

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean and covariance of the unknowns."""
        block, known = self.model.parameter_block, self.unknowns
        cov, theta = np.diag(known.vector(statistics=np.square(self.levels))), known.of("parameters")
        cov[theta, theta] = self.model.cov[block, block]
        return known.vector(parameters=self.model.mean[block]), cov

    @property
    def wide_prior(self) -> tuple[Array, Array]:
        """Model without tolerances: readings are taken as exact."""
        return self.prior

    @property
    def clocks(self) -> tuple[Array, ...]:
        """None."""
        return ()

    def frequencies(self, unknowns: Array) -> tuple[float, ...]:
        """None are known."""
        return ()

    def start(self, inputs: Array, readings: Array) -> tuple[Array, Array]:
        """Start values of the unknowns and their uncertainty, from T samples."""
        return self.start_from([(inputs, readings)])

    def start_from(self, samples: Samples) -> tuple[Array, Array]:
        """Start values from samples in blocks."""
        block, theta = self.model.parameter_block, self.unknowns.of("parameters")
        mean, cov = self.prior
        best = -np.inf
        for factor in NOISE_FACTORS:
            noise = self.model.blocks.noise * factor**2
            louder = replace(self.model, blocks=self.model.blocks._replace(noise=noise))
            belief = EKF.init(louder)
            for inputs, readings in samples:
                belief = EKF.run(louder, belief, inputs, readings)[0]
            if not (np.isfinite(belief.mean).all() and np.isfinite(belief.cov).all()):
                continue
            at = self.unknowns.vector(parameters=belief.mean[block])
            if len(self.levels):  # of all levels together: rather too loud, from where a few steps lead down
                at[self.unknowns.of("statistics")] = np.log(_measure_excess(self.build(at), samples)[0])
            off = at - self.prior[0]
            log_likelihood = _measure_excess(self.build(at), samples)[1]
            reached = float(log_likelihood - 0.5 * off @ np.linalg.solve(self.prior[1], off))
            if reached > best:
                best, mean, cov = reached, at, np.diag(np.full(len(at), FIRST_LOG_STD**2))
                cov[theta, theta] = belief.cov[block, block]
        return mean, cov


def _measure_excess(model: StateSpace, samples: Samples) -> tuple[float, float]:
    """The greatest rms of a reading's innovations in their own standard deviations, 1 where nothing was read, and the
    log-likelihood."""
    belief, log_likelihood = EKF.init(model), 0.0
    total, number = np.zeros(len(model.readings)), np.zeros(len(model.readings))
    for inputs, readings in samples:
        belief, info = EKF.run(model, belief, inputs, readings)
        squares = np.square(info.innovation / info.innovation_std)
        total, number = total + np.nansum(squares, axis=0), number + np.isfinite(squares).sum(axis=0)
        log_likelihood += float(info.log_likelihood.sum())
    return float(np.sqrt((total / np.maximum(number, 1)).max())) or 1.0, log_likelihood


def state_only_model(
    plain: StateSpace, parameters: Sequence[Parameter], loads: Sequence[LoadModel], theta: Array, eta: Array
) -> StateSpace:
    """`plain` with the parameters θ and levels η: noise of each reading first, then one factor for each load; none
    where they are as given."""
    m, p = len(plain.readings), plain.blocks.p.copy()
    for q, value in zip(parameters, theta, strict=True):
        p[plain.compiled.parameters.index(q.name)] = float(q.physical(value))
    if not len(eta):
        return replace(plain, blocks=plain.blocks._replace(p=p))
    factor = np.exp(2.0 * eta)
    load_noise, within, cov = plain.blocks.load_noise.copy(), plain.blocks.load_within.copy(), plain.cov.copy()
    first = 0
    for load, power in zip(loads, factor[m:], strict=True):
        own = slice(first, first := first + len(load.states))
        load_noise[:, own, own] *= power
        within[:, own] *= math.sqrt(power)
        own = slice(own.start + len(plain.compiled.states), own.stop + len(plain.compiled.states))
        cov[own, own] *= power
    blocks = plain.blocks._replace(
        p=p, noise=plain.blocks.noise * factor[:m], load_noise=load_noise, load_within=within
    )
    return replace(plain, blocks=blocks, cov=cov)


def loads_behind_low_pass(
    loads: Sequence[LoadModel], record: Record
) -> tuple[tuple[LoadModel, ...], tuple[Finding, ...]]:
    """Load models as far as the record's low-pass passes them, and a note on those that cannot include it."""
    if LOW_PASS not in record.attributes:
        return tuple(loads), ()
    low_pass = float(record.attributes[LOW_PASS])
    passed = tuple(
        replace(load, low_pass=min(load.low_pass, low_pass)) if isinstance(load, GaussMarkov) else load
        for load in loads
    )
    others = [load.states[0] for load in loads if not isinstance(load, GaussMarkov)]
    note = Finding("low_pass_unknown_to_loads", "note", {"low_pass": low_pass, "loads": others})
    return passed, (note,) if others else ()


def constant_loads(acting: Sequence[str], record: Record, job: EquationsJob) -> dict[str, float]:
    """Constant value of each load of a model that was not measured: from `values`, and zero with a load model."""
    driven = {name for load in job.loads for name in load.outputs}
    constant = {}
    for name in acting:
        if name in job.channels or name in record:
            continue
        if name not in job.values and name not in driven:
            raise ConfigurationError(
                f"load '{name}' is not defined: expected a channel, a model in `loads`, or a constant in "
                f"`values` (0: it does not act); the record has {', '.join(record.channels)}"
            )
        constant[name] = float(job.values.get(name, 0.0))
    return constant


def known_columns(compiled: CompiledModel, record: Record, job: EquationsJob, constant: Mapping[str, float]) -> Array:
    """Known inputs and loads (T, n_u + n_w), measured or constant."""
    names = (*compiled.inputs, *compiled.loads)
    for name in job.channels:
        if name not in names:
            raise ConfigurationError(
                f"channels: '{name}' is no input or load of the model: expected one of {', '.join(names) or 'none'}"
            )
    columns = np.zeros((record.samples, len(names)))
    for column, name in enumerate(names):
        if name in constant:
            columns[:, column] = constant[name]
            continue
        channel = job.channels.get(name, name)
        columns[:, column] = record[channel]
        missing = int(np.isnan(columns[:, column]).sum())
        if missing:
            raise RecordError(
                f"channel '{channel}' is an input of the model and lacks {missing} of {record.samples} samples: "
                "expected all of them; choose a section without the gap, or fill it"
            )
    return columns


def read_columns(record: Record, sensors: Sequence[Any], *, first: bool = True) -> Array:
    """Readings of the sensors (T, m); in the first segment, each must hold numbers."""
    readings = np.column_stack([record[sensor.channel] for sensor in sensors])
    for sensor, values in zip(sensors, readings.T, strict=True):
        if first and not np.isfinite(values).any():
            raise RecordError(f"channel '{sensor.channel}' holds no numbers: leave it out of the sensors")
    return readings

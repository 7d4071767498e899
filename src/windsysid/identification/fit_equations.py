"""Fit: one's own equations + a record → estimates with bands. The front door for every structure that is no turbine.

The unknowns are the parameters θ and, beside them, the noise of every sensor and the level of every load, η. The record
is taken in as it would be on line (`windsysid.identification.estimate.online`); that history is kept. The result is the
mode of the posterior of the whole record on the likelihood of the state-only filter
(`windsysid.identification.estimate.scoring`).

The mode is climbed from where a joint filter ends. Far off, the likelihood has false summits, because the motion that
it expects has lost the phase of the one that was measured; the joint filter stays in phase. It also locks in what it
learns while linearised at wrong parameters, the more so the quieter the sensors are said to be, so it runs again with
all noise 10 and 100 times as loud, and the end that the state-only filter likes best is the start.
"""

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.checks.verdict import Diagnosis, diagnose
from windsysid.errors import ConfigurationError, RecordError
from windsysid.filters import EKF, Info
from windsysid.filters.bank import bank_of, run_bank
from windsysid.identification.condition.samples import Samples, SamplesOnDisk
from windsysid.identification.estimate.equations_spectra import EquationsQuestion, fit_by_spectra
from windsysid.identification.estimate.online import begin, spread_over_samples
from windsysid.identification.estimate.search import Solution, solve
from windsysid.identification.model.fit import no_innovations
from windsysid.inspection.health import Finding
from windsysid.inspection.screening import doubted, noted, screen
from windsysid.kernels.threads import one_thread
from windsysid.loads.statistics import Statistic
from windsysid.mechanics.model import Model
from windsysid.records.record import Record
from windsysid.results.identification import Estimate, Identification
from windsysid.results.posterior import SIGMAS
from windsysid.statespace.compose import StateSpace, compose
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.parameter import Parameter

if TYPE_CHECKING:
    import sympy as sp

from windsysid.identification.model.equations_problem import (
    OwnProblem,
    constant_loads,
    known_columns,
    loads_behind_low_pass,
    read_columns,
)

__all__ = ["Fit", "Reading", "fit"]

LEVEL_SPREAD = 1.5
"""Prior standard deviation of the logarithm of a level: noise and loads may be wrong by a factor of four or five."""

FIRST_FRACTION = 16
"""The first estimate on line comes after this fraction of the record."""

MAX_STEP_SHARE = 0.1
"""Share of a vibration's damping that may be the integration's."""


@dataclass(frozen=True)
class Reading:
    """What one channel reads of a model of one's own.

    Attributes
    ----------
    channel
        Name of the record's channel.
    expression
        What it reads: an expression in the model's states, inputs, parameters, loads and accelerations.
    noise
        Standard deviation of the white noise of one sample, in the channel's unit.
    bias
        Prior standard deviation of an unknown offset, in the channel's unit; 0: none.
    drift
        How fast that offset wanders: its standard deviation after one second, in the channel's unit per √s.
    """

    channel: str
    expression: "sp.Expr"
    noise: float
    bias: float = 0.0
    drift: float = 0.0

    @property
    def structure(self) -> str:
        """What its kernel depends on, as text."""
        from sympy import srepr

        return str(srepr(self.expression))


@dataclass(frozen=True, repr=False)
class Fit(Identification):
    """An `Identification` of one's own equations; `turbine` is their name.

    Attributes
    ----------
    states
        Names of the n states beside the parameters: the model's, its loads', its biases'.
    state_mean, state_std
        Each of them after each sample, at the estimates (T, n).
    """

    states: tuple[str, ...] = field(kw_only=True)
    state_mean: Array = field(kw_only=True)
    state_std: Array = field(kw_only=True)


@one_thread()
def fit(
    model: Model,
    record: Record | Iterable[Record],
    *,
    parameters: Sequence[Parameter],
    sensors: Sequence[Any],
    cov: ArrayLike | None = None,
    mean: ArrayLike | None = None,
    values: Mapping[str, float] | None = None,
    loads: Sequence[LoadModel] = (),
    channels: Mapping[str, str] | None = None,
    learn_levels: bool = True,
    formulation: Literal["joint", "spectral"] = "joint",
) -> Fit:
    """Identify parameters of `model` from `record`.

    Between two samples the filter takes one step of the fourth-order Runge–Kutta method, which damps a motion at ω by
    about (ωh)⁵/144 of the critical: 2e-5 at 20 samples a period, 7e-4 at 10. Inputs run linearly between samples.

    Parameters
    ----------
    model
        `Equations`, or anything that compiles.
    record
        Holds a channel for every sensor and every input of the model, and for the loads that were measured. Or its
        pieces in order, which are then held on disk: the result is the same, with innovations and states of the last
        samples only where there are many.
    parameters
        What to identify, each with its prior.
    sensors
        `Reading`, one per channel.
    cov, mean
        Prior of the model's states at the first sample, (n_x, n_x) and (n_x,); mean zero by default. Spectra need no
        `cov`; `mean` is where they look for the state at rest.
    values
        The parameters that are not identified, and loads that are constant, in the model's units: 0 for a load that
        does not act.
    loads
        Models of loads that were not measured. Where the record went through an anti-aliasing low-pass
        (`windsysid.signals.resample`), first-order loads are taken to have gone through it too.
    channels
        The channel of an input or a measured load, where it is not called what the model calls it.
    learn_levels
        Whether the noise of each sensor and the rms of each load are learned: what is given is then the median of a
        wide prior (a factor of 4.5 at one standard deviation). The shape of a load's spectrum stays as given.
    formulation
        ``"joint"``, or ``"spectral"`` for a stationary record of a structure that moves little: the equations are
        linearised about the state at rest, and the spectra are read (docs/spectral.md). It takes constant inputs only,
        and pieces need not follow each other.

    Returns
    -------
    Fit
        An `Identification`, with the model's states after each sample (T, n).

    Raises
    ------
    RecordError
        If the record lacks a channel, an input has gaps, or a sensor's channel holds no number.
    ConfigurationError
        If model, priors and sensors do not fit each other (`compose`), or a load of the model has neither channel nor
        model nor value.
    WindsysidError
        If every run of the filter diverges.
    """
    if not parameters:
        raise ConfigurationError("parameters: expected at least one to identify, got none")
    parameters = tuple(map(partial(_with_role, model), parameters))
    if formulation == "spectral":
        levels = np.full((len(sensors) + len(loads)) * learn_levels, LEVEL_SPREAD)
        question = EquationsQuestion(model, parameters, sensors, mean, values or {}, loads, channels or {}, levels)
        return _fit_by_spectra(question, record)
    if formulation != "joint":
        raise ConfigurationError(f"formulation: expected joint or spectral, got '{formulation}'")
    if cov is None:
        raise ConfigurationError("cov: expected the prior covariance of the states, got none: the joint fit needs it")
    prior: dict[str, Any] = {"sensors": sensors, "mean": mean, "cov": cov}
    taken = _take(
        record, model, parameters, dict(values or {}), loads, channels or {}, prior, learn_levels=learn_levels
    )
    problem, part, samples = taken.problem, taken.last, taken.samples
    joint, plain, loads = problem.model, problem.plain, problem.loads
    columns = len(joint.inputs), len(joint.readings)
    for space in (joint, plain):  # compiles or loads the kernels outside the clock
        EKF.run(space, EKF.init(space), np.empty((0, columns[0])), np.empty((0, columns[1])))
    run_bank(bank_of([plain]), np.empty((0, columns[0])), np.empty((0, columns[1])))
    started = time.perf_counter()
    nothing = begin(*problem.prior, -(-taken.number // FIRST_FRACTION), columns)
    found = solve(problem, samples, nothing, rate=part.rate, start=problem.start_from(samples))
    history = spread_over_samples(*problem.prior, found.history, taken.number)
    times = taken.begun + np.arange(taken.number) / part.rate if isinstance(samples, SamplesOnDisk) else part.time
    elapsed = time.perf_counter() - started

    theta, eta = problem.unknowns.of("parameters"), problem.unknowns.of("statistics")
    spread = np.sqrt(np.diag(found.cov))
    steps = _list_step_doubts(problem.build(found.mean), found.info, found.inputs)
    return Fit(
        method=f"posterior mode, {EKF.name}",
        formulation="fit",
        record=part.name,
        turbine=joint.compiled.name,
        sensors=joint.readings,
        section=(taken.begun, float(part.time[-1])),
        rate=part.rate,
        samples=taken.number,
        elapsed=elapsed,
        estimates=tuple(map(_describe_parameter, parameters, found.mean[theta], spread[theta])),
        modes=(),
        parameters=tuple(parameters),
        time=times,
        mean=history[0][:, theta],
        std=history[1][:, theta],
        cov=found.cov[theta, theta],
        readings=joint.readings,
        innovation=found.info.innovation,
        whitened=found.info.whitened,
        log_likelihood=found.log_likelihood,
        notes=(
            *taken.notes,
            *found.notes,
            *noted(taken.faults),
            *(() if np.isfinite(history[0]).all() else ("there is no history: the search on line lost its way",)),
        ),
        statistics=_describe_levels(part, sensors, loads, found.mean[eta], spread[eta]),
        diagnosis=_diagnose(found, theta, joint, part.rate, (*doubted(taken.faults), *steps)),
        states=plain.states,
        state_mean=found.info.mean,
        state_std=found.info.std,
    )


def _with_role(model: Model, q: Parameter) -> Parameter:
    """A parameter with its kind and part as the model has them, where the caller does not say."""
    if q.kind:
        return q
    kind, part = model.role(q.name)
    return replace(q, kind=kind, part=part)


def _fit_by_spectra(question: EquationsQuestion, record: Record | Iterable[Record]) -> Fit:
    """The result of spectra."""
    started = time.perf_counter()
    found = fit_by_spectra(question, record)
    parameters, sensors, loads = question.parameters, question.sensors, question.loads
    part, theta, eta = found.last, found.unknowns.of("parameters"), found.unknowns.of("statistics")
    at, cov = found.fit.unknowns, found.fit.cov
    spread, names = np.sqrt(np.diag(cov)), tuple(sensor.channel for sensor in sensors)
    nothing = no_innovations(len(sensors), found.fit.log_likelihood)
    return Fit(
        method="posterior mode, spectral likelihood",
        formulation="spectral",
        record=part.name,
        turbine=found.model,
        sensors=names,
        section=(found.begun, float(part.time[-1])),
        rate=part.rate,
        samples=found.samples,
        elapsed=time.perf_counter() - started,
        estimates=tuple(map(_describe_parameter, parameters, at[theta], spread[theta])),
        modes=(),
        parameters=tuple(parameters),
        time=part.time[-1:],
        mean=at[None, theta],
        std=spread[None, theta],
        cov=cov[theta, theta],
        readings=names,
        innovation=nothing.innovation,
        whitened=nothing.whitened,
        log_likelihood=found.fit.log_likelihood,
        notes=found.notes,
        statistics=_describe_levels(part, sensors, loads, at[eta], spread[eta]),
        diagnosis=diagnose(
            nothing, readings=names, rate=part.rate, frequencies=(), parameters=tuple(parameters), theta=at[theta],
            cov=cov[theta, theta], white=False, doubts=found.doubts,
        ),
        states=(),
        state_mean=nothing.mean,
        state_std=nothing.std,
    )  # fmt: skip


class _Taken(NamedTuple):
    """A record and what it poses: the samples, how many, when they begin [s], the last piece of them, and what is to be
    said."""

    problem: OwnProblem
    samples: Samples
    number: int
    begun: float
    last: Record
    notes: tuple[str, ...]
    faults: list[Finding]


def _take(
    record: Record | Iterable[Record], model: Model, parameters: Sequence[Parameter], known: dict[str, float],
    loads: Sequence[LoadModel], channels: Mapping[str, str], prior: Mapping[str, Any], *, learn_levels: bool,
) -> _Taken:  # fmt: skip
    """Pose the problem on the first piece, or the only one, and take all of them in."""
    sensors = prior["sensors"]
    whole = isinstance(record, Record)
    problem: OwnProblem | None = None
    last: Record | None = None
    faults: list[Finding] = []
    for piece in [record] if isinstance(record, Record) else record:
        part = piece.on_uniform_grid()
        if problem is None or last is None:
            begun, rate = float(part.time[0]), part.rate
            loads, notes = loads_behind_low_pass(loads, part)
            settings = {**prior, "rate": rate, "loads": loads, "continuous": True}
            joint = compose(model, values=known, parameters=parameters, **settings)
            known |= {q.name: q.centre for q in parameters}
            plain = compose(model, values=known, **settings)
            spreads = np.full((len(sensors) + len(loads)) * learn_levels, LEVEL_SPREAD)
            problem = OwnProblem(joint, plain, tuple(loads), spreads)
            constant = constant_loads(joint.compiled.loads, part, channels, loads, known)
            held = SamplesOnDisk((len(joint.inputs), len(sensors)))
        else:
            part = _go_on(last, part, sensors)
        inputs, readings = (
            known_columns(joint.compiled, part, channels, constant),
            read_columns(part, sensors, first=last is None),
        )
        faults += screen(piece, None, [sensor.channel for sensor in sensors], refuse=last is None)
        last = part
        if not whole:
            held.append(inputs, readings)
    if problem is None or last is None:
        raise RecordError("no pieces: expected at least one, got an empty record")
    samples: Samples = [(inputs, readings)] if whole else held
    number = len(readings) if whole else held.count
    return _Taken(problem, samples, number, begun, last, notes, faults)


def _go_on(before: Record, piece: Record, sensors: Sequence[Any]) -> Record:
    """A piece with the samples that are missing before it."""
    missing = [sensor.channel for sensor in sensors if sensor.channel not in piece]
    if missing:
        raise RecordError(f"{piece.name}: expected the channels of the first piece, got none of {', '.join(missing)}")
    if abs(piece.rate / before.rate - 1.0) > 0.01:
        raise RecordError(f"{piece.name}: expected pieces of {before.rate:.6g} Hz, got one of {piece.rate:.6g} Hz")
    steps = round((piece.time[0] - before.time[-1]) * before.rate)
    if steps < 1:
        raise RecordError(f"{piece.name}: expected a piece that begins after the one before, got an overlap")
    between = piece.time[0] - np.arange(steps - 1, 0, -1) / before.rate
    nothing = np.full((steps - 1, len(piece.channels)), np.nan)
    time, values = np.concatenate([between, piece.time]), np.vstack([nothing, piece.values])
    return replace(piece, time=time, values=values)


def _describe_parameter(q: Parameter, theta: float, std: float) -> Estimate:
    """A parameter in its own unit."""
    low, value, high = (float(q.physical(theta + k * std)) for k in (-SIGMAS, 0.0, SIGMAS))
    return Estimate(
        name=q.name, unit="", kind="parameter", estimate=value, low=low, high=high,
        std=float(std * (value if q.logarithmic else q.scale)),
        informed_by_data=float(np.clip(1.0 - (std / q.prior[1]) ** 2, 0.0, 1.0)),
        prior=q.centre, reference=None, average_error_percent=None,
    )  # fmt: skip


def _describe_levels(
    part: Record, sensors: Sequence[Any], loads: Sequence[LoadModel], eta: Array, spread: Array
) -> tuple[Statistic, ...]:
    """Noise of every sensor and rms of every load, from η and its standard deviations (n_η,); none where they are as
    given."""
    given = [Statistic(f"noise_{s.channel}", part.unit(s.channel), s.noise, kind="noise") for s in sensors]
    given += [Statistic(f"rms_{load.states[0]}", "", float(np.sqrt(load.cov[0, 0])), kind="level") for load in loads]
    found = []
    for one, middle, std in zip(given, eta, spread, strict=False):
        value, low, high = (one.given * np.exp(middle + k * std) for k in (0.0, -SIGMAS, SIGMAS))
        found.append(replace(one, estimate=value, low=low, high=high))
    return tuple(found)


def _list_step_doubts(model: StateSpace, info: Info, inputs: Array) -> tuple[str, ...]:
    """A doubt where the Runge–Kutta method itself makes more than `MAX_STEP_SHARE` of the damping of a vibration about
    the last state."""
    compiled, h = model.compiled, float(model.blocks.step[0])
    n, nu = len(compiled.states), len(compiled.inputs)
    if not (n and len(inputs)):
        return ()
    value, A = np.empty(n), np.zeros((n, n))
    B, G = np.zeros((n, len(compiled.identified))), np.zeros((n, len(compiled.loads)))
    at = np.ascontiguousarray(info.mean[-1, :n])
    compiled.rates_jacobian(at, inputs[-1, :nu], model.blocks.p, inputs[-1, nu:].copy(), value, A, B, G)
    if not np.isfinite(A).all():
        return ()
    exponents = np.linalg.eigvals(A)
    step = h * exponents[exponents.imag > 1e-6 * np.abs(exponents)]
    stepped = np.log(1.0 + step * (1.0 + step / 2.0 * (1.0 + step / 3.0 * (1.0 + step / 4.0))))
    ratio, own = -stepped.real / np.abs(stepped), -step.real / np.abs(step)
    worse = np.abs(ratio - own) - MAX_STEP_SHARE * np.abs(ratio)
    if not worse.max(initial=-1.0) > 0.0:
        return ()
    i = int(np.argmax(worse))
    size = float(np.abs(step[i]))
    enough = size / h / (72.0 * MAX_STEP_SHARE * max(abs(float(ratio[i])), 1e-4)) ** 0.2
    return (
        f"steps are too long for the vibration at {size / h / (2.0 * np.pi):.3g} Hz: the integration damps it by "
        f"{100.0 * (ratio[i] - own[i]):.2g} %, which the damping lacks; give {enough:.3g} Hz, with gaps between",
    )


def _diagnose(found: Solution, theta: slice, model: StateSpace, rate: float, doubts: tuple[str, ...]) -> Diagnosis:
    """What to think of the result, whose parameters are the unknowns at `theta`."""
    if not found.settled:
        doubts += (
            "the likelihood still rose when the search ended: identify fewer parameters, or give narrower priors",
        )
    return diagnose(
        found.info, readings=model.readings, rate=rate, frequencies=(), parameters=model.parameters,
        theta=found.mean[theta], cov=found.cov[theta, theta], whiteness=found.whiteness, doubts=doubts,
        constancy=found.constancy,
    )  # fmt: skip

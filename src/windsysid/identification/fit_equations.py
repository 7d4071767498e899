"""Fit: one's own equations + a record → estimates with intervals. The front door for every structure that is no
turbine.

The estimate is made in time (`windsysid.identification.estimate.equations_time`) or from spectra
(`windsysid.identification.estimate.spectral.equations_spectra`).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.checks.verdict import FittedParameters, diagnose
from windsysid.errors import ConfigurationError
from windsysid.identification.condition.segments import SegmentReader
from windsysid.identification.estimate.equations_time import EquationsEstimate, fit_by_filter
from windsysid.identification.estimate.spectral.equations_spectra import fit_by_spectra
from windsysid.identification.model.equations_problem import EquationsJob
from windsysid.identification.verdict.grading import grade_coefficients, judged, widen_coefficients
from windsysid.inspection.screening import doubted, noted
from windsysid.kernels.threads import one_thread
from windsysid.loads.statistics import Statistic
from windsysid.mechanics.model import Model
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.identification import Estimate, Identification
from windsysid.results.posterior import SIGMAS
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.parameter import Parameter

if TYPE_CHECKING:
    import sympy as sp

__all__ = ["Fit", "Reading", "fit"]


@dataclass(frozen=True)
class Reading:
    """Residuals of one channel for a user model.

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
        """Text on which its kernel depends."""
        from sympy import srepr

        return str(srepr(self.expression))


@dataclass(frozen=True, repr=False)
class Fit(Identification):
    """An `Identification` of one's own equations; `turbine` is their name.

    Attributes
    ----------
    states
        Names of the n states without the parameters: the model's, its loads', its biases'.
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
    job = EquationsJob(
        model, tuple(parameters), tuple(sensors), mean, cov, dict(values or {}), tuple(loads), channels or {},
        learn_levels,
    )  # fmt: skip
    _check(job, formulation)
    job = job._replace(parameters=tuple(_with_role(model, q) for q in job.parameters))
    spectral = formulation == "spectral"
    segments = SegmentReader(record, job.readings, continuous=not spectral)
    return _describe(job, segments, fit_by_spectra(job, segments) if spectral else fit_by_filter(job, segments))


def _check(job: EquationsJob, formulation: str) -> None:
    """Refuse data from which no formulation, or not this one, can identify."""
    if not job.parameters:
        raise ConfigurationError("parameters: expected at least one to identify, got none")
    if not job.sensors:
        raise ConfigurationError("sensors: expected at least one reading, got none")
    if formulation not in ("joint", "spectral"):
        raise ConfigurationError(f"formulation: expected joint or spectral, got '{formulation}'")
    if formulation == "joint" and job.cov is None:
        raise ConfigurationError("cov: expected the prior covariance of the states, got none: the joint fit needs it")


def _with_role(model: Model, q: Parameter) -> Parameter:
    """A parameter with its kind and part as the model has them, where the caller does not say."""
    if q.kind:
        return q
    kind, part = model.role(q.name)
    return replace(q, kind=kind, part=part)


def _describe(job: EquationsJob, segments: SegmentReader, found: EquationsEstimate) -> Fit:
    """An estimate in physical units, with its diagnosis."""
    n, last, parameters, spectral = len(job.parameters), segments.last, job.parameters, found.whiteness is None
    lost = () if np.isfinite(found.history[0]).all() else (Finding("no_history", "note"),)
    wide = widen_coefficients(found.scores, parameters, found.cov)
    factors = np.array([one.factor for one in wide])
    theta, cov = found.unknowns[:n], found.cov[:n, :n]
    diagnosis = judged(
        diagnose(
            found.whiteness, FittedParameters(parameters, theta, cov), frequencies=(),
            findings=(*doubted(segments.faults), *found.doubts, *found.notes, *noted(segments.faults), *lost),
        ),
        found.scores,
        wide,
    )  # fmt: skip
    spread, grades = factors * np.sqrt(np.diag(cov)), grade_coefficients(diagnosis, parameters, wide)
    units = [last.unit(channel) for channel in job.readings]
    return Fit(
        method=found.method,
        formulation="spectral" if spectral else "fit",
        record=last.name,
        turbine=found.name,
        sensors=job.readings,
        section=(float(segments.first.time[0]), float(last.time[-1])),
        rate=last.rate,
        samples=segments.samples,
        elapsed=found.elapsed,
        estimates=tuple(map(_describe_parameter, parameters, theta, spread, grades)),
        modes=(),
        parameters=parameters,
        time=found.time,
        mean=found.history[0][:, :n],
        std=found.history[1][:, :n],
        cov=cov * np.outer(factors, factors),
        readings=job.readings,
        innovation=found.info.innovation,
        whitened=found.info.whitened,
        log_likelihood=found.log_likelihood,
        statistics=_describe_levels(job, found, units),
        diagnosis=diagnosis,
        states=found.states,
        state_mean=found.info.mean,
        state_std=found.info.std,
    )  # fmt: skip


def _describe_parameter(q: Parameter, theta: float, std: float, grade: str) -> Estimate:
    """A parameter in its own unit."""
    low, value, high = (float(q.physical(theta + k * std)) for k in (-SIGMAS, 0.0, SIGMAS))
    return Estimate(
        name=q.name, unit="", kind="parameter", estimate=value, low=low, high=high,
        std=float(std * (value if q.logarithmic else q.scale)),
        informed_by_data=float(np.clip(1.0 - (std / q.prior[1]) ** 2, 0.0, 1.0)),
        prior=q.centre, reference=None, average_error_percent=None, grade=grade,
    )  # fmt: skip


def _describe_levels(job: EquationsJob, found: EquationsEstimate, units: Sequence[str]) -> tuple[Statistic, ...]:
    """Noise of every sensor and rms of every load, from η and its standard deviations; none where they are as given."""
    levels = [
        Statistic(f"noise_{s.channel}", unit, s.noise, kind="noise") for s, unit in zip(job.sensors, units, strict=True)
    ]
    levels += [
        Statistic(f"rms_{load.states[0]}", "", float(np.sqrt(load.cov[0, 0])), kind="level") for load in found.loads
    ]
    n, learned = len(job.parameters), []
    for one, middle, std in zip(levels, found.unknowns[n:], np.sqrt(np.diag(found.cov))[n:], strict=False):
        value, low, high = (one.given * np.exp(middle + k * std) for k in (0.0, -SIGMAS, SIGMAS))
        learned.append(replace(one, estimate=value, low=low, high=high))
    return tuple(learned)

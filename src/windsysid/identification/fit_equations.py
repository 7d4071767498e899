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
from windsysid.records.coercion import MappingLike, RecordLike, as_pieces
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
    """Measurement equation of one channel of one's own model.

    Attributes
    ----------
    channel
        Name of the record's channel.
    expression
        Measured quantity: an expression in the model's states, inputs, parameters, loads and accelerations.
    noise
        Standard deviation of the white noise of one sample, in the channel's unit.
    bias
        Prior standard deviation of an unknown offset, in the channel's unit; 0: none.
    drift
        Random walk of that offset: its standard deviation after one second, in the channel's unit per √s.

    Examples
    --------
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> ws.models.Reading("acceleration", w - 0.2 * v - k * q, noise=0.05).channel
    'acceleration'
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
    """Result of a fit of one's own equations: an `Identification` whose `turbine` is their name.

    Attributes
    ----------
    states
        Names of the n states in addition to the parameters: the model's, its loads', its biases'.
    state_mean, state_std
        Mean and standard deviation of each state after each sample, at the estimates (T, n).
    """

    states: tuple[str, ...] = field(kw_only=True)
    state_mean: Array = field(kw_only=True)
    state_std: Array = field(kw_only=True)


@one_thread()
def fit(
    model: Model,
    record: "RecordLike | Iterable[Record]",
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
    mapping: "MappingLike | None" = None,
) -> Fit:
    """Identify parameters of one's own equations from `record`.

    Parameters
    ----------
    model : Equations or MechanicalModel
        Equations of motion, with states x (n_x,).
    record : Record, str, Path, pandas.DataFrame or xarray.Dataset, or an iterable of Record
        Has a channel for every sensor, every input of the model, and every measured load. The pieces of a record, in
        order, are kept on disk: the result is the same, with innovations and states of the last samples only where
        there are many.
    parameters : sequence of Parameter
        Parameters to identify, with their priors.
    sensors : sequence of Reading
        One for each channel.
    cov, mean : array_like, optional
        Prior of the model's states at the first sample, (n_x, n_x) and (n_x,), in their units; mean zero by default.
        The spectral formulation needs no `cov`, and searches for the equilibrium from `mean`.
    values : mapping of str to float, optional
        Parameters that are not identified, and constant loads, in the model's units; 0 for a load that does not act.
    loads : sequence of GaussMarkov or LoadBlock, optional
        Models of loads that were not measured. Where the record went through an anti-aliasing low-pass
        (`windsysid.signals.resample`), first-order loads are filtered in the same way.
    channels : mapping of str to str, optional
        Channel of an input or a measured load, where it has another name than in the model.
    learn_levels : bool, default True
        Learn the noise of each sensor and the rms of each load; the given value is then the median of a wide prior (a
        factor of 4.5 at one standard deviation). The shape of a load's spectrum stays as given.
    formulation : {"joint", "spectral"}, default "joint"
        ``"joint"``: Kalman filter of states and parameters. ``"spectral"``: Whittle likelihood, for stationary records
        of small motion: the equations are linearised about the equilibrium. It takes constant inputs only, and pieces
        need not be consecutive (docs/spectral.md).
    mapping : str, Path or Mapping, optional
        Mapping file with the names, units and signs of channels, where `record` is a path (`windsysid.read_record`).

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

    See Also
    --------
    lagrange : Equations from a Lagrangian.
    windsysid.identify : Identification of a turbine.

    Notes
    -----
    Between two samples the filter takes one step of the fourth-order Runge–Kutta method, which damps a motion at ω by
    about (ωh)⁵/144 of the critical: 2e-5 at 20 samples a period, 7e-4 at 10. Inputs run linearly between samples.

    References
    ----------
    Särkkä & Svensson, Bayesian Filtering and Smoothing, 2nd ed., Cambridge 2023, ch. 16.

    Examples
    --------
    >>> import numpy as np
    >>> import sympy as sp
    >>> import windsysid as ws
    >>> q, v, w, k = sp.symbols("q v w k")
    >>> acceleration = w - 0.2 * v - k * q
    >>> spring = ws.models.Equations("spring", (q, v), (), (k,), (w,), (v, acceleration))
    >>> time = 0.05 * np.arange(400)
    >>> swing = np.exp(-0.1 * time) * np.cos(2.0 * time)  # released at q = 1 m with k = 4 N/m
    >>> record = ws.Record(time, swing[:, None], ("position",), ("m",))
    >>> result = ws.models.fit(
    ...     spring, record, parameters=[ws.models.Parameter("k", 3.0, 0.5)], values={"w": 0.0}, cov=np.eye(2),
    ...     sensors=[ws.models.Reading("position", q, noise=0.01)],
    ... )
    >>> print(f"k: {result['k'].estimate:.2f} N/m")
    k: 4.01 N/m
    """
    job = EquationsJob(
        model, tuple(parameters), tuple(sensors), mean, cov, dict(values or {}), tuple(loads), channels or {},
        learn_levels,
    )  # fmt: skip
    _check(job, formulation)
    job = job._replace(parameters=tuple(_with_role(model, q) for q in job.parameters))
    spectral = formulation == "spectral"
    segments = SegmentReader(as_pieces(record, mapping), job.readings, continuous=not spectral)
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

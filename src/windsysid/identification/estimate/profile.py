"""The profile of the posterior of one parameter: how far it may go when all others give way.

    ℓ_p(θ_k) = max over the others of ℓ(θ_k, others),      interval: ℓ_p ≥ max ℓ − 2,

which is ±2σ exactly where the posterior is Gaussian, and is right in any coordinate where it is not. The others are
found anew at each value from where the Gaussian would put them. Between the values, and to the ends of the interval,
the signed root r = sign(θ_k − θ̂_k) √(2 (max ℓ − ℓ_p)), nearly a straight line, is interpolated. Source: Pawitan, In
All Likelihood (Oxford 2001), ch. 3.4.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.identification.condition.operating_state import in_state
from windsysid.identification.condition.readings import usable_sensors
from windsysid.identification.estimate.scoring import FilteredMode, posterior_mode
from windsysid.identification.identify import identify
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.turbine_problem import TurbineProblem, pose
from windsysid.mechanics.sensors import Sensor
from windsysid.output.answers import Answer
from windsysid.output.progress import Progress, unheard
from windsysid.output.table import Table
from windsysid.records.coercion import MappingLike, RecordLike, as_record
from windsysid.results.identification import Identification
from windsysid.results.posterior import SIGMAS
from windsysid.turbine.coercion import TurbineLike, as_turbine
from windsysid.units import engineering

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Profile", "interpolate_on", "profile_likelihood"]


PROFILE_SIGMAS = (1.0, 2.0, 3.0)
"""Setting: where the posterior is profiled on either side, in standard deviations of the Gaussian."""

MAX_PROFILE_SIGMAS = 12.0
"""Setting: standard deviations up to which the profile goes on where the interval has not ended before."""


@dataclass(frozen=True, eq=False)
class Profile(Answer):
    """Result of `windsysid.profile_likelihood`: profile of the posterior over one parameter.

    Attributes
    ----------
    name, unit
        Of the parameter.
    values
        Values of the parameter (P,), in `unit`, rising.
    log_posterior
        Log posterior, maximised over the other parameters, minus its maximum (P,).
    estimate
        The mode, in `unit`.
    low, high
        Where the log posterior has dropped by 2, in `unit`; 0 or infinite where it does not.
    gaussian
        The ±2σ interval, in `unit`, for comparison; `identify` may widen it for other explanations.
    """

    name: str
    unit: str
    values: Array
    log_posterior: Array
    estimate: float
    low: float
    high: float
    gaussian: tuple[float, float]

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each place where the parameter was held: ``value`` in `unit`, and ``log_posterior``."""
        import pandas as pd

        return pd.DataFrame({"value": self.values, "log_posterior": self.log_posterior})

    def __repr__(self) -> str:
        return f"<Profile: {str(self).splitlines()[0]}>"

    def contents(self) -> list[Table | str]:
        """One line."""
        ends = (self.low, self.high, *self.gaussian)
        estimate, low, high, least, most, unit = engineering(self.unit, self.estimate, *ends)
        return [
            f"{self.name}: {estimate} {unit}, 95 % interval {low} … {high} {unit} (profile),"
            f" {least} … {most} {unit} (Gaussian, ±2σ)"
        ]


def profile_likelihood(
    record: RecordLike,
    turbine: TurbineLike,
    name: str,
    *,
    sensors: Sequence[Sensor] | None = None,
    section: tuple[float, float] | None = None,
    prior: Prior | None = None,
    parameters: Sequence[str] | None = None,
    mapping: "MappingLike | None" = None,
    progress: Progress = unheard,
) -> Profile:
    """Profile the posterior of one parameter of `turbine`, given `record`, in the joint formulation.

    For each value of the parameter the posterior is maximised over all others, so that the interval needs no Gaussian
    approximation.

    Parameters
    ----------
    record, turbine, sensors, section, prior, parameters, mapping
        As in `windsysid.identify`.
    name : str
        Name of the parameter.
    progress : callable, optional
        Called with the present step and the share that is done, 0 to 1, or None if that is unknown.

    Returns
    -------
    Profile
        The log posterior over values of the parameter (P,), with the parameter's unit.

    Raises
    ------
    ConfigurationError
        If `name` is not one of the identified parameters.
    RecordError, WindsysidError
        As raised by `windsysid.identify`.

    References
    ----------
    Pawitan, In All Likelihood, Oxford 2001, ch. 3.4.

    Examples
    --------
    >>> import windsysid as ws
    >>> record = ws.simulate("tower", duration=60.0, rate=5.0, seed=1)
    >>> profile = ws.profile_likelihood(record, "tower", "k_side_side", parameters=["k_side_side"])
    >>> print(f"{profile.low / 1e6:.3f} … {profile.high / 1e6:.3f} MN/m")
    1.722 … 1.820 MN/m
    """
    record, turbine = as_record(record, mapping), as_turbine(turbine)
    progress("identifying", None)
    found = identify(
        record, turbine, sensors=sensors, formulation="joint", section=section, prior=prior, parameters=parameters
    )
    names = [q.name for q in found.parameters]
    if name not in names:
        raise ConfigurationError(f"profile of '{name}': expected one of the identified parameters {', '.join(names)}")
    part = (record.section(*section) if section else record).on_uniform_grid()
    turbine, _ = in_state(turbine, part, "auto")
    problem = pose(part, turbine, usable_sensors(part, turbine, sensors), prior or Prior(), parameters)
    return _profile(problem, names.index(name), found, progress)


def _profile(problem: TurbineProblem, k: int, found: Identification, progress: Progress) -> Profile:
    prior_cov = problem.prior[1]
    known, q = problem.unknowns.only("parameters", "statistics"), problem.parameters[k]
    theta = known.of("parameters")
    start = known.vector(parameters=[p.coordinate(found[p.name].estimate) for p in problem.parameters])
    start_cov = prior_cov.copy()
    start_cov[theta, theta] = found.cov
    mode = posterior_mode(
        problem.build, problem.inputs, problem.readings, prior=problem.prior, start=(start, start_cov)
    )
    centre, sigma = mode.mean[k], math.sqrt(mode.cov[k, k])
    drops = _drops(problem, k, mode, progress)
    shifts = np.array(sorted(drops))
    depth = np.array([drops[shift] for shift in shifts])
    shifts, depth = shifts + 0.0, depth - depth.min()  # should a held fit have found a higher place than the mode
    root = np.sign(shifts) * np.sqrt(2.0 * depth)
    low, high = (
        float(interpolate_on(root, shifts, np.array([r]))[0]) if abs(root[end]) >= SIGMAS else r * math.inf
        for r, end in ((-SIGMAS, 0), (SIGMAS, -1))
    )
    places = (0.0, low, high, -SIGMAS, SIGMAS)
    estimate, low, high, least, most = (float(q.physical(centre + shift * sigma)) for shift in places)
    values = q.physical(centre + shifts * sigma)
    return Profile(q.name, found[q.name].unit, values, -depth, estimate, low, high, (least, most))


def _drops(problem: TurbineProblem, k: int, mode: FilteredMode, progress: Progress) -> dict[float, float]:
    """Drop of the log posterior, by the distance of unknown k from the mode in its standard deviations."""
    height = _log_posterior(mode.mean, mode.log_likelihood, *problem.prior)
    drops = {0.0: 0.0}
    for side in (-1.0, 1.0):
        steps = list(PROFILE_SIGMAS)
        while steps:
            at = side * steps.pop(0)
            progress(f"{problem.parameters[k].name} held {at:+g} σ from its estimate", None)
            drops[at] = height - _held(problem, k, mode.mean[k] + at * math.sqrt(mode.cov[k, k]), mode)
            if not steps and drops[at] < 0.5 * SIGMAS**2 and abs(at) < MAX_PROFILE_SIGMAS:
                steps = [2.0 * abs(at)]
    return drops


def _held(problem: TurbineProblem, k: int, value: float, mode: FilteredMode) -> float:
    """The greatest log posterior with unknown k held at `value`."""
    prior_mean, prior_cov = problem.prior
    others = np.arange(len(prior_mean)) != k
    slope = mode.cov[others, k] / mode.cov[k, k]
    free = posterior_mode(
        lambda values: problem.build(np.insert(values, k, value)), problem.inputs, problem.readings,
        prior=(prior_mean[others], prior_cov[np.ix_(others, others)]),
        start=(
            mode.mean[others] + slope * (value - mode.mean[k]),
            mode.cov[np.ix_(others, others)] - np.outer(slope, mode.cov[k, others]),
        ),
    )  # fmt: skip
    return _log_posterior(np.insert(free.mean, k, value), free.log_likelihood, prior_mean, prior_cov)


def _log_posterior(unknowns: Array, log_likelihood: float, prior_mean: Array, prior_cov: Array) -> float:
    off = unknowns - prior_mean
    return log_likelihood - 0.5 * float(off @ np.linalg.solve(prior_cov, off))


def interpolate_on(x: Array, y: Array, at: Array) -> Array:
    """A monotone curve through points of rising x, at other places."""
    from scipy.interpolate import PchipInterpolator

    rising = np.maximum.accumulate(x) + 1e-12 * np.arange(len(x))
    return np.asarray(PchipInterpolator(rising, y)(at), dtype=np.float64)

"""Shared parts of the two formulations: priors, measured loads, and the result."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.conditioning import hold
from windsysid.checks.dispersion import PartScores
from windsysid.checks.whiteness import Whiteness
from windsysid.errors import WindsysidError
from windsysid.filters import Info
from windsysid.identification.model.drift import Drift
from windsysid.loads.statistics import Statistic
from windsysid.mechanics.sensors import Sensor
from windsysid.records.kept import kept_with_record
from windsysid.records.record import LOW_PASS, Record
from windsysid.results.estimate import FittedSpectrum, Loads
from windsysid.results.finding import Finding
from windsysid.results.smoothed_loads import SmoothedLoads
from windsysid.results.tolerance import Group, Tolerance, unknowns_of
from windsysid.signals import resample
from windsysid.signals.inputs import TURNING, read_inputs
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.unknowns import Unknowns
from windsysid.turbine.turbine import Turbine

__all__ = ["PART_OF", "Outcome", "check_finite", "diverged", "known_inputs", "known_loads", "no_innovations"]


PART_OF = "part_of_"
"""Prefix of a channel with the known part of a load."""


class Outcome(NamedTuple):
    """Result of a formulation, in filter coordinates.

    Attributes
    ----------
    turbine, model
        The turbine with the degrees of freedom that were really used, and the state-space model that was filtered.
    history_mean, history_std
        What was known of θ on line, after each sample (T, n_θ).
    final, elapsed
        The last pass over the record, whose innovations judge the result, and seconds in the filter.
    theta, cov
        The identified parameters (n_θ,) and their covariance (n_θ, n_θ).
    rotor
        The known inputs, ψ, Ω and more (T, n_u), or their mean over the record (1, n_u).
    channels, sensors
        Channels of the record that were used as measurements, and their sensors.
    notes, doubts
        What was done to the record and the model, and why the formulation itself would not trust its result.
    statistics, tolerances
        Statistics of loads and noise that were learned with the parameters, and what is known of instruments and masses
        within tolerances only; none where they were taken as exact.
    loads
        The loads that were states, as the filter knew them at the result; None where none were.
    joint_cov
        Covariance of θ, of the coordinates η of `statistics` and of `tolerances` together (n_θ + n_η + n_τ), the last
        in standard deviations of their priors; None where no statistics were learned.
    whiteness, smoothed_loads
        The test of the innovations against white noise, and those of smoothed loads; None if they were not made.
    scores
        Of parts of the record, to θ and all else that was estimated, in time and over frequencies; none where they were
        not computed.
    log_likelihood
        Of all readings, where `final` does not hold them all.
    hypothesis
        Name of what the loads were taken for; empty where nothing was supposed.
    turns, in_bands
        Whether the rotor's turns couple what moves, as far as the formulation has asked, and whether spectra were read
        in bands around the modes, which supposes wind on a turning rotor.
    held, given_priors
        Damping coefficients whose priors conflict with the readings, and the identified parameters with their priors as
        they were given, where some were made wider; else none.
    drifts
        How clocks drift by what the halves of the record say, much or little.
    spectra
        Spectra of the channels under the fit, where they are known.
    """

    turbine: Turbine
    model: StateSpace
    history_mean: Array
    history_std: Array
    final: Info
    theta: Array
    cov: Array
    rotor: Array
    channels: tuple[str, ...]
    elapsed: float
    notes: tuple[Finding, ...]
    statistics: tuple[Statistic, ...] = ()
    doubts: tuple[Finding, ...] = ()
    loads: Loads | None = None
    joint_cov: Array | None = None
    whiteness: Whiteness | None = None
    scores: tuple[PartScores, ...] = ()
    log_likelihood: float | None = None
    hypothesis: str = ""
    tolerances: tuple[Tolerance, ...] = ()
    smoothed_loads: SmoothedLoads | None = None
    turns: bool = True
    in_bands: bool = False
    held: tuple[str, ...] = ()
    given_priors: tuple[Parameter, ...] = ()
    drifts: tuple[Drift, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    spectra: tuple[FittedSpectrum, ...] = ()

    @property
    def priors(self) -> tuple[Parameter, ...]:
        """The identified parameters (n_θ,) with their priors as they were given."""
        known = {q.name: q for q in self.given_priors}
        return tuple(known.get(q.name, q) for q in self.model.parameters)

    @property
    def unknowns(self) -> Unknowns:
        """Names of the unknowns of `joint_cov`, or of `cov` where it is None."""
        known = unknowns_of(self.model.parameters, self.statistics, self.tolerances)
        return known if self.joint_cov is not None else known.only("parameters")

    def given(self, *groups: Group, as_in: "Outcome | None" = None) -> tuple[Array, Array]:
        """θ (n_θ,), and the covariance of all unknowns, given that these groups of tolerances are as in the file, or as
        in another result."""
        cov, at = self.cov if self.joint_cov is None else self.joint_cov, self.unknowns
        known = {one.name: one.estimate for one in as_in.tolerances} if as_in is not None else {}
        mean = at.vector(parameters=self.theta)
        mean[at.of("tolerances", "clocks")] = [
            (one.estimate - known.get(one.name, 0.0)) / one.spread for one in self.tolerances
        ]
        places = at.places("tolerances", "clocks")
        found, left = hold(mean, cov, places[[one.group in groups for one in self.tolerances]].tolist())
        return found[at.of("parameters")], left


def known_inputs(record: Record, turbine: Turbine, sensors: Sequence[Sensor]) -> Array:
    """Inputs of the turbine's model (T, n_u), which must not be changed; between samples of a uniform grid where times
    are unequal."""
    required = frozenset((*turbine.model.required_inputs, *(name for one in sensors for name in one.needed_inputs)))
    return _inputs(record, tuple(turbine.model.inputs), turbine.rotor_speed, required)


@kept_with_record
def _inputs(record: Record, names: tuple[str, ...], rotor_speed: float, required: frozenset[str]) -> Array:
    if record.is_uniform:
        return read_inputs(record, names, rotor_speed, required=required)
    even = resample(record.select([c for c in record.channels if c in (*TURNING, *names)]), record.rate)
    inputs = read_inputs(even, names, rotor_speed, required=required)
    return np.column_stack([np.interp(record.time, even.time, column) for column in inputs.T])


def known_loads(record: Record, turbine: Turbine) -> tuple[Array, list[GaussMarkov]]:
    """Measured loads and parts of loads (T, n), zero where there is no channel, and the loads that are states, as far
    as the record's low-pass lets them through: those that are not measured altogether."""
    known = np.zeros((record.samples, len(turbine.model.loads)))
    for column, name in enumerate(turbine.model.loads):
        for channel in (name, PART_OF + name):
            if channel in record:
                known[:, column] += np.nan_to_num(record[channel])
    low_pass = float(record.attributes.get(LOW_PASS, math.inf))
    return known, [replace(load, low_pass=low_pass) for load in turbine.loads if load.load not in record]


def check_finite(mean: Array, cov: Array) -> None:
    """Raise where a filter has diverged."""
    if not (np.isfinite(mean).all() and np.isfinite(cov).all()):
        raise diverged()


def diverged() -> WindsysidError:
    """Error message for a filter that diverged."""
    return WindsysidError(
        "the filter diverged: expected loads, noise and priors of the size of the record's; "
        "check units and the turbine file, or change the priors"
    )


def no_innovations(readings: int, log_likelihood: float) -> Info:
    """One sample of nothing: spectra have no innovations."""
    nothing = np.full((1, readings), np.nan)
    return Info(
        mean=np.empty((1, 0)), std=np.empty((1, 0)), innovation=nothing, innovation_std=nothing, whitened=nothing,
        whitening_std=nothing, log_likelihood=np.array([log_likelihood]), gated=np.zeros((1, readings), dtype=np.bool_),
    )  # fmt: skip

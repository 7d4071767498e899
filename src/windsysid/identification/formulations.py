"""Formulations of a job: filters, spectra, or the force balance of one instant.

Each conditions the record, builds the problem and estimates, in a straight line; what a record holds in addition to the
structure is found and included by `windsysid.identification.pipeline`.
"""

from collections.abc import Callable
from dataclasses import replace

from windsysid.errors import ConfigurationError, WindsysidError
from windsysid.identification.condition.readings import check_length, thin_to_readings
from windsysid.identification.effects.clock_drift import drifts_in
from windsysid.identification.effects.narrow_band_load import NarrowBandIncluded
from windsysid.identification.effects.sinusoidal_force import Sinusoids
from windsysid.identification.estimate.fitted.linearisation import linearise
from windsysid.identification.estimate.fitted.whitened_spectrum import scores_over_frequency
from windsysid.identification.estimate.force_balance import identify_by_force_balance, measured_channels
from windsysid.identification.estimate.prior_conflict import with_wide_priors
from windsysid.identification.estimate.spectral.frequency_domain import identify_by_spectrum
from windsysid.identification.estimate.spectral.narrow_band_alternative import heard_on_time, told_before
from windsysid.identification.estimate.time_domain import identify_jointly, identify_jointly_from
from windsysid.identification.job import Conditioned, FittedJob, Formulation, Job
from windsysid.identification.limits import MAX_RADIANS_PER_SPECTRAL_READING
from windsysid.identification.model.fit import Outcome
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.regressor import widening_of
from windsysid.inspection.screening import screen
from windsysid.loads.narrow_band import NarrowBand
from windsysid.results.finding import Finding
from windsysid.signals.inputs import TURNING

__all__ = ["estimate"]


def estimate(job: Job, start: FittedJob | None = None) -> FittedJob:
    """Answer a job by its formulation, from where another fit has ended if that is given."""
    return _FORMULATIONS[job.formulation](job, start)


def _by_filters(job: Job, start: FittedJob | None) -> FittedJob:
    at = job.resampled()
    part, turbine, steps = at.record, job.turbine, at.steps
    check_length(part.name, part.duration, part.rate, turbine)
    outcome = thin_to_readings(_search(job, at, start), steps)
    outcome = outcome._replace(notes=(*job.notes(outcome), *at.notes, *outcome.notes))
    waves = job.inclusion(Sinusoids)
    left = part if waves is None or not waves.forces else waves.left(part, turbine, at.sensors)
    read = replace(left, time=left.time[::steps], values=left.values[::steps])
    fit = FittedJob("joint", _widened(job, outcome), read, at.sensors, at.faults, job.prior or Prior())
    fit = fit._replace(outcome=_scored(job, fit))
    return fit.doubted(Finding("drift_moved_readings", "reason")) if drifts_in(job) else fit


def _scored(job: Job, fit: FittedJob) -> Outcome:
    """A fit with scores over time, and with those over frequencies and spectra where they can be computed."""
    (time,) = fit.outcome.scores
    try:
        at = linearise(job, fit)
        over = scores_over_frequency(at, time.precision) if at is not None else None
    except (WindsysidError, ValueError):  # of which LinAlgError is one
        over = None
    if over is None:
        return fit.outcome
    scores, spectra = over
    return fit.outcome._replace(scores=(time, scores._replace(given=time.given)), spectra=spectra)


def _search(job: Job, at: Conditioned, start: FittedJob | None) -> Outcome:
    """From where another fit has ended, or from the prior where that does not apply."""
    of, outcome = (at.record, job.turbine, at.sensors, job.prior or Prior(), job.parameters), None
    if start is not None and at.record.is_uniform:
        outcome = identify_jointly_from(start.outcome, *of, explained=start.formulation == "spectral")
    return outcome or identify_jointly(*of, loads=job.loads)


def _widened(job: Job, outcome: Outcome) -> Outcome:
    """Fit with the uncertainty from the sizes of included regressors."""
    if outcome.joint_cov is None:
        return outcome
    cov, n = outcome.joint_cov.copy(), len(outcome.joint_cov) - sum(one.group == "clock" for one in outcome.tolerances)
    cov[:n, :n] += widening_of(job.effects, n)
    return outcome._replace(joint_cov=cov, cov=cov[: len(outcome.theta), : len(outcome.theta)])


def _by_spectra(job: Job, start: FittedJob | None) -> FittedJob:
    uniform, turbine = job.part.on_uniform_grid(), job.turbine
    check_length(uniform.name, uniform.duration, uniform.rate, turbine, MAX_RADIANS_PER_SPECTRAL_READING)
    if job.rate is not None:
        raise ConfigurationError("the spectral formulation chooses its frequency ranges itself: leave the rate out")
    at = job.condition()
    part, loads, narrow = at.record, job.loads, job.inclusion(NarrowBandIncluded) is not None and start is not None
    if start is not None and narrow:
        part, loads = heard_on_time(part, start.outcome, turbine, at.sensors), NarrowBand.name
    outcome, prior = with_wide_priors(
        lambda prior: identify_by_spectrum(part, turbine, at.sensors, prior, job.parameters, loads=loads),
        job.prior or Prior(),
    )
    if start is not None and narrow:
        outcome = told_before(outcome, start.outcome)
    outcome = outcome._replace(notes=(*job.notes(outcome), *outcome.notes))
    return FittedJob("spectral", outcome, at.record, at.sensors, at.faults, prior)


def _by_force_balance(job: Job, start: FittedJob | None) -> FittedJob:
    part, turbine = job.part.on_uniform_grid(), job.turbine
    check_length(part.name, part.duration, part.rate, turbine)
    if job.sensors is not None:
        raise ConfigurationError(
            "the force balance takes no sensor list: it reads tower_x_acceleration, blade_1_lag_displacement … by name"
        )
    if job.parameters is not None:
        raise ConfigurationError("the force balance identifies all coefficients at once: leave `parameters` out")
    if job.rate is not None:
        raise ConfigurationError("the force balance filters the record as it is: leave the rate out")
    if job.loads != "auto":
        raise ConfigurationError("the force balance has no model of the loads: leave `loads` out")
    whole = job.record.on_uniform_grid()
    faults = screen(job.part, turbine, measured_channels(part, turbine), others=(*TURNING, *turbine.model.loads))
    outcome = identify_by_force_balance(whole, part, turbine, job.prior or Prior(spread=1.0))
    return FittedJob("force-balance", outcome, part, (), faults)


_FORMULATIONS: dict[Formulation, Callable[[Job, FittedJob | None], FittedJob]] = {
    "joint": _by_filters,
    "spectral": _by_spectra,
    "force-balance": _by_force_balance,
}

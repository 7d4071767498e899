"""Choose between the joint and the spectral formulation, and cross-check them."""

import math
from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np

from windsysid.checks.limits import MAX_DISAGREEMENT_SIGMAS
from windsysid.identification.condition.readings import choose_rate, steps_per_reading, usable_sensors
from windsysid.identification.effects import EFFECTS
from windsysid.identification.effects.clock_drift import drifts_in
from windsysid.identification.effects.lines import Sinusoid, harmonics_of_spectra
from windsysid.identification.effects.narrow_band_load import NarrowBandLoad
from windsysid.identification.effects.random_walk_bias import RandomWalkBias
from windsysid.identification.effects.sinusoidal_force import Sinusoids
from windsysid.identification.formulations import estimate
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.model.agreement import compare, disagreement
from windsysid.identification.model.fit import Outcome, known_loads
from windsysid.identification.model.regressor import Regressors
from windsysid.identification.model.turbine_problem import seen_by
from windsysid.identification.pipeline import FAILURES, run
from windsysid.identification.verdict.conclude import doubts_of_innovations
from windsysid.identification.verdict.grading import is_contradictory, widen_coefficients
from windsysid.loads.family import Broadband
from windsysid.loads.hypothesis import HYPOTHESES
from windsysid.loads.narrow_band import NarrowBand
from windsysid.loads.rotor_wind import RotorWind
from windsysid.results.finding import Finding
from windsysid.spectral.rotor_bands.build import is_lightly_damped

__all__ = ["choose", "spectral_alone"]

SCREENED_PERIODS = 60.0
"""Setting: periods of the slowest mode at a record's beginning in which filters look for loads that they cannot
explain: where there are, a search of all of it takes minutes."""

TRANSIENT_CODES = frozenset({
    "burst", "nonstationary", "stationarity_untestable", "too_short_for_stationarity", "varying_rotor_speed",
})  # fmt: skip
"""Setting: findings of spectra that a record is a transient, or too short to tell: a rotor in wind goes to filters."""

NONLINEARITY_CODES = frozenset({"amplitude_dependence", "nonlinear_force"})
"""Setting: findings of filters that speak against spectra, too, where the two disagree: no interval covers both."""

MAX_WIND_ELEMENTS = 3.6e6
"""Setting: elements of covariances that a filter with the wind's load states may update over a rotor's record. The 40
filters of an evaluation of their likelihood take 1.2 s then (processor time, 2026), and a search has a dozen."""


def choose(job: Job) -> FittedJob:
    """Choose spectra under wind and where nothing turns, filters otherwise, and cross-check them, but under wind.

    Springs that harden, friction, play and loads of another kind show in innovations; in the size of a spectrum they
    hardly do. Under wind filters have 50 load states: they answer transients only, and any other finding is a reason
    against the spectral result.
    """
    try:
        spectral_job, spectral = run(job.by("spectral"))
    except FAILURES as error:
        joint = run(_affordable(job.by("joint")))[1]
        return joint.noting(_note("joint_as_spectra_do_not_apply", error=str(error)))
    spectral = spectral.doubted(*_undamped(spectral.outcome))
    rivals = _rivals_in(spectral)
    doubts = [one for one in spectral.outcome.doubts if one not in rivals]
    joint_job = job.by("joint").with_effects_of(spectral_job, "clock_drift", Sinusoid.code)
    if _is_left_to_spectra(job, spectral):
        broad = _by_broad_loads(joint_job) if spectral.outcome.in_bands else None
        if broad is not None:
            return broad.noting(_note("joint_as_loads_are_broad"))
        return spectral.noting(_note("spectral_under_wind"))
    if not doubts and drifts_in(spectral_job):
        return spectral.noting(_note("spectral_as_clock_drifts"))
    joint_job = _prepared(replace(joint_job, prior=spectral.prior), spectral)
    try:
        if doubts:
            return _filters_instead(joint_job, spectral, doubts[0])
        job, joint = _fitted_beside(joint_job, spectral)
    except FAILURES as error:
        return spectral.doubted(Finding("spectral_as_filters_fail", "reason", {"error": str(error)}))
    return _cross_checked(job, _with_priors_of(spectral, joint), spectral_job, spectral)


def _is_left_to_spectra(job: Job, spectral: FittedJob) -> bool:
    """Test whether a rotor is in wind, and its record stationary or too long for filters with the load states of wind.
    Bands suppose wind and also show a free decay, which filters explain without these states."""
    transient = TRANSIENT_CODES.intersection(one.code for one in spectral.outcome.doubts)
    alone = _is_dear(job) and not spectral.outcome.in_bands
    return spectral.outcome.hypothesis == RotorWind.name and (alone or not transient)


def spectral_alone(job: Job) -> FittedJob:
    """By spectra; a rotor that is read in bands, which suppose wind, is held against filters that do without."""
    _, fit = run(job.by("spectral"))
    if fit.outcome.doubts or not fit.outcome.in_bands or _by_broad_loads(job.by("joint")) is None:
        return fit
    return fit.doubted(Finding("bands_suppose_wind", "reason"))


def _prepared(job: Job, spectral: FittedJob) -> Job:
    """The job for filters, with what spectra show of the rotor's harmonics, and broad loads where a clock drifts:
    others would explain what filters sense of that."""
    try:
        harmonics = harmonics_of_spectra(job, spectral)
    except FAILURES:
        harmonics = None
    job = _affordable(job if harmonics is None else job.including(harmonics))
    return replace(job, loads=Broadband.name) if drifts_in(job) and job.loads == "auto" else job


def _affordable(job: Job) -> Job:
    """The job with broad loads where filters with the wind's load states are too expensive."""
    return replace(job, loads=Broadband.name) if job.loads == "auto" and _is_dear(job) else job


def _is_dear(job: Job) -> bool:
    """Test whether wind's load states are too many for the steps of the equations that filters take over a record."""
    turbine = seen_by(job.turbine, usable_sensors(job.part, job.turbine, job.sensors), [])
    loads, wind = known_loads(job.part, turbine)[1], HYPOTHESES[RotorWind.name]
    if not loads or not wind.applies_to(turbine):
        return False
    states = 2 * len(turbine.model.coordinates) + sum(len(one.states) for one in wind.suppose(turbine, loads).given())
    rate = choose_rate(job.part.rate, job.part.duration, turbine, job.rate) or job.part.rate
    return job.part.duration * rate * steps_per_reading(turbine, rate) * states**2 > MAX_WIND_ELEMENTS


def _filters_instead(job: Job, spectral: FittedJob, doubt: Finding) -> FittedJob:
    """By filters where something speaks against spectra."""
    joint = _with_priors_of(spectral, run(job)[1])
    explained = joint.outcome.hypothesis == NarrowBand.name
    if not explained and compare(joint.outcome, spectral.outcome)[1] < MAX_DISAGREEMENT_SIGMAS:
        joint = _with_farther_rivals(joint, spectral)  # filters have ended where spectra did
    return joint.noting(_note("joint_as_spectra_are_doubtful", because=doubt))


def _rivals_in(fit: FittedJob) -> list[Finding]:
    """Findings of a fit on a narrow-band load."""
    return [one for one in fit.outcome.doubts if one.code.startswith(NarrowBandLoad.code)]


def _with_farther_rivals(joint: FittedJob, spectral: FittedJob) -> FittedJob:
    """The fit by filters with those rivals, its own or of spectra, that are expected to shift estimates more."""
    ours, theirs = _rivals_in(joint), _rivals_in(spectral)
    shifts = [sum(one.data.get("sigmas", math.inf) * one.data["chance"] for one in some) for some in (ours, theirs)]
    if shifts[0] >= shifts[1]:
        return joint
    others = [one for one in joint.outcome.doubts if one not in ours]
    return joint._replace(outcome=joint.outcome._replace(doubts=(*others, *theirs)))


def _cross_checked(job: Job, joint: FittedJob, spectral_job: Job, spectral: FittedJob) -> FittedJob:
    """Filters for a structure with rotating parts, spectra for others, each checked by the other."""
    waves = tuple(one.code for one in job.effects if isinstance(one, Regressors))
    found_more = bool(waves) or job.inclusion(Sinusoids) != spectral_job.inclusion(Sinusoids)
    if found_more and not spectral.outcome.turns:  # spectra lack what filters found
        try:
            _, spectral = run(spectral_job.with_effects_of(job, "clock_drift", Sinusoid.code, *waves))
        except FAILURES as error:
            return joint.noting(_note("joint_as_spectra_do_not_apply", error=str(error)))
    spectral = _with_scores_of(joint, spectral)
    fit, both = joint.outcome, (joint.outcome, spectral.outcome)
    wider = dict(map(attrgetter("name", "factor"), widen_coefficients(fit.scores, fit.model.parameters, fit.cov)))
    answer, other = both if spectral.outcome.turns else both[::-1]
    off, against = compare(answer, other, wider)[1], disagreement(answer, other, job.turbine, wider)
    if not spectral.outcome.turns:
        return _checked_by_filters(spectral, joint, off, against)
    if off > MAX_DISAGREEMENT_SIGMAS:
        return joint.noting(_note("joint_with_spectra"), *against)
    return _with_farther_rivals(joint, spectral).noting(_note("joint_agrees", sigmas=off))


def _with_scores_of(joint: FittedJob, spectral: FittedJob) -> FittedJob:
    """Spectra with the scores of filters over time, and over the frequencies that spectra use. What the filters' loads
    do not explain at other frequencies does not concern spectra."""
    used = np.concatenate([one.frequency for one in spectral.outcome.spectra] or [np.array([0.0, math.inf])])
    low, high, scores = used.min(), used.max(), joint.outcome.scores
    scores = tuple(one.between(low, high) if one.over == "frequency" else one for one in scores)
    return spectral._replace(outcome=spectral.outcome._replace(scores=scores))


def _checked_by_filters(spectral: FittedJob, joint: FittedJob, off: float, against: Sequence[Finding]) -> FittedJob:
    """Spectra with what the innovations of filters say; of filters that disagree, what concerns springs and dampers."""
    innovations = doubts_of_innovations(joint.outcome, joint.read.rate)
    if off > MAX_DISAGREEMENT_SIGMAS:
        nonlinear = (one for one in innovations if one.code in NONLINEARITY_CODES)
        return spectral.noting(_note("spectral_with_filters"), *against, *nonlinear)
    return spectral.noting(_note("spectral_agrees", sigmas=off), *innovations)


def _with_priors_of(spectral: FittedJob, joint: FittedJob) -> FittedJob:
    return joint._replace(outcome=joint.outcome._replace(given_priors=spectral.outcome.given_priors))


def _fitted_beside(job: Job, spectral: FittedJob) -> tuple[Job, FittedJob]:
    """By filters from where spectra ended. Where that differs, and a drift of sensors that are sensitive to gravity is
    there and explains it, with that drift."""
    near = spectral if job.inclusion(Sinusoids) is None else None  # filters have not looked there yet
    answered, joint = run(job, spectral if near is not None else None, effects=(EFFECTS,))
    if compare(joint.outcome, spectral.outcome)[1] <= MAX_DISAGREEMENT_SIGMAS:
        return answered, joint
    wander = RandomWalkBias().find(job, leaning=True)
    if wander is None or not wander.drifts:
        return answered, joint
    leaning = job.including(wander)
    drifting = estimate(leaning, spectral)
    agrees = compare(drifting.outcome, spectral.outcome)[1] <= MAX_DISAGREEMENT_SIGMAS
    return (leaning, drifting) if agrees and not _is_doubtful(drifting) else (answered, joint)


def _by_broad_loads(job: Job) -> FittedJob | None:
    """By filters under broad loads, where these explain the record of a rotor whose modes are well damped, which bands
    take for one in wind; None where they do not, or other loads are requested. A real machine's modes are lightly
    damped, and it has more than its model: it stays with bands."""
    if job.loads not in ("auto", Broadband.name) or is_lightly_damped(job.turbine):
        return None
    part, joint, begun = job.part, None, float(job.part.time[0])
    beginning = begun + SCREENED_PERIODS * 2.0 * math.pi / job.turbine.slowest_frequency
    for end in sorted({min(beginning, float(part.time[-1])), float(part.time[-1])}):
        try:
            _, joint = run(replace(job, part=part.section(begun, end), loads=Broadband.name), effects=())
        except FAILURES:
            return None
        if joint.outcome.doubts or _is_doubtful(joint):
            return None
    return joint


def _is_doubtful(joint: FittedJob) -> bool:
    """Test whether innovations, or segments of the record that contradict each other, speak against a fit."""
    return bool(doubts_of_innovations(joint.outcome, joint.read.rate)) or is_contradictory(joint.outcome)


def _note(code: str, **data: Any) -> Finding:
    return Finding(code, "note", data)


def _undamped(found: Outcome) -> list[Finding]:
    """Damping coefficients that are not positive: a spectrum gives their size only, and a search may find the image."""
    at = [(q, float(q.physical(theta))) for q, theta in zip(found.model.parameters, found.theta, strict=True)]
    dampers = [(q, c) for q, c in at if q.kind == "damping" and q.part in found.turbine.model.coordinates]
    return [Finding("coefficient_not_positive", "reason", {"value": c}, (q.name,)) for q, c in dampers if c <= 0.0]

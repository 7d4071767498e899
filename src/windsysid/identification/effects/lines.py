"""Sinusoids in a fit: lines of the readings near a mode, frequencies on which a coefficient depends, and rotor
harmonics in the innovations."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from windsysid.checks.limits import HARMONIC_HALF_WIDTH_BINS, LINE_SEARCH_FACTOR
from windsysid.checks.lines import Line, may_be_no_line
from windsysid.checks.verdict import found_line
from windsysid.filters import EKF
from windsysid.identification.effects.regression import MAX_REVISIONS
from windsysid.identification.effects.sinusoid import Sine, find_sine, find_turning, one_turn, turned, ways_of
from windsysid.identification.effects.sinusoidal_force import SineForce, Sinusoids, find_forces, step_of
from windsysid.identification.estimate.fitted.influence import doubt_line, doubt_sine, doubt_standing_out
from windsysid.identification.estimate.fitted.linearisation import linearise
from windsysid.identification.estimate.fitted.modal_residuals import line_of, no_narrower
from windsysid.identification.estimate.fitted.modes import modes_of
from windsysid.identification.estimate.time_domain import where_it_ended
from windsysid.identification.job import FittedJob, Job
from windsysid.identification.limits import SINUSOID_DIGITS
from windsysid.identification.model.effect import Detection, Effect
from windsysid.identification.model.prior import Prior
from windsysid.identification.model.prior_odds import odds_of
from windsysid.identification.model.turbine_problem import pose
from windsysid.loads.family import Broadband
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.spectral.transforms.harmonics import find_lines
from windsysid.turbine.turbine import Turbine

__all__ = ["RotorHarmonic", "Sinusoid", "harmonics_of_spectra"]


class Sinusoid(Effect):
    """Machines and waves: a line of the readings that is steady by Thomson's F."""

    code = "sinusoid"

    def detect(self, job: Job, fit: FittedJob) -> Detection:
        """Test the line that stands out near a mode, and the one that a coefficient depends on; then turn waves in
        the readings of a rotor into forces."""
        known = job.inclusion(Sinusoids)
        seen = _Lines.of(job, fit)
        judged = seen.judged(job, fit, known)
        part = job.part.on_own_times()
        if not part.is_uniform:
            return Detection(judged)
        read = part if known is None else known.left(part, job.turbine, fit.sensors)
        sines = [find_sine(read, job.turbine, fit.sensors, *line) for line in seen.candidates(fit)]
        new = _unknown(list(filter(None, sines)), known, part.duration)
        if new:
            odds = math.log10(odds_of(self.code, job.turbine))
            return Detection(judged, Sinusoids((*_sines(known), *new)), SINUSOID_DIGITS + odds)
        waves = known is not None and not known.forces
        if job.filtered and waves and turned(fit.read, job.turbine, fit.sensors) is not None:
            return _as_forces(job, fit, judged, _sines(known))
        return Detection(judged)


class RotorHarmonic(Effect):
    """Rotor harmonics: imbalance, and loads that repeat in every turn, in the innovations."""

    code = "rotor_harmonic"

    def detect(self, job: Job, fit: FittedJob) -> Detection:
        """Test innovations at nP; masses that are off may be an imbalance. Then estimate forces again."""
        if not job.filtered:
            return Detection(fit)
        known = job.inclusion(Sinusoids)
        left = find_turning(fit.outcome.final.whitened, fit.read, job.turbine, fit.sensors, _sines(known))
        judged = fit.lacking(*(one.doubt for one in left))
        if any(one.group == "masses" and one.off for one in fit.outcome.tolerances):
            turn = one_turn(fit.read, job.turbine, fit.sensors)
            left += [turn] if turn is not None else []  # an imbalance looks like blades of other masses
        new = _unknown(left, known, job.part.duration)
        found = _with_amplitudes(job, fit, known or Sinusoids(()), new)
        if found is None:
            return _as_forces(job, fit, judged, (*_sines(known), *new)) if new else Detection(judged)
        return Detection(judged, found, math.inf, fit)


def harmonics_of_spectra(job: Job, fit: FittedJob) -> Sinusoids | None:
    """Rotor harmonics from 2P on in the innovations of one filter at the result of spectra: filters converge slowly
    with unmodelled loads. 1P may come from masses and is tested later."""
    if not (fit.outcome.turns and fit.outcome.hypothesis == Broadband.name):
        return None
    of = fit.read, job.turbine, fit.sensors
    problem = pose(*of, fit.prior, job.parameters, fit.outcome.hypothesis)
    model = problem.build(where_it_ended(fit.outcome, problem))
    left = EKF.run(model, EKF.init(model), problem.inputs, problem.readings)[1].whitened
    known = job.inclusion(Sinusoids)
    new = _unknown([one for one in find_turning(left, *of) if one.order > 1], known, job.part.duration)
    return Sinusoids((*_sines(known), *new)) if new else None


class _Lines(NamedTuple):
    """Frequencies that may be sinusoids: the line near a mode, and the frequency that a coefficient depends on;
    findings if they are not included, and the line of unknown influence."""

    line: Line | None
    depends: tuple[tuple[str, float], ...]
    doubts: tuple[Finding, ...]
    judged_line: Line | None

    @classmethod
    def of(cls, job: Job, fit: FittedJob) -> "_Lines":
        """Tonal components of a fit."""
        dependence, line = doubt_line(job, fit), line_of(fit.outcome, fit.read)
        depends = () if dependence is None else ((dependence.channel, dependence.frequency),)
        doubts = () if dependence is None else (dependence.doubt,)
        known = None
        if line is not None and line.ratio > line.bound:
            known = doubt_standing_out(line, job, fit, abs(modes_of(fit.outcome).speed) / (2.0 * math.pi))
        if known is None:
            return cls(line, depends, doubts, line)
        new = tuple(one for one in known if one not in doubts)
        return cls(line if known else None, depends, (*doubts, *new), None)

    def candidates(self, fit: FittedJob) -> list[tuple[str, float]]:
        """Channels and frequencies [Hz]."""
        first = found_line(fit.outcome.whiteness, self.line)
        return [*([first] if first is not None else []), *self.depends, *_steady_in_readings(fit)]

    def judged(self, job: Job, fit: FittedJob, known: Sinusoids | None) -> FittedJob:
        """Fit with the findings on lines."""
        fit = fit.lacking(*self.doubts)._replace(line=self.judged_line)
        for sine in _sines(known):
            if not (sine.order or fit.outcome.doubts or fit.unmodelled):
                fit = fit.lacking(*doubt_sine(sine.frequency, job, fit))
        return fit


def _steady_in_readings(fit: FittedJob) -> list[tuple[str, float]]:
    """Frequencies near the modes of the support at which its readings are steady by Thomson's F, but for rotor
    harmonics and narrow resonances, which are as steady: a line that a mode has taken in does not stand out."""
    at, record = modes_of(fit.outcome), fit.read
    between = _near_supports(at.turbine)
    if between is None or not record.is_uniform:
        return []
    found = list[tuple[str, float]]()
    for channel in (sensor.channel for sensor in fit.sensors if not sensor.blade):
        values = record[channel]
        if np.isfinite(values).all():
            low, high = between[0], min(between[1], 0.4 * record.rate)
            lines = find_lines(values[:, None] - values.mean(), record.rate, low, high)
            found += [(channel, f) for f in lines]
    modes, rotor_hz = no_narrower(fit.outcome.turbine, at.modes), abs(at.speed) / (2.0 * math.pi)
    other = may_be_no_line(np.array([f for _, f in found]), modes, rotor_hz, 1.0 / record.duration)
    return [one for one, is_other in zip(found, other, strict=True) if not is_other]


def _near_supports(turbine: Turbine) -> tuple[float, float] | None:
    """Lowest and highest frequency [Hz] near a mode of the support; None where it has no mode."""
    names = [one.name for one in turbine.model.freedoms if not one.blade]
    hz = [turbine.natural_frequency(name) / (2.0 * math.pi) for name in names]
    hz = [one for one in hz if one > 0.0]
    return (min(hz) / LINE_SEARCH_FACTOR, max(hz) * LINE_SEARCH_FACTOR) if hz else None


def _sines(known: Sinusoids | None) -> tuple[Sine, ...]:
    return known.sines if known is not None else ()


def _unknown(found: Sequence[Sine], known: Sinusoids | None, duration: float) -> list[Sine]:
    """Sinusoids that are not included yet, each once."""
    new, apart = list[Sine](), HARMONIC_HALF_WIDTH_BINS / duration
    for sine in found:
        if not any(sine.same_as(other, apart) for other in (*_sines(known), *new)):
            new.append(sine)
    return new


def _with_amplitudes(job: Job, fit: FittedJob, known: Sinusoids, new: Sequence[Sine]) -> Sinusoids | None:
    """New sinusoids and known forces after Newton's step of their amplitudes and a fit's unknowns together, if there is
    a linearisation; without new ones `MAX_REVISIONS` times at most, and only if an estimate depends on the step."""
    record = job.resampled().record
    before = _forces_before(known, new, fit, record) if new or known.revisions < MAX_REVISIONS else []
    at = linearise(job, fit) if before else None
    if at is None:
        return None
    forces, shift, widening = step_of(before, at, record, fit.outcome.scores[0].precision)
    if not (new or at.depends_on(shift)):
        return None
    again = 0 if new else known.revisions + 1
    return Sinusoids((*known.sines, *new), forces, widenings={"forces": widening}, revisions=again)


def _forces_before(known: Sinusoids, new: Sequence[Sine], fit: FittedJob, record: Record) -> list[SineForce]:
    """Known forces except images of new ones, and new ones of size zero; none if a known sinusoid is no force yet."""
    if known.sines and not known.forces:
        return []
    turbine, apart = fit.outcome.turbine, HARMONIC_HALF_WIDTH_BINS / record.duration
    ways = {one: ways_of(one.sine, record, turned(record, turbine, fit.sensors)) for one in known.forces}
    kept = [one for one in ways if not any(way.same_as(sine, apart) for way in ways[one] for sine in new)]
    loads = [one for one in turbine.model.freedoms if not one.blade and one.load not in record]
    return kept + [SineForce(sine, one.load, one.load_unit, 0.0, 0.0, 0.0) for sine in new for one in loads]


def _as_forces(job: Job, fit: FittedJob, judged: FittedJob, sines: tuple[Sine, ...]) -> Detection:
    """Sinusoids as forces, whose amplitudes are estimated with the fit's unknowns fixed."""
    at = job.without(Sinusoid.code).resampled()
    of = at.record, job.turbine, at.sensors, job.prior or Prior(), job.parameters
    problem = pose(*of, fit.outcome.hypothesis)
    forces = find_forces(problem, where_it_ended(fit.outcome, problem), at.record, sines)
    if not forces:
        return Detection(judged)
    near = linearise(job, fit)
    widenings = {} if near is None else {"forces": step_of(forces, near, at.record, fit.outcome.scores[0].precision)[2]}
    return Detection(judged, Sinusoids(sines, tuple(forces), widenings=widenings), math.inf, fit)

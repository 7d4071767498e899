"""The spectral formulation: coefficients from the spectra of a stationary record.

Where loads are steady and the speed is constant, a record says all it knows in its spectra
(`windsysid.spectral.transforms.lifted`). The coefficients and the statistics of loads and noise are found at the mode
of the posterior by scoring (`windsysid.spectral.rotor.scoring`), with any smooth load spectrum and without load states.
It is not for what is not stationary: a free decay, a start, a stop, or a speed that varies much.
"""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import HARMONIC_HALF_WIDTH_SHARE
from windsysid.errors import ConfigurationError, RecordError, WindsysidError
from windsysid.identification.condition.spectral_readings import SpectralSamples
from windsysid.identification.estimate.evidence import Ranking, rank
from windsysid.identification.estimate.fitted.spectra import spectra_of_model
from windsysid.identification.estimate.prior_conflict import find_held, one_by_one
from windsysid.identification.estimate.spectral.narrow_band import (
    doubts_of_narrow_band,
    fit_narrow_band,
    note_narrow_band,
)
from windsysid.identification.estimate.spectral.rotor_bands import SpectralEstimate, read_in_bands
from windsysid.identification.limits import (
    MAX_SPEED_VARIATION_IN_BANDS,
    NEGLIGIBLE_SPEED_VARIATION,
    NEGLIGIBLE_SPEED_VARIATION_IN_BANDS,
)
from windsysid.identification.model.fit import Outcome, known_loads, no_innovations
from windsysid.identification.model.prior import Prior, identifiable
from windsysid.identification.model.tolerances import (
    doubt_tolerances,
    in_numbers,
    learned_tolerances,
    note_tolerances,
    places_of_shared,
    tolerances_of,
)
from windsysid.identification.model.turbine_problem import seen_by
from windsysid.identification.verdict.spectral_findings import doubts_of_spectra, drifts_of, halves_of, passed_by
from windsysid.loads.family import hypothesis
from windsysid.loads.hypothesis import HYPOTHESES
from windsysid.loads.narrow_band import NarrowBand
from windsysid.loads.rotor_wind import RotorWind
from windsysid.loads.statistics import learned_statistics
from windsysid.mechanics.compile import compile_model
from windsysid.mechanics.rotor import MEAN_LAG
from windsysid.mechanics.sensors import Sensor
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.tolerance import Tolerance
from windsysid.spectral.rotor.build import pose_lifted, turns_couple
from windsysid.spectral.rotor.fit import COARSE, WHOLE, RotorFit, admit, fit
from windsysid.spectral.rotor.model import Inexact
from windsysid.spectral.rotor.problem import Posed, RotorQuestion
from windsysid.spectral.rotor_bands.build import belongs_in_bands
from windsysid.spectral.transforms.block_sums import BlockSums
from windsysid.spectral.transforms.rotating_frame import TurnedBlock
from windsysid.statespace.compose import compose
from windsysid.turbine.turbine import Turbine

__all__ = ["SpectralBlocks", "ask", "identify_by_spectrum", "inexact_of", "tolerances_in"]

MAX_RIVAL_LOG_ODDS = 50.0
"""Tolerance: log odds against a load model that is not fitted to the end, far beyond those of any that is chosen; the
first stages weigh the record with a fifth."""


class SpectralBlocks(NamedTuple):
    """The sums over the blocks of a record that came in pieces, and the blocks' rotor speeds [rad/s]."""

    sums: BlockSums[Any]
    speeds: Array


def identify_by_spectrum(
    record: Record, turbine: Turbine, sensors: Sequence[Sensor], prior: Prior, chosen: Sequence[str] | None = None, *,
    loads: str = "auto", blocks: SpectralBlocks | None = None,
) -> Outcome:  # fmt: skip
    """Identify the chosen parameters, or every coefficient that the sensors see, from the spectra of a uniformly
    sampled record, or of `blocks`: then `record` is the last of them.

    Raises
    ------
    RecordError, ConfigurationError
        If the record is too short, has gaps, holds measured loads or a speed that varies, or no such load model fits
        this turbine.
    """
    notes: list[Finding] = []
    turbine = seen_by(turbine, sensors, notes)
    samples = SpectralSamples.of(record, turbine, sensors, notes, blocks.sums if blocks else None)
    _refuse_measured_loads(record, turbine)
    started = time.perf_counter()
    broad = ask(samples, turbine, prior, chosen, "broadband")
    coupled, speeds = turns_couple(broad), blocks.speeds if blocks else broad.speed
    if coupled and belongs_in_bands(broad):
        in_bands = _in_bands(
            broad, loads, _speed(speeds, NEGLIGIBLE_SPEED_VARIATION_IN_BANDS, MAX_SPEED_VARIATION_IN_BANDS), notes
        )
        if in_bands is not None:
            return in_bands
    doubts = _speed(speeds, NEGLIGIBLE_SPEED_VARIATION, HARMONIC_HALF_WIDTH_SHARE) if coupled else []
    names = _names(turbine, loads, coupled=coupled)
    questions = {one: broad if one == "broadband" else ask(samples, turbine, prior, chosen, one) for one in names}
    poses = {name: pose_lifted(question, name) for name, question in questions.items()}
    started += _compile(poses.values())
    found = _fitted(poses)
    question = questions[found.name]
    if loads == NarrowBand.name:
        found = _with_narrow_band(question, found)
    outcome = _lifted_outcome(question, found, (notes, doubts), None if coupled else float(speeds.mean()))
    return outcome._replace(turns=coupled, elapsed=time.perf_counter() - started)


def _refuse_measured_loads(record: Record, turbine: Turbine) -> None:
    """ConfigurationError where a record holds a load of the turbine."""
    known, unknown = known_loads(record, turbine)
    if known.any() or len({load.load for load in unknown}) < len(turbine.model.loads):
        raise ConfigurationError(
            "the spectral formulation takes no measured loads: leave load_… out, or use formulation='joint'"
        )


def _compile(poses: Iterable[Posed]) -> float:
    """Evaluate each problem once, which compiles its kernels; the seconds [s] that took."""
    started = time.perf_counter()
    for posed in poses:
        posed.model.likelihood(posed.start, max(1, len(posed.model.place.base)))
    return time.perf_counter() - started


def _in_bands(question: RotorQuestion, loads: str, doubts: list[Finding], notes: list[Finding]) -> Outcome | None:
    """The result of a rotor that is read in bands; None where its modes cannot be separated."""
    started = time.perf_counter()
    tolerances = tolerances_in(question)
    found = read_in_bands(question, loads, inexact_of(question, tolerances) if tolerances else None)
    if found is None:
        if question.sums is not None or question.turned is not None:
            raise ConfigurationError(
                "modes of the rotor are too close to be separated in segments: identify a section of it"
            )
        return None
    found = found._replace(notes=(*notes, *found.notes), doubts=(*doubts, *found.doubts))
    outcome = _outcome(question, found, tolerances, RotorWind.name)
    return outcome._replace(in_bands=True, spectra=found.spectra, elapsed=time.perf_counter() - started)


def _lifted_outcome(
    question: RotorQuestion, found: "_Found", findings: tuple[list[Finding], list[Finding]], passing_speed: float | None
) -> Outcome:
    """The result of a load model's fit, with notes and doubts before its own; blades pass a support at a speed [rad/s]
    where their turns are no part of the model."""
    (notes, doubts), posed, best, tolerances = findings, found.posed, found.fit, tolerances_in(question)
    if tolerances:
        best = admit(best, inexact_of(question, tolerances))
    halves = halves_of(question, posed, best, found.name)
    doubts += [*found.doubts, *doubts_of_spectra(question, posed, best, found.name, halves)]
    if passing_speed is not None:
        doubts += passed_by(question, best.unknowns, abs(passing_speed) / (2.0 * math.pi))
    notes += [
        *found.notes,
        *_lag_angle(best),
        Finding("loads_of_spectra", "note", {"loads": posed.text, **found.why}),
        Finding("ranges_read", "note", {"ranges": posed.bands}),
    ]

    def log_likelihood(unknowns: Array) -> float:
        return -best.model.likelihood(unknowns, slopes=False).value

    held = find_held(one_by_one(log_likelihood), best.unknowns, best.cov, best.model.parameters)
    estimate = SpectralEstimate(
        best.unknowns, best.cov, best.model.unknowns, best.log_likelihood, best.model.statistics, tuple(doubts),
        tuple(notes), held,
    )  # fmt: skip
    drifts = drifts_of(question, halves, best.unknowns, tolerances)
    labels = [(sensor.channel, bool(sensor.blade)) for sensor in question.sensors]
    entries = [labels[entry % len(labels)] for entry in best.model.place.entries]
    spectra = spectra_of_model(best.model, best.unknowns, best.cov, entries)
    return _outcome(question, estimate, tolerances, found.name)._replace(drifts=drifts, spectra=spectra)


def _lag_angle(found: RotorFit) -> tuple[Finding, ...]:
    """The blades' mean lag angle, where it is an unknown."""
    if not found.model.lag:
        return ()
    lag = found.model.unknowns.of("lag").start
    return (Finding("lag_angle", "note", {"angle": found.unknowns[lag], "std": math.sqrt(found.cov[lag, lag])}),)


def _outcome(
    question: RotorQuestion, found: SpectralEstimate, tolerances: Sequence[Tolerance], hypothesis: str
) -> Outcome:
    """An estimate in filter coordinates."""
    unknowns, cov, blocks = found.unknowns, found.cov, found.blocks
    theta, eta, tau = blocks.of("parameters"), blocks.of("statistics"), blocks.of("tolerances", "clocks")
    kept = blocks.but("lag")
    learned = learned_tolerances(tolerances, unknowns[tau], cov[tau, tau])
    return Outcome(
        turbine=question.turbine,
        model=compose(
            question.turbine.model, rate=question.rate, values=question.turbine.values, parameters=question.parameters,
            sensors=question.sensors,
        ),
        history_mean=unknowns[None, theta], history_std=np.sqrt(np.diag(cov)[theta])[None],
        final=no_innovations(len(question.sensors), found.log_likelihood), theta=unknowns[theta], cov=cov[theta, theta],
        rotor=question.inputs, channels=tuple(sensor.channel for sensor in question.sensors), elapsed=0.0,
        notes=(*found.notes, *note_tolerances(learned)),
        statistics=learned_statistics(found.statistics, unknowns[eta], cov[eta, eta]),
        doubts=(*found.doubts, *doubt_tolerances(learned)), joint_cov=cov[np.ix_(kept, kept)], hypothesis=hypothesis,
        tolerances=learned, held=found.held, sensors=question.sensors,
        scores=tuple(one._replace(given=places_of_shared(blocks, tolerances)) for one in found.scores),
    )  # fmt: skip


def tolerances_in(question: RotorQuestion) -> tuple[Tolerance, ...]:
    """Tolerances of instruments and masses."""
    return tolerances_of(question.turbine, question.sensors, [q.name for q in question.parameters])


def inexact_of(question: RotorQuestion, tolerances: Sequence[Tolerance]) -> Inexact:
    """Tolerances as numbers."""
    names = [q.name for q in question.parameters]
    return in_numbers(tolerances, question.compiled.parameters, question.turbine, question.sensors, names)


def _names(turbine: Turbine, loads: str, *, coupled: bool) -> tuple[str, ...]:
    """The load models to try."""
    if loads not in ("auto", "broadband", NarrowBand.name, "rotor-wind"):
        raise ConfigurationError(
            "load model of the spectral formulation: expected auto, broadband, narrow-band or rotor-wind, got "
            f"'{loads}'"
        )
    if loads == NarrowBand.name:  # which is looked for from where broad loads end
        HYPOTHESES[loads].suppose(turbine, turbine.loads)
        return ("broadband",)
    if loads != "auto":
        return (loads,)
    pushed = [name for name in turbine.model.loads if name in ("load_x", "load_y")]
    return ("broadband", "rotor-wind") if coupled and pushed else ("broadband",)


def ask(
    samples: SpectralSamples, turbine: Turbine, prior: Prior, chosen: Sequence[str] | None, loads: str
) -> RotorQuestion:
    """The question under a load model, which may bring coefficients of its own."""
    record, sensors, sums = samples.record, samples.sensors, samples.sums
    file_loads = known_loads(record, turbine)[1]
    supposed = hypothesis(loads, turbine, file_loads)
    own = (q for q in supposed.parameters if q.name != MEAN_LAG)  # which is an unknown of spectra under any loads
    parameters = (*prior.parameters(turbine, identifiable(turbine, chosen), linear=False), *own)
    turbine = _without_lag(supposed.turbine, turbine)
    compiled = compile_model(turbine.model, sensors, instruments=True)
    question = RotorQuestion(
        turbine, sensors, samples.readings, record.rate, samples.inputs, compiled, parameters, tuple(file_loads),
        lifts=samples.lifts,
    )  # fmt: skip
    in_frame = sums is not None and isinstance(sums.last, TurnedBlock)
    return question._replace(turned=sums) if in_frame else question._replace(sums=sums)


def _without_lag(supposed: Turbine, file: Turbine) -> Turbine:
    """The turbine of a load model, without the mean lag angle that it brings where the file has none."""
    rotor = supposed.model.rotor
    if rotor is None or not rotor.leads or MEAN_LAG in file.values:
        return supposed
    values = {name: value for name, value in supposed.values.items() if name != MEAN_LAG}
    return replace(supposed, model=replace(rotor, leads=False), values=values)


def _speed(speed: Array, steady: float, varying: float) -> list[Finding]:
    """Findings against spectra of a constant speed; RecordError if it varies too much."""
    varies = float(speed.std() / abs(speed.mean()))
    if varies > varying:
        raise RecordError(
            f"the rotor's speed varies by ±{100 * varies:.2g} % (one σ): expected at most ±{100 * varying:g} % for "
            "spectra; choose a steadier section, or use formulation='joint'"
        )
    if varies > steady:
        return [Finding("varying_rotor_speed", "reason", {"variation": varies})]
    return []


class _Found(NamedTuple):
    """Load model that explains the record best, its problem, the fit, its log evidence over others, in which `part` of
    the record only was used, and notes."""

    name: str
    posed: Posed
    fit: RotorFit
    why: dict[str, Any]
    notes: tuple[Finding, ...] = ()
    doubts: tuple[Finding, ...] = ()


def _with_narrow_band(question: RotorQuestion, broad: _Found) -> _Found:
    """A narrow-band load in addition to broad ones; WindsysidError where none fits."""
    beside = fit_narrow_band(question, broad.posed, broad.fit, requested=True)
    if beside is None:
        raise WindsysidError("no narrow-band load fits this record: choose broadband")
    name, why = NarrowBand.name, {"rivals": {"broad loads alone": beside.gain}, "part": False}
    doubts = doubts_of_narrow_band(beside, asked=name)
    return _Found(name, beside.posed, beside.fit, why, (note_narrow_band(beside),), doubts)


def _fitted(poses: dict[str, Posed]) -> _Found:
    """Every load model on a few of the bins, and the one of the greatest evidence on all."""
    try:
        if len(poses) == 1:
            ((name, posed),) = poses.items()
            return _Found(name, posed, _fit_alone(posed), {"rivals": {}, "part": False})
        if any(posed.model.blocks > 1.0 for posed in poses.values()):
            return _after_all(poses)
        return _after_stages(poses)
    except np.linalg.LinAlgError:
        raise WindsysidError(
            "no spectrum of this model is positive: expected loads, noise and priors of the size of the record's; "
            "check units and the turbine file"
        ) from None


def _fit_alone(posed: Posed) -> RotorFit:
    """The mode from the prior's centre; of a block, which has few bins, on all of them from the first stage on."""
    whole = posed.model.blocks <= 1.0
    stages = [(weight, every if whole else 1) for weight, every in (*COARSE, *WHOLE)]
    return fit(posed.model, posed.start, stages, posed.smoothed)


def _after_stages(poses: dict[str, Posed]) -> _Found:
    """The load model of the greatest evidence: after the first stages where it is clear there, on half of the bins
    otherwise; fitted to the end."""
    tried = {name: fit(posed.model, posed.start, COARSE[:-1], rough=True) for name, posed in poses.items()}
    ranking = _ranked(tried)
    rivals = ranking.within(MAX_RIVAL_LOG_ODDS)
    later: Sequence[tuple[float, int]] = (*COARSE[-1:], *WHOLE)
    why = {"rivals": ranking.rivals(), "part": True}
    if len(rivals) > 1:
        tried = {name: fit(poses[name].model, tried[name].unknowns, COARSE[-1:], rough=True) for name in rivals}
        ranking, later = _ranked(tried), WHOLE
        why = {"rivals": ranking.rivals(), "part": False}
    name = ranking.best
    posed = poses[name]
    return _Found(name, posed, fit(posed.model, tried[name].unknowns, later, posed.smoothed), why)


def _after_all(poses: dict[str, Posed]) -> _Found:
    """Load model of the greatest evidence after all have been fitted to the end: the effect of a short block's taper on
    spectra can look like another load."""
    tried = {name: _fit_alone(posed) for name, posed in poses.items()}
    overlap = max(found.model.overlap for found in tried.values())
    ranking = rank(tried, lambda name: tried[name].evidence_at(overlap))
    best = tried[ranking.best]
    best = best._replace(log_evidence=best.evidence_at(overlap))
    return _Found(ranking.best, poses[ranking.best], best, {"rivals": ranking.rivals(), "part": False})


def _ranked(tried: Mapping[str, RotorFit]) -> Ranking[str]:
    """Load models by the evidence of their fits."""
    return rank(tried, lambda name: tried[name].log_evidence)

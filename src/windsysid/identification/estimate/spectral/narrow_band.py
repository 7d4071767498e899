"""Test for a narrow-band load: comparison of the spectra with and without one.

A machine nearby, waves or a neighbour's mode push at frequencies of their own. Near a damped mode such a load is the
narrower peak of the two: a search that knows broad loads only takes it for the mode, and the mode for a peak of the
loads. All that is left over is white then. So a narrow-band load on the support is let into the spectral likelihood
(`windsysid.loads.narrow_band`), and the evidence p(y | loads) with it and without is compared, by Laplace's
approximation (`windsysid.identification.estimate.evidence`).

The likelihood has several summits: the load may be the peak near a mode, or the peak that passed for the mode. Places
to begin at come from the channels that see most of the support, one by one: for many frequencies, widths and strengths
of the load, with the modes as they were found and damped as their priors have it, Whittle's likelihood of the
channel's spectrum is evaluated, and searches begin at the best.

Source: Whittle, J. R. Statist. Soc. B 15, 1953, https://doi.org/10.1111/j.2517-6161.1953.tb00131.x.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import NEGLIGIBLE_SHARE, STRONG_LOG_ODDS
from windsysid.checks.widening import mixture_factor
from windsysid.identification.estimate.spectral.narrow_band_posterior import responses, shifted_by_narrow_band
from windsysid.identification.limits import NEGLIGIBLE_SHIFT_SIGMAS
from windsysid.identification.model.prior_odds import chances_of_rivals, odds_of
from windsysid.loads.narrow_band import FREQUENCY, WIDTH, NarrowBand, narrow_band_statistics
from windsysid.loads.statistics import Statistic, coordinates_of, values_of
from windsysid.results.finding import Finding
from windsysid.spectral.rotor.build import pose_lifted
from windsysid.spectral.rotor.fit import WHOLE, RotorFit, fit
from windsysid.spectral.rotor.model import LiftedModel
from windsysid.spectral.rotor.narrow_band_spectra import narrow_density
from windsysid.spectral.rotor.problem import Posed, RotorQuestion

__all__ = ["NarrowBandFit", "doubts_of_narrow_band", "fit_narrow_band", "note_narrow_band"]

MAX_STARTS, FIRST_STAGES = 3, ((1.0, 2),)
"""Setting: how many starts are searched from; and, of the searches that tell which are worth it, the weight of the
likelihood and every how many-th bin is used."""

MAX_START_LOG_ODDS = 5.0
"""Setting: log evidence below the best within which starts are worth a search to the end."""

ROUGH_TOLERANCE = 0.1
"""Numerical: squared length of the last step in standard deviations of a search that tells evidence."""

SAME_OPTIMUM_SIGMAS = 0.5
"""Numerical: standard deviations of the coefficients within which two searches have ended in one place."""

MIN_START_LOG_SPACING = 0.04
"""Numerical: difference of the logarithm of frequency within which two places are one to begin at."""

TRIAL_COUNT, LOG_MARGIN = 61, 0.25
"""Setting: count of frequencies tried, and how far beyond the support's modes they reach, in log frequency."""

TRIAL_DAMPING, TRIAL_STRENGTHS = (0.001, 0.004, 0.02), (3.0, 30.0, 300.0)
"""Setting: damping ratios that are tried, and strengths over the spectrum without the load where it stands out most."""

FAINT_LOG_LEVEL = -1.0
"""Setting: coordinate of the level of a load that is hardly present."""


class Rival(NamedTuple):
    """An explanation other than the best one.

    Attributes
    ----------
    frequency
        Of its narrow-band load, or of the best one's [Hz].
    moved, shifts
        Shifts of the coefficients to it [σ], and in filter coordinates.
    widths
        Their standard deviations over those of the best one.
    chance
        Its probability.
    """

    frequency: float
    moved: dict[str, float]
    shifts: dict[str, float]
    widths: dict[str, float]
    chance: float

    def part(self, name: str) -> tuple[float, float, float]:
        """Its part in a mixture for a coefficient: shift, standard deviation and probability."""
        return self.moved[name], self.widths[name], self.chance


class NarrowBandFit(NamedTuple):
    """Fit of spectra with a narrow-band load.

    Attributes
    ----------
    posed, fit
        The problem, and the mode of its posterior.
    gain
        Posterior log odds against broad loads alone: log evidence and the prior odds at the load's frequency.
    moved
        Shifts of the coefficients from the fit with broad loads alone [σ].
    shifts
        The same in filter coordinates.
    rivals
        Other explanations that widen an interval.
    """

    posed: Posed
    fit: RotorFit
    gain: float
    moved: dict[str, float]
    shifts: dict[str, float]
    rivals: tuple[Rival, ...] = ()

    @property
    def is_needed(self) -> bool:
        """Test whether broad loads alone explain the record much worse and change coefficients."""
        return self.gain > STRONG_LOG_ODDS and max(map(abs, self.moved.values())) > NEGLIGIBLE_SHIFT_SIGMAS

    @property
    def statistics(self) -> tuple[Statistic, ...]:
        """Of the loads."""
        return self.posed.model.sources.statistics

    @property
    def values(self) -> dict[str, float]:
        """Of these, by name."""
        return values_of(self.statistics, self.fit.model.split_statistics(self.fit.unknowns)[0])


def fit_narrow_band(
    question: RotorQuestion, broad: Posed, found: RotorFit, *, requested: bool = False
) -> NarrowBandFit | None:
    """Fit of a record's spectra with a narrow-band load on the support; None where it could act on nothing.

    Parameters
    ----------
    broad, found
        The problem with broad loads, and where a search of it has ended, instruments and masses as files say.
    requested
        Whether results have this load even where it is not needed.
    """
    if not narrow_band_statistics(question.turbine, question.loads):
        return None
    posed, overlap = pose_lifted(question, NarrowBand.name, broad.bands), found.model.overlap
    posed = posed._replace(model=posed.model._replace(overlap=overlap))
    rough = _rough_ends(question, posed, broad, found)
    if not rough:
        return None
    worth = rough[0].log_evidence if requested else max(rough[0].log_evidence, found.log_evidence + STRONG_LOG_ODDS)
    near = [end.unknowns for end in rough if worth - end.log_evidence < MAX_START_LOG_ODDS]
    ends = [end._replace(log_evidence=end.evidence_at(overlap)) for end in _ends(question, posed, near) or rough[:1]]
    ends.sort(key=lambda end: -end.log_evidence)
    gain = ends[0].log_evidence - found.log_evidence
    fitted = NarrowBandFit(posed, ends[0], gain, *_off(question, found, ends[0]))
    needed = requested or fitted.is_needed
    rivals = _of_ends(question, ends[0], [*ends[1:], found]) if needed else _not_found(question, found, fitted, ends)
    return fitted._replace(rivals=_that_widen(rivals))


def doubts_of_narrow_band(found: NarrowBandFit | None, *, asked: str) -> tuple[Finding, ...]:
    """Finding on a narrow-band load against a result under the requested load model."""
    if found is None:
        return ()
    at = {"frequency": found.values[FREQUENCY]}
    if found.is_needed and asked not in ("auto", NarrowBand.name):
        (chance,) = chances_of_rivals([found.gain])
        data = at | {"gain": found.gain, "shifts": found.shifts, "chance": chance}
        return (Finding("narrow_band_load_preferred", "reason", data, tuple(found.moved)),)
    included = found.is_needed or asked == NarrowBand.name
    code = "narrow_band_load_ambiguous" if included else "narrow_band_load_possible"
    return tuple(Finding(code, "reason", *_data(rival)) for rival in found.rivals)


def _data(rival: Rival) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Data of a finding on a rival, and the coefficient that it moves most."""
    worst = max(rival.moved, key=lambda name: abs(rival.moved[name]))
    moved = {"frequency": rival.frequency, "sigmas": abs(rival.moved[worst])}
    return moved | {"shifts": rival.shifts, "widths": rival.widths, "chance": rival.chance}, (worst,)


def note_narrow_band(found: NarrowBandFit) -> Finding:
    """Note on a narrow-band load that a result includes."""
    at, levels = found.values, [one for one in found.statistics if one.kind == "narrow-band level"]
    loudest = max(levels, key=lambda one: at[one.name])
    load = {"rms": at[loudest.name], "unit": loudest.unit, "load": loudest.of}
    return Finding("narrow_band_load", "note", load | {"frequency": at[FREQUENCY], "width": at[WIDTH]})


def _rough_ends(question: RotorQuestion, posed: Posed, broad: Posed, found: RotorFit) -> list[RotorFit]:
    """Ends of rough searches, as `found` and what the load changes in the same bins: half of the bins and all of them
    differ by tens in log evidence, and by chance in the coefficients."""
    ends, alone = _ends(question, posed, _starts(question, found, posed.model), rough=True), found
    with suppress(np.linalg.LinAlgError):  # no spectrum there
        alone = fit(broad.model._replace(overlap=found.model.overlap), found.unknowns, FIRST_STAGES, rough=True)
    rest, theta = found.log_evidence - alone.log_evidence, found.model.unknowns.of("parameters")
    off = np.zeros(len(posed.start))
    off[theta] = found.unknowns[theta] - alone.unknowns[theta]
    return [end._replace(log_evidence=end.log_evidence + rest, unknowns=end.unknowns + off) for end in ends]


def _ends(question: RotorQuestion, posed: Posed, starts: Sequence[Array], *, rough: bool = False) -> list[RotorFit]:
    """Ends of the searches, the best first; ends with equal coefficients count as one. A rough search evaluates
    at every other bin, and not at what the taper adds."""
    found, ends = list[RotorFit](), list[RotorFit]()
    last: dict[str, Any] = {"stages": WHOLE, "smoothed": posed.smoothed, "enough": ROUGH_TOLERANCE}
    how = {"stages": FIRST_STAGES, "rough": True} if rough else last
    for start in starts:
        with suppress(np.linalg.LinAlgError):  # no spectrum there
            found.append(_with_prior(question, fit(posed.model, start, **how)))
    for end in sorted(found, key=lambda end: -end.log_evidence):
        # negative damping of a support has the spectra of positive damping
        is_image = (end.unknowns[_support_damping(question)] < 0.0).any()
        off = (max(map(abs, _off(question, other, end)[0].values())) for other in ends)
        if not is_image and all(largest >= SAME_OPTIMUM_SIGMAS for largest in off):
            ends.append(end)
    return ends


def _support_damping(question: RotorQuestion) -> list[int]:
    """Indicator of the unknowns that are damping coefficients of the support."""
    supports = {one.name for one in question.turbine.model.freedoms if not one.blade}
    return [i for i, q in enumerate(question.parameters) if q.kind == "damping" and q.part in supports]


def _with_prior(question: RotorQuestion, end: RotorFit) -> RotorFit:
    """A fit whose log evidence includes the log prior odds of a narrow-band load at its frequency."""
    odds = odds_of("narrow_band_load", question.turbine, _frequency_of(end))
    return end._replace(log_evidence=end.log_evidence + math.log(odds))


def _starts(question: RotorQuestion, found: RotorFit, model: LiftedModel) -> list[Array]:
    """Start values: near the modes as found, with the prior's damping, and with more."""
    damped, more, of_support = found.unknowns.copy(), found.unknowns.copy(), _support_damping(question)
    damped[of_support] = model.prior[0][of_support]
    more[of_support] = damped[of_support] + model.prior[1][of_support]
    chosen = _best_of([*_places(question, model, damped), *_places(question, model, found.unknowns)])
    swapped = [
        _swapped(question, one) for one in chosen if abs(math.log(one.frequency / one.mode)) > MIN_START_LOG_SPACING
    ]
    last = max(_places(question, model, more), key=lambda one: one.gain)
    return [*(one.start for one in chosen), *swapped[:1], last.start]


def _best_of(places: "Sequence[_Place]") -> "list[_Place]":
    """The best places whose searches end differently."""
    chosen = list[_Place]()
    for one in sorted(places, key=lambda one: -one.gain):
        if len(chosen) < MAX_STARTS and not any(one.is_like(other) for other in chosen):
            chosen.append(one)
    return chosen


def _swapped(question: RotorQuestion, place: "_Place") -> Array:
    """The mode where the load was, and the load where the mode was."""
    start = place.start.copy()
    for i, q in enumerate(question.parameters):
        if q.kind == "stiffness" and q.part == place.name:
            start[i] = q.coordinate(float(q.physical(start[i])) * (place.frequency / place.mode) ** 2)
    start[place.at] += math.log(place.mode / place.frequency)
    return start


class _Place(NamedTuple):
    """A place to begin at.

    Attributes
    ----------
    frequency
        Of the load [Hz].
    name, mode
        The degree of freedom that it pushes, and the frequency of that [Hz].
    known, gain
        What is known of coefficients and broad loads, and by how much a channel's likelihood is greater than with these
        alone.
    start, at
        All unknowns, and which of them is the load's frequency.
    """

    frequency: float
    name: str
    mode: float
    known: Array
    gain: float
    start: Array
    at: int

    def is_like(self, other: "_Place") -> bool:
        """True if a search from the other ends at the end of one from here."""
        return self.known is other.known and abs(math.log(self.frequency / other.frequency)) < MIN_START_LOG_SPACING


def _places(question: RotorQuestion, model: LiftedModel, known: Array) -> Iterator[_Place]:
    """The best frequency of a load on each degree of freedom of the support, for every width and strength."""
    narrow = narrow_band_statistics(question.turbine, question.loads)
    at = model.unknowns.of("statistics").stop - len(model.noise) - len(narrow)
    seen = list(responses(question, model, known))
    modes = [of.mode for of in seen]
    places = np.exp(np.linspace(math.log(min(modes)) - LOG_MARGIN, math.log(max(modes)) + LOG_MARGIN, TRIAL_COUNT))
    for mode, level, f, S, _, H, P in [(of.mode, of.level, *of[2:]) for of in seen]:
        cost = np.einsum("b,be->", model.counts, np.log(S) + P / S)
        for width in TRIAL_DAMPING:
            shape = narrow_density(f, places[:, None, None], width)[0] * H
            for over in TRIAL_STRENGTHS:
                rms = np.sqrt(over / np.max(shape / S, axis=(1, 2)))
                whole = S + np.square(rms)[:, None, None] * shape
                costs = np.einsum("b,pbe->p", model.counts, np.log(whole) + P / whole)
                best = int(np.argmin(costs))
                there = {FREQUENCY: float(places[best]), WIDTH: width, level.name: float(rms[best])}
                eta = coordinates_of(narrow, there)
                eta[2:][[one.name != level.name for one in narrow[2:]]] = FAINT_LOG_LEVEL
                start = np.insert(known, at, eta)
                yield _Place(there[FREQUENCY], level.of, mode, known, float(cost - costs[best]), start, at)


def _of_ends(question: RotorQuestion, best: RotorFit, others: Sequence[RotorFit]) -> list[Rival]:
    """Explanations other than the best one where searches have ended."""
    chances = chances_of_rivals([other.log_evidence - best.log_evidence for other in others])
    return [
        Rival(_frequency_of(other, best), *_off(question, best, other), _widths(question, best, other), chance)
        for other, chance in zip(others, chances, strict=True)
    ]


def _not_found(
    question: RotorQuestion, found: RotorFit, beside: NarrowBandFit, ends: Sequence[RotorFit]
) -> list[Rival]:
    """Narrow-band loads that a fit with broad loads alone lacks: of their posterior, and ends of searches that are too
    narrow a peak of it for the points of its integral."""
    stds = dict(zip([q.name for q in question.parameters], np.sqrt(np.diag(found.cov)).tolist(), strict=False))
    parts = shifted_by_narrow_band(question, beside.posed.model, found)
    rivals = []
    for one, chance in zip(parts, chances_of_rivals([one.log_odds for one in parts]), strict=True):
        shifts, widths = dict.fromkeys(stds, 0.0) | one.shifts, dict.fromkeys(stds, 1.0) | one.widths
        moved = {name: shift / stds[name] for name, shift in shifts.items()}
        rivals.append(Rival(one.frequency, moved, shifts, widths, chance))
    known = max((one.log_odds for one in parts), default=-math.inf) + found.log_evidence
    return [*rivals, *_of_ends(question, found, [end for end in ends if end.log_evidence > known])]


def _that_widen(rivals: Sequence[Rival]) -> tuple[Rival, ...]:
    """All rivals that move a coefficient whose interval they widen together; a few that hardly do add up."""
    names = list(rivals[0].moved) if rivals else []
    wide = [name for name in names if mixture_factor([one.part(name) for one in rivals]) > 1.0 + NEGLIGIBLE_SHARE]
    return tuple(one for one in rivals if any(mixture_factor([one.part(name)]) > 1.0 for name in wide))


def _frequency_of(*ends: RotorFit) -> float:
    """Frequency [Hz] of the narrow-band load of the first fit that has one."""
    loads = (values_of(end.model.sources.statistics, end.model.split_statistics(end.unknowns)[0]) for end in ends)
    return next(values[FREQUENCY] for values in loads if FREQUENCY in values)


def _off(question: RotorQuestion, best: RotorFit, other: RotorFit) -> tuple[dict[str, float], dict[str, float]]:
    """Shifts of the coefficients under another explanation, in standard deviations and in filter coordinates."""
    theta, names = best.model.unknowns.of("parameters"), [q.name for q in question.parameters]
    shifts = other.unknowns[theta] - best.unknowns[theta]
    sigmas = shifts / np.sqrt(np.diag(best.cov)[theta])
    return dict(zip(names, sigmas.tolist(), strict=True)), dict(zip(names, shifts.tolist(), strict=True))


def _widths(question: RotorQuestion, best: RotorFit, other: RotorFit) -> dict[str, float]:
    """Standard deviations of the coefficients under another explanation over those under the best one."""
    stds = [np.sqrt(np.diag(end.cov)[end.model.unknowns.of("parameters")]) for end in (best, other)]
    return dict(zip([q.name for q in question.parameters], (stds[1] / stds[0]).tolist(), strict=True))

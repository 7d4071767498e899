"""Grades of coefficients, frequencies and damping ratios, and the widening of their intervals.

A: the interval of the model. B: a wider interval, as scores of parts of the record disperse
(`windsysid.checks.dispersion`) or a rival explanation is possible. C: not to be used, for a reason that no interval
covers. A reason affects the coefficients that it names, or those whose channels it names, and modes that depend on
them.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, get_args

import numpy as np

from windsysid._types import Array
from windsysid.checks.dispersion import PartScores, expected_factor
from windsysid.checks.limits import (
    MAX_DISAGREEMENT_SIGMAS,
    MAX_INFORMED_STD_RATIO,
    MAX_WIDENING,
    MIN_RIVAL_PROBABILITY,
    NEGLIGIBLE_SHARE,
)
from windsysid.checks.verdict import Diagnosis
from windsysid.checks.widening import grade_of, mixture_factor
from windsysid.identification.estimate.fitted.modes import FittedModes
from windsysid.identification.model.fit import Outcome
from windsysid.results.estimate import IntervalEstimate
from windsysid.results.finding import Finding
from windsysid.results.mode import Mode
from windsysid.results.posterior import SIGMAS
from windsysid.results.tolerance import SHARED, Group
from windsysid.statespace.parameter import Parameter

__all__ = [
    "Widening", "grade_coefficients", "grade_modes", "is_contradictory", "judged", "scaled",
    "widen_coefficients", "widenings_of", "with_tolerance_shifts",
]  # fmt: skip

_EVERY = frozenset({"time", "frequency"})

COVERED_BY_INTERVALS: Mapping[str, frozenset[str]] = {
    **dict.fromkeys(("channel_level", "heavy_tails", "innovation_level", "nonstationary_level"), frozenset({"time"})),
    **dict.fromkeys((
        "correlated_innovations", "correlated_loads", "level_over_frequency", "unexplained_level", "unexplained_peak",
    ), _EVERY),
    "halves_disagree_in_bands": frozenset(), "narrower_bands_disagree": frozenset(),
    **dict.fromkeys(("narrow_band_load_ambiguous", "narrow_band_load_possible", "prior_decides"), frozenset()),
}  # fmt: skip
"""Setting: findings that intervals cover, and the scores that this takes: of loads that change, over time; of
innovations that are not white, over frequencies too; of narrow-band loads, halves and narrower bands, whose rivals are
known by themselves, none. White innovations of another level scatter scores by that level at most, where no scores
over frequencies show by how much."""

Readers = Mapping[str, Collection[str]]
"""For each degree of freedom that moves by itself the channels that measure it."""


class Widening(NamedTuple):
    """Widening of the interval of a quantity.

    Attributes
    ----------
    name, quantity
        A coefficient, or a mode's frequency or damping ratio, and its derivatives to the coefficients (n_θ,).
    std
        Standard deviation of the model, given the masses.
    factor
        Standard deviation over that of the model.
    over, place
        Cause of most of it: ``time``, ``frequency``, ``level`` or ``explanations``, and where [s] or [Hz]; empty
        without one.
    of_rivals
        Part of the factor that rival explanations make.
    prior_std
        Standard deviation of the prior; infinite if it is not compared with the interval.
    """

    name: str
    quantity: Array
    std: float
    factor: float = 1.0
    over: str = ""
    place: float = 0.0
    of_rivals: float = 1.0
    prior_std: float = math.inf

    @property
    def is_usable(self) -> bool:
        """Test whether an interval may be used: the factor is not too large, or rivals make it, and the interval that
        covers them is much narrower than that of the prior."""
        informed = self.factor * self.std <= MAX_INFORMED_STD_RATIO * self.prior_std
        return self.factor <= MAX_WIDENING or (self.factor / self.of_rivals <= MAX_WIDENING and informed)

    def added(self) -> Array:
        """Contributions of dispersion and of rival explanations to the variance, over that of the model (2,)."""
        return np.diff(np.square([1.0, self.factor / self.of_rivals, self.factor]))


def widenings_of(
    outcome: Outcome, at: FittedModes, findings: Sequence[Finding]
) -> tuple[list[Widening], list[list[Widening]]]:
    """Compute the widening of coefficients given masses and aerodynamics, and of frequencies and damping ratios of
    modes given the masses, from scores and from rival explanations among the findings."""
    scores, cov = outcome.scores, outcome.given(*SHARED)[1]
    level, priors = _level_factor(findings, scores), np.array([q.prior[1] for q in outcome.priors])

    def by_level(one: Widening) -> Widening:
        one = one._replace(prior_std=float(np.linalg.norm(one.quantity * priors)))
        return one._replace(factor=level, over="level", place=0.0) if one.factor < level else one

    coefficients = [by_level(one) for one in widen_coefficients(scores, outcome.model.parameters, cov)]
    modes = [
        [_widening(scores, f"{mode.name} {what}", row, cov) for mode, row in zip(at.modes, rows, strict=True)]
        for what, rows in zip(("frequency", "damping ratio"), at.slopes, strict=True)
    ]
    rivals = _rivals([one for one in findings if _is_coverable(one, scores)], coefficients)
    stds = np.array([one.std for one in coefficients])
    return (
        [_with_rivals(one, rivals, stds) for one in coefficients],
        [[_in_whole(_with_rivals(by_level(one), rivals, stds), at.given_masses) for one in row] for row in modes],
    )


def _level_factor(findings: Sequence[Finding], scores: Sequence[PartScores]) -> float:
    """Factor on intervals by the level of innovations where there are no scores over frequencies. If the level is
    another one, it bounds the factor; if it varies, scores are proportional to the power p of the loads and have
    E p² / (E p)² times the variance that its mean gives."""
    if "frequency" in {one.over for one in scores}:
        return 1.0
    ratios = [f.data["ratio"] for f in findings if f.code in ("channel_level", "innovation_level")]
    varying = [math.hypot(1.0, f.data["variation"]) for f in findings if f.code == "nonstationary_level"]
    return float(max([1.0, *ratios]) * max([1.0, *varying]))


def with_tolerance_shifts(diagnosis: Diagnosis, outcome: Outcome) -> Diagnosis:
    """Add to conflicts of gains, axes and clocks with their tolerances the shifts of the coefficients if they were as
    their file says: the regression on them in the posterior."""
    joint, places = outcome.joint_cov, outcome.unknowns.places("tolerances", "clocks")
    if joint is None:
        return diagnosis
    known, names = {}, [q.name for q in outcome.model.parameters]
    for at, one in zip(places.tolist(), outcome.tolerances, strict=True):
        if one.group != "masses" and joint[at, at] > 0.0:
            shifts = -joint[: len(names), at] / joint[at, at] * one.estimate / one.spread
            known[one.group, one.of] = dict(zip(names, shifts.tolist(), strict=True))
    findings = [
        replace(one, data={**one.data, "shifts": known[key], "chance": MIN_RIVAL_PROBABILITY})
        if one.code == "tolerance_conflict" and (key := (one.data["group"], one.data["of"])) in known
        else one
        for one in diagnosis.findings
    ]
    return replace(diagnosis, findings=tuple(findings))


def is_contradictory(outcome: Outcome) -> bool:
    """Test whether segments of the record make the interval of a coefficient more than twice as wide."""
    over_time = [one for one in outcome.scores if one.over == "time"]
    found = widen_coefficients(over_time, outcome.model.parameters, outcome.cov)
    return max((one.factor for one in found), default=1.0) > SIGMAS


def _is_coverable(one: Finding, scores: Sequence[PartScores]) -> bool:
    """Test whether there are the scores with which intervals may cover a finding: none for a line of known shifts."""
    alone = one.code == "spectral_line" and "shifts" in one.data
    return alone or {each.over for each in scores} >= COVERED_BY_INTERVALS.get(one.code, _EVERY)


def _rivals(findings: Sequence[Finding], coefficients: Sequence[Widening]) -> list[tuple[Array, Array, float]]:
    """Shifts of the coefficients under rival explanations (n_θ,), their standard deviations there over those of the
    result (n_θ,), and the probability of each rival."""
    found = []
    for one in findings:
        if one.severity == "reason" and "shifts" in one.data:
            far, chance = _beyond(one, coefficients), float(one.data["chance"])
            if far and _has_evidence(one):
                far, chance = (), max(chance, MIN_RIVAL_PROBABILITY)
            off = [0.0 if each.name in far else one.data["shifts"].get(each.name, 0.0) for each in coefficients]
            widths = [one.data.get("widths", {}).get(each.name, 1.0) for each in coefficients]
            found.append((np.array(off), np.array(widths), chance))
    return found


def _has_evidence(one: Finding) -> bool:
    """Test whether the probability and the own intervals of a rival explanation are known. One that is far away counts
    with even odds: a slightly wrong prior or load model may make it the likelier one."""
    return "widths" in one.data


def _in_sigmas(one: Finding, coefficients: Sequence[Widening]) -> dict[str, float]:
    """Shifts of the coefficients under a rival explanation, in standard deviations with their dispersion."""
    shifts, known = one.data["shifts"], [each for each in coefficients if each.std > 0.0]
    return {each.name: abs(shifts.get(each.name, 0.0)) * each.of_rivals / (each.factor * each.std) for each in known}


def _beyond(one: Finding, coefficients: Sequence[Widening]) -> tuple[str, ...]:
    """Coefficients that differ under a rival explanation, if one shifts far."""
    off = _in_sigmas(one, coefficients)
    return _differing(off) if max(off.values(), default=0.0) > SIGMAS * MAX_WIDENING else ()


def _differing(off: Mapping[str, float]) -> tuple[str, ...]:
    """Coefficients that differ, the most shifted first."""
    return tuple(sorted((name for name in off if off[name] > MAX_DISAGREEMENT_SIGMAS), key=lambda name: -off[name]))


def _covered(one: Finding, coefficients: Sequence[Widening]) -> Finding:
    """Turn a reason into a remark if intervals cover it; of a rival that is too far away, name the coefficients."""
    if "shifts" in one.data:
        names = () if _has_evidence(one) else _beyond(one, coefficients)
        return replace(one, quantities=names) if names else replace(one, severity="remark")
    of_innovations = one.code == "spectral_line" and one.data.get("innovations", False)
    return replace(one, severity="remark") if of_innovations or one.code in COVERED_BY_INTERVALS else one


def _with_rivals(one: Widening, rivals: Sequence[tuple[Array, Array, float]], stds: Array) -> Widening:
    """Widen an interval to cover 95 % of the mixture of all explanations; `stds` are those of the coefficients."""
    std, own = one.factor * one.std, one.quantity * stds
    if not std > 0.0:
        return one
    of_rivals = [
        (float(one.quantity @ off) / std, float(np.linalg.norm(own * widths) / np.linalg.norm(own)), chance)
        for off, widths, chance in rivals
    ]
    factor = mixture_factor(of_rivals)
    if factor <= 1.0:
        return one
    over, place = ("explanations", 0.0) if factor > one.factor else (one.over, one.place)
    return one._replace(factor=factor * one.factor, over=over, place=place, of_rivals=factor)


def widen_coefficients(scores: Sequence[PartScores], parameters: Sequence[Parameter], cov: Array) -> list[Widening]:
    """Compute the widening of the coefficients from scores; `cov` is that of the model, given what results share."""
    rows = zip(parameters, np.eye(len(parameters)), strict=True)
    return [_widening(scores, q.name, row, cov) for q, row in rows]


def _widening(scores: Sequence[PartScores], name: str, quantity: Array, cov: Array) -> Widening:
    """Return the larger of the widening over time and over frequencies."""
    n = len(quantity)
    found = Widening(name, quantity, float(np.sqrt(np.maximum(quantity @ cov[:n, :n] @ quantity, 0.0))))
    for one in scores:
        seen = one.dispersion(quantity)
        factor = 1.0 if seen is None else float(np.sqrt(expected_factor(seen)))
        if seen is not None and factor > found.factor:
            found = found._replace(factor=factor, over=one.over, place=seen.place)
    return found


def _in_whole(one: Widening, cov: Array) -> Widening:
    """Widening of the interval of a covariance that has more than the part that is widened."""
    n = len(one.quantity)
    share = one.std**2 / max(float(one.quantity @ cov[:n, :n] @ one.quantity), 1e-300)
    own, factor = (math.sqrt(1.0 + share * (f**2 - 1.0)) for f in (one.factor / one.of_rivals, one.factor))
    return one._replace(factor=factor, of_rivals=factor / own)


def scaled(outcome: Outcome, coefficients: Sequence[Widening]) -> tuple[Outcome, list[Widening], Array]:
    """Widen intervals given masses and aerodynamics, and leave regressions on tolerances as they are; the widening of
    the coefficients with all contributions, and the factors (n_θ,) on standard deviations given all tolerances."""
    whole = outcome.cov if outcome.joint_cov is None else outcome.joint_cov
    given, alone = (outcome.given(*groups)[1] for groups in (SHARED, get_args(Group)))
    n, factors = len(coefficients), np.ones(len(whole))
    ratios = np.diag(given)[:n] / np.maximum(np.diag(alone)[:n], 1e-300)
    factors[:n] = np.sqrt(1.0 + (np.square([one.factor for one in coefficients]) - 1.0) * ratios)
    wide = whole - alone + alone * np.outer(factors, factors)
    found = outcome._replace(cov=wide[:n, :n], joint_cov=None if outcome.joint_cov is None else wide)
    return found, [_in_whole(one, whole) for one in coefficients], factors[:n]


def judged(
    diagnosis: Diagnosis, scores: Sequence[PartScores], coefficients: Sequence[Widening],
    others: Sequence[Widening] = (),
) -> Diagnosis:  # fmt: skip
    """Turn reasons that wider intervals cover into remarks, and report the widening."""
    findings = []
    for one in diagnosis.findings:
        if one.severity == "reason" and _is_coverable(one, scores):
            one = _covered(one, coefficients)
        elif one.severity == "reason" and "shifts" in one.data:
            differing = _differing(_in_sigmas(one, coefficients))
            one = replace(one, quantities=tuple(dict.fromkeys((*one.quantities, *differing))))
        findings.append(one)
    names = {one.name for one in coefficients}
    return replace(diagnosis, findings=(*findings, *_reported(names, [*coefficients, *others])))


def _reported(names: Collection[str], widenings: Sequence[Widening]) -> Iterator[Finding]:
    """Findings on the widenings of coefficients with these names, and of others, by their cause."""
    by_cause: dict[tuple[bool, str], list[Widening]] = {}
    for one in sorted((one for one in widenings if one.factor > 1.0 + NEGLIGIBLE_SHARE), key=lambda one: -one.factor):
        by_cause.setdefault((one.is_usable, one.over), []).append(one)
    for (usable, over), some in sorted(by_cause.items(), key=lambda item: item[0][0]):
        data = {"names": [one.name for one in some], "factor": some[0].factor, "over": over, "at": some[0].place}
        own = tuple(one.name for one in some if one.name in names)
        yield Finding("wider_intervals", "remark" if usable else "reason", data | {"usable": usable}, own)


def grade_coefficients(
    diagnosis: Diagnosis, parameters: Sequence[Parameter], widenings: Sequence[Widening], channels: Sequence[str] = (),
    readers: Readers | None = None,
) -> list[str]:  # fmt: skip
    """Grade each coefficient of a result from these channels. Without `readers` all degrees of freedom are coupled, and
    every reason affects all coefficients."""
    touched = _touched(diagnosis, parameters, set(channels), readers)
    return [_grade(one, excluded=one.name in touched) for one in widenings]


def _grade(one: Widening, *, excluded: bool) -> str:
    return grade_of(min(one.factor, MAX_WIDENING), excluded=excluded or not one.is_usable)


def grade_modes(
    modes: Sequence[Mode], outcome: Outcome, coefficients: Sequence[str], widenings: Sequence[Sequence[Widening]]
) -> tuple[Mode, ...]:
    """Widen and grade modes. A frequency or damping ratio is C if it depends on a coefficient that is C, and has no
    grade if it depends on none."""
    bad = np.array([grade == "C" for grade in coefficients], dtype=bool)
    logarithmic = np.array([q.logarithmic for q in outcome.model.parameters], dtype=bool)
    unit, found = np.where(logarithmic, 1.0, np.abs(outcome.theta)), []
    for mode, *both in zip(modes, *widenings, strict=True):
        graded = []
        for one, (_, value) in zip(both, mode.quantities, strict=True):
            depends = np.abs(one.quantity) * unit > NEGLIGIBLE_SHARE * abs(value.estimate)
            grade = _grade(one, excluded=bool((bad & depends).any())) if one.std > 0.0 else ""
            wide = IntervalEstimate.normal(value.estimate, one.factor * value.std, value.unit)
            graded.append(replace(wide, grade=grade, reference=value.reference))
        found.append(Mode(mode.name, graded[0], graded[1]))
    return tuple(found)


def _touched(
    diagnosis: Diagnosis, parameters: Sequence[Parameter], channels: set[str], readers: Readers | None
) -> set[str]:
    """Coefficients that a reason affects; of wider intervals the factors are known."""
    reasons = [one for one in diagnosis.findings if one.severity == "reason" and one.code != "wider_intervals"]
    return set[str]().union(*(_touched_by(one, parameters, channels, readers) for one in reasons))


def _touched_by(
    reason: Finding, parameters: Sequence[Parameter], channels: set[str], readers: Readers | None
) -> set[str]:
    names = {q.name for q in parameters}
    if readers is None:
        return names
    if reason.quantities and names.issuperset(reason.quantities):
        return set(reason.quantities)
    if reason.channels and channels.issuperset(reason.channels):
        own = set(reason.channels)
        return {q.name for q in parameters if q.part not in readers or own.intersection(readers[q.part])}
    return names

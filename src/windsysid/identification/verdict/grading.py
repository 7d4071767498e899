"""How good each quantity of a result is: intervals as wide as the record wants them, and a grade for each.

A interval holds as the model says. B was widened, as parts of the record contradict each other
(`windsysid.checks.dispersion`). C is not to be used: a reason speaks against it that no interval holds. A reason
touches the coefficients that it names, or those whose readings it names, and the modes that depend on them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.dispersion import PartScores, expected_factor
from windsysid.checks.verdict import Diagnosis
from windsysid.identification.estimate.fitted.modal_residuals import channel_of
from windsysid.identification.estimate.fitted.modes import FittedModes
from windsysid.identification.limits import MAX_DISAGREEMENT_SIGMAS, MAX_WIDENING, NEGLIGIBLE_SHARE
from windsysid.identification.model.fit import Outcome
from windsysid.records.record import Record
from windsysid.results.finding import Finding
from windsysid.results.mode import Mode
from windsysid.results.posterior import SIGMAS
from windsysid.statespace.parameter import Parameter

__all__ = [
    "Widening",
    "grade_coefficients",
    "grade_modes",
    "judged",
    "readers_of",
    "scaled",
    "widen_coefficients",
    "widenings_of",
]

HELD_BY_INTERVALS = frozenset({
    "channel_level", "correlated_innovations", "correlated_loads", "heavy_tails", "innovation_level",
    "level_over_frequency", "nonstationary_level", "spectral_line", "unexplained_level", "unexplained_peak",
})  # fmt: skip
"""Setting: findings that say that innovations are not white, or that loads change. What that does to an interval is
known where scores over time and over frequencies are."""


class Widening(NamedTuple):
    """How much wider the interval of a quantity is.

    Attributes
    ----------
    name, quantity
        A coefficient, or a mode's frequency or damping ratio, and its derivatives to the coefficients (n_θ,).
    factor
        Its standard deviation over the one that the model says.
    over, place
        What contradicts: times, frequencies or explanations, and which [s] or [Hz]; empty where nothing does.
    """

    name: str
    quantity: Array
    factor: float = 1.0
    over: str = ""
    place: float = 0.0


def widenings_of(
    outcome: Outcome, at: FittedModes, findings: Sequence[Finding]
) -> tuple[list[Widening], list[list[Widening]]]:
    """Of the coefficients, and of frequencies and damping ratios of the modes: by what parts of the record contradict,
    and by how far rival explanations are, which findings tell."""
    scores, coefficients = outcome.scores, widen_coefficients(outcome.scores, outcome.model.parameters)
    modes = [
        [
            _widening(scores, f"{mode.name} {what}", row, given_masses=True)
            for mode, row in zip(at.modes, rows, strict=True)
        ]
        for what, rows in zip(("frequency", "damping ratio"), at.slopes, strict=True)
    ]
    rivals = _rivals(outcome, findings) if _is_known(scores) else []
    return (
        [_with_rivals(one, rivals, outcome.cov) for one in coefficients],
        [[_with_rivals(one, rivals, at.given_masses) for one in row] for row in modes],
    )


def _is_known(scores: Sequence[PartScores]) -> bool:
    """Whether scores tell what innovations that are not white, and loads that change, do to an interval."""
    return {"time", "frequency"} <= {one.over for one in scores}


def _rivals(outcome: Outcome, findings: Sequence[Finding]) -> list[tuple[Array, float]]:
    """By how much the coefficients are elsewhere under other explanations (n_θ,), and the chance of each."""
    stds, names = np.sqrt(np.diag(outcome.cov)), [q.name for q in outcome.model.parameters]
    told = [one.data for one in findings if one.severity == "reason" and "shifts" in one.data and not _beyond(one)]
    return [(stds * np.array([data["shifts"].get(name, 0.0) for name in names]), data["chance"]) for data in told]


def _beyond(one: Finding) -> tuple[str, ...]:
    """Coefficients that differ under a rival explanation which puts one so far away that no interval stands for both:
    where its chance is a few per cent, a slightly wrong prior or load model makes it the likelier one."""
    shifts: Mapping[str, float] = one.data["shifts"]
    far = any(abs(off) > SIGMAS * MAX_WIDENING for off in shifts.values())
    differ = [name for name, off in shifts.items() if far and abs(off) > MAX_DISAGREEMENT_SIGMAS]
    return tuple(sorted(differ, key=lambda name: -abs(shifts[name])))


def _held(one: Finding) -> Finding:
    """A reason as a remark where intervals hold it; of a rival that is too far away, the coefficients that differ."""
    if "shifts" in one.data:
        names = _beyond(one)
        return replace(one, quantities=names) if names else replace(one, severity="remark")
    return replace(one, severity="remark") if one.code in HELD_BY_INTERVALS else one


def _with_rivals(one: Widening, rivals: Sequence[tuple[Array, float]], cov: Array) -> Widening:
    """The same with an interval that holds as much of the mixture of all explanations."""
    n = len(one.quantity)
    std = one.factor * float(np.sqrt(one.quantity @ cov[:n, :n] @ one.quantity))
    factor = mixture_factor([(float(one.quantity @ off) / std, chance) for off, chance in rivals]) if std > 0.0 else 1.0
    if factor <= 1.0:
        return one
    over, place = ("explanations", 0.0) if factor > one.factor else (one.over, one.place)
    return one._replace(factor=factor * one.factor, over=over, place=place)


def mixture_factor(rivals: Sequence[tuple[float, float]]) -> float:
    """How many times ±2σ of the first explanation hold as much as ±2σ of a normal distribution, where others are shifts
    off, in σ, each with a chance.

    Examples
    --------
    >>> [round(mixture_factor([(shift, chance)]), 2) for shift, chance in ((3.0, 0.25), (6.0, 1.0), (23.0, 0.002))]
    [1.84, 3.85, 1.01]
    """
    from scipy.optimize import brentq
    from scipy.special import ndtr

    if not rivals:
        return 1.0
    shifts, chances = np.abs(np.array(rivals)).T
    shifts, chances = np.append(0.0, shifts), np.append(max(1.0 - chances.sum(), 0.0), chances)
    chances /= chances.sum()

    def beyond(half: float) -> float:
        return float(chances @ (ndtr(shifts - half) + ndtr(-shifts - half))) - 2.0 * float(ndtr(-SIGMAS))

    return max(1.0, float(brentq(beyond, 0.0, SIGMAS + 10.0 + shifts.max())) / SIGMAS)


def widen_coefficients(scores: Sequence[PartScores], parameters: Sequence[Parameter]) -> list[Widening]:
    """Of the first unknowns of scores."""
    rows = zip(parameters, np.eye(len(parameters)), strict=True)
    return [_widening(scores, q.name, row, given_masses=False) for q, row in rows]


def _widening(scores: Sequence[PartScores], name: str, quantity: Array, *, given_masses: bool) -> Widening:
    """The largest of times and of frequencies."""
    found = Widening(name, quantity)
    for one in scores:
        seen = one.dispersion(quantity, given_masses=given_masses)
        factor = 1.0 if seen is None else float(np.sqrt(expected_factor(seen)))
        if seen is not None and factor > found.factor:
            found = Widening(name, quantity, factor, one.over, seen.place)
    return found


def scaled(outcome: Outcome, coefficients: Sequence[Widening]) -> Outcome:
    """The same with wider intervals of the coefficients, as correlated as before."""
    factors = np.array([one.factor for one in coefficients])
    joint, n = outcome.joint_cov, len(factors)
    if joint is not None:
        both = np.concatenate([factors, np.ones(len(joint) - n)])
        joint = joint * np.outer(both, both)
    return outcome._replace(cov=outcome.cov * np.outer(factors, factors), joint_cov=joint)


def judged(
    diagnosis: Diagnosis,
    scores: Sequence[PartScores],
    coefficients: Sequence[Widening],
    others: Sequence[Widening] = (),
) -> Diagnosis:
    """What speaks against a result whose intervals are wider: what they hold is a remark."""
    findings = [_held(one) if one.severity == "reason" and _is_known(scores) else one for one in diagnosis.findings]
    names, widenings = {one.name for one in coefficients}, [*coefficients, *others]
    for severity, low, high in (("reason", MAX_WIDENING, np.inf), ("remark", 1.0 + NEGLIGIBLE_SHARE, MAX_WIDENING)):
        wide = sorted((one for one in widenings if low < one.factor <= high), key=lambda one: -one.factor)
        for over in dict.fromkeys(one.over for one in wide):
            some = [one for one in wide if one.over == over]
            data = {"names": [one.name for one in some], "factor": some[0].factor, "over": over, "at": some[0].place}
            own = tuple(one.name for one in some if one.name in names)
            findings.append(Finding("wider_intervals", severity, data, own))  # type: ignore[arg-type]
    return replace(diagnosis, findings=tuple(findings))


def grade_coefficients(
    diagnosis: Diagnosis, parameters: Sequence[Parameter], widenings: Sequence[Widening],
    readers: Mapping[str, str | None],
) -> list[str]:  # fmt: skip
    """A grade for each coefficient, of degrees of freedom that these channels read."""
    touched = _touched(diagnosis, parameters, readers)
    return [_letter(one, touched={one.name} & touched) for one in widenings]


def grade_modes(
    modes: Sequence[Mode], coefficients: Sequence[str], widenings: Sequence[Sequence[Widening]], cov: Array
) -> tuple[Mode, ...]:
    """Modes with wider intervals and grades, that of a frequency or damping ratio C where a coefficient is that
    contributes to its variance; of coefficients with these grades and a covariance (n_θ, n_θ)."""
    bad = np.array([grade == "C" for grade in coefficients], dtype=bool)
    found = []
    for mode, *both in zip(modes, *widenings, strict=True):
        letters, bands = [], []
        for one, (value, low, high) in zip(both, (mode.frequency_hz, mode.damping_ratio), strict=True):
            own = one.quantity**2 * np.diag(cov)
            letters.append(_letter(one, touched=bad & (own > NEGLIGIBLE_SHARE * own.sum())))
            bands.append((value, value - one.factor * (value - low), value + one.factor * (high - value)))
        found.append(mode._replace(frequency_hz=bands[0], damping_ratio=bands[1], grades=(letters[0], letters[1])))
    return tuple(found)


def _letter(one: Widening, touched: Sequence[bool] | set[str] | Array) -> str:
    if any(touched) or one.factor > MAX_WIDENING:
        return "C"
    return "B" if one.factor > 1.0 + NEGLIGIBLE_SHARE else "A"


def _touched(diagnosis: Diagnosis, parameters: Sequence[Parameter], readers: Mapping[str, str | None]) -> set[str]:
    """Coefficients that some reason concerns."""
    names, found = {q.name for q in parameters}, set[str]()
    for one in diagnosis.findings:
        if one.severity != "reason" or one.code == "wider_intervals":  # which factors tell
            continue
        if one.quantities and names.issuperset(one.quantities):
            found |= set(one.quantities)
        elif one.channels:
            found |= {q.name for q in parameters if readers.get(q.part) is None or readers[q.part] in one.channels}
        else:
            return names
    return found


def readers_of(outcome: Outcome, record: Record) -> dict[str, str | None]:
    """The channel that reads each degree of freedom alone; none where blades turn, which couple them all."""
    freedoms = outcome.turbine.model.freedoms
    if any(one.blade for one in freedoms):
        return {}
    return {one.name: channel_of(outcome, record, one.name) for one in freedoms}

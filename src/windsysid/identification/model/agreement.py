"""Agreement of two fits of one record."""

import math
from collections.abc import Mapping

from windsysid.checks.estimates import doubt_priors, hold_against_priors
from windsysid.checks.limits import MAX_DISAGREEMENT_SIGMAS, MIN_RIVAL_PROBABILITY
from windsysid.identification.model.fit import Outcome
from windsysid.results.finding import Finding
from windsysid.results.posterior import SIGMAS
from windsysid.results.tolerance import Group
from windsysid.turbine.turbine import Turbine

__all__ = ["compare", "disagreement", "shifts_to"]


def compare(one: Outcome, other: Outcome, factors: Mapping[str, float] | None = None) -> tuple[str, float]:
    """The parameter on which two results differ most, and by how many standard deviations, widened by factors."""
    return max(_in_sigmas(one, other, factors).items(), key=lambda each: each[1])


def _in_sigmas(one: Outcome, other: Outcome, factors: Mapping[str, float] | None) -> dict[str, float]:
    """Differences of the parameters in standard deviations, widened by factors."""
    wider = factors or {}
    return {name: sigmas / wider.get(name, 1.0) for name, (_, sigmas) in _differences(one, other).items()}


def shifts_to(other: Outcome, one: Outcome) -> dict[str, float]:
    """Shifts of the parameters from `one` result to another, in filter coordinates; those that are not finite are left
    out."""
    found = {name: shift for name, (shift, _) in _differences(one, other).items()}
    return {name: shift for name, shift in found.items() if math.isfinite(shift)}


def _differences(one: Outcome, other: Outcome) -> dict[str, tuple[float, float]]:
    """Differences of the parameters in filter coordinates, and their sizes in the larger of both standard deviations,
    with instruments and masses as the first has found them: both share them, and wide intervals would hide what loads
    do."""
    shared: tuple[Group, ...] = ("gain", "alignment", "clock", "masses", "aerodynamics")
    (theta, cov), (others, other_cov) = (found.given(*shared, as_in=one) for found in (one, other))
    names = [q.name for q in other.model.parameters]
    off = {}
    for i, q in enumerate(one.model.parameters):
        if q.name in names:
            j = names.index(q.name)
            shift = float(others[j] - theta[i])
            off[q.name] = shift, abs(shift) / math.sqrt(max(cov[i, i], other_cov[j, j]))
    return off


def disagreement(
    fit: Outcome, other: Outcome, turbine: Turbine, factors: Mapping[str, float] | None = None
) -> tuple[Finding, ...]:
    """That filters and spectra are too many standard deviations apart on a coefficient, and the likeliest cause.
    Factors are those by which parts of the record contradict filters. Where filters are the other fit, contradict the
    prior of a degree of freedom that this one does not, and are contradicted there by parts of the record, too, they
    are no evidence: by itself, the prior may be wrong."""
    parameters, wider = fit.model.parameters, {} if fit.turns else factors or {}
    wide = {q.part for q in parameters if wider.get(q.name, 1.0) > SIGMAS}
    lost = (_contradicting_priors(other) - _contradicting_priors(fit)) & wide
    known = [q.name for q in parameters if q.part not in lost]
    off = {name: sigmas for name, sigmas in _in_sigmas(fit, other, factors).items() if name in known}
    name = max(off, key=lambda name: off[name], default="")
    if off.get(name, 0.0) <= MAX_DISAGREEMENT_SIGMAS:
        return ()
    shifts = {one: shift for one, shift in shifts_to(other, fit).items() if one in known}
    move, seen = (any(freedom.blade for freedom in one.model.freedoms) for one in (turbine, fit.turbine))
    data = {"sigmas": off[name], "unseen_blades": move and not seen, "shifts": shifts, "chance": MIN_RIVAL_PROBABILITY}
    return (Finding("formulations_disagree", "reason", data, (name,)),)


def _contradicting_priors(found: Outcome) -> set[str]:
    """Degrees of freedom of which a coefficient conflicts with its prior."""
    parameters = found.model.parameters
    conflicts = {one.quantities[0] for one in doubt_priors(hold_against_priors(parameters, found.theta, found.cov))}
    return {q.part for q in parameters if q.name in conflicts}

"""Comparison of two records of one turbine: changes of coefficients, and the odds that they moved.

A result is the posterior N(θ̂, S⁻¹) of a record and its own prior N(θ₀, S₀⁻¹). What the record itself says is the
likelihood that is left when the prior is divided out, of information J = S − S₀ and vector h = S θ̂ − S₀ θ₀
(`own_information`). It does not depend on the prior, as far as the record is Gaussian in θ. Two records, A and B, with
a change δ = θ_B − θ_A between them and nothing else known of θ, leave of δ a likelihood of

    information  P = J_A (J_A + J_B)⁺ J_B,        vector  g = J_A (J_A + J_B)⁺ h_B − J_B (J_A + J_B)⁺ h_A.

Both are the same for (B, A), but for the sign of g. What one of the two does not see has no information in P. The odds
that a coefficient moved are those of Savage and Dickey: the prior density of δ = 0 over the posterior one, with priors
N(0, τ²) of changes of the size that damage makes (`TYPICAL_CHANGE`). The change itself is estimated with a prior
`VAGUE_PRIOR_FACTOR` times as wide.

Stiffness is compared in ln k. The likelihood of damping is Gaussian in c and not in ln c, and c may be hardly
distinguished from zero: damping is compared in c, and its change is the ratio c_B / c_A with the limits of Fieller's
theorem, which are exact for a ratio of Gaussian estimates. A limit may be nothing (−100 %) or infinite.

Sources: Dickey, Ann. Math. Statist. 42(1), 1971, https://doi.org/10.1214/aoms/1177693507; Verdinelli & Wasserman, J.
Am. Stat. Assoc. 90, 1995, https://doi.org/10.1080/01621459.1995.10476554; Fieller, J. R. Stat. Soc. B 16(2), 1954,
https://doi.org/10.1111/j.2517-6161.1954.tb00159.x.
"""

import math
from collections.abc import Sequence
from typing import cast

import numpy as np

from windsysid.errors import ConfigurationError
from windsysid.mechanics.compile import compile_model
from windsysid.modal.analysis import analyse, directions_of
from windsysid.monitoring.change import MAX_REPORTED_LOG_FACTOR, Comparison, QuantityChange
from windsysid.monitoring.modal_comparison import compare_modes
from windsysid.monitoring.modal_tracks import all_hold_modes
from windsysid.monitoring.own_information import (
    TYPICAL_CHANGE,
    Difference,
    common_frame,
    difference_between,
    estimate_of,
    without_prior,
)
from windsysid.results.coercion import PosteriorLike, as_posterior
from windsysid.results.posterior import SIGMAS, Posterior
from windsysid.results.tolerance import unknowns_of
from windsysid.spectral.oma.known_modes import ModesLike
from windsysid.statespace.parameter import Parameter
from windsysid.turbine.operation import MIN_RUNNING_SPEED_SHARE

__all__ = ["compare"]

VAGUE_PRIOR_FACTOR = 100.0
"""Factor on the prior of a change where its size is estimated."""


def compare(before: PosteriorLike | ModesLike, after: PosteriorLike | ModesLike) -> Comparison:
    """Compare two results of one turbine: which coefficients or modes changed, and by how much.

    Parameters
    ----------
    before, after : Identification, Posterior, OperationalModes, str or Path
        Two results of `windsysid.identify`, or two of `windsysid.oma`, or the folders they were saved in.

    Returns
    -------
    Comparison
        ``coefficients`` and ``modes``: changes [% of `before`] with their 95 % intervals, and the posterior odds that
        there is a change; ``doubts``: reasons not to trust the comparison.

    Raises
    ------
    ConfigurationError
        If the two have nothing in common, or a folder holds no result.

    See Also
    --------
    monitor : Drifts and jumps over many records.
    load_result : A result that was saved.

    Notes
    -----
    The odds are a Savage–Dickey ratio: the density of "no change" before and after the records were seen. Both results
    share the tolerances of instruments, masses and, both in operation, aerodynamics, which therefore do not widen the
    interval of a change.

    References
    ----------
    - Dickey, Ann. Math. Statist. 42(1), 1971, doi:10.1214/aoms/1177693507.
    - Verdinelli & Wasserman, J. Am. Stat. Assoc. 90, 1995, doi:10.1080/01621459.1995.10476554.

    Examples
    --------
    >>> import windsysid as ws
    >>> tower = ws.load_turbine("tower")
    >>> softer = tower.with_values({"k_side_side": 0.8 * tower.values["k_side_side"]})
    >>> records = [ws.simulate(one, duration=600.0, rate=5.0) for one in (tower, softer)]
    >>> before, after = (ws.identify(record, tower, formulation="spectral") for record in records)
    >>> print(ws.compare(before, after).coefficients[0])
    k_side_side fell by 19.9 % (95 % interval -21.1 … -18.7 %; odds >1000 : 1)
    """
    if all_hold_modes((before, after)):
        return compare_modes(cast("ModesLike", before), cast("ModesLike", after))
    return _compare_coefficients(*(as_posterior(cast("PosteriorLike", one)) for one in (before, after)))


def _compare_coefficients(before: Posterior, after: Posterior) -> Comparison:
    """Comparison of two results of `identify`."""
    before, after, frame, notes = _in_states(before, after)
    if not frame:
        raise ConfigurationError(
            f"{before.record} and {after.record}: expected coefficients that both identified, got "
            f"{', '.join(q.name for q in before.parameters)} and {', '.join(q.name for q in after.parameters)}"
        )
    difference = difference_between(before, after, frame)
    coefficients = _changes(before, after, frame, difference)
    levels = _frame_of_statistics(before, after)
    both = (*frame, *levels)
    statistics = _changes(before, after, both, difference_between(before, after, both))[len(frame) :] if levels else ()
    same, shared = _shared_data(before, after)
    doubts = [*_distrusted(before, after, frame), *_differing_models(before, after)]
    moved = [change.name for change in coefficients if change.moved]
    if same and moved:
        same = None not in (before.record_hash, after.record_hash)
        doubts.append(
            f"both results are of {before.record}{', the same values' if same else ': if that is one record'}, so"
            " there is no change, and priors, sensors or loads of the two identifications do not agree about"
            f" {', '.join(moved)}"
        )
    return Comparison(
        (before.record, after.record), coefficients, _modes(before, after, frame, difference), statistics, same,
        tuple(doubts), (*notes, *shared),
    )  # fmt: skip


def _in_states(before: Posterior, after: Posterior) -> tuple[Posterior, Posterior, Sequence[Parameter], Sequence[str]]:
    """Both results and what they have in common; of a parked and an operating tower not the air, with a note."""
    frame, turbines = common_frame(before, after), (before.turbine, after.turbine)
    slow, fast = sorted(one.rotor_speed for one in turbines)
    operating = {one.aerodynamic_tolerance > 0.0 or bool(one.states) for one in turbines}  # a parked one has neither
    if len(operating) == 1 or slow > MIN_RUNNING_SPEED_SHARE * fast:
        return before, after, frame, ()
    structural = tuple(q for q in frame if before.turbine.model.coefficient(q.name).kind != "damping")
    note = "only one of the two results is of an operating rotor, whose air damps: windsysid damping compares damping"
    return _with_unshared_air(before), _with_unshared_air(after), structural, (note,)


def _with_unshared_air(result: Posterior) -> Posterior:
    """The result with aerodynamics as a part of its covariance."""
    apart = [one.group == "aerodynamics" for one in result.tolerances]
    if result.joint_cov is None or not any(apart):
        return result
    at = unknowns_of(result.parameters, result.statistics, result.tolerances).places("tolerances", "clocks")[apart]
    left = np.setdiff1d(np.arange(len(result.joint_cov)), at)
    tolerances = tuple(one for one in result.tolerances if one.group != "aerodynamics")
    return result._replace(joint_cov=result.joint_cov[np.ix_(left, left)], tolerances=tolerances)


def _distrusted(before: Posterior, after: Posterior, frame: Sequence[Parameter]) -> list[str]:
    """Coefficients of a frame that are not to be used of a result."""
    doubts = list[str]()
    for result in (before, after):
        bad = [q.name for q in frame if q.name in result.unusable]
        if bad and len(bad) < len(frame):
            doubts.append(f"{', '.join(bad)} of {result.record} (grade C): see its report; the others may be compared")
        elif bad:
            doubts.append(f"findings speak against the result of {result.record}: see its report")
    return doubts


def _frame_of_statistics(before: Posterior, after: Posterior) -> tuple[Parameter, ...]:
    """Changes of the statistics that both learned; those of loads only if both used one load model."""
    given = [{s.name: s for s in result.statistics} for result in (before, after)]
    loads = [{s.name for s in of.values() if s.kind != "noise"} for of in given]
    return tuple(
        Parameter(
            name,
            math.sqrt(s.estimate * given[1][name].estimate),
            TYPICAL_CHANGE["noise" if s.kind == "noise" else "load"],
        )
        for name, s in given[0].items()
        if name in given[1] and (loads[0] == loads[1] or s.kind == "noise")
    )


def _changes(
    before: Posterior, after: Posterior, frame: Sequence[Parameter], difference: Difference
) -> tuple[QuantityChange, ...]:
    """Changes of the quantities in `frame`."""
    delta, cov = difference.with_prior(VAGUE_PRIOR_FACTOR)
    of_damage, cov_of_damage = difference.with_prior(1.0)
    said = [without_prior(result, frame) for result in (before, after)]
    units = {s.name: s.unit for s in before.statistics}
    known = {c.name: c for c in before.turbine.model.parameters}
    changes = []
    for i, q in enumerate(frame):
        sigma, post = math.sqrt(cov[i, i]), cov_of_damage[i, i]
        if q.logarithmic:
            limits = _growth(delta[i], sigma)
        else:
            limits = _ratio(*((float(mean[i]), math.sqrt(c[i, i])) for mean, c in said))
        log_odds = float(0.5 * math.log(post / q.prior[1] ** 2) + 0.5 * of_damage[i] ** 2 / post)
        chance = math.erfc(abs(delta[i]) / sigma / math.sqrt(2.0))
        unit, kind = (units[q.name], "") if q.name in units else (known[q.name].unit, known[q.name].kind)
        a, b = (estimate_of(result, q.name) for result in (before, after))
        changes.append(QuantityChange(q.name, unit, a, b, *limits, log_odds, chance, kind))
    return tuple(changes)


def _growth(step: float, sigma: float) -> tuple[float, float, float]:
    """A change of a logarithm and its 95 % interval [%]."""
    if SIGMAS * sigma > MAX_REPORTED_LOG_FACTOR:
        return math.nan, -100.0, math.inf
    percent, low, high = (100.0 * math.expm1(step + k * sigma) for k in (0.0, -SIGMAS, SIGMAS))
    return percent, low, high


def _ratio(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float, float]:
    """Change from a to b and the ±2σ limits of their ratio by Fieller's theorem [%].

    a and b are (estimate, standard deviation); a negative limit counts as zero.
    """
    backwards, high = _highest_ratio(b, a), _highest_ratio(a, b)
    low = 1.0 / backwards if backwards else math.inf
    if low == 0.0 and math.isinf(high):
        return math.nan, -100.0, math.inf
    middle = max(b[0], 0.0) / a[0] if a[0] > 0.0 else math.inf
    return 100.0 * (middle - 1.0), 100.0 * (low - 1.0), 100.0 * (high - 1.0)


def _highest_ratio(a: tuple[float, float], b: tuple[float, float]) -> float:
    """The greatest ρ ≥ 0 for which b − ρ a is within ±2σ of zero; infinite where a may be nothing."""
    below = a[0] ** 2 - (SIGMAS * a[1]) ** 2
    if a[0] <= 0.0 or below <= 0.0:
        return math.inf
    root = (a[0] * b[0]) ** 2 - below * (b[0] ** 2 - (SIGMAS * b[1]) ** 2)
    return max(a[0] * b[0] + math.sqrt(max(root, 0.0)), 0.0) / below


def _modes(
    before: Posterior, after: Posterior, frame: Sequence[Parameter], difference: Difference
) -> tuple[QuantityChange, ...]:
    """Changes of the modes' frequencies at the mean of the two rotor speeds.

    They are the coefficients' changes times d ln f / dθ, averaged over both results.
    """
    speed = 0.5 * (before.turbine.rotor_speed + after.turbine.rotor_speed)
    delta, cov = difference.with_prior(VAGUE_PRIOR_FACTOR)
    found = []
    for result in (before, after):
        turbine = result.turbine
        compiled = compile_model(turbine.model)
        p = np.array([turbine.values[name] for name in compiled.parameters])
        theta = np.array([q.coordinate(turbine.values[q.name]) for q in frame])
        along = directions_of(compiled, frame, theta)
        try:
            spectrum = analyse(turbine.model, compiled, p, speed, along, method="Coleman")
        except ConfigurationError:  # two blades without a periodic motion
            return ()
        f, slopes = spectrum.frequency, spectrum.frequency_and_damping_slopes()[0]
        found.append({name: (float(f[m]), slopes[m] / f[m]) for m, name in enumerate(spectrum.names)})
    changes = []
    for name in (name for name in found[0] if name in found[1]):
        (f_a, slope_a), (f_b, slope_b) = found[0][name], found[1][name]
        slope = 0.5 * (slope_a + slope_b)
        step, sigma = float(slope @ delta), math.sqrt(float(slope @ cov @ slope))
        chance = math.erfc(abs(step) / sigma / math.sqrt(2.0)) if sigma > 0.0 else 1.0
        changes.append(QuantityChange(name, "Hz", f_a, f_b, *_growth(step, sigma), math.nan, chance))
    return tuple(changes)


def _shared_data(before: Posterior, after: Posterior) -> tuple[bool, tuple[str, ...]]:
    """Test whether both results are of one record and section, with a note if sections of one record overlap.

    The hashes of the records tell; their names do where an older version wrote no hash.
    """
    name = before.record.rpartition(", ")[0]
    if None not in (before.record_hash, after.record_hash):
        one_record = before.record_hash == after.record_hash
        same = one_record and before.section == after.section
    else:
        one_record = bool(name) and name == after.record.rpartition(", ")[0]
        same = before.record == after.record
    if same or not one_record or before.section is None or after.section is None:
        return same, ()
    common = min(before.section[1], after.section[1]) - max(before.section[0], after.section[0])
    if common <= 0.0:
        return False, ()
    note = (
        f"the two sections of {name or before.record} have {common:.4g} s in common: intervals and odds take them"
        " as independent, which favours no change"
    )
    return False, (note,)


def _differing_models(before: Posterior, after: Posterior) -> list[str]:
    """One sentence for each difference between the assumptions, or the coefficients, of the two turbines."""
    a, b = ([q.name for q in result.parameters] for result in (before, after))
    fixed = [name for name in _differing_values(before, after) if name not in (*a, *b)]
    told = []
    if fixed:
        told.append(
            f"the turbine files of the two results differ in {_list_some(fixed)}: the change may be that of the"
            " files; identify both with one file"
        )
    alone = [name for name in (*a, *b) if (name in a) != (name in b)]
    if alone:
        told.append(
            f"only one of the two results identified {_list_some(alone)}: the value that the other assumed"
            " counts as change"
        )
    return told


def _differing_values(before: Posterior, after: Posterior) -> list[str]:
    a, b = before.turbine.values, after.turbine.values
    return [name for name in a if name in b and not math.isclose(a[name], b[name], rel_tol=1e-9)]


def _list_some(names: Sequence[str]) -> str:
    """Up to four names, and how many more there are."""
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")

"""What moved between two records of one turbine, and how sure that is.

A result is the posterior N(θ̂, S⁻¹) of a record and its own prior N(θ₀, S₀⁻¹). What the record itself says is the likelihood that is left when the prior is
divided out, of information J = S − S₀ and vector h = S θ̂ − S₀ θ₀ (`own_information`). It does not depend on the prior, as far as the record is Gaussian in θ. Two
records, A and B, with a change δ = θ_B − θ_A between them and nothing else known of θ, leave of δ a likelihood of

    information  P = J_A (J_A + J_B)⁺ J_B,        vector  g = J_A (J_A + J_B)⁺ h_B − J_B (J_A + J_B)⁺ h_A.

Both are the same for (B, A), but for the sign of g. What one of the two does not see has no information in P. The odds that a coefficient moved are those of Savage and Dickey: the
prior density of δ = 0 over the posterior one, with priors N(0, τ²) of changes of the size that damage makes (`TYPICAL`). The change itself is told with a
prior `VAGUE` times as wide.

Stiffness is compared in ln k. The likelihood of damping is Gaussian in c and not in ln c, and c may be hardly told from zero: damping is compared in c, and its change
is the ratio c_B / c_A with the limits of Fieller's theorem, which are exact for a ratio of Gaussian estimates. A limit may be nothing (−100 %) or infinite.

Sources: Dickey, Ann. Math. Statist. 42(1), 1971, https://doi.org/10.1214/aoms/1177693507; Verdinelli & Wasserman, J. Am. Stat. Assoc. 90, 1995,
https://doi.org/10.1080/01621459.1995.10476554; Fieller, J. R. Stat. Soc. B 16(2), 1954, https://doi.org/10.1111/j.2517-6161.1954.tb00159.x.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.coercion import PosteriorLike, as_posterior
from windsysid.errors import ConfigurationError
from windsysid.mechanics.compile import compile_model
from windsysid.modal import analyse, directions_of
from windsysid.output import Saveable
from windsysid.result import SIGMAS, Posterior, finite
from windsysid.statespace import Parameter
from windsysid.statistics import to_logarithms
from windsysid.units import parameter_unit, unit_text

__all__ = ["HEADINGS", "MOVED", "TYPICAL", "Change", "Comparison", "compare", "own_information", "without_prior"]

Array = NDArray[np.float64]

TYPICAL = {"k": 0.1, "c": 0.5, "load": 0.5, "noise": 0.5}
"""Prior standard deviation of a change, relative: of stiffness (and anything else), damping, statistics of loads and of noise."""

VAGUE = 100.0
"""How many times wider the prior of a change is where its size is estimated."""

FAINT = 1e-6
"""Share of the prior's information that is left where it is taken out."""

UNSEEN = 1e-9
"""A record says nothing of a direction in which it narrows the prior's variance by less than this share: that is rounding."""

UNTOLD = math.log(10.0)
"""A change is not told where its band (±2σ) reaches further than this factor either way."""

MOVED = 100.0
"""Odds from which a coefficient is said to have moved."""

SUSPECT = 10.0
"""Odds from which it is said that it may have."""


class Change(NamedTuple):
    """How a quantity of record B differs from that of record A.

    Attributes
    ----------
    name, unit
        Of a coefficient, a mode's frequency, or a statistic of loads or noise.
    before, after
        Estimates of the two results, priors included, in SI, Hz for a frequency.
    percent, low, high
        By how much B is above A [% of A] according to the records without the priors, and the ±2σ band. `low` is −100 where B may be nothing, `high` infinite where
        A may be. `percent` is NaN where both are so, or where the
        band of a logarithm reaches further than a factor of ten either way: the change is not told.
    log_odds
        Natural logarithm of the odds that it moved; NaN for a mode, which moves if a coefficient does.
    chance
        Probability of a difference this large, or larger, without a change.
    """

    name: str
    unit: str
    before: float
    after: float
    percent: float
    low: float
    high: float
    log_odds: float
    chance: float

    @property
    def moved(self) -> bool:
        """Whether the odds are beyond `MOVED`."""
        return self.log_odds > math.log(MOVED)

    @property
    def suspect(self) -> bool:
        """Whether the odds are beyond `SUSPECT`."""
        return self.log_odds > math.log(SUSPECT)

    @property
    def told(self) -> bool:
        """Whether the records bound the change on one side at least."""
        return not math.isnan(self.percent)

    def __str__(self) -> str:
        """How far it moved, and at which odds."""
        if not self.told:
            how = f"moved by an amount that is not told (odds {_odds(self.log_odds)})"
        elif math.isinf(self.percent):
            how = f"rose from about zero (odds {_odds(self.log_odds)})"
        else:
            verb = "rose" if self.percent > 0.0 else "fell"
            how = f"{verb} by {abs(self.percent):.3g} % (±2σ: {_band(self)}; odds {_odds(self.log_odds)})"
        return f"{self.name} {how}"


@dataclass(frozen=True)
class Comparison(Saveable):
    """What moved between record A and record B.

    Attributes
    ----------
    records
        Names of the two.
    coefficients, modes, statistics
        Changes of the coefficients that both identified, of the frequencies of the modes that both have, at the mean of the two rotor speeds, and of the
        statistics of loads and noise that both learned.
    same
        Whether both are results of one record and section, so that nothing can have moved.
    doubts
        Why the comparison itself is not to be trusted, in sentences.
    notes
        What else a reader must know.
    """

    records: tuple[str, str]
    coefficients: tuple[Change, ...]
    modes: tuple[Change, ...]
    statistics: tuple[Change, ...]
    same: bool
    doubts: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def moved(self) -> tuple[Change, ...]:
        """The coefficients that moved, the surest first."""
        ranked = sorted(self.coefficients, key=lambda change: -change.log_odds)
        return () if self.same else tuple(change for change in ranked if change.moved)

    @property
    def sentence(self) -> str:
        """The answer."""
        if self.same:
            return f"nothing moved: both results are of the same record and section ({self.records[0]}), and one record cannot differ from itself"
        ranked = sorted(self.coefficients, key=lambda change: -change.log_odds)
        suspects = [str(change) for change in ranked if change.suspect and not change.moved]
        if self.moved:
            told = [f"moved: {', '.join(map(str, self.moved))}"]
        else:
            told = [f"nothing moved: no coefficient reaches odds of {MOVED:g} : 1"]
        if suspects:
            told.append(f"may have moved: {', '.join(suspects)}")
        if not self.moved:
            told += self._unseen()
        other = [change.name for change in self.statistics if change.moved]
        if other:
            told.append(f"loads and noise differ in {', '.join(other)}")
        return "; ".join(told)

    def _unseen(self) -> list[str]:
        """What could have moved and not been seen, in words: a change is found from about four σ on."""
        told, dark = [], []
        for kind, what in (("k_", "stiffness"), ("c_", "damping")):
            steps = {c.name: 2.0 * _half_width(c) for c in self.coefficients if c.name.startswith(kind)}
            dark += [name for name, step in steps.items() if step > UNTOLD]
            greatest = max((step for step in steps.values() if step <= UNTOLD), default=None)
            if greatest is not None:
                size = (
                    f"{100.0 * math.expm1(greatest):.2g} %"
                    if greatest < math.log(2.0)
                    else f"a factor of {math.exp(greatest):.2g}"
                )
                told.append(f"a change of {what} by less than {size} could go unseen")
        return told + ([f"the records say too little of {', '.join(dark)} to show a change"] if dark else [])

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """As a table under `HEADINGS`."""
        return [
            (
                change.name, unit_text(change.unit), f"{change.before:.5g}", f"{change.after:.5g}",
                f"{_percent(change.percent)} %" if change.told else "not told", _band(change),
                "" if math.isnan(change.log_odds) else _odds(change.log_odds), f"{change.chance:.2g}",
            )
            for change in (*self.coefficients, *self.modes, *self.statistics)
        ]  # fmt: skip

    def summary(self) -> dict[str, Any]:
        """Plain values, for ``summary.json``; what is not told or not bounded is None."""
        return {
            "records": list(self.records),
            "sentence": self.sentence,
            "same_record": self.same,
            "moved": [c.name for c in self.moved],
            "coefficients": {c.name: finite(c._asdict()) for c in self.coefficients},
            "modes": {c.name: finite(c._asdict()) for c in self.modes},
            "statistics": {c.name: finite(c._asdict()) for c in self.statistics},
            "doubts": list(self.doubts),
            "notes": list(self.notes),
        }

    def files(self) -> dict[str, bytes]:
        """What `save` writes: ``report.html``, ``changes.png`` and ``summary.json``."""
        from windsysid.comparisonreport import comparison_files

        return comparison_files(self)

    def to_json(self) -> str:
        """`summary` as text."""
        return json.dumps(self.summary(), indent=2) + "\n"

    def __repr__(self) -> str:
        return f"<Comparison of {self.records[0]} and {self.records[1]}: {self.sentence}>"

    def __str__(self) -> str:
        """The answer, the table, the doubts."""
        from rich.table import Table

        from windsysid.console import render

        table = Table(title=f"{self.records[0]} (A) → {self.records[1]} (B)", title_justify="left")
        for i, heading in enumerate(HEADINGS):
            table.add_column(heading, justify="left" if i < 2 else "right")
        for row in self.rows:
            table.add_row(*row)
        return render(table, self.sentence, *(f"not to be trusted: {doubt}" for doubt in self.doubts), *self.notes)


HEADINGS = ("", "unit", "A", "B", "change", "±2σ band", "odds of a move", "by chance")


def compare(before: PosteriorLike, after: PosteriorLike) -> Comparison:
    """What moved from one record of a turbine to another; the other way round it is the same change backwards.

    Both are posteriors, results, or the folders that results were saved in.

    Raises
    ------
    ConfigurationError
        If the two have no coefficient in common.
    """
    before, after = as_posterior(before), as_posterior(after)
    frame = _frame(before, after)
    if not frame:
        raise ConfigurationError(
            f"{before.record} and {after.record}: expected coefficients that both identified, got "
            f"{', '.join(q.name for q in before.parameters)} and {', '.join(q.name for q in after.parameters)}"
        )
    difference = _difference(before, after, frame)
    coefficients = _changes(before, after, frame, difference)
    levels = _frame_of_statistics(before, after)
    both = (*frame, *levels)
    statistics = _changes(before, after, both, _difference(before, after, both))[len(frame) :] if levels else ()
    same, notes = _shared_data(before, after)
    doubts = [
        f"the result of {result.record} is not trusted by itself: see its report"
        for result in (before, after)
        if not result.trusted
    ]
    doubts += _differing_models(before, after)
    moved = [change.name for change in coefficients if change.moved]
    if same and moved:
        sure = _hashed(before, after)
        same = sure
        doubts.append(
            f"both results are of {before.record}{', the same values' if sure else ': if that is one record'}, so nothing moved, and priors, sensors or loads of "
            f"the two identifications do not agree about {', '.join(moved)}"
        )
    return Comparison(
        (before.record, after.record), coefficients, _modes(before, after, frame, difference), statistics, same,
        tuple(doubts), notes,
    )  # fmt: skip


def own_information(result: Posterior, frame: Sequence[Parameter]) -> tuple[Array, Array]:
    """What a record itself says: the result's posterior with its prior divided out.

    A stiffness that is linear in the result and logarithmic in `frame`, or the other way round, is taken along its tangent at the estimate.

    Parameters
    ----------
    result
        Of the record.
    frame
        The n coefficients or learned statistics that are asked for, in the coordinates that are wanted; all must be in `result`. Their priors do not matter.

    Returns
    -------
    tuple
        Information (n, n), positive semidefinite, and vector (n,): the logarithm of the likelihood is −½ θᵀ J θ + hᵀ θ + const.
    """
    known = _Belief.of(result)
    at = [known.names.index(q.name) for q in frame]
    stretch, mean = np.empty(len(frame)), np.empty(len(frame))
    for i, q in enumerate(frame):
        own = known.parameters[at[i]]
        value = float(own.physical(known.mean[at[i]]))
        stretch[i] = (value if own.logarithmic else own.scale) / (value if q.logarithmic else q.scale)
        mean[i] = q.coordinate(value)
    prior_mean = mean + stretch * (known.prior_mean[at] - known.mean[at])
    cov, prior_cov = (c[np.ix_(at, at)] * np.outer(stretch, stretch) for c in (known.cov, known.prior_cov))
    # In the prior's own measure the information is 1/share − 1 along each axis, with no small difference of large numbers.
    measure = np.linalg.inv(np.linalg.cholesky(prior_cov))
    share, axes = np.linalg.eigh(measure @ cov @ measure.T)
    seen = share < 1.0 - UNSEEN
    rows, share = axes[:, seen].T @ measure, share[seen]
    information = (rows.T * (1.0 / share - 1.0)) @ rows
    vector = rows.T @ (rows @ (mean - prior_mean) / share) + information @ prior_mean
    return information, np.asarray(vector, dtype=np.float64)


def without_prior(result: Posterior, frame: Sequence[Parameter]) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of the coefficients of `frame` by what the record itself says, in its coordinates.

    A millionth of the information of `frame`'s own priors keeps finite what the record does not see.
    """
    information, vector = own_information(result, frame)
    centre, spread = np.array([q.prior for q in frame]).T
    mean, cov = _settled(information * np.outer(spread, spread), vector * spread + FAINT * centre / spread, FAINT)
    return mean * spread, cov * np.outer(spread, spread)


class _Belief(NamedTuple):
    """All that a result knows: coefficients in filter coordinates, then statistics as ln(value / given), with the prior."""

    parameters: tuple[Parameter, ...]
    mean: Array
    cov: Array
    prior_mean: Array
    prior_cov: Array

    @classmethod
    def of(cls, result: Posterior) -> "_Belief":
        priors = np.array([q.prior for q in result.parameters])
        if result.joint_cov is None:
            return cls(result.parameters, result.theta, result.cov, priors[:, 0], np.diag(priors[:, 1] ** 2))
        n, learned = len(result.parameters), result.statistics
        turn = np.eye(n + len(learned))
        turn[n:, n:] = to_logarithms(learned)
        spread = np.concatenate([priors[:, 1], [s.spread for s in learned]])
        return cls(
            (*result.parameters, *(Parameter(s.name, s.given, s.spread) for s in learned)),
            np.concatenate([result.theta, [math.log(s.estimate / s.given) for s in learned]]),
            turn @ result.joint_cov @ turn.T,
            np.concatenate([priors[:, 0], np.zeros(len(learned))]),
            (turn * spread**2) @ turn.T,
        )

    @property
    def names(self) -> list[str]:
        return [q.name for q in self.parameters]


def _frame(before: Posterior, after: Posterior) -> tuple[Parameter, ...]:
    """Coordinates for the coefficients that both identified, the same for (A, B) and (B, A); their priors are as wide as changes by damage."""
    found = []
    for q in before.parameters:
        other = next((r for r in after.parameters if r.name == q.name), None)
        if other is None:
            continue
        a, b = _value(before, q.name), _value(after, q.name)
        typical = TYPICAL.get(q.name.partition("_")[0], TYPICAL["k"])
        if (q.logarithmic or other.logarithmic) and min(a, b) > 0.0:
            found.append(Parameter(q.name, math.sqrt(a * b), typical))
            continue
        # What the prior expects to be about zero has no size of its own.
        free = q.centre == 0.0 == other.centre
        size = (0.0 if free else 0.5 * (abs(a) + abs(b))) or math.sqrt(q.spread * other.spread)
        found.append(Parameter(q.name, 0.5 * (a + b), typical * size, False, size))
    return tuple(found)


def _frame_of_statistics(before: Posterior, after: Posterior) -> tuple[Parameter, ...]:
    """The same for the statistics that both learned; those of loads only where both took the loads for the same."""
    given = [{s.name: s for s in result.statistics} for result in (before, after)]
    loads = [{name for name in of if name.startswith("load_")} for of in given]
    return tuple(
        Parameter(name, math.sqrt(s.estimate * given[1][name].estimate), TYPICAL[name.partition("_")[0]])
        for name, s in given[0].items()
        if name in given[1] and (loads[0] == loads[1] or name.startswith("noise_"))
    )


class _Difference(NamedTuple):
    """What two records say of the change, in standard deviations of its prior: the eigenvalues (n,) and axes (n, n) of P, the vector g (n,)."""

    information: Array
    vector: Array
    spread: Array

    def with_prior(self, width: float) -> tuple[Array, Array]:
        """Mean (n,) and covariance (n, n) in the frame's coordinates, under a prior so many times wider than that of damage."""
        mean, cov = _settled(self.information, self.vector, width**-2.0)
        return mean * self.spread, cov * np.outer(self.spread, self.spread)


def _difference(before: Posterior, after: Posterior, frame: Sequence[Parameter]) -> _Difference:
    """The likelihood of the change in the coordinates of `frame`."""
    spread = np.array([q.prior[1] for q in frame])
    (a, h_a), (b, h_b) = (own_information(result, frame) for result in (before, after))
    a, b, h_a, h_b = a * np.outer(spread, spread), b * np.outer(spread, spread), h_a * spread, h_b * spread
    values, axes = np.linalg.eigh(a + b)
    seen = values > FAINT
    pooled = (axes[:, seen] / values[seen]) @ axes[:, seen].T
    shared = a @ pooled @ b
    return _Difference(0.5 * (shared + shared.T), a @ (pooled @ h_b) - b @ (pooled @ h_a), spread)


def _settled(information: Array, vector: Array, prior: float) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of an information and a vector with a prior of information `prior` in every direction."""
    values, axes = np.linalg.eigh(information)
    cov = (axes / (values.clip(0.0) + prior)) @ axes.T
    return cov @ vector, cov


def _changes(
    before: Posterior, after: Posterior, frame: Sequence[Parameter], difference: _Difference
) -> tuple[Change, ...]:
    """The changes of what is in `frame`."""
    delta, cov = difference.with_prior(VAGUE)
    of_damage, cov_of_damage = difference.with_prior(1.0)
    said = [without_prior(result, frame) for result in (before, after)]
    units = {s.name: s.unit for s in before.statistics}
    changes = []
    for i, q in enumerate(frame):
        sigma, post = math.sqrt(cov[i, i]), cov_of_damage[i, i]
        if q.logarithmic:
            limits = _growth(delta[i], sigma)
        else:
            limits = _ratio(*((float(mean[i]), math.sqrt(c[i, i])) for mean, c in said))
        log_odds = float(0.5 * math.log(post / q.prior[1] ** 2) + 0.5 * of_damage[i] ** 2 / post)
        chance = math.erfc(abs(delta[i]) / sigma / math.sqrt(2.0))
        unit = units[q.name] if q.name in units else parameter_unit(q.name)
        a, b = (_value(result, q.name) for result in (before, after))
        changes.append(Change(q.name, unit, a, b, *limits, log_odds, chance))
    return tuple(changes)


def _growth(step: float, sigma: float) -> tuple[float, float, float]:
    """A change of a logarithm and its ±2σ band [%]."""
    if SIGMAS * sigma > UNTOLD:
        return math.nan, -100.0, math.inf
    percent, low, high = (100.0 * math.expm1(step + k * sigma) for k in (0.0, -SIGMAS, SIGMAS))
    return percent, low, high


def _ratio(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float, float]:
    """Change from a to b, each an estimate and its standard deviation, and the ±2σ limits of their ratio by Fieller's theorem [%]; what is negative counts as nothing."""
    low, high = _inverse(_highest_ratio(b, a)), _highest_ratio(a, b)
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


def _inverse(ratio: float) -> float:
    return math.inf if ratio == 0.0 else 1.0 / ratio


def _modes(
    before: Posterior, after: Posterior, frame: Sequence[Parameter], difference: _Difference
) -> tuple[Change, ...]:
    """Changes of the modes' frequencies at the mean of the two rotor speeds: those of the coefficients, times d ln f / dθ averaged over both results."""
    speed = 0.5 * (before.turbine.rotor_speed + after.turbine.rotor_speed)
    delta, cov = difference.with_prior(VAGUE)
    found = []
    for result in (before, after):
        turbine = result.turbine
        compiled = compile_model(turbine.model)
        p = np.array([turbine.values[name] for name in compiled.parameters])
        theta = np.array([q.coordinate(turbine.values[q.name]) for q in frame])
        try:
            spectrum = analyse(
                turbine.model, compiled, p, speed, directions_of(compiled, frame, theta), method="Coleman"
            )
        except ConfigurationError:  # two blades without a periodic motion
            return ()
        f = spectrum.frequency
        slopes = spectrum.frequency_and_damping_slopes()[0] / f[:, None]
        found.append({name: (float(f[m]), slopes[m]) for m, name in enumerate(spectrum.names)})
    changes = []
    for name in (name for name in found[0] if name in found[1]):
        (f_a, slope_a), (f_b, slope_b) = found[0][name], found[1][name]
        slope = 0.5 * (slope_a + slope_b)
        step, sigma = float(slope @ delta), math.sqrt(float(slope @ cov @ slope))
        chance = math.erfc(abs(step) / sigma / math.sqrt(2.0)) if sigma > 0.0 else 1.0
        changes.append(Change(name, "Hz", f_a, f_b, *_growth(step, sigma), math.nan, chance))
    return tuple(changes)


def _hashed(before: Posterior, after: Posterior) -> bool:
    """Whether both results say which values they were identified from."""
    return before.record_hash is not None and after.record_hash is not None


def _shared_data(before: Posterior, after: Posterior) -> tuple[bool, tuple[str, ...]]:
    """Whether both results are of one record and section, and what to say where sections of one record overlap.

    The hashes of the records tell; their names do where an older version wrote no hash.
    """
    names = [result.record.rpartition(", ")[0] for result in (before, after)]
    if _hashed(before, after):
        if before.record_hash != after.record_hash:
            return False, ()
        if before.section == after.section:
            return True, ()
    elif before.record == after.record:
        return True, ()
    elif names[0] != names[1] or not names[0]:
        return False, ()
    if before.section is None or after.section is None:
        return False, ()
    common = min(before.section[1], after.section[1]) - max(before.section[0], after.section[0])
    if common <= 0.0:
        return False, ()
    return False, (
        f"the two sections of {names[0] or before.record} have {common:.4g} s in common: bands and odds take them for independent, which errs towards no change",
    )


def _differing_models(before: Posterior, after: Posterior) -> list[str]:
    """What the two turbines take for known and do not agree about, and what only one of them identified, a sentence each."""
    identified = [{q.name for q in result.parameters} for result in (before, after)]
    a, b = (result.turbine.values for result in (before, after))
    fixed = [
        name for name in a
        if name in b and name not in identified[0] | identified[1] and not math.isclose(a[name], b[name], rel_tol=1e-9)
    ]  # fmt: skip
    told = []
    if fixed:
        told.append(
            f"the turbine files of the two results differ in {_some(fixed)}: what moved may be the files; identify both with one file"
        )
    alone = [q.name for r in (before, after) for q in r.parameters if (q.name in identified[0]) != (q.name in identified[1])]  # fmt: skip
    if alone:
        told.append(
            f"only one of the two results identified {_some(alone)}: what the other took for it counts as change"
        )
    return told


def _some(names: Sequence[str]) -> str:
    """Up to four names, and how many more there are."""
    return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def _value(result: Posterior, name: str) -> float:
    learned = {s.name: s.estimate for s in result.statistics}
    return float(learned[name] if name in learned else result.turbine.values[name])


def _half_width(change: Change) -> float:
    """Half of the ±2σ band in ln(B/A)."""
    if change.low <= -100.0 or math.isinf(change.high):
        return math.inf
    return 0.5 * math.log((100.0 + change.high) / (100.0 + change.low))


def _band(change: Change) -> str:
    return f"{_percent(change.low)} … {_percent(change.high)} %"


def _percent(value: float) -> str:
    """A change [%] with its sign, to three digits or so."""
    if math.isinf(value):
        return "∞"
    digits = 0 if abs(value) >= 100.0 else 1 if abs(value) >= 10.0 else 2
    return f"{round(value, digits) + 0.0:+.{digits}f}"


def _odds(log_odds: float) -> str:
    return f"{_large(log_odds)} : 1" if log_odds >= 0.0 else f"1 : {_large(-log_odds)}"


def _large(log_value: float) -> str:
    """e to this power, in words that fit a table."""
    return f"{math.exp(log_value):.3g}" if log_value < math.log(1e5) else f"10^{log_value / math.log(10.0):.0f}"

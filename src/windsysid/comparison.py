"""What moved between records of one turbine, and how sure that is.

Each record leaves a Gaussian posterior N(θ̂, Λ⁻¹), and all of them a prior N(θ₀, Λ₀⁻¹). What a record itself says is the rest, Λ − Λ₀ with the vector
h = Λ θ̂ − Λ₀ θ₀. With a change δ between the first record, A, and another, B, of prior N(0, T⁻¹),

    information  [Λ_A + Λ_B − Λ₀    Λ_B − Λ₀    ]        vector  [h_A + h_B + Λ₀ θ₀]
                 [Λ_B − Λ₀          Λ_B − Λ₀ + T]                [h_B              ]

of (θ_A, δ). No record's own information need be regular: what neither sees stays at its prior. The change and its band are those of a vague T;
the odds that a coefficient moved at all are those of Savage and Dickey, the prior density of δ = 0 over the posterior one, with T for changes of
the size that damage makes (`TYPICAL`). Source: Dickey, Ann. Math. Statist. 42(1), 1971, https://doi.org/10.1214/aoms/1177693507; Verdinelli & Wasserman,
J. Am. Stat. Assoc. 90, 1995, https://doi.org/10.1080/01621459.1995.10476554.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.errors import ConfigurationError
from windsysid.mechanics.compile import compile_model
from windsysid.modal import modes_with_bands
from windsysid.output import Saveable
from windsysid.result import SIGMAS, Posterior
from windsysid.units import parameter_unit, unit_text

__all__ = ["HEADINGS", "MOVED", "Change", "Comparison", "compare", "own_information", "without_prior"]

Array = NDArray[np.float64]

TYPICAL = {"k": 0.1, "c": 0.5}
"""Prior standard deviation of a change, relative: of stiffness (and anything else), and of damping."""

VAGUE = 100.0
"""How many times wider the prior of a change is where its size is estimated."""

FAINT = 1e-6
"""Share of the prior's information that is left where it is taken out."""

MOVED = 100.0
"""Odds from which a coefficient is said to have moved."""


class Change(NamedTuple):
    """How a quantity of record B differs from that of record A.

    Attributes
    ----------
    name, unit
        Of a coefficient, or of a mode's frequency.
    before, after
        Estimates in SI, Hz for a frequency.
    percent, low, high
        The change and its ±2σ band [% of `before`].
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
        """Whether it rather moved than not."""
        return self.log_odds > 0.0

    def __str__(self) -> str:
        """How far it moved, and at which odds."""
        verb = "rose" if self.percent > 0.0 else "fell"
        return f"{self.name} {verb} by {abs(self.percent):.3g} % ± {0.5 * (self.high - self.low):.2g} % (odds {_odds(self.log_odds)})"


@dataclass(frozen=True)
class Comparison(Saveable):
    """What moved between record A and record B.

    Attributes
    ----------
    records
        Names of the two.
    coefficients, modes
        Changes of the coefficients that both identified, and of the frequencies of the modes that both have, at A's rotor speed.
    doubts
        Why the comparison itself is not to be trusted, in sentences.
    """

    records: tuple[str, str]
    coefficients: tuple[Change, ...]
    modes: tuple[Change, ...]
    doubts: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """The answer."""
        ranked = sorted(self.coefficients, key=lambda change: -change.log_odds)
        moved = [str(change) for change in ranked if change.moved]
        suspects = [str(change) for change in ranked if change.suspect and not change.moved]
        told = [f"moved: {', '.join(moved)}"] if moved else [f"nothing moved at odds of {MOVED:g} : 1"]
        if suspects:
            told.append(f"may have moved: {', '.join(suspects)}")
        if not moved:
            widest = {
                kind: max(
                    (0.5 * (c.high - c.low) for c in self.coefficients if c.name.startswith(kind)), default=math.nan
                )
                for kind in ("k_", "c_")
            }
            told += [
                f"a change of {what} below {2.0 * widest[kind]:.2g} % could go unseen"
                for kind, what in (("k_", "stiffness"), ("c_", "damping")) if math.isfinite(widest[kind])
            ]  # fmt: skip
        return "; ".join(told)

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """As a table under `HEADINGS`."""
        return [
            (
                change.name, unit_text(change.unit), f"{change.before:.5g}", f"{change.after:.5g}", f"{change.percent:+.2f} %",
                f"{change.low:+.2f} … {change.high:+.2f} %", "" if math.isnan(change.log_odds) else _odds(change.log_odds),
                f"{change.chance:.2g}",
            )
            for change in (*self.coefficients, *self.modes)
        ]  # fmt: skip

    def summary(self) -> dict[str, Any]:
        """Plain values, for ``summary.json``."""
        return {
            "records": list(self.records),
            "sentence": self.sentence,
            "moved": [c.name for c in self.coefficients if c.moved],
            "coefficients": {c.name: _plain(c) for c in self.coefficients},
            "modes": {c.name: _plain(c) for c in self.modes},
            "doubts": list(self.doubts),
        }

    def files(self) -> dict[str, bytes]:
        """What `save` writes: ``report.html``, ``changes.png`` and ``summary.json``."""
        from windsysid.comparisonreport import comparison_files

        return comparison_files(self)

    def to_json(self) -> str:
        """`summary` as text."""
        return json.dumps(self.summary(), indent=2) + "\n"

    def __str__(self) -> str:
        """The answer, the table, the doubts."""
        from rich.table import Table

        from windsysid.console import render

        table = Table(title=f"{self.records[0]} (A) → {self.records[1]} (B)", title_justify="left")
        for i, heading in enumerate(HEADINGS):
            table.add_column(heading, justify="left" if i < 2 else "right")
        for row in self.rows:
            table.add_row(*row)
        return render(table, self.sentence, *(f"not to be trusted: {doubt}" for doubt in self.doubts))


HEADINGS = ("", "unit", "A", "B", "change", "±2σ band", "odds that it moved", "by chance")


def compare(before: Posterior, after: Posterior) -> Comparison:
    """What moved from one record of a turbine to another.

    Raises
    ------
    ConfigurationError
        If the two have no coefficient in common.
    """
    names = [q.name for q in before.parameters if q.name in [other.name for other in after.parameters]]
    if not names:
        raise ConfigurationError(
            f"{before.record} and {after.record}: expected coefficients that both identified, got "
            f"{', '.join(q.name for q in before.parameters)} and {', '.join(q.name for q in after.parameters)}"
        )
    parameters = [q for q in before.parameters if q.name in names]
    scale = np.array([1.0 if q.logarithmic else abs(_value(before, q.name)) / q.reference for q in parameters])
    typical = scale * [TYPICAL.get(q.name[0], TYPICAL["k"]) for q in parameters]
    delta, cov = _difference(before, after, names, VAGUE * typical)
    of_damage, cov_of_damage = _difference(before, after, names, typical)
    changes = []
    for i, q in enumerate(parameters):
        sigma, now = math.sqrt(cov[i, i]), _value(before, q.name)
        steps = delta[i] + sigma * np.array([0.0, -SIGMAS, SIGMAS])
        percent, low, high = (100.0 * (np.expm1(steps) if q.logarithmic else steps * q.reference / abs(now))).tolist()
        post = cov_of_damage[i, i]
        log_odds = 0.5 * math.log(post / typical[i] ** 2) + 0.5 * of_damage[i] ** 2 / post
        changes.append(
            Change(q.name, parameter_unit(q.name), now, _value(after, q.name), percent, low, high, log_odds, math.erfc(abs(delta[i]) / sigma / math.sqrt(2.0)))
        )  # fmt: skip
    doubts = tuple(
        f"the result of {result.record} is not trusted by itself: see its report"
        for result in (before, after)
        if not result.trusted
    )
    return Comparison((before.record, after.record), tuple(changes), _modes(before, after), doubts)


def _difference(before: Posterior, after: Posterior, names: Sequence[str], spread: Array) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of the change of `names` in A's filter coordinates, prior standard deviations `spread` (n,)."""
    n = len(names)
    prior, prior_vector = _prior(before, names)
    said = [own_information(result, names, before) for result in (before, after)]
    (info_a, h_a), (info_b, h_b) = said
    information = np.block([[prior + info_a + info_b, info_b], [info_b, info_b + np.diag(spread**-2.0)]])
    cov = np.linalg.inv(information)
    mean = cov @ np.concatenate([prior_vector + h_a + h_b, h_b])
    return mean[n:], cov[n:, n:]


def own_information(result: Posterior, names: Sequence[str], frame: Posterior) -> tuple[Array, Array]:
    """What a record itself says of `names`: information (n, n) and vector (n,), in the coordinates of `frame`."""
    at = [[q.name for q in result.parameters].index(name) for name in names]
    own = [result.parameters[i] for i in at]
    shared = [next(q for q in frame.parameters if q.name == name) for name in names]
    # θ_frame = stretch θ + shift
    stretch = np.array([1.0 if q.logarithmic else q.reference / f.reference for q, f in zip(own, shared, strict=True)])
    shift = np.array(
        [math.log(q.reference / f.reference) if q.logarithmic else 0.0 for q, f in zip(own, shared, strict=True)]
    )
    cov = result.cov[np.ix_(at, at)] * np.outer(stretch, stretch)
    mean = result.theta[at] * stretch + shift
    prior_mean = np.array([q.prior[0] for q in own]) * stretch + shift
    prior = np.diag((np.array([q.prior[1] for q in own]) * stretch) ** -2.0)
    posterior = np.linalg.inv(cov)
    values, vectors = np.linalg.eigh(posterior - prior)
    information = (vectors * values.clip(0.0)) @ vectors.T
    return information, posterior @ mean - prior @ prior_mean


def without_prior(result: Posterior, names: Sequence[str], frame: Posterior) -> tuple[Array, Array]:
    """Mean (n,) and covariance (n, n) of `names` by what the record itself says, in the coordinates of `frame`; what it does not see stays finite."""
    information, vector = own_information(result, names, frame)
    prior = [next(q.prior for q in frame.parameters if q.name == name) for name in names]
    faint = FAINT * np.array([spread**-2.0 for _, spread in prior])
    cov = np.linalg.inv(information + np.diag(faint))
    return cov @ (vector + faint * [centre for centre, _ in prior]), np.asarray(cov, dtype=np.float64)


def _prior(result: Posterior, names: Sequence[str]) -> tuple[Array, Array]:
    """Information (n, n) and vector (n,) of A's prior."""
    chosen = [q for q in result.parameters if q.name in names]
    information = np.array([q.prior[1] ** -2.0 for q in chosen])
    return np.diag(information), information * [q.prior[0] for q in chosen]


def _modes(before: Posterior, after: Posterior) -> tuple[Change, ...]:
    """Changes of the modes' frequencies at A's rotor speed."""
    found = []
    for result in (before, after):
        turbine = result.turbine
        compiled = compile_model(turbine.model)
        p = np.array([turbine.values[name] for name in compiled.parameters])
        of = modes_with_bands(
            turbine.model, compiled, p, before.turbine.rotor_speed, result.parameters, result.theta, result.cov, p
        )
        found.append({mode.name: mode.frequency_hz for mode in of})
    changes = []
    for name in (name for name in found[0] if name in found[1]):
        (f0, _, high0), (f1, _, high1) = found[0][name], found[1][name]
        sigma = math.hypot(high0 - f0, high1 - f1) / SIGMAS
        percent, low, high = (100.0 * (f1 - f0 + k * sigma) / f0 for k in (0.0, -SIGMAS, SIGMAS))
        chance = math.erfc(abs(f1 - f0) / max(sigma, 1e-300) / math.sqrt(2.0))
        changes.append(Change(name, "Hz", f0, f1, percent, low, high, math.nan, chance))
    return tuple(changes)


def _value(result: Posterior, name: str) -> float:
    return float(result.turbine.values[name])


def _odds(log_odds: float) -> str:
    return f"{_large(log_odds)} : 1" if log_odds >= 0.0 else f"1 : {_large(-log_odds)}"


def _large(log_value: float) -> str:
    """e to this power, in words that fit a table."""
    return f"{math.exp(log_value):.3g}" if log_value < math.log(1e5) else f"10^{log_value / math.log(10.0):.0f}"


def _plain(change: Change) -> dict[str, float | str | None]:
    return {
        key: None if isinstance(value, float) and math.isnan(value) else value
        for key, value in change._asdict().items()
    }

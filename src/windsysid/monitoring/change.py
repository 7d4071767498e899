"""A change between two records, and all of them together: sentences and plain values."""

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from windsysid.output.answers import Answer
from windsysid.output.table import Table
from windsysid.results.serialization import finite
from windsysid.units import engineering, significant_digits

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["HEADINGS", "MIN_CHANGE_ODDS", "Comparison", "QuantityChange"]

MAX_REPORTED_LOG_FACTOR = math.log(10.0)
"""A change is not reported where its interval (±2σ) reaches further than this factor either way."""

MIN_CHANGE_ODDS = 100.0
"""Odds from which a coefficient is said to have moved."""

MAX_SHOWN_ODDS = 1000.0
"""Odds that are shown at most: none of 2176 coefficients without a change reached 100 : 1 (docs/comparison.md), which
bounds the rate of false alarms at 1.4 in 1000 (95 %) and shows nothing of rarer ones."""

MIN_SUSPECT_ODDS = 10.0
"""Odds from which it is said that it may have."""


class QuantityChange(NamedTuple):
    """Difference of a quantity of record B from that of record A.

    Attributes
    ----------
    name, unit
        Of a coefficient, a mode's frequency, or a statistic of loads or noise.
    before, after
        Estimates of the two results, priors included, in SI, Hz for a frequency.
    percent, low, high
        By how much B is above A [% of A] according to the records without the priors, and the 95 % interval. `low` is
        −100 where B may be nothing, `high` infinite where A may be. `percent` is NaN where both are so, or where the
        interval of a logarithm reaches further than a factor of ten either way: the change is not reported.
    log_odds
        Natural logarithm of the odds that it moved; NaN for a mode, which moves if a coefficient does.
    chance
        Probability of a difference this large, or larger, without a change.
    kind
        Of a coefficient, ``stiffness``, ``damping`` …; of a mode of `windsysid.oma`, ``frequency`` or ``damping``;
        empty for a mode of a model or a statistic.
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
    kind: str = ""

    @property
    def moved(self) -> bool:
        """True if the odds are beyond `MIN_CHANGE_ODDS`."""
        return self.log_odds > math.log(MIN_CHANGE_ODDS)

    @property
    def suspect(self) -> bool:
        """True if the odds are beyond `MIN_SUSPECT_ODDS`."""
        return self.log_odds > math.log(MIN_SUSPECT_ODDS)

    @property
    def ratio_percent(self) -> float:
        """By how much the estimate of B is above that of A, priors included [%]; NaN where A is zero."""
        return 100.0 * (self.after / self.before - 1.0) if self.before else math.nan

    @property
    def is_bounded(self) -> bool:
        """True if the records bound the change on one side at least."""
        return not math.isnan(self.percent)

    def __str__(self) -> str:
        """Size of the change, and its odds."""
        if not self.is_bounded:
            how = f"changed by an amount that the data do not determine (odds {_odds(self.log_odds)})"
        elif math.isinf(self.percent):
            how = f"rose from about zero (odds {_odds(self.log_odds)})"
        else:
            verb = "rose" if self.percent > 0.0 else "fell"
            how = f"{verb} by {abs(self.percent):.3g} % (95 % interval {_band(self)} %; odds {_odds(self.log_odds)})"
        return f"{self.name} {how}"


@dataclass(frozen=True)
class Comparison(Answer):
    """Result of `windsysid.compare`: changes from record A to record B.

    Attributes
    ----------
    records
        Names of the two.
    coefficients, modes, statistics
        Changes of the coefficients that both identified, of the frequencies of the modes that both have, at the mean of
        the two rotor speeds, and of the statistics of loads and noise that both learned.
    same
        True if both are results of one record and section, so that no change is possible.
    doubts
        Reasons why the comparison is not to be trusted, in sentences.
    notes
        Remarks.
    """

    records: tuple[str, str]
    coefficients: tuple[QuantityChange, ...]
    modes: tuple[QuantityChange, ...]
    statistics: tuple[QuantityChange, ...]
    same: bool
    doubts: tuple[str, ...]
    notes: tuple[str, ...]

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each `QuantityChange`: its fields, whether it ``moved``, and whether it is of a coefficient, a mode
        or a statistic (``quantity``)."""
        import pandas as pd

        of = (("coefficient", self.coefficients), ("mode", self.modes), ("statistic", self.statistics))
        moved = self.moved
        rows = [(quantity, *one, one in moved) for quantity, changes in of for one in changes]
        return pd.DataFrame(rows, columns=["quantity", *QuantityChange._fields, "moved"])

    @property
    def _ranked(self) -> list[QuantityChange]:
        """The coefficients, the surest first."""
        return sorted(self.coefficients, key=lambda change: -change.log_odds)

    @property
    def moved(self) -> tuple[QuantityChange, ...]:
        """The coefficients that moved, the surest first."""
        return () if self.same else tuple(change for change in self._ranked if change.moved)

    @property
    def _suspects(self) -> list[QuantityChange]:
        """The coefficients that may have moved, the surest first."""
        return [change for change in self._ranked if change.suspect and not change.moved]

    @property
    def sentence(self) -> str:
        """The answer."""
        if self.same:
            return (
                f"no change: both results are of the same record and section ({self.records[0]}), and one record"
                " cannot differ from itself"
            )
        some = (("changed", self.moved), ("may have changed", self._suspects))
        told = [f"{verb}: {', '.join(map(str, changes))}" for verb, changes in some if changes]
        told = told or [f"no change shown: no coefficient reaches odds of {MIN_SUSPECT_ODDS:g} : 1"]
        told += [] if self.moved else self._unseen()
        other = [change.name for change in self.statistics if change.moved]
        if other:
            told.append(f"loads and noise differ in {', '.join(other)}")
        return "; ".join(told)

    def _unseen(self) -> list[str]:
        """Changes that could remain undetected, in words, of the best and the worst known coefficient of each kind: a
        change is detected from about four σ on."""
        told, dark = [], []
        for kind in ("stiffness", "frequency", "damping"):
            steps = {c.name: 2.0 * _half_width(c) for c in self.coefficients if c.kind == kind}
            dark += [name for name, step in steps.items() if step > MAX_REPORTED_LOG_FACTOR]
            seen = sorted((step, name) for name, step in steps.items() if step <= MAX_REPORTED_LOG_FACTOR)
            told += _undetected(kind, seen)
        return told + (
            [f"the records hold too little information on {', '.join(dark)} to show a change"] if dark else []
        )

    def table(self) -> Table:
        """Every quantity in either record, and its change."""
        return Table(HEADINGS, self.rows, f"{self.records[0]} (A) → {self.records[1]} (B), change: priors removed")

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """As a table under `HEADINGS`."""
        rows = list[tuple[str, ...]]()
        for change in (*self.coefficients, *self.modes, *self.statistics):
            digits = significant_digits(100.0, 0.5 * (change.high - change.low))
            before, after, unit = engineering(change.unit, change.before, change.after, digits=digits)
            percent = _percent(change.percent, change) if change.is_bounded else ""
            interval = _band(change).replace(" ", "") if change.is_bounded else "not determined"
            odds = "" if math.isnan(change.log_odds) else _odds(change.log_odds).replace(" ", "")
            rows.append((f"{change.name} [{unit}]", before, after, percent, interval, odds))
        return rows

    def summary(self) -> dict[str, Any]:
        """Plain values, for ``summary.json``; undetermined or unbounded values are None."""
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

    def to_json(self) -> str:
        """`summary` as text."""
        return json.dumps(self.summary(), indent=2) + "\n"

    def __repr__(self) -> str:
        return f"<Comparison of {self.records[0]} and {self.records[1]}: {self.sentence}>"

    def contents(self) -> list[Table | str]:
        """The sentence, the doubts, the table, the notes."""
        return [self.sentence, *(f"not to be trusted: {doubt}" for doubt in self.doubts), self.table(), *self.notes]


HEADINGS = ("quantity", "A", "B", "change %", "95 % interval", "odds")
"""Six columns: 80 signs of a terminal hold no more."""


def _undetected(kind: str, seen: list[tuple[float, str]]) -> list[str]:
    """The smallest and the largest step of coefficients of a kind that could remain undetected, in words."""
    ends = " … ".join(f"{_size(step)} ({name})" for step, name in [*seen[:1], *seen[1:][-1:]])
    return [f"a change of {kind} by less than {ends} could remain undetected"] if seen else []


def _half_width(change: QuantityChange) -> float:
    """Half of the 95 % interval in ln(B/A)."""
    if change.low <= -100.0 or math.isinf(change.high):
        return math.inf
    return 0.5 * math.log((100.0 + change.high) / (100.0 + change.low))


def _size(step: float) -> str:
    """A step of a logarithm as a percentage, or as a factor from two on."""
    return f"{100.0 * math.expm1(step):.2g} %" if step < math.log(2.0) else f"a factor of {math.exp(step):.2g}"


def _band(change: QuantityChange) -> str:
    return f"{_percent(change.low, change)} … {_percent(change.high, change)}"


def _percent(value: float, of: QuantityChange) -> str:
    """A value [%] of a change with its sign, to three digits or so, or to two digits of half the interval."""
    if math.isinf(value):
        return "∞"
    digits = 0 if abs(value) >= 100.0 else 1 if abs(value) >= 10.0 else 2
    digits = max(digits, significant_digits(1.0, 0.5 * (of.high - of.low), least=1) - 1)
    return f"{round(value, digits) + 0.0:+.{digits}f}"


def _odds(log_odds: float) -> str:
    return f"{_large(log_odds)} : 1" if log_odds >= 0.0 else f"1 : {_large(-log_odds)}"


def _large(log_value: float) -> str:
    """e to this power, in words that fit a table; no more than `MAX_SHOWN_ODDS`."""
    return f"{math.exp(log_value):.3g}" if log_value <= math.log(MAX_SHOWN_ODDS) else f">{MAX_SHOWN_ODDS:g}"

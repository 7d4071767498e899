"""Result of the separation of structural and aerodynamic damping, and its words."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from windsysid.output.answers import SummarisedAnswer
from windsysid.output.table import Table
from windsysid.units import RPM, engineering_unit, significant_digits, unit_text

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["HEADINGS", "DampingBand", "DampingSplit", "Separation", "State"]


class DampingBand(NamedTuple):
    """A value and its 95 % interval, SI."""

    value: float
    low: float
    high: float

    def over(self, unit: float) -> "DampingBand":
        """Band in another unit."""
        return DampingBand(self.value / unit, self.low / unit, self.high / unit)

    @property
    def cells(self) -> tuple[str, str]:
        """The value and the interval, to three digits of the interval's width."""
        decimals = min(significant_digits(1.0, self.high - self.low, least=0), 9)
        value, low, high = (f"{round(one, decimals) + 0.0:.{decimals}f}" for one in self)
        return value, f"{low} … {high}"


AnyBand = TypeVar("AnyBand", DampingBand, DampingBand | None)


class State(NamedTuple):
    """State of operation in one record: rotor speed [rad/s], wind speed [m/s] if it was recorded."""

    record: str
    rotor_speed: float
    wind_speed: float | None
    parked: bool

    def __str__(self) -> str:
        turning = "parked" if self.parked else f"{self.rotor_speed * RPM:.3g} rpm"
        return turning if self.wind_speed is None else f"{turning}, {self.wind_speed:.3g} m/s"


@dataclass(frozen=True)
class DampingSplit:
    """The damping of one degree of freedom, taken apart; what the records do not determine is None.

    Attributes
    ----------
    name, unit
        Of the coefficient.
    critical
        2√(km), to which damping ratios refer.
    frequency
        Of the degree of freedom on its own spring [rad/s].
    measured
        Total from each record by itself.
    structural
        c₀.
    aerodynamic
        What the air adds in each record's state.
    calm
        c₀ + a at the records' mean rotor speed: what does not grow with the wind, where that was recorded.
    per_wind
        b/V*, what a metre per second adds.
    scatter
        Rms of the records' distances from the fit, in their own σ; NaN where there are no more records than unknowns.
    """

    name: str
    unit: str
    critical: float
    frequency: float
    measured: tuple[DampingBand, ...]
    structural: DampingBand | None
    aerodynamic: tuple[DampingBand | None, ...]
    calm: DampingBand | None
    per_wind: DampingBand | None
    scatter: float

    @property
    def resolved(self) -> bool:
        """True if the structural part differs significantly from zero."""
        return self.structural is not None and self.structural.low > 0.0

    def percent(self, band: DampingBand) -> str:
        """An interval in % of critical damping."""
        value, span = band.over(0.01 * self.critical).cells
        return f"{value} % ({span} %)"


@dataclass(frozen=True)
class Separation(SummarisedAnswer):
    """Result of `windsysid.damping`: structural and aerodynamic damping.

    Attributes
    ----------
    states
        Operating conditions of each record.
    parked_air
        True if the structural part includes the aerodynamic damping of a parked rotor.
    splits
        One for each degree of freedom.
    lacking
        Parts that the records do not separate, why, and which record would, in sentences.
    notes
        Remarks.
    doubts
        Reasons why the separation is not to be trusted, in sentences.
    """

    states: tuple[State, ...]
    parked_air: bool
    splits: tuple[DampingSplit, ...]
    lacking: tuple[str, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each coefficient and part of it: ``name``, ``unit``, ``part`` (``total``, ``structure`` or
        ``air``), ``record`` where it is of one record's state, ``estimate``, ``low``, ``high``, and ``critical``,
        2√(km), to which damping ratios refer. What the records do not determine is NaN."""
        import pandas as pd

        rows: list[tuple[Any, ...]] = []
        for split in self.splits:
            parts = [("structure", "", split.structural)]
            for part, bands in (("air", split.aerodynamic), ("total", split.measured)):
                parts += [(part, state.record, band) for state, band in zip(self.states, bands, strict=True)]
            for part, record, band in parts:
                known = (math.nan,) * 3 if band is None else tuple(band)
                rows.append((split.name, unit_text(split.unit), part, record, *known, split.critical))
        columns = ["name", "unit", "part", "record", "estimate", "low", "high", "critical"]
        return pd.DataFrame(rows, columns=columns)

    @property
    def base(self) -> str:
        """Sentence on the structural part."""
        return "structure and a parked rotor's air" if self.parked_air else "structure"

    @property
    def sentence(self) -> str:
        """The answer, in % of critical damping."""
        running = [i for i, state in enumerate(self.states) if not state.parked]
        fastest = max(running, key=lambda i: (self.states[i].rotor_speed, self.states[i].wind_speed or 0.0), default=0)
        told = []
        for split in self.splits:
            if split.structural is not None:
                air = split.aerodynamic[fastest] if running else None
                more = f", air at {self.states[fastest]} {split.percent(air)}" if air is not None else ""
                told.append(f"{split.name}: {self.base} {split.percent(split.structural)}{more}")
        if told:
            return f"{'; '.join(told)}; all in % of critical damping"
        totals = "; ".join(f"{split.name} {split.percent(split.measured[fastest])}" for split in self.splits)
        return (
            f"structural and aerodynamic damping cannot be separated; together, at {self.states[fastest]}: {totals};"
            " all in % of critical damping"
        )

    def table(self) -> Table:
        """Structural and aerodynamic part of each coefficient, in every state."""
        rest = " (at rest: with the air of a parked rotor; air: what rotation and wind add)" if self.parked_air else ""
        return Table(HEADINGS, self.rows, f"Structural and aerodynamic damping{rest}", words=(0, 1))

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """As a table under `HEADINGS`."""
        rows: list[tuple[str, ...]] = []
        for split in self.splits:
            parts = [("at rest" if self.parked_air else "structure", split.structural)]
            if split.structural is None:
                parts = [
                    ("structure and what turns with the rotor", split.calm),
                    ("a metre per second of wind more", split.per_wind),
                ]
            parts += self._by_state("air", split.aerodynamic)
            shown = [(of, band) for of, band in parts if band is not None] or self._by_state("total", split.measured)
            for of, band in shown:
                size, unit = engineering_unit(split.unit, max(abs(band.value) for _, band in shown))
                name = f"{split.name} [{unit}]" if (of, band) == shown[0] else ""
                ratio, own = band.over(0.01 * split.critical), band.over(size)
                rows.append((name, of, *ratio.cells, *own.cells))
        return rows

    def _by_state(self, what: str, bands: Sequence[AnyBand]) -> list[tuple[str, AnyBand]]:
        return [(f"{what}, {state}", band) for state, band in zip(self.states, bands, strict=True)]

    def summary(self) -> dict[str, Any]:
        """Plain values, for ``summary.json``."""
        return {
            "sentence": self.sentence,
            "structural_includes_parked_air": self.parked_air,
            "records": [state._asdict() for state in self.states],
            "coefficients": {split.name: _plain(split) for split in self.splits},
            "lacking": list(self.lacking),
            "notes": list(self.notes),
            "doubts": list(self.doubts),
        }

    def __repr__(self) -> str:
        return f"<Separation: {self.sentence}>"

    def contents(self) -> list[Table | str]:
        """The sentence, undetermined quantities, the doubts, the table, the notes."""
        doubts = (f"not to be trusted: {doubt}" for doubt in self.doubts)
        return [self.sentence, *self.lacking, *doubts, self.table(), *self.notes]


HEADINGS = ("coefficient", "part", "ζ [%]", "95 % interval", "c", "95 % interval")


def _plain(split: DampingSplit) -> dict[str, Any]:
    def plain(band: DampingBand | None) -> dict[str, float] | None:
        return None if band is None else band._asdict()

    return {
        "unit": split.unit,
        "critical": split.critical,
        "structural": plain(split.structural),
        "aerodynamic": [plain(band) for band in split.aerodynamic],
        "calm": plain(split.calm),
        "per_wind": plain(split.per_wind),
        "measured": [plain(band) for band in split.measured],
        "scatter": split.scatter,
    }

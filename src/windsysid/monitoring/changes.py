"""Result of a watch over many records: series, jumps, alarms."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.monitoring.series import DAY, RecordBlocks
from windsysid.output.answers import SummarisedAnswer
from windsysid.output.table import Table
from windsysid.units import engineering_unit, significant_digits, unit_text

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

__all__ = ["HEADINGS", "DetectedJump", "Watch", "WatchedSeries"]


class DetectedJump(NamedTuple):
    """A jump that set off an alarm.

    Attributes
    ----------
    name
        Of the series.
    time, earliest, latest
        When it happened and its 95.45 % interval [s].
    found
        When the alarm went [s].
    percent, low, high
        How much, and the 95 % interval [% of the level before].
    cause
        Where to look: the turbine, the sensor, or the sensor before the turbine.
    sentence
        The sentence.
    """

    name: str
    time: float
    earliest: float
    latest: float
    found: float
    percent: float
    low: float
    high: float
    cause: str
    sentence: str


class WatchedSeries(NamedTuple):
    """History of one coefficient.

    Attributes
    ----------
    name, unit
        Of the coefficient.
    level, low, high
        (T,) value at mean covariates and its 95 % interval, in `unit`, as it was known after each block.
    adjusted
        (T,) blocks less the effect of the covariates, in `unit`.
    whitened, statistic
        (T,) innovations in standard deviations, and the statistic of the test as it was when the block came.
    limit
        Its threshold.
    drift
        Change of the level since the end of learning and its 95 % interval [%].
    slopes
        Effect of each covariate, per unit of it, and its 95 % interval [%].
    wander
        Standard deviation of the level's wandering in a day [%].
    scatter
        By how much blocks scatter more than their intervals say.
    smallest
        Jump that is found within a day in nine cases of ten [%].
    """

    name: str
    unit: str
    level: Array
    low: Array
    high: Array
    adjusted: Array
    whitened: Array
    statistic: Array
    limit: float
    drift: tuple[float, float, float]
    slopes: Mapping[str, tuple[float, float, float]]
    wander: float
    scatter: float
    smallest: float


@dataclass(frozen=True, eq=False)
class Watch(SummarisedAnswer):
    """Result of `windsysid.monitor`: level, drift and jumps of each series.

    Attributes
    ----------
    blocks
        The estimates that were monitored.
    series
        One for each of their names.
    changes
        Jumps, in the order of their alarms.
    alarms_per_year
        Accepted rate of false alarms of the turbine [1/a].
    begins
        Index of the first block that could raise an alarm.
    notes
        Remarks.
    """

    blocks: RecordBlocks
    series: tuple[WatchedSeries, ...]
    changes: tuple[DetectedJump, ...]
    alarms_per_year: float
    begins: int
    notes: tuple[str, ...]

    def to_dataframe(self) -> "pd.DataFrame":
        """A row for each series and record: ``time`` [s], ``name``, ``unit``, what was known after that record
        (``level``, ``low``, ``high``), the record less the effect of its covariates (``adjusted``), and the test for
        a jump (``statistic``, ``limit``)."""
        import pandas as pd

        return pd.concat([
            pd.DataFrame({
                "time": self.blocks.time, "name": s.name, "unit": unit_text(s.unit), "level": s.level, "low": s.low,
                "high": s.high, "adjusted": s.adjusted, "statistic": s.statistic, "limit": s.limit,
            })
            for s in self.series
        ], ignore_index=True)  # fmt: skip

    def to_xarray(self) -> "xr.Dataset":
        """Dataset with the dimensions ``name`` and ``time`` [s]."""
        import xarray as xr

        followed = ("level", "low", "high", "adjusted", "statistic")
        return xr.Dataset(
            {
                **{what: (("name", "time"), [getattr(s, what) for s in self.series]) for what in followed},
                "limit": ("name", [s.limit for s in self.series]),
            },
            coords={
                "name": [s.name for s in self.series],
                "unit": ("name", [unit_text(s.unit) for s in self.series]),
                "time": ("time", self.blocks.time, {"units": "s"}),
            },
        )

    @property
    def sentence(self) -> str:
        """The answer."""
        if self.changes:
            return "; ".join(change.sentence for change in self.changes)
        days = (self.blocks.time[-1] - self.blocks.time[self.begins]) / DAY
        step = float(np.median(np.diff(self.blocks.time)))
        within = "a day" if step < DAY else f"one record ({step / DAY:.3g} days)"
        watched = [s for i, s in enumerate(self.series) if self.blocks.kind(i) != "noise"]
        sharpest = min(watched or self.series, key=lambda s: s.smallest)
        return (
            f"no jump in {days:.3g} days at {self.alarms_per_year:g} false alarms a year; a jump of"
            f" {two_digits(sharpest.smallest)} % in {sharpest.name} would have been found within {within}"
        )

    def tables(self) -> list[Table]:
        """Level, drift and scatter of each series; the effects of covariates, and records that do not count for a
        series, where there are any."""
        told = [Table(HEADINGS, self.rows, f"{len(self.blocks.time)} records", words=(0, 1))]
        if self.effects:
            told.append(Table(self.effect_headings, self.effects, "Effect of one unit of a covariate, ± 95 % interval"))
        if self.blocks.left_out:
            rows = [
                (name, f"{sum(of.values())}", ", ".join(f"{n} {why.replace('_', ' ')}" for why, n in of.items()))
                for name, of in self.blocks.left_out.items()
            ]
            told.append(Table(("quantity", "records", "reason"), rows, "Left out: not of grade A or B", words=(0, 2)))
        return told

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """One line a series, under `HEADINGS`."""
        rows = list[tuple[str, ...]]()
        for s in self.series:
            size, unit = engineering_unit(s.unit, s.level[-1])
            level, half = s.level[-1] / size, 0.5 * (s.high[-1] - s.low[-1]) / size
            digits = significant_digits(level, half)
            shares = f"{two_digits(s.wander)} %", f"{s.scatter:.2f}", f"{two_digits(s.smallest)} %"
            rows.append((s.name, unit, f"{level:.{digits}g} ± {two_digits(half)}", _signed(*s.drift), *shares))
        return rows

    @property
    def effects(self) -> list[tuple[str, ...]]:
        """One line a series, under its name and those of the covariates."""
        return [(s.name, *(_signed(*slope) for slope in s.slopes.values())) for s in self.series if s.slopes]

    @property
    def effect_headings(self) -> tuple[str, ...]:
        """Of `effects`."""
        return ("per unit of", *self.series[0].slopes)

    def summary(self) -> dict[str, Any]:
        """Plain values, for ``summary.json``."""
        return {
            "sentence": self.sentence,
            "records": len(self.blocks.time),
            "alarms_per_year": self.alarms_per_year,
            "alarms_from": self.blocks.when(float(self.blocks.time[self.begins])),
            "changes": [c._asdict() for c in self.changes],
            "series": {
                s.name: {
                    "unit": s.unit, "level": float(s.level[-1]), "low": float(s.low[-1]), "high": float(s.high[-1]),
                    "drift_percent": list(s.drift), "slopes_percent": {k: list(v) for k, v in s.slopes.items()},
                    "wander_percent_per_root_day": s.wander, "scatter": s.scatter, "smallest_jump_percent": s.smallest,
                }
                for s in self.series
            },
            "left_out": {name: dict(counts) for name, counts in self.blocks.left_out.items()},
            "notes": list(self.notes),
        }  # fmt: skip

    def __repr__(self) -> str:
        return f"<Watch over {len(self.blocks.time)} records: {self.sentence}>"

    def contents(self) -> list[Table | str]:
        """The sentence, the tables, the notes."""
        return [self.sentence, *self.tables(), *self.notes]


HEADINGS = ("quantity", "unit", "now ± 95 %", "drift ± 95 %", "random walk a day", "scatter ÷ σ", "detectable in a day")


def _signed(percent: float, low: float, high: float) -> str:
    return f"{percent:+.3g} ± {two_digits(0.5 * (high - low))} %"


def two_digits(value: float) -> str:
    """A number with two digits, without an exponent below a million."""
    return f"{float(f'{value:.2g}'):g}"

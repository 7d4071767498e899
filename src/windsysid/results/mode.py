"""A mode of vibration."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from windsysid.results.estimate import IntervalEstimate
from windsysid.units import with_half_width

__all__ = ["Mode"]

MAX_SHOWN_FACTOR = 3.3
"""Setting: factor from an estimate to the end of its interval beyond which a table does not show it as ±."""


@dataclass(frozen=True)
class Mode:
    """Mode of a turbine in the fixed frame, derived from its estimates.

    Attributes
    ----------
    name
        Degree of freedom with most of the energy: ``tower x``, ``lag backward`` …
    frequency
        [Hz], with its 95 % interval, grade and reference.
    damping_ratio
        [1], likewise.
    """

    name: str
    frequency: IntervalEstimate
    damping_ratio: IntervalEstimate

    def __str__(self) -> str:
        name, frequency, f_grade, damping, z_grade = self.cells()
        return f"{name}: {frequency} Hz (grade {f_grade or '–'}), damping ratio {damping} % (grade {z_grade or '–'})"

    @property
    def trusted(self) -> bool:
        """True if neither frequency nor damping ratio is of grade C."""
        return "C" not in (self.frequency.grade, self.damping_ratio.grade)

    @property
    def half_width(self) -> float:
        """Half of the half-power bandwidth, ζ f [Hz]."""
        return self.damping_ratio.estimate * self.frequency.estimate

    @property
    def quantities(self) -> tuple[tuple[str, IntervalEstimate], tuple[str, IntervalEstimate]]:
        """Frequency and damping ratio with their names in tables."""
        return ("frequency", self.frequency), ("damping ratio", self.damping_ratio)

    def summary(self) -> dict[str, Any]:
        """Name, frequency and damping ratio as plain values, for JSON."""
        values = {"frequency": self.frequency.summary(), "damping_ratio": self.damping_ratio.summary()}
        return {"name": self.name, **values}

    def dataframe_rows(self) -> list[tuple[Any, ...]]:
        """Name, quantity, unit, estimate, low, high, grade and reference of frequency and damping ratio."""
        return [
            (self.name, name, one.unit, one.estimate, one.low, one.high, one.grade, one.reference)
            for name, one in self.quantities
        ]

    def cells(self) -> tuple[str, str, str, str, str]:
        """Name, frequency [Hz] and damping ratio [%] as ``estimate ± 2σ``, each with its grade, for a table; a wide
        interval of ln ζ by its ends, or as — if the grade is C."""
        f, z = self.frequency, self.damping_ratio
        frequency = with_half_width(f.estimate, f.estimate - f.low, 4)
        decimals, percent = 3 if abs(z.estimate) < 0.01 else 2, 100.0 * z.estimate
        damping = with_half_width(percent, percent - 100.0 * z.low, decimals)
        if z.high > MAX_SHOWN_FACTOR * z.estimate > 0.0:
            ends = "± —" if z.grade == "C" else f"({100.0 * z.low:.{decimals}f} … {100.0 * z.high:.{decimals}f})"
            damping = f"{percent:.{decimals}f} {ends}"
        return self.name, frequency, f.grade, damping, z.grade

    def beside(self, orders: Sequence[int], rotor_speed: float) -> str:
        """Distance of the mode from the nearest of `orders` of `rotor_speed` [rad/s], as text: ``3P -7.7 %``."""
        f = self.frequency.estimate
        harmonics = {n: n * rotor_speed / (2.0 * math.pi) for n in orders}
        n = min(harmonics, key=lambda n: abs(f / harmonics[n] - 1.0))
        return f"{n}P {100.0 * (f / harmonics[n] - 1.0):+.2g} %"

    def reference_cell(self) -> str:
        """Reference frequency [Hz] as text for a table."""
        return "" if self.frequency.reference is None else f"{self.frequency.reference:.4f}"

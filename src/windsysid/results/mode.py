"""A mode of vibration."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

__all__ = ["Mode"]


class Mode(NamedTuple):
    """A mode in the fixed frame.

    Attributes
    ----------
    name
        Where its energy sits: ``tower x``, ``lag backward`` …
    frequency_hz, damping_ratio
        (value, low, high) [Hz], [1].
    reference
        Frequency [Hz] and damping ratio [1] that the reference coefficients give; None where they give no such mode.
    grades
        Of the frequency and of the damping ratio, as `windsysid.results.estimate.Estimate.grade`.
    """

    name: str
    frequency_hz: tuple[float, float, float]
    damping_ratio: tuple[float, float, float]
    reference: tuple[float, float] | None = None
    grades: tuple[str, str] = ("", "")

    def summary(self) -> dict[str, Any]:
        """As plain values, for ``summary.json``."""
        values: dict[str, Any] = {"name": self.name}
        for i, (key, triple) in enumerate((("frequency_hz", self.frequency_hz), ("damping_ratio", self.damping_ratio))):
            values[key] = dict(zip(("estimate", "low", "high"), triple, strict=True))
            if self.grades[i]:
                values[key]["grade"] = self.grades[i]
            if self.reference is not None:
                values[key]["reference"] = self.reference[i]
        return values

    def cells(self) -> tuple[str, str, str, str, str]:
        """Name, frequency [Hz] and damping ratio [%] as ``estimate ± 2σ``, each with its grade, for a table."""
        f, digits = self.frequency_hz, 3 if abs(self.damping_ratio[0]) < 0.01 else 2
        (z, low, _), grades = (100.0 * value for value in self.damping_ratio), self.grades
        frequency, damping = f"{f[0]:.4f} ± {f[0] - f[1]:.4f}", f"{z:.{digits}f} ± {z - low:.{digits}f}"
        return self.name, frequency, grades[0], damping, grades[1]

    def beside(self, orders: Sequence[int], rotor_speed: float) -> str:
        """Distance of the mode from the nearest of `orders` of `rotor_speed` [rad/s], as text: ``3P -7.7 %``."""
        harmonics = {n: n * rotor_speed / (2.0 * math.pi) for n in orders}
        n = min(harmonics, key=lambda n: abs(self.frequency_hz[0] / harmonics[n] - 1.0))
        return f"{n}P {100.0 * (self.frequency_hz[0] / harmonics[n] - 1.0):+.2g} %"

    def reference_cells(self) -> tuple[str, str]:
        """Reference frequency [Hz] and damping ratio [%] as text for a table."""
        return ("", "") if self.reference is None else (f"{self.reference[0]:.4f}", f"{100.0 * self.reference[1]:.3f}")

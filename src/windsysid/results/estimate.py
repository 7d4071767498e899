"""Estimates with intervals: of a quantity, of a coefficient, of loads, and of the spectrum of one channel."""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from windsysid._types import Array
from windsysid.results.posterior import SIGMAS
from windsysid.units import engineering_unit

__all__ = ["Estimate", "FittedSpectrum", "IntervalEstimate", "Loads"]


@dataclass(frozen=True)
class IntervalEstimate:
    """Estimate of one quantity with its 95 % interval: a frequency or a damping ratio of a mode.

    Attributes
    ----------
    estimate, low, high
        Value and ends of its ±2σ interval, in `unit`.
    std
        Standard deviation, in `unit`; for an interval of the logarithm, `estimate` times the logarithm's.
    unit
        ``Hz``; ``1`` for a ratio.
    grade
        ``A``: the interval of the model; ``B``: a wider one; ``C``: not to be used (docs/grades.md); empty: not known.
    reference
        Value by the turbine file, in `unit`; None where it is not known.

    Examples
    --------
    >>> from windsysid.results import IntervalEstimate
    >>> f = IntervalEstimate.normal(0.32, 0.002, "Hz")
    >>> f.estimate, f.unit
    (0.32, 'Hz')
    >>> print(f)
    0.32 Hz (95 % interval 0.316 … 0.324)
    """

    estimate: float
    low: float
    high: float
    std: float
    unit: str
    grade: str = ""
    reference: float | None = None

    @classmethod
    def normal(cls, estimate: float, std: float, unit: str) -> "IntervalEstimate":
        """Return an estimate with a symmetric interval: `estimate` ± 2 `std`, both in the `unit` that is given."""
        half = SIGMAS * std
        return cls(estimate, estimate - half, estimate + half, std, unit)

    @classmethod
    def lognormal(cls, estimate: float, log_std: float, unit: str) -> "IntervalEstimate":
        """Return an `estimate`, in the `unit` that is given, whose logarithm has the standard deviation `log_std` [1].

        The interval ends at factors of e⁶, which say that the quantity is not known.
        """
        factor = math.exp(SIGMAS * min(log_std, 3.0))
        return cls(estimate, estimate / factor, estimate * factor, estimate * log_std, unit)

    @property
    def relative_std(self) -> float:
        """Standard deviation relative to the estimate [1]: that of the logarithm of a positive quantity."""
        return self.std / self.estimate

    def __str__(self) -> str:
        return _sentence(self)

    def summary(self) -> dict[str, Any]:
        """Plain values for JSON, without an unknown grade or reference."""
        return {key: value for key, value in asdict(self).items() if value not in ("", None)}


@dataclass(frozen=True)
class Estimate:
    """Estimate of one coefficient, with its interval and grade.

    Attributes
    ----------
    name, unit, kind
        ``k_x`` …, SI unit, ``stiffness``, ``damping`` or ``parameter``.
    estimate, low, high, std
        Value and its ±2σ interval, computed in filter coordinates, and the standard deviation, all in `unit`.
    informed_by_data
        Share of the information that came from the data and not from the prior, 0 … 1.
    prior
        Centre of the prior, in `unit`.
    reference
        The turbine file's value, in `unit`; None where it is not known.
    average_error_percent
        Eq (24) point by point, averaged over the record [%]; None without a reference.
    tip
        The same estimate, low, high, std and reference per tip deflection [N/m or N·s/m], for blades with a tip lever.
    grade
        ``A``: the interval of the model; ``B``: a wider one; ``C``: not to be used (docs/grades.md); empty: not known.
    widening
        Factor on the model's standard deviation, given all tolerances.
    """

    name: str
    unit: str
    kind: str
    estimate: float
    low: float
    high: float
    std: float
    informed_by_data: float
    prior: float
    reference: float | None
    average_error_percent: float | None
    tip: Mapping[str, float] | None = None
    grade: str = ""
    widening: float = 1.0

    def __str__(self) -> str:
        return f"{self.name}: {_sentence(self)}"


def _sentence(one: IntervalEstimate | Estimate) -> str:
    """Value with its unit, interval and grade, in engineering units."""
    factor, unit = engineering_unit(one.unit, one.estimate)
    unit, grade = "" if one.unit == "1" else f" {unit}", f", grade {one.grade}" if one.grade else ""
    return f"{one.estimate / factor:.4g}{unit} (95 % interval {one.low / factor:.4g} … {one.high / factor:.4g}{grade})"


class Loads(NamedTuple):
    """The loads that were states: names, mean and standard deviation after each sample (T, n) [N, N·m]."""

    names: tuple[str, ...]
    mean: Array
    std: Array


class FittedSpectrum(NamedTuple):
    """One-sided power spectral density of one channel under a fit, at the posterior mode.

    Attributes
    ----------
    channel
        Name of the channel, or of the combination of channels of several blades.
    turning
        Whether it is read in the frame that turns with the rotor.
    frequency
        Frequencies (F,) [Hz], increasing.
    density
        There (F,) [unit²/Hz].
    log_std
        Standard deviation of its logarithm (F,), of the posterior, by the delta method.
    measured
        Periodogram of the fit's data (F,) [unit²/Hz], averaged over the bins that share a spectrum; None where the fit
        is one in time.
    """

    channel: str
    turning: bool
    frequency: Array
    density: Array
    log_std: Array
    measured: Array | None = None

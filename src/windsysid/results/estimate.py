"""One identified coefficient, and the spectrum of one channel under a fit."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from windsysid._types import Array

__all__ = ["Estimate", "FittedSpectrum"]


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

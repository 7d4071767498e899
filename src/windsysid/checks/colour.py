"""Level of the innovations over frequency: test for a smooth mismatch of a load's spectrum.

A fit takes in loads whose spectrum is not the model's: it moves levels, memory and noise until innovations are as white
as they can be. What is left has no peak. Their spectrum is a little low over octaves and a little high over others, and
coefficients are off by more than their intervals say. So levels s_b are averaged over half-octaves b and all channels
within reach of the natural frequencies, where each has ν_b degrees of freedom. By Wilson & Hilferty's cube root

    x_b = (s_b^{1/3} − 1 + 2/9ν_b) √(9ν_b/2),        Σ x_b² is χ² with as many degrees of freedom as half-octaves.

A level that is the same everywhere shifts nothing. So levels are tested, too, over their mean, which has one degree of
freedom less, with ten times the chance: that is a condition and not a test.

Source: Wilson & Hilferty, Proc. Natl. Acad. Sci. 17, 1931, https://doi.org/10.1073/pnas.17.12.684.
"""

import math
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import MAX_COLOUR

__all__ = ["Colour", "smooth_colour"]

HALF_OCTAVE = math.sqrt(2.0)
"""Setting: ratio of the limits of a frequency range."""

MIN_RANGE_BINS = 2
"""Setting: smallest number of frequency bins in a range; narrower ones are joined with the next."""

HANN_CORRELATIONS = ((1, 4.0 / 9.0), (2, 1.0 / 36.0))
"""Numerical: correlation of the powers of bins by their distance, for Hann's window."""


class Colour(NamedTuple):
    """Level of a spectrum of innovations over half-octaves.

    Attributes
    ----------
    statistic, bound
        Σ x², and what chance exceeds with the probability requested.
    slope, slope_bound
        The same of levels over their mean, with ten times that probability.
    size
        Root of the mean squared departure of the level from 1 beyond chance, weighted by what each half-octave tells.
    low_hz, low, high_hz, high
        The lowest and the highest level, and where [Hz].
    """

    statistic: float
    bound: float
    slope: float
    slope_bound: float
    size: float
    low_hz: float
    low: float
    high_hz: float
    high: float

    @property
    def ratio(self) -> float:
        """The least of Σ x², of the slope and of the size over their bounds: beyond 1 a result is not to be trusted."""
        return min(self.statistic / self.bound, self.slope / self.slope_bound, self.size / MAX_COLOUR)


def smooth_colour(
    frequency: Array, spectrum: Array, freedom: float, *, reach: tuple[float, float], chance: float
) -> Colour | None:
    """Compare a spectrum (F, m), 1 for white noise, NaN where a channel has none, with so many degrees of freedom a
    point, with 1 within reach [Hz]; None with less than two half-octaves."""
    from scipy.special import gammainccinv

    inside = np.flatnonzero((frequency >= reach[0]) & (frequency <= reach[1]))
    places: list[float] = []
    levels: list[float] = []
    freedoms: list[float] = []
    while len(inside):
        count = max(int(np.searchsorted(frequency[inside], frequency[inside[0]] * HALF_OCTAVE)), MIN_RANGE_BINS)
        own, inside = inside[:count], inside[count:]
        values = spectrum[own]
        seen = np.isfinite(values)
        if len(own) < MIN_RANGE_BINS or not seen.any():
            continue
        alike = 1.0 + 2.0 * sum(share * max(1.0 - lag / len(own), 0.0) for lag, share in HANN_CORRELATIONS)
        places.append(float(np.sqrt(frequency[own[0]] * frequency[own[-1]])))
        levels.append(float(values[seen].mean()))
        freedoms.append(freedom * float(seen.sum()) / alike)
    if len(levels) < 2:
        return None
    s, nu = np.array(levels), np.array(freedoms)
    x, slopes = (
        (np.cbrt(s / mean) - 1.0 + 2.0 / (9.0 * nu)) * np.sqrt(4.5 * nu)
        for mean in (1.0, float(np.average(s, weights=nu)))
    )
    least, most = int(np.argmin(s)), int(np.argmax(s))
    beyond = float(np.sum(nu * np.square(s - 1.0) - 2.0) / np.sum(nu))
    return Colour(
        statistic=float(x @ x),
        bound=2.0 * float(gammainccinv(0.5 * len(s), chance)),
        slope=float(slopes @ slopes),
        slope_bound=2.0 * float(gammainccinv(0.5 * (len(s) - 1), 10.0 * chance)),
        size=math.sqrt(max(beyond, 0.0)),
        low_hz=places[least],
        low=levels[least],
        high_hz=places[most],
        high=levels[most],
    )

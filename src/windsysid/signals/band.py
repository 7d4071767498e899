"""Filters without phase: a gain in the frequency domain, on the record continued by its own odd reflection.

Missing samples (NaN) are bridged for the transform and missing again afterwards. A cut-off is the power gain of a
fourth-order Butterworth filter, which is that filter run forward and backward.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.errors import RecordError

__all__ = ["band_pass", "bridged", "check_cutoff", "high_pass_gain", "through"]


CUT_OFF_EXPONENT = 8
"""Exponent of f / f_c in the power gain of a cut-off: a fourth-order Butterworth filter run forward and backward."""


def band_pass(values: ArrayLike, rate: float, band: tuple[float, float]) -> Array:
    """Filter a channel with a band-pass of zero phase.

    Parameters
    ----------
    values : array_like
        (T,), any unit; NaN = missing, bridged and missing again in the result.
    rate : float
        Sampling rate [Hz].
    band : (float, float)
        Lowest and highest frequency [Hz], at which the amplitude is halved.

    Returns
    -------
    numpy.ndarray
        (T,), in the unit of `values`, without its mean.

    Raises
    ------
    RecordError
        If the channel holds no numbers or the band does not lie inside 0 … rate / 2.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> time = np.arange(0.0, 60.0, 0.05)
    >>> slow, fast = np.sin(2.0 * np.pi * 0.3 * time), np.sin(2.0 * np.pi * 3.0 * time)
    >>> kept = ws.signals.band_pass(slow + fast, rate=20.0, band=(0.1, 1.0))
    >>> round(float(np.std(kept[200:-200] - slow[200:-200])), 3)
    0.008
    """
    low, high = band
    _check_band(low, high, rate)

    def gain(f: Array) -> Any:
        return high_pass_gain(f, low) / (1.0 + (f / high) ** CUT_OFF_EXPONENT) + 0j

    return through(values, rate, gain, 2.0 / low)


def high_pass_gain(f: Array, cutoff: float) -> Array:
    """Power gain of a fourth-order Butterworth high-pass; written so that f = 0 gives 0."""
    scaled = (f / cutoff) ** CUT_OFF_EXPONENT
    return scaled / (1.0 + scaled)


def _check_band(low: float, high: float, rate: float) -> None:
    """Refuse a band that does not lie inside 0 … rate / 2."""
    if not 0.0 < low < high <= rate / 2.0 * (1.0 + 1e-12):
        raise RecordError(
            f"filter band: expected 0 < low < high ≤ {rate / 2.0:g} Hz (half the sampling rate), got {low:g} to"
            f" {high:g} Hz"
        )


def check_cutoff(cutoff: float, rate: float) -> None:
    """Refuse a cut-off [Hz] that does not lie inside 0 … rate / 2."""
    if not 0.0 < cutoff < rate / 2.0:
        raise RecordError(
            f"cutoff: expected more than 0 and less than {rate / 2.0:g} Hz (half the sampling rate), got {cutoff:g} Hz"
        )


def through(values: ArrayLike, rate: float, gain: Callable[[Array], Any], pad: float) -> Array:
    """Pass `values` (T,) through a gain in the frequency domain, padded by odd reflection over `pad` seconds."""
    values = np.asarray(values, dtype=np.float64)
    missing = ~np.isfinite(values)
    whole = bridged(values, "to filter")
    whole = whole - whole.mean()
    n = min(len(whole) - 1, math.ceil(pad * rate))
    padded = np.concatenate([2.0 * whole[0] - whole[n:0:-1], whole, 2.0 * whole[-1] - whole[-2 : -n - 2 : -1]])
    spectrum = np.fft.rfft(padded) * gain(np.asarray(np.fft.rfftfreq(len(padded), 1.0 / rate), dtype=np.float64))
    filtered = np.fft.irfft(spectrum, len(padded))[n : n + len(whole)]
    filtered[missing] = np.nan
    return filtered


def bridged(values: Array, what: str) -> Array:
    """`values` (T,) with missing samples interpolated linearly."""
    known = np.isfinite(values)
    if not known.any():
        raise RecordError(
            f"channel {what}: expected numbers, got none; leave the channel out or choose another section"
        )
    if known.all():
        return values
    index = np.arange(len(values))
    return np.interp(index, index[known], values[known])

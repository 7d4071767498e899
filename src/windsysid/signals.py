"""Signals: from what was recorded to what the filters take in.

Everything here is for whole records and has zero phase: a gain in the frequency domain, on the record continued by
its own odd
reflection so that its ends do not ring. Missing samples (NaN) are bridged for the transform and missing again
afterwards.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windsysid.errors import RecordError
from windsysid.record import Record

__all__ = ["Motion", "band_pass", "integrate", "rotor_inputs"]

Array = NDArray[np.float64]

_STEEPNESS = 8
"""Exponent of f / f_c in the power gain of a cut-off: a fourth-order Butterworth filter run forward and backward."""


class Motion(NamedTuple):
    """Velocity [m/s or rad/s] and displacement [m or rad] of one channel, (T,) each, both with zero mean."""

    velocity: Array
    displacement: Array


def integrate(acceleration: ArrayLike, rate: float, *, cutoff: float) -> Motion:
    """Integrate acceleration to velocity and displacement without drift.

    Division by iω in the frequency domain is exact for what was sampled (the trapezoidal rule loses (ω Δt)²/12 each
    time), and what lies below `cutoff`, where an accelerometer knows nothing, is taken out.

    Parameters
    ----------
    acceleration
        (T,) [m/s² or rad/s²]; NaN = missing.
    rate
        Samples per second [Hz].
    cutoff
        Frequency [Hz] below which motion is removed: half power, a fourth-order Butterworth slope on either pass.

    Raises
    ------
    RecordError
        If the channel holds no numbers or the cut-off lies outside 0 … rate / 2.
    """
    _check_band(cutoff, rate / 2.0, rate)

    def once(f: Array) -> Any:
        return _high_pass(f, cutoff) / (1j * _angular(f))

    def twice(f: Array) -> Any:
        return -_high_pass(f, cutoff) / _angular(f) ** 2 + 0j

    pad = 2.0 / cutoff
    return Motion(_through(acceleration, rate, once, pad), _through(acceleration, rate, twice, pad))


def band_pass(values: ArrayLike, rate: float, band: tuple[float, float]) -> Array:
    """Keep what lies between two frequencies [Hz], with zero phase; (T,) in, (T,) out.

    Raises
    ------
    RecordError
        If the channel holds no numbers or the band does not lie inside 0 … rate / 2.
    """
    low, high = band
    _check_band(low, high, rate)

    def gain(f: Array) -> Any:
        return _high_pass(f, low) / (1.0 + (f / high) ** _STEEPNESS) + 0j

    return _through(values, rate, gain, 2.0 / low)


def rotor_inputs(record: Record, rotor_speed: float) -> Array:
    """Azimuth ψ (unwrapped), Ω and dΩ/dt of a uniformly sampled record, (T, 3) [rad, rad/s, rad/s²].

    Needs the channel ``rotor_azimuth``; ``rotor_speed`` is used where it is recorded. Missing azimuths are bridged
    by Ω.

    Raises
    ------
    RecordError
        If there is no azimuth, if it does not run forward, or if azimuth and speed contradict each other.
    """
    azimuth = record["rotor_azimuth"]
    time = record.time - record.time[0]
    known = np.isfinite(azimuth)
    if known.sum() < 2:
        raise RecordError(
            "channel 'rotor_azimuth': expected angles, got no numbers; the blades' positions are not known"
        )
    speed = (
        _bridged(record["rotor_speed"], "rotor_speed") if "rotor_speed" in record else np.full_like(time, rotor_speed)
    )
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))])
    offset = np.unwrap((azimuth - turned)[known])
    drift = float(np.polyfit(time[known], offset, 1)[0])
    mean_speed = float(speed.mean())
    if not mean_speed + drift > 0.0:
        raise RecordError(
            f"channel 'rotor_azimuth': expected angles that increase with time, got {mean_speed + drift:.3g} rad/s on average: "
            "count them in the sense of rotation"
        )
    if "rotor_speed" in record and abs(drift) > 0.02 * mean_speed:
        raise RecordError(
            f"rotor_azimuth turns at {mean_speed + drift:.4g} rad/s but rotor_speed says {mean_speed:.4g} rad/s: "
            "check the unit of both channels"
        )
    psi = turned + np.interp(time, time[known], offset)
    if "rotor_speed" not in record:
        speed = _smooth_slope(psi, record.rate)
    return np.column_stack([psi, speed, _smooth_slope(speed, record.rate)])


def _smooth_slope(values: Array, rate: float) -> Array:
    """Slope over one second, by local quadratic least squares (Savitzky & Golay 1964)."""
    if np.ptp(values) < 1e-9 * max(1.0, float(np.abs(values).max())):
        return np.zeros_like(values)
    from scipy.signal import savgol_filter

    window = min(2 * math.ceil(rate / 2.0) + 1, len(values) - (1 - len(values) % 2))
    if window < 5:
        return np.gradient(values, 1.0 / rate)
    return np.asarray(savgol_filter(values, window, 2, deriv=1, delta=1.0 / rate), dtype=np.float64)


def _high_pass(f: Array, cutoff: float) -> Array:
    """Power gain of a fourth-order Butterworth high-pass; written so that f = 0 gives 0."""
    scaled = (f / cutoff) ** _STEEPNESS
    return scaled / (1.0 + scaled)


def _angular(f: Array) -> Array:
    """2π f, with 1 in place of 0, where the high-pass gain is 0 anyway."""
    return np.where(f > 0.0, 2.0 * math.pi * f, 1.0)


def _check_band(low: float, high: float, rate: float) -> None:
    if not 0.0 < low < high <= rate / 2.0 * (1.0 + 1e-12):
        raise RecordError(
            f"filter band: expected 0 < low < high ≤ {rate / 2.0:g} Hz (half the sampling rate), got {low:g} to {high:g} Hz"
        )


def _through(values: ArrayLike, rate: float, gain: Callable[[Array], Any], pad: float) -> Array:
    """`values` (T,) through a gain in the frequency domain, padded by odd reflection over `pad` seconds at either end."""
    values = np.asarray(values, dtype=np.float64)
    missing = ~np.isfinite(values)
    whole = _bridged(values, "to filter")
    whole = whole - whole.mean()
    n = min(len(whole) - 1, math.ceil(pad * rate))
    padded = np.concatenate([2.0 * whole[0] - whole[n:0:-1], whole, 2.0 * whole[-1] - whole[-2 : -n - 2 : -1]])
    spectrum = np.fft.rfft(padded) * gain(np.asarray(np.fft.rfftfreq(len(padded), 1.0 / rate), dtype=np.float64))
    filtered = np.fft.irfft(spectrum, len(padded))[n : n + len(whole)]
    filtered[missing] = np.nan
    return filtered


def _bridged(values: Array, what: str) -> Array:
    """`values` with missing samples interpolated linearly."""
    known = np.isfinite(values)
    if not known.any():
        raise RecordError(
            f"channel {what}: expected numbers, got none; leave the channel out or choose another section"
        )
    if known.all():
        return values
    index = np.arange(len(values))
    return np.interp(index, index[known], values[known])

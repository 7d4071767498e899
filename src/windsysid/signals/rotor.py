"""Azimuth and speed of the rotor from the record: an azimuth channel, an encoder, or pulses.

ψ is the azimuth of blade 1, counter-clockwise from +x looking upwind, the way the rotor turns; blade b sits at
ψ + 2π (b − 1) / N. What a source cannot know is said in the result, in words. The record's own harmonics are a source
too: `windsysid.signals.harmonics`.
"""

import math
from collections.abc import Mapping
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.records.record import Record
from windsysid.signals.azimuth import steadied
from windsysid.signals.band import bridged
from windsysid.signals.textbook import local_parabolas

__all__ = ["RotorMotion", "check_units", "rotor_from_encoder", "rotor_from_pulses", "rotor_inputs", "smooth_slope"]


MAX_STANDING_SPEED = 0.05
"""Mean speed [rad/s] below which the rotor of a parked machine counts as standing: half a revolution per minute."""

MAX_SPEED_FACTOR = 20.0
"""Greatest factor from the turbine's usual rotor speed; beyond it an azimuth is in another unit (degrees: 57 times)."""


class RotorMotion(NamedTuple):
    """Azimuth, speed and acceleration of the rotor.

    Attributes
    ----------
    psi
        Azimuth of blade 1, unwrapped (T,) [rad].
    speed, acceleration
        Ω and dΩ/dt (T,) [rad/s, rad/s²].
    known_up_to_constant
        True if ψ may be off by a constant; Ω is not affected.
    note
        Accuracy of the result, and what the source does not determine, in words.
    """

    psi: Array
    speed: Array
    acceleration: Array
    known_up_to_constant: bool
    note: str

    @property
    def inputs(self) -> Array:
        """(T, 3): result of `rotor_inputs` for a recorded azimuth."""
        return np.column_stack([self.psi, self.speed, self.acceleration])


def rotor_inputs(record: Record, rotor_speed: float) -> Array:
    """Compute the inputs of a `RotorModel` from a uniformly sampled record: azimuth, speed and acceleration.

    It needs the channel ``rotor_azimuth``; ``rotor_speed`` is used where it is recorded. Missing azimuths are bridged
    by Ω; those that scatter about a smooth rotation are smoothed.

    Parameters
    ----------
    record : Record
        Sampled uniformly.
    rotor_speed : float
        The turbine's usual speed [rad/s].

    Returns
    -------
    numpy.ndarray
        (T, 3): ψ, unwrapped [rad], Ω [rad/s], dΩ/dt [rad/s²].

    Raises
    ------
    RecordError
        If there is no azimuth, a unit is wrong, the azimuth of a rotating rotor does not run forward, or it contradicts
        the recorded or the turbine's usual speed.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> time = np.arange(0.0, 60.0, 0.05)
    >>> record = ws.Record(time, (1.2 * time % (2.0 * np.pi))[:, None], ("rotor_azimuth",), ("rad",))
    >>> ws.signals.rotor_inputs(record, rotor_speed=1.25)[600].round(2).tolist()
    [36.0, 1.2, 0.0]
    """
    record = steadied(record)
    azimuth, measured = record["rotor_azimuth"], "rotor_speed" in record
    check_units(record, {"rotor_azimuth": "rad", "rotor_speed": "rad/s"})
    time = record.time - record.time[0]
    known = np.isfinite(azimuth)
    if known.sum() < 2:
        raise RecordError(
            "channel 'rotor_azimuth': expected angles, got no numbers; the blades' positions are not known"
        )
    speed = bridged(record["rotor_speed"], "rotor_speed") if measured else np.full_like(time, rotor_speed)
    turned = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time))])
    offset = np.unwrap((azimuth - turned)[known])
    drift = float(np.polyfit(time[known], offset, 1)[0])
    psi = turned + np.interp(time, time[known], offset)
    _check_rotation(float(speed.mean()), drift, rotor_speed, measured=measured)
    if not measured:
        speed = smooth_slope(psi, record.rate)
    return np.column_stack([psi, speed, smooth_slope(speed, record.rate)])


def check_units(record: Record, units: Mapping[str, str]) -> None:
    """Refuse a record that has one of these channels in another unit."""
    for channel, unit in units.items():
        if channel in record and record.unit(channel) != unit:
            raise RecordError(f"channel '{channel}': expected {unit}, got {record.unit(channel)}: correct its unit")


def _check_rotation(mean_speed: float, drift: float, rotor_speed: float, *, measured: bool) -> None:
    """Refuse an azimuth that turns `drift` faster than the `mean_speed`, `measured` or usual, unless it may stand still
    [rad/s]."""
    parked = rotor_speed == 0.0  # then the turbine says nothing of how fast it turns
    turning = mean_speed + drift
    standing = MAX_STANDING_SPEED if parked else rotor_speed / MAX_SPEED_FACTOR
    if max(abs(mean_speed), abs(turning)) < standing and (parked or measured):
        return  # parked or idling: the azimuth need not run forward
    if not turning > 0.0:
        raise RecordError(
            f"channel 'rotor_azimuth': expected angles that increase with time, got {turning:.3g} rad/s on average:"
            " count them in the direction of rotation"
        )
    if measured and abs(drift) > 0.02 * mean_speed:
        raise RecordError(
            f"rotor_azimuth turns at {turning:.4g} rad/s but rotor_speed says {mean_speed:.4g} rad/s: "
            "check the unit of both channels"
        )
    if not (parked or 1.0 / MAX_SPEED_FACTOR < turning / rotor_speed < MAX_SPEED_FACTOR):
        raise RecordError(
            f"rotor_azimuth turns at {turning:.4g} rad/s, but the turbine's usual speed is {rotor_speed:.4g}"
            " rad/s: check the unit of the azimuth, or the turbine file"
        )


def rotor_from_encoder(
    angle: ArrayLike, rate: float, *, sense: Literal[1, -1] = 1, zero: float | None = None
) -> RotorMotion:
    """Estimate azimuth and speed of the rotor from a shaft encoder.

    Parameters
    ----------
    angle : array_like
        Shaft angle (T,) [rad], wrapped at 2π or not; NaN = missing, bridged at the rotor's mean speed.
    rate : float
        Sampling rate [Hz]: more than two samples per turn.
    sense : {1, -1}, default 1
        −1 for an encoder that counts against the rotation.
    zero : float, optional
        Azimuth of blade 1 [rad] at which the encoder reads 0; None: not known.

    Returns
    -------
    RotorMotion
        Azimuth, speed and acceleration (T,) each.

    Raises
    ------
    RecordError
        If the channel holds no angles, or they do not run in the sense of rotation.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> angle = (1.2 * np.arange(0.0, 60.0, 0.05)) % (2.0 * np.pi)
    >>> found = ws.signals.rotor_from_encoder(angle, 20.0, zero=0.0)
    >>> round(float(found.speed[600]), 3), round(float(found.psi[600]), 2)
    (1.2, 36.0)
    """
    angle = sense * np.atleast_1d(np.asarray(angle, dtype=np.float64))
    known = np.isfinite(angle)
    neighbours = known[1:] & known[:-1]
    if not neighbours.any():
        raise RecordError("encoder: expected angles at consecutive samples, got none; choose another source or section")
    steps = np.mod(np.diff(angle)[neighbours] + np.pi, 2.0 * np.pi) - np.pi
    usual = float(np.median(steps)) * rate
    if not usual > 0.0:
        raise RecordError(f"encoder: expected angles that increase, got {usual:.3g} rad/s; set sense to {-sense}")
    record = Record(
        np.arange(len(angle)) / rate, np.mod(angle, 2.0 * np.pi)[:, None], ("rotor_azimuth",), ("rad",), name="encoder"
    )
    psi, speed, acceleration = rotor_inputs(record, usual).T
    note = f"azimuth from the encoder; {np.count_nonzero(~known)} of {len(angle)} samples were missing and are bridged"
    if zero is None:
        note += "; the encoder's zero is not known: the azimuth is known up to a constant"
    return RotorMotion(psi + (zero or 0.0), speed, acceleration, zero is None, note)


def rotor_from_pulses(values: ArrayLike, rate: float, *, per_turn: int = 1, zero: float | None = None) -> RotorMotion:
    """Estimate azimuth and speed of the rotor from a channel with one or several pulses per turn.

    A pulse begins where the channel rises through the middle between its low and its high level, at a time
    interpolated between samples; it counts once the channel has been below a quarter in between. ψ runs through the
    pulses as a cubic spline, and at constant speed before the first and after the last. Where an interval is a
    multiple of its neighbours, pulses were lost, and are counted.

    Parameters
    ----------
    values : array_like
        (T,), any unit; NaN = missing.
    rate : float
        Sampling rate [Hz].
    per_turn : int, default 1
        Pulses per turn, evenly spaced.
    zero : float, optional
        Azimuth of blade 1 [rad] at the beginning of a pulse; None: not known.

    Returns
    -------
    RotorMotion
        Azimuth, speed and acceleration (T,) each.

    Raises
    ------
    RecordError
        If there are fewer than three pulses, or their intervals are inconsistent.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> pulses = (1.2 * np.arange(0.0, 60.0, 0.05)) % (2.0 * np.pi) < 0.3
    >>> found = ws.signals.rotor_from_pulses(pulses.astype(float), 20.0, zero=0.0)
    >>> round(float(found.speed[600]), 2), found.known_up_to_constant
    (1.2, False)
    """
    if per_turn < 1:
        raise RecordError(f"pulses per turn: expected 1 or more, got {per_turn}")
    times = _pulse_times(np.asarray(values, dtype=np.float64), rate)
    if len(times) < 3:
        raise RecordError(
            f"pulses: expected 3 or more, got {len(times)}; check the channel, or choose a longer section"
        )
    intervals = np.diff(times)
    around = np.array([np.median(intervals[max(0, k - 4) : k + 5]) for k in range(len(intervals))])
    turns = np.rint(intervals / around)
    off = np.abs(intervals / around - turns)
    if np.any(turns < 1.0) or np.any(off > 0.3):
        k = int(np.argmax(np.where(turns < 1.0, 1.0, off)))
        raise RecordError(
            f"pulses: the interval after {times[k]:.6g} s is {intervals[k]:.4g} s, its neighbours take {around[k]:.4g}"
            " s; expected a steady rhythm: clean the channel or choose another section"
        )
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(times, 2.0 * np.pi / per_turn * np.concatenate([[0.0], np.cumsum(turns)]))
    time = np.arange(len(np.asarray(values))) / rate
    inside = np.clip(time, times[0], times[-1])
    speed = np.asarray(spline(inside, 1), dtype=np.float64)
    psi = np.asarray(spline(inside), dtype=np.float64) + speed * (time - inside)
    acceleration = np.where(time == inside, np.asarray(spline(inside, 2), dtype=np.float64), 0.0)
    lost = int(np.sum(turns - 1.0))
    note = f"{len(times)} pulses, {per_turn} per turn, {lost} lost; the azimuth between pulses is interpolated"
    if zero is None:
        where = "at the pulse" if per_turn == 1 else f"at the pulse, and which of the {per_turn} pulses came first,"
        note += f"; the azimuth {where} is not known: the azimuth is known up to a constant"
    elif per_turn > 1:
        note += (
            f"; which of the {per_turn} pulses came first is not known: the azimuth is known up to multiples of"
            f" 1/{per_turn} turn"
        )
    return RotorMotion(psi + (zero or 0.0), speed, acceleration, zero is None or per_turn > 1, note)


def _pulse_times(values: Array, rate: float) -> Array:
    """Times [s] at which `values` rises through half height, each after it has been below a quarter."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 4:
        raise RecordError("pulses: expected numbers, got none; choose another channel")
    y = values[known]
    low, high = float(np.median(y)), float(y.max())
    if high - low < low - float(y.min()):  # high most of the time, with notches for pulses
        y, low, high = -y, -low, -float(y.min())
    if not high > low:
        raise RecordError("pulses: the channel never changes; choose another one")
    middle, quarter = 0.5 * (low + high), low + 0.25 * (high - low)
    # One pass: +1 at samples above the middle, −1 at samples below a quarter, the last of them carried on in between.
    mark = np.where(y >= middle, 1, np.where(y < quarter, -1, 0))
    last = np.maximum.accumulate(np.where(mark != 0, np.arange(len(y)), 0))
    above = mark[last] == 1
    rise = np.flatnonzero(above[1:] & ~above[:-1])
    rise = rise[known[rise + 1] - known[rise] == 1]  # a rise inside a gap has no time
    fraction = (middle - y[rise]) / (y[rise + 1] - y[rise])
    return np.asarray((known[rise] + fraction) / rate, dtype=np.float64)


def smooth_slope(values: Array, rate: float) -> Array:
    """Slope over one second, by local quadratic least squares (Savitzky & Golay 1964)."""
    if np.ptp(values) < 1e-9 * max(1.0, float(np.abs(values).max())):
        return np.zeros_like(values)
    window = min(2 * math.ceil(rate / 2.0) + 1, len(values) - (1 - len(values) % 2))
    if window < 5:
        return np.gradient(values, 1.0 / rate)
    return local_parabolas(values, window, 1, rate)

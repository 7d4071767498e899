"""Tower-fixed horizontal axes turned into the nacelle's, with the yaw signal.

The nacelle points upwind at the compass bearing γ (yaw, clockwise from north as turbines log it, at whatever zero the
`bearing` of the sensors shares). The first axis of the pair points to the bearing b, the second a quarter turn
counter-clockwise from it as seen from above (b = 0: north and west). With e(θ) the horizontal unit vector of bearing θ,

    x = a · e(γ + 90°)      lateral, to the right looking upwind: the package's x
    z = −a · e(γ)           downwind

which keeps x, y up, z right-handed. Only axes turn: yawing is slow, and its own accelerations stay in the reading.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.records.record import Record
from windsysid.signals.band import bridged
from windsysid.signals.rotor import check_units, rotor_inputs
from windsysid.signals.textbook import local_parabolas

__all__ = ["to_nacelle", "tower_inputs", "with_nacelle_axes"]


MAX_STANDING_SPEED_SHARE = 0.02
"""Share of the usual rotor speed below which a rotor stands, and its azimuth says nothing."""

YAW_WINDOW_SECONDS = 10.0
"""Seconds over which a yaw is smoothed: a drive turns half a degree per second for a minute, its signal in steps."""


def to_nacelle(first: ArrayLike, second: ArrayLike, yaw: ArrayLike, *, bearing: float = 0.0) -> tuple[Array, Array]:
    """Transform a tower-fixed pair of channels to nacelle axes, lateral x and downwind z.

    Parameters
    ----------
    first, second : array_like
        Components (T,) along the bearing b and a quarter turn counter-clockwise from it, in any unit; NaN = missing, in
        both results.
    yaw : array_like
        Nacelle's compass bearing (T,) [rad], wrapped anywhere; missing values are bridged along the shorter arc.
    bearing : float, default 0
        b [rad], clockwise from the yaw signal's zero.

    Returns
    -------
    lateral, downwind
        x and z (T,) each, in the pair's unit.

    Raises
    ------
    RecordError
        If shapes differ or the yaw holds no numbers.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> north, west, yaw = np.ones(2), np.zeros(2), np.radians([0.0, 30.0])
    >>> lateral, downwind = ws.signals.to_nacelle(north, west, yaw)
    >>> lateral.round(3).tolist(), downwind.round(3).tolist()
    ([0.0, -0.5], [-1.0, -0.866])
    """
    u1, u2, gamma = (np.asarray(values, dtype=np.float64) for values in (first, second, yaw))
    if not (u1.ndim == 1 and u1.shape == u2.shape == gamma.shape):
        raise RecordError(f"expected two axes and a yaw of one shape (T,), got {u1.shape}, {u2.shape}, {gamma.shape}")
    turn = bearing - _unwrapped(gamma)
    cos, sin = np.cos(turn), np.sin(turn)
    return u1 * sin - u2 * cos, -u1 * cos - u2 * sin


def with_nacelle_axes(
    record: Record, first: str, second: str, *, yaw: str = "nacelle_yaw", bearing: float = 0.0, point: str = "tower"
) -> Record:
    """Add ``<point>_x_<quantity>`` and ``<point>_z_<quantity>`` to a record, from two tower-fixed channels.

    Parameters
    ----------
    record : Record
        With both channels and the yaw.
    first, second : str
        Channels along the bearing b and a quarter turn counter-clockwise from it; the quantity is the last word of
        `first`.
    yaw : str, default "nacelle_yaw"
        Channel of the nacelle's bearing [rad].
    bearing : float, default 0
        b [rad], clockwise from the yaw signal's zero.
    point : str, default "tower"
        First word of the names of the new channels.

    Returns
    -------
    Record
        With two channels more.

    Raises
    ------
    RecordError
        If a channel is missing, units differ, the yaw is no angle, or a channel of that name is there already.

    See Also
    --------
    to_nacelle : The transformation itself.

    Examples
    --------
    >>> import numpy as np
    >>> import windsysid as ws
    >>> time = np.arange(0.0, 10.0, 0.1)
    >>> values = np.column_stack([np.sin(time), np.cos(time), np.zeros_like(time)])
    >>> names, units = ("north_acceleration", "west_acceleration", "nacelle_yaw"), ("m/s^2", "m/s^2", "rad")
    >>> record = ws.Record(time, values, names, units)
    >>> ws.signals.with_nacelle_axes(record, "north_acceleration", "west_acceleration").channels[-2:]
    ('tower_x_acceleration', 'tower_z_acceleration')
    """
    if record.unit(first) != record.unit(second):
        raise RecordError(
            f"channels '{first}' and '{second}': expected one unit, got {record.unit(first)} and {record.unit(second)}"
        )
    check_units(record, {yaw: "rad"})
    quantity = first.rsplit("_", 1)[-1]
    names = (f"{point}_x_{quantity}", f"{point}_z_{quantity}")
    for name in names:
        if name in record:
            raise RecordError(f"the record has a channel '{name}' already: rename it, or choose another point")
    turned = to_nacelle(record[first], record[second], record[yaw], bearing=bearing)
    unit = record.unit(first)
    return record.with_channels({name: (values, unit) for name, values in zip(names, turned, strict=True)})


def tower_inputs(record: Record, rotor_speed: float, *, needs_yaw: bool) -> Array:
    """Compute the inputs of a `TowerModel` from a uniformly sampled record: azimuth and speed of the rotor, and yaw.

    The azimuth is the record's, or else its ``rotor_speed`` integrated from an unknown start, or else that of the usual
    `rotor_speed` [rad/s]. The yaw is the channel ``nacelle_yaw``, smoothed by local parabolas over ten seconds, or
    else constant.

    Parameters
    ----------
    record : Record
        Sampled uniformly.
    rotor_speed : float
        The turbine's usual speed [rad/s].
    needs_yaw : bool
        True if a sensor is fixed to the tower.

    Returns
    -------
    numpy.ndarray
        (T, 5): ψ [rad], Ω [rad/s], γ [rad], γ̇ [rad/s], γ̈ [rad/s²].

    Raises
    ------
    RecordError
        If `needs_yaw` and the record has no yaw; or a unit or an azimuth is wrong.

    Examples
    --------
    >>> import windsysid as ws
    >>> record = ws.simulate("tower", duration=60.0, rate=20.0)
    >>> ws.signals.tower_inputs(record, rotor_speed=1.267, needs_yaw=False).shape
    (1200, 5)
    """
    check_units(record, {"rotor_speed": "rad/s", "nacelle_yaw": "rad"})
    inputs = np.zeros((record.samples, 5))
    known = "rotor_speed" in record and bool(np.isfinite(record["rotor_speed"]).any())
    speed = bridged(record["rotor_speed"], "rotor_speed") if known else np.full(record.samples, rotor_speed)
    turns = abs(float(speed.mean())) > MAX_STANDING_SPEED_SHARE * rotor_speed
    if turns and "rotor_azimuth" in record and np.isfinite(record["rotor_azimuth"]).sum() > 1:
        inputs[:, :2] = rotor_inputs(record, rotor_speed)[:, :2]
    else:
        turned = 0.5 * (speed[1:] + speed[:-1]) * np.diff(record.time)
        inputs[:, 0], inputs[:, 1] = np.concatenate([[0.0], np.cumsum(turned)]), speed
    if "nacelle_yaw" in record:
        inputs[:, 2:] = _smooth(_unwrapped(record["nacelle_yaw"]), record.rate)
    elif needs_yaw:
        raise RecordError(
            f"{record.name}: expected a channel 'nacelle_yaw' [rad], since a sensor is fixed to the tower, got"
            f" {', '.join(record.channels)}; add the yaw, or list sensors in the frame 'nacelle'"
        )
    return inputs


def _unwrapped(yaw: Array) -> Array:
    """A yaw (T,) without jumps, missing values bridged the shorter way round."""
    known = np.isfinite(yaw)
    if not known.any():
        raise RecordError("yaw: expected angles, got no numbers; leave the axes as they are or choose another section")
    index = np.arange(len(yaw))
    return np.interp(index, index[known], np.unwrap(yaw[known]))


def _smooth(yaw: Array, rate: float) -> Array:
    """Yaw, its rate and its acceleration (T, 3), by local quadratic least squares (Savitzky & Golay 1964)."""
    window = min(2 * math.ceil(YAW_WINDOW_SECONDS * rate / 2.0) + 1, len(yaw) - (1 - len(yaw) % 2))
    if np.ptp(yaw) == 0.0 or window < 5:
        return np.column_stack([yaw, np.zeros((len(yaw), 2))])
    return np.column_stack([local_parabolas(yaw, window, order, rate) for order in (0, 1, 2)])

"""Tower-fixed horizontal axes turned into the nacelle's, with the yaw signal.

The nacelle points upwind at the compass bearing γ (yaw, clockwise from north as turbines log it, at whatever zero the
`bearing` of the sensors shares). The first axis of the pair points to the bearing b, the second a quarter turn
counter-clockwise from it as seen from above (b = 0: north and west). With e(θ) the horizontal unit vector of bearing θ,

    x = a · e(γ + 90°)      lateral, to the right looking upwind: the package's x
    z = −a · e(γ)           downwind

which keeps x, y up, z right-handed. Only axes turn: yawing is slow, and its own accelerations stay in the reading.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windsysid.errors import RecordError
from windsysid.record import Record

__all__ = ["to_nacelle", "with_nacelle_axes"]

Array = NDArray[np.float64]


def to_nacelle(first: ArrayLike, second: ArrayLike, yaw: ArrayLike, *, bearing: float = 0.0) -> tuple[Array, Array]:
    """A tower-fixed pair (T,) in nacelle axes: lateral x and downwind z, (T,) each, in the pair's unit.

    Parameters
    ----------
    first, second
        Components (T,) along the bearing b and a quarter turn counter-clockwise from it; NaN = missing, in both results.
    yaw
        Nacelle's compass bearing (T,) [rad], wrapped anywhere; missing values are bridged the shorter way round.
    bearing
        b [rad], clockwise from the yaw signal's zero.

    Raises
    ------
    RecordError
        If shapes differ or the yaw holds no numbers.
    """
    u1, u2, gamma = (np.asarray(values, dtype=np.float64) for values in (first, second, yaw))
    if not (u1.ndim == 1 and u1.shape == u2.shape == gamma.shape):
        raise RecordError(f"expected two axes and a yaw of one shape (T,), got {u1.shape}, {u2.shape}, {gamma.shape}")
    known = np.isfinite(gamma)
    if not known.any():
        raise RecordError("yaw: expected angles, got no numbers; leave the axes tower-fixed or choose another section")
    index = np.arange(len(gamma))
    turn = bearing - np.interp(index, index[known], np.unwrap(gamma[known]))
    cos, sin = np.cos(turn), np.sin(turn)
    return u1 * sin - u2 * cos, -u1 * cos - u2 * sin


def with_nacelle_axes(
    record: Record, first: str, second: str, *, yaw: str = "nacelle_yaw", bearing: float = 0.0, point: str = "tower"
) -> Record:
    """The record with ``<point>_x_<quantity>`` and ``<point>_z_<quantity>`` made from two tower-fixed channels.

    Parameters
    ----------
    first, second
        Channels along the bearing b and a quarter turn counter-clockwise from it; the quantity is the last word of `first`.
    yaw
        Channel of the nacelle's bearing [rad].
    bearing
        b [rad].

    Raises
    ------
    RecordError
        If a channel is missing, units differ, the yaw is no angle, or a channel of that name is there already.
    """
    if record.unit(first) != record.unit(second):
        raise RecordError(
            f"channels '{first}' and '{second}': expected one unit, got {record.unit(first)} and {record.unit(second)}"
        )
    if record.unit(yaw) != "rad":
        raise RecordError(f"channel '{yaw}': expected rad, got {record.unit(yaw)}: correct its unit")
    quantity = first.rsplit("_", 1)[-1]
    names = (f"{point}_x_{quantity}", f"{point}_z_{quantity}")
    for name in names:
        if name in record:
            raise RecordError(f"the record has a channel '{name}' already: rename it, or choose another point")
    turned = to_nacelle(record[first], record[second], record[yaw], bearing=bearing)
    unit = record.unit(first)
    return record.with_channels({name: (values, unit) for name, values in zip(names, turned, strict=True)})

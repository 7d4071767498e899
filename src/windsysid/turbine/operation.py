"""State of a turbine during a record: parked, idling, running, or on the way from one to another.

The rotor speed tells, as a share of the turbine's usual one; where the power is known it tells idling from running,
since a rotor may idle as fast as it runs in little wind.
"""

import math
from typing import NamedTuple

import numpy as np

from windsysid._types import Array

__all__ = ["MIN_RUNNING_SPEED_SHARE", "STATES", "Operation", "operation", "operation_of"]

STATES = ("parked", "idling", "running", "transient", "unknown")

MAX_PARKED_SPEED_SHARE = 0.1
"""Share of the usual rotor speed below which a rotor is parked; inspection of stops takes the same."""

MIN_RUNNING_SPEED_SHARE = 0.4
"""Share of the usual rotor speed above which a rotor runs, where the power is not known."""

MAX_STEADY_SPEED_CHANGE = 0.35
"""Share of the usual rotor speed by which it may vary in a record; a start or a stop varies it more."""

SPEED_BIN_COUNT = 10
"""Bins of rotor speed in the usual one."""


class Operation(NamedTuple):
    """Rotation of the rotor.

    Attributes
    ----------
    state
        One of `STATES`.
    speed_bin
        Lower edge of the bin of the mean rotor speed, as a share of the usual one in tenths; None where it is not
        known.
    mean, low, high
        Rotor speed [rad/s]; None where it is not known.
    """

    state: str
    speed_bin: float | None = None
    mean: float | None = None
    low: float | None = None
    high: float | None = None


def operation_of(speed: Array | None, usual: float, power: float | None = None) -> Operation:
    """The state of a record.

    Parameters
    ----------
    speed
        (T,) rotor speed [rad/s]; None where nothing says it.
    usual
        The turbine's usual rotor speed [rad/s].
    power
        Mean electrical power [W], where it is known.
    """
    known = np.empty(0) if speed is None else np.abs(speed[np.isfinite(speed)])
    if not known.size or usual <= 0.0:
        return Operation("unknown")
    return operation(float(known.mean()), float(known.min()), float(known.max()), usual, power)


def operation(mean: float, low: float, high: float, usual: float, power: float | None) -> Operation:
    """The state by mean and range of a rotor speed without its sign, and by the power, as `operation_of`."""
    share = mean / usual
    passes = low < MAX_PARKED_SPEED_SHARE * usual and high > MIN_RUNNING_SPEED_SHARE * usual
    if passes or high - low > MAX_STEADY_SPEED_CHANGE * usual:
        state = "transient"
    elif share < MAX_PARKED_SPEED_SHARE:
        state = "parked"
    elif power is not None:
        state = "running" if power > 0.0 else "idling"
    else:
        state = "running" if share > MIN_RUNNING_SPEED_SHARE else "idling"
    return Operation(state, math.floor(SPEED_BIN_COUNT * share + 1e-9) / SPEED_BIN_COUNT, mean, low, high)

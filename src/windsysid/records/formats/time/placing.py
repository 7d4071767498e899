"""Positions of the samples of a slower series in the table of a faster one.

Nothing is interpolated and nothing moves: a slower series joins where each of its times is a time of the faster one, to
a thousandth of a step, and where it begins and ends within one of its own steps of the faster one. A series of the same
rate that is shorter was cut, and does not join.
"""

import numpy as np
import numpy.typing as npt

from windsysid.records.checks import MAX_OFF_STEPS, Array

__all__ = ["Rows", "coinciding"]

Rows = npt.NDArray[np.int64]

_MIN_SLOWER_RATIO = 1.5  # times as long is the step of a slower series at least


def coinciding(time: Array, slower: Array) -> Rows | None:
    """The rows of `time` (T,) [s] at which the times `slower` (n,) [s] stand; None where they do not.

    Both must increase.
    """
    if min(time.size, slower.size) < 2 or not np.isfinite(slower).all():
        return None
    step, long = float(np.median(np.diff(time))), float(np.median(np.diff(slower)))
    rows = np.minimum(np.searchsorted(time, slower - 0.5 * step), time.size - 1).astype(np.int64)
    meets = np.max(np.abs(time[rows] - slower)) <= MAX_OFF_STEPS * step and bool(np.all(np.diff(rows) > 0))
    within = (1.0 + MAX_OFF_STEPS) * long
    lasts = abs(slower[0] - time[0]) < within and abs(time[-1] - slower[-1]) < within
    return rows if meets and lasts and long >= _MIN_SLOWER_RATIO * step else None

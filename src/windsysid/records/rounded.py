"""Regular sampling behind time stamps that are written with few digits.

A stamp with few digits is a multiple of a quantum q: the sampling time, rounded or cut. If the rows n of a file were
taken at a + n·h, every stamp lies within an interval of width q about its row's time. Conversely, a step h for which
all stamps lie in such an interval explains them all by rounding; stamps that scatter by more than q have none.
"""

from typing import NamedTuple

import numpy as np

from windsysid._types import Array

__all__ = ["RoundedGrid", "is_coarse", "rounded_grid"]

UNIT_SECONDS = (86_400.0, 3600.0, 60.0, 1.0)
"""Units [s] whose decimal fractions stamps are multiples of."""

MAX_DECIMALS = 9

MIN_QUANTUM_STEPS = 0.1
"""Quantum, in steps of the grid, below which rounding does no harm: rows are taken to a grid from that distance."""

MIN_ROWS = 16
"""Rows that show a grid at least."""

MIN_ODD_STEPS = 8
"""Steps of stamps that differ from the usual one, below which single rows were lost or written twice."""

FIRST_ROWS = 64
"""Rows in succession, none lost, from which the step is estimated first."""

MAX_LOST_SHARE = 0.1
"""Share of lost rows above which stamps may have been rounded another way."""

_SLACK = 1e-3  # of the quantum, for numbers that were computed
_HALVINGS = 60


class RoundedGrid(NamedTuple):
    """Beginning [s] and step [s] of a regular grid, and each row's place on it (T,), the first at 0."""

    begin: float
    step: float
    places: Array


def is_coarse(time: Array) -> bool:
    """Test whether times (T,) are multiples of a quantum that is a large part of their step, and not equidistant."""
    steps = np.diff(time)
    if len(time) < MIN_ROWS or not np.isfinite(time).all() or np.any(steps < 0.0) or not steps.any():
        return False
    if np.ptp(steps) <= MIN_QUANTUM_STEPS * float(np.mean(steps)):
        return False
    return _quantum(time) > MIN_QUANTUM_STEPS * float(np.median(steps))


def rounded_grid(time: Array) -> RoundedGrid | None:
    """The regular grid from which all stamps (T,) [s] differ only by the rounding to their digits.

    Parameters
    ----------
    time : ndarray (T,)
        Stamps [s], none smaller than the one before.

    Returns
    -------
    Grid or None
        The grid without lost rows if there is one, otherwise that with few of them; None if rounding does not explain
        the stamps, or if they lie on a grid as they are.
    """
    if len(time) < MIN_ROWS:
        return None
    quantum, steps = _quantum(time), np.diff(time)
    if np.count_nonzero(np.abs(steps - np.median(steps)) > 0.5 * quantum) < MIN_ODD_STEPS:
        return None
    counted = np.arange(len(time), dtype=np.float64)
    elapsed = time - time[0]
    grid = counted if _fits(elapsed, counted, quantum) else _with_losses(elapsed, quantum)
    if grid is None:
        return None
    step = _step(elapsed, grid)
    off = elapsed - step * grid
    if quantum < MIN_QUANTUM_STEPS * step or np.ptp(off) <= _SLACK * quantum:
        return None
    return RoundedGrid(float(time[0]) + _beginning(off, quantum, step), step, grid)


def _quantum(time: Array) -> float:
    """The coarsest decimal fraction [s] of a unit of which all differences of times are multiples; 0 if none is."""
    elapsed = np.abs(time - time[0])
    doubt = 8.0 * np.spacing(float(np.max(np.abs(time)))) + 2e-9  # moments are kept to 1 ns
    candidates = sorted((unit * 10.0**-k for unit in UNIT_SECONDS for k in range(MAX_DECIMALS + 1)), reverse=True)
    for quantum in candidates:
        if quantum < 50.0 * doubt:
            break
        for part in (elapsed[:FIRST_ROWS], elapsed):
            if np.any(np.abs(part - quantum * np.rint(part / quantum)) > doubt):
                break
        else:
            return quantum
    return 0.0


def _step(elapsed: Array, index: Array) -> float:
    """The step [s] about which elapsed times (T,) [s] of rows at `index` have the smallest range.

    The range is convex in the step: the search halves its interval by the range's slope.
    """
    span = float(index[-1] - index[0])
    mean = float(elapsed[-1] - elapsed[0]) / span
    half = float(np.ptp(elapsed - mean * index)) / span
    low, high = mean - 2.0 * half, mean + 2.0 * half
    for _ in range(_HALVINGS):
        step = 0.5 * (low + high)
        off = elapsed - step * index
        if index[np.argmax(off)] < index[np.argmin(off)]:
            high = step
        else:
            low = step
        if high - low <= 1e-15 * mean:
            break
    return 0.5 * (low + high)


def _fits(elapsed: Array, index: Array, quantum: float) -> bool:
    """Test whether a step exists with all times within one quantum of a straight line."""
    if not elapsed[-1] > elapsed[0]:
        return False
    off = elapsed - _step(elapsed, index) * index
    return bool(np.ptp(off) <= (1.0 + _SLACK) * quantum)


def _with_losses(elapsed: Array, quantum: float) -> Array | None:
    """The places of rows (T,) some of which are lost: from rows in succession on, over ever longer parts."""
    rows = len(elapsed)
    counted = np.arange(rows, dtype=np.float64)
    for low in range(0, max(1, rows - FIRST_ROWS), FIRST_ROWS):
        high = min(low + FIRST_ROWS, rows)
        if _fits(elapsed[low:high], counted[low:high], quantum):
            return _extended(elapsed, quantum, low, high)
        if low >= 20 * FIRST_ROWS:
            break
    return None


def _extended(elapsed: Array, quantum: float, low: int, high: int) -> Array | None:
    """The places of all rows from those of rows low to high, which are in succession."""
    rows, index = len(elapsed), np.arange(high - low, dtype=np.float64)
    while True:
        part = elapsed[low:high]
        step = _step(part, index)
        off = part - step * index
        if np.ptp(off) > (1.0 + _SLACK) * quantum:
            return None
        if (low, high) == (0, rows):
            break
        middle = 0.5 * float(np.max(off) + np.min(off))
        low, high = max(0, low - (high - low) // 2), min(rows, high + (high - low))
        index = np.rint((elapsed[low:high] - middle) / step)
        if np.any(np.diff(index) < 1.0):
            return None
    lost = index[-1] - index[0] + 1 - rows
    return index - index[0] if lost <= MAX_LOST_SHARE * rows else None


def _beginning(off: Array, quantum: float, step: float) -> float:
    """When the first row was taken, after its stamp [s]: at it where possible; stamps that rows share are cut."""
    low, high = float(np.max(off)), float(np.min(off)) + quantum  # for stamps that are cut
    half, slack = 0.5 * quantum, _SLACK * quantum
    if low - slack <= 0.0 <= high + slack or low - slack <= half <= high + slack:
        return 0.0
    return 0.5 * (low + high) - (0.0 if step < quantum else half)

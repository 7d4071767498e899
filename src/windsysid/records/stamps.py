"""Time stamps that scatter: whether readings were taken at their stamps, or on a regular grid that stamps blur.

An instrument's converter ticks regularly, and a computer that is busy stamps what it reads late or early. Both kinds of
record look alike in their times; they differ in how well each reading continues its neighbours.
"""

import itertools
import math

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from windsysid._types import Array

__all__ = ["MIN_LOG_LIKELIHOOD_GAIN", "count_lost_rows", "grid_behind", "grid_log_odds", "rhythm", "usual_step"]

MIN_LOG_LIKELIHOOD_GAIN = 8.0
"""Log likelihood by which readings have to be smoother on the grid than at their stamps."""

MAX_STEP_ERROR = 0.02
"""Share by which the step of a grid may be off at first."""

FIRST_SAMPLES = 256
"""Samples at the beginning from which the step of a grid is taken first."""

MAX_END_STEPS = 5.0
"""Steps by which the last stamp may be off the grid of counted samples."""

STEPS_PER_RESOLUTION = 4
"""Steps that are tried for each one that times tell apart."""

MAX_SQUARE_RATIO = 100.0
"""Of the median square, beyond which a reading tells no more: one spike would speak for the whole channel."""

MIN_SHIFT_ROWS = 1.5
"""Smallest shift of stamps [rows] that counts as a loss of rows: rounding alone causes a shift of one row."""

MIN_SHIFT_SIGMAS = 6.0
"""Smallest shift of stamps in standard deviations of their scatter: exceeded with probability 1e-9 per packet if the
scatter is normal."""

SHIFT_WINDOW_STAMPS = 11
"""Number of stamps before and after a shift whose medians are compared."""

LOSS_WINDOW_STAMPS = 50
"""Number of stamps before and after a shift whose means give the number of lost rows: stamps that are rounded to a step
have a standard deviation of 0.3 rows."""

_ROUNDING = 1e-18

_STENCIL = np.array([-2, -1, 1, 2])


def grid_behind(time: Array, values: Array, step: float) -> tuple[float, float, Array] | None:
    """The regular grid on which readings were taken though their time stamps scatter about it.

    Parameters
    ----------
    time : ndarray (T,)
        Time stamps [s].
    values : ndarray (T, m)
        NaN = missing; angles unwrapped.
    step : float
        Of the grid [s], nearly.

    Returns
    -------
    tuple of float, float and ndarray (T,), or None
        The grid's beginning [s] and step [s], and the place of each sample on it; None where two samples fall on one
        place though some were lost, or where readings are not clearly smoother there than at their stamps.
    """
    begin, step = rhythm(time, step)
    for _ in range(2):
        index = np.rint((time - begin) / step)
        step, begin = map(float, np.polyfit(index, time, 1))
    if np.any(np.diff(index) < 1.0) or np.any(np.abs(time - begin - step * index) > 0.5 * step):
        counted = np.arange(len(time))  # stamps are late by more than a step now and then
        lost = count_lost_rows(time - step * counted, step)
        if lost is None:
            return None
        index = (counted + np.cumsum(lost)).astype(np.float64)
        if abs((time[-1] - time[0]) / step - index[-1]) > MAX_END_STEPS:
            return None
        step, begin = map(float, np.polyfit(index, time, 1))
    said = grid_log_odds(time, begin + step * index, values)
    if said.sum() < MIN_LOG_LIKELIHOOD_GAIN or np.any(said < -MIN_LOG_LIKELIHOOD_GAIN):
        return None
    return begin + step * float(index[0]), step, index - index[0]


def grid_log_odds(time: Array, grid: Array, values: Array) -> Array:
    """Log odds, by each channel with readings (m,), of sampling at the times `grid` (T,) [s] against the stamps."""
    values = values[:, np.isfinite(values).any(axis=0)]
    return _log_ratio(_roughness(time, values), _roughness(grid, values))


def usual_step(time: Array) -> float:
    """Mean [s] of the steps that differ from the median by less than half of it; of all steps if the median is zero.

    Rounded times scatter about the grid, so that the median alone would be wrong by that scatter.
    """
    steps = np.diff(time)
    median = np.median(steps)
    if median == 0.0:  # most times are repeated
        return float(np.mean(steps))
    near = steps[np.abs(steps - median) < 0.5 * median]
    return float(np.mean(near)) if near.size else float(median)


def rhythm(time: Array, step: float) -> tuple[float, float]:
    """First time and step [s] of the grid that fits times best, near a given step.

    The step maximises Rayleigh's periodogram (the length of the sum of phases) over increasing parts of the record.
    """
    reach, samples = MAX_STEP_ERROR, FIRST_SAMPLES
    while True:
        elapsed = time[:samples] - time[0]
        steps = step * (1.0 + np.linspace(-reach, reach, 2 * math.ceil(STEPS_PER_RESOLUTION * reach * samples) + 1))
        sums = [np.sum(np.exp(2j * np.pi / one * elapsed)) for one in steps]
        best = int(np.argmax(np.abs(sums)))
        step = float(steps[best])
        if samples >= len(time):
            return float(time[0] + step * np.angle(sums[best]) / (2.0 * np.pi)), step
        reach, samples = 1.0 / samples, 4 * samples


def count_lost_rows(off: Array, step: float) -> npt.NDArray[np.int64] | None:
    """Count the rows missing before each packet (n,), from the offsets [s] of its stamps from evenly counted times.

    None if stamps are shifted backwards.
    """
    lost = np.zeros(len(off), dtype=np.int64)
    if len(off) < 2 * SHIFT_WINDOW_STAMPS:
        return lost
    medians = np.median(sliding_window_view(off, SHIFT_WINDOW_STAMPS), axis=1)
    shift = np.zeros(len(off))
    shift[SHIFT_WINDOW_STAMPS : 1 - SHIFT_WINDOW_STAMPS] = (
        medians[SHIFT_WINDOW_STAMPS:] - medians[:-SHIFT_WINDOW_STAMPS]
    )
    scatter = 1.4826 * float(np.median(np.abs(shift - np.median(shift))))
    clear = np.flatnonzero(np.abs(shift) > max(MIN_SHIFT_ROWS * step, MIN_SHIFT_SIGMAS * scatter))
    if not clear.size:
        return lost
    jump = np.diff(off, prepend=off[0])
    groups = np.split(clear, 1 + np.flatnonzero(np.diff(clear) > 1))
    at = np.array([group[np.argmax(np.abs(jump[group]))] for group in groups])
    edges = np.concatenate([[0], at, [len(off)]])
    for low, k, high in zip(edges[:-2], at, edges[2:], strict=True):
        lost[k] = round(
            float(
                np.mean(off[k : min(high, k + LOSS_WINDOW_STAMPS)]) - np.mean(off[max(low, k - LOSS_WINDOW_STAMPS) : k])
            )
            / step
        )
    return _without_late_stamps(lost)


def _without_late_stamps(lost: npt.NDArray[np.int64]) -> npt.NDArray[np.int64] | None:
    """Lost rows (n,) without shifts that are reversed soon after; None if a reversed shift remains."""
    changes = np.flatnonzero(lost)
    for before, k in itertools.pairwise(changes):
        if lost[k] < 0 and k - before < LOSS_WINDOW_STAMPS and lost[before] + lost[k] >= 0:
            lost[before], lost[k] = lost[before] + lost[k], 0
    return None if np.any(lost < 0) else lost


def _log_ratio(at_stamps: Array, on_grid: Array) -> Array:
    """Log-likelihood ratio of the grid against the stamps, by each channel (m,)."""
    samples = np.sum(np.isfinite(on_grid), axis=0) / (1 + _STENCIL.size)  # neighbours share their readings
    told = samples > 0.0
    ratio = np.zeros(len(samples))
    squares = [np.square(one[:, told]) for one in (at_stamps, on_grid)]
    power = [
        np.nanmean(np.minimum(one, MAX_SQUARE_RATIO * np.nanmedian(one, axis=0)), axis=0) + _ROUNDING for one in squares
    ]
    ratio[told] = 0.5 * samples[told] * np.log(power[0] / power[1])
    return ratio


def _roughness(time: Array, values: Array) -> Array:
    """Distance of each reading from the cubic through its four neighbours (T − 4, m): in standard deviations that
    unit noise gives it, and as a share of the channel's large readings."""
    inner = np.arange(2, len(time) - 2)
    size = np.nanpercentile(np.abs(values), 99.0, axis=0)
    values = values / np.where(size > 0.0, size, 1.0)
    nodes = time[inner[:, None] + _STENCIL] - time[inner, None]
    weights = np.ones_like(nodes)  # Lagrange's, at 0
    for i in range(_STENCIL.size):
        for j in range(_STENCIL.size):
            if i != j:
                weights[:, i] *= nodes[:, j] / (nodes[:, j] - nodes[:, i])
    off = values[inner].copy()
    for i, place in enumerate(_STENCIL.tolist()):
        off -= weights[:, i, None] * values[inner + place]
    return np.asarray(off / np.sqrt(1.0 + np.sum(np.square(weights), axis=1))[:, None])

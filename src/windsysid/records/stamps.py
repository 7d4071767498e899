"""Time stamps that scatter: whether readings were taken at their stamps, or on a regular grid that stamps blur.

An instrument's converter ticks regularly, and a computer that is busy stamps what it reads late or early. Both kinds of
record look alike in their times; they differ in how well each reading continues its neighbours.
"""

import math

import numpy as np

from windsysid._types import Array

__all__ = ["grid_behind", "near_step", "rhythm"]

ENOUGH = 8.0
"""Log likelihood by which readings have to be smoother on the grid than at their stamps."""

NEAR = 0.02
"""Share by which the step of a grid may be off at first."""

FIRST = 256
"""Samples at the beginning from which the step of a grid is taken first."""

LATE = 5.0
"""Steps by which the last stamp may be off where no sample was lost."""

FINER = 4
"""Steps that are tried for each one that times tell apart."""

SPIKE = 100.0
"""Of the median square, beyond which a reading tells no more: one spike would speak for the whole channel."""

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
        index = np.arange(len(time), dtype=np.float64)  # stamps are late by more than a step now and then
        if abs((time[-1] - time[0]) / step - index[-1]) > LATE:
            return None
        step, begin = map(float, np.polyfit(index, time, 1))
    values = values[:, np.isfinite(values).any(axis=0)]
    said = _log_ratio(_roughness(time, values), _roughness(begin + step * index, values))
    if said.sum() < ENOUGH or np.any(said < -ENOUGH):
        return None
    return begin + step * float(index[0]), step, index - index[0]


def near_step(time: Array) -> float:
    """Mean [s] of the steps that are nearer to the median step than to a gap: times written with few digits scatter
    about the step, so that the median alone is wrong by that scatter."""
    steps = np.diff(time)
    median = np.median(steps)
    near = steps[np.abs(steps - median) < 0.5 * median]
    return float(np.mean(near)) if near.size else float(median)


def rhythm(time: Array, step: float) -> tuple[float, float]:
    """Beginning and step [s] of the grid that times keep to best, near a step: where the sum of their phases is longest
    (Rayleigh's periodogram), over ever longer parts from the beginning on."""
    reach, samples = NEAR, FIRST
    while True:
        elapsed = time[:samples] - time[0]
        steps = step * (1.0 + np.linspace(-reach, reach, 2 * math.ceil(FINER * reach * samples) + 1))
        sums = [np.sum(np.exp(2j * np.pi / one * elapsed)) for one in steps]
        best = int(np.argmax(np.abs(sums)))
        step = float(steps[best])
        if samples >= len(time):
            return float(time[0] + step * np.angle(sums[best]) / (2.0 * np.pi)), step
        reach, samples = 1.0 / samples, 4 * samples


def _log_ratio(at_stamps: Array, on_grid: Array) -> Array:
    """How much likelier the grid is than the stamps, by each channel (m,): the logarithm of a ratio of likelihoods."""
    samples = np.sum(np.isfinite(on_grid), axis=0) / (1 + _STENCIL.size)  # neighbours share their readings
    told = samples > 0.0
    ratio = np.zeros(len(samples))
    squares = [np.square(one[:, told]) for one in (at_stamps, on_grid)]
    power = [np.nanmean(np.minimum(one, SPIKE * np.nanmedian(one, axis=0)), axis=0) + _ROUNDING for one in squares]
    ratio[told] = 0.5 * samples[told] * np.log(power[0] / power[1])
    return ratio


def _roughness(time: Array, values: Array) -> Array:
    """How far each reading lies from the cubic through its four neighbours (T − 4, m): in standard deviations that
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

"""Narrow-band loads that were taken for a mode.

A machine nearby, waves or a neighbour's mode push at frequencies of their own. Where such a load is beside a well
damped mode, its peak is the narrower one, and a search that knows smooth loads only may take it for the mode and the
mode for a hump of the loads: the filters' innovations are white then. So two ways to explain the periodogram I_j of one
channel around a mode are held against each other, both with the file's prior of the mode's stiffness and damping:

    S(f) = L(f) |H(f)|²              and              S(f) = (L(f) + N(f)) |H(f)|²,

H the mode's response, L a power law of the load, N a narrow-band load (a second-order process) near the mode that
was found, of any width and level. Each is taken at the greatest of −Σ (I_j/S_j + log S_j) (Whittle 1953) and the log
prior together.

Source: Whittle, J. R. Statist. Soc. B 15, 1953, https://doi.org/10.1111/j.2517-6161.1953.tb00131.x.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.results.lines import HANN_VARIANCE

__all__ = ["Rival", "find_rival"]

LIKELY, BETTER = 0.5, 1.6
"""Log posterior by which a narrow-band load has to explain a channel better: where the mode beside it is damped more,
so that its peak was taken for the mode, and where it is damped less. Odds of 5 to 3 are enough there, as a mode is far
off then."""

OTHER, ELSEWHERE = math.log(2.5), math.log(1.35)
"""Of the damping, by which another explanation has to be another answer; and of the frequency, beyond which its load
may stand for the mode and its mode for nothing that shows."""

MUCH_BETTER = 7.0
"""Log posterior from which on any other explanation counts: of 40 healthy towers one shows 4.7."""

REACH = 1.55
"""Factor about the mode's frequency, as the file has it and as it was found, between which both are held."""

FEWEST_BINS = 40
"""Frequencies of a periodogram below which nothing is asked."""

LEVEL, LEVEL_SPREAD = -1.0, 4.0
"""The logarithm of L over the channel's median, and its standard deviation: without it N could be all of the load, and
stand for the mode that was found."""

SLOPE_SPREAD = 6.0
"""Standard deviation of the slope of L."""

WIDTHS = 0.004, 0.03
"""Damping ratios of N at which a search begins."""

WIDTH, WIDTH_SPREAD = 0.02, 1.0
"""The damping ratio of N, and the standard deviation of its logarithm."""

NEAR = 0.1
"""Standard deviation of the logarithm of N's frequency over that of the mode that was found: it stands for its peak."""

FAINT = -4.0
"""The logarithm of N over the channel's median, where a search begins with the mode that explains it alone."""

TRIED = 2
"""Starts of each width and level that are searched from."""


class Rival(NamedTuple):
    """A narrow-band load that explains a channel better than the mode that was found: its frequency [Hz], by how much
    the log posterior is greater, and frequency [Hz] and damping ratio of the mode beside it."""

    frequency: float
    better: float
    mode: tuple[float, float]

    def speaks_against(self, found: tuple[float, float]) -> bool:
        """Whether it is much better, or better and its mode as fast as the one that was found and damped otherwise."""
        faster, damped = (math.log(theirs / ours) for theirs, ours in zip(self.mode, found, strict=True))
        other = abs(faster) < ELSEWHERE and abs(damped) > OTHER
        return self.better > MUCH_BETTER or (other and self.better > (LIKELY if damped > 0.0 else BETTER))


def find_rival(
    readings: Array, rate: float, file: tuple[float, float], found: tuple[float, float],
    known: Callable[[float, float], tuple[float, ...]],
) -> Rival | None:  # fmt: skip
    """The narrow-band load beside a mode that explains a channel best; None where there is too little to ask.

    Parameters
    ----------
    readings, rate
        The channel in which the mode shows most (T,), without gaps, and its samples per second [Hz].
    file, found
        Frequency [Hz] and damping ratio of the mode, as the turbine file has them and as they were found.
    known
        Stiffness and damping, each over the file's, from their prior's standard normal coordinates.
    """
    from scipy.optimize import minimize

    power = np.abs(np.fft.rfft(np.hanning(len(readings)) * (readings - readings.mean()))) ** 2
    frequency = np.fft.rfftfreq(len(readings), 1.0 / rate)
    near = (frequency > min(file[0], found[0]) / REACH) & (frequency < max(file[0], found[0]) * REACH)
    if near.sum() < FEWEST_BINS:
        return None
    f, power = frequency[near].astype(np.float64), power[near] / np.median(power[near])
    tilt = np.log(f / np.sqrt(f[0] * f[-1]))

    def cost(unknowns: Array) -> float:
        stiffness, damping = known(unknowns[0], unknowns[1])
        load = np.exp(np.clip(unknowns[2] + unknowns[3] * tilt, -40.0, 40.0))
        prior = unknowns[0] ** 2 + unknowns[1] ** 2 + (unknowns[3] / SLOPE_SPREAD) ** 2
        prior += ((unknowns[2] - LEVEL) / LEVEL_SPREAD) ** 2
        if len(unknowns) > 4:
            at, width, level = np.exp(np.clip(unknowns[4:], -40.0, 40.0))
            load = load + level * (2.0 * width) ** 2 * _response(f, at, width)
            prior += (np.log(width / WIDTH) / WIDTH_SPREAD) ** 2 + (np.log(at / found[0]) / NEAR) ** 2
        own = file[0] * np.sqrt(stiffness)
        spectrum = load * _response(f, own, max(file[1] * damping / np.sqrt(stiffness), 1e-5))
        return float(np.sum(np.log(spectrum) + power / spectrum) / HANN_VARIANCE + 0.5 * prior)

    def least(starts: list[list[float]]) -> tuple[float, Array]:
        ends = [minimize(cost, start, method="BFGS", options={"maxiter": 100, "gtol": 1e-2}) for start in starts]
        best = min(ends, key=lambda end: float(end.fun))
        return float(best.fun), np.asarray(best.x)

    alone, mode = least([[k, c, -1.0, 0.0] for k in (0.0, 0.3, -0.3) for c in (0.0, -1.0, -1.8)])
    places = (np.log(found[0]) + NEAR * np.linspace(-2.0, 2.0, 41)).tolist()
    starts = [[*mode, float(np.log(found[0])), math.log(WIDTH), FAINT]]
    for width in WIDTHS:
        for base in (-1.0, -3.0):
            at = [[0.0, 0.0, base, 0.0, place, math.log(width), over] for place in places for over in (0.0, 2.0)]
            starts += sorted(at, key=lambda start: cost(np.array(start)))[:TRIED]
    both, best = least(starts)
    stiffness, damping = known(best[0], best[1])
    root = float(np.sqrt(stiffness))
    return Rival(float(np.exp(best[4])), alone - both, (file[0] * root, file[1] * damping / root))


def _response(f: Array, own: float, damping: float) -> Array:
    """|H|² of acceleration at frequencies f."""
    ratio = (f / own) ** 2
    return np.asarray(ratio**2 / ((1.0 - ratio) ** 2 + 4.0 * damping**2 * ratio))

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
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.results.lines import HANN_VARIANCE

__all__ = ["Rival", "find_rivals"]

LIKELY, BETTER = 0.5, 1.6
"""Log posterior by which a narrow-band load has to explain a channel better: where the mode beside it is damped more,
so that its peak was taken for the mode, and where it is damped less. Odds of 5 to 3 are enough there, as a mode is far
off then."""

OTHER, ELSEWHERE = math.log(2.5), math.log(1.35)
"""Of the damping, by which another explanation has to be another answer; and of the frequency, beyond which its load
may stand for the mode and its mode for nothing that shows."""

MUCH_BETTER = 7.0
"""Log posterior from which on another explanation counts wherever its mode is: of 40 healthy towers one shows 4.7."""

SAME = 0.05
"""Of the logarithm of frequency, within which such a mode is the one that was found, unless its damping is another."""

REACH = 1.55
"""Factor about the mode's frequency, as the file has it and as it was found, between which both are held."""

FEWEST_BINS = 40
"""Frequencies of a periodogram below which nothing is asked."""

LEVEL, LEVEL_SPREAD = -1.0, 4.0
"""The logarithm of L over the channel's median, and its standard deviation: without it N could be all of the load, and
stand for the mode that was found."""

SLOPE_SPREAD = 6.0
"""Standard deviation of the slope of L."""

WIDTHS = 0.001, 0.004, 0.03
"""Damping ratios of N at which a search begins."""

WIDTH, WIDTH_SPREAD = 0.02, 2.0
"""The damping ratio of N, and the standard deviation of its logarithm: from a machine, all but a line, to waves."""

NEAR = 0.1
"""Standard deviation of the logarithm of N's frequency over that of the mode that was found: it stands for its peak."""

OVER = 0.0, 2.0, 5.0
"""Logarithms of N over the channel's median at which a search begins."""

FAINT = -4.0
"""The logarithm of N over the channel's median, where a search begins with the mode that explains it alone."""

LEAST_DAMPING = 1e-5
"""Damping ratio of the mode below which it counts as that."""

STEP = 1e-6
"""Of the prior's coordinates, over which their slopes are told."""

PLACES, BASES = 41, (-1.0, -3.0)
"""How many frequencies of N, and which logarithms of L over the channel's median, a search is chosen from."""

TRIED = 2
"""Starts of each width and level that are searched from."""


class Rival(NamedTuple):
    """A narrow-band load that may explain a channel better than the mode that was found: its frequency [Hz], by how
    much the log posterior is greater, and frequency [Hz] and damping ratio of the mode beside it."""

    frequency: float
    better: float
    mode: tuple[float, float]

    def speaks_against(self, found: tuple[float, float]) -> bool:
        """Whether it is much better, or better and its mode as fast as the one that was found and damped otherwise."""
        faster, damped = (math.log(theirs / ours) for theirs, ours in zip(self.mode, found, strict=True))
        another = abs(damped) > OTHER
        if self.better > MUCH_BETTER:
            return another or abs(faster) > SAME
        return another and abs(faster) < ELSEWHERE and self.better > (LIKELY if damped > 0.0 else BETTER)


def find_rivals(
    readings: Array, rate: float, file: tuple[float, float], found: tuple[float, float],
    known: Callable[[float, float], tuple[float, ...]],
) -> list[Rival]:  # fmt: skip
    """Narrow-band loads beside a mode that explain a channel, as searches end in them, the best first; none where there
    is too little to ask.

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
        return []
    f, power = frequency[near].astype(np.float64), power[near] / np.median(power[near])
    tilt = np.log(f / np.sqrt(f[0] * f[-1]))

    # of the mode's prior, the smooth load's level and slope, the narrow one's frequency, width and level
    mean = np.array([0.0, 0.0, LEVEL, 0.0, math.log(found[0]), math.log(WIDTH), 0.0])
    spread = np.array([1.0, 1.0, LEVEL_SPREAD, SLOPE_SPREAD, NEAR, WIDTH_SPREAD, np.inf])

    def cost(unknowns: Array) -> tuple[float, Array]:
        """−Σ log density and −log prior, with their slopes."""
        (stiffness, damping), slopes = _with_slopes(known, unknowns[:2])
        response, to_own, to_ratio = _mode(f, file, stiffness, damping)
        # of the logarithm of the spectrum: the mode's stiffness and damping, the smooth load's level and slope
        to_known = (0.5 * (to_own - to_ratio) / stiffness, to_ratio / damping)
        rows = [slopes[0, i] * to_known[0] + slopes[1, i] * to_known[1] for i in range(2)]
        load = np.exp(np.clip(unknowns[2] + unknowns[3] * tilt, -40.0, 40.0))
        if len(unknowns) == 4:
            rows += [np.ones_like(tilt), tilt]
        else:
            at, width, level = np.exp(np.clip(unknowns[4:], -40.0, 40.0))
            peak, to_at, to_width = _response(f, at, width)
            narrow = level * (2.0 * width) ** 2 * peak
            load = load + narrow
            share = narrow / load
            rows += [1.0 - share, tilt * (1.0 - share), share * to_at, share * (2.0 + to_width), share]
        spectrum, n = load * response, len(unknowns)
        off = (unknowns - mean[:n]) / spread[:n]
        value = float(np.sum(np.log(spectrum) + power / spectrum) / HANN_VARIANCE + 0.5 * off @ off)
        return value, np.array(rows) @ (1.0 - power / spectrum) / HANN_VARIANCE + off / spread[:n]

    def ends(starts: Sequence[Array]) -> list[tuple[float, Array]]:
        found = [
            minimize(cost, start, jac=True, method="BFGS", options={"maxiter": 100, "gtol": 1e-2}) for start in starts
        ]
        return sorted(((float(end.fun), end.x) for end in found), key=lambda end: end[0])

    modes = [np.array([k, c, LEVEL, 0.0]) for k in (0.0, 0.3, -0.3) for c in (0.0, -1.0, -1.8)]
    alone, mode = ends(modes)[0]
    starts = [np.array([*mode, math.log(found[0]), math.log(WIDTH), FAINT])]
    places, own = NEAR * np.linspace(-2.0, 2.0, PLACES), _mode(f, file, *known(0.0, 0.0))[0]
    for width in WIDTHS:
        peaks = (2.0 * width) ** 2 * _response(f, found[0] * np.exp(places[:, None]), width)[0]
        for base in BASES:
            spectra = (math.exp(base) + np.exp(np.array(OVER))[:, None, None] * peaks) * own
            costs = np.sum(np.log(spectra) + power / spectra, axis=2) / HANN_VARIANCE + 0.5 * (places / NEAR) ** 2
            for over, place in zip(*np.unravel_index(np.argsort(costs, axis=None)[:TRIED], costs.shape), strict=True):
                peak = (math.log(found[0]) + places[place], math.log(width), OVER[over])
                starts.append(np.array([0.0, 0.0, base, 0.0, *peak]))
    rivals = []
    for both, x in ends(starts):
        stiffness, damping = known(x[0], x[1])
        root = math.sqrt(stiffness)
        rivals.append(Rival(math.exp(x[4]), alone - both, (file[0] * root, file[1] * damping / root)))
    return rivals


def _mode(f: Array, file: tuple[float, float], stiffness: float, damping: float) -> tuple[Array, Array, Array]:
    """What `_response` says of the file's mode with stiffness and damping so many times the file's."""
    root = math.sqrt(stiffness)
    response, to_own, to_ratio = _response(f, file[0] * root, max(file[1] * damping / root, LEAST_DAMPING))
    return response, to_own, to_ratio * (file[1] * damping / root > LEAST_DAMPING)


def _response(f: Array, own: float | Array, damping: float) -> tuple[Array, Array, Array]:
    """|H|² of acceleration at frequencies f, and the slopes of its logarithm to those of frequency and damping."""
    ratio = (f / own) ** 2
    wide = 4.0 * damping**2 * ratio
    rest = (1.0 - ratio) ** 2 + wide
    to_own = -4.0 + 2.0 * (wide - 2.0 * ratio * (1.0 - ratio)) / rest
    return np.asarray(ratio**2 / rest), np.asarray(to_own), np.asarray(-2.0 * wide / rest)


def _with_slopes(known: Callable[[float, float], tuple[float, ...]], normal: Array) -> tuple[Array, Array]:
    """Stiffness and damping over the file's (2,), and their slopes to the prior's coordinates (2, 2)."""
    here = np.array(known(*normal))
    return here, np.column_stack([(np.array(known(*(normal + step))) - here) / STEP for step in STEP * np.eye(2)])

"""Goodness of fit of a lifted spectrum in each channel and frequency range, and stationarity of its record.

Every used entry Y of the record has the expected square S. Where the model holds, |Y|²/S is exponential with mean 1,
and the mean of N of them, c_h of which count as one, scatters by √(c_h/N). A mean that is off by more than that says in
which channel and at which frequencies the model fails. A record whose halves have different energies is not stationary.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.checks.limits import FALSE_ALARM_PROBABILITY, MAX_CHANCE_SIGMAS, MAX_NEAR_MODE_LEVEL
from windsysid.inspection.limits import MAX_VIBRATION_CHANGE
from windsysid.results.finding import Finding

__all__ = ["RangePower", "misshapen", "parts_of", "unexplained", "unsteady"]


class RangePower(NamedTuple):
    """One channel between two frequencies.

    Attributes
    ----------
    channel
        Its name.
    low, high
        Between which frequencies [Hz].
    mean
        The mean of |Y|²/S.
    scatter
        Its standard deviation where the model holds.
    energy
        Σ |Y|² / Σ S.
    independent
        As how many independent entries that energy counts, (Σ S)² / Σ S²: where one resonance is loud, few.
    """

    channel: str
    low: float
    high: float
    mean: float
    scatter: float
    energy: float
    independent: float


def parts_of(
    power: Array,
    expected: Array,
    frequency: Array,
    channel: str,
    ranges: Sequence[tuple[float, float]],
    overlap: float,
    fewest: float,
) -> list[RangePower]:
    """One channel's parts: |Y|² and S (N,), NaN where nothing is said, at unsigned frequencies (N,) [Hz].

    c_h = `overlap` entries count as one. Energy counts as `fewest` entries at least: a decay that was taken for noise
    shows a resonance of no width.
    """
    found = []
    for low, high in ranges:
        inside = (frequency >= low) & (frequency < high) & np.isfinite(power)
        number = int(inside.sum())
        if number:
            Y, S = power[inside], expected[inside]
            count = max(float(S.sum() ** 2 / np.sum(S**2)) / overlap, fewest)
            mean, energy = float(np.mean(Y / S)), float(Y.sum() / S.sum())
            found.append(RangePower(channel, low, high, mean, math.sqrt(overlap / number), energy, count))
    return found


def unexplained(parts: Iterable[RangePower]) -> list[Finding]:
    """Findings where the power of a channel is above or below that of the model, the worst first.

    The mean of N complex normal entries is χ² with 2N degrees of freedom.
    """
    from scipy.special import ndtr

    rare, largest = ndtr(-MAX_CHANCE_SIGMAS), MAX_NEAR_MODE_LEVEL
    off = [p for p in parts if not 1.0 / largest < p.mean < largest and _chance(p) < rare]
    return [
        Finding("unexplained_power", "reason", _data(p, p.mean))
        for p in sorted(off, key=lambda p: -abs(math.log(max(p.mean, 1e-12))))
    ]


def misshapen(rows: Sequence[Sequence[RangePower]], probability: float) -> list[Finding]:
    """Reasons where the parts of a row are together further off than chance explains, by Fisher's method, at a
    probability over all rows."""
    from scipy.special import chdtrc

    found = []
    for parts in filter(None, rows):
        chances = [min(max(2.0 * _chance(p), 1e-300), 1.0) for p in parts]
        if chdtrc(2.0 * len(parts), -2.0 * sum(map(math.log, chances))) < probability / len(rows):
            worst = parts[int(np.argmin(chances))]
            found.append(Finding("unexplained_power", "reason", _data(worst, worst.mean)))
    return found


def _chance(part: RangePower) -> float:
    """Probability of a larger mean square where it is above 1, else of a smaller one."""
    from scipy.special import chdtr, chdtrc

    freedom = 2.0 / part.scatter**2
    beyond = chdtrc if part.mean > 1.0 else chdtr
    return float(beyond(freedom, freedom * part.mean))


def _data(part: RangePower, ratio: float) -> dict[str, Any]:
    return {"channel": part.channel, "ratio": ratio, "low": part.low, "high": part.high}


def unsteady(first: Sequence[RangePower], second: Sequence[RangePower]) -> list[Finding]:
    """Reasons where the halves of a record differ in energy by more than chance and by more than a factor, the worst
    first.

    Of N complex normal entries the energy is χ² with 2N degrees of freedom, and the ratio of two energies follows
    Fisher's F. A frequency range with entries in one half only is not compared: entries near rotor harmonics are
    excluded, and if the rotor speed differs between the halves, different entries remain.
    """
    from scipy.special import fdtri

    others = {(p.channel, p.low, p.high): p for p in second}
    pairs = [(a, others[a.channel, a.low, a.high]) for a in first if (a.channel, a.low, a.high) in others]
    if not pairs:
        return [Finding("stationarity_untestable", "reason")]
    off = []
    for a, b in pairs:
        loud, quiet = (a, b) if a.energy > b.energy else (b, a)
        factor = loud.energy / max(quiet.energy, 1e-300)
        # 1/F follows F with the degrees of freedom exchanged
        rare = 1.0 / float(fdtri(2.0 * quiet.independent, 2.0 * loud.independent, FALSE_ALARM_PROBABILITY / len(pairs)))
        if factor > max(MAX_VIBRATION_CHANGE**2, rare):
            off.append((factor, a))
    return [
        Finding("nonstationary", "reason", _data(p, factor)) for factor, p in sorted(off, key=lambda pair: -pair[0])
    ]

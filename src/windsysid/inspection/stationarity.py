"""Stationarity of vibration: test whether its power changes over a section by more than chance.

The mean square of a stationary random vibration over a time T has approximately a chi-squared distribution with

    ν = 2 B_e T,   B_e = (∫ S df)² / ∫ S² df   (Bendat & Piersol, Random Data, section 8.3)

equivalent degrees of freedom. B_e is 2πζf for a lightly damped resonance of frequency f and damping ratio ζ: at 0.3 Hz
and 0.5 %, one minute has one degree of freedom, and the amplitude varies by a factor of three although structure and
loads do not change. So the power of two segments is compared by Fisher's distribution with ν and ν degrees of freedom,
in halves and in quarters of a section. A vibration is called changing if a ratio is less probable than
`SCREENING_PROBABILITY` over all comparisons, and the rms differs by more than a factor of `MAX_VIBRATION_CHANGE`.

The test is repeated with the spectrum raised to the power of ½ and of 0 (prewhitening) within the frequency range that
contains 99 % of the power. Then frequencies of low power count too, which have many more degrees of freedom: they show
a change of the loads even if the resonance is too narrow for a test.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Mask
from windsysid.checks.limits import SCREENING_PROBABILITY
from windsysid.inspection.limits import MAX_ENERGY_SHARE, MAX_VIBRATION_CHANGE
from windsysid.records.record import Record
from windsysid.signals.textbook import tukey

__all__ = [
    "SectionChanges", "Vibration", "changes", "energy_share", "transient_text", "transients",
    "vibration_of",
]  # fmt: skip

WHITENING_EXPONENTS = (1.0, 0.5, 0.0)
"""Setting: powers to which the spectrum is raised: as it is, half and fully whitened."""

SEGMENT_COUNTS = (2, 4)
"""Setting: numbers of segments into which a section is divided."""

POWER_SHARE_OUTSIDE = 0.01
"""Setting: share of the power outside the whitened frequency range, which contains sensor noise and drift."""

SMOOTHED_BINS = 16
"""Setting: number of frequency bins over which the periodogram is averaged for whitening."""

TAPERED_SHARE = 0.05
"""Setting: share of a record at each end that is tapered, so that a resonance does not leak into all frequencies."""

MAX_SAMPLES = 500_000
"""Setting: largest number of samples of the test; longer records are averaged to fewer."""

MIN_SEGMENT_FREEDOM = 0.5
"""Numerical: lower limit of the degrees of freedom of a segment."""


class Vibration(NamedTuple):
    """Power of one channel over time.

    Attributes
    ----------
    edges
        (n + 1,): samples of the record at which steps of `energy` and `weight` begin and end.
    energy
        (3, n): for each of `WHITENING_EXPONENTS`, the sum of squares in each step.
    weight
        (n,): effective number of samples in each step.
    degrees
        (3,): equivalent degrees of freedom of the whole record.
    cycles
        Number of periods in the whole record of the frequency below which half of the power lies.
    steps
        (n,): sum of squares of the differences between successive samples in each step.
    """

    edges: NDArray[np.int64]
    energy: Array
    weight: Array
    degrees: Array
    cycles: float
    steps: Array

    def power(self, bounds: NDArray[np.int64]) -> tuple[Array, Array]:
        """Mean squares (3, ...) and degrees of freedom (3, ...) between samples `bounds` (..., 2) of the record."""
        where = np.searchsorted(self.edges, bounds)
        total = np.concatenate([np.zeros((3, 1)), np.cumsum(self.energy, axis=1)], axis=1)
        count = np.concatenate([[0.0], np.cumsum(self.weight)])
        weight = count[where[..., 1]] - count[where[..., 0]]
        energy = total[:, where[..., 1]] - total[:, where[..., 0]]
        share = weight / max(count[-1], 1e-300)
        freedom = self.degrees.reshape(3, *np.ones(weight.ndim, dtype=int)) * share
        return np.maximum(energy, 1e-300) / np.maximum(weight, 1e-9), np.maximum(freedom, MIN_SEGMENT_FREEDOM)


class SectionChanges(NamedTuple):
    """Changes of vibration within sections.

    Attributes
    ----------
    excess
        (w,): logarithm of the largest ratio, relative to that of the allowed one; above 1 the vibration changes.
    by_chance
        (w,): whether all ratios are within the limits of a stationary vibration.
    factor, allowed
        (w,): ratio of the rms values of these two segments, later over earlier, and the largest allowed ratio.
    segments
        (w,): number of segments of this comparison.
    """

    excess: Array
    by_chance: Mask
    factor: Array
    allowed: Array
    segments: NDArray[np.int64]


def vibration_of(record: Record, channel: str) -> Vibration | None:
    """Compute the power of a channel over time; None if it is constant or has too few samples."""
    values = record[channel]
    known = np.isfinite(values)
    if known.sum() < 4 * SMOOTHED_BINS:
        return None
    centred = np.where(known, values - float(np.mean(values[known])), 0.0)
    per_step = -(-len(values) // MAX_SAMPLES)
    edges = np.append(np.arange(0, len(values), per_step), len(values))
    size = np.diff(edges)
    x = np.add.reduceat(centred, edges[:-1]) / size
    taper = tukey(len(x) + 2, 2.0 * TAPERED_SHARE)[1:-1]
    spectrum = np.fft.rfft(x * taper)
    spectrum[0] = 0.0
    power = np.abs(spectrum) ** 2
    if not power.sum() > 0.0:
        return None
    energy, degrees = [], []
    for exponent in WHITENING_EXPONENTS:
        shaped = spectrum * _gain(power, exponent)
        level = np.abs(shaped) ** 2
        energy.append(np.fft.irfft(shaped, len(x)) ** 2)
        # Of exponential ordinates the mean square is twice the square of the mean; a taper widens what is narrow.
        degrees.append(4.0 * level.sum() ** 2 / np.sum(level**2) * (1.0 - 1.25 * TAPERED_SHARE))
    weight = taper**2 * np.add.reduceat(known.astype(np.float64), edges[:-1]) / size
    cycles = float(np.searchsorted(np.cumsum(power), 0.5 * power.sum()))
    jumps = np.nan_to_num(np.diff(values, prepend=values[0])) ** 2
    return Vibration(edges, np.array(energy), weight, np.array(degrees), cycles, np.add.reduceat(jumps, edges[:-1]))


def energy_share(energy: Array) -> Array:
    """Share of the energy (8, m, ...) of m channels in the strongest eighth of a section: median over channels."""
    return np.asarray(np.median(energy.max(axis=0) / np.maximum(energy.sum(axis=0), 1e-300), axis=0))


def transient_text(share: float) -> str:
    """Describe a section whose strongest eighth has a share of its vibration; empty if it is no transient."""
    return "" if share < MAX_ENERGY_SHARE else f"an eighth of it has {100.0 * share:.0f} % of the vibration"


def transients(vibrations: Sequence[Vibration], starts: NDArray[np.int64], ends: NDArray[np.int64]) -> list[str]:
    """Describe transients in sections from samples `starts` (w,) to `ends` (w,); empty where there is none."""
    cut = starts + (ends - starts) * np.arange(9)[:, None] // 8
    energy = []
    for one in vibrations:
        total = np.concatenate([[0.0], np.cumsum(one.steps)])
        energy.append(np.diff(total[np.searchsorted(one.edges, cut)], axis=0))
    return list(map(transient_text, energy_share(np.stack(energy, axis=1)).tolist()))


def changes(vibrations: Sequence[Vibration], starts: NDArray[np.int64], ends: NDArray[np.int64]) -> SectionChanges:
    """Test whether vibration changes within sections from samples `starts` (w,) to `ends` (w,)."""
    from scipy.special import fdtri

    comparisons = len(WHITENING_EXPONENTS) * sum(n * (n - 1) // 2 for n in SEGMENT_COUNTS)
    sections = len(starts)
    best = SectionChanges(
        np.zeros(sections), np.ones(sections, dtype=np.bool_), np.ones(sections), np.full(sections, np.inf),
        np.full(sections, SEGMENT_COUNTS[0]),
    )  # fmt: skip
    for segments in SEGMENT_COUNTS:
        cut = starts[:, None] + (ends - starts)[:, None] * np.arange(segments + 1) // segments
        found = [vibration.power(np.stack([cut[:, :-1], cut[:, 1:]], axis=-1)) for vibration in vibrations]
        power, freedom = (np.array(values) for values in zip(*found, strict=True))  # (m, 3, w, segments)
        least = freedom.min(axis=-1)
        chance = np.log(fdtri(least, least, 1.0 - SCREENING_PROBABILITY / comparisons))
        allowed = np.maximum(chance, 2.0 * np.log(MAX_VIBRATION_CHANGE))
        level = np.log(power)
        for first, second in combinations(range(segments), 2):
            ratio = level[..., second] - level[..., first]
            excess = np.sqrt(np.mean((ratio / allowed) ** 2, axis=0))  # (3, w)
            by_chance = best.by_chance & np.all(np.mean((ratio / chance) ** 2, axis=0) <= 1.0, axis=0)
            best = best._replace(by_chance=by_chance)
            for k in range(len(WHITENING_EXPONENTS)):
                larger = excess[k] > best.excess
                sign = np.where(ratio[:, k].mean(axis=0) < 0.0, -0.5, 0.5)
                best = SectionChanges(
                    np.where(larger, excess[k], best.excess),
                    by_chance,
                    np.where(larger, np.exp(sign * np.sqrt(np.mean(ratio[:, k] ** 2, axis=0))), best.factor),
                    np.where(larger, np.exp(0.5 * allowed[:, k].mean(axis=0)), best.allowed),
                    np.where(larger, segments, best.segments),
                )
    return best


def _gain(power: Array, exponent: float) -> Array:
    """Factors (F,) that raise a spectrum with periodogram `power` to the power of an exponent."""
    from scipy.ndimage import uniform_filter1d

    if exponent == 1.0:
        return np.ones_like(power)
    smooth = uniform_filter1d(power, SMOOTHED_BINS, mode="nearest")
    share = np.cumsum(power) / power.sum()
    inside = (share > 0.5 * POWER_SHARE_OUTSIDE) & (share < 1.0 - 0.5 * POWER_SHARE_OUTSIDE)
    inside[np.argmax(power)] = True
    return np.where(inside, np.maximum(smooth, 1e-300) ** (0.5 * (exponent - 1.0)), 0.0)

"""Modes found speed by speed, linked to curves over rotor speed."""

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from windsysid._types import Array
from windsysid.modal.analysis import ModalSpectrum
from windsysid.results.estimate import IntervalEstimate
from windsysid.results.mode import Mode

__all__ = ["Curve", "bends", "link"]

MAX_BEND_SHARE = 0.005
"""Share of the diagram's height by which a curve may leave the straight line between its neighbours."""


@dataclass(frozen=True, eq=False)
class Curve:
    """One mode over rotor speed: frequency [Hz] and damping ratio with their standard deviations (S,).

    Where the mode does not oscillate, they are NaN.
    """

    name: str
    frequency: Array
    frequency_std: Array
    damping: Array
    damping_std: Array

    def at(self, i: int) -> Mode:
        """The mode at one of the speeds."""
        f, df, z, dz = (float(v[i]) for v in (self.frequency, self.frequency_std, self.damping, self.damping_std))
        return Mode(self.name, IntervalEstimate.normal(f, df, "Hz"), IntervalEstimate.normal(z, dz, "1"))


def link(
    spectra: Sequence[ModalSpectrum], speeds: Array, start: int, cov: Array, *, shortest: int = 3
) -> tuple[Curve, ...]:
    """Modes (S spectra) linked from speed to speed, outward from the usual one, `start`; `cov` (n_θ, n_θ) gives the
    standard deviations. A mode that is seen at fewer speeds than `shortest` is left out.

    Those that are there at the usual speed come first, by frequency. A mode whose largest harmonic gives way to another
    jumps by Ω: one curve ends there, and another begins.
    """
    named = [
        (_track_name(track, spectra, speeds, start), _values(track, spectra, cov))
        for track in _tracks(spectra, speeds, start)
        if len(track) >= shortest
    ]

    def there(values: Array) -> bool:
        return bool(np.isfinite(values[0, start]))

    named.sort(key=lambda item: (not there(item[1]), item[1][0, start] if there(item[1]) else np.nanmean(item[1][0])))
    usual, seen, found = Counter(name for name, values in named if there(values)), Counter[str](), []
    for name, values in named:
        seen[name] += 1
        numbered = usual[name] > 1 or seen[name] > 1
        found.append(Curve(f"{name} ({seen[name]})" if numbered else name, *values))
    return tuple(found)


def _tracks(spectra: Sequence[ModalSpectrum], speeds: Array, start: int) -> list[dict[int, int]]:
    """The number of a mode by the index of the speed, for each mode that was followed from `start` or from where it
    begins."""
    tracks: list[dict[int, int]] = [{start: m} for m in range(len(spectra[start].exponents))]
    for way, end in ((1, len(spectra)), (-1, -1)):
        for i in range(start + way, end, way):
            ending = [track for track in tracks if i - way in track]
            linked = _linked(spectra, speeds, [(track[i - way], track.get(i - 2 * way)) for track in ending], i, way)
            for track, m in zip(ending, linked, strict=True):
                if m is not None:
                    track[i] = m
            tracks += [{i: m} for m in range(len(spectra[i].exponents)) if m not in linked]
    return tracks


def _values(track: dict[int, int], spectra: Sequence[ModalSpectrum], cov: Array) -> Array:
    """Frequency [Hz] and damping ratio with their standard deviations (4, S), as `Curve`; NaN where there is none."""
    values = np.full((4, len(spectra)), np.nan)
    for i, m in track.items():
        s = spectra[i]
        deviations = [math.sqrt(max(float(d[m] @ cov @ d[m]), 0.0)) for d in s.frequency_and_damping_slopes()]
        values[:, i] = s.frequency[m], deviations[0], s.damping[m], deviations[1]
    return values


def bends(curves: Sequence[Curve], speeds: Array) -> list[float]:
    """Speeds halfway between those around which a curve bends or ends."""
    here = np.zeros(len(speeds), dtype=bool)
    step = np.diff(speeds)
    for values in ([c.frequency for c in curves], [c.damping for c in curves]):
        height = float(np.nanmax(values) - min(np.nanmin(values), 0.0)) if curves else 1.0
        for v in values:
            straight = (v[:-2] * step[1:] + v[2:] * step[:-1]) / (step[1:] + step[:-1])
            here[1:-1] |= np.abs(v[1:-1] - straight) > MAX_BEND_SHARE * height
            seen = np.isfinite(v)
            here[:-1] |= seen[:-1] != seen[1:]
            here[1:] |= seen[:-1] != seen[1:]
    wide = (here[:-1] | here[1:]) & (step > (speeds[-1] - speeds[0]) / 500.0)
    return [float(speed) for speed in (0.5 * (speeds[:-1] + speeds[1:]))[wide]]


def _track_name(track: dict[int, int], spectra: Sequence[ModalSpectrum], speeds: Array, start: int) -> str:
    """The name, without a number, that a mode has at the usual speed, or else over most of its speeds."""
    if start in track:
        return spectra[start].names[track[start]].partition(" (")[0]
    stretch = np.gradient(speeds)
    shares: dict[str, float] = defaultdict(float)
    for i, m in track.items():
        shares[spectra[i].names[m].partition(" (")[0]] += stretch[i]
    return max(shares, key=lambda name: shares[name])


def _linked(
    spectra: Sequence[ModalSpectrum], speeds: Array, before: Sequence[tuple[int, int | None]], i: int, way: int
) -> list[int | None]:
    """For each track the mode at speed i that continues it, or None; its modes one and two steps before tell."""
    from scipy.optimize import linear_sum_assignment

    near, here = spectra[i - way], spectra[i]
    cost = np.empty((len(before), len(here.exponents)))
    step = abs(speeds[i] - speeds[i - way])
    for row, (last, earlier) in enumerate(before):
        expected = near.exponents[last]
        if earlier is not None:
            past = spectra[i - 2 * way].exponents[earlier]
            expected = expected + (expected - past) * step / abs(speeds[i - way] - speeds[i - 2 * way])
        u = near.shapes[last]
        alike = np.maximum(np.abs(here.shapes @ np.conj(u)), np.abs(here.shapes @ u)) ** 2
        apart = np.abs(here.exponents - expected) / (step + 0.05 * abs(expected))
        cost[row] = (1.0 - alike) + apart
    rows, columns = linear_sum_assignment(cost)
    chosen = dict(zip(rows.tolist(), columns.tolist(), strict=True))
    return [m if (m := chosen.get(row)) is not None and cost[row, m] < 1.5 else None for row in range(len(before))]

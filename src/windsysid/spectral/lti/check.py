"""Goodness of fit of a user's equations to cross-spectra, and stationarity of the record."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from windsysid._types import Array, Complex
from windsysid.results.finding import Finding
from windsysid.spectral.lti.fit import LinearFit
from windsysid.spectral.lti.likelihood import LinearModel
from windsysid.spectral.lti.limits import MIN_RESONANCE_FREEDOM
from windsysid.spectral.rotor.check import RangePower, unexplained, unsteady
from windsysid.spectral.transforms.cross_spectra import CrossSpectra

__all__ = ["doubts_of", "frequency_ranges"]

RANGE_COUNT = 8
"""Setting: number of frequency ranges in which a record is judged."""

MAX_RANGE_RATIO = 50.0
"""Setting: largest ratio of the end of the last range to the edge of the first."""

ALL = "what all channels have in common"


def frequency_ranges(limits: tuple[float, float]) -> list[tuple[float, float]]:
    """Ranges between two frequencies [Hz]."""
    low, high = limits
    edges = np.geomspace(max(low, high / MAX_RANGE_RATIO), high, RANGE_COUNT + 1)
    edges[0], edges[-1] = low, 1.001 * high
    return [(float(low), float(high)) for low, high in pairwise(edges)]


def doubts_of(
    model: LinearModel, spectra: CrossSpectra, fit: LinearFit, channels: Sequence[str], energies: Array
) -> list[Finding]:
    """Findings against the bands: a search that did not converge, resonances of few bins, power that the model does not
    explain, blocks of different loudness.

    `energies` (n, R, m) are those of n parts of the record in their order, over the ranges of the blocks.
    """
    doubts, ranges = list[Finding](), spectra.last.ranges
    if not fit.settled:
        doubts.append(Finding("fit_not_converged", "reason"))
    S = model.spectrum(fit.rows.frequency, fit.unknowns) + fit.smear
    counts = fit.rows.counts
    parts = _parts(S, fit, ranges, spectra.last.overlap, channels)
    duration = spectra.last.samples / spectra.last.rate
    poles = model.poles(fit.unknowns)
    poles = poles[(poles.imag > 0.0) & (poles.imag < 2.0 * math.pi * spectra.last.frequency[-1])]
    least = float(np.min(-poles.real, initial=math.inf)) * duration
    values = least / spectra.last.overlap
    if values < MIN_RESONANCE_FREEDOM:
        data = {"count": max(values, 0.0), "least": MIN_RESONANCE_FREEDOM}
        doubts.append(Finding("narrow_resonance", "reason", data))
    doubts += unexplained(parts)[:3]
    halves = [np.nanmean(half, axis=0) for half in np.array_split(energies, 2) if len(half)]
    if len(halves) < 2:
        return doubts
    own = np.einsum("kii->ki", S).real
    pairs: list[list[RangePower]] = [[], []]
    for i, (low, high) in enumerate(ranges):
        inside = (fit.rows.frequency >= low) & (fit.rows.frequency < high)
        if not inside.any():
            continue
        for j, channel in enumerate(channels):
            s, n = own[inside, j], 0.5 * counts[inside]
            independent = float((n @ s) ** 2 / (n @ s**2))
            independent = max(independent, min(0.5 * least, float(n.sum()))) / spectra.last.overlap
            for pair, half in zip(pairs, halves, strict=True):
                pair.append(RangePower(channel, low, high, 1.0, 0.0, float(half[i, j]), independent))
    return doubts + unsteady(*pairs)[:2]


def _parts(
    S: Complex, fit: LinearFit, ranges: Sequence[tuple[float, float]], factor: float, channels: Sequence[str]
) -> list[RangePower]:
    """Mean squares by channel and frequency, and of what whitens all channels together."""
    rows = fit.rows
    L_inv = np.linalg.inv(np.linalg.cholesky(S))
    whitened = np.einsum("kij,kjl,kil->k", L_inv, rows.power, L_inv.conj()).real / S.shape[1]
    own = np.einsum("kii->ki", rows.power).real / np.einsum("kii->ki", S).real
    found = []
    for low, high in ranges:
        inside = (rows.frequency >= low) & (rows.frequency < high)
        n = rows.counts[inside]
        if not inside.any():
            continue
        for name, mean, number in [
            *((channel, own[inside, j], n.sum()) for j, channel in enumerate(channels)),
            (ALL, whitened[inside], n.sum() * len(channels)),
        ]:
            found.append(RangePower(name, low, high, float(n @ mean / n.sum()), math.sqrt(factor / number), 1.0, 1.0))
    return found

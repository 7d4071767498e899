"""Model order of a band by evidence, and mode shapes in all channels.

A band's transforms are scaled and turned into their first m principal directions, as many as its modes can need and two
more; modes are added one by one as long as Schwarz's approximation of the evidence rises (Ann. Statist. 1978,
https://doi.org/10.1214/aos/1176344136). The information of the other directions on the shapes follows from a regression
on the modal responses.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.checks.limits import STRONG_LOG_ODDS
from windsysid.spectral.modal_bands.correlated_loads import are_shared, fit_shared
from windsysid.spectral.modal_bands.limits import MAX_DAMPING
from windsysid.spectral.modal_bands.model import Modes, responses
from windsysid.spectral.modal_bands.scoring import COARSE_TOLERANCE, ModalFit, evidence, score
from windsysid.spectral.modal_bands.start import add_mode, deviance, modes_at, without_modes
from windsysid.spectral.transforms.dft import Band, band_data

__all__ = ["BandFit", "Shapes", "fit_band", "full_shapes", "poles_over_order", "principal_directions"]

MAX_FINAL_STEPS = 120
"""Numerical: largest number of steps of the last search in a band."""

MIN_DIRECTION_POWER = 1e-9
"""Numerical: smallest power of a principal direction over the largest."""


class BandFit(NamedTuple):
    """The modes of one band.

    Attributes
    ----------
    fit, band
        The posterior, and the band's data (K, m, m).
    values, bins
        Transforms (k, n) of all channels at the bins (k,).
    directions
        (n, m): from directions to channels; its pseudo-inverse leads back.
    against_none
        2 ln of the evidence for these modes against a band without a mode.
    plain
        The fit for which every mode has a load of its own, where the data speak against that; else None.
    crowded
        True if the evidence is for more modes than were allowed: some of these are several.
    """

    fit: ModalFit
    band: Band
    values: Complex
    bins: NDArray[np.int64]
    directions: Complex
    against_none: float
    plain: ModalFit | None = None
    crowded: bool = False


class Shapes(NamedTuple):
    """Shapes of the modes of a band in all its channels.

    Attributes
    ----------
    shape, std, cov
        (n, r), 1 in the channel `largest` (r,); standard deviations of real and imaginary parts (n, r); covariance of
        the real parts and then the imaginary ones (r, 2 n, 2 n).
    load, load_std
        (r,) spectrum of the load that drives the mode, per modal mass where the shape is 1 [unit²/Hz], and the standard
        deviation of its logarithm.
    """

    shape: Complex
    std: Array
    cov: Array
    largest: NDArray[np.int64]
    load: Array
    load_std: Array


def fit_band(
    values: Complex,
    bins: NDArray[np.int64],
    samples: int,
    rate: float,
    peaks: int,
    most: int,
    known: Sequence[tuple[float, float]] = (),
) -> BandFit:
    """The modes of a band by evidence, at most `most`; roughly where these are no more than there are peaks.

    Parameters
    ----------
    values
        Transforms (k, n) at `bins`.
    peaks
        How many peaks were seen: so many are tried before the search may end.
    known
        Frequencies [Hz] and damping ratios of modes that were found before: the search begins with them.
    """
    directions, back = principal_directions(values, min(values.shape[1], peaks + 2))
    band = band_data(values @ back.T, bins, samples, rate)
    empty, plain = without_modes(band), None
    none = ModalFit(empty, np.empty((0, 0)), deviance(empty, band), True)
    best = _most_evident(band, len(bins), none, peaks, most, known[:most])
    if known and not len(best.modes.frequency):  # what was known is not here: from the beginning
        best = _most_evident(band, len(bins), none, peaks, most, ())
    if len(best.modes.frequency) and most > peaks:
        best = score(best.modes, band, max_steps=MAX_FINAL_STEPS)
        if are_shared(best, band) and (shared := fit_shared(best, band, len(bins), most)):
            plain, best = best, score(shared.modes, band, max_steps=MAX_FINAL_STEPS)
    against = evidence(none, len(bins)) - evidence(best, len(bins))
    crowded = most > peaks and len(best.modes.frequency) == most and _has_more(best, band, len(bins))
    return BandFit(best, band, values, bins, directions, against, plain, crowded)


def _most_evident(
    band: Band, bins: int, none: ModalFit, peaks: int, most: int, known: Sequence[tuple[float, float]]
) -> ModalFit:
    """Fit with the model order of the largest evidence; modes are added one by one to known ones."""
    best, least = none, evidence(none, bins)
    last = none
    first = max(1, len(known))
    for r in range(first, most + 1):
        more = modes_at(known, band) if known and r == first else add_mode(last.modes, band)
        target = np.inf if r <= peaks else least - 2.0 * STRONG_LOG_ODDS - more.size * float(np.log(bins))
        last = score(more, band, tolerance=COARSE_TOLERANCE, target=target)
        now = evidence(last, bins)
        if now < least - 2.0 * STRONG_LOG_ODDS and last.modes.damping.max() < MAX_DAMPING:
            best, least = last, now
        elif r >= peaks:
            break
    return best


def _has_more(fit: ModalFit, band: Band, bins: int) -> bool:
    """True if the evidence is for one mode more."""
    more, least = add_mode(fit.modes, band), evidence(fit, bins) - 2.0 * STRONG_LOG_ODDS
    found = score(more, band, tolerance=COARSE_TOLERANCE, target=least - more.size * float(np.log(bins)))
    return evidence(found, bins) < least and float(found.modes.damping.max()) < MAX_DAMPING


def poles_over_order(found: BandFit, most: int) -> tuple[tuple[Array, Array], ...]:
    """Frequencies [Hz] and damping ratios of 1, 2, … `most` modes in a band, each fit from that with one mode less."""
    modes, poles = without_modes(found.band), []
    for _ in range(most):
        modes = score(add_mode(modes, found.band), found.band, tolerance=COARSE_TOLERANCE).modes
        poles.append((modes.frequency, modes.damping))
    return tuple(poles)


def full_shapes(found: BandFit) -> Shapes:
    """Shapes in all channels."""
    modes, band, cov = found.fit.modes, found.band, found.fit.cov
    m, r = modes.shape.shape
    back = np.linalg.pinv(found.directions)
    seen, unsure = _modal_responses(modes, band, found.values @ back.T)
    inverse = np.linalg.inv(np.einsum("ki,kj->ij", seen, seen.conj()) + unsure)
    shape = found.directions @ modes.shape
    level = np.zeros(len(shape))
    if m < len(shape):  # what the other directions tell: a regression on the modal responses
        outside = found.values - found.values @ (found.directions @ back).T
        across = (outside.T @ seen.conj()) @ inverse
        level = np.mean(np.abs(outside - seen @ across.T) ** 2, axis=0)
        shape = shape + across
    largest = np.argmax(np.abs(shape), axis=0)
    size = shape[largest, range(r)]
    ratio = shape / size
    n = len(shape)
    spread, level_std = np.empty((r, 2 * n, 2 * n)), np.empty(r)
    for j in range(r):
        weight = found.directions @ _unknowns(modes, j)  # (n, p) complex: how a shape follows the unknowns
        relative = (weight - ratio[:, j : j + 1] * weight[largest[j]]) / size[j]
        parts = np.concatenate([relative.real, relative.imag])
        rest = (np.diag(level) + level[largest[j]] * np.outer(ratio[:, j], ratio[:, j].conj())) * inverse[j, j].real
        rest[largest[j]] = rest[:, largest[j]] = 0.0
        rest /= 2.0 * np.abs(size[j]) ** 2
        spread[j] = parts @ cov @ parts.T + np.block([[rest.real, -rest.imag], [rest.imag, rest.real]])
        along = (weight[largest[j]] / size[j]).real
        level_std[j] = 2.0 * np.sqrt(along @ cov @ along)
    own = np.maximum(np.einsum("jcc->cj", spread), 0.0)
    std = np.sqrt(0.5 * (own[:n] + own[n:]))
    load = np.abs(size) ** 2 * np.diagonal(modes.load @ modes.load.conj().T).real
    return Shapes(ratio, std, spread, largest, load, level_std)


def _modal_responses(modes: Modes, band: Band, values: Complex) -> tuple[Complex, Complex]:
    """Posterior means (k, r) of the modal responses at the bins, and the sum of their covariances (r, r)."""
    rows = np.repeat(np.arange(len(band.counts)), band.counts.astype(np.int64))
    h = responses(modes, band.frequency).T
    d = h[:, :, None] * (modes.load @ modes.load.conj().T) * h.conj()[:, None, :]
    phi = modes.shapes(band.frequency)
    ahead = d @ phi.conj().transpose(0, 2, 1)
    gain = ahead @ np.linalg.inv(phi @ ahead + modes.rest @ modes.rest.conj().T)
    unsure = np.einsum("k,kij->ij", band.counts, d - gain @ (phi @ d))
    return np.einsum("krm,km->kr", gain[rows], values), unsure


def _unknowns(modes: Modes, j: int) -> Complex:
    """Derivative (m, p) of the shape (m,) of mode j with respect to a step of the unknowns."""
    m, r = modes.shape.shape
    weight = np.zeros((m, modes.size), dtype=np.complex128)
    real, at = modes.real, 2 * r + m * r
    for i in range(r):
        for row in range(m):
            if i == j:
                weight[row, 2 * r + i * m + row] = 1.0
            if row != real[i]:
                if i == j:
                    weight[row, at] = 1j
                at += 1
    return weight


def principal_directions(values: Complex, most: int) -> tuple[Complex, Complex]:
    """Directions (n, m) and the way back (m, n): channels are scaled by their quiet level, directions have a mean power
    of about 1."""
    power = np.abs(values) ** 2
    quiet = np.sort(power, axis=0)[: max(4, len(power) // 4)].mean(axis=0)
    scale = np.sqrt(np.maximum(quiet, 1e-24 * power.mean(axis=0).max()))
    scaled = values / scale
    sizes, turned = np.linalg.eigh(scaled.T @ scaled.conj() / len(scaled))
    order = np.argsort(sizes)[::-1][:most]
    order = order[sizes[order] > MIN_DIRECTION_POWER * sizes[order[0]]]
    root = np.sqrt(sizes[order])
    turned = turned[:, order]
    return scale[:, None] * turned * root, turned.conj().T / root[:, None] / scale[None]

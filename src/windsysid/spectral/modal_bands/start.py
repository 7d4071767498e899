"""Start values of scoring: one mode more than in the last fit, at the largest excess of the data.

Where the data exceed the last fit most a mode is added, and shapes, loads and what else is in the band follow by a few
steps of expectation and maximisation (Dempster, Laird & Rubin 1977), the modal responses being what is not seen. The
start with the greatest likelihood is taken.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.signals.textbook import minimum
from windsysid.spectral.modal_bands.model import SLOPE_STD, Modes, height_of, responses, spectrum
from windsysid.spectral.transforms.dft import Band, plain_band

__all__ = ["add_mode", "deviance", "expect", "modes_at", "quiet_start", "without_modes"]

TRIAL_FREQUENCIES, MAX_TRIALS = 19, 3
"""Setting: number of frequencies over a band at which a mode may be, and how many of them are tried."""

TRIAL_WIDTH = 0.04
"""Setting: ζ f of a mode that is tried, over the width of the band."""

COARSE_ROWS = 100
"""Setting: number of rows of the data on which starts are compared."""

MAX_SLOPE = 40.0
"""Numerical: largest slope b of a band without modes."""

EM_STEPS = 8
"""Numerical: steps of expectation and maximisation."""


def without_modes(band: Band) -> Modes:
    """Background of a band without modes: the most probable slope b, and the mean of the scaled spectra, which has the
    greatest likelihood."""
    x = height_of(band.frequency, band)
    total, channels = float(band.counts.sum()), band.power.shape[1]

    def level(b: float) -> Complex:
        return np.asarray(np.tensordot(band.counts * np.exp(-b * x), band.power, 1) / total)

    def cost(b: float) -> float:
        ratio = float(np.linalg.slogdet(level(b))[1]) * total + b * channels * float(band.counts @ x)
        return float(ratio / band.factor + 0.5 * (b / SLOPE_STD) ** 2)

    slope = minimum(cost, -MAX_SLOPE, MAX_SLOPE, 1e-3)
    found = level(slope)
    found = found + 1e-9 * np.diag(np.einsum("kii->i", band.power).real / len(band.power))
    none, no = np.empty(0), np.empty((channels, 0), dtype=np.complex128)
    return Modes(none, none, no, np.empty((0, 0), dtype=np.complex128), 0.0, _root(found), slope)


def modes_at(known: Sequence[tuple[float, float]], band: Band) -> Modes:
    """A start with modes at known frequencies [Hz] and damping ratios."""
    band = _coarse(band)
    frequency, damping = (np.array(column) for column in zip(*known, strict=True))
    return expect(_begin(frequency, damping, band, quiet_start(band)), band)


def add_mode(modes: Modes, band: Band) -> Modes:
    """A start with one mode more."""
    low, high = band.frequency[0], band.frequency[-1]
    band = _coarse(band)
    quiet = quiet_start(band)
    places = low + (high - low) * (np.arange(TRIAL_FREQUENCIES) + 1.0) / (TRIAL_FREQUENCIES + 1.0)
    width = TRIAL_WIDTH * (high - low)
    best, least = modes, np.inf
    for i in np.argsort(-_unexplained(modes, band, places, width))[:MAX_TRIALS]:
        frequency, damping = np.append(modes.frequency, places[i]), np.append(modes.damping, width / places[i])
        trial = expect(_begin(frequency, damping, band, quiet), band)
        cost = deviance(trial, band)
        if cost < least:
            best, least = trial, cost
    return best


def _unexplained(modes: Modes, band: Band, places: Array, width: float) -> Array:
    """Excess of the data over the modes' spectrum around each place, along the direction of the largest, in
    standard deviations."""
    root = np.linalg.inv(np.linalg.cholesky(spectrum(modes, band)))
    white = root @ band.power @ root.conj().transpose(0, 2, 1)
    weight = 1.0 / (1.0 + ((band.frequency[None] - places[:, None]) / width) ** 2)
    scale = np.sqrt(weight**2 @ band.counts)
    over = np.einsum("pk,kij->pij", weight * band.counts, white - np.eye(white.shape[1])) / scale[:, None, None]
    return np.asarray(np.linalg.eigvalsh(over)[:, -1])


def _coarse(band: Band) -> Band:
    """Average neighbouring rows of a band, which is accurate enough for a start."""
    size = -(-len(band.counts) // COARSE_ROWS)
    if size == 1:
        return band
    starts = np.arange(0, len(band.counts), size)
    count = np.add.reduceat(band.counts, starts)
    frequency = np.add.reduceat(band.frequency * band.counts, starts) / count
    power = np.add.reduceat(band.power * band.counts[:, None, None], starts, axis=0) / count[:, None, None]
    return plain_band(frequency, count, np.asarray(power, dtype=np.complex128), band.factor)


def deviance(modes: Modes, band: Band) -> float:
    """−2 ln of the likelihood."""
    s = spectrum(modes, band)
    ratio = np.einsum("kij,kji->k", np.linalg.inv(s), band.power).real
    return 2.0 * float(band.counts @ (np.linalg.slogdet(s)[1] + ratio)) / band.factor


def _begin(frequency: Array, damping: Array, band: Band, rest: Complex) -> Modes:
    """Modes at given frequencies and damping ratios: shapes from the first principal directions there."""
    m, r = band.power.shape[1], len(frequency)
    shape = np.empty((m, r), dtype=np.complex128)
    floor = rest @ rest.conj().T
    width = band.frequency[1] - band.frequency[0]
    for j, (f, z) in enumerate(zip(frequency, damping, strict=True)):
        near = np.abs(band.frequency - f) <= max(z * f, 1.5 * width)
        here = np.average(band.power[near], axis=0, weights=band.counts[near]) if near.any() else floor
        sizes, directions = np.linalg.eigh(here - floor)
        size = max(float(sizes[-1]), 0.1 * float(np.trace(here).real) / m, 1e-12)
        shape[:, j] = directions[:, -1] * np.sqrt(size) * 2.0 * max(z, 0.3 * width / f)
    return Modes(frequency, damping, shape, np.eye(r, dtype=np.complex128), 0.0, rest, 0.0)


def expect(modes: Modes, band: Band, passes: int = EM_STEPS) -> Modes:
    """Shapes, loads and rest by a few steps of expectation and maximisation, frequencies and damping ratios as they
    are."""
    h = responses(modes, band.frequency).T  # (K, r)
    phi, b = modes.shape, modes.load @ modes.load.conj().T
    rest = modes.rest @ modes.rest.conj().T
    n, total = band.counts, float(band.counts.sum())
    level = np.einsum("kii->i", band.power).real / len(band.power)
    whole = np.einsum("k,kij->ij", n, band.power)
    for _ in range(passes):
        d = h[:, :, None] * b * h.conj()[:, None, :]
        ahead = d @ phi.conj().T
        gain = ahead @ np.linalg.inv(phi @ ahead + rest)
        seen = gain @ band.power
        moments = seen @ gain.conj().transpose(0, 2, 1) + d - gain @ (phi @ d)
        across = np.einsum("k,kji->ij", n, seen.conj())
        phi = across @ np.linalg.inv(np.einsum("k,kij->ij", n, moments))
        rest = (whole - phi @ across.conj().T) / total
        rest = _positive(0.5 * (rest + rest.conj().T) + np.diag(1e-9 * level), level)
        b = np.einsum("k,kij->ij", n, moments / (h[:, :, None] * h.conj()[:, None, :])) / total
        size = np.sqrt(np.diagonal(b).real)
        phi, b = phi * size, b / np.outer(size, size)
    low = np.linalg.cholesky(b + 1e-3 * np.eye(len(b)))
    diagonal = np.diagonal(low).real
    # C has ones on its diagonal: its columns' sizes go to Φ only where loads are not coherent, which is near enough for
    # a start
    return modes._replace(shape=phi * diagonal, load=low / diagonal[:, None], rest=_root(rest))


def quiet_start(band: Band, share: float = 0.25) -> Complex:
    """L (m, m) of the background in a band: the mean over the quietest rows, each channel's power counted alike."""
    power: NDArray[np.complex128] = band.power
    m = power.shape[1]
    own = np.einsum("kii->ki", power).real
    level = (own / own.mean(axis=0)).sum(axis=1)
    quiet = np.argsort(level)[: max(int(share * len(level)), min(m + 1, len(level)))]
    mean = np.average(power[quiet], axis=0, weights=band.counts[quiet])
    mean = mean + np.diag(1e-3 * np.diagonal(mean).real + 1e-9 * own.mean(axis=0))
    return _root(mean)


def _positive(matrix: Complex, level: Array) -> Complex:
    """A Hermitian matrix of channels with these powers (m,), positive where rounding made it negative: moments that are
    all but singular, of a filter's stop band, leave a difference of what is much larger."""
    root = np.sqrt(np.maximum(level, np.finfo(float).tiny))
    size = np.outer(root, root)
    values, vectors = np.linalg.eigh(matrix / size)
    if values[0] > 0.0:
        return matrix
    return np.asarray(((vectors * np.maximum(values, 1e-12)) @ vectors.conj().T) * size)


def _root(matrix: Complex) -> Complex:
    """L of a Hermitian matrix L Lᴴ. Rounding may make one that is singular, of a filter's stop band, not positive."""
    size = np.sqrt(np.maximum(np.diagonal(matrix).real, np.finfo(float).tiny))
    scaled, added = matrix / np.outer(size, size), 0.0
    while True:
        try:
            return np.asarray(size[:, None] * np.linalg.cholesky(scaled + added * np.eye(len(size))))
        except np.linalg.LinAlgError:
            if added > 1.0:
                raise
            added = max(10.0 * added, 1e-12)

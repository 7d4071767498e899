"""Spectra of channels under a fit, with intervals by the delta method.

The spectral formulation has the spectrum S(θ) of its entries and ∂S/∂θ. Filters of equations that do not change with
time whiten the readings by H(f; θ): S = H⁻¹ H⁻ᴴ and, with G = ∂H/∂θ H⁻¹ + its conjugate transpose, ∂S = −H⁻¹ G H⁻ᴴ.
The logarithm of S_kk has the variance gᵀ C g, g = ∂ ln S_kk / ∂θ, with the covariance C of the posterior.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.mechanics.sensors import Sensor
from windsysid.results.estimate import FittedSpectrum
from windsysid.spectral.rotor.model import LiftedModel

__all__ = ["dense_places", "joined_spectrum", "spectra_of_filter", "spectra_of_model"]

MAX_DERIVATIVE_NUMBERS = 8_000_000
"""Numerical: complex numbers of derivatives in memory, beyond which a spectrum has no interval."""

MAX_FREQUENCIES = 800
"""Setting: frequencies at which a fitted spectrum is kept."""


def spectra_of_model(
    model: LiftedModel, unknowns: Array, cov: Array, labels: Sequence[tuple[str, bool]]
) -> tuple[FittedSpectrum, ...]:
    """Spectra of the entries of a model of spectra, those of one name together; `labels` (e,) are name and frame."""
    entries = len(model.place.entries)
    slopes = len(unknowns) * len(model.place.base) * entries**2 <= MAX_DERIVATIVE_NUMBERS
    found = model.spectrum(unknowns, slopes=slopes)
    S = np.einsum("bii->bi", found.spectrum).real
    of_logarithm = np.einsum("nbii->nbi", found.slopes).real / S if slopes else np.zeros((len(unknowns), *S.shape))
    log_std = _deviation(of_logarithm, cov) if slopes else np.full(S.shape, np.nan)
    power, _, unsigned = model.powers(unknowns)
    alike = len(power) // len(S)
    blocks = power[: alike * len(S)].reshape(len(S), alike, entries)
    known = np.isfinite(blocks)
    measured = np.where(known, blocks, 0.0).sum(axis=1) / np.where(known.any(axis=1), known.sum(axis=1), np.nan)
    frequency = unsigned[::alike][: len(S)]
    spectra = []
    for name, turning in dict.fromkeys(labels):
        which = [i for i, label in enumerate(labels) if label == (name, turning)]
        f, density, std, data = (x[:, which].ravel() for x in (frequency, 2.0 * S, log_std, 2.0 * measured))
        order = np.argsort(f)
        order = order[np.isfinite(data[order])]
        if len(order):
            spectra.append(FittedSpectrum(name, turning, f[order], density[order], std[order], data[order]))
    return tuple(spectra)


def joined_spectrum(parts: Sequence[FittedSpectrum]) -> FittedSpectrum:
    """Spectra of one channel in several frequency ranges as one."""
    first = parts[0]
    order = np.argsort(np.concatenate([one.frequency for one in parts]))
    f, density, std, measured = (
        np.concatenate([np.asarray(values) for values in column])[order]
        for column in zip(*((one.frequency, one.density, one.log_std, one.measured) for one in parts), strict=True)
    )
    return FittedSpectrum(first.channel, first.turning, f, density, std, measured)


def spectra_of_filter(
    whitening: Complex, gradients: Complex, cov: Array, frequency: Array, sensors: Sequence[Sensor]
) -> tuple[FittedSpectrum, ...]:
    """Spectra of readings that H (F, m, m) whitens, with G (F, n, m, m), at frequencies (F,) [Hz] whose last is next to
    half the sampling rate."""
    inverse = np.linalg.inv(whitening)
    interval = 0.5 / (frequency[-1] + frequency[0])
    S = np.einsum("fij,fij->fi", inverse, inverse.conj()).real
    some = dense_places(frequency, S, MAX_FREQUENCIES)
    H, G = inverse[some], gradients[some]
    slopes = -np.einsum("fij,fnjk,fik->nfi", H, G, H.conj()).real / S[some]
    log_std = _deviation(slopes, cov)
    return tuple(
        FittedSpectrum(sensor.channel, bool(sensor.blade), frequency[some], 2.0 * interval * S[some, i], log_std[:, i])
        for i, sensor in enumerate(sensors)
    )


def _deviation(slopes: Array, cov: Array) -> Array:
    """Standard deviations (F, m) of what has slopes (n, F, m)."""
    variance = np.einsum("nfi,nk,kfi->fi", slopes, cov, slopes, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def dense_places(frequency: Array, S: Array, count: int) -> NDArray[np.intp]:
    """At most `count` bins: dense in frequency, in its logarithm, and where a spectrum (F, m) is steep."""
    steep = np.abs(np.diff(np.log(S), axis=0, prepend=np.log(S[:1]))).sum(axis=1)
    dense = [steep, np.diff(np.log(frequency), prepend=np.log(frequency[0])), np.ones(len(frequency))]
    reached = np.sum([np.cumsum(one) / max(float(one.sum()), 1e-300) for one in dense], axis=0)
    wanted = np.linspace(reached[0], reached[-1], count)
    return np.unique(np.minimum(np.searchsorted(reached, wanted), len(frequency) - 1))

"""Transforms of a record in frames that turn with the rotor, and their sums over blocks of equal length.

A vector v about the frequency f has the support's readings at f and f ± Ω, and those of the blades at f, where they
turn (`windsysid.spectral.rotor_bands.channels`).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Complex
from windsysid.spectral.transforms.block_sums import BlockSums, factored
from windsysid.spectral.transforms.dft import taper, taper_factor
from windsysid.spectral.transforms.lifted import count_harmonics, without_rotor_harmonics

__all__ = ["MAX_GROUPS", "TurnedBlock", "TurnedSpectra", "combine_groups", "turned_block", "turned_spectra"]

MAX_GROUPS = 4
"""Setting: number of groups of blocks that are kept for a comparison of beginning and end."""

HARMONICS = (0, 1, -1)
"""Setting: harmonics at which sensors of the support are analysed; those of blades at the first."""


class TurnedSpectra(NamedTuple):
    """Transforms of a record in frames that turn with the rotor.

    Attributes
    ----------
    data
        Y_k at the bins 0, 1, 2 … below half the rate (T/2, m, 1) for each k; of several blocks columns (B, m, g) that
        have the products of all together.
    rotor_hz, duration, overlap
        Ω / 2π [Hz], T [s], c_h.
    taper
        h (T,).
    blocks
        Of how many blocks `data` are.
    recent, gusts
        Where there are several, Y_k of the last, and how much larger c_h is for what changes between them.
    """

    data: dict[int, Complex]
    rotor_hz: float
    duration: float
    overlap: float
    taper: Array
    blocks: float = 1.0
    recent: dict[int, Complex] | None = None
    gusts: float = 1.0

    def combined(self, weights: Complex, k: int = 0) -> Complex:
        """Y_k of a combination of readings (m,): (B, g)."""
        return np.asarray(np.einsum("bmg,m->bg", self.data[k], weights))


class TurnedBlock(NamedTuple):
    """The transforms of one block.

    Attributes
    ----------
    data
        Y_k (3, B, m) at the harmonics `HARMONICS`.
    support
        Which readings (m,) are not on blades.
    rotor_hz, duration, overlap, taper
        As of `TurnedSpectra`.
    """

    data: Complex
    support: NDArray[np.bool_]
    rotor_hz: float
    duration: float
    overlap: float
    taper: Array

    @property
    def read_at(self) -> list[NDArray[np.intp]]:
        """The readings that are used at each harmonic."""
        return [np.flatnonzero(self.support | (k == 0)) for k in HARMONICS]

    @property
    def vectors(self) -> Complex:
        """v (B, E)."""
        return np.concatenate([Y[:, seen] for Y, seen in zip(self.data, self.read_at, strict=True)], axis=1)

    @property
    def energies(self) -> Array:
        """Mean square of every reading (m,)."""
        return np.asarray(np.sum(np.abs(self.data[0]) ** 2, axis=0) / self.data.shape[1])

    @property
    def independent(self) -> Array:
        """Effective number of bins of each reading (m,), (Σ P)² / Σ P²."""
        power = np.abs(self.data[0]) ** 2
        return np.asarray(power.sum(axis=0) ** 2 / np.maximum(np.sum(power**2, axis=0), 1e-300))

    def averaged(self, before: "TurnedBlock", share: float) -> "TurnedBlock":
        """The block at the mean speed: that of earlier blocks, moved by a share towards its own."""
        return self._replace(rotor_hz=before.rotor_hz + share * (self.rotor_hz - before.rotor_hz))


def turned_spectra(readings: Array, azimuth: Array, rate: float, reach: int) -> TurnedSpectra:
    """Y_k, |k| ≤ `reach`, of readings (T, m) without gaps at `rate` [Hz] and azimuths (T,) [rad, unwrapped], harmonics
    of the rotor taken out."""
    samples = len(azimuth)
    duration = samples / rate
    turned = abs(float(azimuth[-1] - azimuth[0])) / (2.0 * math.pi) * samples / (samples - 1)
    rotor_hz = turned / duration
    h = taper(samples)
    quiet = without_rotor_harmonics(readings, azimuth, h, count_harmonics(rotor_hz, rate)) * h[:, None]
    scale = math.sqrt(1.0 / rate / float(h @ h))
    bins = np.arange((samples + 1) // 2)
    data: dict[int, Complex] = {0: (scale * np.fft.rfft(quiet, axis=0)[bins])[:, :, None]}
    for k in range(1, reach + 1):  # readings are real: Y_{−k}(f) is the complex conjugate of Y_k(−f)
        whole = (scale * np.fft.fft(quiet * np.exp(-1j * k * azimuth)[:, None], axis=0))[:, :, None]
        data |= {k: whole[bins], -k: whole[-bins].conj()}
    return TurnedSpectra(data, rotor_hz, duration, taper_factor(samples), h)


def turned_block(spectra: TurnedSpectra, support: NDArray[np.bool_], highest: int | None = None) -> TurnedBlock:
    """The transforms of one block up to the bin `highest`, of readings of which some are of the `support` (m,)."""
    last = None if highest is None else highest + 1
    data = np.array([spectra.data[k][:last, :, 0] for k in HARMONICS])
    return TurnedBlock(data, support, spectra.rotor_hz, spectra.duration, spectra.overlap, spectra.taper)


def combine_groups(sums: BlockSums[TurnedBlock], groups: Sequence[int] | None = None) -> TurnedSpectra:
    """Transforms with the products of the blocks of some groups, or of all: columns of Z with Z Zᴴ = Σ v vᴴ."""
    chosen = range(len(sums.sizes)) if groups is None else groups
    Z, last = factored(np.sum([sums.powers[i] for i in chosen], axis=0)), sums.last
    data, first = {}, 0
    for k, seen in zip(HARMONICS, last.read_at, strict=True):
        data[k] = np.zeros((len(Z), len(last.support), Z.shape[2]), dtype=np.complex128)
        data[k][:, seen] = Z[:, first : first + len(seen)]
        first += len(seen)
    recent = {k: Y[:, :, None] for k, Y in zip(HARMONICS, last.data, strict=True)}
    blocks = sum(sums.counts[i] for i in chosen)
    return TurnedSpectra(data, last.rotor_hz, last.duration, last.overlap, last.taper, blocks, recent, sums.gusts)

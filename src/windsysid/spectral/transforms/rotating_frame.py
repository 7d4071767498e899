"""Spectra of many blocks of equal length in frames that turn with the rotor, in a memory that does not grow.

What bands ask of N blocks with one spectrum is N and Σ v vᴴ at every bin, v being what is read at f and, of the
support, at f ± Ω. So blocks add, and so do records of one machine in one state. The sums are kept in a few groups of
successive blocks, so that the beginning can be held against the end.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array
from windsysid.spectral.rotor_bands.channels import TurnedSpectra
from windsysid.spectral.transforms.lifted import Complex
from windsysid.spectral.transforms.lifted_blocks import factored, gusts_of

__all__ = ["TurnedSums"]

MOST_GROUPS = 4
"""Groups that are kept; where there are more, neighbours are added."""

HARMONICS = (0, 1, -1)
"""At which the support is read; blades are read at the first."""


T = TypeVar("T", Complex, float, int)


class TurnedSums(NamedTuple):
    """Sums over blocks.

    Attributes
    ----------
    powers
        Σ v vᴴ (B, E, E) of every group [unit²/Hz].
    counts
        As how many blocks each group counts, as far as they are not forgotten.
    sizes
        How many blocks were added to each.
    support
        Which readings (m,) are not on blades.
    last
        The last block; its rotor speed is the mean of all blocks'.
    energies, independent
        Mean square of every reading in every block (n, m) [unit²/Hz], and as how many independent values each counts.
    """

    powers: tuple[Complex, ...]
    counts: tuple[float, ...]
    sizes: tuple[int, ...]
    support: NDArray[np.bool_]
    last: TurnedSpectra
    energies: Array
    independent: Array

    @classmethod
    def of(cls, block: TurnedSpectra, support: NDArray[np.bool_]) -> "TurnedSums":
        """The sums over one block."""
        energies, independent = _energies(block)
        return cls((_products(block, support),), (1.0,), (1,), support, block, energies[None], independent[None])

    def plus(self, block: TurnedSpectra, memory: float = 1.0) -> "TurnedSums":
        """The sums with another block, all before weighted by `memory`."""
        powers = [memory * power for power in self.powers]
        counts, sizes = [memory * count for count in self.counts], list(self.sizes)
        if len(sizes) > 1 and sizes[-1] < sizes[0]:
            powers[-1] = powers[-1] + _products(block, self.support)
            counts[-1], sizes[-1] = counts[-1] + 1.0, sizes[-1] + 1
        else:
            powers, counts, sizes = [*powers, _products(block, self.support)], [*counts, 1.0], [*sizes, 1]
        if len(sizes) > MOST_GROUPS:
            powers, counts, sizes = _paired(powers), _paired(counts), _paired(sizes)
        hz = self.last.rotor_hz + (block.rotor_hz - self.last.rotor_hz) / sum(counts)
        energies, independent = _energies(block)
        return TurnedSums(
            tuple(powers), tuple(counts), tuple(sizes), self.support, block._replace(rotor_hz=hz),
            np.vstack([self.energies, energies]), np.vstack([self.independent, independent]),
        )  # fmt: skip

    @property
    def blocks(self) -> float:
        """How many, as far as they are not forgotten."""
        return sum(self.counts)

    @property
    def gusts(self) -> float:
        """As `gusts_of` has it."""
        return gusts_of(self.energies, self.last.overlap / self.independent.mean(axis=0))

    def spectra(self) -> TurnedSpectra:
        """What stands for all blocks."""
        return self._of(range(len(self.sizes)))

    def halves(self) -> tuple[TurnedSpectra, TurnedSpectra] | None:
        """What stands for the first blocks and for the last, about half of them each; None of one block."""
        if len(self.sizes) < 2:
            return None
        ends = np.cumsum(self.sizes)
        first = 1 + int(np.argmin(np.abs(ends[:-1] - 0.5 * ends[-1])))
        return self._of(range(first)), self._of(range(first, len(self.sizes)))

    def _of(self, groups: Sequence[int]) -> TurnedSpectra:
        """What stands for some groups: columns of Z with Z Zᴴ = Σ v vᴴ, where v was one column."""
        Z = factored(np.sum([self.powers[i] for i in groups], axis=0))
        m = len(self.support)
        data, first = {}, 0
        for k, seen in zip(HARMONICS, _seen(self.support), strict=True):
            data[k] = np.zeros((len(Z), m, Z.shape[2]), dtype=np.complex128)
            data[k][:, seen] = Z[:, first : first + len(seen)]
            first += len(seen)
        blocks = sum(self.counts[i] for i in groups)
        return self.last._replace(data=data, blocks=blocks, recent=self.last.data, gusts=self.gusts)

    def stored(self) -> dict[str, Any]:
        """All of it in arrays by name."""
        last = self.last
        numbers = np.array([last.rotor_hz, last.duration, last.overlap])
        found: dict[str, Any] = {f"last_{k}": last.data[k] for k in HARMONICS}
        return found | {
            "powers": np.array(self.powers), "counts": np.array(self.counts), "sizes": np.array(self.sizes),
            "support": self.support, "numbers": numbers, "taper": last.taper, "energies": self.energies,
            "independent": self.independent,
        }  # fmt: skip

    @classmethod
    def restored(cls, arrays: Mapping[str, Any]) -> "TurnedSums":
        """What `stored` gave."""
        hz, duration, overlap = arrays["numbers"].tolist()
        data = {k: arrays[f"last_{k}"] for k in HARMONICS}
        return cls(
            tuple(arrays["powers"]), tuple(arrays["counts"].tolist()), tuple(arrays["sizes"].tolist()),
            arrays["support"].astype(np.bool_), TurnedSpectra(data, hz, duration, overlap, arrays["taper"]),
            arrays["energies"], arrays["independent"],
        )  # fmt: skip


def _seen(support: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Which readings are kept at every harmonic."""
    return [np.flatnonzero(support | (k == 0)) for k in HARMONICS]


def _products(block: TurnedSpectra, support: NDArray[np.bool_]) -> Complex:
    """v vᴴ (B, E, E)."""
    parts = [block.data[k][:, seen, 0] for k, seen in zip(HARMONICS, _seen(support), strict=True)]
    v = np.concatenate(parts, axis=1)
    return np.asarray(v[:, :, None] * v[:, None, :].conj())


def _energies(block: TurnedSpectra) -> tuple[Array, Array]:
    """Mean square of every reading (m,), and as how many bins it counts, (Σ P)² / Σ P²."""
    power = np.abs(block.data[0][:, :, 0]) ** 2
    total = power.sum(axis=0)
    return total / len(power), total**2 / np.maximum(np.sum(power**2, axis=0), 1e-300)


def _paired(values: list[T]) -> list[T]:
    """Sums of two neighbours each; what is over stays."""
    return [a + b for a, b in zip(values[::2], values[1::2], strict=False)] + values[len(values) // 2 * 2 :]

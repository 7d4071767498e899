"""Lifted spectra of many blocks of equal turns, in a memory that does not grow.

What a likelihood asks of N blocks with one spectrum S is N and Σ Y Yᴴ at every base frequency. So blocks add, and so do
records of one machine in one state. A block counts less and less where what came before is to be forgotten.
"""

from typing import NamedTuple

import numpy as np

from windsysid._types import Array
from windsysid.spectral.transforms.lifted import Complex, Lifted

__all__ = ["LiftedSums", "factored", "sums_of"]


class LiftedSums(NamedTuple):
    """Sums over blocks.

    Attributes
    ----------
    power
        Σ Y Yᴴ (B, E, E) of the entries E = (2K + 1) m of a lifted vector [unit²/Hz].
    blocks
        How many, as far as they are not forgotten.
    last
        The last block; its frequencies are the mean of all blocks'.
    energies
        Mean square of every reading in every block (n, m) [unit²/Hz].
    """

    power: Complex
    blocks: float
    last: Lifted
    energies: Array

    def plus(self, block: Lifted, memory: float = 1.0) -> "LiftedSums":
        """The sums with another block, all before weighted by `memory`.

        Raises
        ------
        ValueError
            If the block has other frequencies.
        """
        if block.data.shape != self.last.data.shape:
            raise ValueError(f"expected a block of {self.last.data.shape} numbers, got {block.data.shape}")
        blocks = memory * self.blocks + 1.0
        share = 1.0 / blocks
        before = self.last
        mean = block._replace(
            base=before.base + share * (block.base - before.base),
            rotor_hz=before.rotor_hz + share * (block.rotor_hz - before.rotor_hz),
        )
        power = memory * self.power + _products(block)
        return LiftedSums(power, blocks, mean, np.vstack([self.energies, _energy(block)]))

    @property
    def gusts(self) -> float:
        """As `gusts_of` has it."""
        return gusts_of(self.energies, self.last.overlap / len(self.power))


def gusts_of(energies: Array, chance: Array | float) -> float:
    """1 + (spread of the blocks' energies (n, m) over their mean)², less what chance makes of it: by so much c_h grows
    where loads grow and fall from block to block."""
    if len(energies) < 3:
        return 1.0
    shares = energies / energies.mean(axis=0)
    return 1.0 + max(0.0, float(np.mean(shares.var(axis=0) - chance)))


def sums_of(block: Lifted) -> LiftedSums:
    """The sums over one block."""
    return LiftedSums(_products(block), 1.0, block, _energy(block)[None])


def factored(power: Complex) -> Complex:
    """Z (B, e, e) with Z Zᴴ = Σ Y Yᴴ (B, e, e): what may stand for all Y where only their products count."""
    values, vectors = np.linalg.eigh(power)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :], dtype=np.complex128)


def _products(block: Lifted) -> Complex:
    Y = block.data.reshape(len(block.data), -1)
    return np.asarray(Y[:, :, None] * Y[:, None, :].conj())


def _energy(block: Lifted) -> Array:
    """Mean square of every reading (m,)."""
    return np.asarray(np.mean(np.abs(block.data) ** 2, axis=(0, 1)))

"""Sums of spectral matrices over blocks of a record, in a memory that does not grow.

The likelihood of N blocks with one spectrum depends on N and on Σ v vᴴ at every bin, v being the vector of a block's
transforms there. So blocks add, and so do records of one machine in one state. A block counts less and less where what
came before is to be forgotten. The sums are kept in a few groups of successive blocks where the beginning is to be
compared with the end.
"""

from collections.abc import Callable, Mapping
from typing import Any, Generic, NamedTuple, Protocol, Self, TypeVar

import numpy as np

from windsysid._types import Array, Complex

__all__ = ["BlockSums", "BlockTransform", "cut_blocks", "cut_turns", "factored"]


class BlockTransform(Protocol):
    """The transforms of one block, a NamedTuple of arrays and numbers."""

    @property
    def vectors(self) -> Complex:
        """v at every bin (B, E) [unit/√Hz]."""

    @property
    def energies(self) -> Array:
        """Mean squares of the readings [unit²/Hz], in as many numbers as are to be compared between blocks."""

    @property
    def independent(self) -> Array:
        """Degrees of freedom of each mean square, but for `overlap`."""

    @property
    def overlap(self) -> float:
        """c_h ≥ 1: how many bins count as one."""

    def averaged(self, before: Self, share: float, /) -> Self:
        """The block at mean frequencies: those of earlier blocks, moved by a share towards its own."""

    def _asdict(self) -> dict[str, Any]: ...


Block = TypeVar("Block", bound=BlockTransform)
Summand = TypeVar("Summand", Complex, float, int)


class BlockSums(NamedTuple, Generic[Block]):
    """Sums over blocks.

    Attributes
    ----------
    powers, counts, sizes
        Of each group of successive blocks: Σ v vᴴ (B, E, E) [unit²/Hz], its number of blocks as far as they are not
        forgotten, and that of all.
    last
        The last block, its frequencies being the mean of all blocks'.
    energies, independent
        As of `BlockTransform`, of every block (n, …).
    groups
        Most groups that are kept; where there would be more, neighbours are added.
    """

    powers: tuple[Complex, ...]
    counts: tuple[float, ...]
    sizes: tuple[int, ...]
    last: Block
    energies: Array
    independent: Array
    groups: int

    @classmethod
    def of(cls, block: Block, groups: int = 1) -> "BlockSums[Block]":
        """The sums over one block."""
        return BlockSums(
            (_products(block),), (1.0,), (1,), block, block.energies[None], block.independent[None], groups
        )

    def plus(self, block: Block, memory: float = 1.0) -> "BlockSums[Block]":
        """The sums with another block, all before weighted by `memory`; ValueError for other frequencies."""
        product = _products(block)
        if product.shape != self.powers[0].shape:
            raise ValueError(f"expected a block of {self.powers[0].shape} numbers, got {product.shape}")
        powers = [memory * power for power in self.powers]
        counts, sizes = [memory * count for count in self.counts], [*self.sizes]
        if len(sizes) > 1 and sizes[-1] < sizes[0]:
            powers[-1], counts[-1], sizes[-1] = powers[-1] + product, counts[-1] + 1.0, sizes[-1] + 1
        else:
            powers, counts, sizes = [*powers, product], [*counts, 1.0], [*sizes, 1]
        if len(sizes) > self.groups:
            powers, counts, sizes = _paired(powers), _paired(counts), _paired(sizes)
        return self._replace(
            powers=tuple(powers), counts=tuple(counts), sizes=tuple(sizes),
            last=block.averaged(self.last, 1.0 / sum(counts)),
            energies=np.concatenate([self.energies, block.energies[None]]),
            independent=np.concatenate([self.independent, block.independent[None]]),
        )  # fmt: skip

    @property
    def power(self) -> Complex:
        """Σ v vᴴ (B, E, E) of all blocks [unit²/Hz]."""
        return self.powers[0] if len(self.powers) == 1 else np.asarray(np.sum(self.powers, axis=0))

    @property
    def blocks(self) -> float:
        """Number of blocks, weighted by the memory."""
        return sum(self.counts)

    @property
    def gusts(self) -> float:
        """1 + (spread of the blocks' energies over their mean)², less what chance makes of it: by so much c_h grows
        where loads grow and fall from block to block."""
        shares = self.energies / self.energies.mean(axis=0)
        chance = self.last.overlap / self.independent.mean(axis=0)
        return 1.0 + max(0.0, float(np.mean(shares.var(axis=0) - chance)))

    def halves(self) -> tuple[range, range] | None:
        """The groups of the first blocks and those of the last, about half of the blocks each; None of one group."""
        if len(self.sizes) < 2:
            return None
        ends = np.cumsum(self.sizes)
        first = 1 + int(np.argmin(np.abs(ends[:-1] - 0.5 * ends[-1])))
        return range(first), range(first, len(self.sizes))

    def stored(self) -> dict[str, Any]:
        """All of it in arrays by name."""
        found = {name: np.array(value) for name, value in self._asdict().items() if name != "last"}
        return found | {f"last_{name}": np.asarray(value) for name, value in self.last._asdict().items()}

    @classmethod
    def restored(cls, arrays: Mapping[str, Any], kind: Callable[..., Block]) -> "BlockSums[Block]":
        """The sums whose `stored` arrays are given, over blocks of a kind."""
        last = {name.removeprefix("last_"): arrays[name] for name in arrays if name.startswith("last_")}
        return BlockSums(
            tuple(arrays["powers"]), tuple(arrays["counts"].tolist()), tuple(arrays["sizes"].tolist()),
            kind(**{name: value if value.ndim else value.item() for name, value in last.items()}),
            arrays["energies"], arrays["independent"], int(arrays["groups"]),
        )  # fmt: skip


def factored(power: Complex) -> Complex:
    """Z (B, e, e) with Z Zᴴ = Σ v vᴴ (B, e, e): what may stand for all v where only their products count."""
    values, vectors = np.linalg.eigh(power)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :], dtype=np.complex128)


def cut_blocks(count: int, samples: int, overlap: float = 0.0) -> tuple[list[slice], int]:
    """Blocks of a number of samples in `count` samples, each beginning before the end of the one before it by a share
    `overlap`, and the sample with which the next block begins."""
    return _cut(lambda first: first + samples if first + samples <= count else None, overlap)


def cut_turns(azimuth: Array, turns: int, overlap: float = 0.0) -> tuple[list[slice], int]:
    """Blocks of a number of turns of a rotor at azimuths (T,) [rad, unwrapped]; otherwise as `cut_blocks`."""

    def end_of(first: int) -> int | None:
        if len(azimuth) - first < 2:
            return None
        turned = np.abs(azimuth[first:] - azimuth[first])
        end = int(np.searchsorted(turned, 2.0 * np.pi * turns))
        return first + end + 1 if end < len(turned) else None

    return _cut(end_of, overlap)


def _cut(end_of: Callable[[int], int | None], overlap: float) -> tuple[list[slice], int]:
    blocks, first = [], 0
    while (end := end_of(first)) is not None:
        blocks.append(slice(first, end))
        first += round((1.0 - overlap) * (end - first))
    return blocks, first


def _products(block: BlockTransform) -> Complex:
    """v vᴴ (B, E, E)."""
    v = block.vectors
    return np.asarray(v[:, :, None] * v[:, None, :].conj())


def _paired(values: list[Summand]) -> list[Summand]:
    """Sums of two neighbours each; an odd last one stays."""
    return [a + b for a, b in zip(values[::2], values[1::2], strict=False)] + values[len(values) // 2 * 2 :]

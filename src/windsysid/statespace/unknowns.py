"""Unknowns of an estimation problem in named blocks, in one order for every vector and matrix of unknowns."""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from windsysid._types import Array

__all__ = ["BlockName", "Unknowns"]

BlockName = Literal["parameters", "lag", "statistics", "tolerances", "clocks", "effects"]


class Unknowns(NamedTuple):
    """Names of the unknowns, block by block, in the order in which vectors hold them.

    Attributes
    ----------
    parameters
        θ, the identified parameters in filter coordinates.
    lag
        The blades' mean lag angle, where it is unknown.
    statistics
        η, coordinates of the statistics of loads and noise.
    tolerances
        τ, errors of gains, axes and masses, in standard deviations of their tolerances.
    clocks
        Lags of loggers, in standard deviations of their tolerances.
    effects
        φ, sizes of disturbances.
    """

    parameters: tuple[str, ...] = ()
    lag: tuple[str, ...] = ()
    statistics: tuple[str, ...] = ()
    tolerances: tuple[str, ...] = ()
    clocks: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all unknowns (n,)."""
        return sum(self, ())

    @property
    def size(self) -> int:
        """Number of unknowns n."""
        return sum(map(len, self))

    def of(self, first: BlockName, last: BlockName | None = None) -> slice:
        """Places of a block, or of all blocks from the `first` to the `last`."""
        begin, end = self._fields.index(first), self._fields.index(last or first) + 1
        return slice(sum(map(len, self[:begin])), sum(map(len, self[:end])))

    def places(self, *blocks: BlockName) -> NDArray[np.intp]:
        """Places of several blocks, in the order in which they are named."""
        every = np.arange(self.size)
        return np.concatenate([every[self.of(block)] for block in blocks])

    def but(self, *blocks: BlockName) -> NDArray[np.intp]:
        """Places of all other blocks."""
        return np.setdiff1d(np.arange(self.size), self.places(*blocks))

    def only(self, *blocks: BlockName) -> "Unknowns":
        """The unknowns of these blocks alone."""
        return Unknowns(**{block: getattr(self, block) for block in blocks})

    def vector(self, **values: ArrayLike) -> Array:
        """All unknowns (n,): blocks with these values, zeros otherwise."""
        found = np.zeros(self.size)
        for block, value in values.items():
            found[self.of(block)] = value  # type: ignore[arg-type]
        return found

    def from_other(self, values: Array, other: "Unknowns") -> Array:
        """All unknowns (n,), with the `values` of another problem's unknowns in the blocks that are the same, zeros
        otherwise."""
        same = [block for block, ours, theirs in zip(self._fields, self, other, strict=True) if ours == theirs]
        return self.vector(**{block: values[other.of(block)] for block in same})  # type: ignore[arg-type]

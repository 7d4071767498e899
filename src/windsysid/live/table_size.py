"""How large the table of a window becomes: between two samples of one logger every moment is a row.

Two samples 10 min apart at 20 kHz are a table of 12 million rows. A block is refused where the table would grow far
more than by the samples that the block brings and those that may still come. So a gap is never refused before its
window is nearly over, and one wide or fast block does not use up what the blocks behind it may hold.
"""

from typing import NamedTuple

from windsysid.live.block import Block
from windsysid.live.codec import BlockRefused
from windsysid.live.limits import cells_allowed

__all__ = ["Growth", "TableSize", "growth"]

SECOND = 1_000_000_000
"""Nanoseconds."""


class TableSize(NamedTuple):
    """The table of one logger's samples at one rate, within one window.

    Attributes
    ----------
    first, last
        Time of the first row and of the end of the last one [ns since 1970].
    channels
        Names of its columns.
    rate
        Rows a second [Hz].
    """

    first: int
    last: int
    channels: frozenset[str]
    rate: float

    @property
    def cells(self) -> float:
        """Number of rows × columns."""
        return (self.last - self.first) / SECOND * self.rate * len(self.channels)


class Growth(NamedTuple):
    """A table without a block and with it."""

    before: TableSize | None
    after: TableSize

    def check(self, block: Block, until: int) -> None:
        """Refuse a block for which the table would grow too much; `until` is the end of the window [ns since 1970].

        Raises
        ------
        BlockRefused
            With the size of the table.
        """
        grown = self.after.cells - (self.before.cells if self.before is not None else 0.0)
        coming = max(0.0, (until - self.after.last) / SECOND * block.rate * len(block.channels))
        if grown > cells_allowed(block.values.size + coming):
            seconds = (self.after.last - self.after.first) / SECOND
            raise BlockRefused(
                f"block of {len(block.values)} samples makes the window's table {seconds:.4g} s at {block.rate:g} Hz ×"
                f" {len(self.after.channels)} channels: expected a lower rate, fewer channels or no such gap"
            )


def growth(before: TableSize | None, block: Block, window: int, until: int) -> Growth:
    """The table of a window from `window` to `until` [ns since 1970] without a block and with it."""
    first = max(block.start, window)
    last = min(block.start + round(len(block.values) * SECOND / block.rate), until)
    if before is None:
        return Growth(None, TableSize(first, last, frozenset(block.channels), block.rate))
    names = before.channels if before.channels.issuperset(block.channels) else before.channels.union(block.channels)
    return Growth(before, TableSize(min(first, before.first), max(last, before.last), names, block.rate))

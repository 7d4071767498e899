"""Size of a window's table, which has a row for every sampling instant between the first and the last sample.

Two samples 10 min apart at 20 kHz make a table of 12 million rows. A block is refused if the table would grow by far
more cells than the block has values and the rest of the window may still have. So a gap is never refused before its
window is nearly over, and one wide or fast block does not use up the size allowed for the following blocks.
"""

from typing import NamedTuple

from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockRefused
from windsysid.live.blocks.limits import cells_allowed
from windsysid.live.windows.timeline import SECOND

__all__ = ["Growth", "TableSize", "growth"]


class TableSize(NamedTuple):
    """Extent of the table of one logger's samples at one rate, within one window.

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
    """Size of a table without and with a block."""

    before: TableSize | None
    after: TableSize

    def check(self, block: Block, until: int) -> None:
        """Refuse a block that makes the table grow too much; `until` is the end of the window [ns since 1970].

        Raises
        ------
        BlockRefused
            If the table would be too large.
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
    """Size of the table of a window from `window` to `until` [ns since 1970] without and with a block."""
    first = max(block.start, window)
    last = min(block.start + round(len(block.values) * SECOND / block.rate), until)
    if before is None:
        return Growth(None, TableSize(first, last, frozenset(block.channels), block.rate))
    names = before.channels if before.channels.issuperset(block.channels) else before.channels.union(block.channels)
    return Growth(before, TableSize(min(first, before.first), max(last, before.last), names, block.rate))

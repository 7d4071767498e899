"""Limits on blocks from senders, as docs/live_sources.md lists them.

A sender is not trusted. The memory and time for a block are bounded by its size, and the size of a window's table by
the number of values received for it.
"""

from typing import NamedTuple

from windsysid.output.console import printable

__all__ = ["MAX_TABLE_CHANNELS", "MAX_TIME_NS", "BlockLimits", "cells_allowed", "one_line"]

MAX_TIME_NS = 2**62
"""Latest time of a sample [ns since 1970], in the year 2116."""

ALWAYS_ALLOWED_CELLS = 4_000_000
"""Number of cells of a window's table that is always allowed (32 MB): 10 min of 66 channels at 100 Hz."""

MAX_CELLS_PER_VALUE = 8
"""Number of further cells for each value received: seven of eight samples of a large table may be missing."""

MAX_TABLE_CHANNELS = 1000
"""Largest number of channels of a turbine; of more, those with the fewest or the oldest samples are left out."""

_MAX_REASON_CHARACTERS = 300
"""Length of the reason for a refusal."""


class BlockLimits(NamedTuple):
    """Limits on a block.

    Attributes
    ----------
    payload
        Size of the message [bytes].
    samples, channels
        Largest numbers in a block.
    rate, lowest_rate
        Highest and lowest sampling rate [Hz].
    name
        Length of a channel's name or unit [characters], which must be printable.
    magnitude
        Largest absolute value in SI; a larger or infinite one counts as missing.
    """

    payload: int = 8_000_000
    samples: int = 500_000
    channels: int = 200
    rate: float = 20_000.0
    lowest_rate: float = 1e-4
    name: int = 200
    magnitude: float = 1e30


def cells_allowed(values: float) -> float:
    """Largest number of cells of a window's table for this number of received values."""
    return ALWAYS_ALLOWED_CELLS + MAX_CELLS_PER_VALUE * values


def one_line(text: str, most: int = _MAX_REASON_CHARACTERS) -> str:
    """Return the text as one line of at most `most` printable characters."""
    shown = printable(" ".join(text.split()))
    return shown if len(shown) <= most else f"{shown[: most - 1]}…"

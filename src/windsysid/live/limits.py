"""Bounds of what a sender may send, all in one place; docs/live_sources.md states them.

A sender is not trusted. Memory and time that a block costs are bounded by its size, and what a window's table holds is
bounded by what was received for it.
"""

from typing import NamedTuple

__all__ = ["LAST_MOMENT", "MAX_TABLE_CHANNELS", "Limits", "cells_allowed", "printable"]

LAST_MOMENT = 2**62
"""In the year 2116 [ns since 1970]: a sample taken later has no date."""

FREE_CELLS = 4_000_000
"""Cells of a window's table that nobody has to justify (32 MB): 10 min of 66 channels at 100 Hz."""

CELLS_PER_VALUE = 8
"""Further cells for each value received: seven of eight samples of a large table may be missing."""

MAX_TABLE_CHANNELS = 1000
"""Channels of a turbine that are followed at once; beyond, those with the fewest or oldest samples are left out."""

_MAX_TEXT = 300
"""Characters of a reason for a refusal."""


class Limits(NamedTuple):
    """Largest block that is taken.

    Attributes
    ----------
    payload
        [bytes].
    samples, channels
        Of a block.
    rate, lowest_rate
        [Hz].
    name
        Characters of a channel's name or unit, all of them printable.
    magnitude
        Largest value in SI; beyond it a sample counts as missing, as an infinite one does.
    """

    payload: int = 8_000_000
    samples: int = 500_000
    channels: int = 200
    rate: float = 20_000.0
    lowest_rate: float = 1e-4
    name: int = 200
    magnitude: float = 1e30


def cells_allowed(values: float) -> float:
    """Largest number of cells of a window's table for which so many values were received."""
    return FREE_CELLS + CELLS_PER_VALUE * values


def printable(text: str, most: int = _MAX_TEXT) -> str:
    """The text in one line of printable characters, cut to `most` of them."""
    shown = "".join(sign if sign.isprintable() else "?" for sign in " ".join(text.split()))
    return shown if len(shown) <= most else f"{shown[: most - 1]}…"

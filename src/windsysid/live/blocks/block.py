"""A block: the samples that a logger sends at once."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Block"]


@dataclass(frozen=True, eq=False)
class Block:
    """Samples of one turbine, one after the other at one rate.

    Attributes
    ----------
    turbine
        The turbine's name in the service.
    sequence
        The sender's number of this block: from one block to the next it grows. Where the sender has none, `start`.
        Turbine, stream and sequence together are the block's key: a block that comes again changes nothing.
    start
        When the first sample was taken, by the logger's clock [ns since 1970, UTC].
    rate
        [Hz].
    channels, units
        As in a `windsysid.Record`, in the units that it holds.
    values
        (n, m), float32 or float64 as they were sent; NaN where a sample is missing.
    stream
        Which of the turbine's loggers sent it: each numbers its blocks by itself. Empty where there is one only.
    """

    turbine: str
    sequence: int
    start: int
    rate: float
    channels: tuple[str, ...]
    units: tuple[str, ...]
    values: NDArray[np.floating]
    stream: str = ""

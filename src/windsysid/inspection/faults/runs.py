"""Runs of consecutive samples in a mask, as indices and as times."""

import numpy as np
from numpy.typing import NDArray

from windsysid._types import Array, Mask

__all__ = ["runs_of", "spans_of"]


def runs_of(mask: Mask) -> NDArray[np.int64]:
    """First and one-past-last index of each run of True, (n, 2)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return edges.reshape(-1, 2).astype(np.int64)


def spans_of(time: Array, mask: Mask) -> Array:
    """First and last time of each run of True, (n, 2) [s]."""
    runs = runs_of(mask)
    return np.column_stack([time[runs[:, 0]], time[runs[:, 1] - 1]])

"""Readings that share a time stamp: a logger took them regularly and stamped them packet by packet, or wrote their
times with few digits.

Rows keep their order and are placed on a regular grid, so that no reading is lost and none is aliased. Packets of one
size are placed by their stamps, which may scatter by half a packet; lost packets stay gaps. Packets of several sizes
are counted: the row number times the step follows the stamps, and where all later stamps are shifted by more than they
scatter, rows were lost. Readings that were not taken evenly (bursts, rows of two loggers in turn, rows written twice)
differ more within packets than across them, or less, and are left to the caller.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numpy.lib.stride_tricks import sliding_window_view

from windsysid._types import Array
from windsysid.records.stamps import near_step, rhythm

__all__ = ["Placed", "is_even", "place_packets", "shares_stamps"]

Rows = npt.NDArray[np.int64]

MIN_PACKETS = 8
"""Packets that show a grid at least."""

MIN_FULL_SHARE = 0.5
"""Share of packets with the greatest size, above which smaller ones have lost rows."""

MAX_SPREAD_STEPS = 2.0
"""Range of 98 % of the stamps about the grid at most, in long steps (the 99th percentile of the steps of stamps)."""

MIN_SHIFT_ROWS = 1.5
"""Rows by which stamps are shifted where rows were lost: rounding alone makes a shift of one."""

SHIFT_SCATTERS = 6.0
"""Standard deviations of the stamps' scatter that a shift must exceed: 1e-9 a packet, if it is normal."""

NEIGHBOURS = 5
"""Packets before and after a shift whose median is compared."""

LEVEL = 50
"""Packets before and after a shift whose mean tells how many rows were lost: stamps that are rounded to a step scatter
by 0.3 rows."""

MAX_UNEVENNESS = 2.0
"""Greatest ratio of the mean difference of neighbours across packets to that within packets, or its inverse; of 50
packets of a regular record it is 1 ± 0.2."""


class Placed(NamedTuple):
    """Regular times (T,) [s] of all rows, the step [s], and how many rows are missing between them."""

    time: Array
    step: float
    lost: int


def shares_stamps(time: Array) -> bool:
    """Whether some rows share a time stamp, and no time runs backwards."""
    steps = np.diff(time)
    return bool(np.all(steps >= 0.0) and np.any(steps == 0.0))


def is_even(time: Array, values: Array) -> bool:
    """Whether each channel (T, m) changes as much within packets as from one packet to the next."""
    across, change = np.diff(time) > 0.0, np.abs(np.diff(values, axis=0))
    for one in change.T:
        known = np.isfinite(one) & (one > 0.0) if np.any(one > 0.0) else np.isfinite(one)
        if not known.any():
            continue
        clipped = np.minimum(one, 10.0 * np.median(one[known]))  # one spike or jump of an angle counts little
        inside, outside = (clipped[np.isfinite(one) & at] for at in (~across, across))
        if min(inside.size, outside.size) < MIN_PACKETS:
            continue
        low, high = sorted((float(np.mean(inside)), float(np.mean(outside))))
        if high > MAX_UNEVENNESS * low:
            return False
    return True


def place_packets(time: Array) -> Placed | None:
    """Place all rows on the grid that their stamps (T,) [s] show; None where they show none."""
    if not (np.isfinite(time).all() and shares_stamps(time)):
        return None
    first = np.flatnonzero(np.concatenate([[True], np.diff(time) > 0.0]))
    sizes = np.diff(np.append(first, time.size))
    if len(first) < MIN_PACKETS or np.count_nonzero(sizes > 1) < MIN_PACKETS:
        return None
    stamps = time[first]
    found = _by_stamps(stamps, sizes) or _by_count(stamps, first)
    if found is None:
        return None
    begin, step, row = found
    index = np.repeat(row, sizes) + np.arange(time.size) - np.repeat(first, sizes)
    return Placed(begin + step * index, step, int(index[-1] - index[0]) + 1 - time.size)


def _by_stamps(stamps: Array, sizes: Rows) -> tuple[float, float, Rows] | None:
    """Beginning and step [s] of the grid and the row of each packet (n,), for packets of one size or less."""
    size = int(sizes.max())
    if np.mean(sizes[1:-1] == size) < MIN_FULL_SHARE:
        return None
    begin, period = rhythm(stamps, near_step(stamps))
    for _ in range(2):
        index = np.rint((stamps - begin) / period)
        period, begin = map(float, np.polyfit(index, stamps, 1))
    if np.any(np.diff(index) < 1.0) or np.any(np.abs(stamps - begin - period * index) > 0.5 * period):
        return None
    row = size * (index - index[0]).astype(np.int64)
    row[0] = size - sizes[0]  # a packet that the record begins in has lost its first rows
    return begin + period * float(index[0]), period / size, row


def _by_count(stamps: Array, first: Rows) -> tuple[float, float, Rows] | None:
    """The same for packets of any size: rows are counted, and lost where all later stamps are shifted."""
    stamps, counted = stamps[1:], first[1:]  # the record may begin inside the first packet
    reach = max(1, min(64, len(stamps) // 8))
    step = float(np.median((stamps[reach:] - stamps[:-reach]) / (counted[reach:] - counted[:-reach])))
    lost = np.zeros(len(stamps), dtype=np.int64)
    for _ in range(3):
        off = stamps - step * (counted + lost)
        more = _lost_rows(off, step)
        if more is None:
            return None
        lost += np.cumsum(more)
        step, begin = map(float, np.polyfit(counted + lost, stamps, 1))
        if not step > 0.0:
            return None
    off = stamps - begin - step * (counted + lost)
    if np.ptp(np.percentile(off, [1.0, 99.0])) > MAX_SPREAD_STEPS * np.percentile(np.diff(stamps), 99.0):
        return None
    return begin, step, np.concatenate([[0], counted + lost])


def _lost_rows(off: Array, step: float) -> Rows | None:
    """Rows that are missing before each packet (n,), from its stamp's distance [s] to where counting puts it; None
    where stamps are shifted backwards."""
    padded = np.concatenate([np.full(NEIGHBOURS - 1, off[0]), off, np.full(NEIGHBOURS - 1, off[-1])])
    medians = np.median(sliding_window_view(padded, NEIGHBOURS), axis=1)  # one that ends at each packet, and more
    shift = np.concatenate([[0.0], medians[NEIGHBOURS:] - medians[: len(off) - 1]])
    lost = np.zeros(len(off), dtype=np.int64)
    scatter = 1.4826 * float(np.median(np.abs(shift - np.median(shift))))
    clear = np.flatnonzero(np.abs(shift) > max(MIN_SHIFT_ROWS * step, SHIFT_SCATTERS * scatter))
    if not clear.size:
        return lost
    jump = np.diff(off, prepend=off[0])
    groups = np.split(clear, 1 + np.flatnonzero(np.diff(clear) > 1))
    at = np.array([group[np.argmax(np.abs(jump[group]))] for group in groups])
    edges = np.concatenate([[0], at, [len(off)]])
    for low, k, high in zip(edges[:-2], at, edges[2:], strict=True):
        lost[k] = round(float(np.mean(off[k : min(high, k + LEVEL)]) - np.mean(off[max(low, k - LEVEL) : k])) / step)
    return None if np.any(lost < 0) else lost

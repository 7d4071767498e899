"""Regular times for rows that share time stamps: packets with one stamp each, or times with few digits.

Rows keep their order and are placed on a regular grid, so that no reading is lost and no frequency is aliased. Packets
of equal size are placed by their stamps, which may scatter by half a packet; lost packets become gaps. Packets of
different sizes are placed by counting rows; if all stamps from some packet on are shifted by more than their scatter,
rows were lost there. Unevenly sampled readings (bursts, interleaved rows of two loggers, rows written twice) change
more, or less, within packets than between them; they are not placed.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.records.rounded import rounded_grid
from windsysid.records.stamps import MIN_LOG_LIKELIHOOD_GAIN, count_lost_rows, grid_log_odds, rhythm, usual_step

__all__ = ["RegularTimes", "is_even", "place_packets", "place_rounded", "shares_stamps"]

Rows = npt.NDArray[np.int64]

MIN_PACKETS = 8
"""Smallest number of packets, and of packets with two or more rows, from which a grid is estimated."""

MIN_FULL_SHARE = 0.5
"""Smallest share of packets of the largest size for which smaller packets count as incomplete."""

MAX_LOST_SHARE = 0.01
"""Share of rows lost inside packets, above which their places matter."""

RETURN_PACKETS = 64
"""Packets over which stamps that follow counted rows have come back to them."""

MAX_SPREAD_STEPS = 2.0
"""Largest range of 98 % of the stamps about the grid, relative to the 99th percentile of the steps between stamps."""

MAX_CHANGE_RATIO = 2.0
"""Largest ratio of the mean absolute change between packets to that within packets, or its inverse; for 50 packets of a
regular record the ratio is 1 ± 0.2."""


class RegularTimes(NamedTuple):
    """Regular times (T,) [s] of all rows, the step [s], and the number of rows missing between them."""

    time: Array
    step: float
    lost: int


def shares_stamps(time: Array) -> bool:
    """Test whether times are finite, never decrease, and some rows have the stamp of the row before."""
    if not np.isfinite(time).all():
        return False
    steps = np.diff(time)
    return bool(np.all(steps >= 0.0) and np.any(steps == 0.0))


def is_even(time: Array, values: Array) -> bool:
    """Test whether each channel of values (T, m) changes by as much within packets as from one packet to the next."""
    across = np.diff(time) > 0.0
    return all(_changes_evenly(change, across) for change in np.diff(values, axis=0).T)


def _changes_evenly(change: Array, across: npt.NDArray[np.bool_]) -> bool:
    """Test whether changes of a channel (T − 1,) have similar size and mean within packets and `across` borders."""
    known = np.isfinite(change)
    moved = np.abs(change[known & (change != 0.0)])
    if not moved.size:
        return True
    most = 10.0 * float(np.median(moved))  # limits the influence of spikes and of jumps of an angle
    clipped = np.clip(change, -most, most)
    inside, outside = clipped[known & ~across], clipped[known & across]
    if min(inside.size, outside.size) < MIN_PACKETS:
        return True
    low, high = sorted(float(np.mean(np.abs(one))) for one in (inside, outside))
    apart = abs(float(np.mean(inside) - np.mean(outside)))
    return high <= MAX_CHANGE_RATIO * low and apart <= 0.5 * (low + high)


def place_packets(time: Array) -> RegularTimes | None:
    """Place all rows on the regular grid that fits their stamps (T,) [s]; None if no grid fits.

    Raises
    ------
    RecordError
        If so many rows were lost one by one that their places are not known.
    """
    if not shares_stamps(time):
        return None
    if (grid := rounded_grid(time)) is not None:
        return _placed(grid.begin, grid.step, grid.places, time.size)
    first = np.flatnonzero(np.concatenate([[True], np.diff(time) > 0.0]))
    sizes = np.diff(np.append(first, time.size))
    if len(first) < MIN_PACKETS or np.count_nonzero(sizes > 1) < MIN_PACKETS:
        return None
    stamps = time[first]
    found = _by_stamps(stamps, sizes)
    inside = found is not None and np.sum(sizes.max() - sizes[1:-1]) > MAX_LOST_SHARE * time.size
    found = found if found is not None and not inside else _by_count(stamps, first)
    if found is None and not inside:
        return None
    if found is None or _wanders((stamps - found[0] - found[1] * found[2])[1:], found[1]):
        raise RecordError(
            f"rows were lost among rows that share a time stamp ({sizes[1:-1].min()} to {sizes.max()} rows a stamp), at"
            " places that are not known; export time stamps with more digits"
        )
    begin, step, row = found
    index = np.repeat(row, sizes) + np.arange(time.size) - np.repeat(first, sizes)
    return _placed(begin, step, index.astype(np.float64), time.size)


def place_rounded(time: Array, values: Array) -> RegularTimes | None:
    """Place rows with increasing rounded stamps (T,) [s] on the regular grid that explains them; None if no grid fits,
    or if readings (≤ T, m), with angles unwrapped, are clearly smoother at their stamps."""
    grid = rounded_grid(time)
    if grid is None:
        return None
    placed = _placed(grid.begin, grid.step, grid.places, time.size)
    rows = len(values)
    against = (
        rows > MIN_PACKETS and grid_log_odds(time[:rows], placed.time[:rows], values).sum() < -MIN_LOG_LIKELIHOOD_GAIN
    )
    return None if against else placed


def _placed(begin: float, step: float, index: Array, rows: int) -> RegularTimes:
    digits = 4 - int(np.floor(np.log10(step)))  # a beginning of 1e-14 s is none
    time = np.asarray(round(begin, digits) + step * index, dtype=np.float64)
    return RegularTimes(time, step, int(index[-1] - index[0]) + 1 - rows)


def _by_stamps(stamps: Array, sizes: Rows) -> tuple[float, float, Rows] | None:
    """First time and step [s] of the grid and row of each packet (n,), for packets of equal size or incomplete ones."""
    size = int(sizes.max())
    if np.mean(sizes[1:-1] == size) < MIN_FULL_SHARE:
        return None
    begin, period = rhythm(stamps, usual_step(stamps))
    for _ in range(2):
        index = np.rint((stamps - begin) / period)
        period, begin = map(float, np.polyfit(index, stamps, 1))
    if np.any(np.diff(index) < 1.0) or np.any(np.abs(stamps - begin - period * index) > 0.5 * period):
        return None
    row = size * (index - index[0]).astype(np.int64)
    row[0] = size - sizes[0]  # an incomplete first packet lacks its first rows
    return begin + period * float(index[0]), period / size, row


def _wanders(off: Array, step: float) -> bool:
    """Test whether stamps depart (n,) [s] from counted rows as a random walk, which rows lost one by one make, and not
    as scatter."""
    reach = min(RETURN_PACKETS, len(off) // 4)
    if reach < 2:
        return False
    near, far = (float(np.sqrt(np.mean(np.square(off[lag:] - off[:-lag])))) for lag in (1, reach))
    return far > max(step, 2.0 * near)


def _by_count(stamps: Array, first: Rows) -> tuple[float, float, Rows] | None:
    """First time and step [s] of the grid and row of each packet (n,), for packets of any size, by counting rows."""
    stamps, counted = stamps[1:], first[1:]  # the first packet may be incomplete
    reach = max(1, min(64, len(stamps) // 8))
    step = float(np.median((stamps[reach:] - stamps[:-reach]) / (counted[reach:] - counted[:-reach])))
    for _ in range(3):
        each = count_lost_rows(stamps - step * counted, step)
        if each is None:
            return None
        lost = np.cumsum(each)
        step, begin = map(float, np.polyfit(counted + lost, stamps, 1))
        if not step > 0.0:
            return None
    off = stamps - begin - step * (counted + lost)
    if np.ptp(np.percentile(off, [1.0, 99.0])) > MAX_SPREAD_STEPS * np.percentile(np.diff(stamps), 99.0):
        return None
    return begin, step, np.concatenate([[0], counted + lost])

"""Requirements on times, values and names of a record, whether it is whole or still read in blocks."""

from collections.abc import Callable, Iterable
from typing import NoReturn

import numpy as np

from windsysid._types import Array
from windsysid.errors import RecordError

__all__ = ["MAX_OFF_STEPS", "Array", "check_block", "check_channels", "check_rows", "refuse_gaps", "refuse_outside"]


NEIGHBOUR_ROWS = 8
"""Rows before and after one whose time runs backwards that are regular in another order, if they were exchanged."""

MAX_SET_BACK_SHARE = 0.05
"""Share of rows whose time runs backwards, above which rows are in no order, and no clock was set back."""

MAX_OFF_STEPS = 1e-3
"""Of a step: within this a time grid counts as uniform."""

MAX_TIME_SECONDS = 1e13
"""Largest absolute time [s]: 300 000 years, where double precision resolves 2 ms. A larger number is damaged, or a
count in another unit."""

MIN_MEAN_STEP_SECONDS = 1e-9
"""Smallest mean step [s]: a rate above 1 GHz comes from a wrong unit or a damaged file, and overflows in spectra."""

_MAX_NAME_CHARACTERS = 200


def check_channels(channels: Iterable[str]) -> None:
    """Refuse names that cannot be separated or written to a file."""
    seen = set()
    for name in channels:
        if not isinstance(name, str) or not name or name != name.strip() or len(name.splitlines()) > 1:
            raise RecordError(
                f"{str(name)[:40]!r} is not a channel name: expected text on one line without spaces around it"
            )
        if not _is_utf8(name):
            raise RecordError(
                f"{name[:40]!r} is not a channel name: expected characters that UTF-8 can hold; rename it"
            )
        if len(name) > _MAX_NAME_CHARACTERS:
            raise RecordError(
                f"the channel name '{name[:40]}…' has {len(name)} characters; expected {_MAX_NAME_CHARACTERS} at most"
            )
        if name == "time":
            raise RecordError("a channel is called 'time', which is the record's own: rename it")
        if name in seen:
            raise RecordError(f"channel '{name}' occurs twice: expected each name once; rename one of them")
        seen.add(name)


def _is_utf8(name: str) -> bool:
    """Test whether UTF-8 can encode a name: unpaired surrogates, from an unknown encoding, cannot be encoded."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def check_rows(
    time: Array, values: Array, channels: tuple[str, ...], place: Callable[[int], str] = "sample {}".format
) -> None:
    """Refuse a time that does not increase and infinite values, naming the first place."""
    if time.size < 2:
        raise RecordError(f"expected at least 2 samples, got {time.size}; give a longer record")
    check_block(time, values, channels, place)


def check_block(
    time: Array,
    values: Array,
    channels: tuple[str, ...],
    place: Callable[[int], str] = "sample {}".format,
    previous: float = np.nan,
) -> None:
    """Checks of `check_rows`, for rows that follow a sample at `previous` [s] and may be few."""
    finite = np.isfinite(time)
    if not finite.any():
        raise RecordError("the time is missing or infinite everywhere: expected seconds as numbers; write the time")
    if not finite.all():
        k = int(np.argmin(finite))
        raise RecordError(f"the time at {place(k)} is {time[k]}: expected seconds; remove that row or write its time")
    if not np.all(np.abs(time) <= MAX_TIME_SECONDS):
        k = int(np.argmax(np.abs(time) > MAX_TIME_SECONDS))
        raise RecordError(
            f"the time at {place(k)} is {time[k]:g} s: expected at most {MAX_TIME_SECONDS:g} s; correct it, or"
            " name its unit"
        )
    steps = np.diff(time, prepend=previous)  # the first is NaN where nothing went before, and compares as False
    if np.any(steps <= 0.0):
        k = int(np.argmax(steps <= 0.0))
        what = "is repeated" if steps[k] == 0.0 else "runs backwards"
        before = previous if k == 0 else float(time[k - 1])
        twice = k > 0 and np.array_equal(values[k], values[k - 1], equal_nan=True)
        what_to_do = _remedy_of_repeats(twice) if steps[k] == 0.0 else _remedy_of_order(time, steps, k, before)
        raise RecordError(
            f"the time {what} at {place(k)} ({before!r} s, then {float(time[k])!r} s): "
            f"expected strictly increasing; {what_to_do}"
        )
    if time[-1] - time[0] < MIN_MEAN_STEP_SECONDS * (time.size - 1):
        raise RecordError(
            f"{time.size} samples from {place(0)} on last {time[-1] - time[0]:g} s: expected at most"
            f" {1.0 / MIN_MEAN_STEP_SECONDS:g} samples per second; correct the step or the unit of the time"
        )
    infinite = np.isinf(values)
    if infinite.any():
        row, column = (int(i) for i in np.argwhere(infinite)[0])
        raise RecordError(
            f"channel '{channels[column]}' is infinite at {place(row)}: expected a finite number; "
            "leave the cell empty or write NaN where a value is missing"
        )


def _remedy_of_repeats(twice: bool) -> str:
    """Advice on a time that is repeated, by a row with the same readings or with others."""
    if twice:
        return "drop the rows that were written twice"
    return (
        "if readings are regular, write [time] rate = … [Hz] into a mapping file; if a row was written twice, delete it"
    )


def _remedy_of_order(time: Array, steps: Array, k: int, before: float) -> str:
    """Advice on a time (T,) that runs backwards at row k: where sorting gives no regular steps, two segments
    would be mixed."""
    usual = float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else 0.0
    around = np.sort(np.append(time[max(k - NEIGHBOUR_ROWS, 0) : k + NEIGHBOUR_ROWS], [before] if k == 0 else []))
    between = np.diff(around)
    swapped = np.all((between > 0.5 * usual) & (between < 3.0 * usual))
    if swapped or np.count_nonzero(steps < 0.0) > MAX_SET_BACK_SHARE * len(steps):
        return "sort the rows"
    return "a clock was set back? shift what follows"


def refuse_gaps(name: str, time: Array, rows: int) -> NoReturn:
    """Refuse times (T,) [s] whose gaps need a grid of `rows`, naming the record and its longest gap."""
    steps = np.diff(time)
    k = int(np.argmax(steps))
    before, after = float(time[k]), float(time[k + 1])
    first, last = float(time[0]), float(time[-1]) + float(np.median(steps))
    ends = first, before + float(np.median(steps))
    low, high = ends if before - first >= 0.5 * (last - after) else (after, last)
    raise RecordError(
        f"{name}: the gap of {after - before:.9g} s after {before:.9g} s is too long ({rows:.3g} rows); keep"
        f" {low:.13g} to {high:.13g} s (section=, or cut the file)"
    )


def refuse_outside(start: float, end: float, samples: int, first: float, last: float, step: float) -> None:
    """Refuse a section [s] that holds too little or reaches outside the record, which runs from first to last [s]."""
    own = f"the record runs from {first:g} to {last:g} s"
    if not start < end:
        raise RecordError(
            f"the section {start:g} to {end:g} s is empty: expected start before end; {own}; choose others"
        )
    if start < first - step or end > last + step * (1.0 + MAX_OFF_STEPS):
        raise RecordError(
            f"the section {start:g} to {end:g} s reaches outside the record: {own}; choose a section inside"
        )
    if samples < 2:
        raise RecordError(
            f"the section {start:g} to {end:g} s holds {samples} samples, expected at least 2: {own} "
            f"at {1.0 / step if step else np.nan:g} Hz; choose a longer section"
        )

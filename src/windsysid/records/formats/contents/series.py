"""Formats that hold each channel as a series of its own: from their series to one `FileSource`.

MATLAB, HDF5, TDMS, UFF, MDF and others keep channels apart, each with its name, unit and clock. A record is one table,
with the times of the fastest of the series that the mapping chooses. A slower series may join where each of its samples
coincides with a row and it lasts as long (`placing`); between its samples it is missing. Anything else is refused,
naming two series, and nothing is cut to fit. Only chosen series are read.

The clock is, in this order: the column that the mapping names; its ``rate``, for a file that says no time; the clock
that the series themselves say; a series called ``time``.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from windsysid.errors import ConfigurationError, RecordError, UnknownTimeError
from windsysid.records.checks import MAX_OFF_STEPS
from windsysid.records.formats.contents.columns import (
    Cell,
    Column,
    find_time,
    is_called_time,
    name_and_unit,
    plan_columns,
)
from windsysid.records.formats.contents.mapping import Mapping, TimeRule
from windsysid.records.formats.contents.source import FileSource, indexed_source
from windsysid.records.formats.time.clock import (
    Moments,
    counted_clock,
    exact_seconds,
    make_clock,
    moments_clock,
    start_of,
)
from windsysid.records.formats.time.placing import Rows, coinciding
from windsysid.records.moments import has_zone, moment, split_start
from windsysid.records.record import Array

__all__ = ["FileSeries", "TimeGrid", "cell_of", "short_names", "source_of_series", "tidy_step", "utc"]

_SOME = 10_000  # values that show in which units they are plausible


@dataclass(frozen=True)
class TimeGrid:
    """Equally spaced times: sample k is at ``first + k step`` [s] after the moment `start`, where that is known."""

    first: float
    step: float
    start: str | None = None


@dataclass(frozen=True)
class FileSeries:
    """One series of a file.

    Attributes
    ----------
    cell : Cell
        Its name and unit as the file says them.
    samples : int
    numbers : callable
        ``numbers(low, high)`` reads the values low … high − 1 as float64.
    grid : Grid or None
        Its times, where the file says them so.
    times : callable or None
        ``times()`` reads its times (samples,) [s] after `start`, where the file has them one by one.
    clock : str
        Name of its times: series with the same one are sampled together. Empty where `grid` says it all.
    start : str or None
        The moment of time 0 of `times`.
    moments : callable or None
        ``moments()`` reads moments (samples,) [ns since 1970, UTC] where the series holds those and no numbers.
    """

    cell: Cell
    samples: int
    numbers: Callable[[int, int], Array]
    grid: TimeGrid | None = None
    times: Callable[[], Array] | None = None
    clock: str = ""
    start: str | None = None
    moments: Callable[[], Moments] | None = None


def cell_of(written: str, name: str, unit: str | None) -> Cell:
    """A column called `name`, in the unit that the file says, otherwise in that at the end of its name."""
    if unit is not None and unit.strip():
        return Cell(written, name, unit.strip())
    found = name_and_unit(name)
    return Cell(written, found.name, found.unit)


def utc(nanoseconds: int) -> str:
    """A moment [ns since 1970, UTC] as ISO text."""
    return str(moments_clock(nanoseconds, "UTC", TimeRule()).start)


def source_of_series(
    name: str,
    series: Sequence[FileSeries],
    mapping: Mapping,
    attributes: dict[str, str],
    *,
    how: str,
    hint: str = "",
    together: Callable[[Sequence[int], int, int], Sequence[Array]] | None = None,
) -> FileSource:
    """The source of a file whose series are these.

    Parameters
    ----------
    name : str
        Of the record.
    series : sequence of Series
        All that the file holds, in its order.
    mapping : Mapping
    attributes : dict of str to str
        A start among them counts where the series say none.
    how : str
        How a user writes a unit in this format, as for `plan_columns`.
    hint : str
        What to add where the file says no time.
    together : callable, optional
        ``together(indices, low, high)`` reads several series at once, where that is cheaper than one by one.

    Raises
    ------
    RecordError
        If the file says no time, or the chosen series are not sampled together.
    ConfigurationError
        If the mapping does not fit.
    """
    cells = [one.cell for one in series]
    at = _time_index(series, mapping, hint)
    columns = plan_columns(cells, at, mapping, lambda i: series[i].numbers(0, min(_SOME, series[i].samples)), how)
    time, said, places = _placing(
        [series[column.index] for column in columns], None if at is None else series[at], mapping
    )
    whole = [k for k, place in enumerate(places) if place is None]
    noted, attributes = split_start(attributes, time)

    def rows(low: int, high: int) -> Array:
        indices = [columns[k].index for k in whole]
        raw = together(indices, low, high) if together else [series[i].numbers(low, high) for i in indices]
        found = {k: _values(columns[k], values, low, high) for k, values in zip(whole, raw, strict=True)}
        for k, place in enumerate(places):
            if place is not None:
                found[k] = _placed(columns[k], series[columns[k].index], place, low, high)
        return np.column_stack([found[k] for k in range(len(columns))])

    return replace(
        indexed_source(name, columns, time, rows),
        attributes=attributes,
        start=start_of(mapping.time, said or noted),
        rate=None if at is None else mapping.time.rate,
    )


def _placing(
    chosen: Sequence[FileSeries], clock: FileSeries | None, mapping: Mapping
) -> tuple[Array, str | None, list[Rows | None]]:
    """Times (T,) [s], the moment of time 0, and the rows of each of the `chosen` series; None for all rows."""
    if clock is not None or mapping.time.rate is not None:
        _check_lengths(chosen if clock is None else [clock, *chosen])
        return *_times(clock, chosen[0].samples, mapping), [None] * len(chosen)
    _check_grids(chosen)
    fastest = max(chosen, key=lambda one: one.samples)
    time, said = _own_times(fastest)
    return time, said, [_place(one, fastest, time) for one in chosen]


def _values(column: Column, raw: Array, low: int, high: int) -> Array:
    if raw.shape != (high - low,):
        raise RecordError(
            f"channel '{column.name}' gives {raw.size} of the samples {low} to {high}; it is cut off or damaged; copy"
            " the file again"
        )
    return column.values(raw)


def _placed(column: Column, series: FileSeries, rows: Rows, low: int, high: int) -> Array:
    """Rows low … high − 1 of a slower series, whose samples stand in `rows`; NaN between them."""
    first, last = (int(k) for k in np.searchsorted(rows, (low, high)))
    values = np.full(high - low, np.nan)
    if last > first:
        values[rows[first:last] - low] = _values(column, series.numbers(first, last), first, last)
    return values


def _time_index(series: Sequence[FileSeries], mapping: Mapping, hint: str) -> int | None:
    """Index of the series that is the time; None if the clock is given otherwise."""
    cells = [one.cell for one in series]
    if mapping.time.column is not None:
        return find_time(cells, mapping)
    if _has_times(series, mapping):
        return None
    called = [i for i, cell in enumerate(cells) if is_called_time(cell.name)]
    if len(called) == 1:
        return called[0]
    if mapping.time.rate is not None:
        return None
    found = f"{len(called)} are called so" if called else "none is called so"
    raise UnknownTimeError(
        f"no series is known to be the time: {'; '.join(filter(None, (found, hint)))}; name it in the mapping file"
        " ([time] column), or say the rate [Hz] there ([time] rate)"
    )


def _has_times(series: Sequence[FileSeries], mapping: Mapping) -> bool:
    """Test whether the selected series have times; refuses a mapping that contradicts them."""
    wanted = [one for one in series if not mapping.only_listed or mapping.rule_of(one.cell.written, one.cell.name)]
    timed = any(one.grid or one.times for one in wanted)
    if timed and mapping.time.rate is not None:
        raise ConfigurationError(f"{mapping.place}: time.rate: the file itself says its times; remove the key")
    if timed and (mapping.time.unit, mapping.time.format) != (None, None):
        raise ConfigurationError(f"{mapping.place}: time: the file itself says its times; leave only zone and start")
    return timed


def _check_lengths(chosen: Sequence[FileSeries]) -> None:
    """Refuse series of unequal length, where the time does not come from them."""
    for other in chosen[1:]:
        if other.samples != chosen[0].samples:
            raise _apart(chosen[0], other)


def _check_grids(chosen: Sequence[FileSeries]) -> None:
    """Refuse a grid whose first time or step is not finite."""
    for one in chosen:
        if one.grid is not None and not np.isfinite([one.grid.first, one.grid.step]).all():
            raise RecordError(
                f"channel '{one.cell.name}' begins at {one.grid.first:g} s with a step of {one.grid.step:g} s; expected"
                " numbers; it is damaged; copy or export it again"
            )


def _place(one: FileSeries, fastest: FileSeries, time: Array) -> Rows | None:
    """The rows where the samples of a slower series stand; None for a series that is sampled with the fastest."""
    if one.samples == fastest.samples and _same_clock(fastest, one):
        return None
    if one.grid is None and one.times is None:
        raise _apart(fastest, one)
    own, start = _own_times(one)
    rows = coinciding(time, own + _between(_start_of(fastest), start))
    if rows is None:
        raise _apart(fastest, one)
    return rows


def _apart(one: FileSeries, other: FileSeries) -> RecordError:
    return RecordError(
        f"'{one.cell.name}' ({_sampling(one)}) and '{other.cell.name}' ({_sampling(other)}) are not sampled"
        " together; list channels of one clock in a mapping file, with only_listed = true"
    )


def _start_of(series: FileSeries) -> str | None:
    return series.grid.start if series.grid is not None else series.start


def _between(start: str | None, other: str | None) -> float:
    """Time from one start to another [s]; NaN where only one of them is known."""
    if start is None or other is None or has_zone(start) != has_zone(other):
        return 0.0 if start == other else np.nan
    return (moment(other) - moment(start)).total_seconds()


def _same_clock(one: FileSeries, other: FileSeries) -> bool:
    if one.clock != other.clock or (one.grid is None) != (other.grid is None):
        return False
    if one.grid is None or other.grid is None:
        return True
    apart = other.grid.first - one.grid.first + _between(one.grid.start, other.grid.start)
    return one.grid.step == other.grid.step and abs(apart) <= MAX_OFF_STEPS * one.grid.step


def _sampling(series: FileSeries) -> str:
    rate = f" at {1.0 / series.grid.step:.6g} Hz" if series.grid is not None and series.grid.step > 0.0 else ""
    begin = f" from {series.grid.first:.6g} s" if series.grid is not None and series.grid.first else ""
    clock = f" of '{series.clock}'" if series.clock else ""
    return f"{series.samples} samples{rate}{begin}{clock}"


def _times(clock: FileSeries | None, samples: int, mapping: Mapping) -> tuple[Array, str | None]:
    """Times (T,) [s] from the series with the time, or from the mapping's rate, and the moment of time 0."""
    place = "sample {}".format
    if clock is not None and clock.moments is not None:
        instants = clock.moments()
        dated = moments_clock(int(instants[0]), "UTC", mapping.time)
        return exact_seconds(dated, instants, place), dated.start
    if clock is not None:
        raw = clock.numbers(0, clock.samples)
        cells = [repr(value) for value in raw[:20].tolist()]
        make = make_clock if mapping.time.rate is None else counted_clock
        found = make(cells, clock.cell.unit, mapping.time, place, ".")
        if found is not None and found.textual:
            raise RecordError("the time is a number, but the mapping says that it is text; correct [time] format")
        if found is not None:
            return found.seconds(raw, place), found.start
    return np.arange(samples) / (mapping.time.rate or 1.0), None


def _own_times(first: FileSeries) -> tuple[Array, str | None]:
    """Times (T,) [s] that a series says, and the moment of time 0."""
    if first.times is not None:
        return first.times(), first.start
    if first.grid is None or not 0.0 < first.grid.step < np.inf:
        raise RecordError(
            f"channel '{first.cell.name}' has no time step; give its rate [Hz] in a mapping file: [time] rate"
        )
    with np.errstate(over="ignore"):  # the check of the rows reports infinity
        return np.asarray(first.grid.first + first.grid.step * np.arange(first.samples)), first.grid.start


def short_names(paths: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """For each (group, name): ``group/name``, and the name alone, or ``group_name`` where another is called so too."""
    counts = Counter(name for _, name in paths)
    return [
        (f"{group}/{name}" if group else name, f"{group}_{name}" if group and counts[name] > 1 else name)
        for group, name in paths
    ]


def tidy_step(step: float, doubt: float) -> float:
    """Of the steps [s] within `doubt` [s] of one that was rounded for the file, that whose rate has fewest decimals."""
    if not 0.0 < step < np.inf:
        return step
    for decimals in range(7):
        rate = round(1.0 / step, decimals)
        if rate > 0.0 and abs(1.0 / rate - step) <= doubt:
            return 1.0 / rate
    return step

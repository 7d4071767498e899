"""The time column of a file, whatever it counts, as seconds.

A time is *elapsed*, a number in some unit of which only differences mean something, or *absolute*, a moment of the
calendar: ISO text, text in a pattern that the mapping gives, or a number since a known day. Elapsed seconds stay as
they are in the file; elapsed days and absolute times become seconds from the first sample. The moment of time 0 is
kept as ISO text: with the zone as it was given, or without one where the zone the clock was in.
An elapsed time may say its zero in its unit, as in the CF conventions: ``s since 2021-07-07T12:00:00Z``.

The unit of a number comes from the header or the mapping; without one, `time_units` decides whether it is seconds. A
number that is a moment of the years 2000 to 2036 in milliseconds, microseconds or nanoseconds since 1970,
and 30 000 years or more in seconds, is that moment.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from windsysid.errors import ConfigurationError, RecordError, UnknownTimeError
from windsysid.records.formats.contents.mapping import TimeRule
from windsysid.records.formats.text.dates import (
    Moments,
    fitting_formats,
    format_without_date,
    has_year,
    is_stamp,
    is_zoned,
    parse_column,
)
from windsysid.records.formats.time.time_units import RECENT_SECONDS, confirmed_unit
from windsysid.records.moments import SINCE, has_zone, moment_text, tidy, zone_offset
from windsysid.records.record import Array
from windsysid.records.stamps import usual_step
from windsysid.units import si_unit, to_si

__all__ = [
    "Clock", "Moments", "counted_clock", "exact_seconds", "is_stamp", "make_clock", "moments_clock", "split_since",
    "start_of",
]  # fmt: skip

_DAY = 86_400_000_000_000  # ns
_SECOND = 1_000_000_000
_EPOCHS = {  # name: (ns per count, the count's zero in days since 1970)
    "excel": (_DAY, -25_569),
    "matlab": (_DAY, -719_529),
    "unix": (_SECOND, 0),
    "labview": (_SECOND, -24_107),
}
_EXCEL = (36_526.0, 49_700.0)  # 2000 to 2036; above, it could as well be a modified Julian day
_MATLAB = (730_486.0, 743_700.0)  # the same years

_MAX_OFF_GRID = 0.25  # largest distance of times from multiples of the step [steps]
_MAX_RATE_DEVIATION = 0.02  # largest relative difference of the given rate from that of the column
_MAX_COUNT_DEVIATION = 1e-6  # largest distance of counts from multiples of their step [steps]

_NOTHING = ("", "nan", "na", "n/a", "null", "none")
_UTC = ("utc", "gmt", "z")


@dataclass(frozen=True)
class Clock:
    """Conversion of one time column to seconds.

    Attributes
    ----------
    textual : bool
        Whether the column is to be read as text.
    factor : float
        Seconds per count of an elapsed time.
    zero : float
        Count of an elapsed time at which the record's time is zero.
    count, epoch : int
        Nanoseconds per count of an absolute number and of its zero since 1970; `count` is 0 where the time is no such
        number.
    pattern : str
        strptime pattern; empty for ISO.
    zoned : bool
        Whether ISO text carries its zone.
    zone : str
        Zone of the others; empty for none.
    origin : int
        Moment of the first sample, ns since 1970.
    start : str or None
        The moment of time 0, as `windsysid.records.record.Record.start`.
    """

    textual: bool = False
    factor: float = 1.0
    zero: float = 0.0
    count: int = 0
    epoch: int = 0
    pattern: str = ""
    zoned: bool = False
    zone: str = ""
    origin: int = 0
    start: str | None = None

    def seconds(self, raw: Any, place: Callable[[int], str]) -> Array:
        """Time [s] (n,) from the column's numbers (n,) or texts (n,).

        Raises
        ------
        RecordError
            If a text is no time, or clocks were put back in the middle.
        """
        if not self.textual and not self.count:
            with np.errstate(over="ignore"):  # the check of the rows reports infinity
                zeroed = raw - self.zero if self.zero else raw
                return zeroed if self.factor == 1.0 else np.asarray(zeroed * self.factor)
        moments = self._moments(raw, place)
        seconds = (moments - self.origin) / 1e9
        back = np.flatnonzero(np.diff(moments) < 0)  # repeated times may be packets
        if self.textual and back.size:
            k = int(back[0]) + 1
            raise RecordError(
                f"the time runs backwards at {place(k)} ('{raw[k - 1]}', then '{raw[k]}'); if the clock was put back"
                " there, cut the file in two at that line; else sort the rows"
            )
        return np.asarray(seconds)

    def _moments(self, raw: Any, place: Callable[[int], str]) -> Moments:
        if self.textual:
            moments = parse_column(list(raw), self.pattern, self.zoned, place)
        elif self.count == 1 and np.asarray(raw).dtype.kind == "i":
            moments = np.asarray(raw, dtype=np.int64) + self.epoch  # float64 would round to 256 ns
        else:
            number = np.asarray(raw, dtype=np.float64)
            whole, zero = np.floor(number), self.epoch // self.count
            with np.errstate(invalid="ignore", over="ignore"):
                far = ~(np.abs((whole + zero) * self.count) < 9.2e18)  # NaN too
            if far.any():
                k = int(np.argmax(far))
                raise RecordError(
                    f"the time at {place(k)} is {number[k]}: expected a date; remove that row or write its time"
                )
            part = np.rint((number - whole) * self.count).astype(np.int64)
            moments = (whole + zero).astype(np.int64) * self.count + part
        return moments if not self.zone else _to_utc(moments, self.zone, place)


def make_clock(
    cells: Sequence[str], unit: str | None, rule: TimeRule, place: Callable[[int], str], decimal: str
) -> Clock:
    """The clock of a time column, from its first cells.

    Parameters
    ----------
    cells : sequence of str
        The first few cells, as written.
    unit : str or None
        What the header says: ``s``, ``d``, ``UTC``, ``TS``, …; None if it says nothing.
    rule : TimeRule
        What the mapping says; it goes before.
    place : callable
        Place of a cell, for messages.
    decimal : str
        Decimal mark of numbers.

    Raises
    ------
    RecordError
        If the cells are neither numbers nor times, or could be seconds as well as days.
    """
    if rule.format is not None and "%" in rule.format:
        return _absolute(Clock(textual=True, pattern=rule.format, zone=rule.zone or ""), cells[:1], place)
    cells = [cell for cell in cells if cell.lower() not in _NOTHING]
    if not cells:
        return Clock()  # the time is missing everywhere, which whoever checks the rows says better
    numbers = _numbers(cells, decimal)
    if 2 * len(numbers) >= len(cells) and rule.format != "iso":
        return _numeric(numbers, unit, rule)
    return _text_clock(cells, unit, rule, place)


def _text_clock(cells: Sequence[str], unit: str | None, rule: TimeRule, place: Callable[[int], str]) -> Clock:
    """The clock of ISO times, with a zone or in that of the mapping or the header."""
    stamps = [cell for cell in cells if is_stamp(cell)]
    if not stamps:
        raise _unknown_format(cells, place)
    zoned = is_zoned(stamps[0])
    zone = "" if zoned else rule.zone or ("UTC" if (unit or "").lower() in _UTC else "")
    return _absolute(Clock(textual=True, zoned=zoned, zone=zone), stamps[:1], place)


def _unknown_format(cells: Sequence[str], place: Callable[[int], str]) -> RecordError:
    """The error for times that are neither numbers nor ISO; it names the formats that fit."""
    cell = cells[0][:40]
    pattern = format_without_date(cell)
    if pattern is not None:
        return RecordError(
            f"the time '{cell}' at {place(0)} has no date; write into a mapping file [time] format ="
            f' "{pattern}" or rate = … [Hz], or column = ["Date", "Time"]'
        )
    fitting = " or ".join(f'"{one}"' for one in fitting_formats(cells)) or '"%d.%m.%Y %H:%M:%S" or the like'
    return RecordError(
        f"the time '{cell}' at {place(0)} is neither a number nor ISO (2021-07-07T12:00:00Z); give its format in"
        f" a mapping file: [time] format = {fitting}"
    )


def counted_clock(
    cells: Sequence[str], unit: str | None, rule: TimeRule, place: Callable[[int], str], decimal: str
) -> Clock | None:
    """Make the clock of a time column for which the mapping gives the `rate`; parameters as of `make_clock`.

    The rate determines the unit of the column, or the duration of a count, so that lost rows remain gaps. None if times
    have no regular step: then rows are counted.

    Raises
    ------
    ConfigurationError
        If the column has a unit, and another rate than the mapping.
    """
    rate = rule.rate or 1.0
    numbers = _numbers(cells, decimal)
    if len(numbers) < max(2, len(cells)):
        return _dated_clock(cells, unit, rule, place, decimal)
    step, steps = usual_step(numbers), np.diff(numbers)
    given = [unit] if unit is not None and _is_of_time(unit) else []
    if given and not np.ptp(steps) <= _MAX_OFF_GRID * step > 0.0:
        # the whole column contains more than its first rows (`source.with_regular_times`)
        return make_clock(cells, unit, TimeRule(zone=rule.zone), place, decimal)
    off = np.abs(steps / step - np.rint(steps / step)) if np.all(steps > 0.0) else np.array([np.inf])
    if np.any(off > _MAX_OFF_GRID):
        return None
    fitting = _unit_of_step(step, rate, given or ["s", "ms", "µs", "min", "h", "d"])
    if fitting is not None:
        return make_clock(cells, fitting, TimeRule(zone=rule.zone), place, decimal)
    if given:
        raise ConfigurationError(
            f"time.rate is {rate:g} Hz, but the time column has steps of {step:.4g} {unit}; correct or remove the rate"
        )
    if np.any(off > _MAX_COUNT_DEVIATION):
        return None
    return Clock(factor=1.0 / (rate * step), zero=float(numbers[0]))


def _unit_of_step(step: float, rate: float, units: Sequence[str]) -> str | None:
    """The first unit in which a step is that of the rate [Hz]."""
    factors = {unit: to_si(1.0, str(split_since(unit)[0])) for unit in units}
    return next((unit for unit in units if abs(step * factors[unit] * rate - 1.0) < _MAX_RATE_DEVIATION), None)


def _dated_clock(
    cells: Sequence[str], unit: str | None, rule: TimeRule, place: Callable[[int], str], decimal: str
) -> Clock | None:
    """Make the clock of dates in order; None for other dates, and for text that is no date."""
    try:
        clock = make_clock(cells, unit, TimeRule(zone=rule.zone), place, decimal)
        return clock if clock.textual and np.all(np.diff(clock.seconds(cells, place)) >= 0.0) else None
    except RecordError:
        return None


def _is_of_time(unit: str) -> bool:
    try:
        return si_unit(str(split_since(unit)[0])) == "s"
    except ConfigurationError:
        return False


def moments_clock(first: int, zone: str | None, rule: TimeRule) -> Clock:
    """The clock of a column that holds moments already (int64 nanoseconds since 1970); in UTC if they have a `zone`."""
    clock = Clock(count=1, zone="" if zone else rule.zone or "", zoned=bool(zone))
    return _absolute(clock, np.array([first]), "sample {}".format, zone or "")


def split_since(unit: str | None) -> tuple[str | None, str | None]:
    """``s since 2021-07-07T12:00:00Z`` as the unit and the moment of its zero; RecordError if that is none."""
    found = SINCE.fullmatch(unit.strip()) if unit is not None else None
    if found is None:
        return unit, None
    text = found[2].removesuffix("UTC").strip() + ("Z" if found[2].endswith("UTC") else "")
    if re.fullmatch(r"\d{4}-\d{2}-\d{2}", text):
        text += "T00:00:00"
    try:
        return found[1], tidy(text)
    except ValueError as error:
        raise RecordError(f"the unit of the time is '{unit}': {error}; correct it") from error


def start_of(rule: TimeRule, given: str | None) -> str | None:
    """Moment of time 0 from the mapping's `rule` and from the file, in the mapping's zone if it has none.

    Raises
    ------
    ConfigurationError
        If both say it.
    RecordError
        If it occurs twice or not at all in that zone.
    """
    if rule.start is not None:
        if given is not None:
            raise ConfigurationError(
                f"time.start: the file itself says that it starts at {given}; remove the key from the mapping file"
            )
        given = str(rule.start)
    if given is None or not rule.zone or has_zone(given):
        return given
    local = int(np.datetime64(given, "ns").astype(np.int64))
    origin = int(_to_utc(np.array([local]), rule.zone, "time 0 (row {})".format)[0])
    return moment_text(origin, zone_offset(origin, rule.zone))


def exact_seconds(clock: Clock, moments: Moments, place: Callable[[int], str]) -> Array:
    """Time [s] (n,) of moments (n,) [ns since 1970], without a way through float64."""
    if clock.zone:
        moments = _to_utc(moments, clock.zone, place)
    return np.asarray((moments - clock.origin) / 1e9)


def _numeric(numbers: Array, unit: str | None, rule: TimeRule) -> Clock:
    first, zone = numbers[:1], rule.zone or ""
    if rule.format is not None:
        count, days = _EPOCHS[rule.format]
        if rule.unit is not None:
            count = round(to_si(1.0, rule.unit) * _SECOND)
        zoned = rule.format in ("unix", "labview")  # these count in UTC by definition
        return _absolute(Clock(count=count, epoch=days * _DAY, zoned=zoned, zone="" if zoned else zone), first, str)
    unit, since = split_since(unit)
    unit = rule.unit if rule.unit is not None else unit
    count = _since_1970(float(first[0]), unit) if since is None else 0
    if count:
        return _absolute(Clock(count=count, zoned=True), first, str)
    factor = _seconds_in(unit if unit is not None else _confirmed(numbers))
    if factor != 86_400.0 or since is not None:
        return Clock(factor=factor, start=since)
    for name, (low, high) in (("excel", _EXCEL), ("matlab", _MATLAB)):
        if low <= first[0] < high:
            return _absolute(Clock(count=_DAY, epoch=_EPOCHS[name][1] * _DAY, zone=zone), first, str)
    return Clock(factor=factor, zero=float(first[0]))


def _confirmed(numbers: Array) -> str:
    with np.errstate(over="ignore"):  # the check of the rows reports a time that is too large
        try:
            return confirmed_unit(numbers)
        except RecordError as error:
            raise UnknownTimeError(str(error)) from None


def _seconds_in(unit: str) -> float:
    if not _is_of_time(unit):
        raise RecordError(
            f"the time is in '{unit}', not in a unit of time; expected 'time [s]', or in a mapping file [time] unit, or"
            " for a count of samples [time] rate = … [Hz]"
        )
    return to_si(1.0, unit)


def _since_1970(first: float, unit: str | None) -> int:
    """Nanoseconds per count of a time that counts from 1970 in less than seconds; 0 where it does not."""
    for count, names in ((1_000_000, ("ms", "milliseconds")), (1000, ("µs", "us")), (1, ("ns",))):
        low, high = (moment * _SECOND / count for moment in RECENT_SECONDS)
        if low <= first < high and (unit is None or unit in names):
            return count
    return 0


def _absolute(clock: Clock, first: Any, place: Callable[[int], str], zone: str = "") -> Clock:
    """The clock with its origin at the first sample; that moment is written in `zone` where moments are in UTC."""
    origin = int(clock._moments(first, place)[0])
    offset: int | None = None
    if clock.zone or zone:
        offset = zone_offset(origin, clock.zone or zone)
    elif clock.zoned and clock.textual:
        offset = _written_offset(first[0])
    elif clock.zoned or "%z" in clock.pattern:
        offset = 0
    dated = not clock.pattern or has_year(clock.pattern)
    return replace(clock, origin=origin, start=moment_text(origin, offset) if dated else None)


def _written_offset(cell: str) -> int:
    """The zone at the end of an ISO time [s ahead of UTC]."""
    found = re.search(r"([+-])(\d{2}):?(\d{2})?$", cell)
    if found is None:
        return 0
    return (-60 if found[1] == "-" else 60) * (60 * int(found[2]) + int(found[3] or 0))


def _to_utc(moments: Moments, zone: str, place: Callable[[int], str]) -> Moments:
    import pandas as pd

    local = pd.DatetimeIndex(moments.astype("datetime64[ns]")).tz_localize(zone, ambiguous="NaT", nonexistent="NaT")
    lost = np.asarray(local.isna())
    if lost.any():
        k = int(np.argmax(lost))
        shown = str(np.datetime64(int(moments[k]), "ns"))[:23]
        raise RecordError(
            f"the time {shown} at {place(k)} occurs twice or not at all in {zone}, because clocks were changed; leave"
            " out that hour, or record in UTC"
        )
    return np.asarray(local.tz_convert("UTC").as_unit("ns").asi8)


def _numbers(cells: Sequence[str], decimal: str) -> Array:
    """The cells that are finite numbers."""
    return np.array([value for cell in cells if (value := _number(cell, decimal)) is not None])


def _number(cell: str, decimal: str) -> float | None:
    try:
        value = float(cell.replace(decimal, "."))
    except ValueError:
        return None
    return value if np.isfinite(value) and "_" not in cell else None

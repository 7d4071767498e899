"""Dates as text: detection of strptime patterns, and parsing with fractions of a second.

A detected pattern is proposed, not applied: ``03/04/2024`` may be in March or in April. The fraction of a second may
have a point or a comma and any number of digits, and may be missing at whole seconds, independently of the pattern.
"""

import re
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from windsysid.errors import RecordError

__all__ = ["Moments", "fitting_formats", "format_without_date", "has_year", "is_stamp", "is_zoned", "parse_column"]

Moments = npt.NDArray[np.int64]

_UNFIT = (ValueError, OverflowError, TypeError)  # what `_parse` raises for cells that do not fit
_ISO = re.compile(r"\d{4}-\d{2}-\d{2}[ T]\d{2}:\d{2}(?::\d{2}(?:[.,]\d{1,9})?)?")
_ISO_ZONED = re.compile(_ISO.pattern + r" ?(?:Z|[+-]\d{2}(?::?\d{2})?)")
_FRACTION = re.compile(r"(\d{1,2}:\d{2})[.,](\d{1,9})(?!\d)")
_YEAR = re.compile(r"%[YyGcxDsF]")
_TIME_OF_DAY = re.compile(r"\d{1,2}:\d{2}(?P<second>:\d{2})?(?:(?P<mark>[.,])\d{1,9})?")
_SECONDS = re.compile(r"%S[.,]%f|%T[.,]%f")
_DATES = (
    (r"\d{4}(?P<s>[-/.])\d{1,2}(?P=s)\d{1,2}", ("%Y{s}%m{s}%d",)),
    (r"\d{8}", ("%Y%m%d",)),
    (r"\d{1,2}\.\d{1,2}\.\d{4}", ("%d.%m.%Y",)),
    (r"\d{1,2}\.\d{1,2}\.\d{2}", ("%d.%m.%y",)),
    (r"\d{1,2}(?P<s>[-/])\d{1,2}(?P=s)\d{4}", ("%d{s}%m{s}%Y", "%m{s}%d{s}%Y")),
    (r"\d{1,2}(?P<s>[-/])\d{1,2}(?P=s)\d{2}", ("%d{s}%m{s}%y", "%m{s}%d{s}%y")),
    (r"\d{1,2}(?P<s>[- ])[A-Za-z]{3}(?P=s)\d{4}", ("%d{s}%b{s}%Y",)),
    (r"[A-Za-z]{3} \d{1,2}(?P<s>,?) \d{4}", ("%b %d{s} %Y",)),
)
_TIME = re.compile(
    r"(?P<sep>[T _]|, )\d{1,2}:\d{2}(?P<second>:\d{2}(?P<fraction>[.,]\d{1,9})?)?(?P<half> ?[AaPp][Mm])?"
    r"(?P<zone> ?(?:Z|[+-]\d{2}:?\d{2}))?"
)


def fitting_formats(cells: Sequence[str]) -> tuple[str, ...]:
    """Find the strptime patterns that fit all of these dates with a time of day.

    There are two if either day or month may come first, and none if cells have different or unknown forms.
    """
    found: list[str] = []
    for date, patterns in _DATES:
        match = re.match(date, cells[0]) if cells else None
        clock = _TIME.fullmatch(cells[0][match.end() :]) if match else None
        if match and clock:
            mark = match.groupdict().get("s") or ""
            found = [pattern.format(s=mark) + _clock_pattern(clock, cells) for pattern in patterns]
            break
    return tuple(pattern for pattern in found if _fits(pattern, cells))


def format_without_date(cell: str) -> str | None:
    """The strptime pattern of a time of day, or of minutes and seconds; None for another cell."""
    found = _TIME_OF_DAY.fullmatch(cell)
    if found is None:
        return None
    mark = found["mark"]
    return ("%H:%M:%S" if found["second"] else "%M:%S") + (f"{mark}%f" if mark else "")


def has_year(pattern: str) -> bool:
    """Test whether a strptime pattern reads a year: without one, a time is no moment of the calendar."""
    return bool(_YEAR.search(pattern.replace("%%", "")))


def is_stamp(cell: str) -> bool:
    """Test whether a cell is an ISO date and time, with or without a zone."""
    return bool(_ISO.fullmatch(cell) or _ISO_ZONED.fullmatch(cell))


def is_zoned(cell: str) -> bool:
    """Test whether a cell is an ISO date and time with a zone."""
    return bool(_ISO_ZONED.fullmatch(cell))


def parse_column(cells: list[str], pattern: str, zoned: bool, place: Callable[[int], str]) -> Moments:
    """Parse a column of dates, in a strptime `pattern` or as ISO text `zoned` or not, to (n,) [ns since 1970, UTC].

    Raises
    ------
    RecordError
        If a cell has another form; the message gives its `place`.
    """
    if not pattern:
        _check_iso(cells, zoned, place)
        cells = [cell.replace(",", ".") for cell in cells]
    try:
        return _parse(cells, pattern)
    except _UNFIT:
        bad = next((k for k, cell in enumerate(cells) if not _fits(pattern, [cell])), None)
    if bad is None:
        raise RecordError("the time holds dates that are too far away, expected years 1678 to 2262")
    wanted = f"'{pattern}'" if pattern else "a date that exists"
    raise RecordError(
        f"the time '{str(cells[bad])[:40]}' at {place(bad)} does not fit, expected {wanted}; correct that row, or "
        "the format in the mapping file"
    )


def _check_iso(cells: list[str], zoned: bool, place: Callable[[int], str]) -> None:
    """Refuse a cell that is no ISO time, with a zone if `zoned` and else without one."""
    shape, wanted = (_ISO_ZONED, "with a zone") if zoned else (_ISO, "without a zone")
    for k, cell in enumerate(cells):
        if not isinstance(cell, str) or not shape.fullmatch(cell):
            shown = cell[:40] if isinstance(cell, str) else ""
            raise RecordError(
                f"the time '{shown}' at {place(k)} is not an ISO time {wanted} as in the first row; "
                "remove that row or write its time"
            )


def _parse(cells: Sequence[str], pattern: str) -> Moments:
    """Parse dates in a strptime pattern, or as ISO text if it is empty, to (n,) [ns since 1970, UTC].

    Raises
    ------
    ValueError, OverflowError, TypeError
        If a cell does not fit the pattern.
    """
    import pandas as pd

    nanoseconds = np.zeros(len(cells), dtype=np.int64)
    if pattern:
        bare = _SECONDS.sub(lambda found: found[0][:2], pattern)
        if bare != pattern or "%f" not in pattern:
            split = [_FRACTION.search(cell) for cell in cells]
            nanoseconds = np.array([int(one[2].ljust(9, "0")) if one else 0 for one in split], dtype=np.int64)
            cells, pattern = [_FRACTION.sub(r"\1", cell, count=1) for cell in cells], bare
    dates = pd.to_datetime(pd.Series(list(cells), dtype="object"), format=pattern or "ISO8601", utc=True)
    if dates.isna().any():
        raise ValueError
    return np.asarray(dates.astype("datetime64[ns, UTC]").astype(np.int64).to_numpy()) + nanoseconds


def _clock_pattern(clock: re.Match[str], cells: Sequence[str]) -> str:
    """Pattern of the time of day, with the decimal mark of the fraction if any cell has one."""
    mark = next((found[0][-len(found[2]) - 1] for cell in cells if (found := _FRACTION.search(cell))), "")
    seconds = f":%S{mark}%f" if mark else ":%S" if clock["second"] else ""
    half, zone = clock["half"] or "", clock["zone"] or ""
    return "".join((
        clock["sep"], "%I" if half else "%H", ":%M", seconds, " " * half.startswith(" "), "%p" if half else "",
        " " * zone.startswith(" "), "%z" if zone else "",
    ))  # fmt: skip


def _fits(pattern: str, cells: Sequence[str]) -> bool:
    try:
        _parse(cells, pattern)
    except _UNFIT:
        return False
    return True

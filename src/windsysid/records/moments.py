"""Moments of the calendar as ISO 8601 text: with a zone, or as local time of unknown zone.

``2021-07-07T12:00:00Z`` and ``2021-07-07T14:00:00+02:00`` have a zone and are the same moment. ``2021-07-07T12:00:00``
has none: it can be compared with other local times, and not with the two above.
"""

import re
from collections.abc import Mapping
from datetime import datetime, timedelta
from typing import Any

import numpy as np

from windsysid._types import Array

__all__ = [
    "SINCE", "has_zone", "in_words", "moment", "moment_text", "nanoseconds", "shift_moment", "split_start", "tidy",
    "zone_offset",
]  # fmt: skip

_SECOND = 1_000_000_000  # ns
_MOMENT = re.compile(r"\d{4}-\d{2}-\d{2}[ T]\d{2}:\d{2}(:\d{2}([.,]\d{1,9})?)? ?(Z|[+-]\d{2}(:?\d{2})?)?")

SINCE = re.compile(r"(\S+)\s+since\s+(\S.*)", re.IGNORECASE)
"""A unit of time with the moment of its zero (CF conventions 1.11, section 4.4): ``s since 2021-07-07T12:00:00Z``."""


def moment(text: str) -> datetime:
    """The moment that ISO 8601 text names, to a microsecond; without `tzinfo` where the text has no zone.

    Raises
    ------
    ValueError
        If it is no date with a time of day, such as ``2021-07-07T12:00:00+02:00``.
    """
    if not _MOMENT.fullmatch(text):
        raise ValueError(f"expected a date and time such as 2021-07-07T12:00:00+02:00, got '{text[:40]}'")
    return datetime.fromisoformat(_plain(text))


def tidy(text: str) -> str:
    """Moment with a ``T`` between date and time and a decimal point; ValueError as `moment`."""
    moment(text)
    return _plain(text)


def nanoseconds(text: str) -> int:
    """A moment with its zone, to the last digit of its fraction [ns since 1970, UTC]; ValueError as `moment`."""
    fraction = re.search(r"\.(\d{1,9})", text := tidy(text))
    whole = moment(text if fraction is None else text.replace(fraction[0], "", 1))
    return int(whole.timestamp()) * _SECOND + (0 if fraction is None else int(fraction[1].ljust(9, "0")))


def has_zone(text: str) -> bool:
    """Test whether the moment is known in UTC, and not only on a local clock."""
    return moment(text).tzinfo is not None


def shift_moment(text: str, seconds: float) -> str:
    """The moment `seconds` later, in the same zone."""
    then = moment(text) + timedelta(seconds=seconds)
    later = then.isoformat(timespec="auto" if then.microsecond % 1000 or not then.microsecond else "milliseconds")
    return later.removesuffix("+00:00") + "Z" if later.endswith("+00:00") else later


def in_words(text: str | None) -> str:
    """A start for a reader, who must see where the zone is missing."""
    if text is None:
        return "not known"
    return text if has_zone(text) else f"{text}, local time, zone not given"


def moment_text(origin: int, offset: int | None) -> str:
    """A moment [ns since 1970, UTC] at `offset` [s] from UTC; of a local clock where that is None."""
    local = origin + (offset or 0) * _SECOND
    unit = next(unit for unit, ns in (("s", _SECOND), ("ms", 1_000_000), ("us", 1000), ("ns", 1)) if local % ns == 0)
    text = str(np.datetime_as_string(np.datetime64(local, "ns"), unit=unit))  # type: ignore[call-overload]
    if not offset:
        return text if offset is None else text + "Z"
    minutes = abs(offset) // 60
    return f"{text}{'-' if offset < 0 else '+'}{minutes // 60:02d}:{minutes % 60:02d}"


def zone_offset(origin: int, zone: Any) -> int:
    """Offset of a zone from UTC [s] at a moment [ns since 1970]."""
    import pandas as pd

    ahead = pd.Timestamp(origin, unit="ns", tz="UTC").tz_convert(zone).utcoffset()
    return 0 if ahead is None else int(ahead.total_seconds())


def split_start(attributes: Mapping[str, str], time: Array) -> tuple[str | None, dict[str, str]]:
    """The moment of time 0 that a file's attributes give, and the attributes without it.

    Ours is ``start_time`` (``start_time_local`` in files of version 0.1.0). ``time_coverage_start`` (ACDD 1.3) is the
    moment of the first sample; times (T,) are in s.
    """
    first = float(time[0]) if time.size else 0.0
    for key, seconds in (("start_time", 0.0), ("start_time_local", 0.0), ("time_coverage_start", first)):
        try:
            text = tidy(attributes[key])
        except (KeyError, ValueError):
            continue
        ours = key.startswith("start_time")
        rest = {k: v for k, v in attributes.items() if k != key or not ours}
        return (text if seconds == 0.0 else shift_moment(text, -seconds)), rest
    return None, dict(attributes)


def _plain(text: str) -> str:
    return text.replace(" ", "T", 1).replace(" ", "").replace(",", ".")

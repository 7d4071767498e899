"""Retention times of a store."""

import re
from dataclasses import dataclass

from windsysid.errors import ConfigurationError

__all__ = ["DAY", "HOUR", "Keep", "span"]

SECOND = 1_000_000_000
DAY = 86_400 * SECOND
HOUR = DAY // 24
UNITS = {"hour": HOUR, "day": DAY, "week": 7 * DAY, "month": 30 * DAY, "year": 365 * DAY}


@dataclass(frozen=True)
class Keep:
    """Retention times of a store: ``30 days``, ``6 months``, ``10 years``, ``forever``.

    Attributes
    ----------
    results
        The windows' rows.
    levels
        The levels of every window. Of what is older, the last window of every day stays for good.
    alarms
        Alarms that have ended, since their end.
    spectra
        Spectra of the channels, of the last window of each hour.

    Raises
    ------
    ConfigurationError
        If a text is no time span.
    """

    results: str = "10 years"
    levels: str = "2 years"
    alarms: str = "10 years"
    spectra: str = "90 days"

    def __post_init__(self) -> None:
        for name in ("results", "levels", "alarms", "spectra"):
            try:
                span(getattr(self, name))
            except ConfigurationError as error:
                raise ConfigurationError(f"keep {name}: {error}") from None


def span(text: str) -> int | None:
    """A span of time in plain words [ns]; None for ``forever``.

    Raises
    ------
    ConfigurationError
        If it is none.
    """
    if text == "forever":
        return None
    found = re.fullmatch(r"(\d{1,6})\s*(hour|day|week|month|year)s?", text)
    if found is None or not int(found[1]):
        raise ConfigurationError(f"expected a span such as 30 days, 6 months, 10 years or forever, got '{text[:40]}'")
    return int(found[1]) * UNITS[found[2]]

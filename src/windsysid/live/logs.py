"""The log of a service: lines for people, or a JSON object a line for programs.

Whatever a client or a broker said is one line of printable characters here.
"""

import json
import logging
import sys
import threading
import time
from collections import OrderedDict
from datetime import UTC, datetime

from windsysid.live.blocks.limits import one_line
from windsysid.live.configuration.settings import LogSettings

__all__ = ["event", "start_log"]

MAX_MESSAGE_CHARACTERS = 2000
"""Characters of a message."""

FIELDS = "fields"
"""Attribute of a log record for its fields, by name."""

LEFT_OUT = "left_out"
"""Attribute of a log record: number of similar lines that were not written."""

LIBRARY_LOGGERS = ("uvicorn.error", "asyncio")
"""Loggers of libraries whose warnings are part of the service's log."""

MAX_SIMILAR_LINES, SIMILAR_LINES_SECONDS = 20, 60.0
"""Largest number of similar lines that are written in a period, and length of the period [s]."""

MAX_LINE_KINDS = 1000
"""Largest number of kinds of lines that are counted at a time."""


def start_log(settings: LogSettings) -> None:
    """Write logs of windsysid and its web server to standard error from now on."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Json() if settings.format == "json" else _Text())
    handler.addFilter(RepeatFilter())
    for name in ("windsysid", *LIBRARY_LOGGERS):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [handler], False
    logging.getLogger("windsysid").setLevel(settings.level.upper())
    for name in LIBRARY_LOGGERS:
        logging.getLogger(name).setLevel(max(logging.WARNING, logging.getLogger("windsysid").level))


class RepeatFilter(logging.Filter):
    """Filter that writes at most `MAX_SIMILAR_LINES` similar lines in a period, and counts the others.

    Lines are similar if they have the same logger, level and template. The first one of the next period gives the
    number of lines that were left out. Threads may log at the same time: `logging` calls filters without its lock.
    """

    def __init__(self, most: int = MAX_SIMILAR_LINES, seconds: float = SIMILAR_LINES_SECONDS) -> None:
        super().__init__()
        self._most, self._seconds = most, seconds
        self._guard = threading.Lock()
        self._counted: OrderedDict[tuple[str, int, str], tuple[float, int]] = OrderedDict()

    def filter(self, record: logging.LogRecord) -> bool:
        """Check whether a line is written."""
        key, now = (record.name, record.levelno, str(record.msg)[:MAX_MESSAGE_CHARACTERS]), time.monotonic()
        with self._guard:
            begun, count = self._counted.get(key, (now, 0))
            if now - begun >= self._seconds:
                setattr(record, LEFT_OUT, max(0, count - self._most))
                begun, count = now, 0
            self._counted[key] = begun, count + 1
            self._counted.move_to_end(key)
            if len(self._counted) > MAX_LINE_KINDS:
                self._counted.popitem(last=False)
        return count < self._most


def event(level: int, message: str, **fields: object) -> None:
    """Log something that has parts: in JSON they are keys, in text they stand behind the message."""
    logging.getLogger("windsysid.live").log(level, message, extra={FIELDS: fields})


def _clean(text: str) -> str:
    return one_line(text, MAX_MESSAGE_CHARACTERS)


def _moment(record: logging.LogRecord) -> str:
    return datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


class _Text(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        fields = getattr(record, FIELDS, {})
        parts = [record.getMessage(), *(f"{key}={value}" for key, value in fields.items() if value not in (None, ""))]
        parts += [f"({left_out} more like this one)"] if (left_out := getattr(record, LEFT_OUT, 0)) else []
        level = "" if record.levelno == logging.INFO else f"{record.levelname.lower()}: "
        return f"{_moment(record)} {level}{_clean(' '.join(parts))}{_trace(record)}"


class _Json(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        told = {"at": _moment(record), "level": record.levelname.lower(), "message": _clean(record.getMessage())}
        fields = {key: _plain(value) for key, value in getattr(record, FIELDS, {}).items() if key not in told}
        trace, left_out = _trace(record), getattr(record, LEFT_OUT, 0)
        fields |= {LEFT_OUT: left_out} if left_out else {}
        return json.dumps(told | fields | ({"trace": trace} if trace else {}), allow_nan=False)


def _plain(value: object) -> object:
    return value if isinstance(value, int | bool | None) else _clean(str(value))


def _trace(record: logging.LogRecord) -> str:
    """Origin of an unexpected error, in one line."""
    if not record.exc_info or record.exc_info[1] is None:
        return ""
    error, at = record.exc_info[1], record.exc_info[2]
    while at is not None and at.tb_next is not None:
        at = at.tb_next
    place = "" if at is None else f" in {at.tb_frame.f_code.co_name}, line {at.tb_lineno}"
    return _clean(f" ({type(error).__name__}{place}: {error})")

"""The log of a service: lines for people, or a JSON object a line for programs.

Whatever a client or a broker said is one line of printable characters here.
"""

import json
import logging
import sys
from datetime import UTC, datetime

from windsysid.live.limits import printable
from windsysid.live.settings import LogSettings

__all__ = ["event", "start_log"]

LONGEST = 2000
"""Characters of a message."""

FIELDS = "fields"
"""Attribute of a log record: what belongs to it, by name."""


def start_log(settings: LogSettings) -> None:
    """Write what windsysid and its web server log to standard error from now on."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Json() if settings.format == "json" else _Text())
    for name in ("windsysid", "uvicorn.error"):
        logger = logging.getLogger(name)
        logger.handlers, logger.propagate = [handler], False
    logging.getLogger("windsysid").setLevel(settings.level.upper())
    logging.getLogger("uvicorn.error").setLevel(max(logging.WARNING, logging.getLogger("windsysid").level))


def event(level: int, message: str, **fields: object) -> None:
    """Log something that has parts: in JSON they are keys, in text they stand behind the message."""
    logging.getLogger("windsysid.live").log(level, message, extra={FIELDS: fields})


def _clean(text: str) -> str:
    return printable(text, LONGEST)


def _moment(record: logging.LogRecord) -> str:
    return datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


class _Text(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        fields = getattr(record, FIELDS, {})
        parts = [record.getMessage(), *(f"{key}={value}" for key, value in fields.items() if value not in (None, ""))]
        level = "" if record.levelno == logging.INFO else f"{record.levelname.lower()}: "
        return f"{_moment(record)} {level}{_clean(' '.join(parts))}{_trace(record)}"


class _Json(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        told = {"at": _moment(record), "level": record.levelname.lower(), "message": _clean(record.getMessage())}
        fields = {key: _plain(value) for key, value in getattr(record, FIELDS, {}).items() if key not in told}
        trace = _trace(record)
        return json.dumps(told | fields | ({"trace": trace} if trace else {}), allow_nan=False)


def _plain(value: object) -> object:
    return value if isinstance(value, int | bool | None) else _clean(str(value))


def _trace(record: logging.LogRecord) -> str:
    """Where an error came from that nobody foresaw, in one line."""
    if not record.exc_info or record.exc_info[1] is None:
        return ""
    error, at = record.exc_info[1], record.exc_info[2]
    while at is not None and at.tb_next is not None:
        at = at.tb_next
    place = "" if at is None else f" in {at.tb_frame.f_code.co_name}, line {at.tb_lineno}"
    return _clean(f" ({type(error).__name__}{place}: {error})")

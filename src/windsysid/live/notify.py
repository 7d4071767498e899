"""Recipients of alarms: the log, a web address, or a broker.

The store keeps the last event that each recipient has confirmed, so that a restart loses no message. After an
interruption a recipient receives the current state. A slow recipient delays neither the engine nor another recipient.
"""

import asyncio
import hashlib
import json
import logging
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import Any, Protocol
from urllib.parse import quote, urlsplit

from windsysid._version import __version__
from windsysid.errors import WindsysidError
from windsysid.live.configuration.settings import SEVERITIES, MqttNotice, NoticeSettings, WebhookNotice
from windsysid.live.logs import event
from windsysid.live.sources.connection import Connection, tls_of
from windsysid.live.store.contents import Alarm, Event
from windsysid.live.store.store import Store

__all__ = [
    "LogRecipient", "MqttRecipient", "Recipient", "UndeliveredError", "Webhook", "notice_of", "recipient_of",
    "tell_alarms",
]  # fmt: skip

POLL_SECONDS = 1.0
"""Interval of reading the journal [s]."""

MAX_EVENTS_PER_READ = 1000
MAX_ALARMS_PER_READ = 100_000

MAX_ANSWER_SECONDS = 10.0
"""In which a recipient must confirm."""

MIN_PAUSE_SECONDS, MAX_PAUSE_SECONDS = 1.0, 300.0
"""Between tries [s]: each pause is twice the one before."""

REFUSALS = (400, 413, 422)
"""Status codes of a web address that will never accept this message: it is logged, and the next one is sent."""

_log = logging.getLogger("windsysid")


class UndeliveredError(WindsysidError):
    """A recipient did not confirm.

    Attributes
    ----------
    for_good
        Whether it will never take this message.
    """

    def __init__(self, why: str, *, for_good: bool = False) -> None:
        super().__init__(why)
        self.for_good = for_good


class Recipient(Protocol):
    """Recipient of alarms.

    Attributes
    ----------
    key
        Under which the store remembers it; it shows no secret.
    severity
        Lowest severity that is sent.
    """

    key: str
    severity: str

    async def send(self, alarm: Alarm) -> None:
        """Send the current state of an alarm; `UndeliveredError` if it is not confirmed."""

    async def close(self) -> None:
        """Let go of connections."""


def notice_of(alarm: Alarm) -> dict[str, Any]:
    """Message of an alarm as plain values; times in ISO 8601, UTC.

    ``text`` is one line that stands alone, as chat programs show it. ``key`` is the same for all messages of one
    alarm, and ``state`` is ``open``, ``acknowledged`` or ``ended``.
    """
    state = "ended" if alarm.ended is not None else "acknowledged" if alarm.acknowledged is not None else "open"
    heading = alarm.severity if state == "open" else f"{alarm.severity}, {state}"
    return {
        "text": f"{alarm.turbine}: {heading}: {alarm.text}",
        "key": alarm.key, "state": state, "turbine": alarm.turbine, "kind": alarm.kind, "severity": alarm.severity,
        "about": alarm.about, "what": alarm.text, "opened": _moment(alarm.opened), "earliest": _moment(alarm.earliest),
        "latest": _moment(alarm.latest), "ended": _moment(alarm.ended), "acknowledged": _moment(alarm.acknowledged),
        "by": alarm.by, "remark": alarm.remark, "windsysid": __version__,
    }  # fmt: skip


def _moment(ns: int | None) -> str | None:
    if ns is None:
        return None
    return datetime.fromtimestamp(ns / 1e9, UTC).isoformat(timespec="seconds").replace("+00:00", "Z")


def recipient_of(settings: NoticeSettings) -> Recipient:
    """The recipient that a table [[notify]] means."""
    if isinstance(settings, WebhookNotice):
        return Webhook(settings.url.value, settings.token.value if settings.token else None, settings.severity)
    return MqttRecipient(settings)


async def tell_alarms(store: Store, recipient: Recipient, stop: asyncio.Event) -> None:
    """Tell a recipient of every alarm that opens, changes, is acknowledged or ends, until `stop` is set.

    A new recipient receives the open alarms.
    """
    place = await _in_thread(stop, store.told, recipient.key)
    if place is None:
        place = await _in_thread(stop, store.last_event)
        fresh = await _in_thread(stop, store.alarms, open_only=True, most=MAX_ALARMS_PER_READ)
        await _tell(store, recipient, stop, fresh or [], place)
    while not stop.is_set():
        events: list[Event] = await _in_thread(stop, store.events, place, most=MAX_EVENTS_PER_READ) or []
        if events:
            place = events[-1].id
        changed = await _changed(store, stop, events)
        if changed is not None:
            await _tell(store, recipient, stop, changed, place)
        if len(events) < MAX_EVENTS_PER_READ:
            await _pause(stop, POLL_SECONDS)
    await recipient.close()


async def _changed(store: Store, stop: asyncio.Event, events: Sequence[Event]) -> list[Alarm] | None:
    """The alarms that events are about, as they are now; None where no event is about one."""
    changed = {one.key for one in events if one.kind == "alarm"}
    if not changed:
        return None
    known = await _in_thread(stop, store.alarms, most=MAX_ALARMS_PER_READ) or []
    return [alarm for alarm in known if alarm.key in changed]


async def _tell(
    store: Store, recipient: Recipient, stop: asyncio.Event, alarms: Sequence[Alarm], place: int
) -> None:  # fmt: skip
    """Send alarms, oldest first, and keep the position in the journal up to which all were sent."""
    await _send_all(recipient, reversed(alarms), stop)
    if not stop.is_set():
        await _in_thread(stop, store.tell, recipient.key, place)


async def _in_thread(stop: asyncio.Event, ask: Any, *given: Any, **options: Any) -> Any:
    """Answer of the store; repeated while its database is not reachable."""
    while True:
        try:
            return await asyncio.to_thread(ask, *given, **options)
        except WindsysidError as error:
            _log.warning("notices wait for the store: %s", error)
            await _pause(stop, MAX_PAUSE_SECONDS / 10.0)
            if stop.is_set():
                return None


async def _send_all(recipient: Recipient, alarms: Iterable[Alarm], stop: asyncio.Event) -> None:
    least = SEVERITIES.index(recipient.severity)
    for alarm in alarms:
        if SEVERITIES.index(alarm.severity) >= least and not stop.is_set():
            await _send(recipient, alarm, stop)


async def _send(recipient: Recipient, alarm: Alarm, stop: asyncio.Event) -> None:
    pause = MIN_PAUSE_SECONDS
    while not stop.is_set():
        try:
            await recipient.send(alarm)
            return
        except UndeliveredError as error:
            if error.for_good:
                _log.error("%s refuses alarm %s for good: %s", recipient.key, alarm.key, error)
                return
            if pause in (MIN_PAUSE_SECONDS, MAX_PAUSE_SECONDS):
                _log.warning("%s has not received alarm %s; it will be sent again: %s", recipient.key, alarm.key, error)
        await _pause(stop, pause)
        pause = min(2.0 * pause, MAX_PAUSE_SECONDS)


async def _pause(stop: asyncio.Event, seconds: float) -> None:
    try:
        await asyncio.wait_for(stop.wait(), seconds)
    except TimeoutError:
        return


class LogRecipient:
    """The service's own log."""

    key, severity = "log", "notice"

    async def send(self, alarm: Alarm) -> None:
        """Write a line."""
        told = notice_of(alarm)
        level = logging.WARNING if told["state"] == "open" else logging.INFO
        event(level, f"alarm: {told['text']}", **{part: told[part] for part in ("key", "state", "turbine", "kind")})

    async def close(self) -> None:
        """Nothing to release."""


class Webhook:
    """A web address that takes alarms as JSON."""

    def __init__(self, url: str, token: str | None, severity: str) -> None:
        import httpx

        self.severity = severity
        self.key = f"webhook {urlsplit(url).hostname} {hashlib.sha256(url.encode()).hexdigest()[:12]}"
        headers = {"User-Agent": f"windsysid/{__version__}"}
        if token is not None:
            headers["Authorization"] = f"Bearer {token}"
        self._url = url
        self._client = httpx.AsyncClient(headers=headers, timeout=MAX_ANSWER_SECONDS, follow_redirects=False)

    async def send(self, alarm: Alarm) -> None:
        """Post an alarm as it is now; `UndeliveredError` without an answer of 2xx."""
        import httpx

        try:
            answer = await self._client.post(self._url, json=notice_of(alarm))
        except (httpx.HTTPError, httpx.InvalidURL) as error:  # its text may hold the address, which may be a secret
            raise UndeliveredError(f"no answer ({type(error).__name__})") from None
        if not answer.is_success:
            raise UndeliveredError(f"answered {answer.status_code}", for_good=answer.status_code in REFUSALS)

    async def close(self) -> None:
        """Let go of connections."""
        await self._client.aclose()


class MqttRecipient:
    """A broker that keeps every open alarm as a retained message.

    The message of an alarm that ended is sent once more, and no longer kept.
    """

    def __init__(self, settings: MqttNotice) -> None:
        self.severity, self._topic, self._broker = settings.severity, settings.topic, settings.broker
        self.key = f"mqtt {urlsplit(settings.broker.url).hostname} {settings.topic}"
        tls_of(settings.broker)  # says at once what is wrong

    async def send(self, alarm: Alarm) -> None:
        """Publish an alarm as it is now; `UndeliveredError` where the broker does not confirm."""
        topic = self._topic.replace("{turbine}", alarm.turbine).replace("{alarm}", quote(alarm.key, safe=" "))
        ended = alarm.ended is not None
        try:
            async with asyncio.timeout(MAX_ANSWER_SECONDS):
                connection = await Connection.open(self._broker)
                try:
                    connection.publish(topic, json.dumps(notice_of(alarm)).encode(), retain=not ended)
                    if ended:
                        connection.publish(topic, b"", retain=True)
                    await connection.confirmed()
                finally:
                    await connection.close()
        except TimeoutError:
            raise UndeliveredError(f"no confirmation within {MAX_ANSWER_SECONDS:g} s") from None
        except OSError as error:
            raise UndeliveredError(" ".join(str(error).split()) or type(error).__name__) from None

    async def close(self) -> None:
        """Nothing to release: each alarm has a connection of its own."""

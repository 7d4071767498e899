"""Blocks from an MQTT 5 broker, acknowledged when they are on disk and not before.

The broker keeps what was not acknowledged under the client's name, for a week. What it loses all the same (a broker
that is killed, a queue that is full) a publisher sends again: the service tells it up to which number all blocks are
committed (`windsysid.live.sources.broker`).
"""

import asyncio
import contextlib
import json
import logging
import threading
import time
from collections import deque
from collections.abc import Iterable
from concurrent.futures import Future
from typing import Any

from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockLimits, BlockRefused, decode, refusing
from windsysid.live.configuration.source_settings import Broker
from windsysid.live.sources.broker import MAX_PAYLOAD_BYTES, TOPIC, Marks, Topics, connect, marks_of, new_client
from windsysid.live.sources.source import Push, SourceState, retries, stopped_within

__all__ = ["Inbox", "MqttSource"]

logger = logging.getLogger(__name__)

MAX_UNACKNOWLEDGED_MESSAGES = 4000
"""Messages that the broker sends before the first of them is acknowledged: of 100 turbines that are behind, and of
others, but no more than the engine lets in (`windsysid.live.engine.MAX_PENDING_BLOCKS`)."""

MAX_WAITING_BYTES = 64_000_000
"""Bytes of messages that wait for the engine; the broker's others wait in its connection."""

MAX_WAIT_SECONDS = 20.0
"""The longest that a message waits for room [s]: the client keeps the connection alive between two messages."""

SESSION_EXPIRY_SECONDS = 7 * 86_400
"""Time for which the broker keeps messages for a disconnected service [s]."""

ACKNOWLEDGEMENT_SECONDS = 0.1
"""Interval of acknowledgements to publishers [s]."""

LOG_INTERVAL_SECONDS = 10.0
"""Between two lines of the log about refused messages [s]."""

MAX_TOPICS_PER_MESSAGE = 100
"""In one message to the broker."""

MAX_STREAMS = 32
"""Setting: loggers of a turbine whose blocks are acknowledged."""


class MqttSource:
    """Subscribes to the blocks of turbines.

    Parameters
    ----------
    broker
        Address, user, password, authority.
    turbines
        Names: to blocks of others it does not listen, so that their publishers keep them.
    topic
        Of blocks, with ``{turbine}`` as one of its levels.
    client
        Under this name the broker keeps what was not acknowledged.
    """

    def __init__(
        self, broker: Broker, turbines: Iterable[str], *, topic: str = TOPIC, client: str = "windsysid-live"
    ) -> None:
        self.broker, self.client, self.topics = broker, client, Topics(topic)
        self.turbines = {self.topics.blocks(turbine): turbine for turbine in turbines}
        self.state = SourceState()
        self._lock = threading.Lock()
        self._committed: dict[str, dict[str, int]] = {turbine: {} for turbine in self.turbines.values()}
        self._untold: set[tuple[str, str]] = set()
        self._said = -LOG_INTERVAL_SECONDS

    def describe(self) -> str:
        """The broker and the number of turbines."""
        count = len(self.turbines)
        return f"MQTT broker {self.broker.url}, {count} turbine{'' if count == 1 else 's'}"

    async def run(self, push: Push, stop: asyncio.Event) -> None:
        """Bring blocks until `stop` is set; a broker that goes away is connected to again.

        Raises
        ------
        ConfigurationError
            If paho is not installed, or the broker's authority cannot be read.
        """
        async for succeeded in retries(stop):
            session = _Session(self, push)
            why = await session.hold(stop)
            if session.was_connected:
                succeeded()
            if not stop.is_set():
                logger.warning("%s: %s; trying again", self.describe(), why)
                self.state = self.state._replace(state="trying", text=why)
        self.state = self.state._replace(state="ended")

    def took(self, turbine: str, stream: str, sequence: int, after: int | None) -> None:
        """Note that a block is committed, or refused for good: its publisher may forget it where none is missing."""
        with self._lock:
            streams = self._committed[turbine]
            known = streams.get(stream)
            if known is None:
                if after is None and len(streams) < MAX_STREAMS:
                    streams[stream] = sequence
            elif after is None or after <= known:
                streams[stream] = max(known, sequence)
            if stream in streams:
                self._untold.add((turbine, stream))

    def untold(self, *, everything: bool = False) -> dict[tuple[str, str], int]:
        """Acknowledgements that are not sent yet, by turbine and stream."""
        with self._lock:
            keys = {(t, s) for t, known in self._committed.items() for s in known} if everything else self._untold
            self._untold = set()
            return {(turbine, stream): self._committed[turbine][stream] for turbine, stream in keys}

    def count(self, refused: str = "") -> None:
        """Count a block that was taken, or one that was refused, and say why now and then."""
        with self._lock:
            state = self.state
            if not refused:
                self.state = state._replace(blocks=state.blocks + 1)
                return
            self.state = state.with_refusal(refused)
            speak = time.monotonic() - self._said >= LOG_INTERVAL_SECONDS
            if speak:
                self._said = time.monotonic()
        if speak:
            logger.warning("%s: %d messages refused, the last: %s", self.describe(), state.refused + 1, refused)


class Inbox:
    """Messages that came and were not taken yet, in their order.

    Parameters
    ----------
    size
        Bytes of them; one larger message may be there alone.
    """

    def __init__(self, size: int) -> None:
        self._most, self.bytes = size, 0
        self._messages: deque[Any] = deque()
        self._changed = threading.Condition()
        self._closed = False

    def put(self, message: Any) -> None:
        """Add a message, when there is room for it or `MAX_WAIT_SECONDS` has passed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self.bytes < self._most, MAX_WAIT_SECONDS)
            self._messages.append(message)
            self.bytes += len(message.payload)
            self._changed.notify_all()

    def get(self) -> Any:
        """The oldest message, or None when the inbox is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._messages)
            if self._closed:
                return None
            message = self._messages.popleft()
            self.bytes -= len(message.payload)
            self._changed.notify_all()
            return message

    def close(self) -> None:
        """No messages are taken from now on: the broker keeps them."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()


class _Session:
    """One connection: messages come in the client's thread, and a thread of ours takes them in, one after the other.

    They are acknowledged as they are committed, not in the order in which they came: the engine holds back the blocks
    of a turbine that is behind, and the others' must not wait for them.
    """

    def __init__(self, source: MqttSource, push: Push) -> None:
        self._source, self._push = source, push
        self.was_connected = False
        self._why = ""
        self._inbox = Inbox(MAX_WAITING_BYTES)
        self._loop = asyncio.get_running_loop()
        self._over = asyncio.Event()
        self._client = new_client(source.broker, source.client, manual_ack=True)
        self._client.on_connect = self._on_connect
        self._client.on_disconnect = lambda _c, _u, _f, reason, _p: self._lose(f"connection lost ({reason})")
        self._client.on_message = lambda _c, _u, message: self._inbox.put(message)

    async def hold(self, stop: asyncio.Event) -> str:
        """Bring blocks until the connection is lost or `stop` is set; why it was lost."""
        taking = threading.Thread(target=self._take_all, name="mqtt-blocks", daemon=True)
        taking.start()
        try:
            await asyncio.to_thread(self._connect)
            while not self._over.is_set() and not await stopped_within(stop, ACKNOWLEDGEMENT_SECONDS):
                self._tell(self._source.untold())
        except OSError as error:
            self._why = f"no connection ({error.strerror or error})"
        finally:
            self._inbox.close()
            await asyncio.to_thread(self._close, taking)
        return self._why

    def _connect(self) -> None:
        told = {
            "SessionExpiryInterval": SESSION_EXPIRY_SECONDS,
            "ReceiveMaximum": MAX_UNACKNOWLEDGED_MESSAGES,
            "MaximumPacketSize": MAX_PAYLOAD_BYTES + 65_536,
        }
        connect(self._client, self._source.broker, clean=False, properties=told)

    def _close(self, taking: threading.Thread) -> None:
        taking.join(2.0)
        self._tell(self._source.untold())
        self._client.disconnect()
        self._client.loop_stop()

    def _lose(self, why: str) -> None:
        self._why = self._why or why
        with contextlib.suppress(RuntimeError):  # the loop has ended, and the session with it
            self._loop.call_soon_threadsafe(self._over.set)

    def _on_connect(self, client: Any, _userdata: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            self._lose(f"the broker refuses ({reason}): check user, password and its list of rights")
            return
        from paho.mqtt.subscribeoptions import SubscribeOptions

        topics = [(topic, SubscribeOptions(qos=1)) for topic in self._source.turbines]
        for i in range(0, len(topics), MAX_TOPICS_PER_MESSAGE):
            client.subscribe(topics[i : i + MAX_TOPICS_PER_MESSAGE])
        self._tell(self._source.untold(everything=True))  # a broker that was killed has forgotten it
        self.was_connected = True
        self._source.state = self._source.state._replace(state="running", text="")

    def _tell(self, committed: dict[tuple[str, str], int]) -> None:
        for (turbine, stream), sequence in committed.items():
            topic = self._source.topics.committed(turbine, stream)
            self._client.publish(topic, str(sequence), qos=0, retain=True)

    def _take_all(self) -> None:
        while (message := self._inbox.get()) is not None:
            if self._over.is_set():
                return
            self._take(message)

    def _take(self, message: Any) -> None:
        turbine = self._source.turbines.get(message.topic)
        if turbine is None:  # followed once, and the broker remembers
            self._client.unsubscribe(message.topic)
            self._client.ack(message.mid, message.qos)
            return
        marks = Marks()
        try:
            with refusing("read"):
                marks = marks_of(message)
                block = decode(message.payload, turbine=turbine, limits=BlockLimits(payload=MAX_PAYLOAD_BYTES))
            future = self._push(block)
        except BlockRefused as error:
            self._refuse(message, turbine, marks, str(error))
        except Exception as error:  # the service ends, or its store fails: the broker keeps the block
            self._lose(f"a block was not taken ({error})")
        else:
            future.add_done_callback(lambda done: self._taken(message, block, marks, done))

    def _taken(self, message: Any, block: Block, marks: Marks, done: Future[None]) -> None:
        error = done.exception()
        if isinstance(error, BlockRefused):
            self._refuse(message, block.turbine, marks, str(error))
        elif error is not None:
            self._lose(f"a block was not committed ({error})")
        else:
            self._source.count()
            self._source.took(block.turbine, block.stream, block.sequence, marks.after)
            self._client.ack(message.mid, message.qos)

    def _refuse(self, message: Any, turbine: str, marks: Marks, why: str) -> None:
        self._source.count(f"{turbine}: {why}")
        told = {"sequence": marks.sequence, "stream": marks.stream, "reason": why[:400]}
        self._client.publish(self._source.topics.refused(turbine), json.dumps(told), qos=1)
        if marks.sequence is not None and _is_name(marks.stream):
            self._source.took(turbine, marks.stream, marks.sequence, marks.after)
        self._client.ack(message.mid, message.qos)


def _is_name(stream: str) -> bool:
    return len(stream) <= 40 and all(sign.isalnum() or sign in "_.-" for sign in stream)

"""Blocks from an MQTT 5 broker, acknowledged when they are on disk and not before.

The broker keeps what was not acknowledged under the client's name, for a week. What it loses all the same (a broker
that is killed, a queue that is full) a publisher sends again: the service tells it up to which number all blocks are
committed (`windsysid.live.sources.broker`).
"""

import asyncio
import json
import logging
import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import STREAM, BlockLimits, BlockRefused, decode, refusing
from windsysid.live.configuration.source_settings import Broker
from windsysid.live.sources.broker import MAX_PAYLOAD_BYTES, TOPIC, Marks, Topics, marks_of
from windsysid.live.sources.connection import Connection, Message, Session, tls_of
from windsysid.live.sources.source import Push, SourceState, retries, stopped_within

__all__ = ["MqttSource"]

logger = logging.getLogger(__name__)

MAX_UNACKNOWLEDGED_MESSAGES = 4000
"""Messages that the broker sends before the first of them is acknowledged: of 100 turbines that are behind, and of
others, but no more than the engine lets in (`windsysid.live.engine.MAX_PENDING_BLOCKS`)."""

SESSION_EXPIRY_SECONDS = 7 * 86_400
"""Time for which the broker keeps messages for a disconnected service [s]."""

ANSWER_SECONDS = 0.1
"""Interval of acknowledgements to the broker and to publishers [s]."""

READ_SECONDS = 0.05
"""Shortest interval of reads [s]: messages of one read share a change of threads and a transaction, which cost more
than a block."""

LOG_INTERVAL_SECONDS = 10.0
"""Between two lines of the log about refused messages [s]."""

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
            If mqtt5 is not installed, or the broker's authority cannot be read.
        """
        tls_of(self.broker)  # says at once what is wrong
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


class _Session:
    """One connection: the messages of a read are taken in by a thread of ours, one after the other.

    They are acknowledged as they are committed, not in the order in which they came: the engine holds back the blocks
    of a turbine that is behind, and the others' must not wait for them.
    """

    def __init__(self, source: MqttSource, push: Push) -> None:
        self._source, self._push = source, push
        self.was_connected = self._over = False
        self._why = ""
        self._settled: deque[tuple[int, str, bytes]] = deque()

    async def hold(self, stop: asyncio.Event) -> str:
        """Bring blocks until the connection is lost or `stop` is set; why it was lost."""
        source = self._source
        session = Session(source.client, SESSION_EXPIRY_SECONDS, MAX_UNACKNOWLEDGED_MESSAGES)
        try:
            connection = await Connection.open(source.broker, session)
        except OSError as error:
            return f"no connection ({error.strerror or str(error) or 'no answer'})"
        connection.subscribe(list(source.turbines))
        self.was_connected = True
        source.state = source.state._replace(state="running", text="")
        thread = ThreadPoolExecutor(1, "mqtt-blocks")
        bringing = asyncio.ensure_future(self._bring(connection, thread))
        self._answer(connection, source.untold(everything=True))  # a broker that was killed has forgotten it
        try:
            while not self._over and not bringing.done() and not await stopped_within(stop, ANSWER_SECONDS):
                self._answer(connection, source.untold())
            bringing.cancel()
            await bringing
        except asyncio.CancelledError:
            pass
        except OSError as error:
            self._lose(f"connection lost ({str(error) or 'no answer'})")
        finally:
            self._over = True
            await asyncio.wait([asyncio.get_running_loop().run_in_executor(thread, int)], timeout=2.0)
            thread.shutdown(wait=False)
            self._answer(connection, source.untold())
            await connection.close()
        return self._why

    async def _bring(self, connection: Connection, thread: ThreadPoolExecutor) -> None:
        while True:
            messages = await connection.messages()
            if connection.refusal:  # the other turbines' blocks still come
                self._source.count(refused=f"the broker refuses {connection.refusal}: check the user's rights")
                connection.refusal = ""
            if messages:
                taking = asyncio.get_running_loop().run_in_executor(thread, self._take_all, messages)
                await asyncio.gather(taking, asyncio.sleep(READ_SECONDS))

    def _lose(self, why: str) -> None:
        self._why = self._why or why
        self._over = True

    def _answer(self, connection: Connection, committed: dict[tuple[str, str], int]) -> None:
        """Send acknowledgements, refusals, and behind these the numbers up to which blocks are committed: with them a
        publisher forgets a block."""
        for _ in range(len(self._settled)):
            mid, topic, refusal = self._settled.popleft()
            if refusal:
                connection.publish(topic, refusal)
            elif topic:
                connection.unsubscribe(topic)
            if mid:
                connection.acknowledge(mid)
        for (turbine, stream), sequence in committed.items():
            topic = self._source.topics.committed(turbine, stream)
            connection.publish(topic, b"%d" % sequence, qos=0, retain=True)
        connection.send()

    # in the thread

    def _take_all(self, messages: Sequence[Message]) -> None:
        for message in messages:
            if self._over:
                return
            self._take(message)

    def _take(self, message: Message) -> None:
        turbine = self._source.turbines.get(message.topic)
        if turbine is None:  # followed once, and the broker remembers
            self._settled.append((message.mid, message.topic, b""))
            return
        marks = Marks()
        try:
            with refusing("read"):
                marks = marks_of(message.properties)
                block = decode(message.payload, turbine=turbine, limits=_LIMITS)
            future = self._push(block)
        except BlockRefused as error:
            self._refuse(message, turbine, marks, str(error))
        except Exception as error:  # the service ends, or its store fails: the broker keeps the block
            self._lose(f"a block was not taken ({error})")
        else:
            future.add_done_callback(lambda done: self._taken(message, block, marks, done))

    def _taken(self, message: Message, block: Block, marks: Marks, done: Future[None]) -> None:
        error = done.exception()
        if isinstance(error, BlockRefused):
            self._refuse(message, block.turbine, marks, str(error))
        elif error is not None:
            self._lose(f"a block was not committed ({error})")
        else:
            self._source.count()
            self._source.took(block.turbine, block.stream, block.sequence, marks.after)
            self._settled.append((message.mid, "", b""))

    def _refuse(self, message: Message, turbine: str, marks: Marks, why: str) -> None:
        self._source.count(f"{turbine}: {why}")
        told = {"sequence": marks.sequence, "stream": marks.stream, "reason": why[:400]}
        self._settled.append((message.mid, self._source.topics.refused(turbine), json.dumps(told).encode()))
        if marks.sequence is not None and STREAM.fullmatch(marks.stream):
            self._source.took(turbine, marks.stream, marks.sequence, marks.after)


_LIMITS = BlockLimits(payload=MAX_PAYLOAD_BYTES)

"""A publisher: sends blocks to a broker, and keeps each until the service says that it is on its disk.

Neither a broker nor a network is relied on. A block that was sent stays in the buffer (`windsysid.live.sources.ring`)
until the service has committed it and all before it. When that takes too long, or the connection was lost, sending goes
back to the first block that is not committed, one block at first and twice as many after each success, as TCP does.

    with Publisher(Broker("mqtt://broker.site.example"), buffer="buffer.sqlite") as publisher:
        publisher.send(block)
"""

import asyncio
import contextlib
import json
import logging
import threading
import time
from collections import Counter, deque
from pathlib import Path
from types import TracebackType

from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockRefused, check, encode_arrow
from windsysid.live.configuration.source_settings import Broker
from windsysid.live.sources.broker import MAX_PAYLOAD_BYTES, TOPIC, Marks, Topics, needed, properties_of
from windsysid.live.sources.connection import Connection, Message, tls_of
from windsysid.live.sources.ring import Flow, PackedBlock, Ring
from windsysid.live.sources.source import retries, stopped_within

__all__ = ["Publisher"]

logger = logging.getLogger(__name__)

MAX_UNCOMMITTED_BLOCKS = 32
"""Blocks of a flow that were sent and are not committed, at most."""

MAX_UNCOMMITTED_BLOCKS_OF_ALL = 500
"""Largest number of sent blocks of all flows without commit: mosquitto by default keeps 1000 messages for a service,
and drops more silently."""

LOOK_EVERY = 0.25
"""Interval at which sent blocks that are not committed are looked for [s]."""

MAX_COMMIT_SECONDS = 60.0
"""Time for the service to commit a sent block [s]."""


class _Sending:
    """Progress of sending one flow; `under_way` counts the sent blocks of all flows without commit."""

    def __init__(self, patience: float, under_way: Counter[str]) -> None:
        self.committed: int | None = None
        self.sent: deque[int] = deque()
        self.width, self.patience, self.until = MAX_UNCOMMITTED_BLOCKS, patience, 0.0
        self._under_way = under_way

    def add(self, number: int) -> None:
        """Count a block as sent."""
        self.sent.append(number)
        self._under_way["blocks"] += 1

    def commit(self, number: int) -> None:
        """Count blocks up to a number as committed."""
        while self.sent and self.sent[0] <= number:
            self.sent.popleft()
            self._under_way["blocks"] -= 1

    def go_back(self, width: int) -> None:
        """Send again from the first block that is not committed."""
        self._under_way["blocks"] -= len(self.sent)
        self.sent.clear()
        self.width = width

    def drop(self, number: int) -> None:
        """A block is not under way any more."""
        with contextlib.suppress(ValueError):
            self.sent.remove(number)
            self._under_way["blocks"] -= 1


class Publisher:
    """Sends blocks of any number of turbines.

    Parameters
    ----------
    broker
        Address, user, password, authority.
    buffer
        File that keeps what is not committed, over restarts and power cuts; in memory where None.
    topic
        Of blocks, with ``{turbine}`` as one of its levels.
    most
        Size of the buffer [bytes]: when it is full, the oldest blocks are dropped, and the log says so.
    patience
        For the service to commit what was sent, before it is sent again [s].

    Raises
    ------
    ConfigurationError
        If pyarrow or mqtt5 is not installed, or the topic or the broker's authority is wrong.
    OutputError
        If the buffer cannot be written, or another publisher uses it.
    """

    def __init__(
        self,
        broker: Broker,
        *,
        buffer: str | Path | None = None,
        topic: str = TOPIC,
        most: int = 1_000_000_000,
        patience: float = 5.0,
    ) -> None:
        self.broker, self.topics, self.patience = broker, Topics(topic), patience
        needed("pyarrow", "Arrow blocks need pyarrow")
        needed("mqtt5", "MQTT needs mqtt5")
        tls_of(broker)  # says at once what is wrong
        self.ring = Ring(buffer, most=most)
        self.dropped = self.refused = self.resent = 0
        self._changed = threading.Condition(threading.RLock())
        self._newest = self.ring.flows()
        self._flows: dict[Flow, _Sending] = {}
        self._under_way, self._looked = Counter[str](), 0.0
        self._told: dict[str, Flow] = {}  # by the topic of its acknowledgements
        self._due: dict[Flow, None] = {}  # in the order in which their turn comes
        self._to_subscribe: list[str] = []
        self._connected = False
        self._why = ""
        self._loop, self._awake, self._closing = asyncio.new_event_loop(), asyncio.Event(), asyncio.Event()
        for flow in self._newest:
            self._open(flow)
        self._thread = threading.Thread(target=self._run, name="publisher", daemon=True)
        self._thread.start()

    def __enter__(self) -> "Publisher":
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        self.close()

    @property
    def connected(self) -> bool:
        """Check whether the broker is connected."""
        return self._connected

    @property
    def trouble(self) -> str:
        """Why the broker is not there or refuses, or why the last block was refused; empty where all is well."""
        return self._why

    def send(self, *blocks: Block) -> int:
        """Put blocks into the buffer; they are sent as soon as may be. How many of them were new.

        The numbers of a logger's blocks grow: one that is not above all before it was sent already.

        Raises
        ------
        BlockRefused
            If one is none, or too long for a message: none of the blocks is kept.
        OutputError
            If the buffer cannot be written: the blocks are not kept.
        """
        for block in blocks:
            check(block)  # what the service could never take is not worth a place in the buffer
        packed = [
            (Flow(block.turbine, block.stream), PackedBlock(block.sequence, encode_arrow(block))) for block in blocks
        ]
        longest = max((len(one.payload) for _, one in packed), default=0)
        if longest > MAX_PAYLOAD_BYTES:
            raise BlockRefused(f"block of {longest} bytes: expected {MAX_PAYLOAD_BYTES} at most; send shorter blocks")
        with self._changed:
            new, newest = self._new(packed)
            if not new:
                return 0
            dropped = self.ring.put(new)
            self._newest.update(newest)
            for flow, _ in new:
                self._open(flow)
                self._due[flow] = None
        self._wake_up(self._awake)
        if dropped:
            self.dropped += dropped
            logger.warning("buffer full: %d blocks dropped, the oldest (%d in all)", dropped, self.dropped)
        return len(new)

    def _new(self, packed: list[tuple[Flow, PackedBlock]]) -> tuple[list[tuple[Flow, PackedBlock]], dict[Flow, int]]:
        """Blocks with a higher number than all before of their flow, and the newest numbers of these flows."""
        new, newest = [], dict[Flow, int]()
        for flow, one in packed:
            if one.sequence > newest.get(flow, self._newest.get(flow, -1)):
                newest[flow] = one.sequence
                new.append((flow, one))
        return new, newest

    def wait(self, timeout: float | None = None, *, room: int | None = None) -> bool:
        """Wait until everything is committed, or the buffer has `room` [bytes]; False after `timeout` [s]."""

        with self._changed:
            return self._changed.wait_for(
                lambda: not len(self.ring) or (room is not None and self.ring.room >= room), timeout
            )

    def close(self) -> None:
        """Disconnect; uncommitted blocks stay in the buffer's file."""
        self._wake_up(self._closing, self._awake)
        self._thread.join()
        self.ring.close()

    def _wake_up(self, *events: asyncio.Event) -> None:
        with contextlib.suppress(RuntimeError):  # its loop has ended
            for each in events:
                self._loop.call_soon_threadsafe(each.set)

    def _open(self, flow: Flow) -> None:
        """Register a flow, and subscribe to its acknowledgements."""
        if flow not in self._flows:
            self._flows[flow] = _Sending(self.patience, self._under_way)
            self._told[self.topics.committed(*flow)] = flow
            self._to_subscribe += self._topics_of(flow)

    def _topics_of(self, flow: Flow) -> list[str]:
        return [self.topics.committed(*flow), self.topics.refused(flow.turbine)]

    # the thread

    def _run(self) -> None:
        with contextlib.closing(self._loop):
            self._loop.run_until_complete(self._hold_all())

    async def _hold_all(self) -> None:
        async for succeeded in retries(self._closing):
            try:
                connection = await Connection.open(self.broker)
            except OSError as error:
                self._lost(f"no connection ({error.strerror or str(error) or 'no answer'})")
                continue
            succeeded()
            try:
                await self._hold(connection)
            except OSError as error:
                self._lost(f"connection lost ({str(error) or 'no answer'})")

    async def _hold(self, connection: Connection) -> None:
        """Send, until the publisher is closed or the connection is lost."""
        self._begin()
        receiving = asyncio.ensure_future(self._receive(connection))
        try:
            while not self._closing.is_set() and not receiving.done():
                self._go_on(connection)
                await stopped_within(self._awake, LOOK_EVERY)
                self._awake.clear()
            receiving.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await receiving
        finally:
            await connection.close()

    def _begin(self) -> None:
        with self._changed:
            self._to_subscribe = [topic for flow in self._flows for topic in self._topics_of(flow)]
            for flow, sending in self._flows.items():
                sending.go_back(MAX_UNCOMMITTED_BLOCKS)
                self._due[flow] = None
            self._connected, self._why = True, ""

    def _go_on(self, connection: Connection) -> None:
        """Send what is due."""
        with self._changed:
            topics, self._to_subscribe = self._to_subscribe, []
            connection.subscribe(topics)
            now = time.monotonic()
            if now > self._looked + LOOK_EVERY:
                self._looked = now
                self._look_for_lost(now)
            while self._due and self._room() > 0:
                flow = next(iter(self._due))
                del self._due[flow]
                self._send_more(connection, flow, self._flows[flow])
            self._changed.notify_all()
        connection.send()

    def _look_for_lost(self, now: float) -> None:
        """Send again what the service did not commit in time."""
        for flow, sending in self._flows.items():
            if sending.sent and now > sending.until:
                self.resent += len(sending.sent)
                sending.go_back(1)
                sending.patience = min(2.0 * sending.patience, MAX_COMMIT_SECONDS)
                self._due[flow] = None

    def _room(self) -> int:
        """Blocks that may be sent before more are committed."""
        return MAX_UNCOMMITTED_BLOCKS_OF_ALL - self._under_way["blocks"]

    def _send_more(self, connection: Connection, flow: Flow, sending: _Sending) -> None:
        if sending.committed is not None:
            self.ring.forget(flow, sending.committed)
        last = sending.sent[-1] if sending.sent else None
        for block in self.ring.after(flow, last, min(sending.width - len(sending.sent), self._room())):
            after = last if last is not None and self.ring.holds(flow, last) else None
            marks = Marks(block.sequence, flow.stream, after)
            connection.publish(self.topics.blocks(flow.turbine), block.payload, properties_of(marks))
            if not sending.sent:
                sending.until = time.monotonic() + sending.patience
            sending.add(block.sequence)
            last = block.sequence

    def _lost(self, why: str) -> None:
        with self._changed:
            self._connected = False
            self._troubled(why)

    def _troubled(self, why: str) -> None:
        if why != self._why:
            logger.warning("broker %s: %s; %d blocks wait", self.broker.url, why, len(self.ring))
        self._why = why

    # what the broker says

    async def _receive(self, connection: Connection) -> None:
        while True:
            messages = await connection.messages()
            with self._changed:
                for message in messages:
                    self._on_message(message)
                if connection.refusal:
                    self._troubled(f"the broker refuses {connection.refusal}: check the user's rights")
                    connection.refusal = ""
            if self._due:
                self._awake.set()

    def _on_message(self, message: Message) -> None:
        if message.retained:  # of a store that may be gone, or restored from a backup: what it had is not what it has
            return
        flow = self._told.get(message.topic)
        if flow is None:
            self._refused(message)
            return
        with contextlib.suppress(ValueError):
            self._heard(flow, self._flows[flow], int(message.payload))

    def _refused(self, message: Message) -> None:
        """The service will never take a block: it goes, and the log says so."""
        try:
            told = json.loads(message.payload)
            number, stream = int(told["sequence"]), str(told["stream"])
        except (ValueError, TypeError, KeyError, RecursionError):
            return
        flows = [f for f in self._flows if f.stream == stream and self.topics.refused(f.turbine) == message.topic]
        for flow in flows:
            if not self.ring.holds(flow, number):  # another publisher's, or known
                continue
            self.refused += 1
            self._why = f"a block was refused: {message.payload[:300].decode(errors='replace')}"
            logger.warning("%s", self._why)
            self.ring.drop(flow, number)
            self._flows[flow].drop(number)
            self._due[flow] = None

    def _heard(self, flow: Flow, sending: _Sending, number: int) -> None:
        if sending.committed is not None and number <= sending.committed:
            return
        sending.committed = number
        self._newest[flow] = max(number, self._newest.get(flow, number))
        sending.commit(number)
        sending.width = min(2 * sending.width, MAX_UNCOMMITTED_BLOCKS)
        sending.patience, sending.until = self.patience, time.monotonic() + self.patience
        self._due[flow] = None

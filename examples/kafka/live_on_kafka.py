"""
The live engine on Kafka
========================

``python live_on_kafka.py BROKER`` follows the turbines of `FOLLOWED` as a service of Quix Streams, for those who
outgrow one machine. Start it on as many machines as the topic ``blocks`` has partitions. It needs ``pip install
quixstreams``.

In: blocks as `windsysid.live.blocks.codec.encode_arrow` writes them, keyed by the turbine's name. Out: JSON, in the
topics ``estimates`` and ``alarms``. An alarm that comes again with the same ``key`` replaces the one before.

What a turbine's engine has to know is in the keyed state of Quix Streams: blocks whose window is open, the watch's
checkpoint, the stream's status, open alarms. It moves with the partition. Offset, state and what goes out are one
transaction of Kafka: each window is meant to be estimated once. docs/live_sources.md says what of that was tried.
"""

import logging
import sys
import threading
import uuid
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from typing import Any, NamedTuple

from windsysid.fleet.members import Member
from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockLimits, BlockRefused, decode, encode_arrow
from windsysid.live.engine import Engine, Followed
from windsysid.live.store.contents import Alarm, Commit, Status
from windsysid.results.serialization import finite

FOLLOWED = [Followed(Member("T01", "tower")), Followed(Member("T02", "tower"))]
"""Put your turbines here."""

PATIENCE = 240.0
"""Longest time for a block and the windows that it closes [s]: Kafka gives the partition away after 300 s."""

OWN = BlockLimits(payload=2**30)
"""Blocks in the state were checked before they came there."""


class KeyedStore:
    """In-memory part of `windsysid.live.store.store.Store` that an engine of one turbine uses, until `save`.

    The engine's threads commit here. Only `save` writes into the keyed state, in the transaction of a message.
    """

    trouble = ""

    def __init__(self, turbine: str, state: Any) -> None:
        self._lock = threading.Lock()
        self._kept: dict[int, int] = dict(state.get("windows", []))  # how many blocks of a window the state has
        self._blocks = {
            window: [decode(state.get_bytes(_key(window, i)), turbine=turbine, limits=OWN) for i in range(count)]
            for window, count in self._kept.items()
        }
        newest, status = state.get_bytes("checkpoint"), state.get("status")
        self._checkpoint = None if newest is None else (int.from_bytes(newest[:8], "big"), newest[8:])
        self._statuses = [] if status is None else [Status(**status)]
        self._alarms = {alarm["key"]: Alarm(**alarm) for alarm in state.get("alarms", [])}
        self._new: list[Commit] = []

    def submit(self, commit: Commit) -> "Future[None]":
        """Keep a commit; nothing of it counts before the message's transaction ends."""
        with self._lock:
            self._new.append(commit)
            for window, block in commit.blocks:
                self._blocks.setdefault(window, []).append(block)
            for result in commit.results:
                self._blocks.pop(result.window, None)
        done: Future[None] = Future()
        done.set_result(None)
        return done

    def save(self, state: Any) -> list[dict[str, Any]]:
        """Write into the state what is new, and give what goes downstream."""
        with self._lock:
            new, self._new = self._new, []
        out = []
        for commit in new:
            for window, block in commit.blocks:
                number = self._kept.get(window, 0)
                state.set_bytes(_key(window, number), encode_arrow(block))
                self._kept[window] = number + 1
            for result in commit.results:
                for number in range(self._kept.pop(result.window, 0)):
                    state.delete(_key(result.window, number))
                state.set_bytes("checkpoint", result.until.to_bytes(8, "big") + result.checkpoint)
                told = result._asdict() | {"levels": [level._asdict() for level in result.levels]}
                out.append({"topic": "estimates"} | {key: told[key] for key in told if key != "checkpoint"})
            for status in commit.statuses:
                state.set("status", status._asdict())
            for alarm in commit.alarms:
                out.append({"topic": "alarms"} | alarm._asdict())
                self._alarms.pop(alarm.key, None)
                if alarm.ended is None and alarm.kind != "structure":  # those of the structure are in the checkpoint
                    self._alarms[alarm.key] = alarm
        state.set("windows", list(self._kept.items()))
        state.set("alarms", [alarm._asdict() for alarm in self._alarms.values()])
        return [finite(message) for message in out]

    # what the engine asks at its start, and of a window that is closed

    def waiting(self, turbine: str, window: int | None = None) -> Iterator[tuple[int, Block]]:
        """Blocks whose window has no result yet, by window, stream and sequence."""
        with self._lock:
            found = [(at, block) for at, blocks in self._blocks.items() if window in (None, at) for block in blocks]
        return iter(sorted(found, key=lambda one: (one[0], one[1].stream, one[1].sequence)))

    def checkpoint(self, turbine: str) -> tuple[int, bytes] | None:
        """The newest result's `until` and checkpoint."""
        return self._checkpoint

    def statuses(self) -> list[Status]:
        """The turbine's, if it has one."""
        return self._statuses

    def alarms(self, **_: Any) -> list[Alarm]:
        """Those that are open."""
        return list(self._alarms.values())

    def configure(self, turbine: str, settings: str, tables: dict[str, Any]) -> None:
        """The settings are this file."""


class Running(NamedTuple):
    """An engine of this process, and the mark of the state that it knows."""

    mark: str
    engine: Engine
    store: KeyedStore


class Turbines:
    """Takes messages: for each turbine an engine, begun from the keyed state."""

    def __init__(self, followed: Sequence[Followed]) -> None:
        self._followed = {one.member.name: one for one in followed}
        self._running: dict[str, Running] = {}

    def take(self, payload: bytes, turbine: str, timestamp: int, headers: Any, state: Any) -> list[dict[str, Any]]:
        """Take a message, and give what goes downstream. The arguments are those of ``StreamingDataFrame.apply``."""
        if turbine not in self._followed:
            logging.warning("message for turbine %.60r: it is not followed; add it to FOLLOWED", turbine)
            return []
        try:
            block = decode(payload, turbine=turbine)
        except BlockRefused as error:
            logging.warning("%s: %s", turbine, error)
            return []
        _, engine, store = self._of(turbine, state)
        try:
            engine.push(block).result(PATIENCE)
        except BlockRefused as error:  # the engine has made it an alarm
            logging.warning("%s: %s", turbine, error)
        if not engine.wait_idle(PATIENCE):
            raise TimeoutError(f"{turbine}: a window took longer than {PATIENCE:g} s: nothing of it is committed")
        out = store.save(state)
        mark = uuid.uuid4().hex
        state.set("mark", mark)
        self._running[turbine] = Running(mark, engine, store)
        return out

    def _of(self, turbine: str, state: Any) -> Running:
        """The turbine's engine; a new one where the state is not what this process left: another process had it, or it
        was undone.

        It is written down again when its message is done, so that one that failed is not used again.
        """
        running = self._running.pop(turbine, None)
        mark = state.get("mark", "")
        if running is not None and running.mark == mark:
            return running
        if running is not None:
            running.engine.drain(0.0)
        store = KeyedStore(turbine, state)
        return Running(mark, Engine([self._followed[turbine]], store, workers=0), store)  # type: ignore[arg-type]


def application(broker: str, followed: Sequence[Followed], **options: Any) -> Any:
    """The application of Quix Streams; `options` are its own."""
    from quixstreams import Application

    given = {"consumer_group": "windsysid", "auto_offset_reset": "earliest", "processing_guarantee": "exactly-once"}
    app = Application(broker_address=broker, **given | options)
    blocks = app.topic("blocks", key_deserializer="str", value_deserializer="bytes")
    stream = app.dataframe(blocks).apply(Turbines(followed).take, expand=True, stateful=True, metadata=True)
    for name in ("estimates", "alarms"):
        stream[stream["topic"] == name].to_topic(app.topic(name, key_serializer="str", value_serializer="json"))
    return app


def _key(window: int, number: int) -> str:
    return f"block {window} {number}"


if __name__ == "__main__":
    application(sys.argv[1], FOLLOWED).run()

"""Blocks that a source pushed: counted when they are committed, refused with their reason."""

import asyncio
from concurrent.futures import Future

import numpy as np

from windsysid.live.blocks.block import Block
from windsysid.live.blocks.codec import BlockRefused
from windsysid.live.sources.ring import Flow, PackedBlock, Ring
from windsysid.live.sources.source import Commits, SourceState


class Silent:
    """A source that brings nothing by itself."""

    state = SourceState()

    def describe(self) -> str:
        return "silent"

    async def run(self, push: object, stop: asyncio.Event) -> None:
        """Bring nothing."""


def block(sequence: int) -> Block:
    return Block("T", sequence, 0, 10.0, ("ax",), ("m/s^2",), np.zeros((10, 1)))


def push(one: Block) -> Future[None]:
    """Commit blocks with an even number; refuse 1 at once and 3 later."""
    future: Future[None] = Future()
    if one.sequence == 1:
        raise BlockRefused("at once")
    if one.sequence == 3:
        future.set_exception(BlockRefused("later"))
    else:
        future.set_result(None)
    return future


def test_committed_blocks_are_counted_and_refusals_are_told():
    source = Silent()

    async def run() -> None:
        commits = Commits(source, "file: ")
        for number in range(5):
            await commits.push(push, block(number))
        await commits.finish()

    asyncio.run(run())
    assert (source.state.blocks, source.state.refused) == (3, 2)
    assert source.state.refusal == "file: later"


def test_a_ring_drops_the_oldest_blocks():
    ring = Ring(most=25)
    flow = Flow("T", "")
    assert ring.put([(flow, PackedBlock(number, bytes(10))) for number in range(4)]) == 2
    assert [one.sequence for one in ring.after(flow, None, 10)] == [2, 3]
    assert ring.flows() == {flow: 3}
    ring.close()

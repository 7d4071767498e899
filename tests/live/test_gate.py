"""How much may be on its way to the store at once: blocks and bytes."""

import threading
import time

from windsysid.live.blocks.gate import Gate


def enters(gate: Gate, size: int) -> bool:
    """Whether a block of so many bytes is let in at once."""
    waiting = threading.Thread(target=gate.enter, args=(size,), daemon=True)
    waiting.start()
    waiting.join(0.2)
    return not waiting.is_alive()


def test_blocks_wait_where_bytes_fill_the_way_and_where_blocks_do():
    gate = Gate(blocks=3, size=100)
    gate.enter(60)
    gate.enter(60)  # the last one may go beyond
    assert not enters(gate, 1)
    gate.leave(60)
    time.sleep(0.05)
    assert gate.inside == 2  # what had waited went in
    assert enters(gate, 1)
    assert not enters(gate, 1)


def test_a_block_that_is_larger_than_the_way_may_be_there_alone():
    gate = Gate(blocks=3, size=100)
    assert enters(gate, 1000)
    assert not enters(gate, 1)


def test_nobody_waits_once_the_engine_ends():
    gate = Gate(blocks=1, size=100)
    gate.enter(1)
    gate.open()
    assert enters(gate, 1)

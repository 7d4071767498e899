"""Commits as rows, and what the columns hold."""

import numpy as np

from windsysid.live.blocks.block import Block
from windsysid.live.store.batch import CommitBatch, prepare
from windsysid.live.store.contents import Commit, Status, StoredBlock
from windsysid.live.store.database import one_line
from windsysid.live.store.encoding import block_of, columns_of

BLOCK = Block("T", 3, 5, 10.0, ("ax", "ay"), ("m/s^2", "g"), np.array([[0.1, np.nan]], dtype=np.float32), "s")


def test_a_block_comes_back_bit_for_bit():
    back = block_of(columns_of(BLOCK))
    assert back.values.dtype == np.float32
    assert back.values.tobytes() == BLOCK.values.tobytes()
    assert (back.channels, back.units, back.stream) == (BLOCK.channels, BLOCK.units, "s")


def test_of_several_statuses_the_last_is_written():
    def status(state: str) -> Commit:
        return Commit(blocks=[StoredBlock(0, BLOCK)], statuses=[Status("T", {}, 0, 0, state, None, {})])

    batch = CommitBatch([prepare(status("waiting")), prepare(status("running"))], 7)
    written = [rows for _, rows in batch.statements()]
    assert [len(rows) for rows in written] == [2, 1]
    assert "running" in written[1][0]
    assert batch.event == 9


def test_an_error_of_a_driver_is_one_line():
    assert one_line(ValueError("no\n  such table")) == "no"
    assert one_line(ValueError()) == "ValueError"

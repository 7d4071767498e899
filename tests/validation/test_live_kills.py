"""The trial of kills itself: short, and it finds what is lost."""

from pathlib import Path

import pytest

live_kills = pytest.importorskip("validation.live_kills", reason="kills need a fork")


@pytest.fixture(scope="module")
def blocks():
    return live_kills.blocks_of(150.0)


@pytest.mark.slow
def test_kills_lose_nothing(blocks, tmp_path: Path):
    trial = live_kills.Trial(tmp_path, blocks, None, 3)
    trial.through("service", 5)
    assert trial.tally.lost == []
    assert trial.tally.blocks == len(blocks)


@pytest.mark.slow
def test_a_block_that_was_acknowledged_and_is_not_there_is_found(blocks, tmp_path: Path):
    url, memory = str(tmp_path / "store.sqlite"), tmp_path / "sent"
    live_kills.serve(url, memory, blocks[:20])
    assert live_kills.missing(url, live_kills.remembered(memory), blocks)[0] == []
    lost, _ = live_kills.missing(url, {live_kills.key_of(blocks[-1])}, blocks)
    assert lost
    assert all(line == f"{live_kills.key_of(blocks[-1])}: lost" for line in lost)

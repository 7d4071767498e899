"""Files of a folder are taken when they are complete, once, and from where they ended."""

import asyncio
import logging
import time
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.live.sources.conftest import Service, Taker
from tests.live.sources.servers import wait_for
from windsysid.errors import StoreError
from windsysid.live.blocks.block import Block
from windsysid.live.sources import folder
from windsysid.live.sources.folder import FolderSource
from windsysid.records.formats import iterate_record, write_record
from windsysid.records.record import Record

CHANNELS, UNITS = ("tower_x_acceleration", "tower_y_acceleration"), ("m/s^2", "m/s^2")


@pytest.fixture(autouse=True)
def _looks_often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folder, "POLL_SECONDS", 0.05)


def record_of(minute: int, samples: int = 1000) -> Record:
    values = np.random.default_rng(minute).standard_normal((samples, 2))
    start = f"2026-01-05T12:{minute:02d}:00Z"
    return Record(np.arange(samples) / 20.0, values, CHANNELS, UNITS, start=start)


def values_of(service: Service) -> np.ndarray:
    blocks = sorted(service.taker.blocks, key=lambda block: block.start)
    return np.concatenate([block.values for block in blocks])


def test_files_that_are_there_and_that_come_are_taken_once(tmp_path: Path):
    records = [record_of(minute) for minute in range(3)]
    write_record(records[0], tmp_path / "a.csv")
    write_record(records[1], tmp_path / "b.nc")
    (tmp_path / ".hidden.csv").write_text("half")
    (tmp_path / "notes.md").write_text("no record")
    service = Service(FolderSource(tmp_path, "T01", pattern="*.[cn]*"))
    wait_for(lambda: len(service.taker.blocks) == 10)
    write_record(records[2], tmp_path / "c.csv")
    wait_for(lambda: len(service.taker.blocks) == 15)
    service.stop()
    assert np.array_equal(values_of(service), np.concatenate([record.values for record in records]))
    assert (service.source.state.blocks, service.source.state.refused) == (15, 0)
    again = Service(FolderSource(tmp_path, "T01", pattern="*.[cn]*"))
    wait_for(lambda: len(again.taker.blocks) == 15)
    again.stop()
    assert again.taker.numbers() == service.taker.numbers()  # by which they are known


def test_a_file_that_is_half_written_is_taken_when_it_is_whole(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    caplog.set_level(logging.WARNING)
    write_record(record_of(0), tmp_path / "whole.nc")
    whole = (tmp_path / "whole.nc").read_bytes()
    (tmp_path / "whole.nc").unlink()
    (tmp_path / "a.nc").write_bytes(whole[: len(whole) // 2])
    service = Service(FolderSource(tmp_path, "T01"))
    wait_for(lambda: service.source.state.refused == 1)
    assert not service.taker.blocks
    (tmp_path / "a.nc").write_bytes(whole)
    wait_for(lambda: len(service.taker.blocks) == 5)
    service.stop()
    assert len([line for line in caplog.messages if "a.nc" in line]) == 1
    assert np.array_equal(values_of(service), record_of(0).values)


def test_a_file_that_grows_goes_on_where_it_ended(tmp_path: Path):
    record = record_of(0)
    write_record(record, tmp_path / "whole.csv")
    lines = (tmp_path / "whole.csv").read_text().splitlines(keepends=True)
    (tmp_path / "whole.csv").unlink()
    (tmp_path / "a.csv").write_text("".join(lines[:505]))
    service = Service(FolderSource(tmp_path, "T01"))
    wait_for(lambda: sum(len(block.values) for block in service.taker.blocks) > 450)
    time.sleep(0.01)  # the file's time of change must differ where its size could not tell
    (tmp_path / "a.csv").write_text("".join(lines))
    wait_for(lambda: sum(len(block.values) for block in service.taker.blocks) == 1000)
    service.stop()
    assert np.array_equal(values_of(service), record.values)


def test_a_file_without_its_moment_is_refused_with_what_to_do(tmp_path: Path):
    write_record(Record(np.arange(100) / 20.0, np.ones((100, 2)), CHANNELS, UNITS), tmp_path / "a.csv")
    service = Service(FolderSource(tmp_path, "T01"))
    wait_for(lambda: service.source.state.refused == 1)
    service.stop()
    assert service.source.state.refusal.endswith("give zone or start in the mapping (docs/records.md)")


def test_a_folder_that_goes_away_is_waited_for(tmp_path: Path):
    place = tmp_path / "share"
    service = Service(FolderSource(place, "T01"))
    wait_for(lambda: service.source.state.state == "trying")
    place.mkdir()
    write_record(record_of(0), place / "a.csv")
    wait_for(lambda: len(service.taker.blocks) == 5)
    assert service.source.state.state == "running"
    service.stop()


def test_a_file_that_breaks_its_reader_is_refused_and_the_next_one_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def reading(path: Path, *more: Any, **options: Any) -> Any:
        if path.name == "a.nc":
            raise MemoryError("no\nroom")
        return iterate_record(path, *more, **options)

    monkeypatch.setattr(folder, "iterate_record", reading)
    write_record(record_of(0), tmp_path / "a.nc")
    write_record(record_of(1), tmp_path / "b.nc")
    service = Service(FolderSource(tmp_path, "T01"))
    wait_for(lambda: len(service.taker.blocks) == 5)
    service.stop()
    state = service.source.state
    assert (state.refused, state.refusal) == (1, "a.nc: cannot be read (MemoryError: no room)")


def test_a_file_whose_blocks_the_store_did_not_take_is_taken_again(tmp_path: Path):
    write_record(record_of(0), tmp_path / "a.nc")
    source, taker, failing = FolderSource(tmp_path, "T01"), Taker(), [True]

    def push(block: Block) -> Future[None]:
        if failing:
            raise StoreError(f"full {failing.pop()}")
        return taker.push(block)

    async def run(stop: asyncio.Event) -> None:
        running = asyncio.ensure_future(source.run(push, stop))
        while not running.done() and len(taker.blocks) < 5:
            await asyncio.sleep(0.02)
        stop.set()
        await running

    with pytest.raises(StoreError, match="full"):
        asyncio.run(run(asyncio.Event()))
    asyncio.run(run(asyncio.Event()))  # the service starts it again
    assert np.array_equal(np.concatenate([block.values for block in taker.blocks]), record_of(0).values)
    assert source.state.refused == 0

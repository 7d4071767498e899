"""Who runs the tasks: threads that each speak to a worker, and a caller who hears what they say."""

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from windsysid.errors import OutputError
from windsysid.fleet.archive import rows_in
from windsysid.fleet.members import single
from windsysid.fleet.rows import empty_row
from windsysid.fleet.work.engine import run_here, share
from windsysid.fleet.work.guard import StoppedError, Worker
from windsysid.fleet.work.tasks import Task


def test_workers_share_items_and_what_they_say_is_heard_by_the_caller():
    both, heard, met = threading.Barrier(2, timeout=30.0), list[tuple[int, bool]](), set[Worker]()

    def do(item: int, worker: Worker, say: Callable[..., None]) -> None:
        met.add(worker)
        if item < 2:
            both.wait()  # two workers are at it
        say(item, threading.current_thread() is here)

    def tell(item: int, same: bool) -> None:
        assert threading.current_thread() is here
        heard.append((item, same))

    here, workers = threading.current_thread(), [Worker(1.0), Worker(1.0)]
    share(range(20), workers, do, tell)
    assert sorted(heard) == [(item, False) for item in range(20)]
    assert met == set(workers)
    assert not any(worker._stopped.is_set() for worker in workers)  # they are asked again


def test_where_one_worker_fails_the_others_are_closed():
    def do(item: int, worker: Worker, say: Callable[..., None]) -> None:
        if item:
            raise OutputError("full")
        worker._stopped.wait(30.0)
        raise StoppedError

    workers = [Worker(1.0), Worker(1.0)]
    with pytest.raises(OutputError, match="full"):
        share(range(2), workers, do, print)
    assert all(worker._stopped.is_set() for worker in workers)


class Answering(Worker):
    """A worker without a process, which answers when others are at work, too."""

    def __init__(self, met: threading.Barrier) -> None:
        super().__init__(1.0)
        self.met, self.taken = met, 0

    def ask(self, request: Mapping[str, Any]) -> dict[str, Any]:
        self.met.wait()
        self.taken += 1
        return {"row": empty_row(request["source"], 1, request["settings"])}


def day(folder: Path, name: str, records: int) -> Task:
    sources = tuple((f"{name}/{i}.csv", 0) for i in range(records))
    return Task(single("tower"), name, str(folder / f"{name}.parquet"), sources, "spectral", "s", 1.0)


def test_one_day_keeps_all_workers_busy_and_is_filed_once_it_is_whole(tmp_path: Path):
    met = threading.Barrier(2, timeout=30.0)
    workers, whole = [Answering(met), Answering(met)], list[bool]()
    task = day(tmp_path, "2026-03-01", 6)
    run_here([task], workers, lambda *_: whole.append(Path(task.place).exists()))
    assert [worker.taken for worker in workers] == [3, 3]
    assert whole == [False] * 5 + [True]
    assert [row["source"] for row in rows_in(Path(task.place))] == [source for source, _ in task.sources]


def test_what_was_found_is_filed_where_a_run_is_interrupted(tmp_path: Path):
    alone = Answering(threading.Barrier(1))
    tasks = [day(tmp_path, "2026-03-01", 2), day(tmp_path, "2026-03-02", 9)]
    told = []

    def tell(status: str, _: str) -> None:
        told.append(status)
        if len(told) == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_here(tasks, [alone], tell)
    assert [len(rows_in(Path(task.place))) for task in tasks] == [2, 3]

"""Who runs the tasks: threads that each speak to a worker, and a caller who hears what they say."""

import threading
from collections.abc import Callable

import pytest

from windsysid.errors import OutputError
from windsysid.fleet.engine import share
from windsysid.fleet.guard import StoppedError, Worker


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

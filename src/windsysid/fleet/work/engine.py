"""Who runs the tasks: worker processes of this machine, or a Dask scheduler of the user's.

Both take records by a guarded process (`windsysid.fleet.work.tasks.take`), so that one which hangs or kills is met in
the same way. On Dask a task has a deterministic key, a window of `TASKS_PER_WORKER` tasks a worker is submitted, and
each future is released as it completes: finished work whose future is held would be run again where its worker dies.
"""

import queue
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from typing import Any, TypeVar

from windsysid.errors import ConfigurationError, OutputError
from windsysid.fleet.rows import Row
from windsysid.fleet.work.guard import StoppedError, Worker
from windsysid.fleet.work.tasks import Filing, Task, Tell, run_task, take
from windsysid.records.formats.access.files import quiet
from windsysid.records.formats.contents.format import package

__all__ = ["run_here", "run_on_dask", "share"]

T = TypeVar("T")
Say = Callable[..., None]

TASKS_PER_WORKER = 4
"""Tasks submitted for each Dask worker: schedulers suffer beyond 100 000 tasks."""

MAX_RESUBMISSIONS = 3
"""Times that a task is given to Dask again after workers died at it; Dask itself tries four times in each."""


def share(items: Iterable[T], workers: Sequence[Worker], do: Callable[[T, Worker, Say], None], tell: Say) -> None:
    """Let workers do items, each the next one; `tell` receives the messages of `do`, in the thread of the caller.

    Where this is interrupted, or one of them fails, all workers are closed.
    """
    waiting, lock = iter(items), threading.Lock()
    said: queue.Queue[tuple[Any, ...] | BaseException | None] = queue.Queue()
    stopping = threading.Event()

    def work(worker: Worker) -> None:
        try:
            while not stopping.is_set():
                with lock:
                    item = next(waiting, None)
                if item is None:
                    break
                do(item, worker, lambda *news: said.put(news))
        except StoppedError:
            pass
        except BaseException as error:  # passed to the waiting caller
            said.put(error)
        finally:
            said.put(None)

    threads = [threading.Thread(target=work, args=(worker,)) for worker in workers]
    for thread in threads:
        thread.start()
    try:
        left = len(threads)
        while left:
            news = said.get()
            if isinstance(news, BaseException):
                raise news
            left -= news is None
            if news is not None:
                tell(*news)
    except BaseException:
        stopping.set()
        for worker in workers:
            worker.close()
        raise
    finally:
        for thread in threads:
            thread.join()


def run_here(tasks: Iterable[Task], workers: Sequence[Worker], tell: Tell) -> None:
    """Run tasks by worker processes of this machine, record by record, so that one day keeps all of them busy; the
    caller files complete ones while workers continue, and an interruption keeps what is complete."""

    def do(one: tuple[Task, str, int], worker: Worker, say: Say) -> None:
        say(one[0], take(*one, worker))

    def hear(task: Task, row: Row) -> None:
        filing.add(task, row)
        tell(row["status"], row["why"] or "")

    with closing(Filing()) as filing:
        share(((task, source, tries) for task in tasks for source, tries in task.sources), workers, do, hear)


def run_on_dask(tasks: Iterable[Task], address: str, tell: Tell) -> None:
    """Run tasks by the workers of a Dask scheduler.

    Raises
    ------
    RecordError
        If Dask is not installed.
    ConfigurationError
        If the scheduler cannot be reached.
    OutputError
        If the scheduler goes away, or workers die at a task again and again.
    """
    distributed = package("distributed", "Dask schedulers", "fleet")
    with quiet("distributed"):  # errors are reported in one line
        try:
            client = distributed.Client(address, timeout="30s")
        except (OSError, ValueError, TimeoutError) as error:
            raise ConfigurationError(f"scheduler {address}: cannot be reached ({type(error).__name__})") from None
        with client:
            for done in _on_dask(client, distributed, iter(tasks), address):
                for one in done:
                    tell(*one)


def _on_dask(client: Any, dask: Any, waiting: Iterator[Task], address: str) -> Iterator[list[tuple[str, str]]]:
    """Statuses of the records of each task."""
    given: dict[str, Task] = {}
    killed: Counter[str] = Counter()

    def submit(task: Task) -> Any:
        given[task.key] = task
        return client.submit(run_on_worker, task, key=task.key, pure=False, retries=0)

    completed = dask.as_completed()
    workers = max(len(client.scheduler_info(n_workers=-1)["workers"]), 1)
    for task, _ in zip(waiting, range(TASKS_PER_WORKER * workers), strict=False):
        completed.add(submit(task))
    gone = OutputError(f"the scheduler {address} went away: start it, and give the same command again: it goes on")
    for future in completed:
        key = future.key
        try:
            if future.status in ("cancelled", "lost"):
                raise gone
            told = future.result()
        except dask.KilledWorker:
            killed[key] += 1
            if killed[key] > MAX_RESUBMISSIONS:
                raise OutputError(f"Dask workers died again and again at {key}: look at their logs") from None
            future.release()
            completed.add(submit(given[key]))
            continue
        except (OSError, dask.CancelledError) as error:
            if isinstance(error, OutputError):
                raise
            raise gone from None
        future.release()
        del given[key]
        yield told
        following = next(waiting, None)
        if following is not None:
            completed.add(submit(following))


_own = threading.local()
"""The guarded process of each thread of a Dask worker."""


def run_on_worker(task: Task) -> list[tuple[str, str]]:
    """Task of a Dask worker: the statuses of its records."""
    if getattr(_own, "worker", None) is None:
        _own.worker = Worker(task.limit)
    _own.worker.limit = task.limit
    told: list[tuple[str, str]] = []
    run_task(task, _own.worker, lambda *one: told.append(one))
    return told

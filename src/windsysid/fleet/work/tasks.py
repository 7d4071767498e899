"""A task: the records of one turbine and day, which are filed together."""

import hashlib
import time
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

from windsysid.fleet.archive import add_rows
from windsysid.fleet.members import Member
from windsysid.fleet.paths import size_or_unknown
from windsysid.fleet.rows import Row, failed_row
from windsysid.fleet.work.guard import MAX_DEATHS, DeadWorkerError, HangingWorkerError, Worker

__all__ = ["MAX_UNFILED_SECONDS", "Filing", "Task", "Tell", "run_task", "take"]

Tell = Callable[[str, str], None]
"""Callback for each record: its status, and why it has no result."""

MAX_UNFILED_SECONDS = 120.0
"""Time after which results are filed at the latest [s]: the work that a kill loses."""


@dataclass(frozen=True)
class Task:
    """Paths and names, no content: it is sent to other machines.

    Attributes
    ----------
    member
        The turbine.
    day
        That the records are filed under.
    place
        The file of the archive.
    sources
        Paths of the records, and how often each was tried before.
    formulation, settings
        As `Member.settings` has them.
    limit
        Seconds that a record may take.
    """

    member: Member
    day: str
    place: str
    sources: tuple[tuple[str, int], ...]
    formulation: str
    settings: str
    limit: float

    @property
    def key(self) -> str:
        """Digest of the work: equal for equal work."""
        content = repr((self.place, self.sources, self.settings))
        digest = hashlib.sha256(content.encode()).hexdigest()[:12]
        return f"windsysid-{self.member.name}-{self.day}-{digest}"


class Filing:
    """Rows as they come, filed when their task is whole, or `MAX_UNFILED_SECONDS` after the first of them."""

    def __init__(self) -> None:
        self._open: dict[str, tuple[list[Row], float]] = {}
        self._left: Counter[str] = Counter()

    def add(self, task: Task, row: Row) -> None:
        """One more row of a task."""
        left = self._left.setdefault(task.place, len(task.sources)) - 1
        self._left[task.place] = left
        rows, since = self._open.setdefault(task.place, ([], time.monotonic()))
        rows.append(row)
        if not left or time.monotonic() - since > MAX_UNFILED_SECONDS:
            self._file(task.place)

    def close(self) -> None:
        """File the results so far, where the work ended between two records."""
        for place in tuple(self._open):
            self._file(place)

    def _file(self, place: str) -> None:
        rows, _ = self._open.pop(place)
        add_rows(Path(place), rows)


def run_task(task: Task, worker: Worker, tell: Tell) -> None:
    """Take the records of a task by one worker and file them; `tell` receives the status of each, and why it has no
    result.

    What was found is filed also where the worker is stopped between two records.
    """
    with closing(Filing()) as filing:
        for source, tries in task.sources:
            row = take(task, source, tries, worker)
            filing.add(task, row)
            tell(row["status"], row["why"] or "")


def take(task: Task, source: str, tries: int, worker: Worker) -> Row:
    """The row of a record of a task, which was tried so often before."""
    row = _ask(task, source, worker)
    return row | {"tries": row["tries"] + tries} if row["status"] == "failed" else row


def _ask(task: Task, source: str, worker: Worker) -> Row:
    """The row of a record; one that a worker hangs at, or dies at again and again, is left alone."""
    request = {
        "do": "take", "source": source, "member": asdict(task.member), "formulation": task.formulation,
        "settings": task.settings,
    }  # fmt: skip
    why = ""
    for _ in range(MAX_DEATHS):
        try:
            row: Row = worker.ask(request)["row"]
            return row
        except HangingWorkerError as error:
            why = str(error)
            break
        except DeadWorkerError as error:
            why = f"{error}, {MAX_DEATHS} times"
    return failed_row(source, size_or_unknown(source), task.settings, why)

"""A task: the records of one turbine and day, taken one after the other and filed together."""

import hashlib
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from windsysid.fleet.archive import add_rows
from windsysid.fleet.guard import DEATHS, DeadWorkerError, HangingWorkerError, Worker
from windsysid.fleet.members import Member
from windsysid.fleet.remote import size_of
from windsysid.fleet.rows import Row, failed_row

__all__ = ["FLUSH_SECONDS", "Task", "Tell", "run_task"]

Tell = Callable[[str, str], None]
"""Hears of each record: its status, and why it has no result."""

FLUSH_SECONDS = 120.0
"""What was found is filed at least this often: so much work is lost where everything is killed."""


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
        """The same for the same work."""
        content = repr((self.place, self.sources, self.settings))
        digest = hashlib.sha256(content.encode()).hexdigest()[:12]
        return f"windsysid-{self.member.name}-{self.day}-{digest}"


def run_task(task: Task, worker: Worker, tell: Tell) -> None:
    """Take the records of a task and file them; `tell` is told the status of each, and why it has no result.

    What was found is filed also where the worker is stopped between two records.
    """
    rows: list[Row] = []
    filed = time.monotonic()
    try:
        for source, tries in task.sources:
            row = _take(task, source, worker)
            rows.append(row | {"tries": row["tries"] + tries} if row["status"] == "failed" else row)
            tell(row["status"], row["why"] or "")
            if time.monotonic() - filed > FLUSH_SECONDS:
                add_rows(Path(task.place), rows)
                rows, filed = [], time.monotonic()
    finally:
        if rows:
            add_rows(Path(task.place), rows)


def _take(task: Task, source: str, worker: Worker) -> Row:
    """The row of a record; one that a worker hangs at, or dies at again and again, is left alone."""
    request = {
        "do": "take", "source": source, "member": asdict(task.member), "formulation": task.formulation,
        "settings": task.settings,
    }  # fmt: skip
    why = ""
    for _ in range(DEATHS):
        try:
            row: Row = worker.ask(request)["row"]
            return row
        except HangingWorkerError as error:
            why = str(error)
            break
        except DeadWorkerError as error:
            why = f"{error}, {DEATHS} times"
    try:
        size = size_of(source)
    except OSError:
        size = -1
    return failed_row(source, size, task.settings, why)

"""A store in a database of SQL: one thread that writes, and readers that come and go."""

import json
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from typing import Any, NamedTuple

from windsysid.errors import StoreError
from windsysid.live.blocks.block import Block
from windsysid.live.store import statements as sql
from windsysid.live.store.batch import CommitBatch, PreparedCommit, prepare
from windsysid.live.store.contents import Alarm, Commit, Event, Result, SensorHealth, SeriesLevel, Status
from windsysid.live.store.database import Database
from windsysid.live.store.encoding import block_of, levels_of, pack_text, row_of, spectra_of
from windsysid.live.store.keep import DAY, Keep, span
from windsysid.live.store.store import ContentError

__all__ = ["SqlStore"]

MAX_COMMITS_PER_TRANSACTION = 1000
"""Commits of one transaction."""

GATHER_SECONDS, MIN_GATHER_RATE = 0.05, 200.0
"""Time for which commits are gathered [s] where more than so many a second are submitted: a transaction costs more than
a block (`python -m benchmarks.live_store`), and a commit may wait for a second."""

MIN_PAUSE_SECONDS, MAX_PAUSE_SECONDS = 0.05, 2.0
"""Between attempts while the database refuses, doubled from the first to the second [s]."""

MAX_COMMIT_SECONDS = 5.0
"""Time for writing a commit [s] beyond which `SqlStore.trouble` reports it."""

ROWS_PER_DELETION = 1000
"""Rows that thinning takes away in one transaction, so that commits need not wait for it."""

MIN_TIME_NS, MAX_TIME_NS = -(2**63), 2**63 - 1
MAX_ROWS = 10**9


class _Job(NamedTuple):
    """Job of the writer: a commit, or a call with its connection."""

    done: "Future[Any]"
    work: "PreparedCommit | Callable[[Any], Any]"


class SqlStore:
    """Implementation of `windsysid.live.store.Store` in a database.

    While the database refuses to write for a reason that may pass (the disk is full, the server restarts), what was
    submitted waits, `trouble` says why, and the store tries again. After anything else the future has the error.

    Parameters
    ----------
    database
        An open one.
    keep
        What `thin` leaves.
    read_only
        No writer: what would write raises StoreError.
    """

    def __init__(self, database: Database, keep: Keep, *, read_only: bool = False) -> None:
        self._database = database
        self._keep = keep
        self._trouble = ""
        self._since: float | None = None
        self._jobs: deque[_Job] = deque()
        self._changed = threading.Condition()
        self._closing = read_only
        self._connection: Any = None
        self._event = self.last_event()
        self._writer = threading.Thread(target=self._run, name="store", daemon=True)
        if not read_only:
            self._writer.start()

    # writing

    @property
    def trouble(self) -> str:
        """Reason why nothing can be written now; empty if writing works."""
        since = self._since
        waited = 0.0 if since is None else time.monotonic() - since
        if self._trouble or waited < MAX_COMMIT_SECONDS:
            return self._trouble
        return f"{self._database.name} cannot be written: a commit has waited for {waited:.0f} s"

    def submit(self, commit: Commit) -> "Future[None]":
        """Queue a commit; the future ends when it is on disk. Its callbacks run in the writer: they must not wait."""
        return self._queue(prepare(commit))

    def _queue(self, work: "PreparedCommit | Callable[[Any], Any]") -> "Future[Any]":
        done: Future[Any] = Future()
        done.set_running_or_notify_cancel()  # what is queued is written and never cancelled
        with self._changed:
            if self._closing:
                raise StoreError(f"{self._database.name} is closed, or open for reading only")
            self._jobs.append(_Job(done, work))
            self._changed.notify()
        return done

    def close(self) -> None:
        """Write the queue and end. If it cannot be written, a StoreError is raised."""
        with self._changed:
            self._closing = True
            self._changed.notify()
        if self._writer.is_alive():
            self._writer.join()
        self._database.release()

    def _run(self) -> None:
        """The writer thread: all waiting entries form one transaction."""
        begun, written, rate = time.monotonic(), 0, 0.0
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._jobs or self._closing)
            now = time.monotonic()
            if now > begun + 1.0:
                begun, written, rate = now, 0, written / (now - begun)
            if rate > MIN_GATHER_RATE and not self._closing:
                time.sleep(GATHER_SECONDS)
            jobs = self._next_jobs()
            if not jobs:
                break
            self._write(jobs)
            written += len(jobs)
        self._disconnect()

    def _next_jobs(self) -> list[_Job]:
        """Jobs of the next transaction: a call alone, or commits; none when the store closes."""
        with self._changed:
            jobs = [self._jobs.popleft()] if self._jobs else []
            while (
                self._jobs
                and len(jobs) < MAX_COMMITS_PER_TRANSACTION
                and isinstance(jobs[0].work, PreparedCommit)
                and isinstance(self._jobs[0].work, PreparedCommit)
            ):
                jobs.append(self._jobs.popleft())
        return jobs

    def _write(self, jobs: Sequence[_Job]) -> None:
        """Write jobs, and record when the writer began, for `trouble`."""
        self._since = time.monotonic()
        self._attempt(jobs)
        self._since = None

    def _attempt(self, jobs: Sequence[_Job]) -> None:
        """Write jobs as one transaction, now or as soon as the database takes it."""
        pause = MIN_PAUSE_SECONDS
        while True:
            try:
                values = self._transact([job.work for job in jobs])
                break
            except Exception as error:  # also what a driver raises that is none of its own errors
                self._disconnect()
                if not self._passes(error):
                    return self._refuse(jobs, error)
                if not self._wait(error, pause):
                    return self._fail(jobs, error)
                pause = min(2 * pause, MAX_PAUSE_SECONDS)
        if self._trouble:
            logging.getLogger("windsysid").warning("%s can be written again", self._database.name)
            self._trouble = ""
        for job, value in zip(jobs, values, strict=True):
            job.done.set_result(value)
        return None

    def _passes(self, error: Exception) -> bool:
        """Check whether an error is temporary; a `StoreError` is that of another service during a restart."""
        database = self._database
        return isinstance(error, StoreError) or (isinstance(error, database.errors) and database.passes(error))

    def _refuse(self, jobs: Sequence[_Job], error: Exception) -> None:
        """Write jobs one by one, since one of them is wrong, not all; fail the one that is."""
        if len(jobs) == 1:
            return self._fail(jobs, error)
        for job in jobs:
            self._attempt([job])
        return None

    def _transact(self, works: Sequence["PreparedCommit | Callable[[Any], Any]"]) -> list[Any]:
        if self._connection is None:
            self._connection = self._database.connect()
        connection = self._connection
        connection.execute(self._database.begin)
        values: list[Any] = [None]
        if isinstance(works[0], PreparedCommit):
            batch = CommitBatch([work for work in works if isinstance(work, PreparedCommit)], self._event)
            self._event = batch.event
            cursor = connection.cursor()
            for statement, rows in batch.statements():
                cursor.executemany(self._database.sql(statement), rows)
            values = [None] * len(works)
        else:
            values = [works[0](connection)]
        connection.execute(f"UPDATE windsysid_store SET last_event = {self._event}")
        connection.execute("COMMIT")
        return values

    def _wait(self, error: Exception, pause: float) -> bool:
        """Wait before the next attempt; False where the store is being closed."""
        trouble = f"{self._database.name} cannot be written: {self._database.explain(error)}"
        if not self._trouble:
            logging.getLogger("windsysid").warning("%s; new blocks wait", trouble)
        self._trouble = trouble
        with self._changed:
            return not self._changed.wait_for(lambda: self._closing, pause)

    def _fail(self, jobs: Sequence[_Job], error: Exception) -> None:
        why = f"{self._database.name} cannot be written: {self._database.explain(error)}"
        of_content = isinstance(error, (self._database.content_errors, ValueError, TypeError, OverflowError))
        if not of_content:
            self._trouble = why
        for job in jobs:
            job.done.set_exception(ContentError(why) if of_content else StoreError(why))

    def _disconnect(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            try:
                connection.rollback()  # an SQLite connection that statements still refer to would keep its lock
                connection.close()
            except self._database.errors:
                logging.getLogger("windsysid").debug("%s: its connection was lost", self._database.name)

    def configure(self, turbine: str, settings: str, tables: dict[str, Any]) -> None:
        """Write down by which settings a turbine is followed from now on; nothing where they are as they were."""
        text = pack_text(tables)

        def write(connection: Any) -> None:
            newest = self._rows(
                connection, "SELECT settings, at FROM configurations WHERE turbine = ? ORDER BY at DESC LIMIT 1",
                (turbine,),
            )  # fmt: skip
            if newest and newest[0][0] == settings:
                return
            at = max(time.time_ns(), newest[0][1] + 1 if newest else 0)
            connection.execute(self._database.sql(sql.CONFIGURATION), (turbine, at, settings, text))

        self._queue(write).result()

    def acknowledge(self, key: str, *, by: str, remark: str = "", at: int) -> Alarm:
        """Acknowledge an alarm; KeyError if there is none of this key. Acknowledging again changes nothing."""

        def write(connection: Any) -> None:
            self._event += 1
            connection.execute(
                self._database.sql(
                    "UPDATE alarms SET acknowledged = ?, acknowledged_by = ?, remark = ?, event = ?"
                    " WHERE key = ? AND acknowledged IS NULL"
                ),
                (at, by, remark, self._event, key),
            )

        self._queue(write).result()
        found = self._read(f"SELECT {ALARM_COLUMNS} FROM alarms WHERE key = ?", (key,))
        if not found:
            raise KeyError(key)
        return Alarm(*found[0])

    def tell(self, recipient: str, event: int) -> None:
        """Record the last event of which a recipient was notified."""
        self._change(sql.TOLD, (recipient, event))

    # reading

    def _rows(self, connection: Any, statement: str, values: Sequence[Any]) -> list[Any]:
        rows: list[Any] = connection.execute(self._database.sql(statement), values).fetchall()
        return rows

    def _read(self, statement: str, values: Sequence[Any] = ()) -> list[Any]:
        """All rows; read once more if the connection was lost."""
        for last in (False, True):
            try:
                with self._database.reader() as connection:
                    return self._rows(connection, statement, values)
            except self._database.errors as error:
                if last or not self._database.passes(error):
                    raise StoreError(f"{self._database.name} cannot be read: {self._database.explain(error)}") from None
        raise AssertionError

    def waiting(self, turbine: str, window: int | None = None) -> Iterator[tuple[int, Block]]:
        """Start of the window and block, of those whose window has no result yet, by window, stream and sequence."""
        found = self._read(
            "SELECT window_start, turbine, stream, sequence, start, rate, channels, units, dtype, content FROM blocks"
            " WHERE turbine = ? AND window_start BETWEEN ? AND ?",
            (turbine, MIN_TIME_NS if window is None else window, MAX_TIME_NS if window is None else window),
        )
        found.sort(key=lambda row: (row[0], row[2], row[3]))  # databases differ in how they order text
        return ((window, block_of(columns)) for window, *columns in found)

    def checkpoint(self, turbine: str) -> tuple[int, bytes] | None:
        """The newest result's `until` and checkpoint."""
        found = self._read("SELECT window_end, content FROM checkpoints WHERE turbine = ?", (turbine,))
        return (found[0][0], bytes(found[0][1])) if found else None

    def told(self, recipient: str) -> int | None:
        """Last event of which a recipient was notified; None if there is none."""
        found = self._read("SELECT event FROM recipients WHERE name = ?", (recipient,))
        return int(found[0][0]) if found else None

    def configurations(self, turbine: str) -> list[dict[str, Any]]:
        """``at``, ``settings`` and ``tables`` of every configuration, the newest first."""
        found = self._read(
            "SELECT at, settings, tables FROM configurations WHERE turbine = ? ORDER BY at DESC", (turbine,)
        )
        return [{"at": at, "settings": settings, "tables": json.loads(tables)} for at, settings, tables in found]

    def turbines(self) -> list[str]:
        """Names of those that were configured or that something came of, in order."""
        found = self._read(
            "SELECT turbine FROM configurations UNION SELECT turbine FROM statuses"
            " UNION SELECT turbine FROM checkpoints"
        )
        return sorted(row[0] for row in found)

    def statuses(self) -> list[Status]:
        """One of every turbine."""
        found = self._read(
            "SELECT turbine, sequences, stream, received, state, rotor_speed, counts FROM statuses ORDER BY turbine"
        )
        return [
            Status(turbine, json.loads(sequences), stream, received, state, rotor_speed, json.loads(counts))
            for turbine, sequences, stream, received, state, rotor_speed, counts in found
        ]

    def healths(self, turbine: str | None = None) -> list[SensorHealth]:
        """One of every channel."""
        found = self._read(
            "SELECT turbine, channel, state, since, text FROM healths WHERE turbine = coalesce(?, turbine)"
            " ORDER BY turbine, channel",
            (turbine,),
        )
        return [SensorHealth(*columns) for columns in found]

    def results(
        self,
        turbine: str,
        *,
        since: int | None = None,
        until: int | None = None,
        newest: int | None = None,
        most: int | None = None,
    ) -> list[Result]:
        """Of windows that begin at `since` or later and before `until`, in order of time; checkpoints are empty."""
        windows, values = self._windows("results", turbine, since, until, most)
        found = self._read(
            sql.RESULTS_OF.format(windows=windows), (turbine, *values, MAX_ROWS if newest is None else newest)
        )
        return [
            Result(turbine, start, end, closed, row_of(row), levels_of(levels) if levels else [], b"")
            for start, end, closed, row, levels in reversed(found)
        ]

    def levels(
        self, turbine: str, *, since: int | None = None, until: int | None = None, most: int = 2000
    ) -> list[tuple[int, SeriesLevel]]:
        """Start of the window and level, in order of time; of more than `most` windows, every so manieth."""
        windows, values = self._windows("levels", turbine, since, until, most)
        found = self._read(sql.LEVELS_OF.format(windows=windows), (turbine, *values))
        return [(window, level) for window, content in found for level in levels_of(content)]

    def spectra(
        self, turbine: str, *, since: int | None = None, until: int | None = None, most: int = 500
    ) -> list[tuple[int, list[dict[str, Any]]]]:
        """Start of the window and plots, in order of time; of more than `most` windows, every so manieth."""
        windows, values = self._windows("spectra", turbine, since, until, most)
        found = self._read(sql.SPECTRA_OF.format(windows=windows), (turbine, *values))
        return [(window, spectra_of(content)) for window, content in found]

    def extent(self, turbine: str) -> tuple[int, int] | None:
        """Starts of the first and of the newest window that a turbine has something of; None where it has nothing."""
        [(first, newest)] = self._read(
            "SELECT min(first), max(newest) FROM ("
            "SELECT min(window_start) AS first, max(window_start) AS newest FROM levels WHERE turbine = ?"
            " UNION ALL SELECT min(window_start), max(window_start) FROM results WHERE turbine = ?) AS both_tables",
            (turbine, turbine),
        )
        return None if first is None else (first, newest)

    def _windows(
        self, table: str, turbine: str, since: int | None, until: int | None, most: int | None
    ) -> tuple[str, tuple[Any, ...]]:
        """A condition for windows of a turbine, and its values."""
        between = (MIN_TIME_NS if since is None else since, MAX_TIME_NS if until is None else until)
        if most is None:
            return "window_start BETWEEN ? AND ? - 1", between
        return f"window_start IN ({sql.EVERY_SO_MANIETH.format(table=table)})", (turbine, *between, most, most)

    def alarms(self, *, turbine: str | None = None, open_only: bool = False, most: int = 500) -> list[Alarm]:
        """The newest first."""
        found = self._read(
            f"SELECT {ALARM_COLUMNS} FROM alarms WHERE turbine = coalesce(?, turbine)"
            f" {'AND ended IS NULL' if open_only else ''} ORDER BY opened DESC, key LIMIT ?",
            (turbine, most),
        )
        return [Alarm(*columns) for columns in found]

    def events(self, after: int, *, most: int = 500) -> list[Event]:
        """Those with a higher id, in order; of a row that changed several times, the last."""
        return [Event(*columns) for columns in self._read(sql.EVENTS, (after, after, after, after, most, most))]

    def last_event(self) -> int:
        """The highest id; 0 where there is none."""
        return int(self._read("SELECT last_event FROM windsysid_store")[0][0])

    # housekeeping

    def thin(self, *, now: int) -> None:
        """Delete data older than their retention time, in slices between which commits are written."""
        keep = self._keep
        results, levels, alarms, spectra = map(span, (keep.results, keep.levels, keep.alarms, keep.spectra))
        for turbine in self.turbines():
            if results is not None:
                self._thin_results(turbine, now - results)
            if levels is not None:
                cut = max(now - levels, 0)
                self._change(sql.THIN_LEVELS, (turbine, cut, cut, DAY, DAY))
        if spectra is not None:
            self._change("DELETE FROM spectra WHERE window_start < ?", (max(now - spectra, 0),))
        if alarms is not None:
            self._change("DELETE FROM alarms WHERE ended < ?", (max(now - alarms, 0),))
        self._queue(self._database.tidy).result()

    def _thin_results(self, turbine: str, before: int) -> None:
        before = max(before, 0)
        while True:
            later = self._read(
                "SELECT window_start FROM results WHERE turbine = ? AND window_start < ?"
                " ORDER BY window_start LIMIT 1 OFFSET ?",
                (turbine, before, ROWS_PER_DELETION),
            )
            cut = later[0][0] if later else before
            self._change("DELETE FROM results WHERE turbine = ? AND window_start < ?", (turbine, cut))
            if not later:
                return

    def _change(self, statement: str, values: Sequence[Any]) -> None:
        self._queue(lambda connection: connection.execute(self._database.sql(statement), values) and None).result()

    def size(self) -> dict[str, int]:
        """Rows of every table, and ``bytes``."""
        counts = {table: int(self._read(f"SELECT count(*) FROM {table}")[0][0]) for table in TABLES}
        with self._database.reader() as connection:
            return counts | {"bytes": self._database.bytes(connection)}


ALARM_COLUMNS = (
    "key, turbine, kind, severity, about, opened, earliest, latest, ended, text, acknowledged, acknowledged_by, remark"
)
TABLES = ("configurations", "blocks", "statuses", "healths", "results", "levels", "spectra", "checkpoints", "alarms")

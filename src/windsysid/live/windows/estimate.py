"""Estimation of a window's record, in a worker process or in this one.

The row is the one that `windsysid batch` gives of a file with the same samples (`windsysid.fleet.rows.row_of`), bit for
bit. A worker that dies is started again and the window tried again; one that hangs is ended. What cannot be estimated
is a row that says why.
"""

import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import NamedTuple, Protocol

from windsysid.fleet.members import Member
from windsysid.fleet.rows import Row, empty_row, failed_row
from windsysid.fleet.work.guard import MAX_DEATHS, DeadWorkerError, HangingWorkerError, Worker
from windsysid.fleet.work.worker import pack_samples, take_samples
from windsysid.kernels.threads import usable_processors
from windsysid.live.windows.timeline import Gathered
from windsysid.results.serialization import finite

__all__ = ["MAX_WINDOW_SECONDS", "Estimated", "Estimator", "Here", "InWorker", "estimators"]

MAX_WINDOW_SECONDS = 600.0
"""Time that a window may take before its worker counts as hanging."""


class Estimated(NamedTuple):
    """A window's row, the processor time that it took [s], and plots of its spectra as JSON."""

    row: Row
    seconds: float
    spectra: Sequence[str] = ()


class Estimator(Protocol):
    """Estimator of windows, one after the other."""

    def take(self, gathered: Gathered, source: str, member: Member, formulation: str, settings: str) -> Estimated:
        """The row of a window, whatever happens."""

    @property
    def compiling(self) -> bool:
        """True while a turbine's equations are being compiled, which takes minutes the first time on a machine."""

    def close(self) -> None:
        """End the current work: `take` raises `windsysid.fleet.work.guard.StoppedError`."""


class Here:
    """Windows taken in the caller's thread: for tests, and where a process is too much."""

    compiling = False

    def take(self, gathered: Gathered, source: str, member: Member, formulation: str, settings: str) -> Estimated:
        """The row of a window, whatever happens."""
        if gathered.record is None:
            return Estimated(_too_short(source, settings), 0.0)
        begun = time.thread_time()
        request = pack_samples(gathered.record, gathered.rate)
        row, spectra = take_samples(request, member, formulation, settings, lambda _: None)
        return Estimated(finite(row), time.thread_time() - begun, spectra)

    def close(self) -> None:
        """There is nothing to end."""


class InWorker:
    """Windows taken in a process of their own, which may hang or die.

    Parameters
    ----------
    limit
        Seconds that a window may take.
    """

    def __init__(self, limit: float = MAX_WINDOW_SECONDS) -> None:
        self._worker = Worker(limit)

    @property
    def compiling(self) -> bool:
        """True while a turbine's equations are being compiled."""
        return self._worker.compiling

    def take(self, gathered: Gathered, source: str, member: Member, formulation: str, settings: str) -> Estimated:
        """The row of a window, whatever happens."""
        if gathered.record is None:
            return Estimated(_too_short(source, settings), 0.0)
        asked = {"member": asdict(member), "formulation": formulation, "settings": settings}
        request = pack_samples(gathered.record, gathered.rate) | asked
        why = ""
        for _ in range(MAX_DEATHS):
            try:
                answer = self._worker.ask(request)
                return Estimated(answer["row"], answer["seconds"], answer["spectra"])
            except HangingWorkerError as error:
                why = str(error)
                break
            except DeadWorkerError as error:
                why = f"{error}, {MAX_DEATHS} times"
        return Estimated(failed_row(source, gathered.record.values.nbytes, settings, why), 0.0)

    def close(self) -> None:
        """End the process, whatever it does."""
        self._worker.close()


def estimators(workers: int | None) -> list[Estimator]:
    """One for each window that is taken at once: as many as processors by default, one in this process for 0."""
    if workers == 0:
        return [Here()]
    return [InWorker() for _ in range(workers or len(usable_processors()))]


def _too_short(source: str, settings: str) -> Row:
    why = "the window holds fewer than 2 samples: expected a record"
    return empty_row(source, 0, settings) | {"status": "refused", "why": why}

"""A worker process under guard: a hanging one is ended, a dead one is restarted, and both are reported.

Foreign files can make a library hang or crash (HDF5 does), and an out-of-memory killer gives no warning. So records
are opened in a process of their own, one after the other. The process is a fresh interpreter with one thread and
receives everything as text: nothing is forked, so that threads and libraries of the caller do not matter.
"""

import contextlib
import json
import os
import queue
import subprocess
import sys
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import windsysid
from windsysid.errors import OutputError

__all__ = ["MAX_DEATHS", "DeadWorkerError", "HangingWorkerError", "StoppedError", "Worker"]

MAX_DEATHS = 3
"""Times that a worker may die at a record before the record is left alone: others may have killed it."""

MAX_FAILED_STARTS = 5
"""Times in a row that a worker may die before it is ready."""

READY_SECONDS = 300.0
"""A worker that is not ready by then never will be."""

COMPILE_FACTOR = 3.0
"""Factor on the limit of a first record, whose model may have to be compiled."""

_THREADS = ("OPENBLAS", "OMP", "MKL", "NUMBA", "VECLIB_MAXIMUM", "NUMEXPR")


class DeadWorkerError(Exception):
    """The process ended by itself or was killed; the text says how."""


class HangingWorkerError(Exception):
    """The process gave no answer in time, and was ended."""


class StoppedError(Exception):
    """The process was ended by `Worker.close`."""


class Worker:
    """One worker process; started when it is first asked, and again after it died.

    Parameters
    ----------
    limit
        Seconds that an answer may take.
    """

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.compiling = False  # for the first time in this process: seconds, or minutes where nothing is cached
        self._stopped = threading.Event()
        self._process: subprocess.Popen[str] | None = None
        self._answers: queue.Queue[str | None] = queue.Queue()

    def ask(self, request: Mapping[str, Any]) -> dict[str, Any]:
        """The answer to a request.

        Raises
        ------
        DeadWorkerError, HangingWorkerError
            If there is none; the next request meets a new process.
        StoppedError
            If `close` was called.
        OutputError
            If no worker can be started.
        """
        process = self._running()
        try:
            assert process.stdin is not None
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
        except OSError:
            raise self._ended() from None
        limit: float | None = self.limit
        while True:
            answer = self._next(limit)
            if answer is None:
                self.compiling = False
                raise self._ended()
            event = answer.pop("event")
            self.compiling = event == "compiling"
            if event == "done":
                return answer
            limit = None if event == "waiting" else COMPILE_FACTOR * self.limit

    def close(self) -> None:
        """End the process, whatever it does, for good; may be called from another thread."""
        self._stopped.set()
        self._kill()

    def _running(self) -> "subprocess.Popen[str]":
        """The process, ready."""
        for _ in range(MAX_FAILED_STARTS):
            if self._stopped.is_set():
                raise StoppedError
            if self._process is not None and self._process.poll() is None:
                return self._process
            self._start()
            with contextlib.suppress(HangingWorkerError):
                if self._next(READY_SECONDS) is not None and not self._stopped.is_set() and self._process is not None:
                    return self._process
            self._kill()
        raise OutputError(
            f"workers end before they are ready ({MAX_FAILED_STARTS} times): try windsysid identify on one record"
        )

    def _start(self) -> None:
        source = str(Path(windsysid.__file__).parents[1])
        paths = [source, *filter(None, [os.environ.get("PYTHONPATH")])]
        threads = {f"{name}_NUM_THREADS": "1" for name in _THREADS}
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "windsysid.fleet.work.worker"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, encoding="utf-8",
            env={**os.environ, **threads, "PYTHONPATH": os.pathsep.join(paths)},
            start_new_session=True,  # Ctrl-C is for whoever started the run, who ends it in order
        )  # fmt: skip
        self._answers = queue.Queue()
        threading.Thread(target=_listen, args=(self._process, self._answers), daemon=True).start()

    def _next(self, seconds: float | None) -> dict[str, Any] | None:
        """Next message of the process; None if it ended."""
        try:
            line = self._answers.get(timeout=seconds)
        except queue.Empty:
            self._kill()
            raise HangingWorkerError(f"did not finish within {seconds:g} s and was ended") from None
        if line is None or not line.endswith("\n"):
            return None
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _ended(self) -> Exception:
        process, code = self._process, 0
        if process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                code = process.wait(timeout=1.0)
        self._kill()
        if self._stopped.is_set():
            return StoppedError()
        return DeadWorkerError(
            f"ended its process by signal {-code}" if code < 0 else f"ended its process with code {code}"
        )

    def _kill(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            with contextlib.suppress(OSError):
                if process.stdin is not None:
                    process.stdin.close()


def _listen(process: "subprocess.Popen[str]", answers: "queue.Queue[str | None]") -> None:
    """Pass on the messages of a process, and its end."""
    assert process.stdout is not None
    with contextlib.suppress(OSError, ValueError), process.stdout:
        for line in process.stdout:
            answers.put(line)
    answers.put(None)

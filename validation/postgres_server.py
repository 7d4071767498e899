"""A PostgreSQL server of one's own, in a temporary folder, reached through a socket in it.

By default it flushes nothing to the disk: processes are killed here, machines are not.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["MissingServerError", "Server", "postgres"]

PLACES = sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
USER = "postgres" if hasattr(os, "geteuid") and os.geteuid() == 0 else None  # the server refuses to run as root


class MissingServerError(Exception):
    """No PostgreSQL server is installed."""


def _program(name: str) -> str | None:
    return shutil.which(name, path=os.pathsep.join([os.environ.get("PATH", ""), *map(str, PLACES)]))


def _lives(process: int) -> bool:
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


class Server:
    """A server, which may be stopped as a power cut does and started again."""

    def __init__(self, folder: Path, flush: bool) -> None:
        self.folder, self._flush = folder, flush
        self.url = f"postgresql://postgres@/postgres?host={folder}"
        self._run(
            "initdb", "-D", "data", "-U", "postgres", "-A", "trust", "-E", "UTF8", "--no-sync", "--locale=C.UTF-8"
        )

    def _run(self, name: str, *arguments: str) -> None:
        found = _program(name)
        assert found
        as_user = ["runuser", "-u", USER, "--"] if USER else []
        subprocess.run([*as_user, found, *arguments], cwd=self.folder, check=True, stdout=subprocess.DEVNULL)

    def start(self) -> None:
        """Start it, and wait until it answers."""
        options = f"-c listen_addresses='' -k {self.folder} -c shared_buffers=16MB -c fsync={self._flush}"
        self._run("pg_ctl", "-D", "data", "-w", "-t", "120", "-l", "log", "-o", options, "start")

    def kill(self) -> None:
        """No message, nothing written: every process of the server is killed."""
        lock = self.folder / "data" / "postmaster.pid"
        postmaster = int(lock.read_text().split()[0])
        workers = Path(f"/proc/{postmaster}/task/{postmaster}/children").read_text().split()
        processes = [postmaster, *map(int, workers)]
        for process in processes:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        deadline = time.monotonic() + 60
        while any(_lives(process) for process in processes) and time.monotonic() < deadline:
            time.sleep(0.01)
        lock.unlink()  # where the dead server was not collected, the next one would take it for alive
        for left in self.folder.glob(".s.PGSQL.*"):
            left.unlink()

    def stop(self) -> None:
        """End it at once."""
        self._run("pg_ctl", "-D", "data", "-m", "immediate", "-w", "stop")

    def emptied(self) -> str:
        """The URL of a database in which no store is."""
        import psycopg

        with psycopg.connect(self.url, autocommit=True) as connection:
            connection.execute("DROP SCHEMA IF EXISTS windsysid CASCADE")
        return self.url


@contextmanager
def postgres(*, flush: bool = False) -> Iterator[Server]:
    """A server that runs; MissingServerError where none is installed."""
    if _program("initdb") is None or (USER and shutil.which("runuser") is None):
        raise MissingServerError("no PostgreSQL server is installed")
    with tempfile.TemporaryDirectory(prefix="windsysid-postgres-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        if USER:
            shutil.chown(folder, USER)
        server = Server(folder, flush)
        server.start()
        try:
            yield server
        finally:
            server.stop()

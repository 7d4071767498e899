"""Protocol of stores: `windsysid.live.store.open_store` opens one by its URL."""

from collections.abc import Iterator
from concurrent.futures import Future
from typing import Any, Protocol

from windsysid.errors import StoreError
from windsysid.live.blocks.block import Block
from windsysid.live.store.contents import Alarm, Commit, Event, Result, SensorHealth, SeriesLevel, Status

__all__ = ["ContentError", "Store"]


class ContentError(StoreError):
    """A commit whose content this database cannot hold: a retry would fail too, other commits are not affected."""


class Store(Protocol):
    """One writer thread, many short-lived readers; methods may be called from any thread.

    Raises
    ------
    StoreError
        From every method, where the database refuses: one line, without the URL's password.
    """

    @property
    def trouble(self) -> str:
        """Reason why nothing can be written now, in one line; empty if writing works.

        While the disk is full or the database restarts, what was submitted waits. It is empty again after the first
        commit that is written.
        """

    def submit(self, commit: Commit) -> Future[None]:
        """Queue a commit; the future ends when it is on disk. Its callbacks run in the writer: they must not wait.

        The future has a ContentError where the commit can never be written, another StoreError where the store fails.
        Several that wait are one transaction, in their order. What is there already (block, result) is left as it is,
        so that a commit may come again. A result takes the blocks of its window away.
        """

    def close(self) -> None:
        """Write the queue and end."""

    # what the engine asks at its start

    def waiting(self, turbine: str, window: int | None = None) -> Iterator[tuple[int, Block]]:
        """Blocks whose window has no result yet, by window, stream and sequence; of one window where it is given."""

    def checkpoint(self, turbine: str) -> tuple[int, bytes] | None:
        """The newest result's `until` and checkpoint."""

    def configure(self, turbine: str, settings: str, tables: dict[str, Any]) -> None:
        """Write down by which settings (a hash, and the tables behind it) a turbine is followed from now on."""

    # what notices of alarms ask

    def told(self, recipient: str) -> int | None:
        """Last event of which a recipient was notified; None if there is none."""

    def tell(self, recipient: str, event: int) -> None:
        """Record the last event of which a recipient was notified."""

    # what pages and exports ask

    def configurations(self, turbine: str) -> list[dict[str, Any]]:
        """``at``, ``settings`` and ``tables`` of every configuration, the newest first."""

    def turbines(self) -> list[str]:
        """Names, in order."""

    def statuses(self) -> list[Status]:
        """One of every turbine."""

    def healths(self, turbine: str | None = None) -> list[SensorHealth]:
        """One of every channel."""

    def results(
        self,
        turbine: str,
        *,
        since: int | None = None,
        until: int | None = None,
        newest: int | None = None,
        most: int | None = None,
    ) -> list[Result]:
        """In order of time; checkpoints are empty. Of more than `most` windows, every so manieth, as of `levels`."""

    def levels(
        self, turbine: str, *, since: int | None = None, until: int | None = None, most: int = 2000
    ) -> list[tuple[int, SeriesLevel]]:
        """Start of the window and level, in order of time; of more than `most` windows, every so manieth."""

    def spectra(
        self, turbine: str, *, since: int | None = None, until: int | None = None, most: int = 500
    ) -> list[tuple[int, list[dict[str, Any]]]]:
        """Start of the window and plots of its spectra, of the last window of each hour; selected as in `levels`."""

    def alarms(self, *, turbine: str | None = None, open_only: bool = False, most: int = 500) -> list[Alarm]:
        """The newest first."""

    def acknowledge(self, key: str, *, by: str, remark: str = "", at: int) -> Alarm:
        """Acknowledge an alarm; KeyError if there is none of this key. Acknowledging again changes nothing."""

    def events(self, after: int, *, most: int = 500) -> list[Event]:
        """Those with a higher id, in order."""

    def last_event(self) -> int:
        """The highest id; 0 where there is none."""

    def thin(self, *, now: int) -> None:
        """Delete or thin data older than their retention time."""

    def size(self) -> dict[str, int]:
        """Rows of every table, and ``bytes``."""

"""Cache of the newest result of every turbine."""

import threading
from collections.abc import Iterable

from windsysid.live.store.contents import Result
from windsysid.live.store.store import Store

__all__ = ["Newest"]

MAX_EVENTS = 5000
"""Setting: events that are checked for new results; after more, all results are read again."""


class Newest:
    """A row has some 10 kB: an overview of 1000 turbines reads those that changed only."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._lock = threading.Lock()
        self._results: dict[str, Result | None] = {}
        self._event = 0

    def of(self, turbines: Iterable[str]) -> dict[str, Result | None]:
        """The newest results; None where a turbine has none yet."""
        with self._lock:
            self._forget_changed()
            for turbine in turbines:
                if turbine not in self._results:
                    self._results[turbine] = next(iter(self._store.results(turbine, newest=1)), None)
            return {turbine: self._results[turbine] for turbine in turbines}

    def _forget_changed(self) -> None:
        last = self._store.last_event()
        if last - self._event > MAX_EVENTS:
            self._results.clear()
        elif last > self._event:
            for event in self._store.events(self._event, most=MAX_EVENTS):
                if event.kind == "result":
                    self._results.pop(event.turbine, None)
        self._event = last

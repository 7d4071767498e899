"""A store in memory, for tests of the engine: what it holds is what was committed."""

import json
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

from windsysid.live.blocks.block import Block
from windsysid.live.store.contents import Alarm, Commit, Event, Result, SensorHealth, SeriesLevel, Status


class MemoryStore:
    """Does what `windsysid.live.store.store.Store` says, as far as the engine asks; commits at once."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.blocks: dict[tuple[str, int, str, int], Block] = {}
        self.kept_results: dict[tuple[str, int], Result] = {}
        self.kept_alarms: dict[str, Alarm] = {}
        self.kept_statuses: dict[str, Status] = {}
        self.kept_healths: dict[tuple[str, str], SensorHealth] = {}
        self.refuse: Callable[[Commit], Exception | None] = lambda _: None
        self.commits = 0

    def submit(self, commit: Commit) -> "Future[None]":
        future: Future[None] = Future()
        error = self.refuse(commit)
        if error is not None:
            future.set_exception(error)
            return future
        with self.lock:
            self.commits += 1
            for window, block in commit.blocks:
                if (block.turbine, window) not in self.kept_results:
                    self.blocks.setdefault((block.turbine, window, block.stream, block.sequence), block)
            for result in commit.results:
                self.kept_results.setdefault((result.turbine, result.window), result)
                for key in [key for key in self.blocks if key[:2] == (result.turbine, result.window)]:
                    del self.blocks[key]
            self.kept_alarms.update({alarm.key: alarm for alarm in commit.alarms})
            self.kept_statuses.update({status.turbine: status for status in commit.statuses})
            self.kept_healths.update({(health.turbine, health.channel): health for health in commit.healths})
        future.set_result(None)
        return future

    def close(self) -> None:
        pass

    @property
    def trouble(self) -> str:
        return ""

    def told(self, recipient: str) -> int | None:
        return None

    def tell(self, recipient: str, event: int) -> None:
        pass

    def waiting(self, turbine: str, window: int | None = None) -> Iterator[tuple[int, Block]]:
        with self.lock:
            kept = sorted(key for key in self.blocks if key[0] == turbine and window in (None, key[1]))
            return iter([(key[1], self.blocks[key]) for key in kept])

    def checkpoint(self, turbine: str) -> tuple[int, bytes] | None:
        newest = self.results(turbine)
        return (newest[-1].until, newest[-1].checkpoint) if newest else None

    def configure(self, turbine: str, settings: str, tables: dict[str, Any]) -> None:
        pass

    def configurations(self, turbine: str) -> list[dict[str, Any]]:
        return []

    def turbines(self) -> list[str]:
        return sorted(self.kept_statuses)

    def statuses(self) -> list[Status]:
        return list(self.kept_statuses.values())

    def healths(self, turbine: str | None = None) -> list[SensorHealth]:
        return [health for health in self.kept_healths.values() if turbine in (None, health.turbine)]

    def results(
        self,
        turbine: str,
        *,
        since: int | None = None,
        until: int | None = None,
        newest: int | None = None,
        most: int | None = None,
    ) -> list[Result]:
        with self.lock:
            return [self.kept_results[key] for key in sorted(self.kept_results) if key[0] == turbine]

    def levels(
        self, turbine: str, *, since: int | None = None, until: int | None = None, most: int = 2000
    ) -> list[tuple[int, SeriesLevel]]:
        return [(result.window, level) for result in self.results(turbine) for level in result.levels]

    def spectra(
        self, turbine: str, *, since: int | None = None, until: int | None = None, most: int = 500
    ) -> list[tuple[int, list[dict[str, Any]]]]:
        return [(one.window, [json.loads(plot) for plot in one.spectra]) for one in self.results(turbine)]

    def alarms(self, *, turbine: str | None = None, open_only: bool = False, most: int = 500) -> list[Alarm]:
        with self.lock:
            return [
                alarm
                for alarm in self.kept_alarms.values()
                if turbine in (None, alarm.turbine) and not (open_only and alarm.ended is not None)
            ]

    def acknowledge(self, key: str, *, by: str, remark: str = "", at: int) -> Alarm:
        self.kept_alarms[key] = self.kept_alarms[key]._replace(acknowledged=at, by=by, remark=remark)
        return self.kept_alarms[key]

    def events(self, after: int, *, most: int = 500) -> list[Event]:
        return []

    def last_event(self) -> int:
        return 0

    def thin(self, *, now: int) -> None:
        pass

    def size(self) -> dict[str, int]:
        return {}

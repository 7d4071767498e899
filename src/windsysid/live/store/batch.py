"""Commits as rows of tables: several that wait become one transaction, in their order."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

from windsysid.live.store import statements as sql
from windsysid.live.store.contents import Commit
from windsysid.live.store.encoding import columns_of, pack_levels, pack_row, pack_spectra, pack_text
from windsysid.live.store.keep import HOUR

__all__ = ["CommitBatch", "PreparedCommit", "prepare"]

Values = tuple[Any, ...]


class PreparedCommit(NamedTuple):
    """A commit whose rows are encoded, in the thread that submits it.

    Attributes
    ----------
    blocks, statuses, healths, alarms, results
        Values of their statements, as far as the writer need not add to them.
    windows
        Turbine and window of every result.
    """

    blocks: list[Values]
    statuses: list[Values]
    healths: list[Values]
    alarms: list[Values]
    results: list[tuple[Values, bytes, bytes, bytes, bytes]]
    windows: list[tuple[str, int]]


def prepare(commit: Commit) -> PreparedCommit:
    """Encode the rows of a commit."""
    windows = [(result.turbine, result.window) for result in commit.results]
    of = dict(windows)
    return PreparedCommit(
        [(*columns_of(stored.block), stored.window, stored.block.turbine, stored.window) for stored in commit.blocks],
        [
            (status[0], pack_text(dict(status.sequences)), *status[2:-1], pack_text(dict(status.counts)))
            for status in commit.statuses
        ],
        [tuple(health) for health in commit.healths],
        [(*alarm, alarm.turbine, of.get(alarm.turbine)) for alarm in commit.alarms],
        [
            (
                (result.turbine, result.window, result.until, result.closed),
                pack_row(result.row),
                pack_levels(result.levels),
                bytes(result.checkpoint),
                pack_spectra(result.spectra),
            )
            for result in commit.results
        ],
        windows,
    )


class CommitBatch:
    """Commits that are written together.

    Attributes
    ----------
    event
        The number of the last event.
    """

    def __init__(self, commits: Sequence[PreparedCommit], event: int) -> None:
        self.event = event
        self._blocks: list[Values] = []
        self._statuses: dict[str, Values] = {}
        self._healths: list[Values] = []
        self._alarms: list[Values] = []
        self._results: dict[tuple[str, int], tuple[Values, bytes, bytes, bytes, bytes]] = {}
        self._events: list[int] = []
        for commit in commits:
            self._add(commit)

    def _next(self) -> int:
        self.event += 1
        return self.event

    def _add(self, commit: PreparedCommit) -> None:
        self._blocks += commit.blocks
        for status in commit.statuses:
            self._statuses[status[0]] = (*status, self._next())
        self._healths += [(*health, self._next()) for health in commit.healths]
        if commit.windows and self._results.keys() >= set(commit.windows):
            return  # it came twice
        self._alarms += [(*alarm[:-2], self._next(), *alarm[-2:]) for alarm in commit.alarms]
        for window, result in zip(commit.windows, commit.results, strict=True):
            self._results.setdefault(window, ((*result[0], self._next()), *result[1:]))

    def statements(self) -> Iterator[tuple[str, list[Values]]]:
        """Statements and the rows for each. Results come after all that asks whether they are there already."""
        results = self._results.values()
        drawn = _drawn(results)
        written: tuple[tuple[str, list[Values]], ...] = (
            (sql.BLOCK, self._blocks),
            (sql.STATUS, list(self._statuses.values())),
            (sql.HEALTH, self._healths),
            (sql.ALARM, self._alarms),
            (sql.LEVELS, [(*key[:2], levels, *key[:2]) for key, _, levels, _, _ in results]),
            (sql.SPECTRA, [(*key[:2], spectra, *key[:2]) for key, spectra in drawn]),
            (sql.SPECTRA_REPLACED, [(key[0], key[1] // HOUR * HOUR, key[1]) for key, _ in drawn]),
            (sql.RESULT, [(*key, row) for key, row, _, _, _ in results]),
            (sql.CHECKPOINT, [(*key[:3], checkpoint) for key, _, _, checkpoint, _ in results]),
            (sql.DONE, [key[:2] for key, *_ in results]),
        )
        return ((statement, rows) for statement, rows in written if rows)


def _drawn(results: Iterable[tuple[Values, bytes, bytes, bytes, bytes]]) -> list[tuple[Values, bytes]]:
    """Keys and spectra of the results that have spectra."""
    return [(key, spectra) for key, *_, spectra in results if spectra]

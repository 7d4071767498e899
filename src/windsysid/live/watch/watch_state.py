"""State of a watch and its windows, without its series."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from windsysid.fleet.rows import Row
from windsysid.live.windows.conditions import NO_STATE, Standards, conditions_of, state_of

__all__ = ["NO_WINDOWS", "KeptWindows", "WatchState"]


class KeptWindows(NamedTuple):
    """The windows that are kept (n,): their starts, states, whether without findings, and conditions (n, 4)."""

    time: NDArray[np.int64]
    state: NDArray[np.int8]
    sound: NDArray[np.bool_]
    conditions: NDArray[np.float32]

    def later(self, count: int) -> "KeptWindows":
        """Without the first `count`."""
        return KeptWindows._make(part[count:] for part in self)

    def and_then(self, time: int, row: Row | None) -> "KeptWindows":
        """With one more; None where it is missing."""
        if row is None:
            newest: tuple[Any, ...] = (time, NO_STATE, False, np.full(self.conditions.shape[1], np.nan))
        else:
            newest = (time, state_of(row), not row["health"], conditions_of(row))
        parts: tuple[NDArray[Any], ...] = self
        new = (np.array([one], dtype=part.dtype) for one, part in zip(newest, parts, strict=True))
        return KeptWindows._make(np.concatenate(both) for both in zip(parts, new, strict=True))


NO_WINDOWS = KeptWindows(np.empty(0, np.int64), np.empty(0, np.int8), np.empty(0, bool), np.empty((0, 4), np.float32))


class WatchState(NamedTuple):
    """All of a watch but its windows and series.

    Attributes
    ----------
    taken
        Windows with a state so far.
    next_learning
        How many of them the rates are learned at next, as long as none had to leave: the windows to learn from, halved
        as often as leaves enough, then doubled.
    standards
        None before they were learned.
    let_go
        Windows that have left.
    blind_since, blind_open
        Start of the first of the windows that could not be taken in, one after the other, and how many they are; when
        that was said. None where the newest could, or nothing was said.
    why
        Why the newest could not.
    settings, changed
        What the newest row was made by, and the window that it was first made so; the latter is None where it has
        always been.
    """

    taken: int
    next_learning: int
    standards: Standards | None
    let_go: int
    blind_since: int | None
    blind: int
    blind_open: int | None
    why: str
    settings: str
    changed: int | None

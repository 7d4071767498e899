"""State of the engine, and the engine as the page needs it."""

from typing import NamedTuple, Protocol

from windsysid.live.store.contents import Alarm

__all__ = ["EngineState", "PageEngine", "TurbineState"]


class TurbineState(NamedTuple):
    """State of one turbine's windows.

    Attributes
    ----------
    windows
        That wait for a worker or are with one.
    behind
        Seconds since the oldest of them was closed.
    """

    windows: int
    behind: float


class EngineState(NamedTuple):
    """State of the engine.

    Attributes
    ----------
    turbines
        By name.
    blocks, samples, windows
        Taken since the start; samples are rows, not values.
    rate
        Blocks a second, in the last seconds.
    pending
        Blocks on their way to the store.
    seconds
        Of processor time since the start: ``blocks`` (check, place, health), ``windows`` (reading back and joining),
        ``estimates`` and ``watch``.
    workers
        At once.
    compiling
        Whether one of them compiles a turbine's equations.
    """

    turbines: dict[str, TurbineState]
    blocks: int
    samples: int
    windows: int
    rate: float
    pending: int
    seconds: dict[str, float]
    workers: int
    compiling: bool = False


class PageEngine(Protocol):
    """An engine, as far as the page needs one."""

    def state(self) -> EngineState:
        """Current state."""

    def acknowledge(self, key: str, by: str, remark: str) -> Alarm:
        """Acknowledge an alarm; KeyError if there is none of this key."""

"""What the page asks of the engine behind it."""

from collections.abc import Mapping
from typing import Protocol

from windsysid.live.store.contents import Alarm

__all__ = ["Engine", "EngineState", "TurbineState"]


class TurbineState(Protocol):
    """How the engine does with one turbine."""

    @property
    def windows_waiting(self) -> int:
        """Windows that are over and have no result."""
        ...

    @property
    def seconds_behind(self) -> float:
        """By how much the results are behind the samples [s]."""
        ...


class EngineState(Protocol):
    """How the engine does."""

    @property
    def turbines(self) -> Mapping[str, TurbineState]:
        """By name."""
        ...

    @property
    def blocks_per_second(self) -> float:
        """Committed of late [1/s]."""
        ...

    @property
    def cost_per_sample(self) -> float:
        """Processor time a sample [µs]."""
        ...


class Engine(Protocol):
    """An engine, as far as the page needs one."""

    def state(self) -> EngineState:
        """How it does now."""
        ...

    def acknowledge(self, key: str, by: str, remark: str) -> Alarm:
        """Acknowledge an alarm; KeyError if there is none of this key."""
        ...

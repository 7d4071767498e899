"""What the page asks of the engine behind it."""

from collections.abc import Mapping
from typing import Protocol

from windsysid.live.store.contents import Alarm

__all__ = ["Engine", "EngineState", "TurbineState"]


class TurbineState(Protocol):
    """How the engine does with one turbine."""

    @property
    def windows(self) -> int:
        """That are over and have no result."""
        ...

    @property
    def behind(self) -> float:
        """How long the oldest of them has waited [s]."""
        ...


class EngineState(Protocol):
    """How the engine does."""

    @property
    def turbines(self) -> Mapping[str, TurbineState]:
        """By name."""
        ...

    @property
    def samples(self) -> int:
        """Taken since the start."""
        ...

    @property
    def rate(self) -> float:
        """Blocks a second, committed of late."""
        ...

    @property
    def compiling(self) -> bool:
        """Whether a turbine's equations are being compiled."""
        ...

    @property
    def seconds(self) -> Mapping[str, float]:
        """Processor time since the start, by part [s]."""
        ...


class Engine(Protocol):
    """An engine, as far as the page needs one."""

    def state(self) -> EngineState:
        """How it does now."""
        ...

    def acknowledge(self, key: str, by: str, remark: str) -> Alarm:
        """Acknowledge an alarm; KeyError if there is none of this key."""
        ...

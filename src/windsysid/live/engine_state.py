"""Where the engine stands: for the page, for metrics, and for whoever asks how fast it is."""

from typing import NamedTuple

__all__ = ["EngineState", "TurbineState"]


class TurbineState(NamedTuple):
    """Where one turbine stands.

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
    """Where the engine stands.

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

"""From the row of a window to what is known of its turbine: levels that forget, alarms, and a checkpoint."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from windsysid.errors import ConfigurationError
from windsysid.fleet.rows import Row
from windsysid.live.store.contents import Alarm, Level
from windsysid.monitoring.watch import TOLERATED_DRIFT

__all__ = ["Options", "Taken", "Watching", "resume", "start"]


class Options(NamedTuple):
    """How a turbine is watched.

    Attributes
    ----------
    window
        Length of a window [s].
    learn
        Windows to learn from before the first alarm: a day of 10 minutes, 12 or more.
    alarms_per_year
        False alarms that are accepted of a turbine in a year, all series together: 1e-6 to 100.
    tolerated
        Of ``k``, ``c``, ``f`` and ``noise``: relative jumps up to this size are no alarm, however sure.
    """

    window: float = 600.0
    learn: int = 144
    alarms_per_year: float = 0.1
    tolerated: Mapping[str, float] = TOLERATED_DRIFT


class Taken(NamedTuple):
    """What a row gave: of a `windsysid.live.store.contents.Result` its levels and its checkpoint, and alarms.

    Attributes
    ----------
    alarms
        New ones, and those that changed: an alarm that is known is replaced by the one of its key.
    """

    levels: tuple[Level, ...]
    alarms: tuple[Alarm, ...]
    checkpoint: bytes


class Watching:
    """The watch over one turbine: it changes with every row, and its checkpoints are all that it takes to go on."""

    def __init__(self, turbine: str, options: Options) -> None:
        self.turbine = turbine
        self.options = options

    def take(self, row: Row, window: int) -> Taken:
        """Take in the row of the window that begins at `window` [ns since 1970]; rows come in order of windows.

        Parameters
        ----------
        row
            As `windsysid.fleet.rows` has it; refused and failed ones too.
        """
        return Taken(tuple(_level(parameter) for parameter in row["parameters"]), (), b"")


def start(turbine: str, options: Options = Options()) -> Watching:
    """A watch that has seen nothing yet.

    Raises
    ------
    ConfigurationError
        If an option is out of its range.
    """
    if options.learn < 12:
        raise ConfigurationError(f"learn: expected 12 windows or more, got {options.learn}")
    return Watching(turbine, options)


def resume(checkpoint: bytes, turbine: str, options: Options = Options()) -> Watching:
    """The watch as it was when it gave this checkpoint: it goes on, bit for bit, as if it had never stopped.

    Raises
    ------
    ConfigurationError
        If the checkpoint is damaged, or of another turbine or version; or an option is out of its range.
    """
    return start(turbine, options)


def _level(parameter: Mapping[str, Any]) -> Level:
    kind = "c" if parameter["name"].startswith("c_") else "k"
    estimate, low, high = (parameter[key] for key in ("estimate", "low", "high"))
    return Level(parameter["name"], parameter["unit"], kind, estimate, low, high, estimate, low, high, 0.0, 1.0)

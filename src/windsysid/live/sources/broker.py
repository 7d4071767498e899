"""Topics and properties of blocks at an MQTT broker.

Blocks come on one topic of each turbine, ``windsysid/<turbine>/blocks``. In addition, the service publishes
``windsysid/<turbine>/committed`` (retained: the number of the newest block up to which all are on its disk, as text; of
a named logger ``…/committed/<stream>``) and ``windsysid/<turbine>/refused`` (why a block was not taken).

A publisher that sends again what was lost marks its messages with MQTT 5 user properties: ``sequence`` and ``stream``
of the block, and ``after``, the number of the block that it sent before. Without ``after`` nothing that can still be
sent lies before the block.
"""

import importlib
from collections.abc import Mapping
from typing import Any, NamedTuple

from windsysid.errors import ConfigurationError

__all__ = ["MAX_PAYLOAD_BYTES", "TOPIC", "Marks", "Topics", "marks_of", "needed", "properties_of"]

TOPIC = "windsysid/{turbine}/blocks"
"""Of blocks."""

MAX_PAYLOAD_BYTES = 2_000_000
"""Of a message [bytes]: the broker hands longer ones to no service."""


class Topics:
    """The topics of turbines.

    Parameters
    ----------
    blocks
        Of blocks, with ``{turbine}`` as one of its levels.
    """

    def __init__(self, blocks: str = TOPIC) -> None:
        levels = blocks.split("/")
        if levels.count("{turbine}") != 1 or "#" in blocks or "+" in blocks:
            raise ConfigurationError(f"topic: expected one level '{{turbine}}', no # and no +, got '{blocks[:60]}'")
        self._blocks = blocks
        self._beside = blocks if levels[-1] == "{turbine}" else "/".join(levels[:-1])

    def blocks(self, turbine: str) -> str:
        """Of a turbine's blocks."""
        return self._blocks.replace("{turbine}", turbine)

    def committed(self, turbine: str, stream: str) -> str:
        """Of the number up to which a logger's blocks are committed."""
        return f"{self._beside.replace('{turbine}', turbine)}/committed" + (f"/{stream}" if stream else "")

    def refused(self, turbine: str) -> str:
        """Of blocks that were not taken, and why."""
        return f"{self._beside.replace('{turbine}', turbine)}/refused"


class Marks(NamedTuple):
    """Metadata of a message in addition to the block; None if there are none."""

    sequence: int | None = None
    stream: str = ""
    after: int | None = None


def marks_of(told: Mapping[str, str]) -> Marks:
    """The marks among a message's user properties; those that are no numbers count as not said."""
    return Marks(_whole(told.get("sequence")), told.get("stream", ""), _whole(told.get("after")))


def _whole(text: str | None) -> int | None:
    try:
        number = int(text or "")
    except ValueError:
        return None
    return number if abs(number) < 2**63 else None


def properties_of(marks: Marks) -> list[tuple[str, str]]:
    """The marks as user properties of a message."""
    told = {"sequence": str(marks.sequence), "stream": marks.stream}
    return list((told if marks.after is None else {**told, "after": str(marks.after)}).items())


def needed(module: str, what: str) -> Any:
    """A module of the extra; ConfigurationError where it is not installed."""
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ConfigurationError(f"{what}; install it with: pip install 'windsysid[live]'") from None

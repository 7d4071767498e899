"""What an answer can do: be saved with its page, and draw itself.

An answer does not know its page. `windsysid.reports` says which module writes the page of a type and which function
draws it; it is looked up by the name of the type when somebody asks.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from windsysid.output.folders import Saveable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Answer"]


class Answer(Saveable):
    """A result with a page and a figure."""

    def files(self) -> dict[str, bytes]:
        """What `save` writes, by name: ``report.html``, figures, and the answer as JSON."""
        found: dict[str, bytes] = _reports().files(self)
        return found

    def plot(self) -> "Figure":
        """The answer as a figure."""
        figure: Figure = _reports().figure(self)
        return figure


def _reports() -> Any:
    return import_module("windsysid.reports")

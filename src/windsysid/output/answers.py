"""Interface of an answer: sentence and tables, saving with its page, and figures.

An answer does not know its page. The room of the pages knows which module writes the page of a type and which function
draws it; it is looked up by the name of the type when somebody asks (`windsysid.output.pages`).
"""

import json
from abc import abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from windsysid.output.console import render
from windsysid.output.folders import Saveable
from windsysid.output.pages import pages
from windsysid.output.table import Table

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["Answer", "SummarisedAnswer"]


class Answer(Saveable):
    """A result with words, a page and a figure."""

    @abstractmethod
    def contents(self) -> Sequence[Table | str]:
        """The answer as sentences and tables: first the result, then its inputs."""

    @abstractmethod
    def to_dataframe(self) -> "pd.DataFrame":
        """The answer's numbers as they are, one thing a row: SI units, Hz for frequencies, intervals of ±2σ."""

    def __str__(self) -> str:
        """The parts as text, as wide as the terminal."""
        return render(*self.contents())

    def _repr_html_(self) -> str:
        """The parts and the figure as a notebook shows them."""
        found: str = pages().fragment(self, self.contents())
        return found

    def files(self) -> dict[str, bytes]:
        """Files of `save`, by name: ``report.html``, figures, and the answer as JSON."""
        found: dict[str, bytes] = pages().files(self)
        return found

    def plot(self, ax: "Axes | None" = None) -> "Figure":
        """The answer as a figure, or in a figure of your own.

        Parameters
        ----------
        ax
            Axes that ``subplots`` or ``add_subplot`` made. An answer with one panel is drawn on them; one with several
            takes their place.

        Returns
        -------
        Figure
            A new figure, or what was drawn on: the figure of `ax`, or the part of it where `ax` was.

        Raises
        ------
        ConfigurationError
            If several panels are to take the place of axes that were placed by hand.
        """
        figure: Figure = pages().figure(self, ax)
        return figure


class SummarisedAnswer(Answer):
    """An answer with a summary for other programs."""

    @abstractmethod
    def summary(self) -> dict[str, Any]:
        """Plain values, for ``summary.json``."""

    def to_json(self) -> str:
        """`summary` as JSON text; what is not a finite number becomes null."""
        from windsysid.results.serialization import finite

        return json.dumps(finite(self.summary()), indent=2, ensure_ascii=False) + "\n"

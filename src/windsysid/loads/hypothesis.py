"""Hypotheses on the loads: the assumptions of each on a turbine, where it applies, and the registry of all.

A hypothesis of one's own derives from `LoadHypothesis` and is known everywhere after `register_loads`: `identify` takes
its name and tries it by itself where it applies, `simulate` plays it, the command line lists it.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, TypeVar

from windsysid.loads.statistics import Statistic
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.process import Process
from windsysid.turbine.turbine import Turbine

__all__ = ["HYPOTHESES", "LoadHypothesis", "SupposedLoads", "register_loads", "with_level"]

Values = Mapping[str, float]


@dataclass(frozen=True)
class SupposedLoads:
    """Load states and their statistics, as a hypothesis supposes them for one turbine.

    Attributes
    ----------
    name
        Name of the hypothesis.
    text
        Description of the loads in words.
    turbine
        The turbine with the model that the hypothesis needs.
    statistics
        Statistics of the loads that are learned.
    blocks
        The load states, as a function of the values of the statistics by name.
    parameters
        Coefficients that come with it.
    """

    name: str
    text: str
    turbine: Turbine
    statistics: tuple[Statistic, ...]
    blocks: Callable[[Values], tuple[LoadModel, ...]]
    parameters: tuple[Parameter, ...] = ()

    def given(self) -> tuple[LoadModel, ...]:
        """The load states with the statistics as the turbine file gives them."""
        return self.blocks({s.name: s.given for s in self.statistics})


class LoadHypothesis(ABC):
    """Load model to derive from; `register_loads` makes it known by its name.

    Attributes
    ----------
    name
        Name of the load model, as `identify` and `simulate` take it.
    text
        Description of the loads in words.
    caution
        Caveat that every result under it carries; empty for none.
    """

    name: ClassVar[str]
    text: ClassVar[str]
    caution: ClassVar[str] = ""

    def applies_to(self, turbine: Turbine) -> bool:
        """True if the hypothesis applies to the loads of a turbine; by default to any."""
        return True

    @abstractmethod
    def suppose(self, turbine: Turbine, loads: Sequence[GaussMarkov]) -> SupposedLoads:
        """Load model for a turbine, `loads` being those of its file that are states.

        Raises
        ------
        ConfigurationError
            If it makes no sense for this turbine.
        """

    def start_from(self, louder: Values, statistics: Sequence[Statistic]) -> dict[str, float]:
        """Start values of its statistics, by name, after the simplest hypothesis has been tried; those left
        out stay as given.

        Parameters
        ----------
        louder
            By which factor the simplest found its loads louder than the file says, by the name of its statistic.
        statistics
            Of this hypothesis. By default levels of the same name are as much louder, and others as much as the
            loudest.
        """
        loudest = max(louder.values(), default=1.0)
        return {s.name: s.given * louder.get(s.name, loudest) for s in statistics if s.kind == "level"}


HYPOTHESES: dict[str, LoadHypothesis] = {}
"""Every hypothesis by its name, in the order in which it was registered: the simplest first."""

H = TypeVar("H", bound=LoadHypothesis)


def register_loads(hypothesis: type[H]) -> type[H]:
    """Register a load hypothesis by its name; for use as a decorator of its class.

    Of the hypotheses that apply to a turbine, the evidence of the record chooses between the simplest and the one
    registered last.

    Parameters
    ----------
    hypothesis : type
        A class derived from `LoadHypothesis`.

    Returns
    -------
    type
        The class itself.

    Examples
    --------
    >>> from dataclasses import replace
    >>> import windsysid as ws
    >>> @ws.models.register_loads
    ... class QuietLoads(ws.models.LoadHypothesis):
    ...     name, text = "quiet", "a tenth of the loads of the turbine file"
    ...     def suppose(self, turbine, loads):
    ...         quiet = tuple(replace(load, rms=0.1 * load.rms) for load in loads)
    ...         return ws.models.SupposedLoads(self.name, self.text, turbine, (), lambda values: quiet)
    >>> quiet = ws.simulate("tower", duration=60.0, rate=20.0, loads="quiet")["tower_x_acceleration"]
    >>> usual = ws.simulate("tower", duration=60.0, rate=20.0)["tower_x_acceleration"]
    >>> round(float(quiet.std() / usual.std()), 1)
    0.1
    """
    HYPOTHESES[hypothesis.name] = hypothesis()
    return hypothesis


def with_level(process: Process, level: float) -> Process:
    """The process with the square of `level` as its spectrum at zero frequency."""
    return process.times(level / math.sqrt(float(process.spectrum(0.0)[0])))

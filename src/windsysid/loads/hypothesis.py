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
    """Load model of a hypothesis for one turbine.

    Attributes
    ----------
    name
        Of the hypothesis.
    text
        What it takes the loads for, in words.
    turbine
        The turbine with the model that it needs.
    statistics
        What must be learned of the loads.
    blocks
        The load states, from the values of the statistics by name.
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
    """One hypothesis on the loads.

    Attributes
    ----------
    name
        What a user calls it.
    text
        What it takes the loads for, in words.
    caution
        Note in every result under it; empty for none.
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
    """Make a hypothesis known by its name; for use as a decorator of its class.

    Of those that apply to a turbine, a record chooses between the simplest and the one registered last.

    Returns
    -------
    type
        The class itself.
    """
    HYPOTHESES[hypothesis.name] = hypothesis()
    return hypothesis


def with_level(process: Process, level: float) -> Process:
    """The process with the square of `level` as its spectrum at zero frequency."""
    return process.times(level / math.sqrt(float(process.spectrum(0.0)[0])))

"""A hypothesis of what the loads are, with the statistics that a record must tell."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from windsysid.loads.statistics import Statistic
from windsysid.statespace.load_model import LoadModel
from windsysid.statespace.parameter import Parameter
from windsysid.statespace.process import Process
from windsysid.turbine.turbine import Turbine

__all__ = ["LoadHypothesis", "with_level"]

Values = Mapping[str, float]


@dataclass(frozen=True)
class LoadHypothesis:
    """A load model for one turbine.

    Attributes
    ----------
    name
        Its name in the family.
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


def with_level(process: Process, level: float) -> Process:
    """The process with the square of `level` as its spectrum at zero frequency."""
    return process.times(level / math.sqrt(float(process.spectrum(0.0)[0])))

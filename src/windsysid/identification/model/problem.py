"""Estimation problem: unknowns with their prior, and the state-space model as a function of them."""

from collections.abc import Sequence
from typing import Protocol

from windsysid._types import Array
from windsysid.statespace.compose import StateSpace
from windsysid.statespace.unknowns import Unknowns

__all__ = ["FIRST_LOG_STD", "Problem"]

FIRST_LOG_STD = 0.05
"""Setting: standard deviation of the logarithm of a statistic of loads or noise that scales its first differences."""


class Problem(Protocol):
    """Unknowns to estimate from a record, and the model at any value of them.

    Vectors of unknowns hold whole blocks of `unknowns` in their order; blocks at the end may be left out.
    """

    @property
    def unknowns(self) -> Unknowns:
        """Names of all unknowns."""

    @property
    def prior(self) -> tuple[Array, Array]:
        """Mean (n,) and covariance (n, n) of the unknowns that are estimated on line: parameters and statistics."""

    @property
    def wide_prior(self) -> tuple[Array, Array]:
        """Derivatives of all unknowns except the clocks."""

    @property
    def clocks(self) -> Sequence[Array]:
        """For each clock, the lags of readings (m,) [s] at one standard deviation of its tolerance."""

    def build(self, unknowns: Array, /) -> StateSpace:
        """The state-only model at the unknowns (n,)."""

    def start(self, inputs: Array, readings: Array) -> tuple[Array, Array]:
        """Start of the search and its covariance (n,), (n, n), from the first T samples."""

    def frequencies(self, unknowns: Array) -> Sequence[float]:
        """Natural frequencies [Hz] at the unknowns (n,); none where they are not known."""

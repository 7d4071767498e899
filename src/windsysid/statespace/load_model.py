"""Interface of a load model in `compose`: a stationary linear block of states that drives the mechanics."""

from collections.abc import Mapping
from typing import Protocol

from windsysid._types import Array

__all__ = ["LoadModel"]


class LoadModel(Protocol):
    """Interface of a load model in `compose`."""

    @property
    def states(self) -> tuple[str, ...]:
        """Names of its n states."""

    @property
    def cov(self) -> Array:
        """Their stationary covariance (n, n)."""

    @property
    def outputs(self) -> Mapping[str, Array]:
        """For each load that it drives, the rows H₀, C₁, S₁, C₂ … of H(ψ) (1 + 2K, n) [N or N·m per unit of state]."""

    def discretise(self, step: float) -> tuple[Array, Array]:
        """Φ and Q (n, n) over `step` seconds, exact."""

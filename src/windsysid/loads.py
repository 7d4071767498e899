"""Load models: stationary random processes that drive the mechanics, as linear blocks that `compose` puts together.

A block holds n states with

    dz = A z dt + noise,    cov(z) = P for all time,    w = H(ψ) z,
    H(ψ) = H₀ + Σ_k (C_k cos kψ + S_k sin kψ),

mean zero and mean-reverting. Several blocks may drive the same degree of freedom, and one block may drive several: that is how loads on
blades and hub are correlated. Over a step h the block is discretised exactly, Φ = exp(A h) and Q = P − Φ P Φᵀ.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from windsysid.errors import ConfigurationError

__all__ = ["GaussMarkov", "LoadBlock", "LoadModel"]

Array = NDArray[np.float64]


class LoadModel(Protocol):
    """What `compose` needs of a load model."""

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


@dataclass(frozen=True)
class GaussMarkov:
    """A first-order Gauss–Markov load on one degree of freedom: mean zero, correlation exp(−|t| / time_constant).

    Attributes
    ----------
    load
        Name of the model's load.
    rms
        Stationary standard deviation [N or N·m].
    time_constant
        [s].
    """

    load: str
    rms: float
    time_constant: float

    def __post_init__(self) -> None:
        if not (self.rms > 0.0 and self.time_constant > 0.0 and np.isfinite(self.rms * self.time_constant)):
            raise ConfigurationError(
                f"load '{self.load}': expected a positive rms and time constant, got {self.rms} and {self.time_constant}"
            )

    @property
    def states(self) -> tuple[str, ...]:
        """The load is its own state."""
        return (self.load,)

    @property
    def cov(self) -> Array:
        """Stationary variance (1, 1)."""
        return np.array([[self.rms**2]])

    @property
    def outputs(self) -> Mapping[str, Array]:
        """It drives its own degree of freedom."""
        return {self.load: np.ones((1, 1))}

    def discretise(self, step: float) -> tuple[Array, Array]:
        """Φ and Q (1, 1) over `step` seconds, exact."""
        variance = self.rms**2 * -np.expm1(-2.0 * step / self.time_constant)
        return np.array([[np.exp(-step / self.time_constant)]]), np.array([[variance]])


@dataclass(frozen=True, eq=False)
class LoadBlock:
    """Any stationary linear block.

    Attributes
    ----------
    states
        Names of its n states, its own among those of all blocks.
    drift
        A (n, n) [1/s], all eigenvalues in the left half plane.
    cov
        Stationary covariance P (n, n).
    outputs
        See `LoadModel`.
    """

    states: tuple[str, ...]
    drift: Array
    cov: Array
    outputs: Mapping[str, Array]

    def __post_init__(self) -> None:
        n, what = len(self.states), "/".join(self.states)
        for word, array in (("drift", self.drift), ("covariance", self.cov)):
            if np.shape(array) != (n, n) or not np.isfinite(array).all():
                raise ConfigurationError(f"load '{what}': expected a finite {word} {n} × {n}, got {np.shape(array)}")
        for load, rows in self.outputs.items():
            shape = np.shape(rows)
            if len(shape) != 2 or shape[1] != n or shape[0] % 2 == 0 or not np.isfinite(rows).all():
                raise ConfigurationError(
                    f"load '{what}' on '{load}': expected finite rows H₀, C₁, S₁ … of {n} numbers, got shape {shape}"
                )
        poles = self._poles
        if poles.size and poles.real.max() >= 0.0:
            raise ConfigurationError(f"load '{what}': expected a block that returns to its mean, got poles {poles}")

    @cached_property
    def _poles(self) -> NDArray[np.complex128]:
        return np.asarray(np.linalg.eigvals(self.drift), dtype=np.complex128)

    def discretise(self, step: float) -> tuple[Array, Array]:
        """Φ and Q (n, n) over `step` seconds, exact."""
        from scipy.linalg import expm

        transition: Array = expm(np.asarray(self.drift) * step)
        noise = self.cov - transition @ self.cov @ transition.T
        return transition, 0.5 * (noise + noise.T)

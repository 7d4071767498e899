"""A parameter to identify: physical value, filter coordinate, prior."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from windsysid._types import Array
from windsysid.errors import ConfigurationError
from windsysid.mechanics.model import Kind

__all__ = ["Parameter"]


@dataclass(frozen=True)
class Parameter:
    """Physical parameter to identify, with its prior in filter coordinates.

    Stiffness and mass are log-scaled, p = scale · exp(θ), and stay positive. Damping is linear, p = scale · θ, and may
    be negative, as of a stalled blade.

    Attributes
    ----------
    name
        Name of the model's parameter.
    centre
        Prior mean (linear) or median (logarithmic) of the parameter, in SI.
    spread
        Prior standard deviation: relative for a logarithmic parameter, in SI for a linear one.
    logarithmic
        True if θ = ln(p / centre).
    scale
        Scale of a linear parameter [SI], 2√(km) for a damper; ignored for a logarithmic one.
    kind, part
        Kind of the parameter, and the degree of freedom or other part that it belongs to, as the model declares them
        (`windsysid.models.Coefficient`); empty where the model leaves them open.

    Examples
    --------
    >>> import windsysid as ws
    >>> stiffness = ws.models.Parameter("k", centre=4.0, spread=0.5)
    >>> stiffness.prior, float(stiffness.physical(0.1).round(3))
    ((0.0, 0.5), 4.421)
    >>> damper = ws.models.Parameter("c", centre=0.2, spread=0.1, logarithmic=False, scale=4.0)
    >>> damper.prior
    (0.05, 0.025)
    """

    name: str
    centre: float
    spread: float
    logarithmic: bool = True
    scale: float = 1.0
    kind: Kind = ""
    part: str = ""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.centre) and np.isfinite(self.spread) and self.spread > 0.0):
            raise ConfigurationError(
                f"prior of '{self.name}': expected a finite centre and a positive spread, got {self.centre} ±"
                f" {self.spread}"
            )
        if (self.logarithmic and self.centre <= 0.0) or not self.scale > 0.0:
            raise ConfigurationError(f"prior of '{self.name}': expected a positive value, got {self.centre}")

    @property
    def reference(self) -> float:
        """Physical value at θ = 0 (logarithmic) or θ = 1 (linear)."""
        return self.centre if self.logarithmic else self.scale

    @property
    def prior(self) -> tuple[float, float]:
        """Mean and standard deviation of θ."""
        return (0.0, self.spread) if self.logarithmic else (self.centre / self.scale, self.spread / self.scale)

    def physical(self, theta: ArrayLike) -> Array:
        """The parameter in SI for values `theta` in filter coordinates, in their shape: (T,) for (T,)."""
        theta = np.asarray(theta, dtype=np.float64)
        return self.reference * (np.exp(theta) if self.logarithmic else theta)

    def coordinate(self, value: float) -> float:
        """θ of a value in SI."""
        return float(np.log(value / self.reference) if self.logarithmic else value / self.reference)

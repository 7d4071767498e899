"""What can be compiled: the protocol of a mechanical model."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import sympy as sp

    from windsysid.mechanics.equations import Equations


__all__ = ["Model"]


class Model(Protocol):
    """What can be compiled: `RotorModel`, or any `Equations`."""

    @property
    def signature(self) -> str:
        """A text that is the same exactly when the equations are."""

    def equations(self) -> "Equations":
        """The symbolic equations."""

    def readings(self, sensors: Sequence[Any]) -> "list[sp.Expr]":
        """The symbolic readings of the sensors."""

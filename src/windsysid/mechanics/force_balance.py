"""Models of a force balance: the equations of motion with the motion as input, and the linear regression of their
residuals.

They are in this package, since the key of a model's compiled code includes the sources of this package.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from windsysid.mechanics.model import Model
from windsysid.mechanics.rotor import RotorModel

if TYPE_CHECKING:
    import sympy as sp

    from windsysid.mechanics.equations import Equations

__all__ = ["ForceBalance", "ForceRegression", "RegressionReading"]


@dataclass(frozen=True)
class ForceBalance(Model):
    """The equations of motion of a rotor with q, q̇ and q̈ as inputs: no states, only readings."""

    rotor: RotorModel

    @property
    def signature(self) -> str:
        """A text that is the same exactly when the equations are."""
        return f"balance of {self.rotor.signature}"

    def equations(self) -> "Equations":
        """Equations without a state, whose inputs are the motion and those of the rotor."""
        from windsysid.mechanics.equations import Equations

        motion = self.rotor.equations()
        return Equations(
            name=f"{motion.name}_balance",
            states=(),
            inputs=(*motion.states, *motion.accelerations, *motion.inputs),
            parameters=motion.parameters,
            loads=motion.loads,
            rates=(),
        )

    def readings(self, sensors: Sequence[object]) -> "list[sp.Expr]":
        """Residual of each degree of freedom [N or N m], whatever the sensors."""
        import sympy as sp

        motion = self.rotor.equations()
        del sensors
        return list(motion.force - motion.mass * sp.Matrix(motion.accelerations))


class RegressionReading(NamedTuple):
    """s_j = Σ_i Φ_ji θ_i for one degree of freedom, as a sensor that the state-space model can read."""

    channel: str
    noise: float
    bias: float = 0.0
    structure: str = "row of Φ θ"


@dataclass(frozen=True)
class ForceRegression(Model):
    """A model without states whose readings are Φ θ, the entries of Φ being its inputs."""

    rows: int
    parameters: tuple[str, ...]

    @property
    def signature(self) -> str:
        """A text that is the same exactly when the equations are."""
        return f"linear regression {self.rows} x {self.parameters}"

    def equations(self) -> "Equations":
        """Equations without a state, whose inputs are the entries of Φ."""
        import sympy as sp

        from windsysid.mechanics.equations import Equations

        names = [f"phi_{j}_{i}" for j in range(self.rows) for i in range(len(self.parameters))]
        inputs, parameters = (tuple(sp.Symbol(name, real=True) for name in of) for of in (names, self.parameters))
        return Equations("force_balance", (), inputs, parameters, (), ())

    def readings(self, sensors: Sequence[object]) -> "list[sp.Expr]":
        """Φ θ of each degree of freedom."""
        equations = self.equations()
        n = len(self.parameters)
        return [
            sum(equations.inputs[j * n + i] * equations.parameters[i] for i in range(n)) for j in range(len(sensors))
        ]

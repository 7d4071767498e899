"""The top of a tower under a rigid rotor: side-side and fore-aft, the nacelle yawed by the angle γ(t), which is an input.

Nacelle axes: x points sideways, to the right looking upwind; z points downwind (`windsysid.signals.yaw`). The top moves by
u = x + i z in these axes, which turn with the nacelle, so that its velocity is

    v = u̇ + i γ̇ u.

Three bodies, two frames. What leans is a nacelle: its modal mass need not be the same sideways and fore-aft, and air damps it by its
own velocity, fore-aft far more than sideways. What bends is a tower, round and fixed to the ground:

    T = ½ m_x v_x² + ½ m_z v_z²,    V = ½ k_x x² + ½ k_z z²,    D = ½ c_x v_x² + ½ c_z v_z²,

with k_x = k_z for a round tower and true masses: V is then the same for every yaw. They are two coefficients all the same,
because a vibration shows k/m and never k, and nobody knows two modal masses: what the masses of the file get wrong ends in the stiffness.

Along the compass bearing b of an axis fixed to the tower, a vector reads v_x sin(b − γ) − v_z cos(b − γ). A top that leans by `tilt` radians per
metre tips its accelerometers: what feels gravity reads g · tilt · (x, z) less than the acceleration.

Left out: torsion, and with it the rotor's gyroscopic moment, which turns a nodding nacelle about the tower and not sideways.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

from windsysid.errors import ConfigurationError

if TYPE_CHECKING:
    import sympy as sp

    from windsysid.mechanics.equations import Equations
    from windsysid.mechanics.sensors import Sensor

__all__ = ["TOWER_INPUTS", "TowerModel"]

TOWER_INPUTS = ("rotor_azimuth", "rotor_speed", "nacelle_yaw", "yaw_rate", "yaw_acceleration")
"""Names of the inputs u: ψ and Ω, which the equations do not need but loads that turn with the rotor do; γ, γ̇, γ̈ [rad …]."""

DIRECTIONS = ("side_side", "fore_aft")


@dataclass(frozen=True)
class TowerModel:
    """Which directions the tower top moves in.

    Parameters
    ----------
    blades
        Number of blades N of the rigid rotor: which of its harmonics a tower feels.
    side_side, fore_aft
        ``"free"`` or ``"locked"``.
    """

    blades: int = 3
    side_side: Literal["free", "locked"] = "free"
    fore_aft: Literal["free", "locked"] = "free"

    def __post_init__(self) -> None:
        if self.blades < 1:
            raise ConfigurationError(f"number of blades: expected 1 or more, got {self.blades}")
        if not self.coordinates:
            raise ConfigurationError("both directions of the tower are locked: free at least one")

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The free directions, in the order of the state vector."""
        return tuple(name for name in DIRECTIONS if getattr(self, name) == "free")

    @property
    def loads(self) -> tuple[str, ...]:
        """Names of the loads: a force along each free direction of the nacelle."""
        return tuple(f"load_{name}" for name in self.coordinates)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states: displacements, then velocities."""
        return (*self.coordinates, *(f"{name}_rate" for name in self.coordinates))

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Stiffness and damping of each free direction."""
        return tuple(f"{kind}_{name}" for name in self.coordinates for kind in ("k", "c"))

    @property
    def signature(self) -> str:
        """A text that is the same exactly when the equations are."""
        return f"TowerModel({sorted(asdict(self).items())})"

    def inertia(self, coordinate: str, values: Mapping[str, float]) -> float:
        """Modal mass [kg] of one direction."""
        return values[f"mass_{coordinate}"]

    def equations(self) -> "Equations":
        """Lagrange's equations of the tower top."""
        from windsysid.mechanics.equations import lagrange

        k = _Kinematics(self)
        half = k.sp.Rational(1, 2)
        kinetic, potential, dissipation = k.zero, k.zero, k.zero
        velocity = dict(zip(DIRECTIONS, k.moved(k.top, 1), strict=True))
        for name, (q, _, _) in k.coordinate.items():
            kinetic += half * k.parameters[f"mass_{name}"] * velocity[name] ** 2
            potential += half * k.parameters[f"k_{name}"] * q**2
            dissipation += half * k.parameters[f"c_{name}"] * velocity[name] ** 2
        return lagrange(
            "tower",
            lagrangian=k.sp.expand(kinetic - potential),
            dissipation=dissipation,
            coordinates=list(k.coordinate.values()),
            loads=[k.symbol(name) for name in self.loads],
            inputs=k.inputs,
            parameters=k.parameters.values(),
        )

    def readings(self, sensors: "Sequence[Sensor]") -> "list[sp.Expr]":
        """What each sensor reads, in x, a, u, p and w."""
        k = _Kinematics(self)
        return [_reading(sensor, k) for sensor in sensors]


class _Kinematics:
    """The symbols of a `TowerModel` and the motion of its top; SymPy is imported here and not before."""

    def __init__(self, model: TowerModel) -> None:
        import sympy as sp

        self.sp: Any = sp
        self.zero = sp.Integer(0)
        names = [*(f"{kind}_{name}" for name in DIRECTIONS for kind in ("mass", "k", "c")), "tilt", "gravity"]
        self.parameters: dict[str, sp.Symbol] = {name: self.symbol(name) for name in names}
        psi, omega, self.yaw, self.yaw_rate, yaw_acceleration = (self.symbol(name) for name in TOWER_INPUTS)
        self.inputs = {
            psi: omega,
            omega: self.zero,
            self.yaw: self.yaw_rate,
            self.yaw_rate: yaw_acceleration,
            yaw_acceleration: self.zero,
        }
        self.coordinate = {
            name: tuple(self.symbol(name + end) for end in ("", "_rate", "_acc")) for name in model.coordinates
        }
        self.top = tuple(self.coordinate[name][0] if name in self.coordinate else self.zero for name in DIRECTIONS)

    def symbol(self, name: str) -> "sp.Symbol":
        """The real symbol of that name."""
        return self.sp.Symbol(name, real=True)

    def moved(self, vector: "tuple[sp.Expr, ...]", times: int) -> "tuple[sp.Expr, ...]":
        """The vector in nacelle axes, or its absolute rate of change of some order: v̇ + i γ̇ v, in components."""
        from windsysid.mechanics.equations import total_derivative

        rates = self.inputs | {of: rate for q, v, a in self.coordinate.values() for of, rate in ((q, v), (v, a))}
        for _ in range(times):
            x, z = vector
            vector = (
                total_derivative(x, rates) - self.yaw_rate * z,
                total_derivative(z, rates) + self.yaw_rate * x,
            )
        return vector


def _reading(sensor: "Sensor", k: _Kinematics) -> "sp.Expr":
    if sensor.frame not in ("nacelle", "tower") or sensor.quantity == "angular_rate":
        raise ConfigurationError(
            f"sensor '{sensor.channel}': this turbine is a tower under a rigid rotor; expected an acceleration, velocity, displacement, "
            "moment or strain of the point 'tower' along x (side-side) or z (fore-aft) of the frame 'nacelle', or along a bearing of the frame 'tower'"
        )
    x, z = k.top
    if sensor.quantity in ("moment", "strain"):
        vector = (k.parameters["k_side_side"] * x, k.parameters["k_fore_aft"] * z)
    else:
        vector = k.moved(k.top, ("displacement", "velocity", "acceleration").index(sensor.quantity))
    if sensor.quantity == "acceleration" and sensor.feels_gravity:
        leaning = k.parameters["gravity"] * k.parameters["tilt"]
        vector = (vector[0] - leaning * x, vector[1] - leaning * z)
    if sensor.axis == "bearing":
        turn = math.radians(sensor.bearing_deg) - k.yaw
        return sensor.gain * (vector[0] * k.sp.sin(turn) - vector[1] * k.sp.cos(turn))
    return sensor.gain * vector[0 if sensor.axis == "x" else 1]

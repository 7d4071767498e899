"""The top of a tower under a rigid rotor: side-side and fore-aft, the nacelle yawed by the angle γ(t), which is an
input.

Nacelle axes: x points sideways, to the right looking upwind; z points downwind (`windsysid.signals.yaw`). The top moves
by u = x + i z in these axes, which turn with the nacelle, so that its velocity is

    v = u̇ + i γ̇ u.

Three bodies, two frames. What leans is a nacelle: its modal mass need not be the same sideways and fore-aft, and air
damps it by its own velocity, fore-aft far more than sideways. What bends is a tower, round and fixed to the ground:

    T = ½ m_x v_x² + ½ m_z v_z²,    V = ½ k_x x² + ½ k_z z²,    D = ½ c_x v_x² + ½ c_z v_z²,

with k_x = k_z for a round tower and true masses: V is then the same for every yaw. They are two coefficients all the
same, because a vibration shows k/m and never k, and two modal masses are not known: errors of the masses in the file
become errors of the stiffness.

Along the compass bearing b of an axis fixed to the tower, a vector reads v_x sin(b − γ) − v_z cos(b − γ). A top that
leans by `tilt` radians per metre tips its accelerometers: what measures gravity reads g · tilt · (x, z) less than the
acceleration.

Left out: torsion, and with it the rotor's gyroscopic moment, which turns a nodding nacelle about the tower and not
sideways.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from windsysid.errors import ConfigurationError
from windsysid.mechanics.model import Coefficient, Coordinate, FixedAxes, MechanicalModel, register_model

if TYPE_CHECKING:
    import sympy as sp

    from windsysid.mechanics.equations import Equations
    from windsysid.mechanics.sensors import PlacedSensor, Sensor

__all__ = ["TOWER_INPUTS", "TowerModel"]

TOWER_INPUTS = ("rotor_azimuth", "rotor_speed", "nacelle_yaw", "yaw_rate", "yaw_acceleration")
"""Names of the inputs u: ψ and Ω, which the equations do not need but loads that turn with the rotor do; γ, γ̇, γ̈ [rad
…]."""

DIRECTIONS = ("side_side", "fore_aft")


SAMPLES_PER_TOWER_PERIOD = 12.0
"""Samples per period of a tower: room for its blade-passing line, not for the blades' own modes and the tower's
second."""


@register_model
@dataclass(frozen=True)
class TowerModel(MechanicalModel):
    """Mechanical model of a tower under a rigid rotor: side-side and fore-aft motion of its top.

    Parameters
    ----------
    blades
        Number of blades N of the rigid rotor, which determines the harmonics that excite the tower.
    side_side, fore_aft
        ``"free"`` or ``"locked"``.

    Examples
    --------
    >>> import windsysid as ws
    >>> model = ws.models.TowerModel(blades=3, fore_aft="locked")
    >>> [one.name for one in model.freedoms], [one.name for one in model.parameters][:4]
    (['side_side'], ['mass_side_side', 'k_side_side', 'c_side_side', 'mass_fore_aft'])
    """

    kind: ClassVar[str] = "tower"
    samples_per_period: ClassVar[float | None] = SAMPLES_PER_TOWER_PERIOD

    blades: int = 3
    side_side: Literal["free", "locked"] = "free"
    fore_aft: Literal["free", "locked"] = "free"

    def __post_init__(self) -> None:
        if self.blades < 1:
            raise ConfigurationError(f"number of blades: expected 1 or more, got {self.blades}")
        if not self.coordinates:
            raise ConfigurationError("both directions of the tower are locked: free at least one")

    @cached_property
    def freedoms(self) -> tuple[Coordinate, ...]:
        """The free directions; the loads on each have a level of their own."""
        return tuple(Coordinate(name, "m", name) for name in DIRECTIONS if getattr(self, name) == "free")

    @cached_property
    def parameters(self) -> tuple[Coefficient, ...]:
        """Every parameter, in the order of the equations."""
        found = []
        for name in DIRECTIONS:
            found += [
                Coefficient(f"mass_{name}", "inertia", "kg", name),
                Coefficient(f"k_{name}", "stiffness", "N/m", name),
                Coefficient(f"c_{name}", "damping", "N*s/m", name),
            ]
        return (
            *found, Coefficient("tilt", "geometry", "rad/m", "top"), Coefficient("gravity", "geometry", "m/s^2", "site")
        )  # fmt: skip

    @property
    def inputs(self) -> tuple[str, ...]:
        """ψ, Ω, γ, γ̇ and γ̈."""
        return TOWER_INPUTS

    @property
    def signature(self) -> str:
        """A text that is the same exactly when the equations are."""
        return f"TowerModel({sorted(asdict(self).items())})"

    def bodies(self) -> Mapping[str, tuple[str, ...]]:
        """One: all parts on the tower move in both directions."""
        return {"top": tuple(f"mass_{name}" for name in DIRECTIONS)}

    def inertia(self, coordinate: str, values: Mapping[str, float]) -> float:
        """Modal mass [kg] of the direction `coordinate`, at coefficients `values`."""
        return values[f"mass_{coordinate}"]

    def stiffness(self, coordinate: str, values: Mapping[str, float], rotor_speed: float) -> float:
        """Stiffness [N/m] of the direction `coordinate`, at coefficients `values`, whatever `rotor_speed` [rad/s]."""
        return values[f"k_{coordinate}"]

    def lock_unseen(self, sensors: "Sequence[Sensor]") -> "tuple[TowerModel, tuple[str, ...]]":
        """The tower with a direction locked where none of `sensors` sees it move."""
        seen = set().union(*(sensor.directions for sensor in sensors))
        unseen = [name for name, axis in zip(DIRECTIONS, ("x", "z"), strict=True) if axis not in seen]
        unseen = [name for name in unseen if name in self.coordinates]
        changes = dict.fromkeys(unseen, "locked")
        return replace(self, **changes) if changes else self, tuple(unseen)  # type: ignore[arg-type]

    def modes(self) -> FixedAxes:
        """Side-side and fore-aft as they are."""
        return FixedAxes(self, "tower ")

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
        """Readings of each of `sensors`, in x, a, u, p and w."""
        k = _Kinematics(self)
        return [sensor.reading(k) for sensor in sensors]

    def readings_across(self, sensors: "Sequence[Sensor]") -> "list[sp.Expr | None]":
        """Readings with the axis of each of `sensors` rotated by 90°; None where that changes nothing."""
        k = _Kinematics(self)
        return [sensor.across(k) for sensor in sensors]


class _Kinematics:
    """The symbols of a `TowerModel` and the motion of its top, as sensors use it; SymPy is imported here and not
    before."""

    def __init__(self, model: TowerModel) -> None:
        import sympy as sp

        self.sp: Any = sp
        self.zero = sp.Integer(0)
        self.parameters: dict[str, sp.Symbol] = {c.name: self.symbol(c.name) for c in model.parameters}
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
        for _ in range(times):
            x, z = vector
            vector = (self.rate(x) - self.yaw_rate * z, self.rate(z) + self.yaw_rate * x)
        return vector

    def displacement(self, name: str) -> "sp.Expr":
        """The displacement of one direction; 0 if locked."""
        return self.coordinate[name][0] if name in self.coordinate else self.zero

    def rate(self, expression: "sp.Expr") -> "sp.Expr":
        """The time derivative of an expression in displacements, velocities and inputs."""
        from windsysid.mechanics.equations import total_derivative

        rates = self.inputs | {of: rate for q, v, a in self.coordinate.values() for of, rate in ((q, v), (v, a))}
        return total_derivative(expression, rates)

    def along(self, sensor: "PlacedSensor", order: int) -> "sp.Expr":
        """Displacement, velocity or acceleration of the top along the sensor's axis."""
        vector = self.moved(self.top, order)
        if sensor.feels_gravity:
            x, z = self.top
            leaning = self.parameters["gravity"] * self.parameters["tilt"]
            vector = (vector[0] - leaning * x, vector[1] - leaning * z)
        return self._component(vector, sensor)

    def spring_force(self, sensor: "PlacedSensor") -> "sp.Expr":
        """The force in the tower along the sensor's axis."""
        x, z = self.top
        return self._component((self.parameters["k_side_side"] * x, self.parameters["k_fore_aft"] * z), sensor)

    def turning(self, sensor: "PlacedSensor") -> "sp.Expr":
        """Unknown: the modal mass does not determine the rotation of the top."""
        raise self._refusal(sensor)

    def _component(self, vector: "tuple[sp.Expr, ...]", sensor: "PlacedSensor") -> "sp.Expr":
        if sensor.frame not in ("nacelle", "tower"):
            raise self._refusal(sensor)
        if sensor.axis == "bearing":
            turn = math.radians(sensor.bearing_deg) - self.yaw
            return vector[0] * self.sp.sin(turn) - vector[1] * self.sp.cos(turn)
        return vector[0 if sensor.axis == "x" else 1]

    def _refusal(self, sensor: "PlacedSensor") -> ConfigurationError:
        return ConfigurationError(
            f"sensor '{sensor.channel}': this turbine is a tower under a rigid rotor; expected the point tower, along "
            "x or z of the frame nacelle, or a bearing of the frame tower"
        )

"""Motion of the parts of a rotor, as its sensors use it: expressions in the rotor's symbols."""

from typing import TYPE_CHECKING

from windsysid.errors import ConfigurationError

if TYPE_CHECKING:
    import sympy as sp

    from windsysid.mechanics.kinematics import Kinematics

from windsysid.mechanics.sensors import PlacedSensor

__all__ = ["SymbolicRotorMotion"]


class SymbolicRotorMotion:
    """The `windsysid.mechanics.sensors.Motion` of a rotor with these kinematics."""

    def __init__(self, kinematics: "Kinematics") -> None:
        self.kinematics, self.parameters = kinematics, kinematics.parameters

    def displacement(self, name: str) -> "sp.Expr":
        """The displacement of a degree of freedom; 0 if locked."""
        return self.kinematics.displacement(name)

    def rate(self, expression: "sp.Expr") -> "sp.Expr":
        """The time derivative of an expression in displacements, velocities, ψ and Ω."""
        return self.kinematics.rate(expression)

    def along(self, sensor: PlacedSensor, order: int) -> "sp.Expr":
        """Displacement, velocity or acceleration of the sensor's point along its axis."""
        k = self._of(sensor)
        if sensor.axis == "lag":
            return self._moved(k.lag(sensor.blade), order)
        roll = k.displacement("roll")
        if sensor.blade:
            motion = k.blade_point(sensor.blade, *sensor.position, sensor.deflection)
        else:
            arm = complex(*sensor.position)
            offset = arm.real + k.sp.I * arm.imag
            motion = k.hub() + (offset * (k.turn(roll) - 1) if offset != 0 else 0)
        vector = self._moved(motion, order)
        if sensor.feels_gravity:
            vector += k.sp.I * k.parameters["gravity"]
        frame_angle = {
            "fixed": k.zero,
            "tower_top": roll,
            "blade": k.blade_angle(sensor.blade) + sensor.slope * k.lag(sensor.blade) if sensor.blade else k.zero,
        }[sensor.frame]
        first, second = k.components(vector * k.turn(-frame_angle))
        return first if sensor.axis in ("x", "span") else second

    def turning(self, sensor: PlacedSensor) -> "sp.Expr":
        """The rate at which the sensor's part turns: the support rolls, a blade turns and lags as well."""
        k = self._of(sensor)
        turning = k.rate(k.displacement("roll"))
        return turning + (k.omega + k.rate(k.lag(sensor.blade)) if sensor.blade else 0)

    def spring_force(self, sensor: PlacedSensor) -> "sp.Expr":
        """Force or moment in the spring and damper of the sensor's part."""
        k = self._of(sensor)
        name = f"beta_{sensor.blade}" if sensor.blade else sensor.axis
        q = k.lag(sensor.blade) if sensor.blade else k.displacement(name)
        return k.parameters[f"k_{name}"] * q + k.parameters[f"c_{name}"] * k.rate(q)

    def _of(self, sensor: PlacedSensor) -> "Kinematics":
        """The kinematics, for a sensor that sits on this rotor."""
        k = self.kinematics
        if sensor.frame in ("nacelle", "tower"):
            raise ConfigurationError(
                f"sensor '{sensor.channel}' is in the frame '{sensor.frame}', which a rotor in its own plane does not "
                "know: expected fixed, tower_top, blade, or a turbine of the kind tower"
            )
        if sensor.blade > k.model.blades:
            raise ConfigurationError(
                f"sensor '{sensor.channel}' sits on blade {sensor.blade}, but the turbine has {k.model.blades} blades"
            )
        return k

    def _moved(self, position: "sp.Expr", order: int) -> "sp.Expr":
        """The position itself, its velocity or its acceleration."""
        for _ in range(order):
            position = self.kinematics.rate(position)
        return position

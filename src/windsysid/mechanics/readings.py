"""What a sensor reads, as an expression in the rotor's symbols."""

from typing import TYPE_CHECKING

from windsysid.errors import ConfigurationError

if TYPE_CHECKING:
    import sympy as sp

    from windsysid.mechanics.kinematics import Kinematics

from windsysid.mechanics.sensors import Sensor

__all__ = ["reading"]


def reading(sensor: Sensor, kinematics: "Kinematics") -> "sp.Expr":
    """The expression that `sensor` reads on the rotor with these kinematics."""
    k = kinematics
    if sensor.frame in ("nacelle", "tower"):
        raise ConfigurationError(
            f"sensor '{sensor.channel}' is in the frame '{sensor.frame}', which a rotor in its own plane does not know: expected 'fixed', "
            "'tower_top' or 'blade'; for side-side and fore-aft motion use a turbine file of the kind 'tower'"
        )
    if sensor.blade > k.model.blades:
        raise ConfigurationError(
            f"sensor '{sensor.channel}' sits on blade {sensor.blade}, but the turbine has {k.model.blades} blades"
        )
    if sensor.quantity == "angular_rate":
        turning = k.rate(k.displacement("roll"))
        return sensor.gain * (turning + (k.omega + k.rate(k.lag(sensor.blade)) if sensor.blade else 0))
    if sensor.quantity in ("moment", "strain"):
        name = f"beta_{sensor.blade}" if sensor.blade else sensor.axis
        q = k.displacement(name)
        return sensor.gain * (k.parameters[f"k_{name}"] * q + k.parameters[f"c_{name}"] * k.rate(q))
    if sensor.axis == "lag":
        return sensor.gain * _moved(k.lag(sensor.blade), sensor, k)
    roll = k.displacement("roll")
    if sensor.blade:
        motion = k.blade_point(sensor.blade, *sensor.position, sensor.deflection)
    else:
        arm = complex(*sensor.position)
        offset = arm.real + k.sp.I * arm.imag
        motion = k.hub() + (offset * (k.turn(roll) - 1) if offset != 0 else 0)
    vector = _moved(motion, sensor, k)
    if sensor.quantity == "acceleration" and sensor.feels_gravity:
        vector += k.sp.I * k.parameters["gravity"]
    frame_angle = {
        "fixed": k.zero,
        "tower_top": roll,
        "blade": k.blade_angle(sensor.blade) + sensor.slope * k.lag(sensor.blade) if sensor.blade else k.zero,
    }[sensor.frame]
    first, second = k.components(vector * k.turn(-frame_angle))
    return sensor.gain * (first if sensor.axis in ("x", "span") else second)


def _moved(position: "sp.Expr", sensor: Sensor, k: "Kinematics") -> "sp.Expr":
    """The position itself, its velocity or its acceleration, as the sensor's quantity asks."""
    for _ in range(("displacement", "velocity", "acceleration").index(sensor.quantity)):
        position = k.rate(position)
    return position

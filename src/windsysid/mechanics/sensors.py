"""Readings of instruments: each kind of sensor a class, with its reading, its unit and its rules.

A reading is an expression in displacements, velocities, accelerations, azimuth and loads. It is compiled with its
Jacobians with the equations of motion, and the simulator and the filters call that same function. An accelerometer
reads the total acceleration of its point, the effect of loads included; one that measures gravity reads the specific
force a − g along its own axis, in its own turning frame.

A mechanical model says how its parts move (`StructuralMotion`); a sensor says what it makes of that. A sensor of one's
own derives from `Sensor` or `PlacedSensor`, says its `quantity`, `unit` and `reading`, and is known to sensor lists
after `register_sensor`.
"""

import math
from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

if TYPE_CHECKING:
    import sympy as sp


__all__ = [
    "SENSORS", "TOWER_LOGGER", "Accelerometer", "AngularRateSensor", "DisplacementSensor", "MomentSensor",
    "PlacedSensor", "Sensor", "StrainGauge", "StructuralMotion", "VelocitySensor", "instrument_parameters",
    "noise_source", "register_sensor",
]  # fmt: skip


TOWER_LOGGER = "tower"
"""The logger that samples the rotor's azimuth: its clock is the record's."""

TOLERANCES = ("gain_tolerance", "alignment_tolerance", "clock_tolerance")
"""Fields of a sensor that say how well it is known."""


MIN_SIZE, MAX_SIZE = 1e-12, 1e12
"""Smallest and largest absolute value of a sensor's numbers other than zero, in the unit of its channel: from the noise
of the finest strain gauge to the moments of the largest turbine. Double precision can represent their squares."""


NOISE = "noise_"
"""Beginning of the name of a statistic that is the noise of sensors."""


def noise_source(name: str) -> str:
    """Name of the source of a noise whose statistic has this `name`, in archives, which hold names only; empty for any
    other statistic."""
    return name.removeprefix(NOISE) if name.startswith(NOISE) else ""


class StructuralMotion(Protocol):
    """Motion of a structure, in symbols: input of its sensors from a mechanical model."""

    @property
    def parameters(self) -> "Mapping[str, sp.Symbol]":
        """The model's parameters by name."""

    def displacement(self, name: str) -> "sp.Expr":
        """The displacement of a degree of freedom; 0 if it is locked."""

    def rate(self, expression: "sp.Expr") -> "sp.Expr":
        """The time derivative of an expression."""

    def along(self, sensor: "PlacedSensor", order: int) -> "sp.Expr":
        """The `order`-th derivative of the sensor's place, along its axis, and gravity if it measures it."""

    def turning(self, sensor: "PlacedSensor") -> "sp.Expr":
        """The rate [rad/s] at which the part turns on which the sensor sits."""

    def spring_force(self, sensor: "PlacedSensor") -> "sp.Expr":
        """Force or moment in what holds the part on which the sensor sits, along its axis."""


class Sensor(BaseModel):
    """Instrument on the turbine, and the channel of the record that holds its readings.

    Attributes
    ----------
    channel
        Name of the record's channel.
    quantity
        Measured quantity: the word that names the class in a sensor list.
    gain
        Reading per unit of the quantity.
    noise
        Standard deviation of the white noise of one sample, in the channel's unit.
    bias
        Prior standard deviation of an unknown offset, in the channel's unit; 0: none.
    drift
        Random walk of that offset: its standard deviation after one second, in the channel's unit per √s.
    gain_tolerance
        Relative standard deviation of the gain, by its calibration; 0: exact.
    logger
        Name of the logger that samples it. By default `TOWER_LOGGER` for sensors on the tower and ``rotor`` for those
        on blades, which rotate and seldom share a clock with the fixed part.
    clock_tolerance
        Standard deviation [s] of that logger's clock against the one that samples the rotor's azimuth, which is
        `TOWER_LOGGER`; 0: exactly synchronous. Of several sensors of a logger the largest tolerance counts.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    channel: str = Field(min_length=1)
    quantity: str
    gain: float = 1.0
    noise: float = Field(gt=0.0)
    bias: float = Field(default=0.0, ge=0.0)
    drift: float = Field(default=0.0, ge=0.0)
    gain_tolerance: float = Field(default=0.01, ge=0.0, le=1.0)
    logger: str = ""
    clock_tolerance: float = Field(default=0.001, ge=0.0)

    @field_validator("*", mode="after")
    @classmethod
    def _check_size(cls, value: Any) -> Any:
        if isinstance(value, float) and value != 0.0 and not MIN_SIZE <= abs(value) <= MAX_SIZE:
            raise ValueError(f"expected a size of {MIN_SIZE:g} … {MAX_SIZE:g} in the unit of the channel, or zero")
        return value

    @property
    @abstractmethod
    def unit(self) -> str:
        """SI unit of its channel."""

    @abstractmethod
    def reading(self, motion: StructuralMotion) -> "sp.Expr":
        """Reading of a structure in `motion`, without noise and offset."""

    @property
    def blade(self) -> int:
        """Number of the blade it sits on; 0 for the tower."""
        return 0

    @property
    def sampled_by(self) -> str:
        """Name of its logger."""
        return self.logger or ("rotor" if self.blade else TOWER_LOGGER)

    @property
    def alignment(self) -> float:
        """Standard deviation [rad] of the angle by which its axis may be off in the plane of motion; 0: none."""
        return 0.0

    def across(self, motion: StructuralMotion) -> "sp.Expr | None":
        """Reading of `motion` if rotated by 90°; None if the rotation changes nothing that is modelled."""
        return None

    def exact(self) -> Self:
        """Sensor without tolerances."""
        return self.model_copy(update={name: 0.0 for name in TOLERANCES if name in type(self).model_fields})

    @property
    def directions(self) -> frozenset[str]:
        """Axes of the support along which it sees motion: x, y, z."""
        return frozenset()

    @property
    def needed_inputs(self) -> tuple[str, ...]:
        """Inputs of the model that a record must tell for its sake."""
        return ()

    @property
    def noise_group(self) -> str:
        """Name of the noise statistic: sensors of one group have equal noise."""
        return f"{NOISE}{'blade' if self.blade else 'tower'}_{self.quantity}"

    @property
    def structure(self) -> str:
        """Text on which its expression depends (noise and bias are numbers of the filter, not of the expression)."""
        fields = sorted(self.model_dump(exclude={"channel", "noise", "bias", "drift", "logger", *TOLERANCES}).items())
        return f"{type(self).__name__} {fields!r}"

    def accepts(self, unit: str) -> bool:
        """True if its channel may be in this unit."""
        return unit == self.unit


class PlacedSensor(Sensor):
    """Sensor at a point of the tower or of a blade, along an axis.

    Attributes
    ----------
    point
        ``tower`` (the support's top, at the hub) or ``blade_1`` … ``blade_N``.
    axis
        ``x``, ``y`` of the frame; ``span`` or ``tangential`` (in the sense of rotation) in the frame ``blade``; ``lag``
        for a blade's lag angle itself. On a `TowerModel`: ``x`` (side-side) and ``z`` (fore-aft, downwind) in the frame
        ``nacelle``, ``bearing`` in the frame ``tower``.
    frame
        ``fixed``, ``tower_top`` (rolls with the support) or ``blade`` (rotates with the blade). On a `TowerModel`:
        ``nacelle`` (yaws with it) or ``tower`` (does not).
    bearing_deg
        Direction of the axis ``bearing``: compass bearing [deg], counted as the yaw channel counts.
    position
        Position [m]: from the hub centre along x and y of the tower top; on a blade, from its link along the blade and
        across it.
    deflection, slope
        For a blade that bends instead of hinging: displacement of the sensor across the blade per unit lag angle
        [m/rad], and its rotation [rad/rad]. A rigid blade's by default: its distance from the link, and 1.
    feels_gravity
        True for an accelerometer that measures specific force, as real ones do.
    alignment_tolerance
        Standard deviation [deg] of the angle of its axis, within the plane in which the model moves; 0: exact. A lag
        angle has no axis.
    may_feel_gravity
        True for classes whose sensors can measure gravity.
    """

    may_feel_gravity: ClassVar[bool] = False

    point: str = Field(pattern=r"^(tower|blade_[1-9][0-9]*)$")
    axis: Literal["x", "y", "z", "span", "tangential", "lag", "bearing"]
    frame: Literal["fixed", "tower_top", "blade", "nacelle", "tower"] = "fixed"
    bearing_deg: float = 0.0
    position: tuple[float, float] = (0.0, 0.0)
    deflection: float | None = Field(default=None, gt=0.0)
    slope: float = Field(default=1.0, ge=0.0)
    feels_gravity: bool = False
    alignment_tolerance: float = Field(default=2.0, ge=0.0, le=45.0)

    @model_validator(mode="after")
    def _axis_belongs_to_frame(self) -> "PlacedSensor":
        self._check_axis(1 if self.blade else 0)
        if not self.blade and (self.deflection is not None or self.slope != 1.0):
            raise ValueError(
                "'deflection' and 'slope' describe a bending blade: remove them from a sensor on the tower"
            )
        if self.feels_gravity and not self.may_feel_gravity:
            raise ValueError(f"'feels_gravity' describes an accelerometer: remove it from a sensor of {self.quantity}")
        return self

    def _check_axis(self, place: int) -> None:
        """Refuse an axis that its frame does not have on the tower (place 0) or on a blade (1)."""
        axes, places = _AXES[self.frame][place], ("the tower", "a blade")
        if not axes:
            raise ValueError(
                f"the frame '{self.frame}' belongs to a sensor on {places[1 - place]}, got point '{self.point}'"
            )
        if self.axis not in axes:
            frames = [frame for frame, there in _AXES.items() if self.axis in there[place]]
            hint = f": that axis belongs to the frame {' or '.join(frames)}" if frames else ""
            raise ValueError(
                f"on {places[place]} the frame '{self.frame}' has the axes {', '.join(axes)}, got '{self.axis}'{hint}"
            )

    @property
    def blade(self) -> int:
        """Number of the blade it sits on; 0 for the tower."""
        return int(self.point.removeprefix("blade_")) if self.point.startswith("blade_") else 0

    @property
    def directions(self) -> frozenset[str]:
        """Axes of the support along which it sees motion: both horizontal ones for a bearing."""
        return frozenset(("x", "z")) if self.axis == "bearing" else frozenset((self.axis,))

    @property
    def turned(self) -> "tuple[int, PlacedSensor] | None":
        """The sensor with its axis turned by 90° in the plane of motion, towards the second axis of its frame, and a
        sign; None where that changes nothing that is modelled."""
        if self.axis not in _TURNED:
            return None
        sign, axis = _TURNED[self.axis]
        if self.axis == "bearing":
            return sign, self.model_copy(update={"bearing_deg": self.bearing_deg + 90.0})
        return sign, self.model_copy(update={"axis": "z" if self.frame == "nacelle" and self.axis == "x" else axis})

    @property
    def alignment(self) -> float:
        """Standard deviation [rad] of the angle of its axis."""
        return math.radians(self.alignment_tolerance) if self.turned else 0.0

    def across(self, motion: StructuralMotion) -> "sp.Expr | None":
        """Reading of `motion` if its axis were rotated by 90°."""
        if self.turned is None:
            return None
        sign, other = self.turned
        return sign * other.reading(motion)

    @property
    def needed_inputs(self) -> tuple[str, ...]:
        """The yaw, for a sensor that does not yaw with the nacelle."""
        return ("nacelle_yaw",) if self.frame == "tower" else ()


_AXES: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "fixed": (("x", "y"), ("x", "y", "lag")),
    "tower_top": (("x", "y"), ("x", "y", "lag")),
    "blade": ((), ("span", "tangential", "lag")),
    "nacelle": (("x", "z"), ()),
    "tower": (("bearing",), ()),
}
"""The axes of each frame, on the tower and on a blade."""

_TURNED: Mapping[str, tuple[int, str]] = {
    "x": (1, "y"), "y": (-1, "x"), "z": (-1, "x"), "span": (1, "tangential"), "tangential": (-1, "span"),
    "bearing": (1, "bearing"),
}  # fmt: skip
"""The axis that each becomes when it is turned by 90° in its plane, and with which sign."""

SENSORS: dict[str, type[Sensor]] = {}
"""The sensors that a list can name, by quantity."""

S = TypeVar("S", bound=Sensor)


def register_sensor(sensor: type[S]) -> type[S]:
    """Register a class of sensors by its `quantity`, for sensor lists; for use as a decorator of the class.

    Parameters
    ----------
    sensor : type
        A class derived from `Sensor`.

    Returns
    -------
    type
        The class itself.

    Examples
    --------
    >>> from typing import ClassVar, Literal
    >>> import windsysid as ws
    >>> @ws.models.register_sensor
    ... class JerkSensor(ws.models.PlacedSensor):
    ...     quantity: Literal["jerk"] = "jerk"
    ...     unit: ClassVar[str] = "m/s^3"
    ...     def reading(self, motion):
    ...         return self.gain * motion.along(self, 3)
    >>> JerkSensor(channel="top_jerk", point="tower", axis="x", noise=0.01).unit
    'm/s^3'
    """
    SENSORS[sensor.model_fields["quantity"].default] = sensor
    return sensor


class _MotionSensor(PlacedSensor):
    """Displacement, velocity or acceleration: [m …], or [rad …] along the axis ``lag``.

    Attributes
    ----------
    order
        How often the displacement is differentiated.
    """

    order: ClassVar[int]

    @property
    def unit(self) -> str:
        """SI unit of its channel."""
        return ("rad" if self.axis == "lag" else "m") + ("", "/s", "/s^2")[self.order]

    def reading(self, motion: StructuralMotion) -> "sp.Expr":
        """The gain times the motion along the axis."""
        return self.gain * motion.along(self, self.order)


@register_sensor
class Accelerometer(_MotionSensor):
    """Accelerometer along an axis of the tower or of a blade; a real one is sensitive to gravity.

    Examples
    --------
    >>> import windsysid as ws
    >>> sensor = ws.models.Accelerometer(
    ...     channel="tower_x_acceleration", point="tower", axis="x", frame="nacelle", noise=0.005
    ... )
    >>> record = ws.simulate("tower", duration=600.0, rate=5.0, seed=1)
    >>> ws.identify(record, "tower", sensors=[sensor], formulation="spectral").sensors
    ('tower_x_acceleration',)
    """

    quantity: Literal["acceleration"] = "acceleration"
    may_feel_gravity: ClassVar[bool] = True
    order: ClassVar[int] = 2


@register_sensor
class VelocitySensor(_MotionSensor):
    """Velocity sensor along an axis of the tower or of a blade.

    Examples
    --------
    >>> import windsysid as ws
    >>> ws.models.VelocitySensor(channel="blade_1_lag_rate", point="blade_1", axis="lag", noise=1e-3).unit
    'rad/s'
    """

    quantity: Literal["velocity"] = "velocity"
    order: ClassVar[int] = 1


@register_sensor
class DisplacementSensor(_MotionSensor):
    """Displacement sensor along an axis of the tower or of a blade.

    Examples
    --------
    >>> import windsysid as ws
    >>> ws.models.DisplacementSensor(channel="top_x", point="tower", axis="x", frame="nacelle", noise=1e-3).unit
    'm'
    """

    quantity: Literal["displacement"] = "displacement"
    order: ClassVar[int] = 0


@register_sensor
class AngularRateSensor(PlacedSensor):
    """Gyroscope in the plane of the rotor.

    Examples
    --------
    >>> import windsysid as ws
    >>> ws.models.AngularRateSensor(channel="blade_1_rate", point="blade_1", axis="lag", noise=1e-4).unit
    'rad/s'
    """

    quantity: Literal["angular_rate"] = "angular_rate"

    @property
    def unit(self) -> str:
        """SI unit of its channel."""
        return "rad/s"

    @property
    def turned(self) -> None:
        """It reads the same along any axis."""
        return None

    def reading(self, motion: StructuralMotion) -> "sp.Expr":
        """The gain times the rate at which its part turns in `motion`."""
        return self.gain * motion.turning(self)


@register_sensor
class MomentSensor(PlacedSensor):
    """Sensor of the moment in the lag spring and damper of a blade.

    On the support it reads the force in spring and damper, times the lever arm `gain`.

    Examples
    --------
    >>> import windsysid as ws
    >>> ws.models.MomentSensor(channel="root_1", point="blade_1", axis="lag", noise=1e3, gain_tolerance=0.05).unit
    'N*m'
    """

    quantity: Literal["moment"] = "moment"

    @property
    def unit(self) -> str:
        """SI unit of its channel."""
        return "N*m"

    @property
    def turned(self) -> tuple[int, PlacedSensor] | None:
        """On a blade it reads the lag spring, whatever its axis."""
        return None if self.blade else super().turned

    def reading(self, motion: StructuralMotion) -> "sp.Expr":
        """The gain times force or moment in `motion`."""
        return self.gain * motion.spring_force(self)


@register_sensor
class StrainGauge(MomentSensor):
    """Strain gauge: a `MomentSensor` with a `gain` [1/(N·m)] or [1/N]; its channel may have any unit of a bridge.

    Examples
    --------
    >>> import windsysid as ws
    >>> gauge = ws.models.StrainGauge(channel="root_1", point="blade_1", axis="lag", gain=2e-10, noise=1e-7)
    >>> gauge.unit, gauge.accepts("mV/V")
    ('1', True)
    """

    quantity: Literal["strain"] = "strain"  # type: ignore[assignment]

    @property
    def unit(self) -> str:
        """SI unit of its channel."""
        return "1"

    def accepts(self, unit: str) -> bool:
        """Any: the gain is in the channel's own unit."""
        return True


def instrument_parameters(sensor: int) -> tuple[str, str]:
    """Names of the gain error of a sensor, counted from 0 (a share), and of its angle error in the plane of motion
    [rad]."""
    return f"sensor_{sensor + 1}_gain", f"sensor_{sensor + 1}_turn"

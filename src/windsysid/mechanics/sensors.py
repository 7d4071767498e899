"""What an instrument reads: point, axis, frame, whether it feels gravity, noise and bias.

A reading is an expression in displacements, velocities, accelerations, azimuth and loads. It is compiled with its
Jacobians beside the equations of motion, and the simulator and the filters call that same function. An accelerometer
reads the total acceleration of its point, the effect of loads included; one that feels gravity reads the specific
force a − g along its own axis, in its own turning frame.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from windsysid.configuration import parse_toml
from windsysid.errors import ConfigurationError

if TYPE_CHECKING:
    pass


__all__ = ["Sensor", "first_problem", "read_sensors"]

Quantity = Literal["acceleration", "velocity", "displacement", "angular_rate", "moment", "strain"]


class Sensor(BaseModel):
    """One instrument on the turbine and the channel of the record that holds its readings.

    Attributes
    ----------
    channel
        Name of the record's channel.
    quantity
        ``acceleration``, ``velocity``, ``displacement`` [m … or rad … for the axis ``lag``], ``angular_rate`` [rad/s],
        ``moment`` [N·m] (in the lag spring and damper of a blade; for the support, the force in its spring and damper
        times `gain`, its lever arm), ``strain`` (the same times a `gain` [1/(N·m)] or [1/N]).
    point
        ``tower`` (the support's top, where the hub sits) or ``blade_1`` … ``blade_N``.
    axis
        ``x``, ``y`` of the frame; ``span`` or ``tangential`` (in the sense of rotation) in the frame ``blade``;
        ``lag`` for a blade's lag angle itself. On a `TowerModel`: ``x`` (side-side) and ``z`` (fore-aft, downwind) in the frame
        ``nacelle``, ``bearing`` in the frame ``tower``.
    frame
        ``fixed``, ``tower_top`` (rolls with the support) or ``blade`` (turns with the blade). On a `TowerModel`:
        ``nacelle`` (yaws with it) or ``tower`` (does not).
    bearing_deg
        Where the axis ``bearing`` points: compass bearing [deg], counted as the yaw channel counts.
    position
        Where it sits [m]: from the hub centre along x and y of the tower top; on a blade, from its link along the
        blade and across it.
    deflection, slope
        For a blade that bends instead of hinging: how far the sensor moves across the blade per unit lag angle
        [m/rad], and how far it turns [rad/rad]. A rigid blade's by default: its distance from the link, and 1.
    feels_gravity
        True for a real accelerometer.
    gain
        Reading per unit of the quantity.
    noise
        Standard deviation of the white noise of one sample, in the channel's unit.
    bias
        Prior standard deviation of an unknown offset, in the channel's unit; 0: none.
    drift
        How fast that offset wanders: its standard deviation after one second, in the channel's unit per √s.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    channel: str = Field(min_length=1)
    quantity: Quantity
    point: str = Field(pattern=r"^(tower|blade_[1-9][0-9]*)$")
    axis: Literal["x", "y", "z", "span", "tangential", "lag", "bearing"]
    frame: Literal["fixed", "tower_top", "blade", "nacelle", "tower"] = "fixed"
    bearing_deg: float = 0.0
    position: tuple[float, float] = (0.0, 0.0)
    deflection: float | None = Field(default=None, gt=0.0)
    slope: float = Field(default=1.0, ge=0.0)
    feels_gravity: bool = False
    gain: float = 1.0
    noise: float = Field(gt=0.0)
    bias: float = Field(default=0.0, ge=0.0)
    drift: float = Field(default=0.0, ge=0.0)

    @model_validator(mode="after")
    def _axis_belongs_to_frame(self) -> "Sensor":
        on_blade = self.point.startswith("blade")
        if self.axis in ("span", "tangential") and self.frame != "blade":
            raise ValueError(f"axis '{self.axis}' belongs to the frame 'blade', got frame '{self.frame}'")
        if self.axis in ("x", "y") and self.frame == "blade":
            raise ValueError(f"the frame 'blade' has the axes 'span' and 'tangential', got '{self.axis}'")
        if self.axis == "z" and self.frame != "nacelle":
            raise ValueError(f"axis 'z' (fore-aft) belongs to the frame 'nacelle', got frame '{self.frame}'")
        if self.axis == "bearing" and self.frame != "tower":
            raise ValueError(f"axis 'bearing' belongs to the frame 'tower', got frame '{self.frame}'")
        if self.frame == "nacelle" and self.axis not in ("x", "z"):
            raise ValueError(f"the frame 'nacelle' has the axes 'x' and 'z', got '{self.axis}'")
        if self.frame == "tower" and self.axis != "bearing":
            raise ValueError(f"the frame 'tower' has the axis 'bearing' only, got '{self.axis}'")
        if on_blade and self.frame in ("nacelle", "tower"):
            raise ValueError(f"the frame '{self.frame}' belongs to a sensor on the tower, got point '{self.point}'")
        if not on_blade and (self.frame == "blade" or self.axis == "lag"):
            raise ValueError(
                "a sensor on the tower reads x or y in the frame 'fixed' or 'tower_top', x or z in the frame 'nacelle', "
                "or along a bearing in the frame 'tower'"
            )
        if not on_blade and (self.deflection is not None or self.slope != 1.0):
            raise ValueError(
                "'deflection' and 'slope' describe a bending blade: remove them from a sensor on the tower"
            )
        return self

    @property
    def blade(self) -> int:
        """Number of the blade it sits on; 0 for the tower."""
        return int(self.point.removeprefix("blade_")) if self.point.startswith("blade_") else 0

    @property
    def structure(self) -> str:
        """What its expression depends on, as text (noise and bias are numbers of the filter, not of the expression)."""
        return repr(sorted(self.model_dump(exclude={"channel", "noise", "bias", "drift"}).items()))

    @property
    def unit(self) -> str:
        """SI unit of its channel."""
        if self.quantity == "angular_rate":
            return "rad/s"
        if self.quantity in ("moment", "strain"):
            return {"moment": "N*m", "strain": "1"}[self.quantity]
        length = "rad" if self.axis == "lag" else "m"
        return length + {"displacement": "", "velocity": "/s", "acceleration": "/s^2"}[self.quantity]


def read_sensors(path: str | Path) -> tuple[Sensor, ...]:
    """Read a sensor list from TOML: one ``[[sensor]]`` table per channel, keys as in `Sensor`.

    Raises
    ------
    ConfigurationError
        In one line: the file, the sensor, what was expected and what was got.
    """
    path = Path(path)
    try:
        content = parse_toml(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{path}: expected a TOML file with [[sensor]] tables, got: {error}") from None
    unknown = set(content) - {"sensor"}
    if unknown or not isinstance(content.get("sensor"), list):
        raise ConfigurationError(
            f"{path}: expected [[sensor]] tables and nothing else, got {', '.join(sorted(content)) or 'an empty file'}"
        )
    return parse_sensors(content["sensor"], str(path))


def parse_sensors(tables: Sequence[object], source: str) -> tuple[Sensor, ...]:
    """Validate sensor tables read from `source`."""
    if not isinstance(tables, list | tuple):
        raise ConfigurationError(f"{source}: expected [[sensor]] tables, one per channel, got {tables!r}")
    sensors: list[Sensor] = []
    for number, table in enumerate(tables, start=1):
        try:
            sensors.append(Sensor.model_validate(table))
        except ValidationError as error:
            raise ConfigurationError(f"{source}: sensor {number}: {first_problem(error)}") from None
    channels = [sensor.channel for sensor in sensors]
    for channel in channels:
        if channels.count(channel) > 1:
            raise ConfigurationError(
                f"{source}: channel '{channel}' is listed {channels.count(channel)} times: list it once"
            )
    return tuple(sensors)


def first_problem(error: ValidationError) -> str:
    """The first problem of a pydantic error in one line: key, what was expected, what was got.

    An unknown key comes first: it is usually the misspelt one that is then missing. Items of a list are counted from 1.
    """
    details = error.errors()
    detail = next((d for d in details if d["type"] == "extra_forbidden"), details[0])
    where = ".".join(str(part + 1 if isinstance(part, int) else part) for part in detail["loc"])
    if detail["type"] == "extra_forbidden":
        return f"unknown key '{where}': remove it or correct its spelling"
    if detail["type"] == "missing":
        return f"'{where}' is missing: add it"
    message = detail["msg"].removeprefix("Value error, ")
    got = detail.get("input")
    shown = f", got {got!r:.80}" if isinstance(got, str | int | float | bool) else ""
    return f"{where}: {message}{shown}" if where else message

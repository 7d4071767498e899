"""Building blocks of all turbine files: tables, and values with their units."""

import math
from abc import abstractmethod
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from windsysid.errors import ConfigurationError
from windsysid.mechanics.sensors import Sensor
from windsysid.turbine.turbine import MASS_TOLERANCE, Site, Turbine
from windsysid.units import parse_quantity, si_unit

__all__ = [
    "AngularDamping", "AngularStiffness", "Damping", "File", "FileTable", "FirstMoment", "Inertia", "Length", "Mass",
    "NotNegative", "Positive", "RotorEntry", "Stiffness", "quantity", "read_quantity",
]  # fmt: skip

RANGES: dict[str, tuple[float, float, str]] = {
    "s": (1e-4, 1e6, "from a sampling interval to the length of a record"),
    "kg": (1e-6, 1e9, "from a model's blade to a floating platform"),
    "kg*m": (1e-9, 1e12, "from a model's blade to a floating platform"),
    "kg*m^2": (1e-12, 1e15, "from a model's blade to a floating platform"),
    "N": (1e-9, 1e10, "from forces on a model to a thousand times the thrust of a large rotor"),
    "N*m": (1e-9, 1e13, "from moments on a model to a thousand times those at a large tower's foot"),
    "N/m": (1e-6, 1e15, "from a model to a rigid foundation"),
    "N*m/rad": (1e-9, 1e18, "from a model to a rigid foundation"),
    "N*s": (1e-9, 1e15, "from a model to a rigid foundation"),
    "N*s/m": (1e-9, 1e15, "from a model to a rigid foundation"),
    "N*m*s/rad": (1e-12, 1e18, "from a model to a rigid foundation"),
    "Hz": (1e-4, 2.5e4, "from a period of hours to the fastest rate of a simulation"),
    "rad/s": (1e-6, 1e4, "from standstill to 100 000 rpm"),
    "m": (1e-6, 1e4, "from a micrometre to ten kilometres"),
    "rad": (1e-9, 1e3, "from an instrument's resolution to many turns"),
    "rad/m": (1e-9, 1e3, "from an instrument's resolution to many turns in a metre"),
    "m/s^2": (1e-6, 1e4, "up to a thousand times the Earth's gravity"),
    "1": (1e-9, 1.0, "as a ratio: 1 is 100 %"),
}
"""Smallest and largest absolute values other than zero in a turbine file, by SI unit, and their reason. Other values
are typing errors or have a wrong unit. Squares and ratios of values in range fit double precision."""

MIN_RELATIVE_STD = 1e-6
"""Smallest relative standard deviation of a prior: no stiffness is known better, and its information, the inverse
square, leaves four of 16 digits for that of a record."""


def read_quantity(text: str, unit: str) -> float:
    """Read ``"1800 N/m"`` as SI, and refuse a quantity other than that of `unit`, or a size out of its range.

    Raises
    ------
    ConfigurationError
        If the quantity or the size is not as expected.
    """
    value = parse_quantity(text, unit)
    si = si_unit(unit)
    low, high, why = RANGES.get(si, (0.0, math.inf, ""))
    if value and not low <= abs(value) <= high:
        shown = "" if si == "1" else f" {si}"
        raise ConfigurationError(f"expected a size of {low:g} … {high:g}{shown} ({why})")
    return value


def quantity(unit: str) -> BeforeValidator:
    """Make a validator of a table's field from `read_quantity`."""

    def convert(value: Any) -> float:
        if not isinstance(value, str):
            raise ValueError(f'expected a value with its unit, such as "1.5 {unit}"')
        try:
            return read_quantity(value, unit)
        except ConfigurationError as error:
            raise ValueError(str(error)) from None

    return BeforeValidator(convert)


Positive, NotNegative, AnyValue = Field(gt=0.0), Field(ge=0.0), Field()
Mass = Annotated[float, quantity("kg"), Positive]
FirstMoment = Annotated[float, quantity("kg*m"), Positive]
Inertia = Annotated[float, quantity("kg*m^2"), Positive]
Length = Annotated[float, quantity("m"), NotNegative]
Stiffness = Annotated[float, quantity("N/m"), NotNegative]
Damping = Annotated[float, quantity("N*s/m"), AnyValue]
AngularStiffness = Annotated[float, quantity("N*m/rad"), NotNegative]
AngularDamping = Annotated[float, quantity("N*m*s/rad"), AnyValue]


class FileTable(BaseModel):
    """A table of a turbine file: a key that it does not know is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, defer_build=True)


def spread(widest: float) -> AfterValidator:
    """Make a validator that accepts relative standard deviations from `MIN_RELATIVE_STD` to `widest`."""

    def check(value: float) -> float:
        if not MIN_RELATIVE_STD <= value <= widest:
            raise ValueError(f"expected a relative standard deviation of {MIN_RELATIVE_STD:g} … {widest:g}")
        return value

    return AfterValidator(check)


class PriorEntry(FileTable):
    stiffness: Annotated[float, spread(3.0)] = 0.3
    damping: Annotated[float, spread(10.0)] = 0.3


class Tolerances(FileTable):
    """Uncertainty of the file's numbers, as standard deviations."""

    masses: Annotated[float, quantity("%"), Field(ge=0.0, le=1.0)] = MASS_TOLERANCE


class File(FileTable):
    """Content of every turbine file."""

    name: str
    description: str
    source: str
    assumed: tuple[str, ...] = ()
    prior: PriorEntry = PriorEntry()
    tolerances: Tolerances = Tolerances()
    site: Site = "onshore"
    odds: dict[str, Annotated[float, Field(gt=0.0, allow_inf_nan=False)]] = {}

    @abstractmethod
    def turbine(self, sensors: tuple[Sensor, ...]) -> Turbine:
        """The turbine that the file describes, with these sensors."""


class RotorEntry(FileTable):
    """A rotor of which only the speed matters."""

    speed: Annotated[float, quantity("rad/s"), NotNegative]

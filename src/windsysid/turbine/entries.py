"""What all turbine files are made of: tables, and values with their units."""

from abc import abstractmethod
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from windsysid.errors import ConfigurationError
from windsysid.mechanics.sensors import Sensor
from windsysid.turbine.turbine import MASS_TOLERANCE, Turbine
from windsysid.units import parse_quantity

__all__ = [
    "AngularDamping", "AngularStiffness", "Damping", "File", "FirstMoment", "Inertia", "Length", "Mass", "NotNegative",
    "Positive", "Rotor", "Stiffness", "Table", "quantity",
]  # fmt: skip


def quantity(unit: str) -> BeforeValidator:
    """Read ``"1800 N/m"`` as SI, and refuse any other quantity than the one of `unit`."""

    def convert(value: Any) -> float:
        if not isinstance(value, str):
            raise ValueError(f'expected a value with its unit, such as "1.5 {unit}"')
        try:
            return parse_quantity(value, unit)
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


class Table(BaseModel):
    """A table of a turbine file: a key that it does not know is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Prior(Table):
    stiffness: float = Field(default=0.3, gt=0.0, le=3.0)
    damping: float = Field(default=0.3, gt=0.0, le=10.0)


class Tolerances(Table):
    """How well the file's numbers are known, as standard deviations."""

    masses: Annotated[float, quantity("%"), Field(ge=0.0, le=1.0)] = MASS_TOLERANCE


class File(Table):
    """What every turbine file says."""

    name: str
    description: str
    source: str
    assumed: tuple[str, ...] = ()
    prior: Prior = Prior()
    tolerances: Tolerances = Tolerances()

    @abstractmethod
    def turbine(self, sensors: tuple[Sensor, ...]) -> Turbine:
        """The turbine that the file describes, with these sensors."""


class Rotor(Table):
    """A rotor of which only the speed matters."""

    speed: Annotated[float, quantity("rad/s"), NotNegative]

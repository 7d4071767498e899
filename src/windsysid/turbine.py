"""A turbine as numbers: masses, dimensions, reference coefficients, usual instruments; TOML in and out.

Every value in a turbine file is written with its unit (``k_x = "1800 N/m"``) and is SI inside. Coefficients are
references: the prior is centred on them, and results are compared with them.
"""

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from windsysid.errors import ConfigurationError, OutputError
from windsysid.loads import GaussMarkov
from windsysid.mechanics.rotor import RotorModel
from windsysid.mechanics.sensors import Sensor, first_problem, parse_sensors
from windsysid.units import is_same_quantity, to_si

__all__ = ["Turbine", "load_turbine", "packaged_turbines", "write_turbine"]


@dataclass(frozen=True)
class Turbine:
    """A turbine in SI units.

    Attributes
    ----------
    name, description, source
        Text; `source` says where the numbers come from.
    assumed
        Names of the values that nobody published.
    model
        Which degrees of freedom move.
    values
        Every parameter of the model: masses [kg], first moments [kg·m], inertias [kg·m²], stiffness, damping, geometry.
    rotor_speed
        Usual rotor speed [rad/s].
    spread
        Relative prior standard deviation of stiffness and of damping.
    loads
        Random loads for simulation and the joint formulation.
    sensors
        The instruments usually fitted.
    tip_lever
        ℓ [m]: lag angles times ℓ are in-plane tip deflections; 0 where the tip coordinate is not used.
    """

    name: str
    description: str
    source: str
    assumed: tuple[str, ...]
    model: RotorModel
    values: Mapping[str, float]
    rotor_speed: float
    spread: tuple[float, float]
    loads: tuple[GaussMarkov, ...]
    sensors: tuple[Sensor, ...]
    tip_lever: float = 0.0

    @property
    def coefficients(self) -> dict[str, float]:
        """Reference value of every coefficient of the free degrees of freedom, SI."""
        return {name: self.values[name] for name in self.model.coefficients}

    def inertia(self, coordinate: str) -> float:
        """Mass [kg] or inertia [kg·m²] that moves with one degree of freedom when the others are held."""
        v = self.values
        if coordinate.startswith("beta_"):
            return v["blade_inertia_" + coordinate.removeprefix("beta_")]
        total = 0.0
        for i in self.model.blade_numbers:
            m, d = v[f"blade_mass_{i}"], v["hinge_offset"]
            about_hub = v[f"blade_inertia_{i}"] + 2.0 * d * v[f"blade_first_moment_{i}"] + m * d**2
            total += about_hub if coordinate == "roll" else m
            if coordinate == "x" and self.model.roll == "tied":
                total += v["kappa"] ** 2 * about_hub
        own = {"x": v["hub_mass_x"], "y": v["hub_mass_y"], "roll": v["roll_inertia"]}[coordinate]
        return (
            total
            + own
            + (v["kappa"] ** 2 * v["roll_inertia"] if coordinate == "x" and self.model.roll == "tied" else 0.0)
        )

    def natural_frequency(self, coordinate: str) -> float:
        """ω [rad/s] of one degree of freedom on its own spring (and, for a blade, its centrifugal stiffening)."""
        stiffness = self.values[f"k_{coordinate}"]
        if coordinate.startswith("beta_"):
            i = coordinate.removeprefix("beta_")
            stiffness += self.values[f"blade_first_moment_{i}"] * self.values["hinge_offset"] * self.rotor_speed**2
        return math.sqrt(stiffness / self.inertia(coordinate))

    def with_values(self, values: Mapping[str, float]) -> "Turbine":
        """The same turbine with other values, such as identified coefficients."""
        unknown = set(values) - set(self.values)
        if unknown:
            raise ConfigurationError(f"turbine '{self.name}' has no parameter '{min(unknown)}'")
        return replace(self, values={**self.values, **values})

    def with_model(self, model: RotorModel) -> "Turbine":
        """The same turbine with other degrees of freedom."""
        return replace(self, model=model)


def write_turbine(turbine: Turbine, path: str | Path, *, overwrite: bool = False) -> None:
    """Write a turbine as TOML, every value with its unit, so that `load_turbine` gives it back.

    Raises
    ------
    OutputError
        If the file is there already and `overwrite` is off, or it cannot be written.
    """
    import tomli_w

    path = Path(path)
    if path.exists() and not overwrite:
        raise OutputError(f"turbine file {path} is already there: choose another name, or overwrite it")
    try:
        path.write_text(tomli_w.dumps(_tables(turbine)), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"turbine file {path} cannot be written: {error.strerror}; choose another folder") from None


def packaged_turbines() -> tuple[str, ...]:
    """Names of the turbines that come with windsysid."""
    folder = resources.files("windsysid") / "turbines"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def load_turbine(name_or_path: str | Path) -> Turbine:
    """Load a packaged turbine by name, or any turbine from a TOML file.

    Raises
    ------
    ConfigurationError
        In one line: what was wrong, what was expected, what was got.
    """
    text = str(name_or_path)
    if text in packaged_turbines():
        source = resources.files("windsysid") / "turbines" / f"{text}.toml"
        return _parse(source.read_text(encoding="utf-8"), text)
    path = Path(name_or_path)
    if path.suffix != ".toml":
        raise ConfigurationError(
            f"no turbine '{text}': expected one of {', '.join(packaged_turbines())}, or the path of a .toml file"
        )
    try:
        return _parse(path.read_text(encoding="utf-8"), text)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"turbine file {text}: cannot be read ({error}); check the path") from None


def _parse(text: str, source: str) -> Turbine:
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigurationError(f"turbine file {source}: expected TOML, got: {error}") from None
    sensors = content.pop("sensor", [])
    try:
        file = _File.model_validate(content)
    except ValidationError as error:
        raise ConfigurationError(f"turbine file {source}: {first_problem(error)}") from None
    return file.turbine(parse_sensors(sensors, f"turbine file {source}"))


def _quantity(unit: str) -> BeforeValidator:
    """Read ``"1800 N/m"`` as SI, and refuse any other quantity than the one of `unit`."""

    def convert(value: Any) -> float:
        if not isinstance(value, str):
            raise ValueError(f'expected a value with its unit, such as "1.5 {unit}"')
        number, _, written = value.strip().partition(" ")
        try:
            amount = float(number)
        except ValueError:
            raise ValueError(f'expected a number and a unit, such as "1.5 {unit}"') from None
        if not math.isfinite(amount):
            raise ValueError(f'expected a finite number, such as "1.5 {unit}"')
        if not written.strip():
            raise ValueError(f"the unit is missing: write it behind the number, in {unit}")
        try:
            matches = is_same_quantity(written, unit)
        except ConfigurationError as error:
            raise ValueError(str(error)) from None
        if not matches:
            raise ValueError(f"expected a unit of the same quantity as {unit}")
        return to_si(amount, written)

    return BeforeValidator(convert)


Positive, NotNegative, AnyValue = Field(gt=0.0), Field(ge=0.0), Field()
Mass = Annotated[float, _quantity("kg"), Positive]
FirstMoment = Annotated[float, _quantity("kg*m"), Positive]
Inertia = Annotated[float, _quantity("kg*m^2"), Positive]
Length = Annotated[float, _quantity("m"), NotNegative]
Stiffness = Annotated[float, _quantity("N/m"), NotNegative]
Damping = Annotated[float, _quantity("N*s/m"), AnyValue]
AngularStiffness = Annotated[float, _quantity("N*m/rad"), NotNegative]
AngularDamping = Annotated[float, _quantity("N*m*s/rad"), AnyValue]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Model(_Table):
    blades: int = Field(ge=1, le=12)
    x: Literal["free", "locked"] = "free"
    y: Literal["free", "locked"] = "free"
    roll: Literal["free", "locked", "tied"] = "locked"
    lag: Literal["free", "locked"] = "free"


class _Rotor(_Table):
    speed: Annotated[float, _quantity("rad/s"), Positive]
    hinge_offset: Length
    gravity: Annotated[float, _quantity("m/s^2"), NotNegative] = 9.80665
    eccentricity: Length = 0.0
    eccentricity_angle: Annotated[float, _quantity("rad")] = 0.0
    tip_lever: Length = 0.0


class _Support(_Table):
    hub_mass_x: Mass
    hub_mass_y: Mass
    k_x: Stiffness
    c_x: Damping
    k_y: Stiffness
    c_y: Damping
    roll_inertia: Annotated[float, _quantity("kg*m^2"), NotNegative] = 0.0
    k_roll: AngularStiffness = 0.0
    c_roll: AngularDamping = 0.0
    kappa: Annotated[float, _quantity("rad/m")] = 0.0


class _Blade(_Table):
    """Either mass, first moment and inertia about the link, or the paper's plate of length and width on an arm."""

    mass: Mass
    k_beta: AngularStiffness
    c_beta: AngularDamping
    first_moment: FirstMoment | None = None
    inertia: Inertia | None = None
    length: Annotated[float, _quantity("m"), Positive] | None = None
    width: Length | None = None
    arm: Length | None = None

    @model_validator(mode="after")
    def _one_description(self) -> "_Blade":
        keys = ("first_moment", "inertia", "length", "width", "arm")
        given = [key for key in keys if getattr(self, key) is not None]
        if given not in (["first_moment", "inertia"], ["length", "width"], ["length", "width", "arm"]):
            raise ValueError(
                "expected either 'first_moment' and 'inertia', or 'length' and 'width' (and 'arm'), "
                f"got {', '.join(given) or 'none of them'}"
            )
        if self.first_moment is not None and self.inertia is not None:
            smallest = self.first_moment**2 / self.mass
            if self.inertia < smallest * (1.0 - 1e-9):
                raise ValueError(
                    f"'inertia' about the link must be at least first_moment²/mass = {smallest:.6g} kg*m^2, "
                    f"got {self.inertia:.6g}"
                )
        return self

    def moments(self, hinge_offset: float) -> tuple[float, float]:
        """S [kg·m] and I [kg·m²] about the link; a plate's mass centre sits at d + h/2 from the link (Eq (2))."""
        if self.first_moment is not None and self.inertia is not None:
            return self.first_moment, self.inertia
        h, w = self.length or 0.0, self.width or 0.0
        arm = self.arm if self.arm is not None else hinge_offset + h / 2.0
        return self.mass * arm, self.mass * ((h**2 + w**2) / 12.0 + arm**2)


class _Loads(_Table):
    time_constant: Annotated[float, _quantity("s"), Positive]
    hub_rms: Annotated[float, _quantity("N"), Positive]
    blade_rms: Annotated[float, _quantity("N*m"), Positive]
    roll_rms: Annotated[float, _quantity("N*m"), Positive] | None = None


class _Prior(_Table):
    stiffness: float = Field(default=0.3, gt=0.0, le=3.0)
    damping: float = Field(default=0.3, gt=0.0, le=10.0)


class _File(_Table):
    name: str
    description: str
    source: str
    assumed: tuple[str, ...] = ()
    model: _Model
    rotor: _Rotor
    support: _Support
    blade: Annotated[list[_Blade], BeforeValidator(lambda given: given if isinstance(given, list) else [given])]
    loads: _Loads
    prior: _Prior = _Prior()

    def turbine(self, sensors: tuple[Sensor, ...]) -> Turbine:
        model = RotorModel(**self.model.model_dump())
        blades = self.blade * model.blades if len(self.blade) == 1 else self.blade
        if len(blades) != model.blades:
            raise ConfigurationError(
                f"turbine '{self.name}': expected one [blade] table or {model.blades} [[blade]] tables, got {len(blades)}"
            )
        values = self.support.model_dump() | {
            key: getattr(self.rotor, key) for key in ("hinge_offset", "gravity", "eccentricity", "eccentricity_angle")
        }
        for i, blade in enumerate(blades, start=1):
            first_moment, inertia = blade.moments(self.rotor.hinge_offset)
            values |= {
                f"blade_mass_{i}": blade.mass,
                f"blade_first_moment_{i}": first_moment,
                f"blade_inertia_{i}": inertia,
                f"k_beta_{i}": blade.k_beta,
                f"c_beta_{i}": blade.c_beta,
            }
        rms = {
            "x": self.loads.hub_rms,
            "y": self.loads.hub_rms,
            "roll": self.loads.roll_rms or self.loads.blade_rms,
        }
        return Turbine(
            name=self.name,
            description=self.description,
            source=self.source,
            assumed=self.assumed,
            model=model,
            values=values,
            rotor_speed=self.rotor.speed,
            spread=(self.prior.stiffness, self.prior.damping),
            loads=tuple(
                GaussMarkov(f"load_{name}", rms.get(name, self.loads.blade_rms), self.loads.time_constant)
                for name in model.coordinates
            ),
            sensors=sensors,
            tip_lever=self.rotor.tip_lever,
        )


def _tables(turbine: Turbine) -> dict[str, Any]:
    """A turbine as the tables of its file."""
    v, model = turbine.values, turbine.model
    rms = {load.load.removeprefix("load_"): load.rms for load in turbine.loads}
    support = next((rms[name] for name in ("x", "y") if name in rms), 1.0)
    blade = rms.get("beta_1", 1.0)
    blades = [
        {
            "mass": f"{v[f'blade_mass_{i}']!r} kg",
            "first_moment": f"{v[f'blade_first_moment_{i}']!r} kg*m",
            "inertia": f"{v[f'blade_inertia_{i}']!r} kg*m^2",
            "k_beta": f"{v[f'k_beta_{i}']!r} N*m/rad",
            "c_beta": f"{v[f'c_beta_{i}']!r} N*m*s/rad",
        }
        for i in model.blade_numbers
    ]
    units = {name: unit for unit, names in _SUPPORT_UNITS.items() for name in names}
    return {
        "name": turbine.name,
        "description": turbine.description,
        "source": turbine.source,
        "assumed": list(turbine.assumed),
        "model": {"blades": model.blades, "x": model.x, "y": model.y, "roll": model.roll, "lag": model.lag},
        "rotor": {
            "speed": f"{turbine.rotor_speed!r} rad/s",
            "tip_lever": f"{turbine.tip_lever!r} m",
            **{name: f"{v[name]!r} m" for name in ("hinge_offset", "eccentricity")},
            "eccentricity_angle": f"{v['eccentricity_angle']!r} rad",
            "gravity": f"{v['gravity']!r} m/s^2",
        },
        "support": {name: f"{v[name]!r} {unit}" for name, unit in units.items()},
        "loads": {
            "time_constant": f"{turbine.loads[0].time_constant if turbine.loads else 1.0!r} s",
            "hub_rms": f"{support!r} N",
            "blade_rms": f"{blade!r} N*m",
            "roll_rms": f"{rms.get('roll', blade)!r} N*m",
        },
        "prior": {"stiffness": turbine.spread[0], "damping": turbine.spread[1]},
        "blade": blades,
        "sensor": [sensor.model_dump(exclude_none=True) for sensor in turbine.sensors],
    }


_SUPPORT_UNITS = {
    "kg": ("hub_mass_x", "hub_mass_y"),
    "N/m": ("k_x", "k_y"),
    "N*s/m": ("c_x", "c_y"),
    "kg*m^2": ("roll_inertia",),
    "N*m/rad": ("k_roll",),
    "N*m*s/rad": ("c_roll",),
    "rad/m": ("kappa",),
}

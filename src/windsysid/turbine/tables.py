"""The turbine file: TOML tables, every value with its unit (``k_x = "1800 N/m"``), to a `Turbine` and back.

Two kinds: a ``rotor`` of hinged blades on its support (docs/nrel5mw.md), and a ``tower`` under a rigid rotor (docs/tower.md).
"""

import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from windsysid.configuration import parse_toml
from windsysid.errors import ConfigurationError
from windsysid.mechanics.rotor import RotorModel
from windsysid.mechanics.sensors import Sensor, first_problem, parse_sensors
from windsysid.mechanics.tower import DIRECTIONS, TowerModel
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.turbine.turbine import Turbine
from windsysid.units import parse_quantity

__all__ = ["as_tables", "parse_turbine"]


def parse_turbine(text: str, source: str) -> Turbine:
    """The turbine that TOML text describes.

    Raises
    ------
    ConfigurationError
        In one line that begins with `source`: what was wrong, what was expected, what was got.
    """
    try:
        content = parse_toml(text)
    except ValueError as error:
        raise ConfigurationError(f"turbine file {source}: expected TOML, got: {error}") from None
    sensors = content.pop("sensor", [])
    model = content.get("model")
    kind = model.get("kind", "rotor") if isinstance(model, dict) else "rotor"
    if kind not in ("rotor", "tower"):
        raise ConfigurationError(f"turbine file {source}: model.kind: expected 'rotor' or 'tower', got {kind!r}")
    try:
        file = (_TowerFile if kind == "tower" else _RotorFile).model_validate(content)
    except ValidationError as error:
        raise ConfigurationError(f"turbine file {source}: {first_problem(error)}") from None
    turbine = file.turbine(parse_sensors(sensors, f"turbine file {source}"))
    for name in turbine.model.coordinates:
        frequency = turbine.natural_frequency(name) / (2.0 * math.pi)
        if not frequency <= _FASTEST:
            raise ConfigurationError(
                f"turbine file {source}: k_{name} = {turbine.values[f'k_{name}']:.4g} makes {name} vibrate at {frequency:.3g} Hz: "
                f"expected at most {_FASTEST:g} Hz; correct the value or its unit"
            )
    return turbine


_FASTEST = 25_000.0
"""[Hz]: what four samples per period at the fastest rate of a simulation can show."""


def as_tables(turbine: Turbine) -> dict[str, Any]:
    """A turbine as the tables of its file: `parse_turbine` of them gives it back."""
    tables = _tower_tables(turbine) if isinstance(turbine.model, TowerModel) else _rotor_tables(turbine)
    return {
        "name": turbine.name,
        "description": turbine.description,
        "source": turbine.source,
        "assumed": list(turbine.assumed),
        **tables,
        "prior": {"stiffness": turbine.spread[0], "damping": turbine.spread[1]},
        "sensor": [sensor.model_dump(exclude_none=True) for sensor in turbine.sensors],
    }


def _quantity(unit: str) -> BeforeValidator:
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
    kind: Literal["rotor"] = "rotor"
    blades: int = Field(ge=1, le=12)
    x: Literal["free", "locked"] = "free"
    y: Literal["free", "locked"] = "free"
    roll: Literal["free", "locked", "tied"] = "locked"
    lag: Literal["free", "locked"] = "free"


class _Rotor(_Table):
    speed: Annotated[float, _quantity("rad/s"), NotNegative]
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
    c_hub_blade: Annotated[float, _quantity("N*s")] | None = None


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
    prior: _Prior = _Prior()


class _RotorFile(_File):
    model: _Model
    rotor: _Rotor
    support: _Support
    blade: Annotated[list[_Blade], BeforeValidator(lambda given: given if isinstance(given, list) else [given])]
    loads: _Loads

    def turbine(self, sensors: tuple[Sensor, ...]) -> Turbine:
        air = self.support.c_hub_blade is not None
        model = RotorModel(**self.model.model_dump(exclude={"kind"}), air_couples=air)
        blades = self.blade * model.blades if len(self.blade) == 1 else self.blade
        if len(blades) != model.blades:
            raise ConfigurationError(
                f"turbine '{self.name}': expected one [blade] table or {model.blades} [[blade]] tables, got {len(blades)}"
            )
        values = self.support.model_dump(exclude_none=True) | {
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


class _TowerModel(_Table):
    kind: Literal["tower"]
    blades: int = Field(default=3, ge=1, le=12)
    side_side: Literal["free", "locked"] = "free"
    fore_aft: Literal["free", "locked"] = "free"


class _TowerRotor(_Table):
    speed: Annotated[float, _quantity("rad/s"), NotNegative]


class _Direction(_Table):
    """One direction as the field knows it: how heavy, how fast, how damped."""

    modal_mass: Mass
    frequency: Annotated[float, _quantity("Hz"), Positive]
    damping_ratio: Annotated[float, _quantity("%"), Field(gt=-1.0, lt=1.0)]

    def values(self, name: str) -> dict[str, float]:
        """Mass, k = m ω² and c = 2 ζ m ω."""
        omega = 2.0 * math.pi * self.frequency
        stiffness, damping = self.modal_mass * omega**2, 2.0 * self.damping_ratio * self.modal_mass * omega
        return {f"mass_{name}": self.modal_mass, f"k_{name}": stiffness, f"c_{name}": damping}


class _Top(_Table):
    tilt: Annotated[float, _quantity("rad/m"), NotNegative] = 0.0
    gravity: Annotated[float, _quantity("m/s^2"), NotNegative] = 9.80665


class _Forces(_Table):
    """Random forces on the tower top: how large, how fast they wander."""

    time_constant: Annotated[float, _quantity("s"), Positive]
    side_side_rms: Annotated[float, _quantity("N"), Positive]
    fore_aft_rms: Annotated[float, _quantity("N"), Positive]

    def loads(self, model: TowerModel, harmonic: int) -> tuple[GaussMarkov, ...]:
        rms = {"side_side": self.side_side_rms, "fore_aft": self.fore_aft_rms}
        return tuple(GaussMarkov(f"load_{n}", rms[n], self.time_constant, harmonic) for n in model.coordinates)


class _TowerFile(_File):
    model: _TowerModel
    rotor: _TowerRotor
    side_side: _Direction
    fore_aft: _Direction
    top: _Top = _Top()
    loads: _Forces
    blade_passing: _Forces

    def turbine(self, sensors: tuple[Sensor, ...]) -> Turbine:
        model = TowerModel(**self.model.model_dump(exclude={"kind"}))
        return Turbine(
            name=self.name,
            description=self.description,
            source=self.source,
            assumed=self.assumed,
            model=model,
            values=self.side_side.values("side_side") | self.fore_aft.values("fore_aft") | self.top.model_dump(),
            rotor_speed=self.rotor.speed,
            spread=(self.prior.stiffness, self.prior.damping),
            loads=(*self.loads.loads(model, 0), *self.blade_passing.loads(model, model.blades)),
            sensors=sensors,
        )


def _tower_tables(turbine: Turbine) -> dict[str, Any]:
    v, model = turbine.values, turbine.model
    free = {name: "free" if name in model.coordinates else "locked" for name in DIRECTIONS}
    directions = {}
    for name in DIRECTIONS:
        omega = turbine.natural_frequency(name)
        directions[name] = {
            "modal_mass": f"{v[f'mass_{name}']!r} kg",
            "frequency": f"{omega / (2.0 * math.pi)!r} Hz",
            "damping_ratio": f"{v[f'c_{name}'] / (2.0 * v[f'mass_{name}'] * omega)!r} 1",
        }
    return {
        "model": {"kind": "tower", "blades": model.blades, **free},
        "rotor": {"speed": f"{turbine.rotor_speed!r} rad/s"},
        **directions,
        "top": {"tilt": f"{v['tilt']!r} rad/m", "gravity": f"{v['gravity']!r} m/s^2"},
        "loads": _forces(turbine, 0),
        "blade_passing": _forces(turbine, model.blades),
    }


def _forces(turbine: Turbine, harmonic: int) -> dict[str, str]:
    loads = {load.load.removeprefix("load_"): load for load in turbine.loads if load.harmonic == harmonic}
    time_constant = next((load.time_constant for load in loads.values()), 1.0)
    rms = {name: loads[name].rms if name in loads else 1.0 for name in DIRECTIONS}
    return {"time_constant": f"{time_constant!r} s", **{f"{name}_rms": f"{value!r} N" for name, value in rms.items()}}


def _rotor_tables(turbine: Turbine) -> dict[str, Any]:
    v, model = turbine.values, turbine.rotor
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
    units = {name: unit for unit, names in _SUPPORT_UNITS.items() for name in names if name in v}
    return {
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
        "blade": blades,
    }


_SUPPORT_UNITS = {
    "kg": ("hub_mass_x", "hub_mass_y"),
    "N/m": ("k_x", "k_y"),
    "N*s/m": ("c_x", "c_y"),
    "kg*m^2": ("roll_inertia",),
    "N*m/rad": ("k_roll",),
    "N*m*s/rad": ("c_roll",),
    "rad/m": ("kappa",),
    "N*s": ("c_hub_blade",),
}

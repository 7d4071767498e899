"""The turbine file of a rotor of hinged blades on its support (docs/nrel5mw.md)."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from windsysid.errors import ConfigurationError
from windsysid.mechanics.rotor import MEAN_LAG, RotorModel
from windsysid.mechanics.sensors import Sensor
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.turbine.entries import (
    AngularDamping,
    AngularStiffness,
    Damping,
    File,
    FileTable,
    FirstMoment,
    Inertia,
    Length,
    Mass,
    NotNegative,
    Positive,
    Stiffness,
    quantity,
)
from windsysid.turbine.turbine import Turbine

__all__ = ["RotorFile", "rotor_tables"]


class _Model(FileTable):
    kind: Literal["rotor"] = "rotor"
    blades: int = Field(ge=1, le=12)
    x: Literal["free", "locked"] = "free"
    y: Literal["free", "locked"] = "free"
    roll: Literal["free", "locked", "tied"] = "locked"
    lag: Literal["free", "locked"] = "free"


class _Rotor(FileTable):
    speed: Annotated[float, quantity("rad/s"), NotNegative]
    hinge_offset: Length
    gravity: Annotated[float, quantity("m/s^2"), NotNegative] = 9.80665
    eccentricity: Length = 0.0
    eccentricity_angle: Annotated[float, quantity("rad")] = 0.0
    tip_lever: Length = 0.0
    mean_lag_angle: Annotated[float, quantity("rad")] | None = None


class _Support(FileTable):
    hub_mass_x: Mass
    hub_mass_y: Mass
    k_x: Stiffness
    c_x: Damping
    k_y: Stiffness
    c_y: Damping
    roll_inertia: Annotated[float, quantity("kg*m^2"), NotNegative] = 0.0
    k_roll: AngularStiffness = 0.0
    c_roll: AngularDamping = 0.0
    kappa: Annotated[float, quantity("rad/m")] = 0.0
    c_hub_blade: Annotated[float, quantity("N*s")] | None = None


class _Blade(FileTable):
    """Either mass, first moment and inertia about the link, or the paper's plate of length and width on an arm."""

    mass: Mass
    k_beta: AngularStiffness
    c_beta: AngularDamping
    first_moment: FirstMoment | None = None
    inertia: Inertia | None = None
    length: Annotated[float, quantity("m"), Positive] | None = None
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


class _Loads(FileTable):
    time_constant: Annotated[float, quantity("s"), Positive]
    hub_rms: Annotated[float, quantity("N"), Positive]
    blade_rms: Annotated[float, quantity("N*m"), Positive]
    roll_rms: Annotated[float, quantity("N*m"), Positive] | None = None


class RotorFile(File):
    """Tables ``[model]``, ``[rotor]``, ``[support]``, one or more ``[[blade]]`` and ``[loads]``."""

    model: _Model
    rotor: _Rotor
    support: _Support
    blade: Annotated[list[_Blade], BeforeValidator(lambda given: given if isinstance(given, list) else [given])]
    loads: _Loads

    def turbine(self, sensors: tuple[Sensor, ...]) -> Turbine:
        """The turbine with this rotor."""
        air = self.support.c_hub_blade is not None
        leads = self.rotor.mean_lag_angle is not None
        model = RotorModel(**self.model.model_dump(exclude={"kind"}), air_couples=air, leads=leads)
        blades = self.blade * model.blades if len(self.blade) == 1 else self.blade
        if len(blades) != model.blades:
            raise ConfigurationError(
                f"turbine '{self.name}': expected one [blade] table or {model.blades} [[blade]] tables, got "
                f"{len(blades)}"
            )
        values = self.support.model_dump(exclude_none=True) | {
            key: getattr(self.rotor, key) for key in ("hinge_offset", "gravity", "eccentricity", "eccentricity_angle")
        }
        if self.rotor.mean_lag_angle is not None:
            values[MEAN_LAG] = self.rotor.mean_lag_angle
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
            mass_tolerance=self.tolerances.masses,
            loads=tuple(
                GaussMarkov(f"load_{name}", rms.get(name, self.loads.blade_rms), self.loads.time_constant)
                for name in model.coordinates
            ),
            sensors=sensors,
            tip_lever=self.rotor.tip_lever,
        )


def rotor_tables(turbine: Turbine) -> dict[str, Any]:
    """A turbine with a rotor of its own as the tables of its file."""
    v, model = turbine.values, turbine.rotor
    rms = {load.load: load.rms for load in turbine.loads}
    support = next((rms[name] for name in ("load_x", "load_y") if name in rms), 1.0)
    blade = rms.get("load_beta_1", 1.0)
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
            **({MEAN_LAG: f"{v[MEAN_LAG]!r} rad"} if model.leads else {}),
        },
        "support": {name: f"{v[name]!r} {unit}" for name, unit in units.items()},
        "loads": {
            "time_constant": f"{turbine.loads[0].time_constant if turbine.loads else 1.0!r} s",
            "hub_rms": f"{support!r} N",
            "blade_rms": f"{blade!r} N*m",
            "roll_rms": f"{rms.get('load_roll', blade)!r} N*m",
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

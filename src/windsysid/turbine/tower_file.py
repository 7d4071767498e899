"""The turbine file of a tower under a rigid rotor (docs/tower.md)."""

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from windsysid.mechanics.sensors import Sensor
from windsysid.mechanics.tower import DIRECTIONS, TowerModel
from windsysid.statespace.gauss_markov import GaussMarkov
from windsysid.turbine.entries import (
    File,
    FileTable,
    Mass,
    NotNegative,
    Positive,
    RotorEntry,
    Tolerances,
    quantity,
    spread,
)  # fmt: skip
from windsysid.turbine.turbine import OperatingState, Turbine

__all__ = ["TowerFile", "tower_tables"]


AERODYNAMIC_STIFFNESS_DISCREPANCY = 0.08
"""Relative standard deviation between the fore-aft stiffness under an operating rotor and that of the structure.
Blades that flap in the air lag behind the tower, and stiffen it. Fore-aft frequencies of OpenFAST's turbines are 5.1 %
higher in a decay in steady wind (NREL 5 MW: 0.340 and 0.3235 Hz), and 3.4 % higher in the response to measured waves
(IEA 15 MW: ``python -m validation.wave_response``): 4 % of a frequency, 8 % of a stiffness."""


class _TowerModel(FileTable):
    kind: Literal["tower"]
    blades: int = Field(default=3, ge=1, le=12)
    side_side: Literal["free", "locked"] = "free"
    fore_aft: Literal["free", "locked"] = "free"


DampingRatio = Annotated[float, quantity("%"), Field(gt=-1.0, lt=1.0)]


class _Direction(FileTable):
    """One direction as the field knows it: how heavy, how fast, how damped."""

    modal_mass: Mass
    frequency: Annotated[float, quantity("Hz"), Positive]
    damping_ratio: DampingRatio

    def values(self, name: str) -> dict[str, float]:
        """Mass, k = m ω² and c = 2 ζ m ω."""
        omega = 2.0 * math.pi * self.frequency
        stiffness, damping = self.modal_mass * omega**2, 2.0 * self.damping_ratio * self.modal_mass * omega
        return {f"mass_{name}": self.modal_mass, f"k_{name}": stiffness, f"c_{name}": damping}


class _Top(FileTable):
    tilt: Annotated[float, quantity("rad/m"), NotNegative] = 0.0
    gravity: Annotated[float, quantity("m/s^2"), NotNegative] = 9.80665


class _Forces(FileTable):
    """Random forces on the tower top: rms and time constant."""

    time_constant: Annotated[float, quantity("s"), Positive]
    side_side_rms: Annotated[float, quantity("N"), Positive]
    fore_aft_rms: Annotated[float, quantity("N"), Positive]

    def loads(self, model: TowerModel, harmonic: int) -> tuple[GaussMarkov, ...]:
        rms = {"side_side": self.side_side_rms, "fore_aft": self.fore_aft_rms}
        return tuple(GaussMarkov(f"load_{n}", rms[n], self.time_constant, harmonic) for n in model.coordinates)


def _identifiable(ratio: float) -> float:
    """Refuse a damping of zero, which is not identified."""
    if ratio == 0.0:
        raise ValueError('expected a size other than 0 %: give a guess, such as "1 %"')
    return ratio


class _Parked(FileTable):
    """Damping while the rotor stands or idles, and the relative standard deviation of its prior."""

    side_side_damping_ratio: Annotated[DampingRatio, AfterValidator(_identifiable)]
    fore_aft_damping_ratio: Annotated[DampingRatio, AfterValidator(_identifiable)]
    prior_damping: Annotated[float, spread(10.0)]

    def state(self, file: "TowerFile") -> OperatingState:
        """The state of the tower of a file."""
        values = {}
        for name in DIRECTIONS:
            direction = getattr(file, name).model_copy(update={"damping_ratio": getattr(self, f"{name}_damping_ratio")})
            values[f"c_{name}"] = direction.values(name)[f"c_{name}"]
        return OperatingState(values, self.prior_damping)


class _Tolerances(Tolerances):
    """Those of every file, and of the fore-aft stiffness by the operating rotor."""

    aerodynamics: Annotated[float, quantity("%"), Field(ge=0.0, le=1.0)] = AERODYNAMIC_STIFFNESS_DISCREPANCY


class _States(FileTable):
    parked: _Parked | None = None


class TowerFile(File):
    """Tables ``[model]``, ``[rotor]``, ``[side_side]``, ``[fore_aft]``, ``[top]``, ``[loads]``, ``[blade_passing]`` and
    ``[states.parked]``."""

    model: _TowerModel
    rotor: RotorEntry
    side_side: _Direction
    fore_aft: _Direction
    top: _Top = _Top()
    loads: _Forces
    blade_passing: _Forces
    tolerances: _Tolerances = _Tolerances()
    states: _States = _States()

    @model_validator(mode="after")
    def _free_directions_are_damped(self) -> "TowerFile":
        for name in DIRECTIONS:
            if getattr(self.model, name) == "free" and getattr(self, name).damping_ratio == 0.0:
                raise ValueError(
                    f"{name}.damping_ratio: expected a size other than 0 %: a damping of zero is not "
                    'identified; give a guess, such as "1 %", or lock the direction'
                )
        return self

    def turbine(self, sensors: tuple[Sensor, ...]) -> Turbine:
        """The turbine with this tower."""
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
            mass_tolerance=self.tolerances.masses,
            aerodynamic_tolerance=self.tolerances.aerodynamics if self.rotor.speed else 0.0,
            loads=(*self.loads.loads(model, 0), *self.blade_passing.loads(model, model.blades)),
            sensors=sensors,
            states={} if self.states.parked is None else {"parked": self.states.parked.state(self)},
        )


def tower_tables(turbine: Turbine) -> dict[str, Any]:
    """A turbine that is a tower as the tables of its file."""
    v, model = turbine.values, turbine.model

    def ratio(name: str, damping: float) -> str:
        return f"{damping / (2.0 * v[f'mass_{name}'] * turbine.natural_frequency(name))!r} 1"

    free = {name: "free" if name in model.coordinates else "locked" for name in DIRECTIONS}
    directions = {}
    for name in DIRECTIONS:
        directions[name] = {
            "modal_mass": f"{v[f'mass_{name}']!r} kg",
            "frequency": f"{turbine.natural_frequency(name) / (2.0 * math.pi)!r} Hz",
            "damping_ratio": ratio(name, v[f"c_{name}"]),
        }
    states = {
        state: {f"{name}_damping_ratio": ratio(name, known.values[f"c_{name}"]) for name in DIRECTIONS}
        | {"prior_damping": known.damping_spread}
        for state, known in turbine.states.items()
    }
    return {
        "model": {"kind": "tower", "blades": model.blades, **free},
        "rotor": {"speed": f"{turbine.rotor_speed!r} rad/s"},
        **directions,
        "top": {"tilt": f"{v['tilt']!r} rad/m", "gravity": f"{v['gravity']!r} m/s^2"},
        "loads": _forces(turbine, 0),
        "blade_passing": _forces(turbine, model.blades),
        **({"states": states} if states else {}),
    }


def _forces(turbine: Turbine, harmonic: int) -> dict[str, str]:
    loads = {load.load: load for load in turbine.loads if load.harmonic == harmonic}
    time_constant = next((load.time_constant for load in loads.values()), 1.0)
    rms = {name: loads[f"load_{name}"].rms if f"load_{name}" in loads else 1.0 for name in DIRECTIONS}
    return {"time_constant": f"{time_constant!r} s", **{f"{name}_rms": f"{value!r} N" for name, value in rms.items()}}

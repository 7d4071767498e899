"""
Your own mechanical model
=========================

A mechanical model, a load hypothesis and a sensor of one's own: a parked offshore tower with a tuned mass damper
under waves.

Run:  python examples/own_turbine_model.py [FOLDER]

All three stand in this file and nothing in the package knows them: they register themselves, and then `simulate`,
`identify`, `modes` and saved results take them as they take the package's own. With FOLDER the result is saved there,
with its report.

The tower's top moves by u, the damper's mass by v, both from rest:

    T = ½ m_t u̇² + ½ m_d v̇²,    V = ½ k_t u² + ½ k_d (v − u)²,    D = ½ c_t u̇² + ½ c_d (v̇ − u̇)²
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import matplotlib.pyplot as plt
import numpy as np
import sympy as sp

import windsysid as ws
from windsysid.loads.statistics import Statistic
from windsysid.mechanics.equations import lagrange
from windsysid.mechanics.sensors import StructuralMotion
from windsysid.reports.identification import identification_report
from windsysid.statespace.process import load_on, rational

# %%
# The mechanical model


@ws.models.register_model
@dataclass(frozen=True)
class DampedTower(ws.models.MechanicalModel):
    """A tower that sways in one direction and carries a tuned mass damper."""

    kind: ClassVar[str] = "damped-tower"

    @property
    def freedoms(self) -> tuple[ws.models.Coordinate, ...]:
        """The top of the tower and the mass of the damper."""
        return ws.models.Coordinate("tower", "m", "tower"), ws.models.Coordinate("damper", "m", "damper")

    @property
    def parameters(self) -> tuple[ws.models.Coefficient, ...]:
        """Mass, stiffness and damping of both."""
        return tuple(
            ws.models.Coefficient(f"{letter}_{part}", kind, unit, part)
            for part in ("tower", "damper")
            for letter, kind, unit in (("m", "inertia", "kg"), ("k", "stiffness", "N/m"), ("c", "damping", "N*s/m"))
        )

    @property
    def signature(self) -> str:
        """There is one such tower."""
        return "DampedTower"

    def inertia(self, coordinate: str, values: Mapping[str, float]) -> float:
        """The mass of the tower or of the damper."""
        return values[f"m_{coordinate}"]

    def stiffness(self, coordinate: str, values: Mapping[str, float], rotor_speed: float) -> float:
        """A tower whose damper is held has the damper's spring too."""
        return values["k_damper"] + (values["k_tower"] if coordinate == "tower" else 0.0)

    def equations(self) -> ws.models.Equations:
        """Lagrange's equations."""
        p = self.symbols()
        (u, u_rate, _), (v, v_rate, _) = self.motion()
        return lagrange(
            "damped_tower",
            lagrangian=(p["m_tower"] * u_rate**2 + p["m_damper"] * v_rate**2) / 2
            - (p["k_tower"] * u**2 + p["k_damper"] * (v - u) ** 2) / 2,
            dissipation=(p["c_tower"] * u_rate**2 + p["c_damper"] * (v_rate - u_rate) ** 2) / 2,
            coordinates=self.motion(),
            loads=[sp.Symbol(name, real=True) for name in self.loads],
            inputs={},
            parameters=p.values(),
        )

    def readings(self, sensors: Sequence[Any]) -> list[sp.Expr]:
        """Expressions of the readings of each sensor."""
        return [sensor.reading(DampedTowerMotion(self)) for sensor in sensors]

    def symbols(self) -> dict[str, sp.Symbol]:
        """The parameters."""
        return {known.name: sp.Symbol(known.name, real=True) for known in self.parameters}

    def motion(self) -> list[tuple[sp.Symbol, sp.Symbol, sp.Symbol]]:
        """Displacement, velocity and acceleration of both."""
        ends = ("", "_rate", "_acc")
        u, v = ([sp.Symbol(name + end, real=True) for end in ends] for name in self.coordinates)
        return [(u[0], u[1], u[2]), (v[0], v[1], v[2])]


class DampedTowerMotion:
    """Motion of the tower as its sensors use it (`windsysid.mechanics.sensors.StructuralMotion`)."""

    def __init__(self, model: DampedTower) -> None:
        self.parameters = model.symbols()
        self.triples = dict(zip(model.coordinates, model.motion(), strict=True))

    def displacement(self, name: str) -> sp.Expr:
        """u or v."""
        return self.triples[name][0]

    def rate(self, expression: sp.Expr) -> sp.Expr:
        """The time derivative."""
        rates = [(q, v) for q, v, _ in self.triples.values()] + [(v, a) for _, v, a in self.triples.values()]
        return sp.Add(*(sp.diff(expression, symbol) * rate for symbol, rate in rates))

    def along(self, sensor: ws.models.PlacedSensor, order: int) -> sp.Expr:
        """The motion of the top, along its only direction."""
        if (sensor.point, sensor.axis, sensor.frame, sensor.feels_gravity) != ("tower", "x", "fixed", False):
            raise ws.ConfigurationError(
                f"sensor '{sensor.channel}': expected one on the tower along x of the frame 'fixed'"
            )
        return self.triples["tower"][order]

    def turning(self, sensor: ws.models.PlacedSensor) -> sp.Expr:
        """Nothing turns here."""
        raise ws.ConfigurationError(
            f"sensor '{sensor.channel}': this tower does not turn: expected an accelerometer or a stroke"
        )

    def spring_force(self, sensor: ws.models.PlacedSensor) -> sp.Expr:
        """The force in the tower."""
        return self.parameters["k_tower"] * self.triples["tower"][0]


# %%
# The load hypothesis


@ws.models.register_loads
class Waves(ws.models.LoadHypothesis):
    """A sea: a peak at the waves' frequency, nothing at rest, S(ω) ∝ ω² / |ω_p² − ω² + 2iζ ω_p ω|²."""

    name = "waves"
    text = "waves on the tower"
    caution = "waves were taken for one peak: a swell beside a wind sea needs two"

    def applies_to(self, turbine: ws.Turbine) -> bool:
        """True if waves act on it."""
        return turbine.model.kind == DampedTower.kind

    def suppose(self, turbine: ws.Turbine, loads: Sequence[ws.models.GaussMarkov]) -> ws.models.SupposedLoads:
        """The force on the tower, as large as the file says, around 0.12 Hz."""
        (force,) = (load for load in loads if load.load == "load_tower")
        statistics = (
            Statistic("load_rms_waves", "N", force.rms, kind="level", of="tower"),
            Statistic("load_peak", "Hz", 0.12, spread=0.3),
            Statistic("load_peak_damping", "1", 0.2, spread=0.5),
        )

        def blocks(values: Mapping[str, float]) -> tuple[Any, ...]:
            peak, ratio = 2.0 * np.pi * values["load_peak"], values["load_peak_damping"]
            pole = peak * complex(-ratio, np.sqrt(1.0 - min(ratio, 0.999) ** 2))
            return (load_on("load_tower", rational(values["load_rms_waves"], [pole, pole.conjugate()], [0.0])),)

        return ws.models.SupposedLoads(self.name, self.text, turbine, statistics, blocks)


# %%
# The sensor


@ws.models.register_sensor
class StrokeSensor(ws.models.Sensor):
    """The stroke of the damper: how far its mass is from where it sits on the tower."""

    quantity: Literal["stroke"] = "stroke"

    @property
    def unit(self) -> str:
        """A length."""
        return "m"

    def reading(self, motion: StructuralMotion) -> sp.Expr:
        """v − u."""
        return self.gain * (motion.displacement("damper") - motion.displacement("tower"))


# %%
# A turbine of these parts, simulated and identified

TRUTH = {
    "m_tower": 400e3, "k_tower": 1.42e6, "c_tower": 15e3,  # 0.30 Hz, 1 % of critical
    "m_damper": 20e3, "k_damper": 64e3, "c_damper": 7.2e3,  # 0.285 Hz, 10 %
}  # fmt: skip
"""Values of the simulated tower, SI."""

SUPPOSED = {"k_tower": 1.6e6, "c_tower": 10e3, "k_damper": 55e3, "c_damper": 10e3}
"""Values in its file."""

turbine = ws.Turbine(
    name="damped tower", description="a parked offshore tower with a tuned mass damper", source="made up",
    assumed=tuple(TRUTH),
    model=DampedTower(), values=TRUTH, rotor_speed=0.0, spread=(0.3, 0.6),
    loads=(ws.models.GaussMarkov("load_tower", 30e3, 5.0),),
    sensors=(
        ws.models.Accelerometer(channel="top_acceleration", point="tower", axis="x", noise=0.003),
        StrokeSensor(channel="damper_stroke", noise=0.002),
    ),
)  # fmt: skip


def identify_waves(seed: int) -> tuple[ws.Record, ws.results.Identification]:
    """Identify the tower from ten minutes of waves."""
    record = ws.simulate(turbine, duration=600.0, rate=10.0, seed=seed, loads="waves")
    return record, ws.identify(record, turbine.with_values(SUPPOSED), loads="waves")


def save(record: ws.Record, result: ws.results.Identification, folder: Path) -> None:
    """Save a result with its report."""
    result.save(folder)
    (folder / "report.html").write_bytes(identification_report(result, record))


if __name__ == "__main__":
    record, result = identify_waves(seed=0)
    print(result)
    print("truth:", ", ".join(f"{name} {value:g}" for name, value in TRUTH.items() if name in SUPPOSED))
    _, ax = plt.subplots(figsize=(12.6, 6.9), layout="constrained")
    result.plot(ax)
    plt.show()
    if len(sys.argv) > 1:
        save(record, result, Path(sys.argv[1]))

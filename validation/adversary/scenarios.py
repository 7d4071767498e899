"""Records as they are: ordinary ones, and ones with something that windsysid's model does not hold."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from validation.adversary.instruments import CHANNELS, Instruments
from validation.adversary.loads import (
    Loads,
    alternative_wind,
    common,
    independent,
    one_sided,
    plus_line,
    plus_narrow_band,
    pulses,
    scaled_by,
    two_speeds,
)
from validation.adversary.machine import RATE, Machine, move
from windsysid.records.record import Record

__all__ = ["HEALTHY", "LEAD_IN", "SCENARIOS", "Scenario", "record", "scenario"]

LEAD_IN = 20
"""Seconds before a record starts: ten of the memory of the slowest mode."""

HEALTHY = "none"
"""Faults of a record of windsysid's own model."""


class Scenario(NamedTuple):
    """One kind of record.

    Attributes
    ----------
    wrong
        What is wrong with it: `HEALTHY`, ``"loads"``, ``"line"``, ``"instrument"`` or ``"machine"``.
    loads, instruments, machine
        What drives it, reads it, and moves.
    duration, rate
        [s], [Hz].
    formulation
        How windsysid is asked.
    drawn
        What draws all of this anew for each record; None where all records have the same.
    """

    wrong: str
    loads: Loads = independent()
    instruments: Instruments = Instruments()
    machine: Machine = Machine()
    duration: float = 100.0
    rate: float = 50.0
    formulation: str = "auto"
    drawn: "Callable[[np.random.Generator], Scenario] | None" = None


def _mixing(pairs: dict[tuple[int, int], float]) -> NDArray[np.float64]:
    found = np.eye(5)
    for at, share in pairs.items():
        found[at] = share
    return found


def _gusts(share: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(np.mod(share * 4.0, 1.0) > 0.8, 3.0, 1.0)


def _modulated(share: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(3.0 ** np.sin(2.0 * np.pi * 3.0 * share))


def _step(share: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(share > 0.55, 3.0, 1.0)


_SPEED = Machine().speed


def _anything(rng: np.random.Generator, *, disturbed: bool = False) -> Scenario:
    """A machine, loads, instruments, a length and a rate of which nothing is as in another record; `disturbed` by a
    line on two degrees of freedom and by a clock that drifts."""

    def around(count: int, spread: float) -> NDArray[np.float64]:
        return np.exp(spread * rng.uniform(-1.0, 1.0, count))

    k, c, usual = around(5, 0.2), around(5, 0.3), Machine()
    machine = Machine(
        hub_mass=usual.hub_mass * (1.0 + 0.014 * rng.standard_normal()),
        blade_mass=tuple(np.array(usual.blade_mass) * (1.0 + 0.014 * rng.standard_normal(3))),
        k_x=usual.k_x * k[0], k_y=usual.k_y * k[1], c_x=usual.c_x * c[0], c_y=usual.c_y * c[1],
        k_beta=tuple(np.array(usual.k_beta) * k[2] * around(3, 0.03)),
        c_beta=tuple(np.array(usual.c_beta) * c[2] * around(3, 0.1)),
        speed=usual.speed * rng.uniform(0.7, 1.1),
    )  # fmt: skip
    loads = independent(tuple(around(5, 0.6)), tuple(around(5, 0.6)))
    drift = 0.0
    if disturbed:
        two = rng.choice(5, 2, replace=False).tolist()
        loads = plus_line(rng.uniform(0.5, 6.0), rng.uniform(0.02, 0.15), two, loads)
        drift = rng.choice([-1.0, 1.0]) * rng.uniform(2e-5, 8e-5)
    instruments = Instruments(
        drawn=(0.01, 2.0, 0.001), noise=tuple(around(5, 0.1)), bits=rng.choice([0, 10]), drift=drift
    )
    duration, rate = float(rng.choice([40, 60, 100, 150, 300])), float(rng.choice([20, 25, 40, 50, 80]))
    wrong = "instrument" if disturbed else HEALTHY
    return Scenario(wrong, loads, instruments, machine, duration, rate)


SCENARIOS: dict[str, Scenario] = {
    "reference": Scenario(HEALTHY),
    "levels 2:1": Scenario(HEALTHY, independent((2.0, 1.0, 1.0, 1.5, 2.0))),
    "levels 5:1": Scenario(HEALTHY, independent((1.0, 0.2, 0.3, 1.0, 1.0))),
    "noise 3 x on one blade": Scenario("instrument", instruments=Instruments(noise=(1.0, 1.0, 1.0, 3.0, 1.0))),
    "15 s": Scenario(HEALTHY, duration=15.0),
    "30 s": Scenario(HEALTHY, duration=30.0),
    "600 s at 50 Hz": Scenario(HEALTHY, duration=600.0, rate=50.0),
    "11 Hz": Scenario(HEALTHY, rate=11.0),
    "rotor at 18 rpm": Scenario(HEALTHY, machine=Machine(speed=2.0 * np.pi * 0.3)),
    "20 Hz": Scenario(HEALTHY, rate=20.0),
    "200 Hz": Scenario(HEALTHY, duration=30.0, rate=200.0),
    "12 bits": Scenario(HEALTHY, instruments=Instruments(bits=12)),
    "time constants 0.5 ... 2 s": Scenario("loads", independent((1.0,) * 5, (2.0, 0.5, 0.5, 1.0, 2.0))),
    "x and y correlated 0.7": Scenario("loads", common(_mixing({(0, 1): 1.0, (1, 0): 0.0}))),
    "blades correlated 0.5": Scenario("loads", common(_mixing({(3, 2): 0.58, (4, 2): 0.58}))),
    "hub and blade correlated 0.7": Scenario("loads", common(_mixing({(0, 2): 1.0}))),
    "line 5 % from a mode": Scenario("line", plus_line(1.64, 0.04, (0,))),
    "line amid the modes": Scenario("line", plus_line(2.6, 0.1, (0, 1))),
    "line 3 % from blades": Scenario("line", plus_line(4.15, 0.02, (2,))),
    "3P on the support": Scenario("line", plus_line(3.48, 0.02, (0, 1))),
    "1P on the support": Scenario("line", plus_line(1.16, 0.125, (0, 1))),
    "narrow band at the support": Scenario("loads", plus_narrow_band(1.9, 0.03, 0.3, (0, 1))),
    "band on the support's modes": Scenario("loads", plus_narrow_band(1.8, 0.02, 0.25, (0, 1))),
    "faint band on the support's modes": Scenario("loads", plus_narrow_band(1.7, 0.01, 0.15, (0, 1))),
    "narrow band at the blades": Scenario("loads", plus_narrow_band(3.6, 0.05, 0.3, (2, 3, 4))),
    "all but a line at the support": Scenario("loads", plus_narrow_band(1.64, 0.001, 0.2, (0, 1))),
    "hump on the support": Scenario("loads", plus_narrow_band(1.2, 0.3, 1.0, (0, 1))),
    "two speeds": Scenario("loads", two_speeds(0.2, 0.03)),
    "gusts 3 x": Scenario("loads", scaled_by(_gusts)),
    "modulation 3 x": Scenario("loads", scaled_by(_modulated)),
    "step 3 x": Scenario("loads", scaled_by(_step)),
    "one-sided": Scenario("loads", one_sided),
    "pulses each 2 s": Scenario("loads", pulses(2.0)),
    "other wind": Scenario("loads", alternative_wind(_SPEED), formulation="spectral"),
    "gain 5 % high": Scenario("instrument", instruments=Instruments(gain=(1.05, 1.0, 1.0, 1.0, 1.0))),
    "blade gain 5 % high": Scenario("instrument", instruments=Instruments(gain=(1.0, 1.0, 1.05, 1.0, 1.0))),
    "5 degrees off": Scenario("instrument", instruments=Instruments(angle=(5.0, 0.0))),
    "blades 2 ms late": Scenario("instrument", instruments=Instruments(late=0.002)),
    "clock drifts 50 ppm": Scenario("instrument", instruments=Instruments(drift=5e-5)),
    "the same, 600 s at 50 Hz": Scenario(
        "instrument", instruments=Instruments(drift=5e-5), duration=600.0, rate=50.0
    ),
    "tolerances drawn": Scenario("instrument", instruments=Instruments(drawn=(0.01, 2.0, 0.001))),
    "offsets of 5 mg": Scenario("instrument", instruments=Instruments(offset=(0.05, -0.03, 0.05, -0.1, 0.1))),
    "offsets wander": Scenario("instrument", instruments=Instruments(wander=1.0)),
    "stamps scatter by 2 ms": Scenario("instrument", instruments=Instruments(stamps=0.002)),
    "azimuth scatters by 2 degrees": Scenario("instrument", instruments=Instruments(azimuth=2.0)),
    "6 bits": Scenario("instrument", instruments=Instruments(bits=6)),
    "noise correlated 0.9": Scenario("instrument", instruments=Instruments(colour=0.9)),
    "noise with tails": Scenario("instrument", instruments=Instruments(tails=3.0)),
    "blade dead 10 s": Scenario("instrument", instruments=Instruments(dead=(40.0, 50.0))),
    "blade stuck 5 s": Scenario("instrument", instruments=Instruments(lost=(40.0, 45.0))),
    "blade clipped at 1.5 rms": Scenario("instrument", instruments=Instruments(clipped=1.5)),
    "masses 2 % more": Scenario("machine", machine=Machine(hub_mass=7.14, blade_mass=(2.55, 2.55, 2.55))),
    "one blade 2 % more": Scenario("machine", machine=Machine(blade_mass=(2.55, 2.5, 2.5))),
    "hub 2 % less": Scenario("machine", machine=Machine(hub_mass=6.86)),
    "imbalance of 18 N": Scenario("machine", machine=Machine(eccentricity=0.06)),
    "support hardens": Scenario("machine", machine=Machine(hardening=0.05)),
    "dry friction": Scenario("machine", machine=Machine(friction=0.5)),
    "play in the support": Scenario("machine", machine=Machine(play=0.001)),
    "support 15 % softer from midway": Scenario("machine", machine=Machine(loosens=0.15, loosens_at=LEAD_IN + 50.0)),
    "all of it drawn": Scenario(HEALTHY, drawn=_anything),
    "the same, a line and a drifting clock": Scenario("instrument", drawn=partial(_anything, disturbed=True)),
}  # fmt: skip
"""By name."""


def scenario(name: str, seed: int) -> Scenario:
    """Ingredients of one record of a scenario."""
    kind = SCENARIOS[name]
    return kind if kind.drawn is None else kind.drawn(np.random.default_rng([seed, 1]))


def record(name: str, seed: int) -> Record:
    """One record of a scenario, as a user has it: accelerations, the rotor's azimuth and speed."""
    kind = scenario(name, seed)
    rng = np.random.default_rng([seed, sum(map(ord, name))])
    seconds = LEAD_IN + kind.duration + 0.1
    motion = move(kind.machine, kind.loads(rng, 2 * round(seconds * RATE) + 1))
    readings = kind.instruments.read(motion, LEAD_IN * RATE, kind.duration, kind.rate, rng)
    time = np.arange(len(readings)) / kind.rate
    psi = kind.instruments.turned(kind.machine.speed * (LEAD_IN + time), rng)
    return Record(
        time=kind.instruments.stamp(time, rng),
        values=np.column_stack([psi, np.full_like(time, kind.machine.speed), readings]),
        channels=("rotor_azimuth", "rotor_speed", *CHANNELS),
        units=("rad", "rad/s", "m/s^2", "m/s^2", "rad/s^2", "rad/s^2", "rad/s^2"),
        name=f"{name}, seed {seed}",
    )

"""How much of the damping is aerodynamic? Records with known parts, simulated, identified and separated.

A tower top moves with the damping of its structure, 0.6 % of critical either way, and that of the NREL 5 MW rotor's
air, in sets of records ("campaigns") of several rotor speeds and winds. The air's part side-side is the mean of C in
steady wind (`windsysid.simulation.wind.blades`), no straight line in Ω and V; fore-aft it is that of attached lift, N Σ
½ ρ c C_lα Ω r Δr (Burton et al., Wind Energy Handbook). A parked rotor's blades are feathered. In the campaign "a stop"
both parts come from one record in which the rotor stops, its section found by `windsysid.inspection`.

With ``--wind N`` the scale model stands N times in simulated turbulent wind with its aerodynamic feedback, parked and
running, where the truth is the mean of C on its diagonal. ``python -m validation.damping [--runs N] [--wind N]`` prints
the tables; ``--stop FILE`` writes a record with a stop.
"""

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import lru_cache
from itertools import chain, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

from windsysid.identification.identify import identify
from windsysid.inspection import inspect_record
from windsysid.mechanics.compile import compile_model
from windsysid.monitoring.damping import separate_damping
from windsysid.monitoring.separation import DampingBand
from windsysid.output.console import render
from windsysid.records.formats import write_record
from windsysid.records.record import Record
from windsysid.results.posterior import Posterior
from windsysid.simulation.integrate import integrate
from windsysid.simulation.random_loads import draw_loads
from windsysid.simulation.record import MIN_LEAD_IN_SECONDS, simulate_record
from windsysid.simulation.wind import blade_loads, packaged_wind, wind_loads
from windsysid.simulation.wind.feedback import integrate_with_feedback
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine
from windsysid.units import RPM

__all__ = ["CAMPAIGNS", "Outcome", "air_of_the_tower", "campaign", "separate_runs", "stop_record"]


RATE = 4.0
"""Of the tower's records [Hz]: what the identification of a tower takes in, so that nothing is resampled."""

FAST = 20.0
"""Of the records that identification resamples [Hz]."""

RUNNING, PARKED = 600.0, 2400.0
"""Length of a record [s]."""

QUIET = 0.3
"""Loads on the tower of a parked rotor over those of a running one."""

PRODUCING = ((12.1, 9.0), (12.1, 13.0), (12.1, 17.0))

CAMPAIGNS: dict[str, tuple[tuple[float, float], ...]] = {
    "parked and running": ((0.0, 3.0), *PRODUCING),
    "parked and running, 20 Hz": ((0.0, 3.0), *PRODUCING),
    "parked in three winds, and running": ((0.0, 3.0), (0.0, 8.0), (0.0, 14.0), *PRODUCING),
    "several speeds, none parked": ((6.9, 5.0), (6.9, 5.0), (9.0, 7.0), *PRODUCING),
    "one speed": PRODUCING,
    "a stop": (),
}
"""Rotor speed [rpm] and wind speed [m/s] of each record."""

ANEMOMETER = 0.03
"""Relative error of a record's mean wind speed."""

STOP_RPM, STOP_WIND = 7.9, 6.0
"""Rotor speed [rpm] and wind [m/s] of the stop."""

STOPS_AT, STOPS_IN, FEATHERS_IN, PARKED_FOR = 660.0, 20.0, 4.0, 1200.0
"""The stop: when [s], how long rotor and blades take [s], and how long the rotor stays parked [s]."""

THRUST, SIDE = 2e5, 3e4
"""Steady force on the top that a stop takes away, fore-aft and side-side [N]."""

FEATHERED = 75.0
"""Pitch of the scale model's parked blades [deg]: with their twist, −14° … 7° of angle of attack."""

IN_WIND: dict[str, tuple[tuple[float, float], ...]] = {
    "simulated wind, parked and running": ((0.0, 5.0), (0.0, 15.0), (55.0, 16.0), (69.6, 20.0)),
    "simulated wind, several speeds": ((35.0, 10.0), (50.0, 14.4), (69.6, 20.0), (69.6, 25.0)),
}
"""The scale model's rotor speeds [rpm] and winds [km/h]."""


class Outcome(NamedTuple):
    """One part of one coefficient in one run.

    Attributes
    ----------
    campaign, name, part
        ``structure``, or the state whose aerodynamic part it is.
    truth, found
        In % of critical; `found` is None where the records do not determine it.
    """

    campaign: str
    name: str
    part: str
    truth: float
    found: DampingBand | None


@lru_cache(maxsize=1)
def structure() -> Turbine:
    """The tower without air."""
    turbine = load_turbine("tower").exact()
    return turbine.with_values({"c_fore_aft": turbine.values["c_side_side"]})


@lru_cache(maxsize=64)
def air_of_the_tower(rotor_speed: float, wind_speed: float) -> dict[str, float]:
    """Aerodynamic damping of the tower top under the NREL 5 MW rotor [N·s/m].

    At Ω [rad/s] and V [m/s]; the blades are feathered where it is parked.
    """
    rotor, (_, blade) = load_turbine("nrel5mw").exact(), packaged_wind("nrel5mw")
    if rotor_speed == 0.0:
        blade = replace(blade, pitch_deg=90.0, induction=0.0)
    azimuth = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    wind = np.full((60, rotor.rotor.blades, len(blade.radii)), wind_speed)
    turning = np.column_stack([azimuth, np.full(60, rotor_speed)])
    made = blade_loads(rotor, blade, wind, turning, mean_speed=wind_speed)
    lift = sum(c * r * w for c, r, w in zip(blade.chords, blade.radii, blade.widths, strict=True))
    fore_aft = 0.5 * rotor.rotor.blades * blade.density * blade.lift_slope * rotor_speed * lift
    return {
        "c_side_side": float(made.damping[:, 0, 0].mean()),
        "c_fore_aft": fore_aft,
    }


def _with_air(turbine: Turbine, rotor_speed: float, wind_speed: float) -> Turbine:
    air = air_of_the_tower(rotor_speed, wind_speed)
    return turbine.with_values({name: turbine.values[name] + c for name, c in air.items()})


def campaign(name: str, seed: int) -> list[Outcome]:
    """Simulate, identify and separate the records of one campaign."""
    prior = load_turbine("tower").exact()
    if name == "a stop":
        record = stop_record(seed)
        (stop,) = inspect_record(record, prior).stops
        sections = ((MIN_LEAD_IN_SECONDS, STOPS_AT), (stop.start, stop.end))
        results = [identify(record, prior, formulation="joint", section=section).posterior for section in sections]
        return _outcomes(
            name,
            results,
            structure(),
            {
                _state(1, STOP_RPM, f"{STOP_WIND:g} m/s"): air_of_the_tower(STOP_RPM / RPM, STOP_WIND),
                _state(2, 0.0, ""): {},
            },
        )
    results, parts = [], {}
    for k, (rpm, wind) in enumerate(CAMPAIGNS[name]):
        speed = rpm / RPM
        still = speed == 0.0
        machine = replace(_with_air(structure(), speed, wind), rotor_speed=speed)
        if still:
            machine = replace(machine, loads=tuple(replace(load, rms=QUIET * load.rms) for load in machine.loads))
        draw = 1000 * seed + k
        rate = FAST if name.endswith("20 Hz") else RATE
        record = simulate_record(machine, duration=PARKED if still else RUNNING, rate=rate, seed=draw)
        read = wind * (1.0 + ANEMOMETER * np.random.default_rng(draw).standard_normal())
        record = record.with_channels({"wind_speed": (np.full(record.samples, read), "m/s")})
        results.append(identify(record, prior, formulation="joint").posterior)
        parts[_state(k + 1, rpm, f"{wind:g} m/s")] = air_of_the_tower(speed, wind)
    return _outcomes(name, results, structure(), parts)


def _outcomes(
    name: str, results: Sequence[Posterior], truth: Turbine, air: Mapping[str, Mapping[str, float]]
) -> list[Outcome]:
    """Separated damping compared with the truth; `air` has the truth of each record, by the name of its state."""
    outcomes = []
    for split in separate_damping(results).splits:
        coordinate = split.name.removeprefix("c_")
        percent = 0.02 * truth.inertia(coordinate) * truth.natural_frequency(coordinate)
        parts = [("structure", truth.values[split.name], split.structural)]
        parts += [
            (state, true[split.name], band)
            for (state, true), band in zip(air.items(), split.aerodynamic, strict=True)
            if state.startswith("air")
        ]
        outcomes += [
            Outcome(name, split.name, part, true / percent, None if band is None else band.over(percent))
            for part, true, band in parts
        ]
    return outcomes


def _state(index: int, rpm: float, wind: str) -> str:
    """Name of a record's state."""
    return f"air {index}, {rpm:g} rpm, {wind}" if rpm else f"parked {index}"


def stop_record(seed: int) -> Record:
    """The tower's record of a stop: blades feather within `FEATHERS_IN`, the rotor stands after `STOPS_IN`."""
    turbine, rng = structure(), np.random.default_rng(seed)
    model = compile_model(turbine.model, turbine.sensors)
    time = np.arange(round((STOPS_AT + PARKED_FOR) * RATE)) / RATE
    spin = np.clip(1.0 - (time - STOPS_AT) / STOPS_IN, 0.0, 1.0)
    grip = np.clip(1.0 - (time - STOPS_AT) / FEATHERS_IN, 0.0, 1.0)
    speed = STOP_RPM / RPM * spin
    azimuth = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) / RATE)])
    loads = draw_loads(turbine.loads, model.loads, len(time), RATE, rng, azimuth)
    loads = loads * (QUIET + (1.0 - QUIET) * grip)[:, None] + np.outer(grip, [SIDE, THRUST])
    still = np.zeros((len(time), 3))  # the nacelle does not yaw
    inputs = np.hstack([azimuth[:, None], speed[:, None], still, loads])
    running, parked = (_with_air(turbine, rpm / RPM, STOP_WIND) for rpm in (STOP_RPM, 0.0))
    at = np.zeros(len(model.states))
    at[: len(model.loads)] = [
        force / turbine.values[f"k_{q}"] for q, force in zip(turbine.model.coordinates, (SIDE, THRUST), strict=True)
    ]
    readings = np.empty((len(time), model.readings))
    first = 0
    for last in (*range(round(STOPS_AT * RATE), round((STOPS_AT + FEATHERS_IN) * RATE) + 1), len(time) - 1):
        now = 0.5 * (grip[first] + grip[last])
        p = np.array([parked.values[q] + now * (running.values[q] - parked.values[q]) for q in model.parameters])
        part = integrate(model, p, inputs[first : last + 1], rate=RATE, start=at)
        readings[first : last + 1], at, first = part.readings, part.states[-1], last
    readings = readings + rng.standard_normal(readings.shape) * [sensor.noise for sensor in turbine.sensors]
    return Record(
        time=time,
        values=np.column_stack([np.mod(azimuth, 2.0 * np.pi), speed, np.full_like(time, STOP_WIND), readings]),
        channels=("rotor_azimuth", "rotor_speed", "wind_speed", *(sensor.channel for sensor in turbine.sensors)),
        units=("rad", "rad/s", "m/s", *(sensor.unit for sensor in turbine.sensors)),
        name=f"simulated stop, seed {seed}",
    )


def in_wind(name: str, seed: int) -> list[Outcome]:
    """The scale model in simulated wind with feedback, parked and running."""
    turbine, rate, duration = load_turbine("verne555").exact(), 100.0, 100.0
    conditions, working = packaged_wind("verne555")
    model = compile_model(turbine.model, turbine.sensors)
    p = np.array([turbine.values[name] for name in model.parameters])
    lead, names = round(MIN_LEAD_IN_SECONDS * rate), [f"c_{q}" for q in turbine.model.coordinates]
    results, parts = [], {}
    for k, (rpm, kmh) in enumerate(IN_WIND[name]):
        rng = np.random.default_rng(1000 * seed + k)
        time = np.arange(round((MIN_LEAD_IN_SECONDS + duration) * rate)) / rate
        rotor = np.column_stack([rpm / RPM * time + 1.0, np.full_like(time, rpm / RPM), np.zeros_like(time)])
        blade = working if rpm else replace(working, pitch_deg=FEATHERED, induction=0.0)
        wind = wind_loads(turbine, replace(conditions, speed=kmh / 3.6), blade, rotor, rate=rate, seed=1000 * seed + k)
        start = np.zeros(len(model.states))
        response, _ = integrate_with_feedback(
            model, p, np.hstack([rotor, wind.loads]), wind.damping, rate=rate, start=start
        )
        noise = rng.standard_normal(response.readings.shape) * [sensor.noise for sensor in turbine.sensors]
        known = [np.mod(rotor[:, :1], 2.0 * np.pi), rotor[:, 1:2], wind.hub_speed[:, None]]
        record = Record(
            time=time[: len(time) - lead],
            values=np.hstack([*known, response.readings + noise])[lead:],
            channels=("rotor_azimuth", "rotor_speed", "wind_speed", *(sensor.channel for sensor in turbine.sensors)),
            units=("rad", "rad/s", "m/s", *(sensor.unit for sensor in turbine.sensors)),
            name=f"{rpm:g} rpm, {kmh:g} km/h, seed {seed}",
        )
        results.append(identify(record, turbine, formulation="joint").posterior)
        air = wind.damping[lead:].mean(axis=0).diagonal().tolist()
        parts[_state(k + 1, rpm, f"{kmh:g} km/h")] = dict(zip(names, air, strict=True))
    return _outcomes(name, results, turbine, parts)


def separate_runs(runs: int, names: Sequence[str] = tuple(CAMPAIGNS)) -> Iterator[list[Outcome]]:
    """Every campaign, seeds 0, 1, …; the same on any number of processors."""
    with ProcessPoolExecutor() as pool:
        yield from pool.map(_one, product(names, range(runs)))


def _one(which: tuple[str, int]) -> list[Outcome]:
    name, seed = which
    return in_wind(name, seed) if name in IN_WIND else campaign(name, seed)


def main() -> None:
    """Print errors, bands and how often they hold."""
    from rich.console import Console
    from rich.progress import track
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.damping", description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="times that each campaign of the tower is simulated (20)")
    parser.add_argument("--wind", type=int, default=0, help="times that the scale model stands in simulated wind (0)")
    parser.add_argument(
        "--stop", type=Path, metavar="FILE", help="write the record of a stop, seed 0, and do nothing else"
    )
    options = parser.parse_args()
    if options.stop is not None:
        write_record(stop_record(0), options.stop)
        return
    asked = [(tuple(CAMPAIGNS), options.runs), (tuple(IN_WIND), options.wind)]
    total = sum(len(names) * runs for names, runs in asked)
    found = chain.from_iterable(separate_runs(runs, names) for names, runs in asked if runs)
    listed = list(track(found, total=total, description="damping", console=Console(stderr=True)))
    outcomes = list(chain.from_iterable(listed))
    for name in dict.fromkeys(outcome.campaign for outcome in outcomes):
        of = [outcome for outcome in outcomes if outcome.campaign == name]
        runs = sum(run[0].campaign == name for run in listed)
        table = Table(title=f"{name}: {runs} runs; c in % of critical", title_justify="left")
        for heading in ("coefficient", "part"):
            table.add_column(heading)
        for heading in ("truth", "mean found", "rms error", "±2σ, median", "±2σ holds"):
            table.add_column(heading, justify="right")
        for key in dict.fromkeys((outcome.name, outcome.part) for outcome in of):
            table.add_row(*key, *_cells([outcome for outcome in of if (outcome.name, outcome.part) == key]))
        for part in ("structure", "air"):
            table.add_row(
                "all", part, "", "", "", "", _held([outcome for outcome in of if outcome.part.startswith(part)])
            )
        print(render(table))


def _cells(outcomes: Sequence[Outcome]) -> tuple[str, ...]:
    """Truth, mean, rms error, half-width of the band, coverage."""
    truth = np.array([o.truth for o in outcomes if o.found is not None])
    shown = f"{np.mean([o.truth for o in outcomes]):.2f}"
    if not truth.size:
        return shown, "not told", "", "", ""
    value, low, high = np.array([o.found for o in outcomes if o.found is not None]).T
    error = math.sqrt(float(np.mean((value - truth) ** 2)))
    return shown, f"{value.mean():.2f}", f"{error:.2f}", f"{0.5 * np.median(high - low):.2f}", _held(outcomes)


def _held(outcomes: Sequence[Outcome]) -> str:
    inside = [o.found.low < o.truth < o.found.high for o in outcomes if o.found is not None]
    return f"{100.0 * np.mean(inside):.0f} % of {len(inside)}" if inside else ""


if __name__ == "__main__":
    main()

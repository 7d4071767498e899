"""Cost of bad records: the reference scenario, damaged in one way after another.

``python -m validation.robustness [--runs N] [--speed FILE]`` prints the table. Every row has the same seeds and priors
as the clean case; FILE is a record of the rotor speed of a real turbine in operation (time_s, rotor_speed_rpm), scaled
to the scale model's mean speed.
"""

import argparse
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from validation.calibration import DURATION, RATE, Run, judge, measured, stationary
from windsysid._types import Array
from windsysid.errors import RecordError
from windsysid.output.console import render
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.turbine.turbine import Turbine

__all__ = ["DAMAGES", "cases", "varying_speed"]

Damage = Callable[[Record, np.random.Generator], Record]


def _readings(record: Record) -> NDArray[np.bool_]:
    """Mask of the accelerometer columns."""
    return np.array([channel.endswith("acceleration") for channel in record.channels])


def missing(record: Record, rng: np.random.Generator) -> Record:
    """A fifth of the accelerometers' samples is missing, at random."""
    lost = (rng.random(record.values.shape) < 0.2) & _readings(record)
    return replace(record, values=np.where(lost, np.nan, record.values))


def hole(record: Record, rng: np.random.Generator) -> Record:
    """Five seconds in the middle are missing altogether."""
    start = 0.5 * DURATION
    lost = ((record.time >= start) & (record.time < start + 5.0))[:, None] & _readings(record)
    return replace(record, values=np.where(lost, np.nan, record.values))


def outliers(record: Record, rng: np.random.Generator) -> Record:
    """One sample in a hundred is off by twenty standard deviations of its channel's noise."""
    noise = np.array([{"b": 0.1, "t": 0.05}.get(channel[0], 0.0) for channel in record.channels])
    off = (rng.random(record.values.shape) < 0.01) * rng.choice([-20.0, 20.0], record.values.shape)
    return replace(record, values=record.values + off * noise * _readings(record))


def one_blade(record: Record, rng: np.random.Generator) -> Record:
    """Two of the three blades have no sensor."""
    return record.select([c for c in record.channels if not c.startswith(("blade_2", "blade_3"))])


def time_stamps(record: Record, rng: np.random.Generator) -> Record:
    """Time stamps are wrong by 1 ms, a tenth of the sampling interval."""
    return replace(record, time=record.time + 1e-3 * rng.standard_normal(record.samples))


def twelve_bits(record: Record, rng: np.random.Generator) -> Record:
    """Converters of 12 bits over ±4 rms; what is beyond is cut off."""
    rms = np.sqrt(np.mean(record.values**2, axis=0))
    step = 8.0 * rms / 4096.0
    coded = np.clip(np.rint(record.values / step), -2048, 2047) * step
    return replace(record, values=np.where(_readings(record), coded, record.values))


DAMAGES: dict[str, Damage] = {
    "clean": lambda record, rng: record,
    "20 % of samples missing": missing,
    "a hole of 5 s": hole,
    "1 % outliers of 20σ": outliers,
    "two blades without sensors": one_blade,
    "time stamps wrong by 1 ms": time_stamps,
    "12-bit converters, ±4 rms": twelve_bits,
}


LEVELS = {"load_x": 2.0, "load_y": 1.0, "load_beta_1": 1.0, "load_beta_2": 1.5, "load_beta_3": 2.0}
"""Factor by which loads exceed those in the turbine file, one for each degree of freedom."""

TIME_CONSTANTS = {"load_x": 0.5, "load_y": 2.0, "load_beta_1": 0.5, "load_beta_2": 1.0, "load_beta_3": 2.0}
"""Of the loads [s], where the file says 1 s for all."""

FINE = 400.0
"""[Hz], of records that are read less often."""


def uneven(turbine: Turbine) -> Turbine:
    """The scale model with loads of different levels."""
    return replace(turbine, loads=tuple(replace(load, rms=load.rms * LEVELS[load.load]) for load in turbine.loads))


def unlike(turbine: Turbine) -> Turbine:
    """The scale model with loads of different time constants."""
    return replace(
        turbine, loads=tuple(replace(load, time_constant=TIME_CONSTANTS[load.load]) for load in turbine.loads)
    )


def two_blades(turbine: Turbine) -> Turbine:
    """The scale model with two blades."""
    fewer = turbine.with_model(replace(turbine.rotor, blades=2))
    keep = set(fewer.model.loads)
    return replace(
        fewer,
        loads=tuple(load for load in fewer.loads if load.load in keep),
        sensors=tuple(sensor for sensor in fewer.sensors if sensor.blade < 3),
    )


def varying_speed(turbine: Turbine, path: Path) -> Array:
    """ψ, Ω, dΩ/dt (T, 3) of the scale model where its speed varies as a real turbine's did, in proportion.

    Raises
    ------
    RecordError
        If the file is not there or does not hold what is needed.
    """
    try:
        columns = np.genfromtxt(path, delimiter=",", names=True)
        then, speed = columns["time_s"], columns["rotor_speed_rpm"]
    except (OSError, ValueError, IndexError) as error:
        raise RecordError(f"{path}: expected a CSV file with columns time_s and rotor_speed_rpm ({error})") from None
    time = np.arange(round(DURATION * RATE)) / RATE
    omega = (
        turbine.rotor_speed * np.interp(time, then - then[0], speed) / float(np.mean(speed[then - then[0] <= DURATION]))
    )
    psi = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1])) / RATE])
    return np.column_stack([psi, omega, np.gradient(omega, 1.0 / RATE)])


def _clean(seed: int, damage: str) -> Run:
    turbine = load_turbine("verne555").exact()
    record = DAMAGES[damage](stationary(turbine, seed), np.random.default_rng([seed, 3]))
    return judge(record, turbine, seed)


def _two_blades(seed: int) -> Run:
    turbine = two_blades(load_turbine("verne555").exact())
    return judge(stationary(turbine, seed), turbine, seed)


def _other_loads(seed: int, loads: Callable[[Turbine], Turbine]) -> Run:
    turbine = load_turbine("verne555").exact()
    return judge(stationary(loads(turbine), seed), turbine, seed)


def _read_rarely(seed: int, rate: float, duration: float) -> Run:
    turbine = load_turbine("verne555").exact()
    fine = simulate_record(turbine, duration=duration, rate=FINE, seed=seed)
    every = round(FINE / rate)
    return judge(replace(fine, time=fine.time[::every], values=fine.values[::every]), turbine, seed)


def _varying(seed: int, rotor: Array) -> Run:
    turbine = load_turbine("verne555").exact()
    return judge(measured(turbine, rotor, seed), turbine, seed)


def cases(speed: Path | None) -> dict[str, Callable[[int], Run]]:
    """One run of each row of the table, by its seed."""
    found: dict[str, Callable[[int], Run]] = {name: partial(_clean, damage=name) for name in DAMAGES}
    if speed is not None:
        found["rotor speed of a real turbine"] = partial(
            _varying, rotor=varying_speed(load_turbine("verne555").exact(), speed)
        )
    return found | {
        "two blades": _two_blades,
        "loads 2 : 1 on x and y, 1 : 1.5 : 2 on the blades": partial(_other_loads, loads=uneven),
        "time constants of loads 0.5 … 2 s": partial(_other_loads, loads=unlike),
        "20 readings a second": partial(_read_rarely, rate=20.0, duration=DURATION),
        "600 s, 50 readings a second": partial(_read_rarely, rate=50.0, duration=600.0),
    }


def main() -> None:
    """Print what each damage costs."""
    from rich.console import Console
    from rich.progress import track
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="python -m validation.robustness", description=__doc__)
    parser.add_argument("--runs", type=int, default=20, help="records per row (20)")
    parser.add_argument("--speed", type=Path, help="CSV of a real turbine's rotor speed: time_s, rotor_speed_rpm")
    parser.add_argument("--only", nargs="+", default=[""], metavar="BEGINNING", help="rows whose names begin so (all)")
    options = parser.parse_args()
    try:
        rows = {name: run for name, run in cases(options.speed).items() if name.startswith(("clean", *options.only))}
    except RecordError as error:
        parser.error(str(error))
    jobs = [(name, seed) for name in rows for seed in range(options.runs)]
    with ProcessPoolExecutor() as pool:
        waiting = [pool.submit(rows[name], seed) for name, seed in jobs]
        shown = track(waiting, description="robustness", console=Console(stderr=True))
        runs = [job.result() for job in shown]
    table = Table(
        title=f"{options.runs} runs of {DURATION:g} s if not said otherwise, priors 30 % off, statistics not given",
        title_justify="left",
    )
    table.add_column("record")
    for heading in ("±2σ holds", "rms error: k_x", "k_β", "c_x", "c_β", "over clean: k", "c"):
        table.add_column(heading, justify="right")
    clean: Array | None = None
    for name in rows:
        mine = [run for run, (of, _) in zip(runs, jobs, strict=True) if of == name]
        holds = 100.0 * np.mean(np.abs([run.deviation[0] for run in mine]) < 2.0)
        rms = 100.0 * np.sqrt(
            np.mean(np.square([run.relative[0] for run in mine]), axis=0)
        )  # k_x, c_x, k_y, c_y, k_β1, c_β1 …
        four = np.array([rms[0], np.sqrt(np.mean(rms[4::2] ** 2)), rms[1], np.sqrt(np.mean(rms[5::2] ** 2))])
        both = np.array([np.sqrt(np.mean(rms[i::2] ** 2)) for i in (0, 1)])
        clean = both if clean is None else clean
        table.add_row(
            name, f"{holds:.1f} %", *(f"{value:.2f} %" for value in four), *(f"{x:.2f}" for x in both / clean)
        )
    print(render(table))


if __name__ == "__main__":
    main()

"""Records to try the commands on: a tower of two years, parked, a rotor in wind, a building, and a logger's CSV.

All are simulated with fixed seeds, so that their truth is known; nothing is packaged but this module.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np

from windsysid.output.files import claim_file
from windsysid.output.progress import Progress, unheard
from windsysid.records.formats import write_record
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine
from windsysid.units import RPM, to_si

__all__ = ["Building", "building", "write_examples"]

_SOFTENING = 0.97
"""Setting: side-side stiffness of the tower's second year over that of the first."""
FILES = (
    ("tower_year1.csv", "a running turbine, two accelerometers, 10 min", "identify tower_year1.csv --turbine tower"),
    ("tower_year2.csv", "a year later, 3 % softer side-side", "identify tower_year2.csv --turbine tower"),
    ("both of them", "what changed?", "compare results/tower_year1 results/tower_year2"),
    ("tower_parked.csv", "the tower with its rotor at rest", "identify tower_parked.csv --turbine tower"),
    ("rotor_wind.csv", "a scale model in wind, sensors on blades", "identify rotor_wind.csv --turbine verne555"),
    ("building.csv", "five storeys in ambient vibration, no model", "oma building.csv"),
    ("logger.csv", "a tower, with a logger's names and units", "start logger.csv --turbine tower"),
)
"""Examples, each with a description and a command."""


class Building(NamedTuple):
    """A simulated record of a building, and its true modes: frequency [Hz] and damping ratio."""

    record: Record
    modes: tuple[tuple[float, float], ...]


def write_examples(folder: str | Path, progress: Progress = unheard) -> list[Path]:
    """Write all example records and a README.md with a command for each.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    OutputError
        If one of the files is there already, or cannot be written.
    """
    tower = load_turbine("tower")
    softer = tower.with_values({"k_side_side": _SOFTENING * tower.values["k_side_side"]})
    ten_minutes = partial(simulate_record, duration=600.0, rate=20.0)
    records: dict[str, Callable[[], Record]] = {
        "tower_year1": lambda: replace(ten_minutes(tower, seed=1), start="2024-05-02T10:00:00Z"),
        "tower_year2": lambda: replace(ten_minutes(softer, seed=2), start="2025-05-02T10:00:00Z"),
        "tower_parked": lambda: ten_minutes(tower.in_state("parked"), seed=3),
        "rotor_wind": lambda: simulate_record("verne555", duration=130.0, rate=50.0, seed=3, loads="wind-feedback"),
        "building": lambda: building().record,
    }
    written = []
    for i, (name, made) in enumerate(records.items()):
        path = Path(folder) / f"{name}.csv"
        progress(str(path), i / len(records))
        write_record(made(), path)
        written.append(path)
    for name, text in (("logger.csv", _as_logged(ten_minutes(tower, seed=4))), ("README.md", _readme())):
        path = Path(folder) / name
        with claim_file(path) as write:
            write(partial(_put, text.encode()))
        written.append(path)
    return written


def building(storeys: int = 5, *, duration: float = 600.0, rate: float = 50.0, seed: int = 1) -> Building:
    """Simulate accelerometers on the floors of a shear frame under white forces, with 1 % of noise.

    Storeys are alike, the highest mode is at 12 Hz, every damping ratio is 1 %.

    Examples
    --------
    >>> found = building(2, duration=10.0)
    >>> found.record.channels
    ('floor_1_acceleration', 'floor_2_acceleration')
    >>> [round(frequency, 2) for frequency, _ in found.modes]
    [4.58, 12.0]
    """
    from scipy.signal import cont2discrete, lfilter

    rng = np.random.default_rng(seed)
    pattern = 2.0 * np.eye(storeys) - np.eye(storeys, k=1) - np.eye(storeys, k=-1)
    pattern[-1, -1] = 1.0
    squares, shapes = np.linalg.eigh(pattern)
    omega = 2.0 * math.pi * 12.0 * np.sqrt(squares / squares[-1])
    forces = rng.standard_normal((round(duration * rate), storeys)) @ shapes
    answers = []
    for j, w in enumerate(omega):
        system = np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.02 * w, w * w])
        numerator, denominator, _ = cont2discrete(system, 1.0 / rate)
        answers.append(lfilter(numerator.ravel(), denominator, forces[:, j]))
    exact = np.column_stack(answers) @ shapes.T
    values = 0.01 * (exact + 0.01 * exact.std(axis=0) * rng.standard_normal(exact.shape))
    names = tuple(f"floor_{i}_acceleration" for i in range(1, storeys + 1))
    record = Record(np.arange(len(values)) / rate, values, names, ("m/s^2",) * storeys, name="building")
    return Building(record, tuple((float(w) / (2.0 * math.pi), 0.01) for w in omega))


def _readme() -> str:
    """A page that lists the files."""
    about = "All records are simulated: the truth is known. Results go to results/; each command prints where."
    rows = [f"| {name} | {what} | `windsysid {command}` |" for name, what, command in FILES]
    return "\n".join(
        ["# Examples of windsysid", "", about, "", "| file | record | command |", "|---|---|---|", *rows, ""]
    )


def _put(content: bytes, file: BinaryIO) -> None:
    file.write(content)


def _as_logged(record: Record) -> str:
    """A tower's record as a logger writes it: other names and units, few digits."""
    mg = to_si(1.0, "mg")
    columns = (
        record["tower_z_acceleration"] / mg, record["tower_x_acceleration"] / mg, record["rotor_speed"] * RPM
    )  # fmt: skip
    lines = ["Time (s);Acc tower top FA (mg);Acc tower top SS (mg);Rotor speed (rpm)"]
    rows = zip(record.time, *columns, strict=True)
    lines += [f"{t:.2f};{a:.2f};{b:.2f};{n:.2f}" for t, a, b, n in rows]
    return "\n".join(lines) + "\n"

"""Cost of a row of an archive by the spectral formulation, as a function of length, sensors and harmonics K.

    python benchmarks/spectral_cost.py

Processor time of reading a netCDF file at 100 Hz and of `windsysid.fleet.rows.row_of`: the least of three runs, after
one that compiles. K, the highest harmonic of the rotor in one lifted vector, follows from the rotor's speed; a tower on
which nothing that moves turns has none.
"""

import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from sheets import Sheet, number, present

from windsysid import Turbine, load_turbine, read_record, write_record
from windsysid.fleet.rows import empty_row, row_of
from windsysid.records.record import Record
from windsysid.simulation.record import simulate_record

RATE, RUNS = 100.0, 3


def cost(record: Record, turbine: Turbine) -> float:
    """Processor time of a row [s], from the file on."""
    seconds = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.nc"
        write_record(record, path)
        for _ in range(RUNS + 1):
            begun = time.process_time()
            row = row_of(empty_row("", 0, ""), read_record(path), turbine, None, "spectral")
            seconds.append(time.process_time() - begun)
            if row["status"] != "ok":
                raise SystemExit(f"{record.name}: {row['why']}")
    return min(seconds[1:])


def sheets(short: bool) -> Iterator[Sheet]:
    """The three tables."""
    tower, rotor = load_turbine("tower"), load_turbine("verne555")
    rows, costs = [], {}
    for turbine, loads, lengths in (
        (tower, "random", (150.0, 600.0) if short else (150.0, 600.0, 3600.0)),
        (rotor, "rotor-wind", (100.0,) if short else (100.0, 300.0, 600.0)),
    ):
        for duration in lengths:
            found = cost(simulate_record(turbine, duration=duration, rate=RATE, seed=7, loads=loads), turbine)
            rows.append((turbine.name, f"{duration:g}", number(found), number(1e6 * found / (duration * RATE))))
            costs[f"spectral, {turbine.name}, {duration:g} s"] = found
    yield Sheet("Spectral: cost against length", ("turbine", "s", "s of the processor", "µs per sample"), rows, costs)

    record = simulate_record(rotor, duration=100.0, rate=RATE, seed=7, loads="rotor-wind")
    rows, costs = [], {}
    for sensors in (rotor.sensors[:2], rotor.sensors[2:], rotor.sensors):
        found = cost(record, replace(rotor, sensors=sensors))
        rows.append((str(len(sensors)), ", ".join(s.channel for s in sensors), number(found)))
        costs[f"spectral, {len(sensors)} sensors"] = found
    yield Sheet("Spectral: cost against sensors, 100 s", ("sensors", "which", "s of the processor"), rows, costs)

    rows, costs = [], {}
    for share in (1.0,) if short else (1.5, 1.0, 0.75):
        turbine = replace(rotor, rotor_speed=share * rotor.rotor_speed)
        found = cost(simulate_record(turbine, duration=100.0, rate=RATE, seed=7, loads="rotor-wind"), turbine)
        rows.append((f"{share:g}", number(found)))
        costs[f"spectral, {share:g} of the usual speed"] = found
    yield Sheet(
        "Spectral: cost against the rotor's speed, 100 s: more slowly, K is higher",
        ("rotor speed, of the usual one", "s of the processor"), rows, costs,
    )  # fmt: skip


if __name__ == "__main__":
    present(__doc__, sheets)

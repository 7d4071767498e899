"""Is an archive what it says? Kills, a full disk, a year of ten sisters, records a second.

``python -m validation.fleet --kills 20``: some short records are taken into an archive, undisturbed and then with
workers killed (signal 9) at random instants, the run itself killed, and the disk full once. Nothing may be lost or
there twice, and the files of both archives must have the same bytes.

``python -m validation.fleet --years 3``: years of ten sisters, one 10-minute record an hour, simulated as what the
records would say (as validation/years.py does; bands from `windsysid.plan`). Sisters scatter by 1 %. One is softened by
3 % in May, the sensor of one fails in July, one is iced in January; then the same of healthy sisters. All sisters have
the same weather; turbines stop, and idle in little wind.

``python -m validation.fleet --speed 24``: so many records by one and by two workers.
"""

import argparse
import math
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from validation.years import Site, site
from windsysid._types import Array
from windsysid.fleet.archive import add_rows, place_of, read_table, table_of
from windsysid.fleet.batch import batch
from windsysid.fleet.overview import Overview, overview_of
from windsysid.fleet.rows import Row, empty_row
from windsysid.records.formats import write_record
from windsysid.simulation.record import simulate_record
from windsysid.turbine.file import load_turbine

__all__ = ["Fault", "kills", "main", "simulate_fleet"]

BEGIN = datetime(2025, 9, 1, tzinfo=UTC)
HOUR = 3600.0
YEAR_HOURS = 8766
SCATTER = 0.01
"""Standard deviation of true coefficients from sister to sister."""


class Fault(NamedTuple):
    """What is wrong with one turbine: which, what, from when to when."""

    turbine: str
    kind: str
    begin: datetime
    end: datetime


FAULTS = (
    Fault("T03", "soft", datetime(2026, 5, 12, tzinfo=UTC), datetime(2027, 1, 1, tzinfo=UTC)),
    Fault("T05", "sensor", datetime(2026, 7, 6, tzinfo=UTC), datetime(2027, 1, 1, tzinfo=UTC)),
    Fault("T08", "ice", datetime(2026, 1, 14, tzinfo=UTC), datetime(2026, 1, 20, tzinfo=UTC)),
)
"""3 % less stiffness; spikes; 4 % less stiffness for six days."""

NAMED = {"T03": "turbine", "T05": "sensor", "T08": "ice"}
"""What the page should call them."""


def simulate_fleet(
    place: Site, seed: int, *, turbines: int = 10, hours: int = YEAR_HOURS, faults: tuple[Fault, ...] = ()
) -> Iterator[tuple[str, list[Row]]]:
    """Turbines and their rows, one an hour."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, HOUR * hours, HOUR)
    year = 2.0 * np.pi * (time + (BEGIN - datetime(BEGIN.year, 1, 15, tzinfo=UTC)).total_seconds()) / (365.25 * 86400.0)
    season = 8.0 - 10.0 * np.cos(year) + 4.0 * np.sin(2.0 * np.pi * time / 86400.0)
    temperature = season + 3.0 * _memory(rng, hours, 72.0)
    wind = 8.0 * np.exp(0.35 * _memory(rng, hours, 12.0) - 0.06)
    for number in range(1, turbines + 1):
        name = f"T{number:02d}"
        mine = [fault for fault in faults if fault.turbine == name]
        own = np.random.default_rng([seed, number])
        yield name, _rows(place, own, name, time, temperature, wind * np.exp(0.05 * _memory(own, hours, 3.0)), mine)


def _rows(
    place: Site, rng: np.random.Generator, name: str, time: Array, temperature: Array, wind: Array, faults: list[Fault]
) -> list[Row]:
    """Rows of one turbine."""
    hours = len(time)
    parked = np.zeros(hours, dtype=bool)
    for begin in rng.integers(0, hours, 12):  # stops of half a day to two days
        parked[begin : begin + int(rng.integers(12, 48))] = True
    idle = ~parked & (wind < 4.0)
    state = np.where(parked, "parked", np.where(idle, "idling", "running"))
    inside = {
        fault.kind: (time >= (fault.begin - BEGIN).total_seconds()) & (time < (fault.end - BEGIN).total_seconds())
        for fault in faults
    }
    columns = {}
    failing = inside.get("sensor", np.zeros(hours, dtype=bool)) & (rng.random(hours) < 0.6)
    for coefficient, sigma in zip(place.names, place.sigma, strict=True):
        stiff = coefficient.startswith("k_")
        steps = (0.0002 if stiff else 0.01) / math.sqrt(24.0) * rng.standard_normal(hours)
        truth = np.cumsum(steps) + SCATTER * rng.standard_normal()
        if stiff:
            truth = truth - 0.0003 * (temperature - 8.0)
            truth = truth + math.log(0.97) * inside.get("soft", 0.0) + math.log(0.96) * inside.get("ice", 0.0)
        else:
            truth = (1.0 + truth) * np.where(parked | idle, 0.5, 1.0 + 0.5 * (wind / 8.0 - 1.0))
        bad = rng.random(hours) < 0.005
        errors = 1.2 * sigma * rng.standard_normal(hours) * np.where(bad, 10.0, 1.0)
        errors += np.where(failing, 6.0 * sigma * rng.standard_normal(hours), 0.0)
        columns[coefficient] = truth + errors
    lost = rng.random(hours) < 0.03
    out = int(rng.integers(0, hours - 24 * 14))
    lost[out : out + 24 * 7] = True
    refused = failing & (rng.random(hours) < 0.3)
    rows = []
    for i in np.flatnonzero(~lost):
        start = BEGIN + timedelta(seconds=float(time[i]))
        row = empty_row(f"/data/{name}/{start:%Y%m%d_%H%M}.csv", 1, "simulated")
        row |= {
            "status": "refused" if refused[i] else "ok", "why": "spikes" if refused[i] else None,
            "start": start.isoformat().replace("+00:00", "Z"), "duration": 600.0, "state": str(state[i]),
            "trusted": None if refused[i] else bool(not failing[i]), "scada_wind_speed": float(wind[i]),
            "scada_temperature": float(temperature[i]),
            "rotor_speed": 0.0 if parked[i] else 0.2 if idle[i] else float(np.clip(0.11 * wind[i], 0.7, 1.267)),
        }  # fmt: skip
        if failing[i]:
            row["health"] = [
                {"channel": "tower_x_acceleration", "kind": "spikes", "severity": "warning", "text": "", "count": 9}
            ]
        if not refused[i]:
            row["parameters"] = [
                _parameter(name, float(columns[name][i]), float(sigma))
                for name, sigma in zip(place.names, place.sigma, strict=True)
            ]
        rows.append(row)
    return rows


def _parameter(name: str, own: float, sigma: float) -> Row:
    stiff = name.startswith("k_")
    return {
        "name": name, "unit": "N/m" if stiff else "N*s/m", "kind": "stiffness" if stiff else "damping",
        "prior_centre": 1.8e6 if stiff else 2e4, "prior_spread": 0.3, "logarithmic": stiff, "coordinate_scale": 2e4,
        "own": own, "own_std": sigma,
    }  # fmt: skip


def _memory(rng: np.random.Generator, count: int, hours: float) -> Array:
    """A first-order Gauss–Markov series of unit variance (count,)."""
    from scipy.signal import lfilter

    a = math.exp(-1.0 / hours)
    noise = math.sqrt(1.0 - a * a) * rng.standard_normal(count)
    return np.asarray(lfilter([1.0], [1.0, -a], noise, zi=[a * rng.standard_normal()])[0])


def write_fleet(place: Site, seed: int, archive: Path, **options: Any) -> None:
    """An archive of simulated rows, day by day."""
    for name, rows in simulate_fleet(place, seed, **options):
        days: dict[str, list[Row]] = {}
        for row in rows:
            days.setdefault(row["start"][:10], []).append(row)
        for day, of in days.items():
            add_rows(place_of(archive, name, day), of)


def years(fleets: int, first: int) -> None:
    """Print what the pages of some fleets name, with faults and without."""
    place = site("tower", 12.0)
    rates = ", ".join(f"{name} {100.0 * s:.2g} %" for name, s in zip(place.names, place.sigma, strict=True))
    print(f"σ of a record: {rates}")
    for faults in (FAULTS, ()):
        right = wrong = 0
        for seed in range(first, first + fleets):
            page = _page(place, seed, faults)
            kinds = {(name, event.kind) for event in page.events for name in event.turbine.split(", ")}
            wanted = set(NAMED.items()) if faults else set()
            right += len(wanted & kinds)
            wrong += len(kinds - wanted)
            print(f"seed {seed}:", *page.sentences, sep="\n  ")
        told = f"{right} of {len(NAMED) * fleets} named as they should be, " if faults else "healthy: "
        print(f"{told}{wrong} turbines named that should not be, in {fleets} years of ten turbines")


def _page(place: Site, seed: int, faults: tuple[Fault, ...]) -> Overview:
    tables = {name: table_of(rows) for name, rows in simulate_fleet(place, seed, faults=faults)}
    return overview_of(tables, Path("simulated"), alarms_per_year=0.1)


def write_records(folder: Path, count: int, *, turbines: int = 2) -> Path:
    """Short records of a tower, four a day, and the fleet file."""
    machine = load_turbine("tower")
    text = ""
    for number in range(1, turbines + 1):
        name = f"T{number:02d}"
        text += f'[[turbine]]\nname = "{name}"\npattern = "{name}/*"\nturbine = "tower"\n'
        for i in range(count // turbines):
            start = BEGIN + timedelta(hours=6 * i)
            record = simulate_record(machine, duration=300.0, rate=10.0, seed=1000 * number + i)
            record = replace(record, start=start.isoformat().replace("+00:00", "Z"))
            write_record(record, folder / name / f"{start:%Y%m%d_%H%M}.csv")
    (folder / "fleet.toml").write_text(text)
    (folder / "T01" / "damaged.csv").write_text("time,tower_x_acceleration [m/s^2]\n0,1\n1,wet\n")
    return folder / "fleet.toml"


def kills(count: int, seed: int, home: Path) -> tuple[str, bool]:
    """Kill workers and runs, and fill the disk; what came of it, and whether the archive is whole."""
    rng = random.Random(seed)
    fleet = write_records(home / "data", 16)
    begun = time.monotonic()
    batch(home / "data", fleet=fleet, archive=home / "calm", workers=2)
    longest = 0.5 * (time.monotonic() - begun)  # so that workers come to work between kills
    command = [
        sys.executable, "-m", "windsysid", "batch", str(home / "data"), "--fleet", str(fleet), "--output",
        str(home / "wild"), "--workers", "2",
    ]  # fmt: skip
    clean = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}  # Python keeps a module that it could not write whole
    full = subprocess.run(command, preexec_fn=_small_files, env=clean, capture_output=True, text=True)
    told = full.stderr.strip().splitlines()
    workers = runs = ended = 0
    while workers + runs < count or not ended:
        run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        while run.poll() is None:
            time.sleep(rng.uniform(0.0, longest))
            if workers + runs >= count:
                run.wait()
                break
            if rng.random() < 0.15:
                run.kill()
                runs += 1
            else:
                of_run = _children(run.pid)
                if of_run:
                    _kill(rng.choice(of_run))
                    workers += 1
        said = run.communicate()[1]
        code = run.returncode
        if code not in (0, -signal.SIGKILL):
            return f"a run ended with exit code {code}: {said}", False
        if code == 0:
            ended += 1
            if workers + runs < count:
                _forget_a_day(home / "wild", rng)  # work for the next run
    same = _contents(home / "calm") == _contents(home / "wild")
    rows = [row for name in ("T01", "T02") for row in read_table(home / "wild", name, ["source"]).to_pylist()]
    sources = {row["source"] for row in rows}
    told_all = (
        f"{workers} workers and {runs} runs killed, {ended} runs to their end; disk full: exit code"
        f" {full.returncode}, {len(told)} line: {told[0] if told else ''}\n"
        f"{len(rows)} rows of 17 records, {len(rows) - len(sources)} twice; same bytes as undisturbed: {same}"
    )
    return told_all, same


def _small_files() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


def _forget_a_day(archive: Path, rng: random.Random) -> None:
    files = sorted(archive.rglob("*.parquet"))
    for path in rng.sample(files, k=len(files) // 2):
        path.unlink()


def _children(pid: int) -> list[int]:
    """Processes that a process started."""
    try:
        text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
        tasks = [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/children")]
    except OSError:
        return []
    return [int(number) for number in {*text.split(), *" ".join(tasks).split()}]


def _kill(pid: int) -> None:
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return


def _contents(archive: Path) -> dict[str, bytes]:
    return {path.relative_to(archive).as_posix(): path.read_bytes() for path in archive.rglob("*.parquet")}


def speed(count: int, home: Path) -> str:
    """Records a second by one worker and by two."""
    fleet = write_records(home / "data", count)
    seconds = []
    for workers in (1, 2):
        begun = time.perf_counter()
        batch(home / "data", fleet=fleet, archive=home / f"archive_{workers}", workers=workers)
        seconds.append(time.perf_counter() - begun)
    one, two = (count / s for s in seconds)
    size = sum(path.stat().st_size for path in (home / "archive_1").rglob("*.parquet"))
    return (
        f"{count} records of 300 s at 10 Hz: {one:.2f} a second by one worker, {two:.2f} by two: efficiency"
        f" {100.0 * two / one / 2.0:.0f} %, starts of the workers included; {size / count / 1000.0:.1f} kB a record"
    )


def main() -> int:
    """Run what is asked for; 1 where something was lost."""
    parser = argparse.ArgumentParser(prog="python -m validation.fleet", description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, metavar="N", help="kill so many workers and runs")
    parser.add_argument("--years", type=int, metavar="N", help="so many years of ten turbines, faulty and healthy")
    parser.add_argument("--speed", type=int, metavar="N", help="take so many records by one and by two workers")
    parser.add_argument("--archive", type=Path, help="write the archive of one faulty year")
    parser.add_argument("--seed", type=int, default=0, help="of the first fleet, and of the instants")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as home:
        if options.kills is not None:
            told, whole = kills(options.kills, options.seed, Path(home))
            print(told)
            if not whole:
                return 1
        if options.speed is not None:
            print(speed(options.speed, Path(home)))
    if options.years is not None:
        years(options.years, options.seed)
    if options.archive is not None:
        write_fleet(site("tower", 12.0), options.seed, options.archive, faults=FAULTS)
    return 0


if __name__ == "__main__":
    sys.exit(main())
